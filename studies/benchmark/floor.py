"""The minimum arithmetic of a step with exact panels, as a kernel of its own.

One assembly of the influence matrices G and P, one elimination of G, and the potentials of all
unit motions, P G^-1 B. Every step has to do this for its new pose; what it takes beyond this floor
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
from swim_env.physics.fluid import outline
from swim_env.physics.runtime.compile import (
    entry_kernel,
    kernel,
    row_kernel,
    use_widest_registers,
)
from swim_env.physics.runtime.dense import (
    add_block_times_rows,
    add_multiple,
    block_of,
    copy,
    invert_in_order,
    multiply,
)
from swim_env.physics.runtime.elementary import atan2, log
from swim_env.physics.runtime.views import LANES, padded
from swim_env.scene import Scene
from swim_env.sim.batch import Bodies, aligned_zeros, minimal_start
from swim_env.sim.constants import scene_constants

Array = NDArray[np.float64]

#: Solving for the motions as G is eliminated, or inverting G and multiplying. Which of the two is
#: faster depends on the size.
FLOOR_WAYS = {"elimination": 0, "inverse": 1}
_ELIMINATION = FLOOR_WAYS["elimination"]


class FloorArrays(NamedTuple):
    """The outline of a pose, padded to M' panels, the motions of N elements, and work space.

    Attributes
    ----------
    panels : (..., M') array
        Vertices, collocation points and tangents, in the rows of `swim_env.physics.fluid.outline`.
    length : (M',) array
        Length of every panel (m).
    element : (M + 1,) int array
        Element of every panel that is not padding; the last entry is N - 1.
    motions : (M', K') array
        B: normal velocity of every panel per unit motion, two of each element.
    strengths, out : (M', K') arrays
        Overwritten: source strengths and potentials.
    """

    panels: Array
    length: Array
    element: NDArray[np.int64]
    motions: Array
    strengths: Array
    out: Array
    half_log: Array
    augmented: Array
    inverse: Array
    potential: Array


@row_kernel
def _assemble_row(
    cx: float,
    cy: float,
    nx: float,
    ny: float,
    x: Array,
    y: Array,
    tangent_x: Array,
    tangent_y: Array,
    lengths: Array,
    half_log: Array,
    normal: Array,
    potential: Array,
) -> None:
    use_widest_registers()
    count = (x.size >> 3) << 3
    for j in range(count):
        dx = cx - x[j]
        dy = cy - y[j]
        half_log[j] = 0.5 * log(dx * dx + dy * dy)
    half_log[count] = half_log[0]
    for j in range(count):
        ct, st, length = tangent_x[j], tangent_y[j], lengths[j]
        dx = cx - x[j]
        dy = cy - y[j]
        along = dx * ct + dy * st
        across = dy * ct - dx * st
        angle = atan2(across * length, across * across + along * (along - length))
        ratio = half_log[j] - half_log[j + 1]
        normal[j] = nx * (ratio * ct - angle * st) + ny * (ratio * st + angle * ct)
        potential[j] = (
            along * half_log[j] - (along - length) * half_log[j + 1] - length + across * angle
        )


@kernel
def _assemble(count: int, a: FloorArrays, matrix: Array) -> None:
    """Write the normal influence, filled up with rows of the identity, and the potentials."""
    panels, size = a.panels, a.length.size
    x, y, tangent_x, tangent_y = (
        panels[outline.X],
        panels[outline.Y],
        panels[outline.CT],
        panels[outline.ST],
    )
    for i in range(count):
        normal, potential = matrix[i, :size], a.potential[i]
        _assemble_row(
            *(panels[outline.CX, i], panels[outline.CY, i], tangent_y[i], -tangent_x[i]),
            *(x, y, tangent_x, tangent_y, a.length, a.half_log, normal, potential),
        )
        normal[i] = np.pi
        potential[i] = a.length[i] * (a.half_log[i] - 1.0)
    for i in range(count, size):
        matrix[i] = 0.0
        matrix[i, i] = 1.0


@kernel
def _solve(matrix: Array, size: int) -> None:
    """Solve for the right-hand sides that follow the first `size` columns, in place."""
    # Pivot blocks are reduced to the identity, so that four rows below need their own entries
    # alone as factors.
    for first in range(0, size, 4):
        # Columns before this are done with; it is a multiple of the lanes of vector registers.
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


@kernel
def _subtract_four(matrix: Array, row: int, first: int, start: int) -> None:
    """Subtract multiples of rows first ... first + 3 from four others, from a column on."""
    block = block_of(matrix, row, first, -1.0)
    # Slices that begin at 0: an index that might be negative keeps a loop from being vectorised.
    s, r = matrix[first : first + 4, start:], matrix[row : row + 4, start:]
    add_block_times_rows(block, s[0], s[1], s[2], s[3], r[0], r[1], r[2], r[3])


@kernel
def _by_elimination(a: FloorArrays) -> None:
    """Solve for the source strengths of all motions next to the elimination of G."""
    size = a.augmented.shape[0]
    for i in range(size):
        copy(a.motions[i], a.augmented[i, size:])
    _solve(a.augmented, size)
    for i in range(size):
        copy(a.augmented[i, size:], a.strengths[i])


@kernel
def _by_inverse(a: FloorArrays) -> None:
    """Invert G and sum the columns of every motion: B has few entries a panel."""
    invert_in_order(a.inverse, 0.0)
    count = a.element.size - 1
    elements = a.element[count] + 1
    a.strengths[:] = 0.0
    for i in range(count):
        for p in range(count):
            k = a.element[p]
            a.strengths[i, k] += a.inverse[i, p] * a.motions[p, k]
            a.strengths[i, elements + k] += a.inverse[i, p] * a.motions[p, elements + k]


@entry_kernel
def potentials_of_motions(times: int, way: int, a: FloorArrays) -> None:
    """Evaluate P G^-1 B a number of times, in one of FLOOR_WAYS, into `a.out`."""
    matrix = a.augmented if way == _ELIMINATION else a.inverse
    count = a.element.size - 1
    for _ in range(times):
        _assemble(count, a, matrix)
        if way == _ELIMINATION:
            _by_elimination(a)
        else:
            _by_inverse(a)
        multiply(a.potential, a.strengths, a.out)


def floor_arrays(scene: Scene) -> FloorArrays:
    """Return the outline, the motions and work space for the pose that a scene starts from.

    A scene without panels is a SceneError.
    """
    if scene.fluid is None or scene.fluid.model != "panels":
        raise SceneError("the floor is that of fluid.model panels")
    bodies = Bodies(scene)
    bodies.start(0, *minimal_start(scene, scene.initial))
    given = bodies.views(0).fluid_work.outline
    elements = scene.beam.elements
    count = int(outline.panel_count(scene_constants(scene)[1].geometry))
    element = given.element[:count]
    size, wide = given.element.size, padded(2 * elements)
    motions = aligned_zeros(size, wide)
    rows = np.arange(count)
    motions[rows, element] = given.panels[outline.LATERAL, :count]
    motions[rows, elements + element] = given.panels[outline.ROTARY, :count]
    return FloorArrays(
        panels=given.panels,
        length=given.panels[outline.LENGTH],
        element=np.append(element, elements - 1),
        motions=motions,
        strengths=aligned_zeros(size, wide),
        out=aligned_zeros(size, wide),
        half_log=np.zeros(size + 1),
        augmented=aligned_zeros(size, size + wide),
        inverse=aligned_zeros(size, size),
        potential=aligned_zeros(size, size),
    )


def floor_calls(scene: Scene) -> dict[str, Callable[[int], None]]:
    """Return what evaluates the floor of a scene a given number of times, in both ways.

    A scene without panels is a SceneError.
    """
    arrays = floor_arrays(scene)

    def call(way: int, times: int) -> None:
        potentials_of_motions(times, way, arrays)

    return {name: partial(call, way) for name, way in FLOOR_WAYS.items()}
