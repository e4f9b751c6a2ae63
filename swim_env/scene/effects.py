"""Optional effects (drag, stream, contact ...), each switched on by a block in the scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from swim_env.errors import SceneError
from swim_env.scene.block import Block
from swim_env.scene.body import Beam
from swim_env.scene.checks import Pair, pair, real
from swim_env.scene.fluid import FLUID_TABLE, NO_FLUID, Fluid


@dataclass(frozen=True)
class Effect(Block):
    """Base of the effects: a block that a scene has or does not have."""

    #: Whether the effect has no meaning without a fluid.
    needs_fluid: ClassVar[bool] = False

    def check_scene(self, beam: Beam, fluid: Fluid | None) -> None:
        """Refuse a body or a fluid with which the effect has no meaning.

        Raises
        ------
        SceneError
            If the effect has none.
        """
        if self.needs_fluid and not (fluid and fluid.present):
            raise SceneError(
                f"{self._path} has no meaning without a fluid; leave it out or give the scene a "
                "fluid"
            )


@dataclass(frozen=True)
class AxialAddedMass(Effect, path="axial_added_mass"):
    """Effect: the added mass of the elements' motion along themselves. It has no fields."""

    def check_scene(self, beam: Beam, fluid: Fluid | None) -> None:
        """Refuse all fluids but those whose end panels can have it."""
        model = NO_FLUID if fluid is None else fluid.model
        if not FLUID_TABLE[model].axial:
            fitting = " or ".join(name for name, row in FLUID_TABLE.items() if row.axial)
            raise SceneError(
                f"axial_added_mass has no meaning without fluid.model {fitting}, as it is that of "
                f"the end panels; leave it out or change the model, got {model}"
            )


@dataclass(frozen=True)
class Damping(Effect, path="damping"):
    """Effect: Kelvin-Voigt damping, a joint moment (EI/dl) t_kv d(dth)/dt.

    Attributes
    ----------
    retardation_time : float
        Retardation time t_kv [s], above 0.
    """

    retardation_time: Annotated[float, real("s", above=0.0)]

    def check_scene(self, beam: Beam, fluid: Fluid | None) -> None:
        """Refuse a body without stiffness."""
        if not beam.stiffness_at_joints().any():
            raise SceneError(
                "damping has no meaning where beam.bending_stiffness is zero everywhere, as its "
                "moment is proportional to it; leave damping out or give some stiffness"
            )


@dataclass(frozen=True)
class CrossFlowDrag(Effect, path="cross_flow_drag"):
    """Effect: quadratic drag of the flow across the body, -rho C |u| u/2 per length.

    u is the velocity along the normal, relative to the stream. It represents the vortices that an
    ideal fluid does not shed, and is the only force here that takes momentum from the body.

    Attributes
    ----------
    coefficient : float
        Drag coefficient C, above 0; about 2 for a flat plate across a steady flow.
    """

    needs_fluid = True

    coefficient: Annotated[float, real(above=0.0)] = 1.0


@dataclass(frozen=True)
class Stream(Effect, path="stream"):
    """Effect: the fluid far away moves with one velocity.

    A body in a uniform stream does what it would do in fluid at rest and is carried along; what
    drag feels is the velocity relative to the stream. `initial.velocity` is over ground. A body
    that starts at rest therefore moves at -U relative to the fluid, and as an ideal fluid exerts
    no force on steady motion, it stays where it is without any effort (but for drag, and for the
    moment that turns a slender body broadside). Start with the stream's velocity to be carried.

    Attributes
    ----------
    velocity : tuple of float
        (x, y) [m/s].
    """

    needs_fluid = True

    velocity: Annotated[Pair, pair("m/s")]


@dataclass(frozen=True)
class SelfContact(Effect, path="self_contact"):
    """Effect: a run ends where the body, as thick as it is, touches itself. It has no fields."""

    def check_scene(self, beam: Beam, fluid: Fluid | None) -> None:
        """Refuse a body without thickness."""
        if beam.half_thickness == 0.0:
            raise SceneError(
                "self_contact needs beam.half_thickness, a number above 0 in m, got 0.0"
            )


@dataclass(frozen=True)
class InternalForces(Effect, path="internal_forces"):
    """Effect: trajectories hold the forces between the elements. It has no fields."""


@dataclass(frozen=True)
class Recording(Effect, path="recording"):
    """Effect: simulators and environments keep the trajectory since the start. It has no fields."""


EFFECT_BLOCKS: dict[str, type[Effect]] = {
    "axial_added_mass": AxialAddedMass,
    "damping": Damping,
    "cross_flow_drag": CrossFlowDrag,
    "stream": Stream,
    "self_contact": SelfContact,
    "internal_forces": InternalForces,
    "recording": Recording,
}
"""The block of each effect, by its name in a scene."""

EFFECT_NAMES: tuple[str, ...] = ("bending_stiffness", *EFFECT_BLOCKS)
"""Names of the effects; the first is in `Beam`, each of the others has a block of its name."""
