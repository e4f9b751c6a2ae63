r"""Derivatives of the step equations in space: Newton's matrix, and the reduced total mass.

The unknowns that they are taken by are a shift of the mean centre and a rotation of every element's
end pose, R(n+1) -> exp(hat xi) R(n+1), in the axes of space. What moves and pushes is kept in rows,
three for every element, with a column for every unknown:

.. math::
    \delta \Delta r = C, \quad \delta (R U_v) = (A_{vv} C + \ldots)/h, \quad
    -\delta r_k = d_3 \times \sum_l E_{lk}\, \delta P^l + \ldots

with the added mass in the axes of space.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.planar.chain import chain_weight
from swim_env.physics.runtime.compile import embedded, kernel, vector_kernel
from swim_env.physics.runtime.dense import add_multiple, copy, multiply
from swim_env.physics.runtime.linking import linked_kernel
from swim_env.physics.spatial.chain import SpatialBeam
from swim_env.physics.spatial.joints import add_joint_columns
from swim_env.physics.spatial.layout import Body, Columns, Increment, Newton, SpatialFluid
from swim_env.physics.spatial.rotations import (
    cross_matrix,
    inverse_jacobian,
    rotate_back,
    trace_less,
    turned_block,
)

Array = NDArray[np.float64]


@embedded
def _turn_block(
    block: Array, left: Array, right: Array, work: Array, out: Array, opposite: Array
) -> None:
    """Write left B right^T of a block B (3, 3) of the added mass, and its transpose opposite."""
    turned_block(left, block, right, work[0], work[1])
    for r in range(3):
        for s in range(3):
            out[r, s] = work[1, r, s]
            opposite[s, r] = work[1, r, s]


@kernel
def turn_added_mass(
    fluid: SpatialFluid, added: Array, frames: Array, columns: Columns, work: Array
) -> None:
    """Write the added mass in the axes of space, for elements with these frames (N, 3, 3)."""
    vv, vw, wv, ww = columns.vv, columns.vw, columns.wv, columns.ww
    for k in range(frames.shape[0]):
        for j in range(frames.shape[0]):
            if k != j and not fluid.coupled:
                continue
            left, right, v, w = frames[k], frames[j], 6 * k, 6 * k + 3
            row, column, there = 3 * k, 3 * j, 6 * j
            if j <= k:
                _turn_block(
                    *(added[v:, there:], left, right, work),
                    *(vv[row:, column:], vv[column:, row:]),
                )
                _turn_block(
                    *(added[w:, there + 3 :], left, right, work),
                    *(ww[row:, column:], ww[column:, row:]),
                )
            _turn_block(
                *(added[w:, there:], left, right, work),
                *(wv[row:, column:], vw[column:, row:]),
            )


@kernel
def _write_moves(beam: SpatialBeam, directors: Array, moves: Array) -> None:
    """Write by how much the centres move with every unknown; `directors` are those that turn."""
    elements, dl = beam.elements, beam.element_length
    for k in range(elements):
        for i in range(3):
            row = moves[3 * k + i]
            row[:3] = 0.0
            row[i] = 1.0
    for j in range(elements):
        share = -chain_weight(j, elements)
        first = 3 + 3 * j
        for k in range(elements):
            if k == j or k == j + 1:
                share += 0.5
            # The axes of space, one after the other, times d3.
            moved = moves[3 * k : 3 * k + 3, first : first + 3]
            cross_matrix(-share * dl, directors[j, :, 2], moved)


@vector_kernel
def _add_block_rows(block: Array, source: Array, first: int, out: Array) -> None:
    """Add a block (3, 3) times three rows of a matrix, from row `first` on, to those of another."""
    aa, ab, ac = block[0, 0], block[0, 1], block[0, 2]
    ba, bb, bc = block[1, 0], block[1, 1], block[1, 2]
    ca, cb, cc = block[2, 0], block[2, 1], block[2, 2]
    x, y, z = source[first], source[first + 1], source[first + 2]
    u, v, w = out[first], out[first + 1], out[first + 2]
    for j in range((u.size >> 3) << 3):
        u[j] += aa * x[j] + ab * y[j] + ac * z[j]
        v[j] += ba * x[j] + bb * y[j] + bc * z[j]
        w[j] += ca * x[j] + cb * y[j] + cc * z[j]


@kernel
def _multiply_blocks(
    elements: int, coupled: bool, factors: Array, source: Array, block: Array, out: Array
) -> None:
    """Write factors times source, where elements are not coupled by blocks of three rows."""
    if coupled:
        rows, n = 3 * elements, (3 * elements + 3) // 4 * 4
        multiply(factors, source[:n], out[:rows])
        return
    out[:] = 0.0
    for first in range(0, 3 * elements, 3):
        for r in range(3):
            for s in range(3):
                block[r, s] = factors[first + r, first + s]
        _add_block_rows(block, source, first, out)


@kernel
def _add_own_motion(
    j: int,
    coupled: bool,
    elements: int,
    spin: Array,
    angular: Array,
    linear: Array,
    columns: Columns,
) -> None:
    """Add the impulses of what an element's unknowns do to its own motion alone.

    `spin` (3, 3) is the change of a motion by its rotation; `angular` and `linear` (3 N, 3 N) are
    the impulses that it has.
    """
    first = 3 + 3 * j
    begin, end = (0, elements) if coupled else (j, j + 1)
    for k in range(3 * begin, 3 * end):
        push, turning = columns.pushes[k], columns.spins[k]
        p, t = linear[k, 3 * j : 3 * j + 3], angular[k, 3 * j : 3 * j + 3]
        for s in range(3):
            x, y, z = spin[0, s], spin[1, s], spin[2, s]
            push[first + s] += p[0] * x + p[1] * y + p[2] * z
            turning[first + s] += t[0] * x + t[1] * y + t[2] * z


@kernel
def _add_own_motions_at_rest(elements: int, columns: Columns) -> None:
    """Add the impulses of all elements' own turns in a vanishing increment."""
    for k in range(3 * elements):
        push, turning, vw, ww = columns.pushes[k], columns.spins[k], columns.vw[k], columns.ww[k]
        for i in range(3 * elements):
            push[3 + i] += vw[i]
            turning[3 + i] += ww[i]


@kernel
def _half_trace_less(turn: Array, frame: Array, transposed: bool, out: Array, work: Array) -> None:
    """Write (tr E - E)/2 in the axes of space, or with E's transpose; E = R (1 + F) R^T."""
    trace_less(turn, transposed, out)
    turned_block(frame, out, frame, work, out)
    for r in range(3):
        for s in range(3):
            out[r, s] *= 0.5
        out[r, r] += 1.0


@vector_kernel
def _next_lever(
    behind: Array, last: Array, push: Array, total: Array, half: float, share: float, out: Array
) -> None:
    """Write behind + half (last + push) - share total, of padded rows."""
    for j in range((out.size >> 3) << 3):
        out[j] = behind[j] + half * (last[j] + push[j]) - share * total[j]


@kernel
def _sum_rows_from_centres(beam: SpatialBeam, pushes: Array, out: Array, total: Array) -> None:
    """Write sum_l E_lk P^l of every column, and the sum of all pushes (3, n) to `total`."""
    elements, dl = beam.elements, beam.element_length
    for i in range(3):
        total[i, :] = 0.0
        for k in range(elements):
            add_multiple(total[i], pushes[3 * k + i], 1.0)
        for back in range(elements):
            k = elements - 1 - back
            row = out[3 * k + i]
            push = pushes[3 * k + i]
            if back == 0:
                row[:] = 0.0
                add_multiple(row, push, 0.5 * dl)
                add_multiple(row, total[i], -chain_weight(k, elements) * dl)
            else:
                # What is behind grows by half of either element; so does the mean's share.
                behind, share = 3 * (k + 1) + i, dl / elements
                _next_lever(out[behind], pushes[behind], push, total[i], 0.5 * dl, share, row)


@linked_kernel
def inertia_columns(
    h: float,
    adjoint: bool,
    still: bool,
    beam: SpatialBeam,
    fluid: SpatialFluid,
    body: Body,
    newton: Newton,
    out: Array,
) -> None:
    """Write minus the derivatives of all but the joints' impulses.

    `still` is for a vanishing increment, where much of it is not there.
    """
    pose, inc = body.pose, body.inc
    elements = beam.elements
    rate = 1.0 / h
    c = newton.columns
    new = pose.directors if still else inc.directors
    blocks = newton.blocks
    spin, shift, other, work = blocks[0], blocks[1], blocks[2], blocks[3]
    _write_moves(beam, new, c.moves)
    if fluid.present:
        _multiply_blocks(elements, fluid.coupled, c.vv, c.moves, work, c.pushes)
        _multiply_blocks(elements, fluid.coupled, c.wv, c.moves, work, c.spins)
        if still:
            _add_own_motions_at_rest(elements, c)
        for j in range(0 if still else elements):
            _half_trace_less(inc.turn[j], pose.directors[j], adjoint, spin, work)
            _add_own_motion(j, fluid.coupled, elements, spin, c.ww, c.vw, c)
            if adjoint:
                # The frame that the shift is measured in turns: -axis x shift.
                cross_matrix(1.0, inc.shift[j], shift)
                _add_own_motion(j, fluid.coupled, elements, shift, c.wv, c.vv, c)
        for k in range(3 * elements):
            push, turning = c.pushes[k], c.spins[k]
            for i in range(push.size):
                push[i] *= rate
                turning[i] *= rate
        if adjoint:
            for j in range(elements):
                cross_matrix(-1.0, inc.push[j], shift)
                for r in range(3):
                    for s in range(3):
                        c.pushes[3 * j + r, 3 + 3 * j + s] += shift[r, s]
    else:
        c.pushes[:] = 0.0
    c.rows[:] = 0.0
    for k in range(elements):
        first = 3 * k
        if fluid.present:
            if still:
                for i in range(first, first + 3):
                    copy(c.spins[i], c.rows[i])
            else:
                _half_trace_less(inc.turn[k], pose.directors[k], not adjoint, other, work)
                _add_block_rows(other, c.spins, first, c.rows)
            if not adjoint and not still:
                cross_matrix(1.0, inc.shift[k], other)
                _add_block_rows(other, c.pushes, first, c.rows)
                cross_matrix(-1.0, inc.push[k], other)
                _add_block_rows(other, c.moves, first, c.rows)
        for i in range(3):
            add_multiple(c.pushes[first + i], c.moves[first + i], beam.mass[k] * rate)
    _sum_rows_from_centres(beam, c.pushes, c.levers, c.total)
    for k in range(elements):
        cross_matrix(1.0, pose.directors[k, :, 2], other)
        _add_block_rows(other, c.levers, 3 * k, c.rows)
        _add_own_turn(k, rate, beam, fluid, body, new, blocks, c.rows)
    n = out.shape[0]
    for i in range(3):
        copy(c.total[i, :n], out[i])
    for i in range(3 * elements):
        copy(c.rows[i, :n], out[3 + i])


@embedded
def _add_own_turn(
    j: int,
    rate: float,
    beam: SpatialBeam,
    fluid: SpatialFluid,
    body: Body,
    new: Array,
    blocks: Array,
    rows: Array,
) -> None:
    """Add what an element's turn changes of its own angular momentum with all impulses held.

    The body's is sum_i I_i d_i x Delta d_i/h, the fluid's R (tr E - E^T) U_w/2.
    """
    inc, d = body.inc, body.pose.directors[j]
    first = 3 * j
    column = 3 + first
    for a in range(2):
        factor = beam.inertia[j, a] * rate
        along = 0.0
        for i in range(3):
            along += d[i, a] * new[j, i, a]
        # d x (xi x d') = (d . d') xi - (d . xi) d'.
        for r in range(3):
            for s in range(3):
                rows[first + r, column + s] -= factor * new[j, r, a] * d[s, a]
            rows[first + r, column + r] += factor * along
    if not fluid.present:
        return
    # With dE = hat(y) E for y = R^T xi: tr(dE) = -2 w . y and dE^T U = -E^T (y x U).
    local, turned, work = blocks[1], blocks[2], blocks[3]
    turn = inc.turn[j]
    spin = inc.impulse[6 * j + 3 : 6 * j + 6]
    cross_matrix(-0.5, spin, turned)
    for r in range(3):
        for s in range(3):
            local[r, s] = turned[r, s] - spin[r] * inc.motion[6 * j + 3 + s]
            for a in range(3):
                local[r, s] += turn[a, r] * turned[a, s]
    turned_block(d, local, d, work, local)
    for r in range(3):
        for s in range(3):
            rows[first + r, column + s] += local[r, s]


@kernel
def mass_matrix(beam: SpatialBeam, fluid: SpatialFluid, body: Body, newton: Newton) -> None:
    """Write the reduced total mass at q_n, in the axes of space, to `mass.total`.

    It is the inertial part of Newton's matrix at a vanishing increment. The added mass in the axes
    of space is left for `spatial_jacobian`.
    """
    pose, inc, mass = body.pose, body.inc, body.mass
    inc.turn[:] = 0.0
    inc.motion[:] = 0.0
    inc.impulse[:] = 0.0
    if fluid.present:
        turn_added_mass(fluid, mass.added, pose.directors, newton.columns, newton.blocks)
    inertia_columns(1.0, bool(0), bool(1), beam, fluid, body, newton, mass.total)


@linked_kernel
def spatial_jacobian(
    h: float, adjoint: bool, beam: SpatialBeam, fluid: SpatialFluid, body: Body, newton: Newton
) -> None:
    """Write minus the derivative of the residual to `newton.jacobian`.

    Call `evaluate_spatial_step` before. All terms are there but the derivatives of the shape force
    and of an adjoint's added mass.
    """
    if fluid.present and adjoint:
        mass, inc = body.mass, body.inc
        turn_added_mass(fluid, mass.added, inc.directors, newton.columns, newton.blocks)
    inertia_columns(h, adjoint, bool(0), beam, fluid, body, newton, newton.jacobian)
    add_joint_columns(h, beam, body, newton)


@kernel
def add_correction(step: Array, length: float, inc: Increment, z: Array, local: Array) -> None:
    """Add a correction (3 N + 3,) of the unknowns to an increment z that was evaluated last.

    A rotation xi of the end pose changes the increment by J_r(phi)^-1 R(n+1)^T xi.
    """
    for i in range(3):
        z[i] += length * step[i]
    for k in range(inc.directors.shape[0]):
        first = 3 + 3 * k
        phi = z[first : first + 3]
        rotate_back(inc.directors[k], step[first : first + 3], local[0])
        inverse_jacobian(1.0, phi, local[0], local[1])
        for i in range(3):
            phi[i] += length * local[1, i]
