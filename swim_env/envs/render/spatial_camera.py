"""The camera in space: it looks at the body from the side and from above, and never turns."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.envs.render.camera import Camera

Array = NDArray[np.float64]

#: Angles of the view below the horizon and out of the y axis, towards +x (rad).
_DOWN, _ASIDE = math.radians(24.0), math.radians(26.0)
#: Right, up and forward of the view, as rows.
AXES = np.array(
    [
        [math.cos(_ASIDE), -math.sin(_ASIDE), 0.0],
        [
            math.sin(_DOWN) * math.sin(_ASIDE),
            math.sin(_DOWN) * math.cos(_ASIDE),
            math.cos(_DOWN),
        ],
        [
            math.cos(_DOWN) * math.sin(_ASIDE),
            math.cos(_DOWN) * math.cos(_ASIDE),
            -math.sin(_DOWN),
        ],
    ]
)
#: Distance of the screen from the eye, in halves of the view's height. The horizon is out of view.
FOCUS = 4.2
#: Nearer to the eye than this share of the distance to the middle nothing is drawn.
NEAREST = 0.1
#: Where points are shown (pixels) that cannot be.
_FAR_OUT = -1e9
#: How far the view reaches beyond the mean centre (BL), and how far below it the middle lies.
_REACH_ALONG, _REACH_ACROSS, _BELOW = 1.0, 0.72, 0.12
#: How far the middle may be from the body in depth, as a share of the distance, and so how much
#: of the view is left to a body that is that much nearer.
_MOST_DEPTH = 0.2
_LEFT = 1.0 - _MOST_DEPTH
#: Lines on a floor are so far apart, and heights of floors are multiples of it (BL).
FLOOR_STEP = 0.5
#: Smallest height of the mean centre above a new floor, and above one that is left (BL). The
#: highest is a step more, and its shadow is still in view.
_NEW_HEIGHT, _LEAST_HEIGHT = 0.35, 0.3
#: Shares of the camera's lag in which floors change.
_CHANGE = 0.3


class SpatialCamera(Camera):
    """Follows the mean centre in space, with a floor below it; see `Camera`.

    Attributes
    ----------
    floors : list of (float, float)
        Heights of the floors (BL), and how visible each is, 0 to 1. A floor rests in the fluid;
        where the body goes far up or down, another one appears while it fades.
    """

    #: A body that rises upright would leave the view if the camera were late.
    most_lag = 0.05

    def __init__(self, *settings: Any) -> None:
        super().__init__(*settings)
        self.floors = [(self._floor(), 1.0)]

    @property
    def distance(self) -> float:
        """Distance of the eye from the middle of the view (BL)."""
        return FOCUS * float(self._half[1]) / self.scale

    def follow(self, centre: Array, aim: Array, time: float) -> None:
        """Move on to the next frame."""
        kept = math.exp(-(time - self.time) / (_CHANGE * self._lag))
        super().follow(centre, aim, time)
        *older, (height, weight) = self.floors
        # The others are above the body, or so far below that they would only confuse.
        older = [
            (other, shown * kept)
            for other, shown in older
            if shown > 0.02 and 0.0 < centre[2] - other < _NEW_HEIGHT + 2.0 * FLOOR_STEP
        ]
        self.floors = [*older, (height, 1.0 - (1.0 - weight) * kept)]
        above, slack = centre[2] - height, _NEW_HEIGHT - _LEAST_HEIGHT
        if not _LEAST_HEIGHT <= above <= _NEW_HEIGHT + FLOOR_STEP + slack:
            new, weights = self._floor(), dict(self.floors)
            weight = weights.pop(new, 0.0)
            self.floors = [*weights.items(), (new, weight)]

    def on_screen(self, points: Array) -> Array:
        """Return column and row (pixels) of points (..., 3)."""
        return self.project(points - self.place)[0]

    def project(self, away: Array) -> tuple[Array, Array]:
        """Return column and row (pixels) and depth (BL) of points (..., 3) from the view's middle.

        Points that are too near, or behind the eye, have a place far out of the view.
        """
        seen = away @ AXES.T
        depth = self.distance + seen[..., 2]
        nearest = NEAREST * self.distance
        size = self.scale * self.distance / np.maximum(depth, nearest)
        places = self._middle + seen[..., :2] * (size[..., None] * (1.0, -1.0))
        return np.where(depth[..., None] > nearest, places, _FAR_OUT), depth

    def _floor(self) -> float:
        """Return the height of the floor (BL) that suits the mean centre."""
        return FLOOR_STEP * math.floor((float(self.centre[2]) - _NEW_HEIGHT) / FLOOR_STEP)

    def _chosen_scale(self, aim: Array) -> float:
        """Return the pixels per BL at the middle's depth."""
        half_width, half_height = self._half
        largest = min(half_width / _REACH_ALONG, half_height / _REACH_ACROSS)
        if self._radius is None:
            return float(largest)
        beyond = max(_REACH_ACROSS, self._radius + 0.05)
        away = 0.5 * np.abs(AXES[:2] @ (aim - self.centre)) + beyond
        fitting = _LEFT * min(half_width / away[0], half_height / away[1])
        return float(min(max(fitting, 0.45 * largest), largest))

    def _focus(self, aim: Array) -> Array:
        """Return what the camera follows: below the mean centre, or half way to a target."""
        below = self.centre - (0.0, 0.0, _BELOW)
        if self._radius is None:
            return below
        half = _LEFT * self._half / self.scale - _REACH_ACROSS
        most = np.maximum([*half, _MOST_DEPTH * self.distance], 0.0)
        ahead = np.clip(0.5 * (AXES @ (aim - self.centre)), -most, most)
        return np.asarray(below + ahead @ AXES)
