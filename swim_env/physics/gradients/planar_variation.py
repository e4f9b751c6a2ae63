r"""Second derivatives of the planar discrete Lagrangian, applied to a direction.

A step solves p_n + D_1 L + h F/2 = 0 and takes p_{n+1} = D_2 L + h F/2, with derivatives of one
scalar L(q_n, q_{n+1}). What an adjoint needs of a step, and what a tangent needs, are therefore the
products of L's symmetric matrix of second derivatives with a direction. They are computed as the
derivative of (D_1 L, D_2 L) along the direction, by a complex step: imaginary parts, made so small
that their products vanish, are the derivatives to all digits.

What depends on a fluid model is taken from the model by central differences along the direction of
the shape alone: A and the shape force, at the shape a little to either side. The shape force is a
quadratic form of the motion, so its derivative by the motion is exact.

Here `a` is the end of the step at which the inertia is taken, `b` the other; in the second half of
a composed step `a` is the later one. Angles are those of the elements: vectors (N + 2,) are
(c, theta_1 ... theta_N).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.layout import FluidConstants, motion_count, unit_motion
from swim_env.physics.fluid.models import added_mass, shape_force
from swim_env.physics.fluid.outline import AXIAL, LATERAL, ROTARY
from swim_env.physics.planar.chain import BeamConstants, sum_from_centres, sum_to_centres
from swim_env.physics.planar.layout import Increment, Pose
from swim_env.physics.runtime.compile import kernel
from swim_env.physics.runtime.dense import mat_vec
from swim_env.physics.runtime.linking import linked_kernel
from swim_env.physics.runtime.views import padded
from swim_env.physics.solve.state import Member
from swim_env.physics.status import FINE

Array = NDArray[np.float64]
# Of complex numbers; kernels that take real ones elsewhere take them too.
Complex = NDArray[Any]

#: Length of the complex step.
SMALL = 1e-50

#: Entries of a vector of parameters: mass and rotary inertia of an element (kg, kg m^2), the share
#: by which the fluid is denser, then the stiffness and the damping of every joint (N m, N m s).
MASS, INERTIA, FLUID, JOINTS = range(4)


def parameter_count(elements: int) -> int:
    """Return the number of parameters of a planar beam."""
    return JOINTS + 2 * (elements - 1)


class Variation(NamedTuple):
    """Work space of `vary`.

    Attributes
    ----------
    d1, d3, change, shift, push, lever : (2, N) complex arrays
        Directors at `a`, changes of d3, shifts of the centres, momenta and their levers.
    impulse : (K + 1,) complex array
        A V/h.
    shape : (N,) complex array
        The shape force.
    change_of_motion, moved, product : (K + 1,) arrays, padded
        The derivative of V, V to either side, and A times one of them.
    forces : (2, N + 2) array
        Shape forces to either side.
    angles : (N - 1,) array
        Joint angles to either side.
    u_a, u_b : (N + 2,) arrays
        The direction, times SMALL.
    changes, parameters : (P,) arrays
        Its part by the parameters, times SMALL, and derivatives by them.
    """

    d1: Complex
    d3: Complex
    change: Complex
    shift: Complex
    push: Complex
    lever: Complex
    impulse: Complex
    shape: Complex
    change_of_motion: Array
    moved: Array
    product: Array
    forces: Array
    angles: Array
    u_a: Array
    u_b: Array
    changes: Array
    parameters: Array


def new_variation(elements: int, motions: int) -> Variation:
    """Return the work space of `vary` for a body with so many motions."""
    n, moved, parameters = elements + 2, padded(motions + 1), parameter_count(elements)
    return Variation(
        d1=np.zeros((2, elements), np.complex128),
        d3=np.zeros((2, elements), np.complex128),
        change=np.zeros((2, elements), np.complex128),
        shift=np.zeros((2, elements), np.complex128),
        push=np.zeros((2, elements), np.complex128),
        lever=np.zeros((2, elements), np.complex128),
        impulse=np.zeros(motions + 1, np.complex128),
        shape=np.zeros(elements, np.complex128),
        change_of_motion=np.zeros(moved),
        moved=np.zeros(moved),
        product=np.zeros(moved),
        forces=np.zeros((2, n)),
        angles=np.zeros(elements - 1),
        u_a=np.zeros(n),
        u_b=np.zeros(n),
        changes=np.zeros(parameters),
        parameters=np.zeros(parameters),
    )


@kernel
def _vary_motion(z: Array, beam: BeamConstants, pose: Pose, inc: Increment, v: Variation) -> None:
    """Write directors and shifts with their derivatives."""
    u_a, u_b = v.u_a, v.u_b
    for k in range(beam.elements):
        turn, new_turn = u_a[2 + k], u_b[2 + k]
        versine = -2.0 * inc.half_sine[k] * inc.half_sine[k]
        for i in range(2):
            d1, d3 = pose.d1[i, k], pose.d3[i, k]
            v.d1[i, k] = complex(d1, -turn * d3)
            v.d3[i, k] = complex(d3, turn * d1)
            change = versine * d3 + inc.turn_sine[k] * d1
            v.change[i, k] = complex(change, new_turn * inc.new_d1[i, k] - turn * d1)
    shift_x: Any = complex(z[0], u_b[0] - u_a[0])
    shift_y: Any = complex(z[1], u_b[1] - u_a[1])
    sum_to_centres(v.change, shift_x, shift_y, beam.element_length, v.shift)


@kernel
def _vary_fluid(
    q: Array,
    h: float,
    bend: float,
    forces: bool,
    fluid: FluidConstants,
    m: Member,
    beside: Member,
    v: Variation,
) -> int:
    """Write impulse and shape force with their derivatives; returns 0 or a reason's code."""
    u_a, u_b, denser = v.u_a, v.u_b, v.changes[FLUID]
    inc, mass, balance = m.body.inc, m.body.mass, m.body.balance
    elements = fluid.geometry.elements
    motions = motion_count(fluid)
    rows = mass.added[:motions]
    columns = mass.added.shape[1]
    moving = v.change_of_motion
    for k in range(elements):
        across = v.d1[0, k] * v.shift[0, k] + v.d1[1, k] * v.shift[1, k]
        along = v.d3[0, k] * v.shift[0, k] + v.d3[1, k] * v.shift[1, k]
        moving[unit_motion(k, LATERAL, fluid)] = across.imag
        moving[unit_motion(k, ROTARY, fluid)] = (u_b[2 + k] - u_a[2 + k]) * inc.turn_cosine[k]
        moving[unit_motion(k, AXIAL, fluid)] = along.imag
    moving[motions] = 0.0
    mat_vec(rows, moving[:columns], v.product)
    # A change of the density alone changes A by a share of itself.
    energy = 0.0
    for i in range(motions):
        v.impulse[i] = complex(inc.impulse[i], v.product[i] / h + denser * inc.impulse[i])
        energy += inc.motion[i] * v.product[i] / h
    v.impulse[motions] = 0.0
    for k in range(elements):
        v.shape[k] = complex(balance.shape[k], denser * balance.shape[k])
    if fluid.varies:
        largest, moved = 0.0, 0.0
        for i in range(motions):
            largest = max(largest, abs(inc.motion[i]))
            moved = max(moved, abs(moving[i]))
        if forces and moved > 0.0 and largest > 0.0:
            # (V + s V')^2 - (V - s V')^2 = 4 s V V'.
            size = largest / moved
            for side in range(2):
                factor = size if side == 0 else -size
                for i in range(motions):
                    v.moved[i] = inc.motion[i] + factor * moving[i]
                shape_force(v.moved, fluid, m.fluid_work, v.forces[side])
            for k in range(elements):
                change = 0.5 * (v.forces[0, k] - v.forces[1, k]) / size
                v.shape[k] += complex(0.0, change)
        bent = 0.0
        for j in range(elements - 1):
            bent = max(bent, abs(u_a[3 + j] - u_a[2 + j]))
        if bend > 0.0 and bent > 0.0:
            step = bend / bent
            for side in range(2):
                factor = step if side == 0 else -step
                for j in range(elements - 1):
                    v.angles[j] = q[3 + j] + factor * (u_a[3 + j] - u_a[2 + j])
                status = added_mass(v.angles, fluid, beside.fluid_work, beside.body.mass.added)
                if status != FINE:
                    return int(status)
                mat_vec(beside.body.mass.added[:motions], inc.motion[:columns], v.product)
                shape_force(inc.motion, fluid, beside.fluid_work, v.forces[0])
                half = 0.5 / factor
                for i in range(motions):
                    v.impulse[i] += complex(0.0, half * v.product[i] / h)
                    energy += 0.5 * half * inc.motion[i] * v.product[i] / h
                for k in range(elements):
                    v.shape[k] += complex(0.0, half * v.forces[0, k])
    v.parameters[FLUID] += energy
    return FINE


@kernel
def _vary_joints(
    h: float, beam: BeamConstants, inc: Increment, v: Variation, out_a: Array, out_b: Array
) -> None:
    """Add the derivatives of -h dW/dq at both ends."""
    u_a, u_b = v.u_a, v.u_b
    for j in range(beam.elements - 1):
        bend = 0.5 * (u_a[3 + j] - u_a[2 + j] + u_b[3 + j] - u_b[2 + j])
        sine = complex(inc.mean_sine[j], bend * inc.mean_cosine[j])
        cosine = complex(inc.mean_cosine[j], 0.0 if beam.linear_strain else -bend * sine.real)
        front, back = complex(1.0, 0.0), complex(1.0, 0.0)
        front_sine, back_sine = complex(0.0, 0.0), complex(0.0, 0.0)
        if not beam.strain_of_angles:
            half = 0.5 * (u_b[2 + j] - u_a[2 + j])
            front = complex(inc.half_cosine[j], -half * inc.half_sine[j])
            front_sine = complex(inc.half_sine[j], half * inc.half_cosine[j])
            half = 0.5 * (u_b[3 + j] - u_a[3 + j])
            back = complex(inc.half_cosine[j + 1], -half * inc.half_sine[j + 1])
            back_sine = complex(inc.half_sine[j + 1], half * inc.half_cosine[j + 1])
        strain = front * back * sine
        moment = h * complex(beam.joint_stiffness[j], v.changes[JOINTS + j]) * strain
        straight = 0.5 * front * back * cosine
        turned_front = 0.5 * front_sine * back * sine
        turned_back = 0.5 * back_sine * front * sine
        out_a[2 + j] -= (moment * (turned_front - straight)).imag
        out_a[3 + j] -= (moment * (turned_back + straight)).imag
        out_b[2 + j] += (moment * (turned_front + straight)).imag
        out_b[3 + j] += (moment * (turned_back - straight)).imag
        v.parameters[JOINTS + j] -= h * strain.real * strain.imag


@linked_kernel
def vary(
    q: Array,
    z: Array,
    h: float,
    u_a: Array,
    u_b: Array,
    changes: Array,
    bend: float,
    forces: bool,
    beam: BeamConstants,
    fluid: FluidConstants,
    m: Member,
    beside: Member,
    v: Variation,
    out_a: Array,
    out_b: Array,
    parameters: Array,
) -> int:
    """Differentiate dL/da and dL/db of a step without its forces along a direction.

    Parameters
    ----------
    q, z : (N + 2,) arrays
        Minimal coordinates of `a`, and the increment from there to `b`.
    h : float
        Length of the step (s).
    u_a, u_b : (N + 2,) arrays
        The direction.
    changes : (P,) array
        Its part by the parameters, see `parameter_count`.
    bend : float
        Bend of a joint (rad) by which shapes to either side differ; 0 to hold the added mass.
    forces : bool
        Whether the derivative of dL/da is wanted, in which the shape force is.
    beam, fluid : BeamConstants, FluidConstants
        The scene.
    m : Member
        For which `evaluate_step` was called with q and z.
    beside : Member
        Another, whose fluid work space and added mass are overwritten.
    v : Variation
        Work space.
    out_a, out_b : (N + 2,) arrays
        Overwritten: the derivatives of dL/da and dL/db.
    parameters : (P,) array
        The derivatives of dL/d parameter are added.

    Returns
    -------
    int
        0, or the code of the reason why a shape to either side has no added mass.
    """
    for i in range(u_a.size):
        v.u_a[i] = SMALL * u_a[i]
        v.u_b[i] = SMALL * u_b[i]
    for i in range(changes.size):
        v.changes[i] = SMALL * changes[i]
        v.parameters[i] = 0.0
    status = _vary(q, z, h, bend, forces, beam, fluid, m, beside, v, out_a, out_b)
    for i in range(u_a.size):
        out_a[i] /= SMALL
        out_b[i] /= SMALL
    for i in range(changes.size):
        parameters[i] += v.parameters[i] / SMALL
    return int(status)


@kernel
def _vary(
    q: Array,
    z: Array,
    h: float,
    bend: float,
    forces: bool,
    beam: BeamConstants,
    fluid: FluidConstants,
    m: Member,
    beside: Member,
    v: Variation,
    out_a: Array,
    out_b: Array,
) -> int:
    """Do what `vary` does with directions and derivatives that are times SMALL."""
    u_a, u_b = v.u_a, v.u_b
    pose, inc = m.body.pose, m.body.inc
    rate = 1.0 / h
    _vary_motion(z, beam, pose, inc, v)
    if fluid.present:
        status = _vary_fluid(q, h, bend, forces, fluid, m, beside, v)
        if status != FINE:
            return int(status)
    mass = rate * complex(beam.element_mass, v.changes[MASS])
    inertia = rate * complex(beam.element_inertia, v.changes[INERTIA])
    total_x: Any = complex(0.0, 0.0)
    total_y: Any = complex(0.0, 0.0)
    for k in range(beam.elements):
        for i in range(2):
            v.push[i, k] = mass * v.shift[i, k]
            v.parameters[MASS] += rate * v.shift[i, k].real * v.shift[i, k].imag
            if fluid.present:
                v.push[i, k] += v.impulse[unit_motion(k, LATERAL, fluid)] * v.d1[i, k]
                v.push[i, k] += v.impulse[unit_motion(k, AXIAL, fluid)] * v.d3[i, k]
        total_x += v.push[0, k]
        total_y += v.push[1, k]
    sum_from_centres(v.push, total_x, total_y, beam.element_length, v.lever)
    out_b[0], out_b[1] = total_x.imag, total_y.imag
    out_a[0], out_a[1] = -total_x.imag, -total_y.imag
    for j in range(beam.elements):
        relative, new_turn = u_b[2 + j] - u_a[2 + j], u_b[2 + j]
        sine = complex(inc.turn_sine[j], relative * inc.turn_cosine[j])
        turning = inertia * sine
        v.parameters[INERTIA] += rate * relative * inc.turn_sine[j]
        arm = v.d1[0, j] * v.lever[0, j] + v.d1[1, j] * v.lever[1, j]
        new_x, new_y = inc.new_d1[0, j], inc.new_d1[1, j]
        new_arm = complex(new_x, -new_turn * new_y) * v.lever[0, j]
        new_arm += complex(new_y, new_turn * new_x) * v.lever[1, j]
        munk = complex(0.0, 0.0)
        if fluid.present:
            cosine = complex(inc.turn_cosine[j], -relative * inc.turn_sine[j])
            turning += v.impulse[unit_motion(j, ROTARY, fluid)] * cosine
            across = v.d1[0, j] * v.shift[0, j] + v.d1[1, j] * v.shift[1, j]
            along = v.d3[0, j] * v.shift[0, j] + v.d3[1, j] * v.shift[1, j]
            munk = v.impulse[unit_motion(j, AXIAL, fluid)] * across
            munk += rate * v.shape[j] - v.impulse[unit_motion(j, LATERAL, fluid)] * along
        out_a[2 + j] = (munk - arm - turning).imag
        out_b[2 + j] = (new_arm + turning).imag
    _vary_joints(h, beam, inc, v, out_a, out_b)
    return FINE
