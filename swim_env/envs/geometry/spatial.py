"""Environments in space: shapes, starts and their noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from swim_env.envs.geometry.base import Geometry, StartPlan
from swim_env.envs.geometry.spatial_assessment import (
    KEPT_BESIDE,
    assess_in_space,
    load_spatial_assessment,
)
from swim_env.envs.geometry.spatial_moment import SpatialMoment
from swim_env.physics.spatial.invariants import directors_of, heading_of
from swim_env.scene import Scene
from swim_env.scene.spatial.initial import SpatialInitial
from swim_env.sim.spatial.bodies import SpatialBodies, spatial_start

Array = NDArray[np.float64]


class SpatialGeometry(Geometry):
    """Scenes in space: coordinates (4 N + 3,), see `swim_env.physics.spatial.chain`."""

    start_fields = tuple(spec.name for spec in fields(SpatialInitial))
    assess = staticmethod(assess_in_space)
    moment = SpatialMoment

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        joints = scene.joints
        self.joint_shape = (joints, 3)
        self.kept = 4 * joints + 7 + KEPT_BESIDE
        self.part_sizes = {
            "joint_angles": 3 * joints,
            "joint_rates": 3 * joints,
            "goal_direction": 3,
            "velocity": 3,
            "turning_rate": 3,
        }

    def load(self) -> None:
        """Load the kernels."""
        load_spatial_assessment()

    def bodies(self, count: int) -> SpatialBodies:
        """Return so many bodies."""
        return SpatialBodies(self.scene, count)  # type: ignore[arg-type]

    def start(self, initial: SpatialInitial) -> tuple[Array, Array]:
        """Return coordinates and velocity of an initial state."""
        return spatial_start(self.scene, initial)  # type: ignore[arg-type]

    def draw_noise(self, random: np.random.Generator, share: float) -> Mapping[str, Any]:
        """Draw bends of the joints, the body's turn, and its motion."""
        episode = self.scene.episode
        bend = random.uniform(-1.0, 1.0, self.joint_shape) * (share * episode.bend_noise)
        turn = random.uniform(-1.0, 1.0, 3) * (share * episode.heading_noise)
        push = random.uniform(-1.0, 1.0, 6) * (share * self.velocity_noise)
        return {"bend": bend, "turn": turn, "push": push}

    def disturbed(self, plan: StartPlan, noise: Mapping[str, Any]) -> tuple[Array, Array]:
        """Return coordinates and velocity of a planned start with its noise."""
        coordinates, velocity, exact = plan.coordinates.copy(), plan.velocity.copy(), plan.exact
        turn = Rotation.from_rotvec(noise["turn"])
        before = heading_of(directors_of(coordinates)[0])
        if "joint_rotations" not in exact and noise["bend"].any():
            joints = _rotations(coordinates[7:]) * Rotation.from_rotvec(noise["bend"])
            coordinates[7:] = joints.as_quat(scalar_first=True).ravel()
            # Bending leaves the body's frame alone.
            after = heading_of(directors_of(coordinates)[0])
            _turn(coordinates, Rotation.from_matrix(before @ after.T))
        if noise["turn"].any():
            _turn(coordinates, turn)
        rates = velocity[3:].reshape(-1, 3)
        if "velocity" not in exact:
            # The body is turned with the motion that it has through the fluid.
            velocity[:3] = turn.apply(velocity[:3] - self.stream) + self.stream
            velocity[:3] += noise["push"][:3]
        if "spin" not in exact:
            rates[:] = turn.apply(rates) + noise["push"][3:] / self.scene.beam.length
        return coordinates, velocity

    def direction_at(self, angle: float, around: float = 0.0) -> Array:
        """Return the direction (3,) at an angle (rad) from the heading, and at one around it."""
        ahead = np.array(self.scene.episode.heading)
        # Up is along z, or for a heading along z itself, along x.
        up = np.eye(3)[2 if abs(ahead[2]) < 0.9 else 0]
        left = np.cross(up, ahead)
        left /= np.linalg.norm(left)
        aside = math.cos(around) * left + math.sin(around) * np.cross(ahead, left)
        return np.asarray(math.cos(angle) * ahead + math.sin(angle) * aside)


def _rotations(quaternions: Array) -> Rotation:
    """Return the rotations of quaternions in a row (4 K,), the real part first."""
    return Rotation.from_quat(quaternions.reshape(-1, 4), scalar_first=True)


def _turn(coordinates: Array, rotation: Rotation) -> None:
    """Turn the whole body about its mean centre."""
    head = rotation * _rotations(coordinates[3:7])
    coordinates[3:7] = head.as_quat(scalar_first=True).ravel()
