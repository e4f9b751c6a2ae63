r"""One time step of a scene: halved where it cannot be solved, ended with a reason if that fails.

A part solves p_n + D1 L_d(q_n, q_{n+1}) + h F/2 = 0 for q_{n+1} and takes
p_{n+1} = p_n + (D1 L_d + D2 L_d) + h F. The second line is the position-momentum form with the
residual of the first carried along: total momentum is then constant to round-off whatever
Newton's tolerance, because D1 L_d + D2 L_d sums to zero over the body.

Newton starts from an extrapolated increment, then from the rigid-free motion M^-1 p h, then from
rest. Where none of them leads to a solution, or an element or joint turns by more than half a
radian (a sign of a wrong root), the part is halved; the outer step keeps its length and its held
torques, and the parts are counted. With the composed scheme a part is two halves, the second with
the inertia of its end: both or none.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.layout import FluidConstants
from swim_env.physics.planar.chain import BeamConstants
from swim_env.physics.planar.drag import drag_loss, drag_moment
from swim_env.physics.planar.equations import evaluate_step, set_pose
from swim_env.physics.planar.layout import TOTAL, Body, Drag, Increment, Pose
from swim_env.physics.runtime.compile import embedded, inlined, kernel
from swim_env.physics.runtime.dense import copy
from swim_env.physics.runtime.linking import linked_kernel
from swim_env.physics.solve.budget import keep_budget
from swim_env.physics.solve.constants import SolverConstants
from swim_env.physics.solve.forces import add_momenta, begin_forces, find_forces
from swim_env.physics.solve.history import extrapolate, remember
from swim_env.physics.solve.newton import newton_in_passes, newton_with_shortening, turns_beyond
from swim_env.physics.solve.prepare import energy_of_pose, prepare
from swim_env.physics.solve.state import (
    ANGULAR_IMPULSE,
    AT_ROUND_OFF,
    CORRECTIONS,
    DISSIPATED,
    ENERGY,
    EVALUATED,
    EVALUATIONS,
    IMPULSE_X,
    IMPULSE_Y,
    ITERATIONS,
    KNOWN_INCREMENTS,
    LAST_PART,
    PARTS,
    POSITIVE_WORK,
    RESIDUAL_MET,
    SHAPE_FAILURE,
    STEPS,
    WORK,
    ForceWork,
    Member,
    OuterStep,
    State,
)
from swim_env.physics.status import FINE, STEP_NOT_SOLVED, TURN_TOO_LARGE

Array = NDArray[np.float64]

#: Largest turn of an element or joint in one (part of a) step (rad).
LARGEST_TURN = 0.5
#: A step is cut into at most 2**MOST_HALVINGS parts.
MOST_HALVINGS = 10
#: Length of a whole step in the smallest parts.
WHOLE = 1 << MOST_HALVINGS


@embedded
def _solve_part(
    m: Member,
    torques: Array,
    h: float,
    part: int,
    adjoint: bool,
    beam: BeamConstants,
    fluid: FluidConstants,
    solver: SolverConstants,
) -> tuple[int, float, bool]:
    """Solve one part of a step from several starts; leaves the increment in its row.

    Returns
    -------
    status, norm, at_round_off : int, float, bool
        0 or a reason's code, and as `newton`.
    """
    state, body, newton, step = m.state, m.body, m.newton, m.step
    increment = newton.increment
    velocity = body.mass.velocity
    step.tally[SHAPE_FAILURE] = FINE
    status = STEP_NOT_SOLVED
    tried = False
    norm = np.inf
    at_round_off = False
    for start in range(3):
        if start == 0:
            if state.counters[KNOWN_INCREMENTS] == 0.0:
                continue
            extrapolate(
                part,
                state.history,
                state.shape_history,
                state.counters,
                increment,
                body.balance.shape,
            )
        elif start == 1:
            increment[0] = h * velocity[0]
            increment[1] = h * velocity[1]
            increment[2] = h * velocity[2]
            for k in range(3, increment.size):
                increment[k] = h * (velocity[k] - velocity[k - 1])
        else:
            increment[:] = 0.0
        if tried and step.effort[0] > 1.0:
            break
        solved = False
        in_passes = False
        if not tried:
            tried = True
            copy(increment, newton.start)
            at_round_off = False
            guessed = adjoint or start == 0
            solved, norm = newton_in_passes(m, torques, h, adjoint, beam, fluid, solver, guessed)
            in_passes = solved
            if not solved:
                copy(newton.start, increment)
        if not solved:
            solved, norm, at_round_off = newton_with_shortening(
                m, torques, h, adjoint, beam, fluid, solver
            )
        if solved:
            if not turns_beyond(increment, LARGEST_TURN):
                if adjoint and fluid.varies:
                    if in_passes:
                        copy(newton.lag, state.lag)
                    else:
                        state.lag[:] = 0.0
                return FINE, norm, at_round_off
            status = TURN_TOO_LARGE
    # In the adjoint a shape at the end without added mass is the reason, if there was one.
    if status == STEP_NOT_SOLVED and step.tally[SHAPE_FAILURE] != FINE:
        status = int(step.tally[SHAPE_FAILURE])
    return status, norm, at_round_off


@inlined
def _drift(
    state: State,
    z: Array,
    h: float,
    fluid: FluidConstants,
    pose: Pose,
    inc: Increment,
    drag: Drag,
    record: Array,
) -> None:
    """Carry the body along with the stream, and record the impulse that comes from outside.

    Increments and momenta are those in the frame that moves with the stream, where the fluid far
    away is at rest; only the position is that in the frame of the ground. The drag pushes at the
    middle of the step; about an origin that moves with the ground, a momentum that is carried along
    gains h U x p.
    """
    q = state.q
    p = state.p
    push_x = 0.0
    push_y = 0.0
    if fluid.drag > 0.0:
        for k in range(drag.moment.size):
            push_x += drag.impulse[0, k]
            push_y += drag.impulse[1, k]
        x = q[0] + 0.5 * z[0]
        y = q[1] + 0.5 * z[1]
        record[ANGULAR_IMPULSE] += drag_moment(pose, inc, drag) + x * push_y - y * push_x
    record[IMPULSE_X] += push_x
    record[IMPULSE_Y] += push_y
    drift_x = h * fluid.stream_x
    drift_y = h * fluid.stream_y
    record[ANGULAR_IMPULSE] += drift_x * (p[1] + push_y) - drift_y * (p[0] + push_x)
    q[0] += drift_x
    q[1] += drift_y


@kernel
def _keep_part(state: State, step: OuterStep, forces: ForceWork, record: Array) -> None:
    """Note where a part begins, so that it can be taken back after its first half."""
    copy(state.q, step.part_q)
    copy(state.p, step.part_p)
    copy(state.inertia, step.part_inertia)
    copy(step.total, step.part_total)
    copy(record, step.part_record)
    for i in range(2):
        copy(forces.mean[i], forces.part_mean[i])
        copy(forces.push[i], forces.part_push[i])


@kernel
def _take_back_part(state: State, step: OuterStep, forces: ForceWork, record: Array) -> None:
    """Go back to where the part began."""
    copy(step.part_q, state.q)
    copy(step.part_p, state.p)
    copy(step.part_inertia, state.inertia)
    copy(step.part_total, step.total)
    copy(step.part_record, record)
    for i in range(2):
        copy(forces.part_mean[i], forces.mean[i])
        copy(forces.part_push[i], forces.push[i])
    state.counters[KNOWN_INCREMENTS] = 0.0
    state.lag[:] = 0.0


@kernel
def _keep_losses(
    second: bool, increment: Array, beam: BeamConstants, body: Body, drag: float, losses: Array
) -> None:
    """Note the impulses of damping and drag in a half of a composed part, as in `losses`."""
    pose, inc, work, mass = body.pose, body.inc, body.drag, body.mass
    if not second:
        losses[:2] = 0.0
        copy(mass.velocity, losses[2])
    sign = 1.0 if second else -1.0
    for row in range(2):
        part = 1.0 if row == 0 else sign
        for j in range(beam.elements - 1):
            impulse = part * beam.joint_damping[j] * increment[3 + j]
            losses[row, 2 + j] += impulse
            losses[row, 3 + j] -= impulse
        if drag > 0.0:
            for k in range(beam.elements):
                losses[row, 0] += part * work.impulse[0, k]
                losses[row, 1] += part * work.impulse[1, k]
                mean_x = 0.5 * (pose.d1[0, k] + inc.new_d1[0, k])
                mean_y = 0.5 * (pose.d1[1, k] + inc.new_d1[1, k])
                arm = mean_x * work.lever[0, k] + mean_y * work.lever[1, k]
                losses[row, 2 + k] += part * (work.moment[k] + arm)


@kernel
def _loss_of_halves(h: float, step: OuterStep, velocity: Array) -> float:
    """Return the energy (J) that damping and drag took in a composed part of length h.

    Impulses act at the ends of the halves, so what they take is their product with the mean of H's
    velocities there. Products with the halves' own increments overstate it: the first half moves by
    the inertia of its start and the second by that of its end, and a loss has the square of what
    this makes their rates differ by. The velocity in the middle, whose mass is not known, is the
    one with which the trapezoidal rule gives the increment of both halves.
    """
    losses = step.losses
    loss = 0.0
    moved = 0.0
    for i in range(velocity.size):
        change = step.total[i] - step.part_total[i]
        # Coordinates count angles from element to element, momenta from the ground.
        moved = moved + change if i > 2 else change
        change_of_rate = velocity[i] - losses[2, i]
        loss -= losses[0, i] * moved / h + 0.25 * losses[1, i] * change_of_rate
    return loss


@linked_kernel
def outer_step(
    m: Member,
    torques: Array,
    beam: BeamConstants,
    fluid: FluidConstants,
    solver: SolverConstants,
    record: Array,
) -> int:
    """Advance one outer step; on failure coordinates and momentum are what they were before."""
    state, body, newton, step, forces = m.state, m.body, m.newton, m.step, m.forces
    pose, inc, balance, drag, mass = body.pose, body.inc, body.balance, body.drag, body.mass
    counters = state.counters
    increment = newton.increment
    # A step that had to be cut is followed by one that starts with parts twice as long.
    last_part = int(counters[LAST_PART])
    part = min(WHOLE, 2 * last_part) if last_part > 0 else WHOLE
    done = 0
    record[:] = 0.0
    step.tally[:] = 0
    copy(state.q, step.q)
    copy(state.p, step.p)
    copy(state.lag, step.lag)
    copy(state.inertia, step.inertia)
    step.total[:] = 0.0
    if solver.forces:
        begin_forces(forces)
    status = FINE
    half = 0
    begun = False
    # Length of the last composed part, whose losses are known once the velocity at its end is.
    pending = 0.0
    while True:
        # Compared, not assigned: kernels are not compiled once more for a literal False.
        second = half == 1
        adjoint = second
        if not second:
            # A pose without mass is not handed out: the run ends at the one before. The next step
            # finds the mass of a good one ready.
            status = prepare(state, beam, fluid, solver, body, m.fluid_work, newton, step.effort)
            if status == FINE and pending > 0.0:
                record[DISSIPATED] += _loss_of_halves(pending, step, mass.velocity)
                pending = 0.0
            if status != FINE or done == WHOLE:
                break
            if not begun:
                # What the first pose takes depends on what the work space remembers.
                step.effort[0] = 0.0
                begun = True
        h = solver.time_step * (part / WHOLE)
        if solver.composed:
            h *= 0.5
            if not second:
                _keep_part(state, step, forces, record)
                if part != int(counters[LAST_PART]):
                    state.lag[:] = 0.0
        if part < WHOLE and step.effort[0] > 1.0:
            status = STEP_NOT_SOLVED
            break
        outcome, norm, at_round_off = _solve_part(m, torques, h, part, adjoint, beam, fluid, solver)
        if outcome != FINE:
            if part == 1 or step.effort[0] > 1.0:
                status = outcome
                break
            part //= 2
            if second:
                # Both halves or none.
                half = 0
                _take_back_part(state, step, forces, record)
            continue
        if adjoint:
            # The change of the momentum needs the shape force at the end.
            step.effort[0] += solver.evaluation_cost
            evaluate_step(
                state.p, torques, increment, h, True, False, beam, fluid, body, m.fluid_work
            )
        if solver.composed:
            _keep_losses(second, increment, beam, body, fluid.drag, step.losses)
        else:
            for j in range(torques.size):
                change = increment[3 + j]
                record[DISSIPATED] += beam.joint_damping[j] * change * change / h
            if fluid.drag > 0.0:
                record[DISSIPATED] += drag_loss(increment, h, inc, drag)
        if solver.forces:
            add_momenta(h / solver.time_step, fluid.drag > 0.0, balance, drag, forces)
        if fluid.drag > 0.0 or fluid.stream_x != 0.0 or fluid.stream_y != 0.0:
            _drift(state, increment, h, fluid, pose, inc, drag, record)
        for i in range(increment.size):
            state.q[i] += increment[i]
            state.p[i] += balance.change[i]
            step.total[i] += increment[i]
        remember(part, increment, balance.shape, state.history, state.shape_history, state.counters)
        copy(mass.shape if adjoint and fluid.varies else state.q[3:], state.inertia)
        record[RESIDUAL_MET] = max(record[RESIDUAL_MET], norm)
        record[AT_ROUND_OFF] = max(record[AT_ROUND_OFF], 1.0 if at_round_off else 0.0)
        if solver.composed and not second:
            half = 1
            set_pose(state.q, beam, pose)
            mass.known[TOTAL] = 0
            continue
        half = 0
        if solver.composed:
            pending = 2.0 * h
        record[PARTS] += 1.0
        done += part
        # Once two halves have made a whole, try the longer part again.
        if done < WHOLE and done % (2 * part) == 0:
            part *= 2
    if status != FINE:
        copy(step.q, state.q)
        copy(step.p, state.p)
        copy(step.lag, state.lag)
        copy(step.inertia, state.inertia)
        return status
    record[ENERGY] = energy_of_pose(state.p, beam, pose, mass)
    record[ITERATIONS] = step.tally[CORRECTIONS]
    record[EVALUATIONS] = step.tally[EVALUATED]
    for j in range(torques.size):
        work = torques[j] * step.total[3 + j]
        record[WORK] += work
        record[POSITIVE_WORK] += max(work, 0.0)
    if solver.forces:
        find_forces(solver.time_step, forces, state)
    counters[STEPS] += 1.0
    keep_budget(counters, record)
    return FINE
