"""Colours of recordings: as in the frames, and apart for every colour vision."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from swim_env.envs.render.drawing import Colour, blend, torque_colours
from swim_env.envs.render.frames import BODY_COLOUR, GOAL_COLOUR, WATER_COLOUR

__all__ = [
    "ARROW_COLOUR",
    "BODY_COLOUR",
    "GOAL_COLOUR",
    "GRID_COLOUR",
    "INSIDE",
    "MIDDLE",
    "SERIES_COLOURS",
    "TRAIL_COLOURS",
    "WATER_COLOUR",
    "joint_colours",
    "pressure_palette",
    "shades_of_torque",
]

Bytes = NDArray[np.uint8]

ARROW_COLOUR: Colour = (62, 84, 110)
GRID_COLOUR: Colour = (214, 224, 233)
#: Of swimmers, in turn: what they leave behind.
TRAIL_COLOURS: tuple[Colour, ...] = ((0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167))
#: Of the series of one group, in turn (after Okabe and Ito), for a dark background and a light one.
SERIES_COLOURS: tuple[Colour, ...] = (
    (86, 180, 233),
    (230, 159, 0),
    (0, 190, 140),
    (225, 150, 190),
)
#: From low to high pressure: green, the water's own colour, purple.
_PRESSURE_STOPS: tuple[Colour, ...] = (
    (0, 90, 50),
    (90, 174, 97),
    WATER_COLOUR,
    (153, 112, 171),
    (90, 25, 110),
)
#: From head to tail: yellow, orange, purple (series of joints, on dark backgrounds and light ones).
_JOINT_STOPS: tuple[Colour, ...] = (
    (225, 185, 40),
    (240, 125, 70),
    (210, 65, 105),
    (130, 90, 220),
)
#: Indices of a pressure image: the body's inside, and no pressure.
INSIDE, MIDDLE = 0, 128


def _ramp(stops: tuple[Colour, ...], count: int) -> Bytes:
    at = np.linspace(0.0, len(stops) - 1.0, count)
    below = np.minimum(at.astype(np.int64), len(stops) - 2)
    return np.array(
        [blend(stops[i], stops[i + 1], float(s)) for i, s in zip(below, at - below, strict=True)],
        dtype=np.uint8,
    )


def pressure_palette() -> Bytes:
    """Return the colours of a pressure image's indices, (256, 3): INSIDE, then low to high."""
    return np.concatenate([np.array([BODY_COLOUR], dtype=np.uint8), _ramp(_PRESSURE_STOPS, 255)])


def joint_colours(count: int) -> Bytes:
    """Return the colours of the joints' series from head to tail, (count, 3)."""
    return _ramp(_JOINT_STOPS, max(count, 1))[:count]


def shades_of_torque(shares: NDArray[np.float64]) -> Bytes:
    """Return the colours of torques, as in the frames.

    Parameters
    ----------
    shares : array
        Torques as a share of their limit, of any shape.

    Returns
    -------
    (..., 3) array of uint8
        The colours, from a table of 256.
    """
    index = np.rint(127.5 * (np.clip(shares, -1.0, 1.0) + 1.0)).astype(np.int64)
    colours: Bytes = _torque_table()[index]
    return colours


@functools.cache
def _torque_table() -> Bytes:
    return np.array(torque_colours(np.linspace(-1.0, 1.0, 256)), dtype=np.uint8)
