"""The physics core: beam, outline, panels, added mass, integrator. Arrays in, arrays out."""

from swim_env.physics.fluid.models import FLUID_MODELS
from swim_env.physics.polygon import added_mass_of_polygon
from swim_env.physics.status import TERMINATION_REASONS
from swim_env.physics.surface import added_mass_of_surface

__all__ = [
    "FLUID_MODELS",
    "TERMINATION_REASONS",
    "added_mass_of_polygon",
    "added_mass_of_surface",
]
