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
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics._compile import kernel
from swim_env.physics.added_mass import (
    NO_FLUID,
    FluidConstants,
    FluidWork,
    shape_force,
)
from swim_env.physics.beam import BeamConstants, chain_weight
from swim_env.physics.dense import mat_vec, matrix_view

__all__ = [
    "StepArrays",
    "carve_step_arrays",
    "evaluate_step",
    "mass_matrix",
    "residual_norm",
    "round_off_floor",
    "set_pose",
    "step_array_size",
    "step_jacobian",
]

Array = NDArray[np.float64]

_ELEMENT_ROWS = 25
_UNKNOWN_ROWS = 9
_MOTION_ROWS = 5
_SAVED_ROWS = 5

#: Smallest scale of the residual (kg m/s for c, kg m^2/s for the angles).
SMALLEST_SCALE = 1e-3
_SHAPE_DIFFERENCE = 1e-5


class StepArrays(NamedTuple):
    """Work space of one step.

    Attributes
    ----------
    d1x, d1y, d3x, d3y : (N,) arrays
        Directors at q_n.
    new_d1x, new_d1y : (N,) arrays
        First director at q_{n+1}.
    sin_turn, cos_turn, sin_half, cos_half : (N,) arrays
        Of the turn of every element in the step, and of half of it.
    move_x, move_y : (N,) arrays
        Increment of the element centres (m).
    momentum_x, momentum_y : (N,) arrays
        P^k (kg m/s).
    behind_x, behind_y : (N,) arrays
        Sum over k of E_kj P^k (kg m^2/s).
    shape : (N,) array
        V^T dA/dtheta_k V/2.
    elastic, elastic_sum, elastic_size : (N,) arrays
        h dW/dtheta_k at q_n, its sum with the derivative at q_{n+1}, and the magnitude of the
        terms.
    impulse, impulse_size : (N,) arrays
        Impulse h F of torques and damping, and the magnitude of its terms.
    sum_x, sum_y, column_shape : (N,) arrays
        Scratch.
    residual, scale, size, change : (N + 2,) arrays
        Residual of p_n + D1 L_d + h F/2; the scale it is measured with; the magnitude of its
        terms; the change D1 L_d + D2 L_d + h F of the momentum.
    increment, trial, direction, velocity, total : (N + 2,) arrays
        Newton's vectors, the velocity M^-1 p at q_n, and the increment of the outer step.
    motion, fluid_impulse, column_motion, column_impulse, moved : (K,) arrays
        V, A V/h, the same of one column of the Jacobian, and a scratch row.
    added_mass : (K, K) array
        A at q_n.
    mass : (N + 2, N + 2) array
        Cholesky factor of the reduced total mass at q_n.
    jacobian, transposed : (N + 2, N + 2) arrays
        Newton's matrix (its factors) and the rows of its transpose.
    saved : (5, N + 2) array
        State at the beginning of the outer step.
    """

    d1x: Array
    d1y: Array
    d3x: Array
    d3y: Array
    new_d1x: Array
    new_d1y: Array
    sin_turn: Array
    cos_turn: Array
    sin_half: Array
    cos_half: Array
    move_x: Array
    move_y: Array
    momentum_x: Array
    momentum_y: Array
    behind_x: Array
    behind_y: Array
    shape: Array
    elastic: Array
    elastic_sum: Array
    elastic_size: Array
    impulse: Array
    impulse_size: Array
    sum_x: Array
    sum_y: Array
    column_shape: Array
    residual: Array
    scale: Array
    size: Array
    change: Array
    increment: Array
    trial: Array
    direction: Array
    velocity: Array
    total: Array
    motion: Array
    fluid_impulse: Array
    column_motion: Array
    column_impulse: Array
    moved: Array
    added_mass: Array
    mass: Array
    jacobian: Array
    transposed: Array
    saved: Array


@kernel
def step_array_size(elements: int, motions: int) -> int:
    """Return how many float64 numbers `carve_step_arrays` takes."""
    unknowns = elements + 2
    return (
        _ELEMENT_ROWS * elements
        + (_UNKNOWN_ROWS + _SAVED_ROWS) * unknowns
        + _MOTION_ROWS * motions
        + motions * motions
        + 3 * unknowns * unknowns
    )


@kernel
def carve_step_arrays(floats: Array, elements: int, motions: int) -> StepArrays:
    """Lay the arrays of `StepArrays` into a flat buffer of `step_array_size` numbers."""
    n = elements + 2
    e = matrix_view(floats, 0, _ELEMENT_ROWS, elements)
    start = _ELEMENT_ROWS * elements
    u = matrix_view(floats, start, _UNKNOWN_ROWS, n)
    start += _UNKNOWN_ROWS * n
    saved = matrix_view(floats, start, _SAVED_ROWS, n)
    start += _SAVED_ROWS * n
    m = matrix_view(floats, start, _MOTION_ROWS, motions)
    start += _MOTION_ROWS * motions
    added = matrix_view(floats, start, motions, motions)
    start += motions * motions
    return StepArrays(
        e[0],
        e[1],
        e[2],
        e[3],
        e[4],
        e[5],
        e[6],
        e[7],
        e[8],
        e[9],
        e[10],
        e[11],
        e[12],
        e[13],
        e[14],
        e[15],
        e[16],
        e[17],
        e[18],
        e[19],
        e[20],
        e[21],
        e[22],
        e[23],
        e[24],
        u[0],
        u[1],
        u[2],
        u[3],
        u[4],
        u[5],
        u[6],
        u[7],
        u[8],
        m[0],
        m[1],
        m[2],
        m[3],
        m[4],
        added,
        matrix_view(floats, start, n, n),
        matrix_view(floats, start + n * n, n, n),
        matrix_view(floats, start + 2 * n * n, n, n),
        saved,
    )


@kernel
def set_pose(q: Array, w: StepArrays) -> None:
    """Compute the directors at q_n from the minimal coordinates q (N + 2,)."""
    angle = 0.0
    for k in range(w.d1x.size):
        angle += q[2 + k]
        w.d3x[k] = np.cos(angle)
        w.d3y[k] = np.sin(angle)
        w.d1x[k] = -w.d3y[k]
        w.d1y[k] = w.d3x[k]


@kernel
def _set_increment(z: Array, w: StepArrays) -> None:
    """Compute turns and first directors at q_{n+1} from the increment z (N + 2,)."""
    turn = 0.0
    for k in range(w.d1x.size):
        turn += z[2 + k]
        s = np.sin(0.5 * turn)
        c = np.cos(0.5 * turn)
        w.sin_half[k] = s
        w.cos_half[k] = c
        w.sin_turn[k] = 2.0 * s * c
        w.cos_turn[k] = 1.0 - 2.0 * s * s
        w.new_d1x[k] = w.d1x[k] * w.cos_turn[k] - w.d3x[k] * w.sin_turn[k]
        w.new_d1y[k] = w.d1y[k] * w.cos_turn[k] - w.d3y[k] * w.sin_turn[k]


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
def _elastic_terms(q: Array, z: Array, h: float, beam: BeamConstants, w: StepArrays) -> None:
    """Differentiate h W(K(q_{n+1/2})) with the strain of the averaged directors (16)."""
    w.elastic[:] = 0.0
    w.elastic_sum[:] = 0.0
    w.elastic_size[:] = 0.0
    for j in range(beam.joint_stiffness.size):
        mean = q[3 + j] + 0.5 * z[3 + j]
        sine = np.sin(mean)
        cosine = np.cos(mean)
        front = w.cos_half[j]
        back = w.cos_half[j + 1]
        moment = h * beam.joint_stiffness[j] * front * back * sine
        straight = 0.5 * front * back * cosine
        w.elastic[j] += moment * (-straight + 0.5 * w.sin_half[j] * back * sine)
        w.elastic[j + 1] += moment * (straight + 0.5 * w.sin_half[j + 1] * front * sine)
        w.elastic_sum[j] -= 2.0 * moment * straight
        w.elastic_sum[j + 1] += 2.0 * moment * straight
        w.elastic_size[j] += abs(moment)
        w.elastic_size[j + 1] += abs(moment)


@kernel
def _impulses(
    torques: Array, z: Array, h: float, beam: BeamConstants, w: StepArrays
) -> None:
    """Collect the impulses of held joint torques and of Kelvin-Voigt damping over the step."""
    w.impulse[:] = 0.0
    w.impulse_size[:] = 0.0
    for j in range(torques.size):
        impulse = h * torques[j] - beam.joint_damping[j] * z[3 + j]
        w.impulse[j] -= impulse
        w.impulse[j + 1] += impulse
        size = h * abs(torques[j]) + beam.joint_damping[j] * abs(z[3 + j])
        w.impulse_size[j] += size
        w.impulse_size[j + 1] += size


@kernel
def evaluate_step(
    q: Array,
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
    q, p : (N + 2,) arrays
        Minimal coordinates and momentum at the beginning of the step.
    torques : (N - 1,) array
        Joint torques held over the step (N m).
    z : (N + 2,) array
        Increment (dc, d theta_1, da_2 ... da_N).
    h : float
        Length of the step (s).
    beam, fluid, fluid_work : BeamConstants, FluidConstants, FluidWork
        The body, with the added mass evaluated at q_n.
    w : StepArrays
        `set_pose` was called for q_n and `w.added_mass` is A(q_n); the rest is overwritten, among
        it residual, scale, size and change.

    Returns
    -------
    float
        max_i |r_i|/s_i with s_i = max(1e-3, |p_i|, impulses); not finite where z is not.
    """
    elements = beam.elements
    dl = beam.element_length
    mass_rate = beam.element_mass / h
    inertia_rate = beam.element_inertia / h
    inverse_h = 1.0 / h
    _set_increment(z, w)
    for k in range(elements):
        # d3(n+1) - d3(n) without cancellation.
        versine = -2.0 * w.sin_half[k] * w.sin_half[k]
        w.sum_x[k] = versine * w.d3x[k] + w.sin_turn[k] * w.d1x[k]
        w.sum_y[k] = versine * w.d3y[k] + w.sin_turn[k] * w.d1y[k]
    _sum_to_centres(w.sum_x, w.sum_y, z[0], z[1], dl, w.move_x, w.move_y)

    with_fluid = fluid.model != NO_FLUID
    if with_fluid:
        for k in range(elements):
            w.motion[k] = w.d1x[k] * w.move_x[k] + w.d1y[k] * w.move_y[k]
            w.motion[elements + k] = w.sin_turn[k]
        if fluid.axial:
            last = elements - 1
            w.motion[2 * elements] = w.d3x[0] * w.move_x[0] + w.d3y[0] * w.move_y[0]
            w.motion[2 * elements + 1] = (
                w.d3x[last] * w.move_x[last] + w.d3y[last] * w.move_y[last]
            )
        mat_vec(w.added_mass, w.motion, w.fluid_impulse)
        for i in range(w.fluid_impulse.size):
            w.fluid_impulse[i] *= inverse_h
        shape_force(w.motion, fluid, fluid_work, w.shape)

    total_x = 0.0
    total_y = 0.0
    size = 0.0
    for k in range(elements):
        w.momentum_x[k] = mass_rate * w.move_x[k]
        w.momentum_y[k] = mass_rate * w.move_y[k]
        if with_fluid:
            w.momentum_x[k] += w.fluid_impulse[k] * w.d1x[k]
            w.momentum_y[k] += w.fluid_impulse[k] * w.d1y[k]
            if fluid.axial and (k == 0 or k == elements - 1):
                axial = w.fluid_impulse[2 * elements + (1 if k > 0 else 0)]
                w.momentum_x[k] += axial * w.d3x[k]
                w.momentum_y[k] += axial * w.d3y[k]
        total_x += w.momentum_x[k]
        total_y += w.momentum_y[k]
        size += abs(w.momentum_x[k]) + abs(w.momentum_y[k])
    _sum_from_centres(
        w.momentum_x, w.momentum_y, total_x, total_y, dl, w.behind_x, w.behind_y
    )
    _elastic_terms(q, z, h, beam, w)
    _impulses(torques, z, h, beam, w)

    w.residual[0] = p[0] - total_x
    w.residual[1] = p[1] - total_y
    w.change[0] = 0.0
    w.change[1] = 0.0
    for i in range(2):
        w.scale[i] = max(SMALLEST_SCALE, abs(p[i]))
        w.size[i] = size + abs(p[i])
    for j in range(elements):
        turning = inertia_rate * w.sin_turn[j]
        munk = 0.0
        shape = 0.0
        if with_fluid:
            turning += w.fluid_impulse[elements + j] * w.cos_turn[j]
            munk = -w.fluid_impulse[j] * (w.d3x[j] * w.move_x[j] + w.d3y[j] * w.move_y[j])
            shape = inverse_h * w.shape[j]
            if fluid.axial and (j == 0 or j == elements - 1):
                axial = w.fluid_impulse[2 * elements + (1 if j > 0 else 0)]
                munk += axial * (w.d1x[j] * w.move_x[j] + w.d1y[j] * w.move_y[j])
        arm = w.d1x[j] * w.behind_x[j] + w.d1y[j] * w.behind_y[j]
        new_arm = w.new_d1x[j] * w.behind_x[j] + w.new_d1y[j] * w.behind_y[j]
        w.residual[2 + j] = (
            p[2 + j] - turning + munk - arm - w.elastic[j] + shape + 0.5 * w.impulse[j]
        )
        w.change[2 + j] = munk + (new_arm - arm) - w.elastic_sum[j] + shape + w.impulse[j]
        forces = w.elastic_size[j] + abs(shape) + abs(munk) + w.impulse_size[j]
        w.scale[2 + j] = max(SMALLEST_SCALE, max(abs(p[2 + j]), forces))
        w.size[2 + j] = abs(p[2 + j]) + abs(turning) + abs(arm) + forces + dl * size
    return residual_norm(w)


@kernel
def residual_norm(w: StepArrays) -> float:
    """Return max_i |r_i|/s_i; a residual that is not a number counts as infinite."""
    largest = 0.0
    for i in range(w.residual.size):
        ratio = abs(w.residual[i]) / w.scale[i]
        if not ratio <= largest:
            largest = ratio if ratio >= 0.0 else np.inf
    return largest


@kernel
def round_off_floor(w: StepArrays) -> float:
    """Estimate the scaled residual that rounding alone leaves."""
    largest = 0.0
    for i in range(w.residual.size):
        largest = max(largest, w.size[i] / w.scale[i])
    return 2.220446049250313e-16 * largest


@kernel
def _inertia_columns(
    h: float,
    beam: BeamConstants,
    fluid: FluidConstants,
    fluid_work: FluidWork,
    with_shape: bool,
    w: StepArrays,
) -> None:
    """Differentiate the negative inertial part of the residual, a column per row of `transposed`.

    Columns belong to dc and to the turns delta_k. The derivative of the shape force, N + 2 further
    evaluations of it, is part of it only on request.
    """
    elements = beam.elements
    dl = beam.element_length
    mass_rate = beam.element_mass / h
    inverse_h = 1.0 / h
    with_fluid = fluid.model != NO_FLUID
    for column in range(elements + 2):
        out = w.transposed[column]
        j = column - 2
        for k in range(elements):
            if column == 0:
                w.sum_x[k] = 1.0
                w.sum_y[k] = 0.0
            elif column == 1:
                w.sum_x[k] = 0.0
                w.sum_y[k] = 1.0
            else:
                lever = dl * (
                    (1.0 if j < k else (0.5 if j == k else 0.0)) - chain_weight(j, elements)
                )
                w.sum_x[k] = lever * w.new_d1x[j]
                w.sum_y[k] = lever * w.new_d1y[j]
        if with_fluid:
            for k in range(elements):
                w.column_motion[k] = w.d1x[k] * w.sum_x[k] + w.d1y[k] * w.sum_y[k]
                w.column_motion[elements + k] = w.cos_turn[k] if k == j else 0.0
            if fluid.axial:
                last = elements - 1
                w.column_motion[2 * elements] = (
                    w.d3x[0] * w.sum_x[0] + w.d3y[0] * w.sum_y[0]
                )
                w.column_motion[2 * elements + 1] = (
                    w.d3x[last] * w.sum_x[last] + w.d3y[last] * w.sum_y[last]
                )
            mat_vec(w.added_mass, w.column_motion, w.column_impulse)
            if with_shape:
                # The shape force is a quadratic form, so this difference quotient is off by no
                # more than its step, and a Newton matrix need not be better.
                for i in range(w.moved.size):
                    w.moved[i] = w.motion[i] + _SHAPE_DIFFERENCE * w.column_motion[i]
                shape_force(w.moved, fluid, fluid_work, w.column_shape)
        total_x = 0.0
        total_y = 0.0
        for k in range(elements):
            turning = 0.0
            if k == j:
                turning = beam.element_inertia * inverse_h * w.cos_turn[k]
            moving_x = w.sum_x[k]
            moving_y = w.sum_y[k]
            push_x = mass_rate * moving_x
            push_y = mass_rate * moving_y
            if with_fluid:
                lateral = inverse_h * w.column_impulse[k]
                rotary = inverse_h * w.column_impulse[elements + k]
                push_x += lateral * w.d1x[k]
                push_y += lateral * w.d1y[k]
                turning += rotary * w.cos_turn[k]
                if k == j:
                    turning -= w.fluid_impulse[elements + k] * w.sin_turn[k]
                turning += lateral * (w.d3x[k] * w.move_x[k] + w.d3y[k] * w.move_y[k])
                turning += w.fluid_impulse[k] * (w.d3x[k] * moving_x + w.d3y[k] * moving_y)
                if fluid.axial and (k == 0 or k == elements - 1):
                    end = 2 * elements + (1 if k > 0 else 0)
                    axial = inverse_h * w.column_impulse[end]
                    push_x += axial * w.d3x[k]
                    push_y += axial * w.d3y[k]
                    turning -= axial * (w.d1x[k] * w.move_x[k] + w.d1y[k] * w.move_y[k])
                    turning -= w.fluid_impulse[end] * (
                        w.d1x[k] * moving_x + w.d1y[k] * moving_y
                    )
            total_x += push_x
            total_y += push_y
            w.sum_x[k] = push_x
            w.sum_y[k] = push_y
            if with_shape and with_fluid:
                turning -= inverse_h * (w.column_shape[k] - w.shape[k]) / _SHAPE_DIFFERENCE
            out[2 + k] = turning
        out[0] = total_x
        out[1] = total_y
        behind_x = 0.0
        behind_y = 0.0
        for back in range(elements):
            k = elements - 1 - back
            weight = chain_weight(k, elements)
            lever_x = dl * (behind_x + 0.5 * w.sum_x[k] - weight * total_x)
            lever_y = dl * (behind_y + 0.5 * w.sum_y[k] - weight * total_y)
            out[2 + k] += w.d1x[k] * lever_x + w.d1y[k] * lever_y
            behind_x += w.sum_x[k]
            behind_y += w.sum_y[k]


@kernel
def mass_matrix(
    beam: BeamConstants, fluid: FluidConstants, fluid_work: FluidWork, w: StepArrays
) -> None:
    """Write the reduced total mass at q_n, in the basis (c, theta_1 ... theta_N), to `w.mass`.

    It is the inertial Jacobian at a vanishing increment. `set_pose` was called for q_n, and
    `w.added_mass` is A(q_n).
    """
    w.sin_turn[:] = 0.0
    w.cos_turn[:] = 1.0
    w.new_d1x[:] = w.d1x
    w.new_d1y[:] = w.d1y
    w.move_x[:] = 0.0
    w.move_y[:] = 0.0
    w.fluid_impulse[:] = 0.0
    _inertia_columns(1.0, beam, fluid, fluid_work, False, w)
    w.mass[:] = w.transposed


@kernel
def _add_elastic_columns(
    q: Array, z: Array, h: float, beam: BeamConstants, w: StepArrays
) -> None:
    """Add the elastic part to columns of the turns: the factors cos(delta/2) of the strain."""
    for j in range(beam.joint_stiffness.size):
        mean = q[3 + j] + 0.5 * z[3 + j]
        sine = np.sin(mean)
        cosine = np.cos(mean)
        front = w.cos_half[j]
        back = w.cos_half[j + 1]
        front_sine = w.sin_half[j]
        back_sine = w.sin_half[j + 1]
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
    q: Array,
    z: Array,
    h: float,
    beam: BeamConstants,
    fluid: FluidConstants,
    fluid_work: FluidWork,
    with_shape: bool,
    w: StepArrays,
) -> None:
    """Write minus the derivative of the residual with respect to z to `w.jacobian`.

    Call `evaluate_step` for the same z before. All terms are there, except that the shape force is
    held unless `with_shape`: its derivative costs as much as the rest of the step.
    """
    elements = beam.elements
    _inertia_columns(h, beam, fluid, fluid_work, with_shape, w)
    _add_elastic_columns(q, z, h, beam, w)
    # From turns of elements to turns of joints: joint j turns everything behind it.
    for back in range(elements - 1):
        column = elements - back
        for i in range(elements + 2):
            w.transposed[column, i] += w.transposed[column + 1, i]
    for j in range(beam.joint_stiffness.size):
        mean = q[3 + j] + 0.5 * z[3 + j]
        sine = np.sin(mean)
        cosine = np.cos(mean)
        front = w.cos_half[j]
        back = w.cos_half[j + 1]
        stiffness = h * beam.joint_stiffness[j]
        strain = front * back * sine
        slope = front * back * cosine
        row_front = 0.5 * (-slope + w.sin_half[j] * back * sine)
        row_back = 0.5 * (slope + w.sin_half[j + 1] * front * sine)
        front_change = 0.5 * (strain + w.sin_half[j] * back * cosine)
        back_change = 0.5 * (-strain + w.sin_half[j + 1] * front * cosine)
        damping = 0.5 * beam.joint_damping[j]
        w.transposed[3 + j, 2 + j] += (
            0.5 * stiffness * (slope * row_front + strain * front_change) - damping
        )
        w.transposed[3 + j, 3 + j] += (
            0.5 * stiffness * (slope * row_back + strain * back_change) + damping
        )
    for i in range(elements + 2):
        for j in range(elements + 2):
            w.jacobian[i, j] = w.transposed[j, i]
