r"""The discrete Lagrangian of PHYSICS.md section 4, its derivatives and their Jacobian.

In redundant coordinates (r, d1, d3) of every element

.. math::
    L_d(q_n, q_{n+1}) = \frac{1}{2 h} \Delta q \cdot (M_b + M_f(q_n)) \Delta q
        - h\, W(K(q_{n+1/2})).

Everything here is the pull-back of its derivatives to the minimal coordinates (the discrete null
space method of Leyendecker, Marsden & Ortiz), written in increments z = (dc, d theta_1, da_2 ...
da_N) from q_n. Positions never enter, so the result does not depend on where the beam is.
With delta_k the turn of element k in the step, E the map from directors to centres and P^k the
momentum of element k, the derivatives are

.. math::
    D_1 L_d \cdot \delta c &= -\sum_k P^k, \\
    D_1 L_d \cdot \delta\theta_j &= -J \sin\delta_j / h - f_{w,j} \cos\delta_j
        - f_{v,j}\, d_3^j \cdot \Delta r^j + f_{a,j}\, d_1^j \cdot \Delta r^j \\
        &\quad - d_1^j \cdot \sum_k E_{kj} P^k - h\, \partial W / \partial\theta_j(n)
        + \frac{1}{2 h} V^T \frac{\partial A}{\partial\theta_j} V,

with f = A V/h the impulse of the fluid per unit motion.

The adjoint of this map has the inertia of q_{n+1}: L_d*(q_n, q_{n+1}) = -L_d(q_{n+1}, q_n) with -h
for h. Its V is measured with the directors at q_{n+1}; then D_1 L_d* has no shape force and no
term in f_v d3 . dr, and D_2 L_d* has them. Composing both halves of a step is of second order.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.added_mass import (
    NO_FLUID,
    FluidConstants,
    FluidWork,
    motion_count,
    shape_force,
)
from swim_env.physics.fluid.outline import padded
from swim_env.physics.planar.beam import BeamConstants, chain_weight
from swim_env.physics.runtime.compile import inlined, kernel, shared
from swim_env.physics.runtime.dense import copy, mat_vec, multiply
from swim_env.physics.runtime.elementary import SMALL_ANGLE, cos_small, sin_small

__all__ = [
    "StepArrays",
    "carve_step_arrays",
    "drag_loss",
    "drag_moment",
    "evaluate_held_step",
    "evaluate_step",
    "mass_matrix",
    "pose_jacobian",
    "residual_norm",
    "round_off_floor",
    "set_pose",
    "step_array_size",
    "step_jacobian",
]

Array = NDArray[np.float64]

# Rows of `StepArrays.elements`, one number per element: directors at q_n, first director at
# q_{n+1}; sine and cosine of the element's turn in the step and of half of it, of the joint in
# front of it (behind element 1: the row is one shorter) at q_n and at q_{n+1/2}; increment of its
# centre (m); P^k (kg m/s); sum over k of E_kj P^k (kg m^2/s); V^T dA/dtheta V/2; h dW/dtheta at
# q_n, its sum with that at q_{n+1} and the magnitude of the terms; impulse h F of torques and
# damping and the magnitude of its terms; scratch; impulse of the drag (kg m/s) and its moment
# (kg m^2/s), what the joints in front feel of it like E P, and its slopes: by the increment of the
# centre along the normal, by the turn, and of one by the other; for the internal forces, the
# mean momentum in the last step with half its drag, the force from the neighbours since, mean
# momentum and drag of this step, and four rows of these at the beginning of a part.
(
    D1X,
    D1Y,
    D3X,
    D3Y,
    NEW_D1X,
    NEW_D1Y,
    SIN_TURN,
    COS_TURN,
    SIN_HALF,
    COS_HALF,
    SIN_JOINT,
    COS_JOINT,
    SIN_MEAN,
    COS_MEAN,
    MOVE_X,
    MOVE_Y,
    MOMENTUM_X,
    MOMENTUM_Y,
    BEHIND_X,
    BEHIND_Y,
    SHAPE,
    ELASTIC,
    ELASTIC_SUM,
    ELASTIC_SIZE,
    IMPULSE,
    IMPULSE_SIZE,
    SUM_X,
    SUM_Y,
    COLUMN_SHAPE,
    DRAG_X,
    DRAG_Y,
    DRAG_TURN,
    DRAG_BEHIND_X,
    DRAG_BEHIND_Y,
    DRAG_SLOPE,
    DRAG_CROSS,
    DRAG_TURN_SLOPE,
    PAST_X,
    PAST_Y,
    NET_X,
    NET_Y,
    MEAN_X,
    MEAN_Y,
    PUSH_X,
    PUSH_Y,
    KEPT,
) = range(46)
_ELEMENT_ROWS = 49
# Rows of `StepArrays.unknowns`, one number per minimal coordinate: residual of
# p_n + D1 L_d + h F/2, the scale it is measured with, the magnitude of its terms, the change
# D1 L_d + D2 L_d + h F of the momentum; Newton's increment, trial, correction and next correction;
# the increment Newton started from; the velocity M^-1 p at q_n; the increment of the outer step; q
# and p at its beginning; the angles that the mass stands for, behind a flag, and the momentum that
# the velocity stands for; the diagonal of the mass, which its Cholesky factor replaces; the joint
# angles that the added mass stands for, behind a flag, and those of a trial; coordinates, momentum
# and increment of the outer step at the beginning of one of its parts; the momentum up to which
# the internal forces are known.
RESIDUAL, SCALE, SIZE, CHANGE, INCREMENT, TRIAL, DIRECTION, PROPOSED = range(8)
START, VELOCITY, TOTAL, SAVED_Q, SAVED_P, PREPARED, PREPARED_P = range(8, 15)
MASS_DIAGONAL, ADDED_ANGLES, TRIAL_ANGLES, PART_Q, PART_P, PART_TOTAL = range(15, 21)
FORCES_P = 21
_UNKNOWN_ROWS = 22
# Rows of `StepArrays.motions`, one number per unit motion: V, A V/h, scratch.
MOTION, FLUID_IMPULSE, MOVED = range(3)
_MOTION_ROWS = 3
# Columns of the record of a step.
_RECORD = 12

#: States of an adjoint step.
SOLVED_FOR, FOUND = 1.0, 2.0
#: Difference quotient for the derivative of the shape force in Newton's matrix, in increments.
SHAPE_DIFFERENCE = 1e-5


class StepArrays(NamedTuple):
    """Work space of one step; K' is K, padded.

    Attributes
    ----------
    elements : (rows, N) array
        One row per quantity of an element, see the row names above.
    unknowns : (rows, N + 2) array
        One row per vector in minimal coordinates.
    motions : (rows, K') array
        One row per vector of unit motions.
    added_mass : (K', K') array
        A at q_n.
    mass : (N + 2, N + 2) array
        Reduced total mass at q_n; its Cholesky factor replaces the diagonal and what is below.
    jacobian, transposed : (N + 2, N + 2) arrays
        Newton's matrix (its factors) and the rows of its transpose.
    column_motions, column_impulses : (N + 2, K') arrays
        Derivatives of V and of A V, a row for every unknown.
    report : (4,) array
        What Newton's method says of its last attempt.
    adjoint : (1,) array
        0 where the inertia is that of q_n; SOLVED_FOR and then FOUND where it is that of q_{n+1}.
    part_record : (12,) array
        The record of the outer step at the beginning of one of its parts.
    forces_known : (1,) array
        1 where the mean momenta of the step before are known.
    shape_status : (1,) array
        Why the last shape at the end of an adjoint step could not be weighed, 0 where it could.
    effort : (4,) array
        Share of the effort that an outer step may take that was spent, and what an evaluation of
        the residual, one of an added mass, and a matrix of N + 2 rows add to it.
    """

    elements: Array
    unknowns: Array
    motions: Array
    added_mass: Array
    mass: Array
    jacobian: Array
    transposed: Array
    column_motions: Array
    column_impulses: Array
    report: Array
    adjoint: Array
    part_record: Array
    forces_known: Array
    shape_status: Array
    effort: Array


@shared
def step_array_size(elements: int, motions: int) -> int:
    """Return how many float64 numbers `carve_step_arrays` takes."""
    n = elements + 2
    k = padded(motions)
    return (
        k * (k + 2 * n + _MOTION_ROWS)
        + _ELEMENT_ROWS * elements
        + _UNKNOWN_ROWS * n
        + 3 * n * n
        + 11
        + _RECORD
    )


@shared
def carve_step_arrays(floats: Array, elements: int, motions: int) -> StepArrays:
    """Lay the arrays of `StepArrays` into a flat buffer of `step_array_size` numbers.

    The buffer is zero at first: what pads its arrays is never written.
    """
    n = elements + 2
    k = padded(motions)
    mass_end = k * k
    derivative_end = mass_end + 2 * n * k
    motions_end = derivative_end + _MOTION_ROWS * k
    elements_end = motions_end + _ELEMENT_ROWS * elements
    unknowns_end = elements_end + _UNKNOWN_ROWS * n
    squares_end = unknowns_end + 3 * n * n
    squares = floats[unknowns_end:squares_end].reshape((3, n, n))
    derivatives = floats[mass_end:derivative_end].reshape((2, n, k))
    return StepArrays(
        floats[motions_end:elements_end].reshape((_ELEMENT_ROWS, elements)),
        floats[elements_end:unknowns_end].reshape((_UNKNOWN_ROWS, n)),
        floats[derivative_end:motions_end].reshape((_MOTION_ROWS, k)),
        floats[:mass_end].reshape((k, k)),
        squares[0],
        squares[1],
        squares[2],
        derivatives[0],
        derivatives[1],
        floats[squares_end : squares_end + 4],
        floats[squares_end + 4 : squares_end + 5],
        floats[squares_end + 5 : squares_end + 5 + _RECORD],
        floats[squares_end + 5 + _RECORD : squares_end + 6 + _RECORD],
        floats[squares_end + 6 + _RECORD : squares_end + 7 + _RECORD],
        floats[squares_end + 7 + _RECORD :],
    )


@kernel
def set_pose(q: Array, beam: BeamConstants, w: StepArrays) -> None:
    """Compute directors and joints at q_n from the minimal coordinates q (N + 2,)."""
    e = w.elements
    angle = 0.0
    for k in range(e[D1X].size):
        angle += q[2 + k]
        e[D3X, k] = np.cos(angle)
        e[D3Y, k] = np.sin(angle)
        e[D1X, k] = -e[D3Y, k]
        e[D1Y, k] = e[D3X, k]
    for j in range(q.size - 3):
        e[SIN_JOINT, j] = np.sin(q[3 + j])
        e[COS_JOINT, j] = np.cos(q[3 + j])
    if beam.linear_strain:
        _take_angles(q, w)


@kernel
def _take_angles(q: Array, w: StepArrays) -> None:
    """Put the joint angle and its slope, 1, in the place of its sine and cosine."""
    e = w.elements
    for j in range(q.size - 3):
        e[SIN_JOINT, j] = q[3 + j]
        e[COS_JOINT, j] = 1.0


@kernel
def _take_mean_angles(z: Array, w: StepArrays) -> None:
    """Do the same for the mean joint angles of a step with increment z (N + 2,)."""
    e = w.elements
    for j in range(z.size - 3):
        e[SIN_MEAN, j] = e[SIN_JOINT, j] + 0.5 * z[3 + j]
        e[COS_MEAN, j] = 1.0


@kernel
def _set_increment(z: Array, w: StepArrays) -> None:
    """Compute turns, first directors and mean joints from the increment z (N + 2,)."""
    e = w.elements
    half = 0.0
    small = True
    for k in range(e[D1X].size):
        half += 0.5 * z[2 + k]
        e[SIN_HALF, k] = half
        small = small and abs(half) <= SMALL_ANGLE
        if k > 0:
            e[SIN_MEAN, k - 1] = 0.5 * z[2 + k]
            small = small and abs(z[2 + k]) <= 2.0 * SMALL_ANGLE
    # Newton's iterates stay small; the library's functions serve the rest.
    if small:
        for k in range(e[D1X].size):
            e[COS_HALF, k] = cos_small(e[SIN_HALF, k])
            e[SIN_HALF, k] = sin_small(e[SIN_HALF, k])
        for j in range(e[D1X].size - 1):
            s = sin_small(e[SIN_MEAN, j])
            c = cos_small(e[SIN_MEAN, j])
            e[SIN_MEAN, j] = e[SIN_JOINT, j] * c + e[COS_JOINT, j] * s
            e[COS_MEAN, j] = e[COS_JOINT, j] * c - e[SIN_JOINT, j] * s
    else:
        for k in range(e[D1X].size):
            e[COS_HALF, k] = np.cos(e[SIN_HALF, k])
            e[SIN_HALF, k] = np.sin(e[SIN_HALF, k])
        for j in range(e[D1X].size - 1):
            s = np.sin(e[SIN_MEAN, j])
            c = np.cos(e[SIN_MEAN, j])
            e[SIN_MEAN, j] = e[SIN_JOINT, j] * c + e[COS_JOINT, j] * s
            e[COS_MEAN, j] = e[COS_JOINT, j] * c - e[SIN_JOINT, j] * s
    for k in range(e[D1X].size):
        s = e[SIN_HALF, k]
        e[SIN_TURN, k] = 2.0 * s * e[COS_HALF, k]
        e[COS_TURN, k] = 1.0 - 2.0 * s * s
        e[NEW_D1X, k] = e[D1X, k] * e[COS_TURN, k] - e[D3X, k] * e[SIN_TURN, k]
        e[NEW_D1Y, k] = e[D1Y, k] * e[COS_TURN, k] - e[D3Y, k] * e[SIN_TURN, k]


@kernel
def _sum_to_centres(
    x: Array, y: Array, shift_x: float, shift_y: float, dl: float, out_x: Array, out_y: Array
) -> None:
    """Apply E to changes of d3 and add a shift: out_k = shift + sum_j E_kj x_j."""
    elements = x.size
    mean_x = 0.0
    mean_y = 0.0
    for j in range(elements):
        weight = chain_weight(j, elements)
        mean_x += weight * x[j]
        mean_y += weight * y[j]
    front_x = -mean_x
    front_y = -mean_y
    for k in range(elements):
        out_x[k] = shift_x + dl * (front_x + 0.5 * x[k])
        out_y[k] = shift_y + dl * (front_y + 0.5 * y[k])
        front_x += x[k]
        front_y += y[k]


@kernel
def _sum_from_centres(
    x: Array, y: Array, total_x: float, total_y: float, dl: float, out_x: Array, out_y: Array
) -> None:
    """Apply the transpose of E: out_j = sum_k E_kj x_k."""
    elements = x.size
    behind_x = 0.0
    behind_y = 0.0
    for back in range(elements):
        j = elements - 1 - back
        weight = chain_weight(j, elements)
        out_x[j] = dl * (behind_x + 0.5 * x[j] - weight * total_x)
        out_y[j] = dl * (behind_y + 0.5 * y[j] - weight * total_y)
        behind_x += x[j]
        behind_y += y[j]


@kernel
def _elastic_terms(h: float, beam: BeamConstants, w: StepArrays) -> None:
    """Differentiate h W(K(q_{n+1/2})), the strain (16) that of averaged directors or of angles."""
    e = w.elements
    averaged = not beam.strain_of_angles
    e[ELASTIC] = 0.0
    e[ELASTIC_SUM] = 0.0
    e[ELASTIC_SIZE] = 0.0
    if not beam.elastic:
        return
    for j in range(beam.joint_stiffness.size):
        sine = e[SIN_MEAN, j]
        cosine = e[COS_MEAN, j]
        # Averages of directors that turn are shorter than 1, by the cosine of half the turn.
        front = e[COS_HALF, j] if averaged else 1.0
        back = e[COS_HALF, j + 1] if averaged else 1.0
        front_sine = e[SIN_HALF, j] if averaged else 0.0
        back_sine = e[SIN_HALF, j + 1] if averaged else 0.0
        moment = h * beam.joint_stiffness[j] * front * back * sine
        straight = 0.5 * front * back * cosine
        e[ELASTIC, j] += moment * (-straight + 0.5 * front_sine * back * sine)
        e[ELASTIC, j + 1] += moment * (straight + 0.5 * back_sine * front * sine)
        e[ELASTIC_SUM, j] -= 2.0 * moment * straight
        e[ELASTIC_SUM, j + 1] += 2.0 * moment * straight
        e[ELASTIC_SIZE, j] += abs(moment)
        e[ELASTIC_SIZE, j + 1] += abs(moment)


@kernel
def _impulses(torques: Array, z: Array, h: float, beam: BeamConstants, w: StepArrays) -> None:
    """Collect the impulses of held joint torques and of Kelvin-Voigt damping over the step."""
    e = w.elements
    e[IMPULSE] = 0.0
    e[IMPULSE_SIZE] = 0.0
    for j in range(torques.size):
        impulse = h * torques[j] - beam.joint_damping[j] * z[3 + j]
        e[IMPULSE, j] -= impulse
        e[IMPULSE, j + 1] += impulse
        size = h * abs(torques[j]) + beam.joint_damping[j] * abs(z[3 + j])
        e[IMPULSE_SIZE, j] += size
        e[IMPULSE_SIZE, j + 1] += size


@kernel
def _base_row(w: StepArrays) -> int:
    """Return the row of the first directors that the fluid's motions are measured with."""
    return D1X if w.adjoint[0] == 0.0 else NEW_D1X


@kernel
def _drag_terms(
    z: Array, h: float, beam: BeamConstants, fluid: FluidConstants, w: StepArrays
) -> None:
    """Collect the impulse of quadratic cross-flow drag over the step, and its slopes.

    The force per length on a place that moves with u along the normal, -rho C |u| u/2, is summed at
    two Gauss points of every element, exact where the sign of u does not change along it. Velocity
    and normal are those of the middle of the step, so the drag is of second order in time and takes
    energy in every step.
    """
    e = w.elements
    elements = beam.elements
    dl = beam.element_length
    arm = dl / (2.0 * math.sqrt(3.0))
    weight = 0.5 * fluid.drag * dl
    rate = 1.0 / h
    turn = 0.0
    total_x = 0.0
    total_y = 0.0
    for k in range(elements):
        turn += z[2 + k]
        normal_x = e[D1X, k] * e[COS_HALF, k] - e[D3X, k] * e[SIN_HALF, k]
        normal_y = e[D1Y, k] * e[COS_HALF, k] - e[D3Y, k] * e[SIN_HALF, k]
        across = rate * (normal_x * e[MOVE_X, k] + normal_y * e[MOVE_Y, k])
        front = across - arm * rate * turn
        back = across + arm * rate * turn
        impulse = -h * weight * (abs(front) * front + abs(back) * back)
        e[DRAG_X, k] = impulse * normal_x
        e[DRAG_Y, k] = impulse * normal_y
        e[DRAG_TURN, k] = -h * weight * arm * (abs(back) * back - abs(front) * front)
        e[DRAG_SLOPE, k] = 2.0 * weight * (abs(front) + abs(back))
        e[DRAG_CROSS, k] = 2.0 * weight * arm * (abs(back) - abs(front))
        e[DRAG_TURN_SLOPE, k] = arm * arm * e[DRAG_SLOPE, k]
        total_x += e[DRAG_X, k]
        total_y += e[DRAG_Y, k]
    _sum_from_centres(
        e[DRAG_X], e[DRAG_Y], total_x, total_y, dl, e[DRAG_BEHIND_X], e[DRAG_BEHIND_Y]
    )


@kernel
def _add_drag(
    z: Array, h: float, beam: BeamConstants, fluid: FluidConstants, w: StepArrays
) -> None:
    """Add the drag to residual, scale and change of the momentum: half its impulse at each end."""
    e = w.elements
    u = w.unknowns
    _drag_terms(z, h, beam, fluid, w)
    size = 0.0
    for k in range(beam.elements):
        u[RESIDUAL, 0] += 0.5 * e[DRAG_X, k]
        u[RESIDUAL, 1] += 0.5 * e[DRAG_Y, k]
        u[CHANGE, 0] += e[DRAG_X, k]
        u[CHANGE, 1] += e[DRAG_Y, k]
        size += abs(e[DRAG_X, k]) + abs(e[DRAG_Y, k])
        arm = e[D1X, k] * e[DRAG_BEHIND_X, k] + e[D1Y, k] * e[DRAG_BEHIND_Y, k]
        new_arm = e[NEW_D1X, k] * e[DRAG_BEHIND_X, k] + e[NEW_D1Y, k] * e[DRAG_BEHIND_Y, k]
        u[RESIDUAL, 2 + k] += 0.5 * (e[DRAG_TURN, k] + arm)
        u[CHANGE, 2 + k] += e[DRAG_TURN, k] + 0.5 * (arm + new_arm)
        turning = abs(e[DRAG_TURN, k]) + abs(arm)
        u[SCALE, 2 + k] = max(u[SCALE, 2 + k], turning)
        u[SIZE, 2 + k] += turning
    for i in range(2):
        u[SCALE, i] = max(u[SCALE, i], size)
        u[SIZE, i] += size


@kernel
def drag_loss(z: Array, h: float, w: StepArrays) -> float:
    """Return the energy (J) that the drag took in the step of the last evaluation, at least 0."""
    e = w.elements
    turn = 0.0
    loss = 0.0
    for k in range(z.size - 2):
        turn += z[2 + k]
        loss -= e[DRAG_X, k] * e[MOVE_X, k] + e[DRAG_Y, k] * e[MOVE_Y, k] + e[DRAG_TURN, k] * turn
    return loss / h


@kernel
def drag_moment(w: StepArrays) -> float:
    """Return the drag's angular impulse about the mean centre in the last evaluation (kg m^2/s)."""
    e = w.elements
    moment = 0.0
    for k in range(e[D1X].size):
        mean_x = 0.5 * (e[D1X, k] + e[NEW_D1X, k])
        mean_y = 0.5 * (e[D1Y, k] + e[NEW_D1Y, k])
        moment += e[DRAG_TURN, k] + mean_x * e[DRAG_BEHIND_X, k] + mean_y * e[DRAG_BEHIND_Y, k]
    return moment


@kernel
def _move(z: Array, h: float, beam: BeamConstants, fluid: FluidConstants, w: StepArrays) -> None:
    """Compute how elements and centres move in an increment z, and the fluid's impulse A V/h."""
    e = w.elements
    m = w.motions
    elements = beam.elements
    _set_increment(z, w)
    if beam.linear_strain:
        _take_mean_angles(z, w)
    for k in range(elements):
        # d3(n+1) - d3(n) without cancellation.
        versine = -2.0 * e[SIN_HALF, k] * e[SIN_HALF, k]
        e[SUM_X, k] = versine * e[D3X, k] + e[SIN_TURN, k] * e[D1X, k]
        e[SUM_Y, k] = versine * e[D3Y, k] + e[SIN_TURN, k] * e[D1Y, k]
    _sum_to_centres(e[SUM_X], e[SUM_Y], z[0], z[1], beam.element_length, e[MOVE_X], e[MOVE_Y])
    if fluid.model != NO_FLUID:
        normal_x = _base_row(w)
        normal_y = normal_x + 1
        for k in range(elements):
            m[MOTION, k] = e[normal_x, k] * e[MOVE_X, k] + e[normal_y, k] * e[MOVE_Y, k]
            m[MOTION, elements + k] = e[SIN_TURN, k]
        if fluid.axial:
            # d3 = (d1_y, -d1_x).
            for end in range(2):
                k = 0 if end == 0 else elements - 1
                m[MOTION, 2 * elements + end] = (
                    e[normal_y, k] * e[MOVE_X, k] - e[normal_x, k] * e[MOVE_Y, k]
                )
        mat_vec(w.added_mass[: motion_count(fluid)], m[MOTION], m[FLUID_IMPULSE])
        for i in range(m[FLUID_IMPULSE].size):
            m[FLUID_IMPULSE, i] /= h


@kernel
def evaluate_held_step(
    p: Array,
    torques: Array,
    z: Array,
    h: float,
    beam: BeamConstants,
    fluid: FluidConstants,
    w: StepArrays,
) -> float:
    """Evaluate the residual like `evaluate_step`, the shape force taken as its row stands.

    The shape force is what an evaluation spends most of its time on, and changes little with z.
    """
    _move(z, h, beam, fluid, w)
    return _balance(p, torques, z, h, beam, fluid, w)


@kernel
def evaluate_step(
    p: Array,
    torques: Array,
    z: Array,
    h: float,
    beam: BeamConstants,
    fluid: FluidConstants,
    fluid_work: FluidWork,
    w: StepArrays,
) -> float:
    """Evaluate the residual of p_n + D1 L_d(q_n, q_{n+1}) + h F/2 = 0.

    Parameters
    ----------
    p : (N + 2,) array
        Momentum at the beginning of the step.
    torques : (N - 1,) array
        Joint torques held over the step (N m).
    z : (N + 2,) array
        Increment (dc, d theta_1, da_2 ... da_N).
    h : float
        Length of the step (s).
    beam, fluid, fluid_work : BeamConstants, FluidConstants, FluidWork
        The body, with the added mass evaluated at q_n.
    w : StepArrays
        `set_pose` was called for q_n and `w.added_mass` is A(q_n), or with the adjoint A(q_{n+1});
        the rest is overwritten, among it residual, scale, size and change.

    Returns
    -------
    float
        max_i |r_i|/s_i with s_i = max(smallest scale, |p_i|, impulses); not finite where z is not.
    """
    _move(z, h, beam, fluid, w)
    if fluid.model != NO_FLUID:
        shape_force(w.motions[MOTION], fluid, fluid_work, w.elements[SHAPE])
    return _balance(p, torques, z, h, beam, fluid, w)


@kernel
def _balance(
    p: Array,
    torques: Array,
    z: Array,
    h: float,
    beam: BeamConstants,
    fluid: FluidConstants,
    w: StepArrays,
) -> float:
    """Sum up residual, its scale, and the change of the momentum; return the residual's norm."""
    e = w.elements
    u = w.unknowns
    m = w.motions
    elements = beam.elements
    dl = beam.element_length
    mass_rate = beam.element_mass / h
    inertia_rate = beam.element_inertia / h
    inverse_h = 1.0 / h
    with_fluid = fluid.model != NO_FLUID
    adjoint = w.adjoint[0] != 0.0
    normal_x = _base_row(w)
    normal_y = normal_x + 1
    total_x = 0.0
    total_y = 0.0
    size = 0.0
    for k in range(elements):
        e[MOMENTUM_X, k] = mass_rate * e[MOVE_X, k]
        e[MOMENTUM_Y, k] = mass_rate * e[MOVE_Y, k]
        if with_fluid:
            e[MOMENTUM_X, k] += m[FLUID_IMPULSE, k] * e[normal_x, k]
            e[MOMENTUM_Y, k] += m[FLUID_IMPULSE, k] * e[normal_y, k]
            if fluid.axial and (k == 0 or k == elements - 1):
                axial = m[FLUID_IMPULSE, 2 * elements + (1 if k > 0 else 0)]
                e[MOMENTUM_X, k] += axial * e[normal_y, k]
                e[MOMENTUM_Y, k] -= axial * e[normal_x, k]
        total_x += e[MOMENTUM_X, k]
        total_y += e[MOMENTUM_Y, k]
        size += abs(e[MOMENTUM_X, k]) + abs(e[MOMENTUM_Y, k])
    _sum_from_centres(e[MOMENTUM_X], e[MOMENTUM_Y], total_x, total_y, dl, e[BEHIND_X], e[BEHIND_Y])
    _elastic_terms(h, beam, w)
    _impulses(torques, z, h, beam, w)

    u[RESIDUAL, 0] = p[0] - total_x
    u[RESIDUAL, 1] = p[1] - total_y
    u[CHANGE, 0] = 0.0
    u[CHANGE, 1] = 0.0
    for i in range(2):
        u[SCALE, i] = max(beam.smallest_momentum, abs(p[i]))
        u[SIZE, i] = size + abs(p[i])
    for j in range(elements):
        turning = inertia_rate * e[SIN_TURN, j]
        munk = 0.0
        shape = 0.0
        if with_fluid:
            turning += m[FLUID_IMPULSE, elements + j] * e[COS_TURN, j]
            munk = -m[FLUID_IMPULSE, j] * (
                e[normal_y, j] * e[MOVE_X, j] - e[normal_x, j] * e[MOVE_Y, j]
            )
            shape = inverse_h * e[SHAPE, j]
            if fluid.axial and (j == 0 or j == elements - 1):
                axial = m[FLUID_IMPULSE, 2 * elements + (1 if j > 0 else 0)]
                munk += axial * (e[normal_x, j] * e[MOVE_X, j] + e[normal_y, j] * e[MOVE_Y, j])
        arm = e[D1X, j] * e[BEHIND_X, j] + e[D1Y, j] * e[BEHIND_Y, j]
        new_arm = e[NEW_D1X, j] * e[BEHIND_X, j] + e[NEW_D1Y, j] * e[BEHIND_Y, j]
        u[CHANGE, 2 + j] = munk + (new_arm - arm) - e[ELASTIC_SUM, j] + shape + e[IMPULSE, j]
        if adjoint:
            # They belong to D2 L_d.
            munk = 0.0
            shape = 0.0
        u[RESIDUAL, 2 + j] = (
            p[2 + j] - turning + munk - arm - e[ELASTIC, j] + shape + 0.5 * e[IMPULSE, j]
        )
        forces = e[ELASTIC_SIZE, j] + abs(shape) + abs(munk) + e[IMPULSE_SIZE, j]
        u[SCALE, 2 + j] = max(beam.smallest_spin, max(abs(p[2 + j]), forces))
        u[SIZE, 2 + j] = abs(p[2 + j]) + abs(turning) + abs(arm) + forces + dl * size
    if fluid.drag > 0.0:
        _add_drag(z, h, beam, fluid, w)
    return residual_norm(w)


@kernel
def residual_norm(w: StepArrays) -> float:
    """Return max_i |r_i|/s_i; a residual that is not a number counts as infinite."""
    u = w.unknowns
    largest = 0.0
    for i in range(u[RESIDUAL].size):
        ratio = abs(u[RESIDUAL, i]) / u[SCALE, i]
        if not ratio <= largest:
            largest = ratio if ratio >= 0.0 else np.inf
    return largest


@kernel
def round_off_floor(w: StepArrays) -> float:
    """Estimate the scaled residual that rounding alone leaves."""
    u = w.unknowns
    largest = 0.0
    for i in range(u[RESIDUAL].size):
        largest = max(largest, u[SIZE, i] / u[SCALE, i])
    return 2.220446049250313e-16 * largest


@kernel
def _centre_column(column: int, beam: BeamConstants, w: StepArrays) -> None:
    """Write how the centres move with an unknown, dc or the turn of an element."""
    e = w.elements
    elements = beam.elements
    dl = beam.element_length
    j = column - 2
    if j < 0:
        e[SUM_X] = 1.0 if column == 0 else 0.0
        e[SUM_Y] = 1.0 if column == 1 else 0.0
        return
    weight = chain_weight(j, elements)
    for k in range(elements):
        lever = dl * ((1.0 if j < k else (0.5 if j == k else 0.0)) - weight)
        e[SUM_X, k] = lever * e[NEW_D1X, j]
        e[SUM_Y, k] = lever * e[NEW_D1Y, j]


@inlined
def _fluid_columns(beam: BeamConstants, fluid: FluidConstants, w: StepArrays) -> None:
    """Differentiate V, and the impulse A V with it, by every unknown; a row for each."""
    e = w.elements
    elements = beam.elements
    normal_x = _base_row(w)
    normal_y = normal_x + 1
    for column in range(elements + 2):
        motion = w.column_motions[column]
        _centre_column(column, beam, w)
        for k in range(elements):
            motion[k] = e[normal_x, k] * e[SUM_X, k] + e[normal_y, k] * e[SUM_Y, k]
        if column >= 2:
            motion[elements + column - 2] = e[COS_TURN, column - 2]
        if fluid.axial:
            for end in range(2):
                k = 0 if end == 0 else elements - 1
                motion[2 * elements + end] = (
                    e[normal_y, k] * e[SUM_X, k] - e[normal_x, k] * e[SUM_Y, k]
                )
    # A is symmetric, and its rows beyond K are zero.
    multiply(
        w.column_motions, w.added_mass[: (motion_count(fluid) + 3) // 4 * 4], w.column_impulses
    )


@inlined
def _shape_columns(
    inverse_h: float, difference: float, fluid: FluidConstants, fluid_work: FluidWork, w: StepArrays
) -> None:
    """Take the derivative of the shape force off, by a difference quotient for every unknown.

    The shape force is a quadratic form, so a quotient is off by no more than its step, and a Newton
    matrix need not be better.
    """
    e = w.elements
    m = w.motions
    for column in range(w.transposed.shape[0]):
        for i in range(m[MOVED].size):
            m[MOVED, i] = m[MOTION, i] + difference * w.column_motions[column, i]
        shape_force(m[MOVED], fluid, fluid_work, e[COLUMN_SHAPE])
        for k in range(e[SHAPE].size):
            change = e[COLUMN_SHAPE, k] - e[SHAPE, k]
            w.transposed[column, 2 + k] -= inverse_h * change / difference


@kernel
def _inertia_columns(
    h: float,
    beam: BeamConstants,
    fluid: FluidConstants,
    fluid_work: FluidWork,
    shape_difference: float,
    w: StepArrays,
) -> None:
    """Differentiate the negative inertial part of the residual, a column per row of `transposed`.

    Columns belong to dc and to the turns delta_k. The derivative of the shape force, N + 2 further
    evaluations of it, is part of it where `shape_difference`, its difference quotient, is positive.
    """
    e = w.elements
    m = w.motions
    elements = beam.elements
    dl = beam.element_length
    mass_rate = beam.element_mass / h
    inverse_h = 1.0 / h
    with_fluid = fluid.model != NO_FLUID
    forward = w.adjoint[0] == 0.0
    normal_x = _base_row(w)
    normal_y = normal_x + 1
    if with_fluid:
        _fluid_columns(beam, fluid, w)
    for column in range(elements + 2):
        out = w.transposed[column]
        impulses = w.column_impulses[column]
        j = column - 2
        _centre_column(column, beam, w)
        total_x = 0.0
        total_y = 0.0
        for k in range(elements):
            turning = 0.0
            if k == j:
                turning = beam.element_inertia * inverse_h * e[COS_TURN, k]
            moving_x = e[SUM_X, k]
            moving_y = e[SUM_Y, k]
            push_x = mass_rate * moving_x
            push_y = mass_rate * moving_y
            if with_fluid:
                lateral = inverse_h * impulses[k]
                rotary = inverse_h * impulses[elements + k]
                push_x += lateral * e[normal_x, k]
                push_y += lateral * e[normal_y, k]
                turning += rotary * e[COS_TURN, k]
                if k == j:
                    turning -= m[FLUID_IMPULSE, elements + k] * e[SIN_TURN, k]
                if forward:
                    turning += lateral * (e[D3X, k] * e[MOVE_X, k] + e[D3Y, k] * e[MOVE_Y, k])
                    turning += m[FLUID_IMPULSE, k] * (e[D3X, k] * moving_x + e[D3Y, k] * moving_y)
                if fluid.axial and (k == 0 or k == elements - 1):
                    end = 2 * elements + (1 if k > 0 else 0)
                    axial = inverse_h * impulses[end]
                    push_x += axial * e[normal_y, k]
                    push_y -= axial * e[normal_x, k]
                    if forward:
                        turning -= axial * (e[D1X, k] * e[MOVE_X, k] + e[D1Y, k] * e[MOVE_Y, k])
                        turning -= m[FLUID_IMPULSE, end] * (
                            e[D1X, k] * moving_x + e[D1Y, k] * moving_y
                        )
            total_x += push_x
            total_y += push_y
            e[SUM_X, k] = push_x
            e[SUM_Y, k] = push_y
            out[2 + k] = turning
        out[0] = total_x
        out[1] = total_y
        behind_x = 0.0
        behind_y = 0.0
        for back in range(elements):
            k = elements - 1 - back
            weight = chain_weight(k, elements)
            lever_x = dl * (behind_x + 0.5 * e[SUM_X, k] - weight * total_x)
            lever_y = dl * (behind_y + 0.5 * e[SUM_Y, k] - weight * total_y)
            out[2 + k] += e[D1X, k] * lever_x + e[D1Y, k] * lever_y
            behind_x += e[SUM_X, k]
            behind_y += e[SUM_Y, k]
    if with_fluid and forward and shape_difference > 0.0:
        _shape_columns(inverse_h, shape_difference, fluid, fluid_work, w)


@kernel
def mass_matrix(
    beam: BeamConstants, fluid: FluidConstants, fluid_work: FluidWork, w: StepArrays
) -> None:
    """Write the reduced total mass at q_n, in the basis (c, theta_1 ... theta_N), to `w.mass`.

    It is the inertial Jacobian at a vanishing increment. `set_pose` was called for q_n, and
    `w.added_mass` is A(q_n).
    """
    w.adjoint[0] = 0.0
    e = w.elements
    m = w.motions
    e[SIN_TURN] = 0.0
    e[COS_TURN] = 1.0
    copy(e[D1X], e[NEW_D1X])
    copy(e[D1Y], e[NEW_D1Y])
    e[MOVE_X] = 0.0
    e[MOVE_Y] = 0.0
    m[FLUID_IMPULSE] = 0.0
    _inertia_columns(1.0, beam, fluid, fluid_work, 0.0, w)
    for i in range(w.mass.shape[0]):
        copy(w.transposed[i], w.mass[i])
        w.unknowns[MASS_DIAGONAL, i] = w.mass[i, i]


@kernel
def _add_drag_columns(beam: BeamConstants, w: StepArrays) -> None:
    """Add the drag, with the slopes of the last evaluation; half its impulse is in the residual."""
    e = w.elements
    elements = beam.elements
    for column in range(elements + 2):
        out = w.transposed[column]
        j = column - 2
        _centre_column(column, beam, w)
        total_x = 0.0
        total_y = 0.0
        for k in range(elements):
            normal_x = e[D1X, k] * e[COS_HALF, k] - e[D3X, k] * e[SIN_HALF, k]
            normal_y = e[D1Y, k] * e[COS_HALF, k] - e[D3Y, k] * e[SIN_HALF, k]
            across = normal_x * e[SUM_X, k] + normal_y * e[SUM_Y, k]
            push = 0.5 * e[DRAG_SLOPE, k] * across
            turning = 0.5 * e[DRAG_CROSS, k] * across
            if k == j:
                push += 0.5 * e[DRAG_CROSS, k]
                turning += 0.5 * e[DRAG_TURN_SLOPE, k]
            out[2 + k] += turning
            e[SUM_X, k] = push * normal_x
            e[SUM_Y, k] = push * normal_y
            total_x += e[SUM_X, k]
            total_y += e[SUM_Y, k]
        out[0] += total_x
        out[1] += total_y
        _sum_from_centres(
            e[SUM_X],
            e[SUM_Y],
            total_x,
            total_y,
            beam.element_length,
            e[DRAG_BEHIND_X],
            e[DRAG_BEHIND_Y],
        )
        for k in range(elements):
            out[2 + k] += e[D1X, k] * e[DRAG_BEHIND_X, k] + e[D1Y, k] * e[DRAG_BEHIND_Y, k]


@inlined
def _add_elastic_columns(h: float, beam: BeamConstants, w: StepArrays) -> None:
    """Add the elastic part to columns of the turns: the factors cos(delta/2) of the strain."""
    if beam.strain_of_angles:
        return
    e = w.elements
    for j in range(beam.joint_stiffness.size):
        sine = e[SIN_MEAN, j]
        cosine = e[COS_MEAN, j]
        front = e[COS_HALF, j]
        back = e[COS_HALF, j + 1]
        front_sine = e[SIN_HALF, j]
        back_sine = e[SIN_HALF, j + 1]
        stiffness = h * beam.joint_stiffness[j]
        strain = front * back * sine
        row_front = 0.5 * (-front * back * cosine + front_sine * back * sine)
        row_back = 0.5 * (front * back * cosine + back_sine * front * sine)
        # By the turn of the element in front.
        strain_change = -0.5 * front_sine * back * sine
        w.transposed[2 + j, 2 + j] += stiffness * (
            strain_change * row_front
            + strain * 0.25 * (front_sine * back * cosine + front * back * sine)
        )
        w.transposed[2 + j, 3 + j] += stiffness * (
            strain_change * row_back
            - strain * 0.25 * (front_sine * back * cosine + front_sine * back_sine * sine)
        )
        # By the turn of the element behind.
        strain_change = -0.5 * back_sine * front * sine
        w.transposed[3 + j, 2 + j] += stiffness * (
            strain_change * row_front
            + strain * 0.25 * (front * back_sine * cosine - front_sine * back_sine * sine)
        )
        w.transposed[3 + j, 3 + j] += stiffness * (
            strain_change * row_back
            + strain * 0.25 * (-front * back_sine * cosine + front * back * sine)
        )


@kernel
def step_jacobian(
    h: float,
    beam: BeamConstants,
    fluid: FluidConstants,
    fluid_work: FluidWork,
    shape_difference: float,
    w: StepArrays,
) -> None:
    """Write minus the derivative of the residual with respect to z to `w.jacobian`.

    Call `evaluate_step` for this z before. All terms are there, except that the shape force is held
    where `shape_difference` is 0: its derivative costs as much as the rest of the step. With the
    adjoint the inertia and the directors that it is measured with are held instead.
    """
    e = w.elements
    elements = beam.elements
    _inertia_columns(h, beam, fluid, fluid_work, shape_difference, w)
    if fluid.drag > 0.0:
        _add_drag_columns(beam, w)
    _add_elastic_columns(h, beam, w)
    averaged = not beam.strain_of_angles
    # From turns of elements to turns of joints: joint j turns everything behind it.
    n = elements + 2
    for i in range(n):
        w.jacobian[i, 0] = w.transposed[0, i]
        w.jacobian[i, 1] = w.transposed[1, i]
        behind = 0.0
        for column in range(n - 1, 1, -1):
            behind += w.transposed[column, i]
            w.jacobian[i, column] = behind
    for j in range(beam.joint_stiffness.size):
        sine = e[SIN_MEAN, j]
        cosine = e[COS_MEAN, j]
        front = e[COS_HALF, j] if averaged else 1.0
        back = e[COS_HALF, j + 1] if averaged else 1.0
        front_sine = e[SIN_HALF, j] if averaged else 0.0
        back_sine = e[SIN_HALF, j + 1] if averaged else 0.0
        stiffness = h * beam.joint_stiffness[j]
        strain = front * back * sine
        slope = front * back * cosine
        row_front = 0.5 * (-slope + front_sine * back * sine)
        row_back = 0.5 * (slope + back_sine * front * sine)
        front_change = 0.5 * (strain + front_sine * back * cosine)
        back_change = 0.5 * (-strain + back_sine * front * cosine)
        damping = 0.5 * beam.joint_damping[j]
        w.jacobian[2 + j, 3 + j] += (
            0.5 * stiffness * (slope * row_front + strain * front_change) - damping
        )
        w.jacobian[3 + j, 3 + j] += (
            0.5 * stiffness * (slope * row_back + strain * back_change) + damping
        )
    if beam.linear_strain:
        _straighten_columns(0.25 * h, SIN_MEAN, beam, w)


@kernel
def _straighten_columns(quarter: float, row: int, beam: BeamConstants, w: StepArrays) -> None:
    """Take the curvature of the sine, which a strain linear in the angle lacks, from the matrix.

    `quarter` is a quarter of the step (s), `row` that of the joints' strain.
    """
    e = w.elements
    for j in range(beam.joint_stiffness.size):
        change = quarter * beam.joint_stiffness[j] * e[row, j] * e[row, j]
        w.jacobian[2 + j, 3 + j] -= change
        w.jacobian[3 + j, 3 + j] += change


@kernel
def pose_jacobian(h: float, beam: BeamConstants, w: StepArrays) -> None:
    """Write minus the derivative of the residual at a vanishing increment to `w.jacobian`.

    It is put together from the mass that `prepare` has left, that of this pose or in the second
    half of a composed step of the one before, at a tenth of the cost of `step_jacobian`, and
    differs from that by terms of the order of the turns in the step.
    """
    u = w.unknowns
    e = w.elements
    elements = beam.elements
    n = elements + 2
    inverse_h = 1.0 / h
    for i in range(n):
        row = w.jacobian[i]
        for k in range(i):
            row[k] = inverse_h * w.mass[k, i]
        row[i] = inverse_h * u[MASS_DIAGONAL, i]
        for k in range(i + 1, n):
            row[k] = inverse_h * w.mass[i, k]
    for j in range(beam.joint_stiffness.size):
        sine = e[SIN_JOINT, j]
        if beam.strain_of_angles:
            break
        # The averaged directors: a turn of either element takes off strain.
        softening = 0.25 * h * beam.joint_stiffness[j] * sine * sine
        w.jacobian[2 + j, 2 + j] += softening
        w.jacobian[3 + j, 3 + j] += softening
    # From turns of elements to turns of joints: joint j turns everything behind it.
    for i in range(n):
        behind = 0.0
        for column in range(n - 1, 1, -1):
            behind += w.jacobian[i, column]
            w.jacobian[i, column] = behind
    for j in range(beam.joint_stiffness.size):
        sine = e[SIN_JOINT, j]
        cosine = e[COS_JOINT, j]
        spring = 0.25 * h * beam.joint_stiffness[j] * (cosine * cosine - sine * sine)
        spring += 0.5 * beam.joint_damping[j]
        w.jacobian[2 + j, 3 + j] -= spring
        w.jacobian[3 + j, 3 + j] += spring
    if beam.linear_strain:
        _straighten_columns(0.25 * h, SIN_JOINT, beam, w)
