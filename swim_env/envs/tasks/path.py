"""Task ``path``: follow a curve."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.envs.tasks.base import Array, Task
from swim_env.envs.tasks.moment import Moment
from swim_env.errors import OptionError
from swim_env.scene import Scene, require_planar
from swim_env.scene.checks import checked_option, listed, pair, real

#: Distance of the samples of a curve (BL), and how many of them on either side of the present one
#: are looked at for the nearest: a body does not get farther in an action.
_SPACING, _WINDOW = 0.02, 4

_AROUND = np.arange(2 * _WINDOW + 1)


def bends() -> tuple[tuple[float, float], ...]:
    """Return the curve of the task unless another is given: to the left and back, 4 BL long."""
    x = np.linspace(0.0, 3.6, 37)
    y = 0.25 * (1.0 - np.cos(2.0 * math.pi / 3.6 * x))
    return tuple(zip(x.tolist(), y.tolist(), strict=True))


class PathTask(Task):
    """Follow a curve that begins at the start; ends with success at the curve's end.

    The reward is the progress along the curve, less a weight times the distance from it for every
    action. The goal of the observation is the point of the curve that is some way ahead. ``info``
    has ``deviation``, the distance from the curve (BL), and its ``progress`` is that along the
    curve.

    Parameters
    ----------
    scene : Scene
        The body, its fluid and how the episode is played.
    points : sequence of pairs of float, optional
        Points of the curve (BL) from the mean centre at the start, x along the scene's heading and
        y to the left; the first is (0, 0). A gentle bend to the left and back unless given.
    lookahead : float
        How far along the curve the goal is ahead (BL).
    width : float
        The episode ends at this distance from the curve (BL).
    deviation_weight : float
        What an action at 1 BL from the curve costs (BL), at least 0; an action that ends early as
        much less.

    Raises
    ------
    OptionError
        If one of them cannot be used.
    """

    goal_is_point = True
    radius = 0.05
    reasons = {
        "path_finished": "the end of the path was reached",
        "path_left": "the body is too far from the path",
    }
    successes = ("path_finished",)

    def __init__(
        self,
        scene: Scene,
        points: Sequence[Sequence[float]] | None = None,
        lookahead: float = 0.5,
        width: float = 0.5,
        deviation_weight: float = 0.002,
    ) -> None:
        require_planar(scene, "task path")
        super().__init__(scene)
        self.points = bends() if points is None else _checked_points(points)
        self.lookahead = checked_option(real("BL", above=0.0), lookahead, "lookahead")
        self.width = checked_option(real("BL", above=0.0), width, "width")
        weight = real("BL", at_least=0.0)
        self.deviation_weight = checked_option(weight, deviation_weight, "deviation_weight")
        steps = np.diff(np.array(self.points), axis=0)
        marks = np.concatenate([[0.0], np.cumsum(np.hypot(*steps.T))])
        self.length = float(marks[-1])
        samples = max(2, math.ceil(self.length / _SPACING) + 1)
        self._marks = np.linspace(0.0, self.length, samples)
        along, left = (np.interp(self._marks, marks, one) for one in np.array(self.points).T)
        forward = np.array(scene.episode.heading)
        sideways = self.geometry.direction_at(0.5 * math.pi)
        self._curve = along[:, None] * forward + left[:, None] * sideways
        tangents = np.gradient(self._curve, self._marks, axis=0)
        self._samples = np.column_stack([self._curve, tangents, self._marks])
        self._padded = np.pad(self._curve, ((_WINDOW, _WINDOW), (0, 0)), "edge").T.copy()
        self._ahead = max(1, round(self.lookahead / float(self._marks[1])))

    def state(self, count: int) -> dict[str, NDArray[Any]]:
        """Return the curve's origin (BL), the nearest sample, where that is and what was gained."""
        return {
            "origin": np.zeros((count, 2)),
            "nearest": np.zeros(count, dtype=np.int64),
            "along": np.zeros(count),
            "gained": np.zeros(count),
            "deviation": np.zeros(count),
        }

    def update(self, now: Moment) -> None:
        """Find the nearest point of the curve, not far from the one before."""
        state, last = now.state, len(self._marks) - 1
        if now.start:
            state["origin"][:] = now.position
        place_x, place_y = (now.position - state["origin"]).T
        before = state["nearest"]
        around = before[:, None] + _AROUND
        x, y = self._padded
        away_x, away_y = place_x[:, None] - x[around], place_y[:, None] - y[around]
        squares = away_x * away_x + away_y * away_y
        best = squares.argmin(axis=1)
        nearest = np.minimum(np.maximum(before + best - _WINDOW, 0), last)
        x, y, along_x, along_y, mark = self._samples[nearest].T
        # Between the samples, along the tangent.
        more = (place_x - x) * along_x + (place_y - y) * along_y
        along = mark + np.minimum(np.maximum(more, -_SPACING), _SPACING)
        along = np.minimum(np.maximum(along, 0.0), self.length)
        state["gained"][:] = along - state["along"]
        state["deviation"][:] = np.sqrt(squares.min(axis=1))
        state["along"][:], state["nearest"][:] = along, nearest

    def update_goal(self, now: Moment) -> Array:
        """Return the points ahead."""
        ahead = np.minimum(now.state["nearest"] + self._ahead, len(self._marks) - 1)
        goals: Array = (self._curve[ahead] + now.state["origin"]) * self.scene.beam.length
        return goals

    def reward(self, now: Moment) -> Mapping[str, Array]:
        """Return the progress along the curve, and what the distance from it has cost."""
        cost = self.deviation_weight * now.state["deviation"] * now.share_held
        return {"progress": now.state["gained"], "deviation": -cost}

    def ends(self, now: Moment) -> Mapping[str, NDArray[np.bool_]]:
        """End at the curve's end, and far from the curve."""
        return {
            "path_finished": now.state["along"] >= self.length - _SPACING,
            "path_left": now.state["deviation"] > self.width,
        }

    def info(self, now: Moment) -> Mapping[str, Array]:
        """Return how far along the curve, and how far from it, the mean centre is (BL)."""
        return {"progress": now.state["along"], "deviation": now.state["deviation"]}


def _checked_points(points: object) -> tuple[tuple[float, float], ...]:
    """Return the points of a curve."""
    items = listed(points)
    if items is None or len(items) < 2:
        raise OptionError("points must be at least two pairs of numbers in BL")
    found = tuple(checked_option(pair("BL"), item, f"points[{i}]") for i, item in enumerate(items))
    if found[0] != (0.0, 0.0):
        raise OptionError(f"points must begin at (0, 0), the start, got {list(found[0])}")
    for i, (one, other) in enumerate(zip(found, found[1:], strict=False)):
        if one == other:
            raise OptionError(f"points must differ from their neighbours, points[{i + 1}] does not")
    return found
