"""One swimmer of a recording in space."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swim_env.analysis.pose import orientation_of
from swim_env.analysis.spatial_energy import spatial_elastic_energy, spatial_moments
from swim_env.errors import OptionError
from swim_env.recording.swimmer import Swimmer
from swim_env.scene.spatial.body import AXIS_NAMES
from swim_env.scene.spatial.scene import SpatialScene
from swim_env.sim.spatial.trajectory import SpatialTrajectory

__all__ = ["SpatialSwimmer"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class SpatialSwimmer(Swimmer):
    """A run in space to be recorded; `Swimmer` makes it of one.

    Torques, rotations and moments of joints have an axis more, (T + 1, N - 1, 3): about (pitch,
    yaw, roll).
    """

    trajectory: SpatialTrajectory  # type: ignore[assignment]  # as its scene is

    @property
    def scene(self) -> SpatialScene:
        """The scene."""
        scene = self.trajectory.scene
        assert isinstance(scene, SpatialScene)
        return scene

    @property
    def joint_angles(self) -> Array:
        """Rotation vectors of the joints, (T + 1, N - 1, 3) (rad)."""
        return self.trajectory.joint_rotations

    @cached_property
    def moments(self) -> Array:
        """Elastic moments, (T + 1, N - 1, 3) (N m)."""
        return spatial_moments(self.scene, self.joint_angles)[0]

    @cached_property
    def girth(self) -> float:
        """How far the body is drawn from its centre line (m)."""
        s = np.linspace(0.0, self.scene.beam.length, 51)
        beam = self.scene.beam
        return float(max(beam.half_width_at(s).max(), beam.half_height_at(s).max()))

    def largest(self, colour: str) -> float:
        """Return the torque or moment of bending that a colour of the body reaches to (N m)."""
        if colour == "torque":
            bending = [
                limit
                for axis, limit in zip(self.scene.axes, self.scene.torque_limit, strict=True)
                if axis != "roll"
            ]
            return max(bending or self.scene.torque_limit)
        return float(np.linalg.norm(self.moments[..., :2], axis=-1).max(initial=0.0)) or 1.0

    def check(self) -> None:
        """Check that what is given beside the run can belong to it, else raise OptionError."""
        if self.start_velocity is not None:
            raise OptionError(
                f"the energy of {self.name} is not split in a scene of dimension 3: leave "
                "start_velocity out"
            )
        super().check()

    def series(self, group: str, instants: Indices) -> Array:
        """Return a group of series at some instants, see `Swimmer.series`."""
        axis, _, what = group.partition("_")
        if axis in AXIS_NAMES:
            values = self.held_torques if what == "torques" else self.joint_angles
            return values[instants][..., AXIS_NAMES.index(axis)]
        return super().series(group, instants)

    def _energy(self, instants: Indices) -> Array:
        total = self.trajectory.energy[instants]
        elastic = spatial_elastic_energy(self.scene, self.joint_angles[instants])
        return np.column_stack([total - elastic, elastic, total])

    def _orientation(self, instants: Indices) -> Array:
        return np.degrees(orientation_of(self.trajectory.directors[instants]))

    def _momentum(self, instants: Indices) -> Array:
        return self.trajectory.momentum[instants, :3]

    def _angular_momentum(self, instants: Indices) -> Array:
        return self.trajectory.momentum[instants, 3:]

    def _drift(self, instants: Indices) -> Array:
        change = self.trajectory.unexplained_momentum[instants]
        sizes = [np.linalg.norm(part, axis=1) for part in (change[:, :3], change[:, 3:])]
        return np.column_stack(sizes)
