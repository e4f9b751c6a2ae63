"""Task ``target``: reach a point."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from swim_env.envs.tasks.base import Array, Task
from swim_env.errors import OptionError
from swim_env.scene import Scene
from swim_env.scene.checks import checked_option, real, reals, vector

#: Where a target is drawn by default: distance (BL), bearing (rad), radius (BL).
TARGET_DISTANCE, TARGET_BEARING, TARGET_RADIUS = (0.5, 1.5), 0.5 * math.pi, 0.1


class TargetTask(Task):
    """Reach a point; the reward is the decrease of the mean centre's distance, in body lengths.

    Parameters
    ----------
    scene : Scene
        The body, its fluid and how the episode is played.
    target_distance : pair of float
        Least and largest distance of the point from the mean centre at the start (BL).
    target_bearing : float
        Largest angle between the scene's heading and the direction to the point (rad), up to pi;
        in space directions are drawn evenly within a cone.
    target_radius : float
        The point is reached when the mean centre is this close (BL).
    effort_weight, heading_weight : float
        As for `Task`.

    Raises
    ------
    OptionError
        If one of them cannot be used.
    """

    goal_is_point = True
    ends_at_goal = True
    own_options = ("target",)

    def __init__(
        self,
        scene: Scene,
        target_distance: Sequence[float] = TARGET_DISTANCE,
        target_bearing: float = TARGET_BEARING,
        target_radius: float = TARGET_RADIUS,
        effort_weight: float = 0.0,
        heading_weight: float = 0.0,
    ) -> None:
        super().__init__(scene, effort_weight, heading_weight)
        self.radius = checked_option(real("BL", above=0.0), target_radius, "target_radius")
        bounds = checked_option(reals("BL"), target_distance, "target_distance")
        if len(bounds) != 2 or not self.radius < bounds[0] <= bounds[1]:
            raise OptionError(
                "target_distance must be two numbers in BL, the least above target_radius "
                f"({self.radius:g}) and the largest not below it, got {list(bounds)}"
            )
        self.distance = bounds
        half_turn = real("rad", at_least=0.0, at_most=math.pi)
        self.bearing = checked_option(half_turn, target_bearing, "target_bearing")

    def given_goal(self, options: Mapping[str, Any]) -> Array | None:
        """Return the point of the option ``target`` (m), or None."""
        if "target" not in options:
            return None
        names = ("x", "y", "z")[: self.scene.dimension]
        return np.array(vector("m", *names)(options["target"], "target"))

    def draw_goal(self, random: np.random.Generator) -> Array:
        """Return the way to the point (m)."""
        low, high = self.distance
        away = random.uniform(low, high) * self.scene.beam.length
        if self.scene.dimension == 2:
            return self.geometry.direction_at(random.uniform(-self.bearing, self.bearing)) * away
        # Every direction within the cone is as likely as another.
        angle = math.acos(random.uniform(math.cos(self.bearing), 1.0))
        return self.geometry.direction_at(angle, random.uniform(0.0, math.tau)) * away
