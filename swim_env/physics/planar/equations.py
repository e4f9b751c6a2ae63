r"""The step equations: derivatives of the discrete Lagrangian in minimal coordinates.

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

Here the inertia is that of the start of the step, M_f(q_n). The adjoint of this map has that of its
end, L_d*(q_n, q_{n+1}) = -L_d(q_{n+1}, q_n) with -h for h: V is measured with the directors at
q_{n+1}; D_1 L_d* has no shape force and no term in f_v d3 . dr, and D_2 L_d* has them. Composing
both halves of a step is of second order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.layout import (
    FluidConstants,
    FluidWork,
    motion_count,
    padded_motions,
    unit_motion,
)
from swim_env.physics.fluid.models import shape_force
from swim_env.physics.fluid.outline import AXIAL
from swim_env.physics.planar.chain import BeamConstants, sum_from_centres, sum_to_centres
from swim_env.physics.planar.drag import add_drag
from swim_env.physics.planar.elastic import joint_terms, linearise_joints, linearise_mean_joints
from swim_env.physics.planar.layout import (
    BACK,
    BENDING,
    BOTH,
    EFFORT,
    FRONT,
    TORQUE,
    Balance,
    Body,
    Drag,
    Increment,
    Pose,
)
from swim_env.physics.runtime.compile import inlined, kernel, row_kernel
from swim_env.physics.runtime.dense import mat_vec_transposed
from swim_env.physics.runtime.elementary import SMALL_ANGLE, cos_small, sin_small
from swim_env.physics.runtime.linking import linked_kernel
from swim_env.physics.runtime.references import by_value

Array = NDArray[np.float64]


@kernel
def set_pose(q: Array, beam: BeamConstants, pose: Pose) -> None:
    """Compute directors and joints at q_n from the minimal coordinates q (N + 2,)."""
    angle = 0.0
    for k in range(beam.elements):
        angle += q[2 + k]
        pose.d3[0, k] = np.cos(angle)
        pose.d3[1, k] = np.sin(angle)
        pose.d1[0, k] = -pose.d3[1, k]
        pose.d1[1, k] = pose.d3[0, k]
    for j in range(q.size - 3):
        pose.joint_sine[j] = np.sin(q[3 + j])
        pose.joint_cosine[j] = np.cos(q[3 + j])
    if beam.linear_strain:
        linearise_joints(q, pose)


@row_kernel
def _turn_little(pose: Pose, inc: Increment) -> None:
    """Replace the halves of small turns by their sines and cosines, and find those of mean joints.

    The series are cheaper than the library's functions, and loops over them run on vector
    registers.
    """
    for k in range(inc.half_sine.size):
        half = inc.half_sine[k]
        inc.half_cosine[k] = cos_small(half)
        inc.half_sine[k] = sin_small(half)
    for j in range(inc.half_sine.size - 1):
        half = inc.mean_sine[j]
        s = sin_small(half)
        c = cos_small(half)
        inc.mean_sine[j] = pose.joint_sine[j] * c + pose.joint_cosine[j] * s
        inc.mean_cosine[j] = pose.joint_cosine[j] * c - pose.joint_sine[j] * s


@kernel
def _turn_far(pose: Pose, inc: Increment) -> None:
    """Do the same for turns of any size."""
    for k in range(inc.half_sine.size):
        half = inc.half_sine[k]
        inc.half_cosine[k] = np.cos(half)
        inc.half_sine[k] = np.sin(half)
    for j in range(inc.half_sine.size - 1):
        half = inc.mean_sine[j]
        s = np.sin(half)
        c = np.cos(half)
        inc.mean_sine[j] = pose.joint_sine[j] * c + pose.joint_cosine[j] * s
        inc.mean_cosine[j] = pose.joint_cosine[j] * c - pose.joint_sine[j] * s


@row_kernel
def _turn_directors(
    pose: Pose,
    half_sine: Array,
    half_cosine: Array,
    turn_sine: Array,
    turn_cosine: Array,
    new_x: Array,
    new_y: Array,
    change_x: Array,
    change_y: Array,
) -> None:
    """Write the elements' turns, their new d1, and the change of d3 without cancellation."""
    for k in range(half_sine.size):
        sine = 2.0 * half_sine[k] * half_cosine[k]
        versine = -2.0 * half_sine[k] * half_sine[k]
        cosine = 1.0 + versine
        turn_sine[k] = sine
        turn_cosine[k] = cosine
        new_x[k] = pose.d1[0, k] * cosine - pose.d3[0, k] * sine
        new_y[k] = pose.d1[1, k] * cosine - pose.d3[1, k] * sine
        change_x[k] = versine * pose.d3[0, k] + sine * pose.d1[0, k]
        change_y[k] = versine * pose.d3[1, k] + sine * pose.d1[1, k]


@inlined
def _move(z: Array, beam: BeamConstants, pose: Pose, inc: Increment, change: Array) -> None:
    """Compute turns, directors, mean joints and centres from the increment z (N + 2,).

    `change` (2, N) is scratch.
    """
    half = 0.0
    small = True
    for k in range(beam.elements):
        half += 0.5 * z[2 + k]
        inc.half_sine[k] = half
        small = small and abs(half) <= SMALL_ANGLE
        if k > 0:
            inc.mean_sine[k - 1] = 0.5 * z[2 + k]
            small = small and abs(z[2 + k]) <= 2.0 * SMALL_ANGLE
    if small:
        _turn_little(by_value(pose), by_value(inc))
    else:
        _turn_far(pose, inc)
    if beam.linear_strain:
        linearise_mean_joints(z, pose, inc)
    _turn_directors(
        by_value(pose),
        inc.half_sine,
        inc.half_cosine,
        inc.turn_sine,
        inc.turn_cosine,
        inc.new_d1[0],
        inc.new_d1[1],
        change[0],
        change[1],
    )
    sum_to_centres(change, z[0], z[1], beam.element_length, inc.shift)


@row_kernel
def _unit_motions(
    normal: Array, shift: Array, turn_sine: Array, lateral: Array, rotary: Array
) -> None:
    for k in range(turn_sine.size):
        lateral[k] = normal[0, k] * shift[0, k] + normal[1, k] * shift[1, k]
        rotary[k] = turn_sine[k]


@kernel
def _move_fluid(
    inverse_h: float, normal: Array, added: Array, fluid: FluidConstants, inc: Increment
) -> None:
    """Compute V, measured with the normals (2, N), and the fluid's impulse A V/h."""
    elements = fluid.geometry.elements
    motion, shift = inc.motion, inc.shift
    lateral, rotary = motion[:elements], motion[elements : 2 * elements]
    _unit_motions(normal, shift, inc.turn_sine, lateral, rotary)
    if fluid.axial:
        for k in (0, elements - 1):
            # d3 = (d1_y, -d1_x).
            along = normal[1, k] * shift[0, k] - normal[0, k] * shift[1, k]
            motion[unit_motion(k, AXIAL, fluid)] = along
    motion[motion_count(fluid)] = 0.0
    # A is symmetric, and its rows beyond K are zero.
    rows = padded_motions(fluid)
    impulse = inc.impulse[: added.shape[1]]
    mat_vec_transposed(added[:rows], motion[:rows], impulse)
    for i in range(impulse.size):
        impulse[i] *= inverse_h


@linked_kernel
def evaluate_step(
    p: Array,
    torques: Array,
    z: Array,
    h: float,
    adjoint: bool,
    held: bool,
    beam: BeamConstants,
    fluid: FluidConstants,
    body: Body,
    fluid_work: FluidWork,
) -> float:
    """Evaluate the residual of p_n + D1 L_d(q_n, q_{n+1}) + h F/2 = 0, or of the adjoint map.

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
    adjoint : bool
        Whether it is D1 L_d*. Then `body.mass` holds the added mass of q_{n+1}, or one that is
        tried for it, and the shape force changes the momentum but not the residual.
    held : bool
        Whether the shape force is taken as `body.balance` has it. An evaluation spends most of its
        time on that, and it changes little with z.
    beam, fluid : BeamConstants, FluidConstants
        The scene.
    body : Body
        With the pose q_n and the added mass. Increment, balance and drag are overwritten.
    fluid_work : FluidWork
        As `added_mass` left it for that.

    Returns
    -------
    float
        max_i |r_i|/s_i with s_i = max(smallest scale, |p_i|, impulses); not finite where z is not.
    """
    pose, inc, balance, drag, mass = body.pose, body.inc, body.balance, body.drag, body.mass
    normal, early = pose.d1, balance.pose_forces
    if adjoint:
        normal, early = inc.new_d1, balance.no_forces
    _move(z, beam, pose, inc, balance.sums)
    if fluid.present:
        _move_fluid(1.0 / h, normal, mass.added, fluid, inc)
        if not held:
            shape_force(inc.motion, fluid, fluid_work, balance.shape)
        _pose_forces(1.0 / h, normal, fluid, inc, balance)
    return _balance(p, torques, z, h, normal, early, beam, fluid, pose, inc, balance, drag)


@row_kernel
def _pose_force_rows(
    inverse_h: float,
    normal: Array,
    shift: Array,
    lateral: Array,
    shape: Array,
    munk: Array,
    shaping: Array,
) -> None:
    for j in range(shape.size):
        along = normal[1, j] * shift[0, j] - normal[0, j] * shift[1, j]
        munk[j] = -lateral[j] * along
        shaping[j] = inverse_h * shape[j]


@kernel
def _pose_forces(
    inverse_h: float, normal: Array, fluid: FluidConstants, inc: Increment, balance: Balance
) -> None:
    """Collect what the inertia does to the pose that it is taken at, with these normals (2, N)."""
    forces, shift = balance.pose_forces, inc.shift
    lateral = inc.impulse[: fluid.geometry.elements]
    _pose_force_rows(inverse_h, normal, shift, lateral, balance.shape, forces[0], forces[1])
    if fluid.axial:
        for j in (0, fluid.geometry.elements - 1):
            across = normal[0, j] * shift[0, j] + normal[1, j] * shift[1, j]
            forces[0, j] += inc.impulse[unit_motion(j, AXIAL, fluid)] * across


@row_kernel
def _momenta(
    mass_rate: float, normal: Array, shift: Array, lateral: Array, x: Array, y: Array
) -> None:
    """Write the momenta of the elements with the fluid's impulse along their normals."""
    for k in range(x.size):
        x[k] = mass_rate * shift[0, k] + lateral[k] * normal[0, k]
        y[k] = mass_rate * shift[1, k] + lateral[k] * normal[1, k]


@row_kernel
def _turning_balance(
    inertia_rate: float,
    smallest: float,
    shift_size: float,
    p: Array,
    rotary: Array,
    early: Array,
    pose: Pose,
    inc: Increment,
    balance: Balance,
) -> None:
    """Write the parts of residual, scale and change that belong to the elements' turns."""
    b = balance
    for j in range(inc.turn_sine.size):
        turning = inertia_rate * inc.turn_sine[j] + rotary[j] * inc.turn_cosine[j]
        arm = pose.d1[0, j] * b.lever[0, j] + pose.d1[1, j] * b.lever[1, j]
        new_arm = inc.new_d1[0, j] * b.lever[0, j] + inc.new_d1[1, j] * b.lever[1, j]
        elastic = b.joints[FRONT, j + 1] + b.joints[BACK, j]
        elastic_sum = b.joints[BOTH, j] - b.joints[BOTH, j + 1]
        torque = b.joints[TORQUE, j] - b.joints[TORQUE, j + 1]
        forces = (
            b.joints[BENDING, j]
            + b.joints[BENDING, j + 1]
            + abs(early[0, j])
            + abs(early[1, j])
            + (b.joints[EFFORT, j] + b.joints[EFFORT, j + 1])
        )
        munk, shape = b.pose_forces[0, j], b.pose_forces[1, j]
        b.change[2 + j] = munk + (new_arm - arm) - elastic_sum + shape + torque
        munk, shape = early[0, j], early[1, j]
        b.residual[2 + j] = p[2 + j] - turning + munk - arm - elastic + shape + 0.5 * torque
        impulses = abs(turning) + abs(arm) + forces
        b.scale[2 + j] = max(smallest, max(abs(p[2 + j]), impulses))
        b.size[2 + j] = abs(p[2 + j]) + impulses + shift_size


@inlined
def _balance(
    p: Array,
    torques: Array,
    z: Array,
    h: float,
    normal: Array,
    early: Array,
    beam: BeamConstants,
    fluid: FluidConstants,
    pose: Pose,
    inc: Increment,
    balance: Balance,
    drag: Drag,
) -> float:
    """Sum up residual, its scale, and the change of the momentum; return the residual's norm.

    The inertia is measured with the normals (2, N); `early` (2, N) are the forces of its pose that
    act at the beginning of the step.
    """
    b = balance
    elements = beam.elements
    dl = beam.element_length
    # Without a fluid there are no impulses.
    lateral, rotary = inc.impulse[:elements], inc.impulse[elements : 2 * elements]
    x, y = b.momentum[0], b.momentum[1]
    _momenta(beam.element_mass / h, normal, inc.shift, lateral, x, y)
    if fluid.axial:
        for k in (0, elements - 1):
            axial = inc.impulse[unit_motion(k, AXIAL, fluid)]
            x[k] += axial * normal[1, k]
            y[k] -= axial * normal[0, k]
    total_x = 0.0
    total_y = 0.0
    size = 0.0
    for k in range(elements):
        total_x += x[k]
        total_y += y[k]
        size += abs(x[k]) + abs(y[k])
    sum_from_centres(b.momentum, total_x, total_y, dl, b.lever)
    rows = b.joints[:, 1:elements]
    joint_terms(
        *(h, torques, z, by_value(beam), by_value(inc)),
        *(rows[FRONT], rows[BACK], rows[BOTH], rows[BENDING], rows[TORQUE], rows[EFFORT]),
    )
    b.residual[0] = p[0] - total_x
    b.residual[1] = p[1] - total_y
    b.change[0] = 0.0
    b.change[1] = 0.0
    for i in range(2):
        b.scale[i] = max(beam.smallest_momentum, max(size, abs(p[i])))
        b.size[i] = size + abs(p[i])
    inertia_rate = beam.element_inertia / h
    _turning_balance(
        *(inertia_rate, beam.smallest_spin, dl * size, p, rotary, early),
        *(by_value(pose), by_value(inc), by_value(balance)),
    )
    if fluid.drag > 0.0:
        add_drag(z, h, beam, fluid.drag, pose, inc, b, drag)
    return residual_norm(b.residual, b.scale)


@kernel
def residual_norm(residual: Array, scale: Array) -> float:
    """Return max_i |r_i|/s_i; a residual that is not a number counts as infinite."""
    largest = 0.0
    for i in range(residual.size):
        ratio = abs(residual[i]) / scale[i]
        if not ratio <= largest:
            largest = ratio if ratio >= 0.0 else np.inf
    return largest


@kernel
def round_off_floor(size: Array, scale: Array) -> float:
    """Estimate the scaled residual that rounding alone leaves."""
    largest = 0.0
    for i in range(size.size):
        largest = max(largest, size[i] / scale[i])
    return 2.220446049250313e-16 * largest
