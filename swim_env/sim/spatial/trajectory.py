"""A recorded run in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.spatial.invariants import heading_of, rotation_angle
from swim_env.sim.trajectory import TRAJECTORIES, TrajectoryBase

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SpatialTrajectory(TrajectoryBase):
    """A run of T steps of a scene in space; see `TrajectoryBase` for what is not said here.

    Attributes
    ----------
    directors : (T + 1, N, 3, 3) array
        R_k of every element, with columns d1, d2, d3 (head to tail).
    joint_rotations : (T + 1, N - 1, 3) array
        Rotation vectors of the joints (pitch, yaw, roll) (rad).
    """

    directors: Array
    joint_rotations: Array

    def _shapes(self) -> dict[str, tuple[int, ...]]:
        elements, steps = self.scene.beam.elements, self._torque_rows
        return {
            "centres": (steps + 1, elements, 3),
            "directors": (steps + 1, elements, 3, 3),
            "joint_rotations": (steps + 1, elements - 1, 3),
            "torques": (steps, elements - 1, 3),
        }

    @property
    def heading_change(self) -> float:
        """Angle between the body's rotation at the end and at the start (rad), 0 to pi.

        The body's rotation is the polar factor of the mean of its directors.
        """
        first, last = (heading_of(self.directors[i]) for i in (0, -1))
        return rotation_angle(first.T @ last)

    @property
    def nodes(self) -> Array:
        """Nodes of the centre line from head to tail, (T + 1, N + 1, 3) (m)."""
        arms = 0.5 * self.scene.beam.element_length * self.directors[..., 2]
        return np.concatenate([self.centres - arms, (self.centres + arms)[:, -1:]], axis=1)


TRAJECTORIES[3] = SpatialTrajectory
