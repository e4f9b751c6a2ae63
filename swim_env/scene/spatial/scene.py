"""A scene in three dimensions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SceneError
from swim_env.scene.checks import Triple
from swim_env.scene.effects import Recording
from swim_env.scene.making import KINDS
from swim_env.scene.run import EpisodeBase, Integrator, direction
from swim_env.scene.scene import AUTOMATIC, Scene, bend_of, limit_of
from swim_env.scene.spatial.body import AXIS_NAMES, SpatialBeam
from swim_env.scene.spatial.drive import SpatialActuation, SpatialDamping
from swim_env.scene.spatial.fluid import SpatialFluid, SpatialStream
from swim_env.scene.spatial.initial import SpatialInitial

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SpatialEpisode(EpisodeBase, path="episode"):
    """How a scene in three dimensions is played, see `EpisodeBase` for the fields."""

    heading: Annotated[Triple, direction("x", "y", "z")] = (-1.0, 0.0, 0.0)


@dataclass(frozen=True)
class SpatialScene(Scene):
    """A body in space, its fluid, damping, drive, start and integrator.

    Its fields are those of `Scene`, with blocks of three dimensions; damping, stream and recording
    are the only effects that have a meaning there, the others are None. The integrator's strain is
    of the averaged directors or of the joint angle.
    """

    # Every block is that of its dimension and no planar one in disguise, whatever mypy expects.
    beam: SpatialBeam = SpatialBeam()  # type: ignore[assignment]
    fluid: SpatialFluid | None = None  # type: ignore[assignment]
    damping: SpatialDamping | None = None  # type: ignore[assignment]
    stream: SpatialStream | None = None  # type: ignore[assignment]
    actuation: SpatialActuation | None = None  # type: ignore[assignment]
    initial: SpatialInitial = SpatialInitial()  # type: ignore[assignment]
    episode: SpatialEpisode = SpatialEpisode()  # type: ignore[assignment]

    dimension = 3
    _blocks = {
        "beam": SpatialBeam,
        "fluid": SpatialFluid,
        "damping": SpatialDamping,
        "stream": SpatialStream,
        "recording": Recording,
        "actuation": SpatialActuation,
        "initial": SpatialInitial,
        "integrator": Integrator,
        "episode": SpatialEpisode,
    }
    _optional = ("fluid", "damping", "stream", "recording", "actuation")
    #: All that is automatic in the plane but the panels, which lie otherwise here.
    _automatic = AUTOMATIC[1:]

    def _check_together(self) -> None:
        """Refuse blocks that do not fit together."""
        if self.fluid is not None:
            self.fluid.check_body(self.beam)
        self.inertia_per_length()
        effects: tuple[Any, ...] = (self.damping, self.stream)
        for effect in effects:
            if effect is not None:
                effect.check_scene(self.beam, self.fluid)
        self.initial.check_sizes(self.beam)
        if self.integrator.strain == "mean_angles":
            raise SceneError(
                "integrator.strain mean_angles has no meaning in a scene of dimension 3, which "
                "needs averaged_directors or joint_angle"
            )

    def inertia_per_length(self) -> Floats:
        """Mean inertia of every element, (N, 3), see `SpatialBeam.inertia_per_length`."""
        return self.beam.inertia_per_length(self.fluid.density if self.fluid else None)

    @property
    def mass(self) -> float:
        """Mass of the body [kg]."""
        return float(self.inertia_per_length()[:, 0].mean()) * self.beam.length

    @property
    def axes(self) -> tuple[str, ...]:
        """The actuated axes of the joints, of `AXIS_NAMES`; yaw without an actuation."""
        return self.actuation.axes if self.actuation is not None else ("yaw",)

    @property
    def torque_limit(self) -> tuple[float, ...]:  # type: ignore[override]
        """Torque of an environment's action of 1 [N m], for each of `axes`."""
        if self.actuation is not None:
            return self.actuation.limits
        return tuple(limit_of(bend) for bend in self.bend_per_torque)

    @property
    def bend_per_torque(self) -> tuple[float | None, ...]:  # type: ignore[override]
        """Static bend of the whole body under the same torque everywhere [rad / (N m)].

        One for each of `axes`, see `Scene.bend_per_torque`.
        """
        stiffness = self.beam.stiffness_at_joints()
        return tuple(bend_of(self.beam, stiffness[:, axis]) for axis in self._axis_numbers)

    @property
    def has_period(self) -> bool:
        """Whether all joints have stiffness about the actuated axes, which gives a period."""
        return None not in self.bend_per_torque

    @property
    def action_places(self) -> NDArray[np.int64]:
        """Where the actions' torques are among those of a step, flattened; shape (n,)."""
        places: NDArray[np.int64] = (
            3 * np.arange(self.joints)[:, None] + self._axis_numbers
        ).ravel()
        return places

    @property
    def _axis_numbers(self) -> NDArray[np.int64]:
        return np.array([AXIS_NAMES.index(axis) for axis in self.axes])


KINDS[SpatialScene.dimension] = SpatialScene
