r"""The step equations in space: derivatives of the discrete Lagrangian in minimal coordinates.

In redundant coordinates (r, d1, d2) of every element

.. math::
    L_d(q_n, q_{n+1}) = \frac{1}{2 h} \Delta q \cdot M_b \Delta q + \frac{1}{2 h} V^T A(q_n) V
        - h\, W(K(q_{n+1/2})), \quad v = R(n)^T \Delta r, \; w = \mathrm{vect\,skew}(E),

with E = exp(hat phi) the turn of an element in its own axes. What is solved is the pull-back to
the mean centre and the elements' rotations (discrete null space). With E_kj the map from changes
of d3 to centres, P^k the momentum of element k, U = A V/h the fluid's impulse in the elements'
frames, and for rotations omega in the axes of space,

.. math::
    D_1 L_d \cdot \delta c &= -\sum_k P^k, \\
    D_1 L_d \cdot \omega_k &= \sum_i I_i (\Delta d_i \times d_i)/h
        - \tfrac{1}{2} R (\mathrm{tr} E - E^T) U_w - d_3 \times \sum_l E_{lk} P^l \\
        &\quad - \Delta r^k \times R U_v + R S/h + \text{joints},

where S is the derivative of V^T A V/2 by the element's rotation, V held. In D_1 + D_2 the first two
terms cancel.

The adjoint of this map has the inertia of its end: v is measured in R(n+1), and the terms with
Delta r and S are in D_2 alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import embedded, kernel
from swim_env.physics.runtime.dense import mat_vec
from swim_env.physics.runtime.linking import linked_kernel
from swim_env.physics.spatial.chain import Pose, SpatialBeam, sum_from_centres, sum_to_centres
from swim_env.physics.spatial.joints import joint_impulses
from swim_env.physics.spatial.layout import Body, Increment, Newton, SpatialFluid
from swim_env.physics.spatial.rotations import (
    product,
    quaternion_of_vector,
    quaternion_product,
    rotate,
    rotate_back,
    turn_less_one,
    vector_of_quaternion,
)
from swim_env.physics.spatial.vectors import (
    Vector,
    cross,
    director,
    inner,
    part,
    plus,
    row,
    scaled,
    size,
    to_space,
    write_part,
    write_row,
)

Array = NDArray[np.float64]


@embedded
def _move(q: Array, z: Array, beam: SpatialBeam, body: Body, newton: Newton) -> None:
    """Compute how elements, joints and centres move in an increment z (3 N + 3,)."""
    pose, inc = body.pose, body.inc
    elements = beam.elements
    change = newton.tangents
    for k in range(elements):
        phi = z[3 + 3 * k : 6 + 3 * k]
        sine = turn_less_one(phi, inc.turn[k])
        product(pose.directors[k], inc.turn[k], inc.change[k])
        for i in range(3):
            for a in range(3):
                inc.directors[k, i, a] = pose.directors[k, i, a] + inc.change[k, i, a]
            change[k, i] = inc.change[k, i, 2]
            inc.motion[6 * k + 3 + i] = sine * phi[i]
    sum_to_centres(change, z[:3], beam.element_length, inc.shift)
    for j in range(elements - 1):
        new_joint(q, z, j, newton.quaternions)
        vector_of_quaternion(newton.quaternions[0], inc.angles[j])


@kernel
def new_joint(q: Array, z: Array, j: int, work: Array) -> None:
    """Write the quaternion of joint j after an increment to the first of three rows (3, 4)."""
    quaternion_of_vector(z[3 + 3 * j : 6 + 3 * j], work[0])
    quaternion_product(-1.0, work[0], q[7 + 4 * j : 11 + 4 * j], work[1])
    quaternion_of_vector(z[6 + 3 * j : 9 + 3 * j], work[2])
    quaternion_product(1.0, work[1], work[2], work[0])


@kernel
def apply_added_mass(fluid: SpatialFluid, added: Array, motion: Array, out: Array) -> None:
    """Write A V of one motion V (6 N,), padded."""
    if fluid.coupled:
        mat_vec(added, motion, out)
        return
    for first in range(0, 6 * (added.shape[0] // 6), 6):
        for r in range(6):
            total = 0.0
            for s in range(6):
                total += added[first + r, first + s] * motion[first + s]
            out[first + r] = total


@embedded
def _find_flow(h: float, adjoint: bool, fluid: SpatialFluid, body: Body) -> None:
    """Compute V and the fluid's impulse A V/h."""
    pose, inc, mass = body.pose, body.inc, body.mass
    frames = inc.directors if adjoint else pose.directors
    for k in range(frames.shape[0]):
        rotate_back(frames[k], inc.shift[k], inc.motion[6 * k : 6 * k + 3])
    apply_added_mass(fluid, mass.added, inc.motion, inc.impulse)
    for i in range(inc.impulse.size):
        inc.impulse[i] /= h
    for k in range(frames.shape[0]):
        rotate(frames[k], inc.impulse[6 * k : 6 * k + 3], inc.push[k])


@linked_kernel
def evaluate_spatial_step(
    q: Array,
    p: Array,
    torques: Array,
    z: Array,
    h: float,
    adjoint: bool,
    beam: SpatialBeam,
    fluid: SpatialFluid,
    body: Body,
    newton: Newton,
) -> float:
    """Evaluate the residual of p_n + D1 L_d(q_n, q_{n+1}) + h F/2 = 0, or of the adjoint map.

    Parameters
    ----------
    q, p : (4 N + 3,), (3 N + 3,) arrays
        Coordinates and momentum at the beginning of the step.
    torques : (N - 1, 3) array
        Joint torques held over the step (N m).
    z : (3 N + 3,) array
        Increment (dc, phi_1 ... phi_N).
    h : float
        Length of the step (s).
    adjoint : bool
        Whether it is D1 of the adjoint's Lagrangian.
    beam, fluid : SpatialBeam, SpatialFluid
        The scene.
    body : Body
        With the pose q_n, the added mass and the shape force. Increment and the rest of the balance
        are overwritten.
    newton : Newton
        For its scratch.

    Returns
    -------
    float
        max_i |r_i|/s_i with s_i = max(smallest scale, |p_i|, impulses), the same for the components
        of a vector; not finite where z is not.
    """
    _move(q, z, beam, body, newton)
    if fluid.present:
        _find_flow(h, adjoint, fluid, body)
    joint_impulses(torques, h, beam, body, newton)
    return _balance(p, h, adjoint, beam, fluid, body)


@embedded
def _balance(
    p: Array, h: float, adjoint: bool, beam: SpatialBeam, fluid: SpatialFluid, body: Body
) -> float:
    """Sum up residual, its scale, and the change of the momentum; return the residual's norm."""
    pose, inc, b = body.pose, body.inc, body.balance
    total = 0.0
    left = part(p, 0)
    for k in range(beam.elements):
        momentum = scaled(beam.mass[k] / h, row(inc.shift, k))
        if fluid.present:
            momentum = plus(momentum, 1.0, row(inc.push, k))
        write_row(b.momentum, k, momentum)
        left = plus(left, -1.0, momentum)
        total += size(momentum)
    write_part(b.residual, 0, left)
    carried = size(part(p, 0))
    b.change[:3] = 0.0
    b.scale[:3] = max(beam.smallest_momentum, max(total, carried))
    b.size[:3] = total + carried
    sum_from_centres(b.momentum, beam.element_length, b.lever)
    frames = inc.directors if adjoint else pose.directors
    for k in range(beam.elements):
        lever = row(b.lever, k)
        turning = _turning(k, h, beam, fluid, pose, inc)
        arm = cross(director(pose.directors, k, 2), lever)
        new_arm = cross(director(inc.change, k, 2), lever)
        munk = (0.0, 0.0, 0.0)
        if fluid.present:
            munk = cross(row(inc.push, k), row(inc.shift, k))
        if fluid.varies:
            munk = plus(munk, 1.0 / h, to_space(frames, k, row(b.shape, k)))
        first = 3 + 3 * k
        for i in range(3):
            own = 0.0 if adjoint else munk[i]
            b.residual[first + i] = p[first + i] - turning[i] - arm[i] + own + b.early[k, i]
            b.change[first + i] = munk[i] + new_arm[i] + b.early[k, i] + b.late[k, i]
        spin = size(part(p, first))
        impulses = size(turning) + size(arm) + size(munk) + b.joint_size[k]
        b.scale[first : first + 3] = max(beam.smallest_spin, max(spin, impulses))
        b.size[first : first + 3] = spin + impulses + beam.element_length * total
    largest = 0.0
    for i in range(b.residual.size):
        ratio = abs(b.residual[i]) / b.scale[i]
        if not ratio <= largest:
            largest = ratio if ratio >= 0.0 else np.inf
    return largest


@embedded
def _turning(
    k: int, h: float, beam: SpatialBeam, fluid: SpatialFluid, pose: Pose, inc: Increment
) -> Vector:
    """Return the angular momentum of an element about its centre, at the beginning of the step.

    That is R (tr E - E^T) U_w/2 of the fluid and sum_i I_i d_i x Delta d_i/h of the body.
    """
    found = (0.0, 0.0, 0.0)
    if fluid.present:
        turn, spin = inc.turn, part(inc.impulse, 6 * k + 3)
        factor = 1.0 + 0.5 * (turn[k, 0, 0] + turn[k, 1, 1] + turn[k, 2, 2])
        # E^T U has the products of U with the columns of E = 1 + F.
        turned = (
            inner(director(turn, k, 0), spin),
            inner(director(turn, k, 1), spin),
            inner(director(turn, k, 2), spin),
        )
        found = to_space(pose.directors, k, plus(scaled(factor, spin), -0.5, turned))
    for a in range(2):
        moment = cross(director(pose.directors, k, a), director(inc.change, k, a))
        found = plus(found, beam.inertia[k, a] / h, moment)
    return found
