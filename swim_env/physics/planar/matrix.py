"""Newton's matrices of the step equations, and the reduced mass of a pose."""

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
from swim_env.physics.fluid.outline import AXIAL, LATERAL, ROTARY
from swim_env.physics.planar.chain import BeamConstants, chain_weight, sum_from_centres
from swim_env.physics.planar.elastic import (
    add_joint_columns,
    add_pose_softening,
    add_pose_springs,
    add_turn_columns,
)
from swim_env.physics.planar.layout import Body, Drag, Increment, Mass, Newton, Pose
from swim_env.physics.runtime.compile import inlined, kernel
from swim_env.physics.runtime.dense import copy, multiply
from swim_env.physics.runtime.linking import linked_kernel

Array = NDArray[np.float64]

#: Difference quotient for the derivative of the shape force in Newton's matrix, in increments.
SHAPE_DIFFERENCE = 1e-5


@kernel
def _centre_column(column: int, beam: BeamConstants, new_d1: Array, out: Array) -> None:
    """Write how the centres (2, N) move with an unknown, dc or the turn of an element."""
    elements = beam.elements
    dl = beam.element_length
    j = column - 2
    if j < 0:
        out[0] = 1.0 if column == 0 else 0.0
        out[1] = 1.0 if column == 1 else 0.0
        return
    weight = chain_weight(j, elements)
    for k in range(elements):
        lever = dl * ((1.0 if j < k else (0.5 if j == k else 0.0)) - weight)
        out[0, k] = lever * new_d1[0, j]
        out[1, k] = lever * new_d1[1, j]


@inlined
def _fluid_columns(
    beam: BeamConstants,
    fluid: FluidConstants,
    normal: Array,
    added: Array,
    inc: Increment,
    moving: Array,
    newton: Newton,
) -> None:
    """Differentiate V, and the impulse A V with it, by every unknown; a row for each."""
    elements = beam.elements
    motions = motion_count(fluid)
    for column in range(elements + 2):
        motion = newton.motions[column]
        _centre_column(column, beam, inc.new_d1, moving)
        for k in range(elements):
            across = normal[0, k] * moving[0, k] + normal[1, k] * moving[1, k]
            along = normal[1, k] * moving[0, k] - normal[0, k] * moving[1, k]
            motion[unit_motion(k, LATERAL, fluid)] = across
            motion[unit_motion(k, AXIAL, fluid)] = along
        motion[motions] = 0.0
        if column >= 2:
            motion[unit_motion(column - 2, ROTARY, fluid)] = inc.turn_cosine[column - 2]
    # A is symmetric, and its rows beyond K are zero.
    multiply(newton.motions, added[: padded_motions(fluid)], newton.impulses)


@inlined
def _shape_columns(
    inverse_h: float,
    difference: float,
    fluid: FluidConstants,
    fluid_work: FluidWork,
    inc: Increment,
    shape: Array,
    newton: Newton,
) -> None:
    """Take the derivative of the shape force off, by a difference quotient for every unknown.

    The shape force is a quadratic form, so a quotient is off by no more than its step, and a Newton
    matrix need not be better.
    """
    for column in range(newton.transposed.shape[0]):
        for i in range(newton.moved.size):
            newton.moved[i] = inc.motion[i] + difference * newton.motions[column, i]
        shape_force(newton.moved, fluid, fluid_work, newton.shape)
        for k in range(shape.size):
            change = newton.shape[k] - shape[k]
            newton.transposed[column, 2 + k] -= inverse_h * change / difference


@kernel
def _inertia_columns(
    h: float,
    normal: Array,
    early: bool,
    beam: BeamConstants,
    fluid: FluidConstants,
    body: Body,
    newton: Newton,
) -> None:
    """Differentiate the negative inertial part of the residual, a column per row of `transposed`.

    Columns belong to dc and to the turns delta_k. The inertia is measured with the normals (2, N);
    `early` is whether the forces of its pose act at the beginning of the step. Callers write it as
    bool(1) or bool(0): a literal is a type of its own, and all of this would be compiled for each.
    """
    pose, inc, balance, mass = body.pose, body.inc, body.balance, body.mass
    pushes = balance.sums
    elements = beam.elements
    dl = beam.element_length
    mass_rate = beam.element_mass / h
    inverse_h = 1.0 / h
    with_fluid = fluid.present
    if with_fluid:
        _fluid_columns(beam, fluid, normal, mass.added, inc, pushes, newton)
    for column in range(elements + 2):
        out = newton.transposed[column]
        impulses = newton.impulses[column]
        j = column - 2
        _centre_column(column, beam, inc.new_d1, pushes)
        total_x = 0.0
        total_y = 0.0
        for k in range(elements):
            turning = 0.0
            if k == j:
                turning = beam.element_inertia * inverse_h * inc.turn_cosine[k]
            moving_x = pushes[0, k]
            moving_y = pushes[1, k]
            push_x = mass_rate * moving_x
            push_y = mass_rate * moving_y
            if with_fluid:
                lateral = inverse_h * impulses[k]
                rotary = inverse_h * impulses[elements + k]
                push_x += lateral * normal[0, k]
                push_y += lateral * normal[1, k]
                turning += rotary * inc.turn_cosine[k]
                if k == j:
                    turning -= inc.impulse[elements + k] * inc.turn_sine[k]
                if early:
                    turning += lateral * (
                        pose.d3[0, k] * inc.shift[0, k] + pose.d3[1, k] * inc.shift[1, k]
                    )
                    turning += inc.impulse[k] * (
                        pose.d3[0, k] * moving_x + pose.d3[1, k] * moving_y
                    )
                if fluid.axial and (k == 0 or k == elements - 1):
                    along = unit_motion(k, AXIAL, fluid)
                    axial = inverse_h * impulses[along]
                    push_x += axial * normal[1, k]
                    push_y -= axial * normal[0, k]
                    if early:
                        turning -= axial * (
                            pose.d1[0, k] * inc.shift[0, k] + pose.d1[1, k] * inc.shift[1, k]
                        )
                        turning -= inc.impulse[along] * (
                            pose.d1[0, k] * moving_x + pose.d1[1, k] * moving_y
                        )
            total_x += push_x
            total_y += push_y
            pushes[0, k] = push_x
            pushes[1, k] = push_y
            out[2 + k] = turning
        out[0] = total_x
        out[1] = total_y
        behind_x = 0.0
        behind_y = 0.0
        for back in range(elements):
            k = elements - 1 - back
            weight = chain_weight(k, elements)
            lever_x = dl * (behind_x + 0.5 * pushes[0, k] - weight * total_x)
            lever_y = dl * (behind_y + 0.5 * pushes[1, k] - weight * total_y)
            out[2 + k] += pose.d1[0, k] * lever_x + pose.d1[1, k] * lever_y
            behind_x += pushes[0, k]
            behind_y += pushes[1, k]


@inlined
def mass_matrix(beam: BeamConstants, fluid: FluidConstants, body: Body, newton: Newton) -> None:
    """Write the reduced total mass at q_n, in the basis (c, theta_1 ... theta_N), to `mass.total`.

    It is the inertial Jacobian at a vanishing increment. `set_pose` was called for q_n, and
    `mass.added` is A(q_n).
    """
    pose, inc, mass = body.pose, body.inc, body.mass
    inc.turn_sine[:] = 0.0
    inc.turn_cosine[:] = 1.0
    for i in range(2):
        copy(pose.d1[i], inc.new_d1[i])
    inc.shift[:] = 0.0
    inc.impulse[:] = 0.0
    _inertia_columns(1.0, pose.d1, bool(1), beam, fluid, body, newton)
    for i in range(mass.total.shape[0]):
        copy(newton.transposed[i], mass.total[i])
        mass.diagonal[i] = mass.total[i, i]


@kernel
def _add_drag_columns(
    beam: BeamConstants, pose: Pose, inc: Increment, drag: Drag, pushes: Array, transposed: Array
) -> None:
    """Add the drag, with the slopes of the last evaluation; half its impulse is in the residual."""
    elements = beam.elements
    for column in range(elements + 2):
        out = transposed[column]
        j = column - 2
        _centre_column(column, beam, inc.new_d1, pushes)
        total_x = 0.0
        total_y = 0.0
        for k in range(elements):
            normal_x = pose.d1[0, k] * inc.half_cosine[k] - pose.d3[0, k] * inc.half_sine[k]
            normal_y = pose.d1[1, k] * inc.half_cosine[k] - pose.d3[1, k] * inc.half_sine[k]
            across = normal_x * pushes[0, k] + normal_y * pushes[1, k]
            push = 0.5 * drag.slope[k] * across
            turning = 0.5 * drag.cross[k] * across
            if k == j:
                push += 0.5 * drag.cross[k]
                turning += 0.5 * drag.turn_slope[k]
            out[2 + k] += turning
            pushes[0, k] = push * normal_x
            pushes[1, k] = push * normal_y
            total_x += pushes[0, k]
            total_y += pushes[1, k]
        out[0] += total_x
        out[1] += total_y
        sum_from_centres(pushes, total_x, total_y, beam.element_length, drag.lever)
        for k in range(elements):
            out[2 + k] += pose.d1[0, k] * drag.lever[0, k] + pose.d1[1, k] * drag.lever[1, k]


@linked_kernel
def step_jacobian(
    h: float,
    shape_difference: float,
    beam: BeamConstants,
    fluid: FluidConstants,
    body: Body,
    fluid_work: FluidWork,
    newton: Newton,
) -> None:
    """Write minus the derivative of the residual with respect to z to `newton.jacobian`.

    Call `evaluate_step` for this z before. All terms are there, except that the shape force is held
    where `shape_difference`, the difference quotient for its derivative, is 0: that costs N + 2
    evaluations of it, as much as the rest of the step.
    """
    pose, inc, balance = body.pose, body.inc, body.balance
    _inertia_columns(h, pose.d1, bool(1), beam, fluid, body, newton)
    if fluid.present and shape_difference > 0.0:
        _shape_columns(1.0 / h, shape_difference, fluid, fluid_work, inc, balance.shape, newton)
    _finish_jacobian(h, beam, fluid, body, newton)


@linked_kernel
def adjoint_jacobian(
    h: float, beam: BeamConstants, fluid: FluidConstants, body: Body, newton: Newton
) -> None:
    """Write minus the derivative of the adjoint map's residual to `newton.jacobian`.

    Call `evaluate_step` with `adjoint` before. The added mass of q_{n+1} and the normals that it is
    measured with are held.
    """
    _inertia_columns(h, body.inc.new_d1, bool(0), beam, fluid, body, newton)
    _finish_jacobian(h, beam, fluid, body, newton)


@kernel
def _finish_jacobian(
    h: float, beam: BeamConstants, fluid: FluidConstants, body: Body, newton: Newton
) -> None:
    """Add drag and elasticity to the derivatives in `transposed`, and write the matrix."""
    pose, inc, balance, drag = body.pose, body.inc, body.balance, body.drag
    if fluid.drag > 0.0:
        _add_drag_columns(beam, pose, inc, drag, balance.sums, newton.transposed)
    add_turn_columns(h, beam, inc, newton.transposed)
    # From turns of elements to turns of joints: joint j turns everything behind it.
    jacobian = newton.jacobian
    n = beam.elements + 2
    for i in range(n):
        jacobian[i, 0] = newton.transposed[0, i]
        jacobian[i, 1] = newton.transposed[1, i]
        behind = 0.0
        for column in range(n - 1, 1, -1):
            behind += newton.transposed[column, i]
            jacobian[i, column] = behind
    add_joint_columns(h, beam, inc, jacobian)


@kernel
def pose_jacobian(h: float, beam: BeamConstants, pose: Pose, mass: Mass, jacobian: Array) -> None:
    """Write minus the derivative of the residual at a vanishing increment to `jacobian`.

    It is put together from the mass of this pose, or in the second half of a composed step of the
    one before, at a tenth of the cost of `step_jacobian`, and differs from that by terms of the
    order of the turns in the step.
    """
    n = beam.elements + 2
    inverse_h = 1.0 / h
    for i in range(n):
        row = jacobian[i]
        for k in range(i):
            row[k] = inverse_h * mass.total[k, i]
        row[i] = inverse_h * mass.diagonal[i]
        for k in range(i + 1, n):
            row[k] = inverse_h * mass.total[i, k]
    add_pose_softening(h, beam, pose, jacobian)
    # From turns of elements to turns of joints: joint j turns everything behind it.
    for i in range(n):
        behind = 0.0
        for column in range(n - 1, 1, -1):
            behind += jacobian[i, column]
            jacobian[i, column] = behind
    add_pose_springs(h, beam, pose, jacobian)
