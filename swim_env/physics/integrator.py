r"""The variational integrator: Newton's method, its safeguards, and the loop over steps.

A step solves p_n + D1 L_d(q_n, q_{n+1}) + h F/2 = 0 for q_{n+1} and takes
p_{n+1} = p_n + (D1 L_d + D2 L_d) + h F. The second line is the position-momentum form with the
residual of the first carried along: total momentum is then constant to round-off whatever
Newton's tolerance, because D1 L_d + D2 L_d sums to zero over the body.

Newton starts from an extrapolated increment, then from the rigid-free motion M^-1 p h, then from
rest; steps are shortened until the scaled residual falls. Where that fails, or an element or joint
turns by more than half a radian (a sign of a wrong root), the step is cut in two; the outer step
keeps its length and its held torques, and the parts are counted.
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
    added_mass,
    carve_fluid_work,
    fluid_work_sizes,
    motion_count,
)
from swim_env.physics.beam import BeamConstants, strain_energy
from swim_env.physics.dense import (
    cholesky,
    cholesky_solve,
    dot,
    lu_factor,
    lu_solve,
    mat_vec,
    matrix_view,
)
from swim_env.physics.lagrangian import (
    StepArrays,
    carve_step_arrays,
    evaluate_step,
    mass_matrix,
    round_off_floor,
    set_pose,
    step_array_size,
    step_jacobian,
)
from swim_env.physics.status import (
    FINE,
    MASS_NOT_POSITIVE,
    STATE_NOT_FINITE,
    STEP_NOT_SOLVED,
    TURN_TOO_LARGE,
)

__all__ = [
    "RECORD_NAMES",
    "SCHEMES",
    "SolverConstants",
    "advance",
    "begin",
    "measure",
    "state_size",
    "work_sizes",
]

Array = NDArray[np.float64]

#: Integration schemes that a scene may name, and their codes.
SCHEMES: dict[str, int] = {"paper": 0}

#: Largest turn of an element or joint in one (part of a) step (rad).
LARGEST_TURN = 0.5
#: Newton's iterates keep within this turn (rad): the strain softens beyond, and wrong roots wait.
TRUSTED_TURN = 1.0
#: A step is cut into at most 2**MOST_HALVINGS parts.
MOST_HALVINGS = 10
_MOST_ITERATIONS = 20
_MOST_LINE_SEARCHES = 8

# Layout of a member's state vector, in rows of N + 2 numbers: q, p, the last three increments;
# then the counters.
_STATE_ROWS = 5
_COUNTERS = 2

#: Columns of the record that `advance` writes for every step.
RECORD_NAMES = (
    "energy",
    "work",
    "positive_work",
    "dissipated",
    "residual",
    "iterations",
    "parts",
    "at_round_off",
)


class SolverConstants(NamedTuple):
    """What a scene says of the integrator.

    Attributes
    ----------
    time_step : float
        dt (s).
    tolerance : float
        Largest scaled residual accepted.
    most_solves : int
        Bound on the attempts to solve a part of one outer step.
    """

    time_step: float
    tolerance: float
    most_solves: int


def state_size(elements: int) -> int:
    """Return the length of a member's state vector."""
    return _STATE_ROWS * (elements + 2) + _COUNTERS


def work_sizes(beam: BeamConstants, fluid: FluidConstants) -> tuple[int, int]:
    """Return how many float64 and int64 numbers of work space a member takes."""
    floats, integers = fluid_work_sizes(fluid)
    return (
        floats + int(step_array_size(beam.elements, int(motion_count(fluid)))),
        integers + beam.elements + 2,
    )


class _Member(NamedTuple):
    """Views of one member's state and work space."""

    q: Array
    p: Array
    history: Array
    counters: Array
    fluid_work: FluidWork
    step: StepArrays
    permutation: NDArray[np.int64]


@kernel
def _member(
    state: Array,
    beam: BeamConstants,
    fluid: FluidConstants,
    floats: Array,
    integers: NDArray[np.int64],
) -> _Member:
    n = beam.elements + 2
    motions = motion_count(fluid)
    used = step_array_size(beam.elements, motions)
    rows = matrix_view(state, 0, _STATE_ROWS, n)
    return _Member(
        rows[0],
        rows[1],
        rows[2:],
        state[_STATE_ROWS * n :],
        carve_fluid_work(floats[used:], integers[n:], fluid),
        carve_step_arrays(floats[:used], beam.elements, motions),
        integers[:n],
    )


@kernel
def _prepare(
    q: Array,
    p: Array,
    beam: BeamConstants,
    fluid: FluidConstants,
    fluid_work: FluidWork,
    w: StepArrays,
) -> int:
    """Evaluate everything that hangs on the pose alone, and the velocity M^-1 p."""
    for i in range(q.size):
        if not (np.isfinite(q[i]) and np.isfinite(p[i])):
            return STATE_NOT_FINITE
    set_pose(q, w)
    if fluid.model != NO_FLUID:
        status = added_mass(q[3:], fluid, fluid_work, w.added_mass)
        if status != FINE:
            return status
    mass_matrix(beam, fluid, fluid_work, w)
    if not cholesky(w.mass):
        return MASS_NOT_POSITIVE
    w.velocity[:] = p
    cholesky_solve(w.mass, w.velocity)
    return FINE


@kernel
def _energy(q: Array, p: Array, beam: BeamConstants, w: StepArrays) -> float:
    """Return H = p M^-1 p/2 + W (J) after `_prepare`."""
    return 0.5 * dot(p, w.velocity) + strain_energy(q, beam.joint_stiffness)


@kernel
def _newton(
    q: Array,
    p: Array,
    torques: Array,
    h: float,
    beam: BeamConstants,
    fluid: FluidConstants,
    solver: SolverConstants,
    fluid_work: FluidWork,
    w: StepArrays,
    permutation: NDArray[np.int64],
    report: Array,
) -> bool:
    """Improve `w.increment` until the residual is met; report = (residual, iterations, floor)."""
    z = w.increment
    norm = evaluate_step(q, p, torques, z, h, beam, fluid, fluid_work, w)
    report[0] = norm
    report[2] = 0.0
    if not norm < np.inf:
        return False
    fresh = False
    factored = False
    with_shape = False
    for _ in range(_MOST_ITERATIONS):
        if norm <= solver.tolerance:
            return True
        if not factored:
            step_jacobian(q, z, h, beam, fluid, fluid_work, with_shape, w)
            if not lu_factor(w.jacobian, permutation):
                return False
            factored = True
            fresh = True
        w.direction[:] = w.residual
        lu_solve(w.jacobian, permutation, w.direction)
        length = 1.0
        accepted = False
        new_norm = norm
        for _ in range(_MOST_LINE_SEARCHES):
            for i in range(z.size):
                w.trial[i] = z[i] + length * w.direction[i]
            if not _turns_beyond(w.trial, TRUSTED_TURN):
                new_norm = evaluate_step(q, p, torques, w.trial, h, beam, fluid, fluid_work, w)
                report[1] += 1.0
                if new_norm <= (1.0 - 1e-2 * length) * norm:
                    accepted = True
                    break
                if not fresh or new_norm <= 1e3 * round_off_floor(w):
                    break
            length *= 0.5
        if accepted:
            z[:] = w.trial
            # A slowly falling residual asks for a better Jacobian at the new place.
            factored = new_norm <= 0.3 * norm
            with_shape = with_shape or (fresh and new_norm > 0.3 * norm)
            fresh = False
            norm = new_norm
            report[0] = norm
            continue
        norm = evaluate_step(q, p, torques, z, h, beam, fluid, fluid_work, w)
        if norm <= 32.0 * round_off_floor(w):
            # Rounding keeps the residual from falling further; the step is as exact as it gets.
            report[2] = 1.0
            return True
        if fresh and with_shape:
            return False
        with_shape = with_shape or fresh
        factored = False
    return norm <= solver.tolerance


@kernel
def _turns_beyond(z: Array, limit: float) -> bool:
    """Tell whether an element or a joint turns by more than a limit (rad), or by no number."""
    turn = 0.0
    for k in range(2, z.size):
        turn += z[k]
        if not (abs(turn) <= limit):
            return True
        if k > 2 and not (abs(z[k]) <= limit):
            return True
    return False


@kernel
def _solve_part(
    q: Array,
    p: Array,
    history: Array,
    histories: int,
    ratio: float,
    torques: Array,
    h: float,
    beam: BeamConstants,
    fluid: FluidConstants,
    solver: SolverConstants,
    fluid_work: FluidWork,
    w: StepArrays,
    permutation: NDArray[np.int64],
    report: Array,
) -> int:
    """Solve one part of a step from several starts; leaves the increment in `w.increment`."""
    status = STEP_NOT_SOLVED
    for start in range(3):
        if start == 0:
            if histories == 0:
                continue
            for i in range(q.size):
                if histories >= 3:
                    w.increment[i] = ratio * (history[0, i] + history[1, i] - history[2, i])
                else:
                    w.increment[i] = ratio * history[0, i]
        elif start == 1:
            w.increment[0] = h * w.velocity[0]
            w.increment[1] = h * w.velocity[1]
            w.increment[2] = h * w.velocity[2]
            for k in range(3, q.size):
                w.increment[k] = h * (w.velocity[k] - w.velocity[k - 1])
        else:
            w.increment[:] = 0.0
        if _newton(
            q, p, torques, h, beam, fluid, solver, fluid_work, w, permutation, report
        ):
            if not _turns_beyond(w.increment, LARGEST_TURN):
                return FINE
            status = TURN_TOO_LARGE
    return status


@kernel
def _outer_step(
    q: Array,
    p: Array,
    history: Array,
    counters: Array,
    torques: Array,
    beam: BeamConstants,
    fluid: FluidConstants,
    solver: SolverConstants,
    fluid_work: FluidWork,
    w: StepArrays,
    permutation: NDArray[np.int64],
    report: Array,
    record: Array,
) -> int:
    """Advance one outer step; on failure the state is what it was before."""
    unknowns = q.size
    whole = 1 << MOST_HALVINGS
    part = whole
    done = 0
    solves = 0
    record[:] = 0.0
    report[:] = 0.0
    status = _prepare(q, p, beam, fluid, fluid_work, w)
    if status != FINE:
        return status
    record[0] = _energy(q, p, beam, w)
    w.saved[0, :] = q
    w.saved[1, :] = p
    w.total[:] = 0.0
    # Increments of parts of a step scale with the parts: remember the length of the last one.
    last_part = whole
    histories = int(counters[1])
    prepared = True
    while done < whole:
        h = solver.time_step * (part / whole)
        if not prepared:
            status = _prepare(q, p, beam, fluid, fluid_work, w)
        if status == FINE:
            prepared = True
            status = _solve_part(
                q,
                p,
                history if part == last_part == whole else w.saved[2:],
                histories,
                part / last_part,
                torques,
                h,
                beam,
                fluid,
                solver,
                fluid_work,
                w,
                permutation,
                report,
            )
            solves += 1
        if status != FINE:
            if part == 1 or solves >= solver.most_solves or not prepared:
                q[:] = w.saved[0]
                p[:] = w.saved[1]
                return status
            part //= 2
            status = FINE
            if last_part == whole:
                w.saved[2, :] = history[0]
                histories = min(histories, 1)
            continue
        for i in range(unknowns):
            q[i] += w.increment[i]
            p[i] += w.change[i]
            w.total[i] += w.increment[i]
            w.saved[2, i] = w.increment[i]
        for j in range(torques.size):
            record[3] += beam.joint_damping[j] * w.increment[3 + j] * w.increment[3 + j] / h
        record[4] = max(record[4], report[0])
        record[6] += 1.0
        record[7] = max(record[7], report[2])
        done += part
        last_part = part
        histories = 1
        prepared = False
        # Two halves make a whole again once the two are done: try the longer part.
        if part < whole and done % (2 * part) == 0 and done < whole:
            part *= 2
    record[5] = report[1]
    for j in range(torques.size):
        work = torques[j] * w.total[3 + j]
        record[1] += work
        record[2] += max(work, 0.0)
    history[2, :] = history[1]
    history[1, :] = history[0]
    history[0, :] = w.total
    counters[1] = min(counters[1] + 1.0, 3.0) if record[6] == 1.0 else 1.0
    counters[0] += 1.0
    return FINE


@kernel
def advance(
    state: Array,
    torques: Array,
    beam: BeamConstants,
    fluid: FluidConstants,
    solver: SolverConstants,
    floats: Array,
    integers: NDArray[np.int64],
    trace_q: Array,
    trace_p: Array,
    record: Array,
) -> tuple[int, int]:
    """Advance one member by as many steps as there are rows of torques.

    Parameters
    ----------
    state : (S,) array
        The member's state, see `begin`; changed in place. At an early end it is the last state
        that was reached, at the beginning of the step that failed.
    torques : (T, N - 1) array
        Joint torques held over each step (N m).
    beam, fluid, solver : BeamConstants, FluidConstants, SolverConstants
        The scene.
    floats, integers : arrays
        Work space of `work_sizes`.
    trace_q, trace_p : (T, N + 2) arrays
        Overwritten: coordinates and momenta after each step.
    record : (T, 8) array
        Overwritten: a row of RECORD_NAMES per step; the energy is that at the step's beginning.

    Returns
    -------
    steps, status : int
        Steps taken and 0, or the code of the reason for an early end.
    """
    m = _member(state, beam, fluid, floats, integers)
    report = np.zeros(3)
    for step in range(torques.shape[0]):
        status = _outer_step(
            m.q,
            m.p,
            m.history,
            m.counters,
            torques[step],
            beam,
            fluid,
            solver,
            m.fluid_work,
            m.step,
            m.permutation,
            report,
            record[step],
        )
        if status != FINE:
            return step, status
        trace_q[step, :] = m.q
        trace_p[step, :] = m.p
    return torques.shape[0], FINE


@kernel
def begin(
    state: Array,
    q: Array,
    velocity: Array,
    beam: BeamConstants,
    fluid: FluidConstants,
    floats: Array,
    integers: NDArray[np.int64],
) -> int:
    """Start a member at a pose and velocity, by momentum: p_0 = dL/dq'(q_0, v_0) = M v_0.

    Parameters
    ----------
    state : (S,) array
        Overwritten: q, p, the last three increments, the number of steps taken and the number
        of increments that are known.
    q : (N + 2,) array
        Minimal coordinates (m, m, rad).
    velocity : (N + 2,) array
        Velocity of the mean centre (m/s) and turning rate of every element (rad/s).
    beam, fluid, floats, integers
        As in `advance`.

    Returns
    -------
    int
        0, or the code of the reason why the pose cannot be simulated.
    """
    state[:] = 0.0
    m = _member(state, beam, fluid, floats, integers)
    m.q[:] = q
    status = _prepare(m.q, m.p, beam, fluid, m.fluid_work, m.step)
    if status != FINE:
        return status
    mass_matrix(beam, fluid, m.fluid_work, m.step)
    mat_vec(m.step.mass, velocity, m.p)
    return FINE


@kernel
def measure(
    state: Array,
    beam: BeamConstants,
    fluid: FluidConstants,
    floats: Array,
    integers: NDArray[np.int64],
    velocity: Array,
) -> tuple[float, int]:
    """Return the energy H (J) of a state and a status; write M^-1 p (N + 2,) to velocity."""
    m = _member(state, beam, fluid, floats, integers)
    status = _prepare(m.q, m.p, beam, fluid, m.fluid_work, m.step)
    if status != FINE:
        return np.nan, status
    velocity[:] = m.step.velocity
    return _energy(m.q, m.p, beam, m.step), FINE
