"""Environments in the plane: shapes, starts and their noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.envs.assessment import assess, load_assessment
from swim_env.envs.geometry.base import Geometry, StartPlan
from swim_env.envs.tasks.moment import Moment
from swim_env.scene import Initial, Scene
from swim_env.sim.batch import Bodies, minimal_start

Array = NDArray[np.float64]


class PlanarGeometry(Geometry):
    """Scenes in the plane: coordinates (N + 2,), see `swim_env.sim.batch.minimal_start`."""

    start_fields = tuple(spec.name for spec in fields(Initial))
    assess = staticmethod(assess)
    moment = Moment

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        joints = scene.joints
        self.joint_shape = (joints,)
        self.kept = joints + 3
        self.part_sizes = {
            "joint_angles": joints,
            "joint_rates": joints,
            "goal_direction": 2,
            "velocity": 2,
            "turning_rate": 1,
        }

    def load(self) -> None:
        """Load the kernels."""
        load_assessment()

    def bodies(self, count: int) -> Bodies:
        """Return so many bodies."""
        return Bodies(self.scene, count)

    def start(self, initial: Initial) -> tuple[Array, Array]:
        """Return coordinates and velocity of an initial state."""
        return minimal_start(self.scene, initial)

    def draw_noise(self, random: np.random.Generator, share: float) -> Mapping[str, Any]:
        """Draw bends of the joints, the body's turn, and its motion."""
        episode = self.scene.episode
        bend = random.uniform(-1.0, 1.0, self.scene.joints) * (share * episode.bend_noise)
        turn = float(random.uniform(-1.0, 1.0)) * (share * episode.heading_noise)
        push = random.uniform(-1.0, 1.0, 3) * (share * self.velocity_noise)
        return {"bend": bend, "turn": turn, "push": push}

    def disturbed(self, plan: StartPlan, noise: Mapping[str, Any]) -> tuple[Array, Array]:
        """Return coordinates and velocity of a planned start with its noise."""
        coordinates, velocity, exact = plan.coordinates.copy(), plan.velocity.copy(), plan.exact
        bend, turn, push = noise["bend"], noise["turn"], noise["push"]
        if "joint_angles" not in exact:
            coordinates[3:] += bend
            # The mean angle of the elements is the body's heading: bending leaves it alone.
            if "heading" not in exact:
                coordinates[2] -= float(np.cumsum(bend).sum()) / self.scene.beam.elements
        if "heading" not in exact:
            coordinates[2] += turn
            if not exact & {"velocity", "velocity_slope"}:
                # The body is turned with the motion that it has through the fluid.
                drift = self.stream
                x, y = velocity[:2] - drift
                cosine, sine = math.cos(turn), math.sin(turn)
                velocity[:2] = (cosine * x - sine * y, sine * x + cosine * y) + drift
        if "position" in exact:
            # The head's end is where the option says, however the body is bent and turned.
            there = Initial(
                position=plan.initial.position,
                heading=float(coordinates[2]),
                joint_angles=tuple(coordinates[3:].tolist()),
            )
            coordinates[:2] = there.pose(self.scene.beam)[0].mean(axis=0)
        if not exact & {"velocity", "velocity_slope"}:
            velocity[:2] += push[:2]
        if not exact & {"turning_rate", "velocity_slope"}:
            velocity[2:] += push[2] / self.scene.beam.length
        return coordinates, velocity

    def direction_at(self, angle: float, around: float = 0.0) -> Array:
        """Return the scene's heading (2,) turned counter-clockwise by an angle (rad)."""
        x, y = self.scene.episode.heading
        cosine, sine = math.cos(angle), math.sin(angle)
        return np.array([cosine * x - sine * y, sine * x + cosine * y])
