"""The physics core: beam, outline, panels, added mass, integrator. Arrays in, arrays out."""

from typing import TYPE_CHECKING, Any

from swim_env.physics.fluid.models import FLUID_MODELS
from swim_env.physics.polygon import added_mass_of_polygon
from swim_env.physics.status import TERMINATION_REASONS

if TYPE_CHECKING:
    from swim_env.physics.surface import added_mass_of_surface

__all__ = [
    "FLUID_MODELS",
    "TERMINATION_REASONS",
    "added_mass_of_polygon",
    "added_mass_of_surface",
]


def __getattr__(name: str) -> Any:
    """Import the panels in space where they are asked for: planar programs need not wait."""
    if name == "added_mass_of_surface":
        from swim_env.physics.surface import added_mass_of_surface

        return added_mass_of_surface
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
