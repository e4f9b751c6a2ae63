"""Task ``station``: hold a place in a stream."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.envs.geometry import StartPlan
from swim_env.envs.tasks.base import Array, Task
from swim_env.envs.tasks.moment import Moment
from swim_env.errors import OptionError
from swim_env.scene import Scene
from swim_env.scene.checks import checked_option, real


class StationTask(Task):
    """Hold the place of the start in a stream that carries the body away.

    The body starts with the stream's velocity, unless the options of the reset give another: one
    that rests over ground would stay there without any effort, as an ideal fluid does not drag. The
    reward has two terms in body lengths. ``held`` is how far the stream went past while the action
    lasted, weighted by how near the place is: 1 there, 0 at the reach. ``return`` is the decrease
    of the distance from the place, without which a learner would be paid for its strokes only much
    later. A body that drifts away is paid minus half the reach.

    Parameters
    ----------
    scene : Scene
        The body, its fluid with a stream, and how the episode is played.
    reach : float
        The episode ends where the mean centre is this far from the place (BL).

    Raises
    ------
    OptionError
        If the scene has no stream, or the reach cannot be used.
    """

    goal_is_point = True
    parts = ("joint_angles", "joint_rates", "velocity", "turning_rate")
    reasons = {"drifted_away": "the place that was to be held is out of reach"}

    def __init__(self, scene: Scene, reach: float = 1.0) -> None:
        super().__init__(scene)
        if scene.stream is None or not any(scene.stream.velocity):
            example = [0.1 * scene.beam.length] + [0.0] * (scene.dimension - 1)
            raise OptionError(
                f"task {self.name} needs a stream to hold a place in, and scene {scene.name} has "
                "none: add a block stream with a velocity (m/s) against the heading, for example "
                f"overrides={{'stream.velocity': {example}}}"
            )
        self.reach = checked_option(real("BL", above=0.0), reach, "reach")
        flow = np.array(scene.stream.velocity)
        speed = math.hypot(*flow)
        self._upstream = -flow / speed
        self._speed = speed / scene.beam.length

    def plan_start(self, options: Mapping[str, Any] | None = None) -> StartPlan:
        """Check the options of a reset; unless they say otherwise the body starts adrift."""
        plan = super().plan_start(options)
        if options is not None and not plan.exact & {"velocity", "velocity_slope"}:
            assert self.scene.stream is not None
            plan.velocity[: self.scene.dimension] = self.scene.stream.velocity
        return plan

    def observe(self, now: Moment) -> Mapping[str, Array]:
        """Return, as seen from the head, the way to the place (BL) and the upstream direction."""
        place = now.goal / self.scene.beam.length - now.position
        upstream = np.broadcast_to(self._upstream, place.shape)
        return {"place": now.in_body(place), "upstream": now.in_body(upstream)}

    def state(self, count: int) -> dict[str, NDArray[Any]]:
        """Return the distance from the place, and by how much it has fallen (BL)."""
        return {"distance": np.zeros(count), "gained": np.zeros(count)}

    def update(self, now: Moment) -> None:
        """Measure the distance."""
        distance = now.distance
        now.state["gained"][:] = 0.0 if now.start else now.state["distance"] - distance
        now.state["distance"][:] = distance

    def reward(self, now: Moment) -> Mapping[str, Array]:
        """Return what was held against the stream, and what was gained of the way back."""
        near = 1.0 - now.state["distance"] / self.reach
        return {"held": near * now.seconds * self._speed, "return": now.state["gained"]}

    def ends(self, now: Moment) -> Mapping[str, NDArray[np.bool_]]:
        """End where the place is out of reach."""
        return {"drifted_away": now.state["distance"] > self.reach}
