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

from swim_env.physics.fluid.layout import FluidBuffers, FluidConstants, motion_count, unit_motion
from swim_env.physics.fluid.models import shape_force
from swim_env.physics.fluid.outline import AXIAL, LATERAL, ROTARY
from swim_env.physics.planar.chain import BeamConstants, sum_from_centres, sum_to_centres
from swim_env.physics.planar.drag import add_drag
from swim_env.physics.planar.elastic import (
    elastic_terms,
    impulses_of_torques,
    linearise_joints,
    linearise_mean_joints,
)
from swim_env.physics.planar.layout import Balance, Body, Drag, Increment, Pose
from swim_env.physics.runtime.compile import inlined, kernel
from swim_env.physics.runtime.dense import mat_vec
from swim_env.physics.runtime.elementary import SMALL_ANGLE, cos_small, sin_small
from swim_env.physics.runtime.linking import linked_kernel

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


@inlined
def _set_increment(z: Array, pose: Pose, inc: Increment) -> None:
    """Compute turns, first directors and mean joints from the increment z (N + 2,)."""
    elements = inc.turn_sine.size
    half = 0.0
    small = True
    for k in range(elements):
        half += 0.5 * z[2 + k]
        inc.half_sine[k] = half
        small = small and abs(half) <= SMALL_ANGLE
        if k > 0:
            inc.mean_sine[k - 1] = 0.5 * z[2 + k]
            small = small and abs(z[2 + k]) <= 2.0 * SMALL_ANGLE
    # Newton's iterates stay small; the library's functions serve the rest.
    if small:
        for k in range(elements):
            inc.half_cosine[k] = cos_small(inc.half_sine[k])
            inc.half_sine[k] = sin_small(inc.half_sine[k])
        for j in range(elements - 1):
            s = sin_small(inc.mean_sine[j])
            c = cos_small(inc.mean_sine[j])
            inc.mean_sine[j] = pose.joint_sine[j] * c + pose.joint_cosine[j] * s
            inc.mean_cosine[j] = pose.joint_cosine[j] * c - pose.joint_sine[j] * s
    else:
        for k in range(elements):
            inc.half_cosine[k] = np.cos(inc.half_sine[k])
            inc.half_sine[k] = np.sin(inc.half_sine[k])
        for j in range(elements - 1):
            s = np.sin(inc.mean_sine[j])
            c = np.cos(inc.mean_sine[j])
            inc.mean_sine[j] = pose.joint_sine[j] * c + pose.joint_cosine[j] * s
            inc.mean_cosine[j] = pose.joint_cosine[j] * c - pose.joint_sine[j] * s
    for k in range(elements):
        s = inc.half_sine[k]
        inc.turn_sine[k] = 2.0 * s * inc.half_cosine[k]
        inc.turn_cosine[k] = 1.0 - 2.0 * s * s
        inc.new_d1[0, k] = pose.d1[0, k] * inc.turn_cosine[k] - pose.d3[0, k] * inc.turn_sine[k]
        inc.new_d1[1, k] = pose.d1[1, k] * inc.turn_cosine[k] - pose.d3[1, k] * inc.turn_sine[k]


@inlined
def _move(
    z: Array,
    h: float,
    beam: BeamConstants,
    fluid: FluidConstants,
    normal: Array,
    added: Array,
    pose: Pose,
    inc: Increment,
    change: Array,
) -> None:
    """Compute how elements and centres move in an increment z, and the fluid's impulse A V/h.

    V is measured with the normals (2, N); `change` (2, N) is scratch.
    """
    elements = beam.elements
    _set_increment(z, pose, inc)
    if beam.linear_strain:
        linearise_mean_joints(z, pose, inc)
    for k in range(elements):
        # d3(n+1) - d3(n) without cancellation.
        versine = -2.0 * inc.half_sine[k] * inc.half_sine[k]
        change[0, k] = versine * pose.d3[0, k] + inc.turn_sine[k] * pose.d1[0, k]
        change[1, k] = versine * pose.d3[1, k] + inc.turn_sine[k] * pose.d1[1, k]
    sum_to_centres(change, z[0], z[1], beam.element_length, inc.shift)
    if fluid.present:
        for k in range(elements):
            across = normal[0, k] * inc.shift[0, k] + normal[1, k] * inc.shift[1, k]
            # d3 = (d1_y, -d1_x).
            along = normal[1, k] * inc.shift[0, k] - normal[0, k] * inc.shift[1, k]
            inc.motion[unit_motion(k, LATERAL, fluid)] = across
            inc.motion[unit_motion(k, ROTARY, fluid)] = inc.turn_sine[k]
            inc.motion[unit_motion(k, AXIAL, fluid)] = along
        motions = motion_count(fluid)
        inc.motion[motions] = 0.0
        mat_vec(added[:motions], inc.motion[: added.shape[1]], inc.impulse)
        for i in range(inc.impulse.size):
            inc.impulse[i] /= h


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
    fluid_buffers: FluidBuffers,
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
    fluid_buffers : FluidBuffers
        As `added_mass` left them for that.

    Returns
    -------
    float
        max_i |r_i|/s_i with s_i = max(smallest scale, |p_i|, impulses); not finite where z is not.
    """
    pose, inc, balance, drag, mass = body
    normal, early = pose.d1, balance.pose_forces
    if adjoint:
        normal, early = inc.new_d1, balance.no_forces
    _move(z, h, beam, fluid, normal, mass.added, pose, inc, balance.sums)
    if fluid.present and not held:
        shape_force(inc.motion, fluid, fluid_buffers, balance.shape)
    _pose_forces(h, normal, fluid, inc, balance)
    return _balance(p, torques, z, h, normal, early, beam, fluid, pose, inc, balance, drag)


@inlined
def _pose_forces(
    h: float, normal: Array, fluid: FluidConstants, inc: Increment, balance: Balance
) -> None:
    """Collect what the inertia does to the pose that it is taken at, with these normals (2, N)."""
    if not fluid.present:
        return
    inverse_h = 1.0 / h
    for j in range(normal.shape[1]):
        across = normal[0, j] * inc.shift[0, j] + normal[1, j] * inc.shift[1, j]
        along = normal[1, j] * inc.shift[0, j] - normal[0, j] * inc.shift[1, j]
        lateral = inc.impulse[unit_motion(j, LATERAL, fluid)]
        axial = inc.impulse[unit_motion(j, AXIAL, fluid)]
        balance.pose_forces[0, j] = axial * across - lateral * along
        balance.pose_forces[1, j] = inverse_h * balance.shape[j]


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
    mass_rate = beam.element_mass / h
    inertia_rate = beam.element_inertia / h
    with_fluid = fluid.present
    total_x = 0.0
    total_y = 0.0
    size = 0.0
    for k in range(elements):
        b.momentum[0, k] = mass_rate * inc.shift[0, k]
        b.momentum[1, k] = mass_rate * inc.shift[1, k]
        if with_fluid:
            lateral = inc.impulse[unit_motion(k, LATERAL, fluid)]
            axial = inc.impulse[unit_motion(k, AXIAL, fluid)]
            b.momentum[0, k] += lateral * normal[0, k]
            b.momentum[1, k] += lateral * normal[1, k]
            b.momentum[0, k] += axial * normal[1, k]
            b.momentum[1, k] -= axial * normal[0, k]
        total_x += b.momentum[0, k]
        total_y += b.momentum[1, k]
        size += abs(b.momentum[0, k]) + abs(b.momentum[1, k])
    sum_from_centres(b.momentum, total_x, total_y, dl, b.lever)
    elastic_terms(h, beam, inc, b)
    impulses_of_torques(torques, z, h, beam, b)

    b.residual[0] = p[0] - total_x
    b.residual[1] = p[1] - total_y
    b.change[0] = 0.0
    b.change[1] = 0.0
    for i in range(2):
        b.scale[i] = max(beam.smallest_momentum, max(size, abs(p[i])))
        b.size[i] = size + abs(p[i])
    for j in range(elements):
        turning = inertia_rate * inc.turn_sine[j]
        if with_fluid:
            turning += inc.impulse[unit_motion(j, ROTARY, fluid)] * inc.turn_cosine[j]
        arm = pose.d1[0, j] * b.lever[0, j] + pose.d1[1, j] * b.lever[1, j]
        new_arm = inc.new_d1[0, j] * b.lever[0, j] + inc.new_d1[1, j] * b.lever[1, j]
        munk, shape = b.pose_forces[0, j], b.pose_forces[1, j]
        b.change[2 + j] = munk + (new_arm - arm) - b.elastic_sum[j] + shape + b.torque[j]
        munk, shape = early[0, j], early[1, j]
        b.residual[2 + j] = (
            p[2 + j] - turning + munk - arm - b.elastic[j] + shape + 0.5 * b.torque[j]
        )
        forces = b.elastic_size[j] + abs(shape) + abs(munk) + b.torque_size[j]
        impulses = abs(turning) + abs(arm) + forces
        b.scale[2 + j] = max(beam.smallest_spin, max(abs(p[2 + j]), impulses))
        b.size[2 + j] = abs(p[2 + j]) + impulses + dl * size
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
