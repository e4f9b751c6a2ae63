r"""What acts at the joints: strain (16), energy (17), torques and damping, and their derivatives.

In a step the directors are averaged, D = R(n) (1 + F/2), and dl K = vect skew(D_a^T D_b), with a in
front of a joint and b behind it. With N_i = EI_i (K_i - K0_i) the virtual work is N . delta(dl K),

.. math::
    4\, \delta(dl K) = (\mathrm{tr} M_2 - M_2^T) \eta_b - (\mathrm{tr} M_1 - M_1) \eta_a, \quad
    M_1 = R_a^T D_b, \quad M_2 = D_a^T R_b

for a rotation eta of the elements at either end of the step, whose R stands in M_1 and M_2.

Torques and dampers are conjugate to the joint's rotation vector theta = log Q, whose change is
J_r^{-1} eta_b - J_l^{-1} eta_a. Half of their impulse acts with the pose of the beginning, half
with that of the end. So does that of strain where it is one of rotation vectors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import embedded, kernel
from swim_env.physics.spatial.chain import Pose, SpatialBeam
from swim_env.physics.spatial.layout import Body, Newton
from swim_env.physics.spatial.rotations import (
    cross_matrix,
    inverse_jacobian,
    inverse_jacobian_matrix,
    product,
    rotate,
    rotate_back,
    trace_less,
    transposed_product,
    turned_block,
)
from swim_env.physics.spatial.vectors import part, size

Array = NDArray[np.float64]


@kernel
def elastic_energy(beam: SpatialBeam, pose: Pose) -> float:
    """Return W (17) of a pose (J)."""
    strain = pose.angles if beam.strain_of_angles else pose.bend
    energy = 0.0
    for j in range(strain.shape[0]):
        for i in range(3):
            bent = strain[j, i] - beam.rest[j, i]
            energy += 0.5 * beam.stiffness[j, i] * bent * bent
    return energy


@embedded
def _average(j: int, beam: SpatialBeam, body: Body, moment: Array, blocks: Array) -> None:
    """Write N (3,) of the averaged directors, and with Q: Q F_b, F_a^T Q, F_a^T Q F_b (blocks)."""
    pose, turn = body.pose, body.inc.turn
    q, front, back = pose.joints[j], turn[j], turn[j + 1]
    by_back, by_front, by_both = blocks[0], blocks[1], blocks[2]
    product(q, back, by_back)
    transposed_product(front, q, by_front)
    transposed_product(front, by_back, by_both)
    for i in range(3):
        u, v = (i + 1) % 3, (i + 2) % 3
        skew = 0.25 * (by_back[v, u] - by_back[u, v] + by_front[v, u] - by_front[u, v])
        skew += 0.125 * (by_both[v, u] - by_both[u, v])
        moment[i] = beam.stiffness[j, i] * (pose.bend[j, i] + skew - beam.rest[j, i])


@embedded
def _partly_turned(front: float, back: float, q: Array, blocks: Array, out: Array) -> None:
    """Write (1 + front F_a)^T Q (1 + back F_b), with the products that `_average` left."""
    by_back, by_front, by_both = blocks[0], blocks[1], blocks[2]
    both = front * back
    for r in range(3):
        for s in range(3):
            out[r, s] = (
                q[r, s] + front * by_front[r, s] + back * by_back[r, s] + both * by_both[r, s]
            )


@embedded
def _add_trace_less(
    factor: float, m: Array, transposed: bool, moment: Array, frame: Array, local: Array, out: Array
) -> None:
    """Add factor R (tr M - M) N to a vector of space, or with M's transpose."""
    if transposed:
        rotate_back(m, moment, local)
    else:
        rotate(m, moment, local)
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    for i in range(3):
        local[i] = factor * (trace * moment[i] - local[i])
    _add_turned(1.0, frame, local, out)


@embedded
def _add_turned(factor: float, frame: Array, v: Array, out: Array) -> None:
    """Add factor R v (3,)."""
    for i in range(3):
        out[i] += factor * (frame[i, 0] * v[0] + frame[i, 1] * v[1] + frame[i, 2] * v[2])


@embedded
def _add_averaged_strain(j: int, h: float, beam: SpatialBeam, body: Body, newton: Newton) -> float:
    """Add -h dW/dq of a joint at both ends of the step; returns the magnitude of the terms."""
    pose, inc, balance = body.pose, body.inc, body.balance
    blocks, q = newton.blocks, pose.joints[j]
    m, moment, local = blocks[3], blocks[4, 0], blocks[4, 2]
    _average(j, beam, body, moment, blocks)
    for late in range(2):
        frames = inc.directors if late == 1 else pose.directors
        out = balance.late if late == 1 else balance.early
        end = float(late)
        # M1 = R_a^T D_b and M2 = D_a^T R_b, with the R of either end.
        _partly_turned(end, 0.5, q, blocks, m)
        _add_trace_less(0.25 * h, m, bool(1), moment, frames[j], local, out[j])
        _partly_turned(0.5, end, q, blocks, m)
        _add_trace_less(-0.25 * h, m, bool(0), moment, frames[j + 1], local, out[j + 1])
    return h * size(part(moment, 0))


@embedded
def _held_force(
    j: int, h: float, torques: Array, beam: SpatialBeam, body: Body, force: Array
) -> float:
    """Write what is conjugate to theta_j and held over the step (N m); returns its terms' sum."""
    magnitude = 0.0
    for i in range(3):
        before, after = body.pose.angles[j, i], body.inc.angles[j, i]
        damping = beam.damping[j, i] * (after - before) / h
        force[i] = torques[j, i] - damping
        magnitude += abs(torques[j, i]) + abs(damping)
        if beam.strain_of_angles:
            strain = beam.stiffness[j, i] * (0.5 * (before + after) - beam.rest[j, i])
            force[i] -= strain
            magnitude += abs(strain)
    return magnitude


@embedded
def joint_impulses(torques: Array, h: float, beam: SpatialBeam, body: Body, newton: Newton) -> None:
    """Collect the impulses of strain, held torques (N - 1, 3) and damping on every element."""
    pose, inc, balance = body.pose, body.inc, body.balance
    balance.early[:] = 0.0
    balance.late[:] = 0.0
    balance.joint_size[:] = 0.0
    force, local = newton.blocks[4, 1], newton.blocks[4, 2]
    for j in range(beam.elements - 1):
        magnitude = h * _held_force(j, h, torques, beam, body, force)
        if not beam.strain_of_angles:
            magnitude += _add_averaged_strain(j, h, beam, body, newton)
        for late in range(2):
            angles = inc.angles[j] if late == 1 else pose.angles[j]
            frames = inc.directors if late == 1 else pose.directors
            out = balance.late if late == 1 else balance.early
            inverse_jacobian(-1.0, angles, force, local)
            _add_turned(-0.5 * h, frames[j + 1], local, out[j])
            _add_turned(0.5 * h, frames[j + 1], local, out[j + 1])
        balance.joint_size[j] += magnitude
        balance.joint_size[j + 1] += magnitude


# ---- derivatives -------------------------------------------------------------------------------


@kernel
def _subtract_block(
    row: int, column: int, block: Array, left: Array, right: Array, work: Array, jacobian: Array
) -> None:
    """Subtract R block R'^T from the rows and columns of two elements in Newton's matrix."""
    turned_block(left, block, right, work, block)
    for r in range(3):
        for s in range(3):
            jacobian[3 + 3 * row + r, 3 + 3 * column + s] -= block[r, s]


@embedded
def _strain_columns(j: int, h: float, beam: SpatialBeam, body: Body, newton: Newton) -> None:
    """Subtract the derivatives of the averaged directors' early impulses from Newton's matrix."""
    pose, inc = body.pose, body.inc
    blocks, q = newton.blocks, pose.joints[j]
    m, change, early, block = blocks[3], blocks[5], blocks[6], blocks[7]
    moment, vector, turned = blocks[4, 0], blocks[4, 1], blocks[4, 2]
    _average(j, beam, body, moment, blocks)
    for element in range(2):  # whose impulse, a or b
        # tr M1 - M1^T of a, tr M2 - M2 of b, at the beginning.
        _partly_turned(0.5 * element, 0.5 - 0.5 * element, q, blocks, m)
        trace_less(m, element == 0, early)
        sign = 1.0 if element == 0 else -1.0
        for column in range(2):  # by whose rotation at the end
            # What changes N: 4 delta(dl K) by the rotation of a or b.
            _partly_turned(1.0 - 0.5 * column, 0.5 + 0.5 * column, q, blocks, m)
            trace_less(m, column == 1, change)
            for r in range(3):
                factor = (0.25 if column == 1 else -0.25) * beam.stiffness[j, r]
                for s in range(3):
                    change[r, s] *= factor
            product(early, change, block)
            if element != column:
                # The other element's directors in M1 or M2 turn as well.
                _partly_turned(float(element), float(column), q, blocks, m)
                _axial(m, vector)
                if element == 0:
                    rotate_back(m, moment, turned)
                else:
                    rotate(m, moment, turned)
                cross_matrix(-0.5, turned, m)
                for r in range(3):
                    for s in range(3):
                        block[r, s] += m[r, s] - sign * moment[r] * vector[s]
            for r in range(3):
                for s in range(3):
                    block[r, s] *= 0.25 * h * sign
            frames = pose.directors[j + element], inc.directors[j + column]
            _subtract_block(j + element, j + column, block, *frames, m, newton.jacobian)


@kernel
def _axial(m: Array, out: Array) -> None:
    """Write the axial vector (3,) of the skew part of a matrix."""
    out[0] = 0.5 * (m[2, 1] - m[1, 2])
    out[1] = 0.5 * (m[0, 2] - m[2, 0])
    out[2] = 0.5 * (m[1, 0] - m[0, 1])


@embedded
def _force_columns(j: int, h: float, beam: SpatialBeam, body: Body, newton: Newton) -> None:
    """Subtract the derivatives of the early impulses of what is held from Newton's matrix."""
    pose, inc = body.pose, body.inc
    blocks = newton.blocks
    left, right, block, work = blocks[0], blocks[1], blocks[2], blocks[3]
    # On b, in its frame, J_l^-1 f; on a, in its own, -J_r^-1 f.
    for element in range(2):
        inverse_jacobian_matrix(1.0 if element == 0 else -1.0, pose.angles[j], left)
        row_sign = -1.0 if element == 0 else 1.0
        for column in range(2):
            column_sign = -1.0 if column == 0 else 1.0
            inverse_jacobian_matrix(column_sign, inc.angles[j], right)
            for r in range(3):
                rate = beam.damping[j, r] / h
                if beam.strain_of_angles:
                    rate += 0.5 * beam.stiffness[j, r]
                for s in range(3):
                    right[r, s] *= -0.5 * h * rate * row_sign * column_sign
            product(left, right, block)
            frames = pose.directors[j + element], inc.directors[j + column]
            _subtract_block(j + element, j + column, block, *frames, work, newton.jacobian)


@embedded
def add_joint_columns(h: float, beam: SpatialBeam, body: Body, newton: Newton) -> None:
    """Add minus the derivatives of the joints' early impulses to Newton's matrix.

    They are by rotations of the elements at the end of the step, in the axes of space.
    """
    for j in range(beam.elements - 1):
        if not beam.strain_of_angles:
            _strain_columns(j, h, beam, body, newton)
        _force_columns(j, h, beam, body, newton)
