r"""The variational integrator: Newton's method, its safeguards, and the loop over steps.

A step solves p_n + D1 L_d(q_n, q_{n+1}) + h F/2 = 0 for q_{n+1} and takes
p_{n+1} = p_n + (D1 L_d + D2 L_d) + h F. The second line is the position-momentum form with the
residual of the first carried along: total momentum is then constant to round-off whatever
Newton's tolerance, because D1 L_d + D2 L_d sums to zero over the body.

Newton starts from an extrapolated increment and works in passes: corrections with one matrix while
the shape force, the costly part of the residual, is held, then one evaluation of the whole. Where
passes fail, every correction is followed by a whole evaluation and shortened where need be, from
the same start, then from the rigid-free motion M^-1 p h, then from rest. Where that fails too, or
an element or joint turns by more than half a radian (a sign of a wrong root), the step is cut in
two; the outer step keeps its length and its held torques, and the parts are counted.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.added_mass import (
    NO_FLUID,
    FluidConstants,
    FluidWork,
    added_mass,
    carve_fluid_work,
    fluid_work_sizes,
    hangs_on_shape,
    motion_count,
)
from swim_env.physics.fluid.outline import FluidGeometry, padded
from swim_env.physics.planar.beam import BeamConstants, touches_itself
from swim_env.physics.planar.lagrangian import (
    ADDED_ANGLES,
    CHANGE,
    D3X,
    D3Y,
    DIRECTION,
    DRAG_X,
    DRAG_Y,
    FORCES_P,
    FOUND,
    INCREMENT,
    KEPT,
    MEAN_X,
    MEAN_Y,
    MOMENTUM_X,
    MOMENTUM_Y,
    NET_X,
    NET_Y,
    PART_P,
    PART_Q,
    PART_TOTAL,
    PAST_X,
    PAST_Y,
    PREPARED,
    PREPARED_P,
    PROPOSED,
    PUSH_X,
    PUSH_Y,
    RESIDUAL,
    SAVED_P,
    SAVED_Q,
    SHAPE,
    SHAPE_DIFFERENCE,
    SIN_JOINT,
    SOLVED_FOR,
    START,
    SUM_X,
    SUM_Y,
    TOTAL,
    TRIAL,
    TRIAL_ANGLES,
    VELOCITY,
    StepArrays,
    carve_step_arrays,
    drag_loss,
    drag_moment,
    evaluate_held_step,
    evaluate_step,
    mass_matrix,
    pose_jacobian,
    round_off_floor,
    set_pose,
    step_array_size,
    step_jacobian,
)
from swim_env.physics.runtime.compile import entry_kernel, inlined, kernel, shared
from swim_env.physics.runtime.dense import (
    cholesky,
    cholesky_product,
    cholesky_solve,
    copy,
    dot,
    lu_factor,
    lu_solve,
)
from swim_env.physics.status import (
    ENERGY_UNEXPLAINED,
    FINE,
    MASS_NOT_POSITIVE,
    SELF_CONTACT,
    STATE_NOT_FINITE,
    STEP_NOT_SOLVED,
    TURN_TOO_LARGE,
)

__all__ = [
    "RECORD_NAMES",
    "MemberViews",
    "SolverConstants",
    "advance",
    "energy_drift_of",
    "member_views",
    "pack_constants",
    "prepare",
    "state_size",
    "steps_column",
    "unexplained_share",
    "unpack_constants",
    "weigh",
    "work_sizes",
]

Array = NDArray[np.float64]

#: Largest turn of an element or joint in one (part of a) step (rad).
LARGEST_TURN = 0.5
#: Newton's iterates keep within this turn (rad): the strain softens beyond, and wrong roots wait.
TRUSTED_TURN = 1.0
#: A step is cut into at most 2**MOST_HALVINGS parts.
MOST_HALVINGS = 10
_MOST_ITERATIONS = 20
_MOST_SHORTENINGS = 8
#: A residual within this multiple of the rounding of its terms counts as met.
ROUND_OFF_MARGIN = 32.0
#: But not one that is larger than this and than the tolerance.
_LARGEST_ROUND_OFF = 1e-6

# Passes of corrections with one matrix and the shape force held, and corrections in one of them.
# Each at least halves the correction. The first pass ends where the residual has fallen by this
# factor, later ones at this part of the tolerance.
_MOST_PASSES = 4
_MOST_IN_PASS = 8
_MOST_LAST = 3
#: Where an element turns by more than this in the guess of a step (rad), Newton's matrix is that of
#: the guess; else that of the pose serves, which costs a tenth.
_SMALL_TURN = 0.1
_FIRST_PASS = 1e-4
_PASS_TOLERANCE = 0.1

# Layout of a member's state vector, in rows of N + 2 numbers: q, p, the last three increments and
# the shape forces that belong to them; then the counters: steps taken, increments of equal parts
# that are known (at most 3), and how many 1024ths of a step the last part was; then the energy
# budget (J): the energy that start, work and losses explain, the largest energy, and the largest
# that was not explained.
STATE_ROWS = 8
STEPS, KNOWN_INCREMENTS, LAST_PART, EXPLAINED, LARGEST, UNEXPLAINED = range(6)
_COUNTERS = 6

#: Columns of the record that `advance` writes for every step.
RECORD_NAMES = (
    "energy",
    "work",
    "positive_work",
    "dissipated",
    "residual",
    "iterations",
    "evaluations",
    "parts",
    "at_round_off",
    "impulse_x",
    "impulse_y",
    "angular_impulse",
)
ENERGY, WORK, POSITIVE_WORK, DISSIPATED, RESIDUAL_MET, ITERATIONS = range(6)
EVALUATIONS, PARTS, AT_ROUND_OFF = range(6, 9)
IMPULSE_X, IMPULSE_Y, ANGULAR_IMPULSE = range(9, 12)


class SolverConstants(NamedTuple):
    """What a scene says of the integrator.

    Attributes
    ----------
    time_step : float
        dt (s).
    tolerance : float
        Largest scaled residual accepted.
    evaluation_cost, weighing_cost, matrix_cost : float
        What an evaluation of the residual, one of the added mass, and a matrix of N + 2 rows with
        its factors take, as shares of the effort
        that an outer step may take before it ends unsolved. They hang on sizes alone, not on a
        clock, so that results do not depend on the machine; 0 for no bound.
    composed : bool
        Whether a step is one of half the length followed by its adjoint.
    forces : bool
        Whether internal forces are found and written to the trace.
    energy_tolerance : float
        Share of the largest energy beyond which energy that nothing explains ends a run.
    """

    time_step: float
    tolerance: float
    evaluation_cost: float = 0.0
    weighing_cost: float = 0.0
    matrix_cost: float = 0.0
    composed: bool = False
    forces: bool = False
    energy_tolerance: float = np.inf


def pack_constants(
    beam: BeamConstants, fluid: FluidConstants, solver: SolverConstants
) -> tuple[Array, NDArray[np.int64]]:
    """Return what the entry points need to know of a scene, as two arrays.

    Handing over nested tuples at every call would take longer than all other arguments together.
    """
    geometry = fluid.geometry
    reals = [beam.element_length, beam.element_mass, beam.element_inertia]
    reals += [geometry.half_thickness, fluid.density, solver.time_step, solver.tolerance]
    reals += [beam.contact_radius, fluid.drag, fluid.stream_x, fluid.stream_y]
    reals += [beam.smallest_momentum, beam.smallest_spin]
    reals += [solver.evaluation_cost, solver.weighing_cost, solver.matrix_cost]
    reals += [solver.energy_tolerance]
    integers = [beam.elements, geometry.side_panels, geometry.cap_panels]
    integers += [fluid.model, int(fluid.axial), int(solver.composed)]
    integers += [int(beam.strain_of_angles), int(beam.elastic), int(solver.forces)]
    integers += [int(beam.linear_strain)]
    joints = (beam.joint_stiffness, beam.joint_damping)
    return np.concatenate([reals, *joints, fluid.terms]), np.array(integers, dtype=np.int64)


@shared
def unpack_constants(
    reals: Array, integers: NDArray[np.int64]
) -> tuple[BeamConstants, FluidConstants, SolverConstants]:
    """Return the constants that `pack_constants` has put into arrays."""
    elements = integers[0]
    side_panels = integers[1]
    cap_panels = integers[2]
    model = integers[3]
    first = 17
    last = first + elements - 1
    beam = BeamConstants(
        elements,
        reals[0],
        reals[1],
        reals[2],
        reals[first:last],
        reals[last : last + elements - 1],
        integers[7] == 1,
        integers[6] == 1,
        integers[9] == 1,
        reals[7],
        reals[11],
        reals[12],
    )
    geometry = FluidGeometry(elements, reals[0], reals[3], side_panels, cap_panels)
    fluid = FluidConstants(
        model,
        geometry,
        reals[4],
        integers[4] == 1,
        reals[last + elements - 1 :],
        reals[8],
        reals[9],
        reals[10],
    )
    solver = SolverConstants(
        reals[5],
        reals[6],
        reals[13],
        reals[14],
        reals[15],
        integers[5] == 1,
        integers[8] == 1,
        reals[16],
    )
    return beam, fluid, solver


def state_size(elements: int) -> int:
    """Return the length of a member's state vector."""
    return STATE_ROWS * (elements + 2) + _COUNTERS


def energy_drift_of(state: Array, elements: int) -> float:
    """Return the largest unexplained energy since the start as a share of the largest energy."""
    return float(unexplained_share(state[STATE_ROWS * (elements + 2) :]))


@shared
def unexplained_share(counters: Array) -> float:
    """Return `energy_drift_of` from the counters at the end of a state."""
    if counters[LARGEST] > 0.0:
        return float(counters[UNEXPLAINED] / counters[LARGEST])
    return 0.0


def steps_column(elements: int) -> int:
    """Return the column of a state vector that counts the steps taken."""
    return STATE_ROWS * (elements + 2) + STEPS


def work_sizes(beam: BeamConstants, fluid: FluidConstants) -> tuple[int, int]:
    """Return how many float64 and int64 numbers of work space a member takes."""
    floats, integers = fluid_work_sizes(fluid)
    # A multiple of a cache line, so that rows of panels begin at one in every member's part.
    step = padded(int(step_array_size(beam.elements, int(motion_count(fluid)))))
    return floats + step, integers + beam.elements + 2


class MemberViews(NamedTuple):
    """Views of one member's state and work space."""

    q: Array
    p: Array
    history: Array
    shape_history: Array
    counters: Array
    fluid_work: FluidWork
    step: StepArrays
    permutation: NDArray[np.int64]


@shared
def member_views(
    state: Array,
    beam: BeamConstants,
    fluid: FluidConstants,
    floats: Array,
    integers: NDArray[np.int64],
) -> MemberViews:
    """Lay the names of `MemberViews` over one member's state and work space."""
    n = beam.elements + 2
    motions = motion_count(fluid)
    step_floats = step_array_size(beam.elements, motions)
    fluid_floats = fluid_work_sizes(fluid)[0]
    rows = state[: STATE_ROWS * n].reshape((STATE_ROWS, n))
    return MemberViews(
        rows[0],
        rows[1],
        rows[2:5],
        rows[5:],
        state[STATE_ROWS * n :],
        carve_fluid_work(floats[:fluid_floats], integers[n:], fluid),
        carve_step_arrays(
            floats[fluid_floats : fluid_floats + step_floats], beam.elements, motions
        ),
        integers[:n],
    )


@kernel
def _energy(p: Array, beam: BeamConstants, w: StepArrays) -> float:
    """Return H = p M^-1 p/2 + W (33) (J) of the pose that was prepared."""
    energy = 0.5 * dot(p, w.unknowns[VELOCITY])
    for j in range(beam.joint_stiffness.size):
        sine = w.elements[SIN_JOINT, j]
        energy += 0.5 * beam.joint_stiffness[j] * sine * sine
    return energy


@kernel
def _find_added_mass(
    joint_angles: Array, fluid: FluidConstants, fluid_work: FluidWork, w: StepArrays
) -> int:
    """Evaluate the added mass of a shape unless it is the last one that was evaluated."""
    if fluid.model == NO_FLUID:
        return FINE
    known = w.unknowns[ADDED_ANGLES]
    same = known[0] == 1.0
    if hangs_on_shape(fluid):
        for j in range(joint_angles.size):
            same = same and known[1 + j] == joint_angles[j]
    if same:
        return FINE
    known[0] = 0.0
    w.effort[0] += w.effort[2]
    status = added_mass(joint_angles, fluid, fluid_work, w.added_mass)
    if status == FINE:
        known[0] = 1.0
        for j in range(joint_angles.size):
            known[1 + j] = joint_angles[j]
    return status


@kernel
def prepare(
    q: Array,
    p: Array,
    beam: BeamConstants,
    fluid: FluidConstants,
    fluid_work: FluidWork,
    w: StepArrays,
) -> int:
    """Evaluate everything that hangs on the pose alone, and the velocity M^-1 p.

    The work space remembers which angles its mass stands for, and which momentum its velocity, so
    asking again costs nothing. Positions do not matter to it.
    """
    u = w.unknowns
    for i in range(q.size):
        if not (np.isfinite(q[i]) and np.isfinite(p[i])):
            return STATE_NOT_FINITE
    known = u[PREPARED, 0] == 1.0
    for i in range(2, q.size):
        known = known and u[PREPARED, i] == q[i]
    same = known
    for i in range(q.size):
        same = same and u[PREPARED_P, i] == p[i]
    if same:
        return FINE
    if not known:
        u[PREPARED, 0] = 0.0
        u[PREPARED_P] = np.nan
        set_pose(q, beam, w)
        if beam.contact_radius > 0.0:
            e = w.elements
            radius = beam.contact_radius
            dl = beam.element_length
            if touches_itself(e[D3X], e[D3Y], radius, dl, e[SUM_X], e[SUM_Y]):
                return SELF_CONTACT
        status = _find_added_mass(q[3:], fluid, fluid_work, w)
        if status != FINE:
            return status
        w.effort[0] += w.effort[3]
        mass_matrix(beam, fluid, fluid_work, w)
        if not cholesky(w.mass):
            return MASS_NOT_POSITIVE
        copy(q, u[PREPARED])
        u[PREPARED, 0] = 1.0
    copy(p, u[VELOCITY])
    cholesky_solve(w.mass, u[VELOCITY])
    if not np.isfinite(_energy(p, beam, w)):
        u[PREPARED_P] = np.nan
        return STATE_NOT_FINITE
    copy(p, u[PREPARED_P])
    return FINE


@kernel
def _correction_size(z: Array, dl: float) -> float:
    """Return the largest turn of an element (rad) or shift (element lengths) in an increment."""
    largest: float = max(abs(z[0]), abs(z[1])) / dl
    turn = 0.0
    for k in range(2, z.size):
        turn += z[k]
        if not abs(turn) <= largest:
            largest = abs(turn) if turn == turn else math.inf
    return largest


@kernel
def _evaluate(
    m: MemberViews, torques: Array, z: Array, h: float, beam: BeamConstants, fluid: FluidConstants
) -> float:
    """Evaluate the residual at an increment z with all that hangs on z; infinite where none is.

    That is the shape force, or in the adjoint while it is solved the added mass of the shape at the
    end.
    """
    w = m.step
    w.effort[0] += w.effort[1]
    if w.adjoint[0] != SOLVED_FOR:
        return evaluate_step(m.p, torques, z, h, beam, fluid, m.fluid_work, w)
    angles = w.unknowns[TRIAL_ANGLES]
    for j in range(torques.size):
        angles[j] = m.q[3 + j] + z[3 + j]
    status = _find_added_mass(angles[: torques.size], fluid, m.fluid_work, w)
    if status != FINE:
        w.shape_status[0] = status
        return np.inf
    return evaluate_held_step(m.p, torques, z, h, beam, fluid, w)


@kernel
def _correct_once_more(
    m: MemberViews,
    torques: Array,
    h: float,
    beam: BeamConstants,
    fluid: FluidConstants,
) -> None:
    """Correct the increment after its residual was met, with the shape force that belongs to it.

    This is cheap and as a rule leaves far less than was measured. The residual of a correction that
    brings the increment closer may still rise, so a few are tried before it is left as it was.
    """
    w = m.step
    u = w.unknowns
    z = u[INCREMENT]
    direction = u[DIRECTION]
    copy(z, u[TRIAL])
    for _ in range(_MOST_LAST):
        copy(u[RESIDUAL], direction)
        lu_solve(w.jacobian, m.permutation, direction)
        for i in range(z.size):
            z[i] += direction[i]
        if evaluate_held_step(m.p, torques, z, h, beam, fluid, w) <= w.report[0]:
            return
    copy(u[TRIAL], z)
    evaluate_held_step(m.p, torques, z, h, beam, fluid, w)


@inlined
def _newton_in_passes(
    m: MemberViews,
    torques: Array,
    h: float,
    beam: BeamConstants,
    fluid: FluidConstants,
    solver: SolverConstants,
    shape_known: bool,
) -> bool:
    """Improve the increment in passes during which the shape force is held.

    The shape force takes most of an evaluation and changes little with the increment: with it held,
    a correction costs a tenth, and two or three evaluations of the whole serve a step. Nothing is
    shortened here; False where corrections do not shrink fast enough.

    Whether the shape force's row already holds a guess is said by `shape_known`. The report is
    that of `_newton`.
    """
    w = m.step
    u = w.unknowns
    z = u[INCREMENT]
    direction = u[DIRECTION]
    report = w.report
    report[2] = 0.0
    if shape_known:
        norm = evaluate_held_step(m.p, torques, z, h, beam, fluid, w)
    else:
        norm = _evaluate(m, torques, z, h, beam, fluid)
        report[3] += 1.0
    report[0] = norm
    if not norm < np.inf:
        return False
    if norm <= solver.tolerance and not shape_known:
        return True
    # The mass knows nothing of drag.
    if fluid.drag > 0.0 or _turns_beyond(z, _SMALL_TURN):
        w.effort[0] += w.effort[3]
        step_jacobian(h, beam, fluid, m.fluid_work, 0.0, w)
    else:
        pose_jacobian(h, beam, w)
    if not lu_factor(w.jacobian, m.permutation):
        return False
    # The first pass works with a guess of what is held and need not go far; where nothing is held,
    # it goes all the way.
    held = hangs_on_shape(fluid)
    enough = _FIRST_PASS * norm if held else 0.0
    for _ in range(_MOST_PASSES):
        enough = max(enough, _PASS_TOLERANCE * solver.tolerance)
        size = np.inf
        for _ in range(_MOST_IN_PASS):
            copy(u[RESIDUAL], direction)
            lu_solve(w.jacobian, m.permutation, direction)
            new_size = _correction_size(direction, beam.element_length)
            if not new_size <= 0.5 * size:
                break
            size = new_size
            for i in range(z.size):
                z[i] += direction[i]
            norm = evaluate_held_step(m.p, torques, z, h, beam, fluid, w)
            report[1] += 1.0
            if norm <= enough:
                break
        if held:
            norm = _evaluate(m, torques, z, h, beam, fluid)
            report[3] += 1.0
        report[0] = norm
        enough = 0.0
        if norm <= solver.tolerance:
            # The adjoint's added mass is to stay that of the increment.
            if held and w.adjoint[0] == 0.0:
                _correct_once_more(m, torques, h, beam, fluid)
            return not _turns_beyond(z, TRUSTED_TURN)
        if not held:
            break
    return False


@inlined
def _newton(
    m: MemberViews,
    torques: Array,
    h: float,
    beam: BeamConstants,
    fluid: FluidConstants,
    solver: SolverConstants,
) -> bool:
    """Improve the increment until the residual is met.

    The matrix is kept as long as corrections shrink. Corrections are shortened by Deuflhard's
    natural monotonicity test: the next correction with the same matrix has to be smaller. It does
    not depend on how residuals of turning and of shifting are weighed against each other.

    The report is the scaled residual, the number of corrections tried (added up), 1 where rounding
    kept the residual from falling to the tolerance, and the number of whole evaluations (added up).
    """
    w = m.step
    u = w.unknowns
    z = u[INCREMENT]
    trial = u[TRIAL]
    direction = u[DIRECTION]
    proposed = u[PROPOSED]
    report = w.report
    report[2] = 0.0
    norm = _evaluate(m, torques, z, h, beam, fluid)
    report[3] += 1.0
    report[0] = norm
    if not norm < np.inf:
        return False
    if norm <= solver.tolerance:
        return True
    difference = 0.0
    fresh = False
    renew = True
    size = 0.0
    for _ in range(_MOST_ITERATIONS):
        if renew:
            w.effort[0] += w.effort[3]
            if difference > 0.0 and w.adjoint[0] == 0.0 and hangs_on_shape(fluid):
                w.effort[0] += z.size * w.effort[1]
            if w.effort[0] > 1.0:
                return False
            # Here the last evaluation was that of z.
            step_jacobian(h, beam, fluid, m.fluid_work, difference, w)
            if not lu_factor(w.jacobian, m.permutation):
                return False
            copy(u[RESIDUAL], direction)
            lu_solve(w.jacobian, m.permutation, direction)
            size = _correction_size(direction, beam.element_length)
            fresh = True
            renew = False
        length = 1.0
        accepted = False
        new_size = np.inf
        for _ in range(_MOST_SHORTENINGS):
            if w.effort[0] > 1.0:
                return False
            for i in range(z.size):
                trial[i] = z[i] + length * direction[i]
            if not _turns_beyond(trial, TRUSTED_TURN):
                norm = _evaluate(m, torques, trial, h, beam, fluid)
                report[1] += 1.0
                report[3] += 1.0
                if norm <= solver.tolerance:
                    copy(trial, z)
                    report[0] = norm
                    return True
                copy(u[RESIDUAL], proposed)
                lu_solve(w.jacobian, m.permutation, proposed)
                new_size = _correction_size(proposed, beam.element_length)
                if new_size <= (1.0 - 0.25 * length) * size:
                    accepted = True
                    break
                largest = max(solver.tolerance, _LARGEST_ROUND_OFF)
                if norm <= min(ROUND_OFF_MARGIN * round_off_floor(w), largest):
                    # Rounding keeps the residual from falling further: this is as exact as it
                    # gets.
                    copy(trial, z)
                    report[0] = norm
                    report[2] = 1.0
                    return True
                if not fresh:
                    break
            length *= 0.5
        if accepted:
            copy(trial, z)
            copy(proposed, direction)
            slow = new_size > 0.25 * size
            size = new_size
            report[0] = norm
            fresh = False
            if slow:
                renew = True
                difference = SHAPE_DIFFERENCE
            continue
        if fresh and difference > 0.0:
            return False
        difference = SHAPE_DIFFERENCE
        renew = True
        report[0] = _evaluate(m, torques, z, h, beam, fluid)
        report[3] += 1.0
    return False


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


@inlined
def _solve_part(
    m: MemberViews,
    torques: Array,
    h: float,
    part: int,
    beam: BeamConstants,
    fluid: FluidConstants,
    solver: SolverConstants,
) -> int:
    """Solve one part of a step from several starts; leaves the increment in its row."""
    u = m.step.unknowns
    increment = u[INCREMENT]
    velocity = u[VELOCITY]
    shape = m.step.elements[SHAPE]
    m.step.shape_status[0] = FINE
    status = STEP_NOT_SOLVED
    tried = False
    for start in range(3):
        if start == 0:
            # Extrapolate. Beyond h0 + h1 - h2 the stiff modes, which turn by many radians a
            # step, are carried away.
            if m.counters[KNOWN_INCREMENTS] == 0.0:
                continue
            ratio = part / m.counters[LAST_PART]
            known = m.counters[KNOWN_INCREMENTS] if ratio == 1.0 else 1.0
            for i in range(increment.size):
                increment[i] = ratio * m.history[0, i]
                if known == 3.0:
                    increment[i] += m.history[1, i] - m.history[2, i]
            for k in range(shape.size):
                shape[k] = ratio * ratio * m.shape_history[0, k]
                if known == 3.0:
                    shape[k] += m.shape_history[1, k] - m.shape_history[2, k]
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
            copy(increment, u[START])
            # The adjoint has nothing to guess from: its added mass is that of the end.
            extrapolated = start == 0 and (m.step.adjoint[0] == 0.0 or not hangs_on_shape(fluid))
            solved = _newton_in_passes(m, torques, h, beam, fluid, solver, extrapolated)
            if not solved:
                copy(u[START], increment)
        if solved or _newton(m, torques, h, beam, fluid, solver):
            if not _turns_beyond(increment, LARGEST_TURN):
                return FINE
            status = TURN_TOO_LARGE
    # In the adjoint a shape at the end that cannot be weighed is the reason, if there was one.
    if status == STEP_NOT_SOLVED and m.step.shape_status[0] != FINE:
        status = int(m.step.shape_status[0])
    return status


@kernel
def _begin_forces(m: MemberViews) -> None:
    """Begin to collect momenta; those of the step before count if this state is where it ended."""
    w = m.step
    e = w.elements
    known = w.unknowns[FORCES_P]
    w.forces_known[0] = 1.0 if m.counters[STEPS] > 0.0 else 0.0
    for i in range(known.size):
        if known[i] != m.p[i]:
            w.forces_known[0] = 0.0
    for row in range(4):
        e[MEAN_X + row] = 0.0


@kernel
def _collect_momenta(share: float, fluid: FluidConstants, w: StepArrays) -> None:
    """Add the momenta of a part, a share of the step, to their mean over it, and its drag."""
    e = w.elements
    for k in range(e[MEAN_X].size):
        e[MEAN_X, k] += share * e[MOMENTUM_X, k]
        e[MEAN_Y, k] += share * e[MOMENTUM_Y, k]
        if fluid.drag > 0.0:
            e[PUSH_X, k] += e[DRAG_X, k]
            e[PUSH_Y, k] += e[DRAG_Y, k]


@kernel
def _find_forces(p: Array, time_step: float, w: StepArrays) -> None:
    """Find what every element gets from its neighbours at the beginning of the step.

    That is the change from its mean momentum in the step before to that in this step (with the
    fluid's impulse on its own panels), less half the drag of both. The step ends with momentum p.
    """
    e = w.elements
    for k in range(e[NET_X].size):
        e[NET_X, k] = (e[MEAN_X, k] - 0.5 * e[PUSH_X, k] - e[PAST_X, k]) / time_step
        e[NET_Y, k] = (e[MEAN_Y, k] - 0.5 * e[PUSH_Y, k] - e[PAST_Y, k]) / time_step
        if w.forces_known[0] == 0.0:
            e[NET_X, k] = np.nan
            e[NET_Y, k] = np.nan
        e[PAST_X, k] = e[MEAN_X, k] + 0.5 * e[PUSH_X, k]
        e[PAST_Y, k] = e[MEAN_Y, k] + 0.5 * e[PUSH_Y, k]
    copy(p, w.unknowns[FORCES_P])


@kernel
def _write_forces(w: StepArrays, out: Array) -> None:
    """Write the force (N) on what is in front of each joint by what is behind it, x and y."""
    e = w.elements
    x = 0.0
    y = 0.0
    for j in range(e[NET_X].size - 1):
        x += e[NET_X, j]
        y += e[NET_Y, j]
        out[2 * j] = x
        out[2 * j + 1] = y


@kernel
def _drift(m: MemberViews, h: float, fluid: FluidConstants, record: Array) -> None:
    """Carry the body along with the stream, and record the impulse that comes from outside.

    Increments and momenta are those in the frame that moves with the stream, where the fluid far
    away is at rest; only the position is that in the frame of the ground. The drag pushes at the
    middle of the step; about an origin that moves with the ground, a momentum that is carried along
    gains h U x p.
    """
    w = m.step
    e = w.elements
    z = w.unknowns[INCREMENT]
    push_x = 0.0
    push_y = 0.0
    if fluid.drag > 0.0:
        for k in range(e[DRAG_X].size):
            push_x += e[DRAG_X, k]
            push_y += e[DRAG_Y, k]
        x = m.q[0] + 0.5 * z[0]
        y = m.q[1] + 0.5 * z[1]
        record[ANGULAR_IMPULSE] += drag_moment(w) + x * push_y - y * push_x
    record[IMPULSE_X] += push_x
    record[IMPULSE_Y] += push_y
    drift_x = h * fluid.stream_x
    drift_y = h * fluid.stream_y
    record[ANGULAR_IMPULSE] += drift_x * (m.p[1] + push_y) - drift_y * (m.p[0] + push_x)
    m.q[0] += drift_x
    m.q[1] += drift_y


@kernel
def _keep_budget(counters: Array, record: Array) -> None:
    """Compare the energy after a step with what start, work and losses explain."""
    counters[EXPLAINED] += record[WORK] - record[DISSIPATED]
    counters[LARGEST] = max(counters[LARGEST], record[ENERGY])
    gap = abs(record[ENERGY] - counters[EXPLAINED])
    if not gap <= counters[UNEXPLAINED]:
        counters[UNEXPLAINED] = gap if gap == gap else np.inf


@inlined
def _outer_step(
    m: MemberViews,
    torques: Array,
    beam: BeamConstants,
    fluid: FluidConstants,
    solver: SolverConstants,
    record: Array,
) -> int:
    """Advance one outer step; on failure coordinates and momentum are what they were before."""
    w = m.step
    u = w.unknowns
    whole = 1 << MOST_HALVINGS
    # A step that had to be cut is followed by one that starts with parts twice as long.
    last_part = int(m.counters[LAST_PART])
    part = min(whole, 2 * last_part) if last_part > 0 else whole
    done = 0
    record[:] = 0.0
    report = w.report
    report[:] = 0.0
    copy(m.q, u[SAVED_Q])
    copy(m.p, u[SAVED_P])
    u[TOTAL] = 0.0
    if solver.forces:
        _begin_forces(m)
    status = FINE
    second = False
    begun = False
    while True:
        if not second:
            # A pose that cannot be weighed is not handed out: the run ends at the one before. The
            # next step finds the mass of a good one ready.
            status = prepare(m.q, m.p, beam, fluid, m.fluid_work, w)
            if status != FINE or done == whole:
                break
            if not begun:
                # What the first pose takes hangs on what the work space remembers.
                w.effort[0] = 0.0
                begun = True
        h = solver.time_step * (part / whole)
        if solver.composed:
            h *= 0.5
            if not second:
                copy(m.q, u[PART_Q])
                copy(m.p, u[PART_P])
                copy(u[TOTAL], u[PART_TOTAL])
                copy(record, w.part_record)
                for row in range(4):
                    copy(w.elements[MEAN_X + row], w.elements[KEPT + row])
        w.adjoint[0] = SOLVED_FOR if second else 0.0
        if part < whole and w.effort[0] > 1.0:
            status = STEP_NOT_SOLVED
            break
        outcome = _solve_part(m, torques, h, part, beam, fluid, solver)
        if outcome != FINE:
            if part == 1 or w.effort[0] > 1.0:
                status = outcome
                break
            part //= 2
            if second:
                # Both halves or none.
                second = False
                copy(u[PART_Q], m.q)
                copy(u[PART_P], m.p)
                copy(u[PART_TOTAL], u[TOTAL])
                copy(w.part_record, record)
                for row in range(4):
                    copy(w.elements[KEPT + row], w.elements[MEAN_X + row])
                m.counters[KNOWN_INCREMENTS] = 0.0
            continue
        if second:
            # The change of the momentum wants the shape force at the end.
            w.adjoint[0] = FOUND
            _evaluate(m, torques, u[INCREMENT], h, beam, fluid)
        for j in range(torques.size):
            change = u[INCREMENT, 3 + j]
            record[DISSIPATED] += beam.joint_damping[j] * change * change / h
        if fluid.drag > 0.0:
            record[DISSIPATED] += drag_loss(u[INCREMENT], h, w)
        if solver.forces:
            _collect_momenta(h / solver.time_step, fluid, w)
        if fluid.drag > 0.0 or fluid.stream_x != 0.0 or fluid.stream_y != 0.0:
            _drift(m, h, fluid, record)
        for i in range(m.q.size):
            m.q[i] += u[INCREMENT, i]
            m.p[i] += u[CHANGE, i]
            u[TOTAL, i] += u[INCREMENT, i]
            m.history[2, i] = m.history[1, i]
            m.history[1, i] = m.history[0, i]
            m.history[0, i] = u[INCREMENT, i]
        for k in range(beam.elements):
            m.shape_history[2, k] = m.shape_history[1, k]
            m.shape_history[1, k] = m.shape_history[0, k]
            m.shape_history[0, k] = w.elements[SHAPE, k]
        known = m.counters[KNOWN_INCREMENTS] if part == int(m.counters[LAST_PART]) else 0.0
        m.counters[KNOWN_INCREMENTS] = min(known + 1.0, 3.0)
        m.counters[LAST_PART] = part
        record[RESIDUAL_MET] = max(record[RESIDUAL_MET], report[0])
        record[AT_ROUND_OFF] = max(record[AT_ROUND_OFF], report[2])
        if solver.composed and not second:
            second = True
            set_pose(m.q, beam, w)
            u[PREPARED, 0] = 0.0
            continue
        second = False
        w.adjoint[0] = 0.0
        record[PARTS] += 1.0
        done += part
        # Once two halves have made a whole, try the longer part again.
        if done < whole and done % (2 * part) == 0:
            part *= 2
    if status != FINE:
        copy(u[SAVED_Q], m.q)
        copy(u[SAVED_P], m.p)
        return status
    record[ENERGY] = _energy(m.p, beam, w)
    record[ITERATIONS] = report[1]
    record[EVALUATIONS] = report[3]
    for j in range(torques.size):
        work = torques[j] * u[TOTAL, 3 + j]
        record[WORK] += work
        record[POSITIVE_WORK] += max(work, 0.0)
    m.counters[STEPS] += 1.0
    _keep_budget(m.counters, record)
    if solver.forces:
        _find_forces(m.p, solver.time_step, w)
    return FINE


@entry_kernel
def advance(
    members: NDArray[np.int64],
    states: Array,
    torques: Array,
    hold: int,
    reals: Array,
    sizes: NDArray[np.int64],
    floats: Array,
    integers: NDArray[np.int64],
    trace: Array,
    record: Array,
    velocities: Array,
    outcome: NDArray[np.int64],
) -> None:
    """Advance some members of a batch, each by all its rows of torques.

    Members do not know of each other: what becomes of one depends on its own rows alone, whichever
    members are advanced in the same call or, by other threads, at the same time.

    Parameters
    ----------
    members : (K,) array
        The members to advance, rows of all arrays that begin with M.
    states : (M, S) array
        Their states, see `weigh`; changed in place. At an early end a state is the last one that
        was reached, at the beginning of the step that failed.
    torques : (M, R, N - 1) array
        Joint torques (N m).
    hold : int
        Number of steps over which each row of torques is held.
    reals, sizes : (R,), (10,) arrays
        The scene, from `pack_constants`.
    floats, integers : (M, F), (M, I) arrays
        Work space of `work_sizes`.
    trace : (M, T, 2 (N + 2)) array
        Overwritten: coordinates and momenta after each of the first T steps; T may be 0. Where the
        solver finds internal forces, 2 (N - 1) further columns: x and y of the force (N) with which
        what is behind a joint pulls at what is in front of it, at the step's beginning, a mean over
        this step and the one before; not numbers where that was not taken by this member's work
        space.
    record : (M, R hold, 12) array
        Overwritten: a row of RECORD_NAMES per step; the energy is that at the step's end.
    velocities : (M, N + 2) array
        Overwritten: M^-1 p at the last state: velocity of the mean centre (m/s) and turning rate
        of every element (rad/s).
    outcome : (M, 2) array
        Overwritten: steps taken and 0, or the code of the reason for an early end.
    """
    beam, fluid, solver = unpack_constants(reals, sizes)
    for member in members:
        m = member_views(states[member], beam, fluid, floats[member], integers[member])
        m.step.effort[1] = solver.evaluation_cost
        m.step.effort[2] = solver.weighing_cost
        m.step.effort[3] = solver.matrix_cost
        steps = torques.shape[1] * hold
        taken = 0
        status = FINE
        while taken < steps and status == FINE:
            held = torques[member, taken // hold]
            status = _outer_step(m, held, beam, fluid, solver, record[member, taken])
            if status == FINE:
                if taken < trace.shape[1]:
                    row = trace[member, taken]
                    copy(m.q, row[: m.q.size])
                    copy(m.p, row[m.q.size : 2 * m.q.size])
                    if solver.forces:
                        _write_forces(m.step, row[2 * m.q.size :])
                taken += 1
                # Not more than it should be; infinity times no energy is not a number.
                if m.counters[UNEXPLAINED] > solver.energy_tolerance * m.counters[LARGEST]:
                    status = ENERGY_UNEXPLAINED
        outcome[member, 0] = taken
        outcome[member, 1] = status
        # A state that is handed out has been weighed before, so this does not fail.
        prepare(m.q, m.p, beam, fluid, m.fluid_work, m.step)
        copy(m.step.unknowns[VELOCITY], velocities[member])
        velocities[member, 0] += fluid.stream_x
        velocities[member, 1] += fluid.stream_y


@entry_kernel
def weigh(
    state: Array,
    given: Array,
    start: bool,
    reals: Array,
    sizes: NDArray[np.int64],
    floats: Array,
    integers: NDArray[np.int64],
) -> tuple[float, int]:
    """Evaluate the mass at a member's pose: its energy and velocity, or its start by momentum.

    Parameters
    ----------
    state : (S,) array
        The member's state: q, p, the last three increments and shape forces, and the counters
        that are named in this module.
    given : (N + 2,) array
        Velocity of the mean centre (m/s) and turning rate of every element (rad/s).
        At a start it is read, and p_0 = dL/dq'(q_0, v_0) = M v_0 is written to the state;
        otherwise M^-1 p is written to it.
    start : bool
        Whether this is a start.
    reals, sizes
        As in `advance`.
    floats, integers : (F,), (I,) arrays
        The member's work space.

    Returns
    -------
    energy, status : float, int
        H = p M^-1 p/2 + W (J) and 0, or NaN and the code of the reason why there is none.
    """
    beam, fluid, _ = unpack_constants(reals, sizes)
    m = member_views(state, beam, fluid, floats, integers)
    status = prepare(m.q, m.p, beam, fluid, m.fluid_work, m.step)
    if status != FINE:
        return np.nan, status
    velocity = m.step.unknowns[VELOCITY]
    if start:
        copy(given, velocity)
        velocity[0] -= fluid.stream_x
        velocity[1] -= fluid.stream_y
        m.step.unknowns[PREPARED_P] = np.nan
        cholesky_product(m.step.mass, velocity, m.p)
    else:
        copy(velocity, given)
        given[0] += fluid.stream_x
        given[1] += fluid.stream_y
    energy = _energy(m.p, beam, m.step)
    if start:
        m.counters[EXPLAINED] = energy
        m.counters[LARGEST] = energy
        m.counters[UNEXPLAINED] = 0.0
    return energy, FINE if np.isfinite(energy) else STATE_NOT_FINITE
