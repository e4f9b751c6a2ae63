"""The outline of a body on the screen, from its angles alone: exact wherever the body is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: A head's half width along its axis, in units of the largest: half a circle, then a taper.
_round, _taper = np.linspace(0.0, 0.5 * np.pi, 9), np.linspace(0.15, 1.0, 6)
_HEAD_PLACES = np.concatenate([1.0 - np.cos(_round), 1.0 + 2.0 * _taper])
_HEAD_WIDTHS = np.concatenate([np.sin(_round), np.cos(0.5 * np.pi * _taper)])


def chain(angles: Array, element: float) -> tuple[Array, Array]:
    """Return a body's unit vectors (N, 2) from head to tail, and its nodes (N + 1, 2) (pixels).

    The nodes are relative to the mean centre, y is downwards. The angles (N,) are that of element
    1 and the joint angles (rad); `element` is the length of an element (pixels).
    """
    turned = np.cumsum(angles)
    along = np.stack([np.cos(turned), -np.sin(turned)], axis=-1)
    nodes = np.zeros((len(angles) + 1, 2))
    nodes[1:] = np.cumsum(element * along, axis=0)
    centres = 0.5 * (nodes[:-1] + nodes[1:])
    return along, nodes - centres.mean(axis=0)


def head_outline(front: Array, along: Array, across: Array, radius: float) -> Array:
    """Return the corners (30, 2) of a head at the body's front (2,), with half its width as radius.

    The unit vectors (2,) point to the tail and to the side.
    """
    line = front + radius * _HEAD_PLACES[:, None] * along
    side = radius * _HEAD_WIDTHS[:, None] * across
    return np.concatenate([line + side, (line - side)[::-1]])


def mitres(across: Array) -> Array:
    """Return the vectors (N + 1, 2) from the nodes to the outline of a body of half thickness 1.

    Where two elements meet, they point to the corner that their sides make. The elements' normals
    (N, 2) are unit vectors.
    """
    corners = np.concatenate([across[:1], across[:-1] + across[1:], across[-1:]])
    # Sharp bends, which the physics does not allow, would have corners at any distance.
    meeting = np.maximum(1.0 + (across[:-1] * across[1:]).sum(axis=-1), 0.3)
    corners[1:-1] /= meeting[:, None]
    return corners
