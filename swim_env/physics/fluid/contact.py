"""Whether a chain of thick elements touches itself."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import kernel

Array = NDArray[np.float64]


@kernel
def _distance_from_segment(
    x: float, y: float, start_x: float, start_y: float, along_x: float, along_y: float, dl: float
) -> float:
    """Return the distance (m) of a point from a segment of length dl with the given direction."""
    dx = x - start_x
    dy = y - start_y
    along = min(max(dx * along_x + dy * along_y, 0.0), dl)
    dx -= along * along_x
    dy -= along * along_y
    distance: float = np.sqrt(dx * dx + dy * dy)
    return distance


@kernel
def touches_itself(elements: int, d3: Array, radius: float, dl: float, nodes: Array) -> bool:
    """Return whether the body touches itself.

    Every element counts as a stadium, all points within the radius of its centre line. Two of them
    touch where they overlap, and are further apart along the body than half a turn around the
    radius: what is nearer is bent, not touching. Neighbours, which overlap at their node whatever
    they do, touch where the joint folds so far that their other ends do. Exact; elements that are
    far apart cost one comparison.

    Parameters
    ----------
    elements : int
        Their number N.
    d3 : (2, N or more) array
        Tangents of the elements.
    radius : float
        Half the thickness (m).
    dl : float
        Length of an element (m).
    nodes : (2, N or more) array
        Scratch: the node in front of every element.
    """
    width = 2.0 * radius
    x = 0.0
    y = 0.0
    for k in range(elements):
        nodes[0, k] = x
        nodes[1, k] = y
        x += dl * d3[0, k]
        y += dl * d3[1, k]
    far = dl + width
    half_turn = math.pi * radius
    for k in range(elements):
        ax = d3[0, k]
        ay = d3[1, k]
        for m in range(k + 1, elements):
            if max(m - k - 1, 1) * dl < half_turn:
                continue
            bx = d3[0, m]
            by = d3[1, m]
            # From centre to centre.
            dx = nodes[0, m] - nodes[0, k] + 0.5 * dl * (bx - ax)
            dy = nodes[1, m] - nodes[1, k] + 0.5 * dl * (by - ay)
            if dx * dx + dy * dy > far * far:
                continue
            end_x = nodes[0, m] + dl * bx
            end_y = nodes[1, m] + dl * by
            if m == k + 1:
                gap = min(
                    _distance_from_segment(end_x, end_y, nodes[0, k], nodes[1, k], ax, ay, dl),
                    _distance_from_segment(
                        nodes[0, k], nodes[1, k], nodes[0, m], nodes[1, m], bx, by, dl
                    ),
                )
                if gap < width:
                    return True
                continue
            # Sides of one segment's ends from the other's line, for segments that cross.
            first = ax * (nodes[1, m] - nodes[1, k]) - ay * (nodes[0, m] - nodes[0, k])
            second = ax * (end_y - nodes[1, k]) - ay * (end_x - nodes[0, k])
            third = bx * (nodes[1, k] - nodes[1, m]) - by * (nodes[0, k] - nodes[0, m])
            tip_x = nodes[0, k] + dl * ax
            tip_y = nodes[1, k] + dl * ay
            fourth = bx * (tip_y - nodes[1, m]) - by * (tip_x - nodes[0, m])
            if first * second < 0.0 and third * fourth < 0.0:
                return True
            gap = min(
                min(
                    _distance_from_segment(
                        nodes[0, m], nodes[1, m], nodes[0, k], nodes[1, k], ax, ay, dl
                    ),
                    _distance_from_segment(end_x, end_y, nodes[0, k], nodes[1, k], ax, ay, dl),
                ),
                min(
                    _distance_from_segment(
                        nodes[0, k], nodes[1, k], nodes[0, m], nodes[1, m], bx, by, dl
                    ),
                    _distance_from_segment(tip_x, tip_y, nodes[0, m], nodes[1, m], bx, by, dl),
                ),
            )
            if gap < width:
                return True
    return False
