"""The integrator's entry points for Python: steps of members, energy and momentum of a state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import entry_kernel
from swim_env.physics.runtime.dense import cholesky_product, copy
from swim_env.physics.solve.budget import begin_budget
from swim_env.physics.solve.constants import constants_at
from swim_env.physics.solve.forces import write_forces
from swim_env.physics.solve.outer_step import outer_step
from swim_env.physics.solve.prepare import energy_of_pose, prepare
from swim_env.physics.solve.state import member_at, unexplained_share
from swim_env.physics.status import ENERGY_UNEXPLAINED, FINE, STATE_NOT_FINITE

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@entry_kernel
def advance(
    members: Integers,
    places: Integers,
    torques: Array,
    hold: int,
    constants: Integers,
    trace: Array,
    record: Array,
    velocities: Array,
    outcome: Integers,
) -> None:
    """Advance some members of a batch, each by all its rows of torques.

    Members are independent: the results of one depend on its own rows alone, whichever
    members are advanced in the same call or, by other threads, at the same time.

    Parameters
    ----------
    members : (K,) array
        The members to advance, rows of all arrays that begin with M.
    places : (M, W) array
        The words of every `swim_env.physics.solve.state.Member`. Their states are changed in place.
        At an early end a state is the last one that was reached, at the beginning of the step that
        failed.
    torques : (M, R, N - 1) array
        Joint torques (N m).
    hold : int
        Number of steps over which each row of torques is held.
    constants : (C,) array
        The words of the scene's `swim_env.physics.solve.constants.Constants`.
    trace : (M, T, 2 (N + 2)) array
        Overwritten: coordinates and momenta after each of the first T steps; T may be 0. Where the
        solver finds internal forces, 2 (N - 1) further columns: x and y of the force (N) with which
        what is behind a joint pulls at what is in front of it, at the step's beginning, a mean over
        this step and the one before; not numbers in the first step after a start.
    record : (M, R hold, 12) array
        Overwritten: a row of RECORD_NAMES per step; the energy is that at the step's end.
    velocities : (M, N + 2) array
        Overwritten: M^-1 p at the last state: velocity of the mean centre (m/s) and turning rate
        of every element (rad/s).
    outcome : (M, 2) array
        Overwritten: steps taken and 0, or the code of the reason for an early end.
    """
    scene = constants_at(constants)
    beam, fluid, solver = scene.beam, scene.fluid, scene.solver
    for member in members:
        m = member_at(places[member])
        q = m.state.q
        p = m.state.p
        steps = torques.shape[1] * hold
        taken = 0
        status = FINE
        while taken < steps and status == FINE:
            held = torques[member, taken // hold]
            status = outer_step(m, held, beam, fluid, solver, record[member, taken])
            if status == FINE:
                if taken < trace.shape[1]:
                    row = trace[member, taken]
                    copy(q, row[: q.size])
                    copy(p, row[q.size : 2 * q.size])
                    if solver.forces:
                        write_forces(m.forces, row[2 * q.size :])
                taken += 1
                if unexplained_share(m.state.counters) > solver.energy_tolerance:
                    status = ENERGY_UNEXPLAINED
        outcome[member, 0] = taken
        outcome[member, 1] = status
        # A state that is handed out has been prepared before, so this does not fail.
        prepare(m.state, beam, fluid, solver, m.body, m.fluid_work, m.newton, m.step.effort)
        copy(m.body.mass.velocity, velocities[member])
        velocities[member, 0] += fluid.stream_x
        velocities[member, 1] += fluid.stream_y


@entry_kernel
def energy_and_velocity(
    velocity: Array,
    constants: Integers,
    place: Integers,
) -> tuple[float, int]:
    """Find a member's energy, and its velocity M^-1 p.

    Parameters
    ----------
    velocity : (N + 2,) array
        Overwritten: velocity of the mean centre (m/s) and turning rate of every element (rad/s).
    constants
        As in `advance`.
    place : (W,) array
        The words of the member.

    Returns
    -------
    energy, status : float, int
        H = p M^-1 p/2 + W (J) and 0, or NaN and the code of the reason why there is none.
    """
    scene, m = constants_at(constants), member_at(place)
    beam, fluid, solver = scene.beam, scene.fluid, scene.solver
    status = prepare(m.state, beam, fluid, solver, m.body, m.fluid_work, m.newton, m.step.effort)
    if status != FINE:
        return np.nan, status
    copy(m.body.mass.velocity, velocity)
    velocity[0] += fluid.stream_x
    velocity[1] += fluid.stream_y
    energy = energy_of_pose(m.state.p, beam, m.body.pose, m.body.mass)
    return energy, FINE if np.isfinite(energy) else STATE_NOT_FINITE


@entry_kernel
def momentum_of_velocity(
    velocity: Array,
    constants: Integers,
    place: Integers,
) -> float:
    """Start a member by momentum: write p_0 = dL/dq'(q_0, v_0) = M v_0 to its state.

    Call `energy_and_velocity` before: it prepares the mass of the pose. Parameters as there, with
    `velocity` read.

    Returns
    -------
    float
        The energy of the start, H = p M^-1 p/2 + W (J).
    """
    scene, m = constants_at(constants), member_at(place)
    beam, fluid = scene.beam, scene.fluid
    copy(velocity, m.body.mass.velocity)
    m.body.mass.velocity[0] -= fluid.stream_x
    m.body.mass.velocity[1] -= fluid.stream_y
    m.body.mass.momentum[:] = np.nan
    cholesky_product(m.body.mass.total, m.body.mass.velocity, m.state.p)
    energy = energy_of_pose(m.state.p, beam, m.body.pose, m.body.mass)
    begin_budget(energy, m.state.counters)
    return energy
