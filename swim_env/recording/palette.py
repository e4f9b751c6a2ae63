"""Colours of recordings, as in the frames and distinguishable under every colour vision."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.colours import BODY, WATER, Colour, ramp, torque_colours

Bytes = NDArray[np.uint8]

ARROWS: Colour = (62, 84, 110)
GRID: Colour = (214, 224, 233)
#: Of swimmers, in turn: what they leave behind.
TRAILS: tuple[Colour, ...] = ((0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167))
#: Of the series of one group, in turn (after Okabe and Ito), for a dark background and a light one.
SERIES: tuple[Colour, ...] = ((86, 180, 233), (230, 159, 0), (0, 190, 140), (225, 150, 190))
#: From low to high pressure: green, the water's own colour, purple.
_PRESSURE_STOPS = ((0, 90, 50), (90, 174, 97), WATER, (153, 112, 171), (90, 25, 110))
#: From head to tail: yellow, orange, purple (series of joints, on dark backgrounds and light ones).
_JOINT_STOPS = ((225, 185, 40), (240, 125, 70), (210, 65, 105), (130, 90, 220))
#: From no speed to the largest one: the water's own colour to dark teal.
_SPEED_STOPS = (WATER, (160, 212, 208), (55, 150, 148), (8, 84, 88))
#: Of d1, d2 and d3.
DIRECTORS: tuple[Colour, ...] = ((0, 158, 115), (204, 121, 167), BODY)
#: Indices of a pressure image: the body's inside, and no pressure.
INSIDE, MIDDLE = 0, 128


def pressure_palette() -> Bytes:
    """Return the colours of a pressure image's indices, (256, 3): INSIDE, then low to high."""
    shades = ramp(_PRESSURE_STOPS, np.linspace(0.0, 4.0, 255))
    return np.concatenate([np.array([BODY], dtype=np.uint8), shades])


def joint_colours(count: int) -> Bytes:
    """Return the colours of the joints' series from head to tail, (count, 3)."""
    return ramp(_JOINT_STOPS, np.linspace(0.0, 3.0, count))


def shades_of_torque(shares: NDArray[np.float64]) -> Bytes:
    """Return the colours (..., 3) of torques as shares (...) of their limit, as in the frames."""
    index = np.rint(127.5 * (np.clip(shares, -1.0, 1.0) + 1.0)).astype(np.int64)
    colours: Bytes = _torque_table()[index]
    return colours


def shades_of_speed(shares: NDArray[Any]) -> Bytes:
    """Return the colours (..., 3) of speeds as shares (...) of the largest one shown."""
    return ramp(_SPEED_STOPS, (len(_SPEED_STOPS) - 1) * np.clip(shares, 0.0, 1.0))


@functools.cache
def _torque_table() -> Bytes:
    return torque_colours(np.linspace(-1.0, 1.0, 256))
