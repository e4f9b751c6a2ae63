r"""One step of the scene's time step, in as many parts as it takes.

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

from swim_env.physics.fluid.added_mass import FluidConstants, depends_on_shape
from swim_env.physics.planar.chain import BeamConstants
from swim_env.physics.planar.drag import drag_loss, drag_moment
from swim_env.physics.planar.equations import evaluate_step, set_pose
from swim_env.physics.planar.layout import TOTAL
from swim_env.physics.runtime.compile import inlined, kernel
from swim_env.physics.runtime.dense import copy
from swim_env.physics.solve.budget import keep_budget
from swim_env.physics.solve.constants import SolverConstants
from swim_env.physics.solve.forces import add_momenta, begin_forces, find_forces
from swim_env.physics.solve.newton import newton, newton_in_passes, turns_beyond
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
    Member,
)
from swim_env.physics.status import FINE, STEP_NOT_SOLVED, TURN_TOO_LARGE

__all__ = ["LARGEST_TURN", "MOST_HALVINGS", "outer_step"]

Array = NDArray[np.float64]

#: Largest turn of an element or joint in one (part of a) step (rad).
LARGEST_TURN = 0.5
#: A step is cut into at most 2**MOST_HALVINGS parts.
MOST_HALVINGS = 10
_WHOLE = 1 << MOST_HALVINGS


@kernel
def _extrapolate(
    part: int, history: Array, shape_history: Array, counters: Array, increment: Array, shape: Array
) -> None:
    """Guess increment and shape force of a part from those before it.

    Beyond h0 + h1 - h2 the stiff modes, which turn by many radians a step, are carried away.
    """
    ratio = part / counters[LAST_PART]
    known = counters[KNOWN_INCREMENTS] if ratio == 1.0 else 1.0
    for i in range(increment.size):
        increment[i] = ratio * history[0, i]
        if known == 3.0:
            increment[i] += history[1, i] - history[2, i]
    for k in range(shape.size):
        shape[k] = ratio * ratio * shape_history[0, k]
        if known == 3.0:
            shape[k] += shape_history[1, k] - shape_history[2, k]


@inlined
def _solve_part(
    m: Member,
    torques: Array,
    h: float,
    part: int,
    at_end: bool,
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
    increment = m.newton.increment
    velocity = m.mass.velocity
    m.step.tally[SHAPE_FAILURE] = FINE
    status = STEP_NOT_SOLVED
    tried = False
    norm = np.inf
    at_round_off = False
    for start in range(3):
        if start == 0:
            if m.state.counters[KNOWN_INCREMENTS] == 0.0:
                continue
            _extrapolate(
                part,
                m.state.history,
                m.state.shape_history,
                m.state.counters,
                increment,
                m.balance.shape,
            )
        elif start == 1:
            increment[0] = h * velocity[0]
            increment[1] = h * velocity[1]
            increment[2] = h * velocity[2]
            for k in range(3, increment.size):
                increment[k] = h * (velocity[k] - velocity[k - 1])
        else:
            increment[:] = 0.0
        if tried and m.step.effort[0] > 1.0:
            break
        solved = False
        if not tried:
            tried = True
            copy(increment, m.newton.start)
            # The adjoint has nothing to guess from: its added mass is that of the end.
            extrapolated = start == 0 and (not at_end or not depends_on_shape(fluid))
            at_round_off = False
            solved, norm = newton_in_passes(
                m, torques, h, at_end, beam, fluid, solver, extrapolated
            )
            if not solved:
                copy(m.newton.start, increment)
        if not solved:
            solved, norm, at_round_off = newton(m, torques, h, at_end, beam, fluid, solver)
        if solved:
            if not turns_beyond(increment, LARGEST_TURN):
                return FINE, norm, at_round_off
            status = TURN_TOO_LARGE
    # In the adjoint a shape at the end without added mass is the reason, if there was one.
    if status == STEP_NOT_SOLVED and m.step.tally[SHAPE_FAILURE] != FINE:
        status = int(m.step.tally[SHAPE_FAILURE])
    return status, norm, at_round_off


@inlined
def _drift(m: Member, h: float, fluid: FluidConstants, record: Array) -> None:
    """Carry the body along with the stream, and record the impulse that comes from outside.

    Increments and momenta are those in the frame that moves with the stream, where the fluid far
    away is at rest; only the position is that in the frame of the ground. The drag pushes at the
    middle of the step; about an origin that moves with the ground, a momentum that is carried along
    gains h U x p.
    """
    q = m.state.q
    p = m.state.p
    z = m.newton.increment
    push_x = 0.0
    push_y = 0.0
    if fluid.drag > 0.0:
        for k in range(m.drag.moment.size):
            push_x += m.drag.impulse[0, k]
            push_y += m.drag.impulse[1, k]
        x = q[0] + 0.5 * z[0]
        y = q[1] + 0.5 * z[1]
        record[ANGULAR_IMPULSE] += drag_moment(m.pose, m.inc, m.drag) + x * push_y - y * push_x
    record[IMPULSE_X] += push_x
    record[IMPULSE_Y] += push_y
    drift_x = h * fluid.stream_x
    drift_y = h * fluid.stream_y
    record[ANGULAR_IMPULSE] += drift_x * (p[1] + push_y) - drift_y * (p[0] + push_x)
    q[0] += drift_x
    q[1] += drift_y


@inlined
def _keep_part(m: Member, record: Array) -> None:
    """Note where a part begins, so that it can be taken back after its first half."""
    step = m.step
    copy(m.state.q, step.part_q)
    copy(m.state.p, step.part_p)
    copy(step.total, step.part_total)
    copy(record, step.part_record)
    for i in range(2):
        copy(m.forces.mean[i], m.forces.part_mean[i])
        copy(m.forces.push[i], m.forces.part_push[i])


@inlined
def _take_back_part(m: Member, record: Array) -> None:
    """Go back to where the part began."""
    step = m.step
    copy(step.part_q, m.state.q)
    copy(step.part_p, m.state.p)
    copy(step.part_total, step.total)
    copy(step.part_record, record)
    for i in range(2):
        copy(m.forces.part_mean[i], m.forces.mean[i])
        copy(m.forces.part_push[i], m.forces.push[i])
    m.state.counters[KNOWN_INCREMENTS] = 0.0


@inlined
def _move_on(m: Member, part: int) -> None:
    """Add increment and change of the momentum to the state, and keep them for the next guess."""
    state = m.state
    increment = m.newton.increment
    for i in range(increment.size):
        state.q[i] += increment[i]
        state.p[i] += m.balance.change[i]
        m.step.total[i] += increment[i]
        state.history[2, i] = state.history[1, i]
        state.history[1, i] = state.history[0, i]
        state.history[0, i] = increment[i]
    for k in range(m.balance.shape.size):
        state.shape_history[2, k] = state.shape_history[1, k]
        state.shape_history[1, k] = state.shape_history[0, k]
        state.shape_history[0, k] = m.balance.shape[k]
    counters = state.counters
    known = counters[KNOWN_INCREMENTS] if part == int(counters[LAST_PART]) else 0.0
    counters[KNOWN_INCREMENTS] = min(known + 1.0, 3.0)
    counters[LAST_PART] = part


@inlined
def outer_step(
    m: Member,
    torques: Array,
    beam: BeamConstants,
    fluid: FluidConstants,
    solver: SolverConstants,
    record: Array,
) -> int:
    """Advance one outer step; on failure coordinates and momentum are what they were before."""
    step = m.step
    counters = m.state.counters
    increment = m.newton.increment
    # A step that had to be cut is followed by one that starts with parts twice as long.
    last_part = int(counters[LAST_PART])
    part = min(_WHOLE, 2 * last_part) if last_part > 0 else _WHOLE
    done = 0
    record[:] = 0.0
    step.tally[:] = 0
    copy(m.state.q, step.q)
    copy(m.state.p, step.p)
    step.total[:] = 0.0
    if solver.forces:
        begin_forces(m.forces)
    status = FINE
    second = False
    begun = False
    while True:
        if not second:
            # A pose without mass is not handed out: the run ends at the one before. The next step
            # finds the mass of a good one ready.
            status = prepare(
                m.state.q,
                m.state.p,
                beam,
                fluid,
                solver,
                m.fluid_work,
                m.mass,
                m.pose,
                m.inc,
                m.balance,
                m.newton,
                step.effort,
            )
            if status != FINE or done == _WHOLE:
                break
            if not begun:
                # What the first pose takes depends on what the work space remembers.
                step.effort[0] = 0.0
                begun = True
        h = solver.time_step * (part / _WHOLE)
        if solver.composed:
            h *= 0.5
            if not second:
                _keep_part(m, record)
        if part < _WHOLE and step.effort[0] > 1.0:
            status = STEP_NOT_SOLVED
            break
        outcome, norm, at_round_off = _solve_part(m, torques, h, part, second, beam, fluid, solver)
        if outcome != FINE:
            if part == 1 or step.effort[0] > 1.0:
                status = outcome
                break
            part //= 2
            if second:
                # Both halves or none.
                second = False
                _take_back_part(m, record)
            continue
        if second:
            # The change of the momentum needs the shape force at the end.
            step.effort[0] += solver.evaluation_cost
            evaluate_step(
                m.state.p,
                torques,
                increment,
                h,
                True,
                beam,
                fluid,
                m.fluid_work,
                m.mass.added,
                m.pose,
                m.inc,
                m.balance,
                m.drag,
            )
        for j in range(torques.size):
            change = increment[3 + j]
            record[DISSIPATED] += beam.joint_damping[j] * change * change / h
        if fluid.drag > 0.0:
            record[DISSIPATED] += drag_loss(increment, h, m.inc, m.drag)
        if solver.forces:
            add_momenta(h / solver.time_step, fluid.drag > 0.0, m.balance, m.drag, m.forces)
        if fluid.drag > 0.0 or fluid.stream_x != 0.0 or fluid.stream_y != 0.0:
            _drift(m, h, fluid, record)
        _move_on(m, part)
        record[RESIDUAL_MET] = max(record[RESIDUAL_MET], norm)
        record[AT_ROUND_OFF] = max(record[AT_ROUND_OFF], 1.0 if at_round_off else 0.0)
        if solver.composed and not second:
            second = True
            set_pose(m.state.q, beam, m.pose)
            m.mass.known[TOTAL] = 0
            continue
        second = False
        record[PARTS] += 1.0
        done += part
        # Once two halves have made a whole, try the longer part again.
        if done < _WHOLE and done % (2 * part) == 0:
            part *= 2
    if status != FINE:
        copy(step.q, m.state.q)
        copy(step.p, m.state.p)
        return status
    record[ENERGY] = energy_of_pose(m.state.p, beam, m.pose, m.mass)
    record[ITERATIONS] = step.tally[CORRECTIONS]
    record[EVALUATIONS] = step.tally[EVALUATED]
    for j in range(torques.size):
        work = torques[j] * step.total[3 + j]
        record[WORK] += work
        record[POSITIVE_WORK] += max(work, 0.0)
    if solver.forces:
        find_forces(solver.time_step, m.forces, m.state)
    counters[STEPS] += 1.0
    keep_budget(counters, record)
    return FINE
