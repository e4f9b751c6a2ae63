"""The arithmetic that no step with exact panels can do without, as a kernel of its own.

One assembly of the influence matrices G and P, one elimination of G, and the potentials of all
unit motions, P G^-1 B. Every step has to weigh its new pose so; what a step takes beyond this floor
is its own: Newton's method, the shape derivative, the rigid and elastic terms. The floor uses the
logarithm and arc tangent of the kernels and the same blocks of four rows, but keeps nothing that a
shape derivative would need.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SceneError
from swim_env.physics.fluid.outline import (
    CT,
    CX,
    CY,
    LANES,
    LATERAL,
    LENGTH,
    ROTARY,
    ST,
    X,
    Y,
    padded,
    panel_count,
)
from swim_env.physics.runtime.compile import entry_kernel, kernel, vector_kernel
from swim_env.physics.runtime.dense import add_multiple, copy, invert_in_order, multiply
from swim_env.physics.runtime.elementary import atan2, log
from swim_env.scene import Scene
from swim_env.sim.batch import Bodies, aligned_zeros, minimal_start, scene_constants

__all__ = ["FLOOR_WAYS", "FloorArrays", "floor_arrays", "floor_calls", "potentials_of_motions"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

ELIMINATION, INVERSE = 0, 1
#: The ways by name.
FLOOR_WAYS = {"elimination": ELIMINATION, "inverse": INVERSE}


@kernel
def _assemble_row(
    i: int, panels: Array, inverse_square: float, half_log: Array, normal: Array, potential: Array
) -> None:
    count = (panels.shape[1] >> 3) << 3
    cx = panels[CX, i]
    cy = panels[CY, i]
    nx = panels[ST, i]
    ny = -panels[CT, i]
    for j in range(count):
        dx = cx - panels[X, j]
        dy = cy - panels[Y, j]
        half_log[j] = 0.5 * log((dx * dx + dy * dy) * inverse_square)
    half_log[count] = half_log[0]
    for j in range(count):
        ct = panels[CT, j]
        st = panels[ST, j]
        length = panels[LENGTH, j]
        dx = cx - panels[X, j]
        dy = cy - panels[Y, j]
        along = dx * ct + dy * st
        across = dy * ct - dx * st
        angle = atan2(across * length, across * across + along * (along - length))
        ratio = half_log[j] - half_log[j + 1]
        normal[i, j] = nx * (ratio * ct - angle * st) + ny * (ratio * st + angle * ct)
        potential[i, j] = (
            along * half_log[j] - (along - length) * half_log[j + 1] - length + across * angle
        )
    normal[i, i] = np.pi
    potential[i, i] = panels[LENGTH, i] * (half_log[i] - 1.0)


@kernel
def _solve(matrix: Array, size: int) -> None:
    """Solve for the right-hand sides that stand behind the first `size` columns, in place."""
    # Pivot blocks are reduced to the identity, so that four rows below need their own entries
    # alone as factors.
    for first in range(0, size, 4):
        # Columns before this are done with; it is a multiple of LANES.
        start = first // LANES * LANES
        for k in range(first, first + 4):
            reciprocal = 1.0 / matrix[k, k]
            for j in range(first, matrix.shape[1]):
                matrix[k, j] *= reciprocal
            for i in range(first, first + 4):
                if i != k:
                    add_multiple(matrix[i, start:], matrix[k, start:], -matrix[i, k])
        for row in range(first + 4, size, 4):
            _subtract_four(matrix, row, first, start)
    for back in range(4, size + 1, 4):
        first = size - back
        for row in range(0, first, 4):
            _subtract_four(matrix, row, first, size)


@vector_kernel
def _subtract_four(matrix: Array, row: int, first: int, start: int) -> None:
    """Subtract multiples of rows first ... first + 3 from four others, from a column on."""
    # Slices that begin at 0: an index that might be negative keeps a loop from being vectorised.
    p0 = matrix[first, start:]
    p1 = matrix[first + 1, start:]
    p2 = matrix[first + 2, start:]
    p3 = matrix[first + 3, start:]
    r0 = matrix[row, start:]
    r1 = matrix[row + 1, start:]
    r2 = matrix[row + 2, start:]
    r3 = matrix[row + 3, start:]
    a0, b0, c0, d0 = (
        matrix[row, first],
        matrix[row, first + 1],
        matrix[row, first + 2],
        matrix[row, first + 3],
    )
    a1, b1, c1, d1 = (
        matrix[row + 1, first],
        matrix[row + 1, first + 1],
        matrix[row + 1, first + 2],
        matrix[row + 1, first + 3],
    )
    a2, b2, c2, d2 = (
        matrix[row + 2, first],
        matrix[row + 2, first + 1],
        matrix[row + 2, first + 2],
        matrix[row + 2, first + 3],
    )
    a3, b3, c3, d3 = (
        matrix[row + 3, first],
        matrix[row + 3, first + 1],
        matrix[row + 3, first + 2],
        matrix[row + 3, first + 3],
    )
    for j in range((p0.size >> 3) << 3):
        a = p0[j]
        b = p1[j]
        c = p2[j]
        d = p3[j]
        r0[j] -= a0 * a + b0 * b + c0 * c + d0 * d
        r1[j] -= a1 * a + b1 * b + c1 * c + d1 * d
        r2[j] -= a2 * a + b2 * b + c2 * c + d2 * d
        r3[j] -= a3 * a + b3 * b + c3 * c + d3 * d


@kernel
def _by_elimination(motions: Array, augmented: Array, strengths: Array) -> None:
    """Solve for the source strengths of all motions next to the elimination of G."""
    size = augmented.shape[0]
    for i in range(size):
        copy(motions[i], augmented[i, size:])
    _solve(augmented, size)
    for i in range(size):
        copy(augmented[i, size:], strengths[i])


@kernel
def _by_inverse(
    count: int, motions: Array, element: Integers, inverse: Array, strengths: Array
) -> None:
    """Invert G and sum the columns of every motion: B has few entries a panel."""
    invert_in_order(inverse, 0.0)
    elements = element[count] + 1
    strengths[:] = 0.0
    for i in range(count):
        for p in range(count):
            k = element[p]
            strengths[i, k] += inverse[i, p] * motions[p, k]
            strengths[i, elements + k] += inverse[i, p] * motions[p, elements + k]


@entry_kernel
def potentials_of_motions(
    times: int,
    way: int,
    panels: Array,
    count: int,
    element: Integers,
    motions: Array,
    half_log: Array,
    augmented: Array,
    inverse: Array,
    potential: Array,
    strengths: Array,
    out: Array,
) -> None:
    """Evaluate P G^-1 B a number of times.

    Parameters
    ----------
    times : int
        How often.
    way : int
        ELIMINATION solves for the motions as G is eliminated, INVERSE inverts G and multiplies.
        Which is faster depends on the size.
    panels : (7 or more, M') array
        A padded outline (`swim_env.physics.fluid.outline`).
    count : int
        M, the number of panels that are not padding.
    element : (M + 1,) int array
        Element of every panel; the last entry is N - 1.
    motions : (M', K') array
        B: normal velocity of every panel per unit motion.
    half_log : (M' + 1,) array
        Work space.
    augmented, inverse : (M', M' + K'), (M', M') arrays
        Work space.
    potential : (M', M') array
        Work space, zero at first.
    strengths, out : (M', K') arrays
        Overwritten: source strengths and potentials.
    """
    matrix = augmented if way == ELIMINATION else inverse
    for _ in range(times):
        for i in range(count):
            _assemble_row(i, panels, 1.0, half_log, matrix, potential)
        for i in range(count, panels.shape[1]):
            matrix[i] = 0.0
            matrix[i, i] = 1.0
        if way == ELIMINATION:
            _by_elimination(motions, augmented, strengths)
        else:
            _by_inverse(count, motions, element, inverse, strengths)
        multiply(potential, strengths, out)


class FloorArrays(NamedTuple):
    """What `potentials_of_motions` takes of a scene, in its order."""

    panels: Array
    panel_number: int
    element: Integers
    motions: Array
    half_log: Array
    augmented: Array
    inverse: Array
    potential: Array
    strengths: Array
    out: Array


def floor_arrays(scene: Scene) -> FloorArrays:
    """Return the outline, the motions and work space for the pose that a scene starts from.

    Raises
    ------
    SceneError
        If the scene has no panels.
    """
    if scene.fluid is None or scene.fluid.model != "panels":
        raise SceneError("the floor is that of fluid.model panels")
    bodies = Bodies(scene)
    bodies.start(0, *minimal_start(scene, scene.initial))
    outline = bodies.views(0).fluid_work.outline
    elements = scene.beam.elements
    count = int(panel_count(scene_constants(scene)[1].geometry))
    size, wide = outline.element.size, padded(2 * elements)
    motions = aligned_zeros(size, wide)
    rows = np.arange(count)
    motions[rows, outline.element[:count]] = outline.panels[LATERAL, :count]
    motions[rows, elements + outline.element[:count]] = outline.panels[ROTARY, :count]
    return FloorArrays(
        outline.panels,
        count,
        np.append(outline.element[:count], elements - 1),
        motions,
        np.zeros(size + 1),
        aligned_zeros(size, size + wide),
        aligned_zeros(size, size),
        aligned_zeros(size, size),
        aligned_zeros(size, wide),
        aligned_zeros(size, wide),
    )


def floor_calls(scene: Scene) -> dict[str, Callable[[int], None]]:
    """Return what evaluates the floor of a scene a given number of times, in both ways.

    Raises
    ------
    SceneError
        If the scene has no panels.
    """
    arrays = floor_arrays(scene)

    def call(way: int, times: int) -> None:
        potentials_of_motions(times, way, *arrays)

    return {name: partial(call, way) for name, way in FLOOR_WAYS.items()}
