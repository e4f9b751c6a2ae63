"""What the frames of an episode show: a camera that follows the body, and the trail behind it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: How far the view reaches beyond the mean centre (BL).
_REACH_ALONG, _REACH_ACROSS = 1.15, 0.56
#: Most points of the trail; when there are as many, the older half is dropped.
_TRAIL_POINTS = 2000


class Camera:
    """Follows the mean centre from an episode's first frame on; lengths are body lengths (BL).

    The view has its middle and half its size (2,) on the screen (pixels); a target has a radius,
    without one the goal is a direction; the trail has a least distance of its points (pixels), and
    the camera a time (s) after which it has made up for 63 % of a move.
    Centre and aim (2,) are the mean centre and the goal, in the first frame, at a time (s).
    Points have three components in space, see `SpatialCamera`.

    Attributes
    ----------
    place : (2,) array
        What the middle of the view shows.
    scale : float
        Pixels per BL.
    centre, start : (2,) arrays
        The mean centre in the last frame and in the first.
    trail : (n, 2) array
        Where it has been, a visible step apart.
    time : float
        Time of the last frame (s).
    """

    #: How far the camera may fall behind (BL).
    most_lag = 0.15

    def __init__(
        self,
        middle: Array,
        half: Array,
        target_radius: float | None,
        trail_step: float,
        lag: float,
        centre: Array,
        aim: Array,
        time: float,
    ) -> None:
        self._middle, self._half, self._radius = middle, half, target_radius
        self._trail_step, self._lag = trail_step, lag
        self.time, self.start, self.centre = time, centre, centre
        self.trail = centre[None]
        self.scale = self._chosen_scale(aim)
        self.place = self._focus(aim)

    def follow(self, centre: Array, aim: Array, time: float) -> None:
        """Move on to the next frame."""
        elapsed = time - self.time
        self.time, self.centre = time, centre
        focus = self._focus(aim)
        behind = (focus - self.place) * math.exp(-elapsed / self._lag)
        most = self.most_lag / max(self.most_lag, float(np.hypot.reduce(behind)))
        self.place = focus - most * behind
        if np.hypot.reduce(centre - self.trail[-1]) * self.scale >= self._trail_step:
            first = len(self.trail) // 2 if len(self.trail) == _TRAIL_POINTS else 0
            self.trail = np.concatenate([self.trail[first:], centre[None]])

    def on_screen(self, points: Array) -> Array:
        """Return column and row (pixels) of points (..., 2)."""
        away = (points - self.place) * self.scale
        return self._middle + away * (1.0, -1.0)

    def _chosen_scale(self, aim: Array) -> float:
        """Return the pixels per BL: the body as large as it can turn, and a target in view."""
        half_width, half_height = self._half
        largest = min(half_width / _REACH_ALONG, half_height / _REACH_ACROSS)
        if self._radius is None:
            return float(largest)
        beyond = max(_REACH_ACROSS, self._radius + 0.05)
        away = 0.5 * np.abs(aim - self.centre) + beyond
        fitting = min(half_width / away[0], half_height / away[1])
        return float(min(max(fitting, 0.45 * largest), largest))

    def _focus(self, aim: Array) -> Array:
        """Return what the camera follows: the mean centre, or half way to a target."""
        if self._radius is None:
            return self.centre
        most = np.maximum(self._half / self.scale - _REACH_ACROSS, 0.0)
        return self.centre + np.clip(0.5 * (aim - self.centre), -most, most)
