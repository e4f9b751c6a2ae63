"""How a body in space is turned as a whole."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.spatial.invariants import heading_of

__all__ = ["ORIENTATION", "orientation_of"]

Array = NDArray[np.float64]

#: The angles of `orientation_of`.
ORIENTATION = ("roll", "pitch", "yaw")


def orientation_of(directors: Array) -> Array:
    """Return how the body is turned from the reference pose, (T, 3) (rad).

    The body's rotation is that of `heading_of`. From the reference pose
    (d3, head to tail, along +x; d2 upwards along +z) it is turned by the yaw about z, then by the
    pitch about its own d1, then by the roll about its own d3. A positive yaw turns to the left,
    a positive pitch lifts the head. Angles count whole turns from the first instant on; where the
    body stands upright, yaw and roll cannot be told apart.

    Parameters
    ----------
    directors : (T, N, 3, 3) array
        R_k of every element, with columns d1, d2, d3.
    """
    d1, d2, d3 = np.moveaxis(heading_of(directors), -1, 0)
    roll = np.arctan2(d1[:, 2], d2[:, 2])
    pitch = np.arctan2(-d3[:, 2], np.hypot(d3[:, 0], d3[:, 1]))
    yaw = np.arctan2(d3[:, 1], d3[:, 0])
    turned: Array = np.unwrap(np.stack([roll, pitch, yaw], axis=-1), axis=0)
    return turned
