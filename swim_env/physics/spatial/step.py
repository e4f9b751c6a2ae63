"""One time step in space: halved where it cannot be solved, ended with a reason if that fails.

As in the plane, see `swim_env.physics.solve.outer_step`: a part solves p_n + D1 L_d + h F/2 = 0 and
takes p_{n+1} = p_n + (D1 L_d + D2 L_d) + h F, so total momenta are constant to round-off whatever
Newton's tolerance. With the composed scheme a part is two halves, the second with the inertia of
its end: both or none. Increments and momenta are those in the frame that moves with the stream,
where the fluid far away is at rest; only the position is that in the frame of the ground.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import kernel
from swim_env.physics.runtime.dense import copy
from swim_env.physics.runtime.linking import linked_kernel
from swim_env.physics.solve.budget import keep_budget
from swim_env.physics.solve.history import extrapolate, remember
from swim_env.physics.solve.outer_step import LARGEST_TURN, WHOLE
from swim_env.physics.solve.state import (
    AT_ROUND_OFF,
    CORRECTIONS,
    DISSIPATED,
    ENERGY,
    EVALUATED,
    EVALUATIONS,
    ITERATIONS,
    KNOWN_INCREMENTS,
    LAST_PART,
    PARTS,
    POSITIVE_WORK,
    RESIDUAL_MET,
    SHAPE_FAILURE,
    STEPS,
    WORK,
)
from swim_env.physics.spatial.chain import Pose, SpatialBeam, set_pose
from swim_env.physics.spatial.constants import SpatialConstants
from swim_env.physics.spatial.equations import new_joint
from swim_env.physics.spatial.layout import TOTAL, Member, OuterStep, State
from swim_env.physics.spatial.newton import evaluate, spatial_newton, turns_beyond
from swim_env.physics.spatial.panels.mass import panel_shape_force
from swim_env.physics.spatial.prepare import energy_of_pose, prepare_spatial
from swim_env.physics.spatial.rotations import (
    inverse_jacobian,
    normalise,
    quaternion_of_vector,
    quaternion_product,
    rotate_back,
)
from swim_env.physics.status import FINE, STEP_NOT_SOLVED, TURN_TOO_LARGE

Array = NDArray[np.float64]


@kernel
def _guess(start: int, h: float, part: int, m: Member) -> None:
    """Guess the increment of a part: from those before it, from the velocity, or none.

    The shape force is guessed from those before it.
    """
    state, body, newton = m.state, m.body, m.newton
    z, shape = newton.increment, body.balance.shape
    if start == 0:
        forces = shape.reshape((shape.size,))
        extrapolate(part, state.history, state.shape_history, state.counters, z, forces)
    elif start == 1:
        velocity = body.mass.velocity
        for i in range(3):
            z[i] = h * velocity[i]
        local = newton.blocks[0, 0]
        for k in range(body.pose.directors.shape[0]):
            first = 3 + 3 * k
            rotate_back(body.pose.directors[k], velocity[first : first + 3], local)
            for i in range(3):
                z[first + i] = h * local[i]
    else:
        z[:] = 0.0


@kernel
def _solve_part(
    m: Member,
    torques: Array,
    h: float,
    part: int,
    adjoint: bool,
    scene: SpatialConstants,
) -> tuple[int, float, bool]:
    """Solve one part of a step from several starts; returns 0 or a reason's code, and as Newton."""
    status = STEP_NOT_SOLVED
    m.step.tally[SHAPE_FAILURE] = FINE
    norm = np.inf
    at_round_off = False
    for start in range(3):
        if start == 0 and m.state.counters[KNOWN_INCREMENTS] == 0.0:
            continue
        _guess(start, h, part, m)
        solved, norm, at_round_off = spatial_newton(m, torques, h, adjoint, scene, start == 0)
        if solved:
            if not turns_beyond(m.newton.increment, LARGEST_TURN):
                return FINE, norm, at_round_off
            status = TURN_TOO_LARGE
        if m.step.effort[0] > 1.0:
            break
    # In the adjoint a shape at the end without added mass is the reason, if there was one.
    if status == STEP_NOT_SOLVED and m.step.tally[SHAPE_FAILURE] != FINE:
        status = int(m.step.tally[SHAPE_FAILURE])
    return status, norm, at_round_off


@kernel
def _move_on(m: Member, h: float, part: int, stream: Array) -> None:
    """Add increment and change of the momentum to the state, and keep them for the next guess.

    The stream carries the body along.
    """
    state, body, newton = m.state, m.body, m.newton
    q, z = state.q, newton.increment
    for j in range(body.pose.joints.shape[0]):
        new_joint(q, z, j, newton.quaternions)
        joint = q[7 + 4 * j : 11 + 4 * j]
        copy(newton.quaternions[0], joint)
        normalise(joint)
    quaternion_of_vector(z[3:6], newton.quaternions[0])
    quaternion_product(1.0, q[3:7], newton.quaternions[0], newton.quaternions[1])
    copy(newton.quaternions[1], q[3:7])
    normalise(q[3:7])
    for i in range(3):
        q[i] += z[i]
        if stream[i] != 0.0:
            q[i] += h * stream[i]
    for i in range(z.size):
        state.p[i] += body.balance.change[i]
    shape = body.balance.shape.reshape((body.balance.shape.size,))
    remember(part, z, shape, state.history, state.shape_history, state.counters)


@kernel
def _joint_rate(j: int, pose: Pose, velocity: Array, work: Array) -> None:
    """Write theta_j' = J_r^-1 omega_b - J_l^-1 omega_a to the last of four rows (4, 3) (rad/s)."""
    rotate_back(pose.directors[j + 1], velocity[6 + 3 * j : 9 + 3 * j], work[0])
    inverse_jacobian(1.0, pose.angles[j], work[0], work[1])
    rotate_back(pose.directors[j], velocity[3 + 3 * j : 6 + 3 * j], work[0])
    inverse_jacobian(-1.0, pose.angles[j], work[0], work[2])
    for i in range(3):
        work[3, i] = work[1, i] - work[2, i]


@kernel
def _loss(h: float, second: bool, composed: bool, beam: SpatialBeam, m: Member) -> float:
    """Return the energy (J) that damping took in a part, or keep what its first half did for later.

    In a composed part impulses act at the ends of its halves, so what they take is their product
    with the mean of H's rates there; products with the halves' own increments overstate it, see
    `swim_env.physics.solve.outer_step`.
    """
    body, step = m.body, m.step
    loss = 0.0
    work = m.newton.vectors
    for j in range(beam.elements - 1):
        if composed and not second:
            _joint_rate(j, body.pose, body.mass.velocity, work)
        for i in range(3):
            change = body.inc.angles[j, i] - body.pose.angles[j, i]
            impulse = beam.damping[j, i] * change
            if not composed:
                loss += impulse * change / h
            elif not second:
                step.losses[0, j, i] = impulse
                step.losses[1, j, i] = work[3, i]
            else:
                step.losses[2, j, i] = impulse
    return loss


@kernel
def _loss_of_halves(h: float, beam: SpatialBeam, m: Member) -> float:
    """Return the energy (J) that damping took in a composed part of length h that has ended."""
    step, pose, work = m.step, m.body.pose, m.newton.vectors
    loss = 0.0
    for j in range(beam.elements - 1):
        _joint_rate(j, pose, m.body.mass.velocity, work)
        for i in range(3):
            first, second = step.losses[0, j, i], step.losses[2, j, i]
            moved = pose.angles[j, i] - step.part_angles[j, i]
            loss += (first + second) * moved / h
            loss += 0.25 * (second - first) * (work[3, i] - step.losses[1, j, i])
    return loss


@kernel
def _keep_part(state: State, pose: Pose, step: OuterStep, record: Array) -> None:
    """Note where a part begins, so that it can be taken back after its first half."""
    copy(state.q, step.part_q)
    copy(state.p, step.part_p)
    copy(record, step.part_record)
    for j in range(pose.angles.shape[0]):
        copy(pose.angles[j], step.part_angles[j])


@linked_kernel
def spatial_step(
    m: Member,
    torques: Array,
    scene: SpatialConstants,
    record: Array,
) -> int:
    """Advance one outer step; on failure coordinates and momentum are what they were before."""
    state, body, newton, step = m.state, m.body, m.newton, m.step
    beam, fluid, solver = scene.beam, scene.fluid, scene.solver
    pose, mass = body.pose, body.mass
    counters = state.counters
    # A step that had to be cut is followed by one that starts with parts twice as long.
    last_part = int(counters[LAST_PART])
    part = min(WHOLE, 2 * last_part) if last_part > 0 else WHOLE
    done = 0
    record[:] = 0.0
    step.tally[:] = 0
    copy(state.q, step.q)
    copy(state.p, step.p)
    status = FINE
    half = 0
    begun = False
    # Length of the last composed part, whose losses are known once the velocity at its end is.
    pending = 0.0
    while True:
        second = half == 1
        if not second:
            status = prepare_spatial(m, scene)
            if status == FINE and pending > 0.0:
                record[DISSIPATED] += _loss_of_halves(pending, beam, m)
                pending = 0.0
            if status != FINE or done == WHOLE:
                break
            if not begun:
                # What the first pose takes depends on what the work space remembers.
                step.effort[0] = 0.0
                for j in range(pose.angles.shape[0]):
                    copy(pose.angles[j], step.angles[j])
                begun = True
        h = solver.time_step * (part / WHOLE)
        if solver.composed:
            h *= 0.5
            if not second:
                _keep_part(state, pose, step, record)
        if part < WHOLE and step.effort[0] > 1.0:
            status = STEP_NOT_SOLVED
            break
        outcome, norm, at_round_off = _solve_part(m, torques, h, part, second, scene)
        if outcome != FINE:
            if part == 1 or step.effort[0] > 1.0:
                status = outcome
                break
            part //= 2
            if second:
                # Both halves or none.
                half = 0
                copy(step.part_q, state.q)
                copy(step.part_p, state.p)
                copy(step.part_record, record)
                counters[KNOWN_INCREMENTS] = 0.0
            continue
        if second and fluid.varies:
            # The change of the momentum needs the shape force at the end.
            panel_shape_force(
                body.inc.directors, body.inc.motion, scene.surface, m.panels, body.balance.shape
            )
            evaluate(m, torques, newton.increment, h, second, scene)
        record[DISSIPATED] += _loss(h, second, solver.composed, beam, m)
        _move_on(m, h, part, fluid.stream)
        record[RESIDUAL_MET] = max(record[RESIDUAL_MET], norm)
        record[AT_ROUND_OFF] = max(record[AT_ROUND_OFF], 1.0 if at_round_off else 0.0)
        if solver.composed and not second:
            half = 1
            set_pose(state.q, pose)
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
        return status
    record[ENERGY] = energy_of_pose(state.p, beam, body)
    record[ITERATIONS] = step.tally[CORRECTIONS]
    record[EVALUATIONS] = step.tally[EVALUATED]
    for j in range(torques.shape[0]):
        for i in range(3):
            work = torques[j, i] * (pose.angles[j, i] - step.angles[j, i])
            record[WORK] += work
            record[POSITIVE_WORK] += max(work, 0.0)
    counters[STEPS] += 1.0
    keep_budget(counters, record)
    return FINE
