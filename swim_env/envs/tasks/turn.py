"""Task ``turn``: turn to a new heading, quickly."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.envs.tasks.base import Array, Task
from swim_env.envs.tasks.moment import Moment
from swim_env.errors import OptionError
from swim_env.scene import Scene
from swim_env.scene.checks import checked_option, pair, real, reals


class TurnTask(Task):
    """Turn to a new heading; ends with success when the head points there.

    The reward is the decrease of the heading error's size (rad), less what time costs: the sooner
    the head points along the goal, the more is left of it.

    Parameters
    ----------
    scene : Scene
        The body, its fluid and how the episode is played.
    turn : pair of float
        Least and largest angle from the scene's heading to the new one (rad), up to pi, to either
        side; in space to any side.
    tolerance : float
        The head points along the goal where the heading error is below this (rad).
    time_cost : float
        What an action costs (rad), at least 0; an action that ends early as much less.

    Raises
    ------
    OptionError
        If one of them cannot be used.
    """

    own_options = ("turn",)
    reasons = {"heading_reached": "the head points along the new heading"}
    successes = ("heading_reached",)
    unit = "rad"

    def __init__(
        self,
        scene: Scene,
        turn: Sequence[float] = (0.5, 1.5),
        tolerance: float = 0.1,
        time_cost: float = 0.001,
    ) -> None:
        super().__init__(scene)
        angle = real("rad", above=0.0, at_most=math.pi)
        self.tolerance = checked_option(angle, tolerance, "tolerance")
        bounds = checked_option(reals("rad"), turn, "turn")
        if len(bounds) != 2 or not self.tolerance < bounds[0] <= bounds[1] <= math.pi:
            raise OptionError(
                "turn must be two angles in rad, the least above the tolerance "
                f"({self.tolerance:g}) and the largest not below it and up to pi, got "
                f"{list(bounds)}"
            )
        self.turn = bounds
        self.time_cost = checked_option(real("rad", at_least=0.0), time_cost, "time_cost")

    def given_goal(self, options: Mapping[str, Any]) -> Array | None:
        """Return the heading of the option ``turn``, or None.

        It is an angle (rad) from the scene's heading, in space two: that one, and the one around
        it from left to up.
        """
        if "turn" not in options:
            return None
        if self.scene.dimension == 2:
            return self.geometry.direction_at(real("rad")(options["turn"], "turn"))
        return self.geometry.direction_at(*pair("rad")(options["turn"], "turn"))

    def draw_goal(self, random: np.random.Generator) -> Array:
        """Return a new heading, to the left or to the right, in space to any side."""
        angle = random.uniform(*self.turn)
        if self.scene.dimension == 2:
            return self.geometry.direction_at(angle * random.choice([-1.0, 1.0]))
        return self.geometry.direction_at(angle, random.uniform(0.0, math.tau))

    def state(self, count: int) -> dict[str, NDArray[Any]]:
        """Return the size of the heading error, and by how much it has fallen (rad)."""
        return {"error": np.zeros(count), "gained": np.zeros(count)}

    def update(self, now: Moment) -> None:
        """Measure the heading error."""
        error = np.abs(now.heading_error)
        now.state["gained"][:] = 0.0 if now.start else now.state["error"] - error
        now.state["error"][:] = error

    def reward(self, now: Moment) -> Mapping[str, Array]:
        """Return what has been gained of the turn, and what the time has cost."""
        return {"turn": now.state["gained"], "time": -self.time_cost * now.share_held}

    def ends(self, now: Moment) -> Mapping[str, NDArray[np.bool_]]:
        """End where the head points along the goal."""
        return {"heading_reached": now.state["error"] < self.tolerance}
