"""Colours that frames, recordings and still pictures share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Colour = tuple[int, int, int]
Colours = NDArray[np.uint8]

WATER: Colour = (242, 247, 251)
BODY: Colour = (44, 58, 75)
GOAL: Colour = (0, 158, 115)

#: From -1 over 0 to 1: blue, white, orange, for everything that has a sign. Blue and orange stay
#: apart for every colour vision, and both ends are darker than the middle.
TORQUE_STOPS: tuple[Colour, ...] = (
    (8, 81, 156),
    (107, 174, 214),
    (250, 250, 250),
    (253, 174, 107),
    (217, 72, 1),
)


#: Of the parts of the energy and of what changes it, the same in recordings and still pictures, to
#: be seen on dark and light backgrounds.
ENERGY: dict[str, Colour] = {
    "elastic": (230, 159, 0),
    "kinetic, body": (0, 114, 178),
    "kinetic, fluid": (86, 180, 233),
    "kinetic, body and fluid": (86, 180, 233),
    "total": (150, 150, 150),
    "by torques": (213, 94, 0),
    "positive part": (240, 160, 110),
    "to damping": (0, 158, 115),
    "unexplained": (204, 121, 167),
}


def ramp(stops: Sequence[Colour], places: ArrayLike) -> Colours:
    """Return the colours (..., 3) at places (...) between stops, which are at 0, 1, 2 ..."""
    at, numbers = np.asarray(places, dtype=np.float64), np.arange(len(stops))
    mixed = [np.interp(at, numbers, channel) for channel in zip(*stops, strict=True)]
    colours: Colours = np.rint(np.stack(mixed, axis=-1)).astype(np.uint8)
    return colours


def torque_colours(shares: ArrayLike) -> Colours:
    """Return the colours (..., 3) of torques as shares (...) of their limit, clipped to -1 to 1."""
    return ramp(TORQUE_STOPS, 2.0 * (np.clip(shares, -1.0, 1.0) + 1.0))
