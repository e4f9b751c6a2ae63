"""Newton's method for the increment of a step.

It works in passes: corrections with a matrix that learns from them while the shape force, the
costly part of the residual, is held, then one evaluation of the whole. Where passes fail, every
correction is followed by a whole evaluation and shortened where need be.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.layout import FluidConstants, FluidWork
from swim_env.physics.planar.chain import BeamConstants
from swim_env.physics.planar.equations import (
    evaluate_step,
    round_off_floor,
)
from swim_env.physics.planar.layout import MOST_LEARNT, Body, Newton
from swim_env.physics.planar.matrix import (
    SHAPE_DIFFERENCE,
    adjoint_jacobian,
    pose_jacobian,
    step_jacobian,
)
from swim_env.physics.runtime.compile import inlined, kernel
from swim_env.physics.runtime.dense import copy, dot, lu_factor, lu_solve
from swim_env.physics.runtime.linking import linked_kernel
from swim_env.physics.solve.constants import SolverConstants
from swim_env.physics.solve.prepare import find_added_mass
from swim_env.physics.solve.state import (
    CORRECTIONS,
    EVALUATED,
    LEARNT,
    SHAPE_FAILURE,
    Member,
    OuterStep,
)
from swim_env.physics.status import FINE

Array = NDArray[np.float64]

#: Newton's iterates keep within this turn (rad): the strain softens beyond, and wrong roots wait.
TRUSTED_TURN = 1.0
MOST_ITERATIONS = 20
MOST_SHORTENINGS = 8
#: A residual within this multiple of the rounding of its terms counts as met.
ROUND_OFF_MARGIN = 32.0
#: But not one that is larger than this and than the tolerance.
LARGEST_ROUND_OFF = 1e-6

# Passes of corrections with the shape force held, and corrections in one of them, each of which has
# to be smaller than the one before.
_MOST_PASSES = 4
_MOST_IN_PASS = 8
_MOST_LAST = 3
#: Where an element turns by more than this in the guess of a step (rad), Newton's matrix is that of
#: the guess; else that of the pose serves, which costs a tenth.
_SMALL_TURN = 0.1
# A pass ends where the residual is below this part of the tolerance.
_PASS_TOLERANCE = 0.1
# The first one works with a guess, and may end earlier: where the residual has fallen by this
# factor, or is below this part of the tolerance; with a guess of the added mass, which is off by
# more, below the tolerance itself.
_FIRST_PASS = 1e-4
_FIRST_TOLERANCE = 0.3
# Estimated change of the residual per radian of turn, or per element length of shift, since what is
# held was evaluated. Measured were at most 0.1.
_CHANGE_WITH_SHAPE = 0.25


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
def turns_beyond(z: Array, limit: float) -> bool:
    """Return whether an element or a joint turns by more than a limit (rad), or by NaN."""
    turn = 0.0
    for k in range(2, z.size):
        turn += z[k]
        if not (abs(turn) <= limit):
            return True
        if k > 2 and not (abs(z[k]) <= limit):
            return True
    return False


@kernel
def _evaluate(
    q: Array,
    p: Array,
    torques: Array,
    z: Array,
    h: float,
    adjoint: bool,
    beam: BeamConstants,
    fluid: FluidConstants,
    solver: SolverConstants,
    body: Body,
    fluid_work: FluidWork,
    step: OuterStep,
) -> float:
    """Evaluate the residual at an increment z with all that depends on z; infinite where none is.

    That is the shape force, or in the adjoint the added mass of the shape at the end.
    """
    step.effort[0] += solver.evaluation_cost
    step.tally[EVALUATED] += 1
    if adjoint:
        mass = body.mass
        shape = mass.trial_shape[: torques.size]
        for j in range(torques.size):
            shape[j] = q[3 + j] + z[3 + j]
        status = find_added_mass(shape, fluid, solver, fluid_work, mass, step.effort)
        step.tally[SHAPE_FAILURE] = status
        if status != FINE:
            return np.inf
    # The residual of the adjoint has no shape force.
    return evaluate_step(p, torques, z, h, adjoint, adjoint, beam, fluid, body, fluid_work)


@kernel
def _inner(a: Array, b: Array, dl: float) -> float:
    """Return the scalar product of two increments, shifts measured in element lengths."""
    product: float = (a[0] * b[0] + a[1] * b[1]) / (dl * dl) + dot(a[2:], b[2:])
    return product


@kernel
def _correct(residual: Array, dl: float, chained: bool, learnt: int, newton: Newton) -> int:
    """Write the correction that a residual asks for to `newton.correction`.

    The matrix is off by some percent, and every correction shows where: Broyden's good update, by
    the products of Kelley, Solving Nonlinear Equations with Newton's Method (2003), sect. 4.2.

    Parameters
    ----------
    residual : (N + 2,) array
        What is to become zero.
    dl : float
        Length of an element (m).
    chained : bool
        Whether this residual is what the last correction left of the same equations.
    learnt : int
        Number of corrections that the matrix has learnt from since it was factorised.
    newton : Newton
        Corrections are kept in `steps` and `answers`.

    Returns
    -------
    int
        The number of them now.
    """
    correction = newton.correction
    copy(residual, correction)
    lu_solve(newton.jacobian, newton.permutation, correction)
    for j in range(learnt):
        step = newton.steps[j]
        share = _inner(step, correction, dl) / _inner(step, step, dl)
        for i in range(correction.size):
            correction[i] += share * newton.answers[j, i]
    if chained and learnt < MOST_LEARNT:
        step = newton.steps[learnt]
        share = _inner(step, correction, dl) / _inner(step, step, dl)
        # Not where half of it or more is left or was too much, and not where it was zero.
        if abs(share) < 0.5:
            for i in range(correction.size):
                correction[i] /= 1.0 - share
            copy(correction, newton.answers[learnt])
            learnt += 1
    copy(correction, newton.steps[learnt])
    return learnt


@inlined
def _correct_once_more(
    met: float,
    learnt: int,
    p: Array,
    torques: Array,
    h: float,
    beam: BeamConstants,
    fluid: FluidConstants,
    body: Body,
    fluid_work: FluidWork,
    newton: Newton,
) -> None:
    """Correct the increment after its residual was met, with the shape force that belongs to it.

    This is cheap and usually leaves far less than was measured. The residual of a correction that
    brings the increment closer may still rise, so a few are tried before it is left as it was.
    """
    z = newton.increment
    balance = body.balance
    copy(z, newton.trial)
    for number in range(_MOST_LAST):
        learnt = _correct(balance.residual, beam.element_length, number > 0, learnt, newton)
        for i in range(z.size):
            z[i] += newton.correction[i]
        norm = evaluate_step(p, torques, z, h, False, True, beam, fluid, body, fluid_work)
        if norm <= met:
            return
    copy(newton.trial, z)
    evaluate_step(p, torques, z, h, False, True, beam, fluid, body, fluid_work)


@linked_kernel
def newton_in_passes(
    m: Member,
    torques: Array,
    h: float,
    adjoint: bool,
    beam: BeamConstants,
    fluid: FluidConstants,
    solver: SolverConstants,
    guessed: bool,
) -> tuple[bool, float]:
    """Improve the increment in passes during which the shape force is held.

    The shape force takes most of an evaluation and changes little with the increment: with it held,
    a correction costs a tenth, and two or three evaluations of the whole serve a step. Nothing is
    shortened here.

    Parameters
    ----------
    m : Member
        The member; `newton.increment` is improved.
    torques : (N - 1,) array
        Joint torques (N m).
    h : float
        Length of the step (s).
    adjoint : bool
        Whether the step is that of the adjoint map, with the inertia of its end.
    beam, fluid, solver : BeamConstants, FluidConstants, SolverConstants
        The scene.
    guessed : bool
        Whether to start with what is held as it is, without evaluating it first: `balance.shape`, a
        guess of the shape force, or in the adjoint `mass.added`, that of the part's beginning. The
        increment that this gives an adjoint is then moved by `state.lag`.

    Returns
    -------
    solved, norm : bool, float
        False where corrections grow or there is no matrix or added mass, and
        the residual's norm; where what is held was not evaluated once more, with an estimate of
        what that would add. `newton.lag` is the next `state.lag` of an adjoint.
    """
    state, body, fluid_work, newton, step = m.state, m.body, m.fluid_work, m.newton, m.step
    q, p = state.q, state.p
    balance = body.balance
    z = newton.increment
    if not adjoint:
        step.tally[LEARNT] = -1
    if guessed:
        norm = evaluate_step(p, torques, z, h, adjoint, True, beam, fluid, body, fluid_work)
    else:
        norm = _evaluate(q, p, torques, z, h, adjoint, beam, fluid, solver, body, fluid_work, step)
        copy(z, newton.whole)
    if not norm < np.inf:
        return False, norm
    if norm <= solver.tolerance and not guessed:
        return True, norm
    # The matrix of the pose has no drag in it.
    own_matrix = fluid.drag > 0.0 or turns_beyond(z, _SMALL_TURN)
    learnt = step.tally[LEARNT]
    # The second half of a step goes on with the first one's, which is that of nearly its own pose.
    if own_matrix or learnt < 0:
        learnt = 0
        if not own_matrix:
            pose_jacobian(h, beam, body.pose, body.mass, newton.jacobian)
        else:
            step.effort[0] += solver.matrix_cost
            if adjoint:
                adjoint_jacobian(h, beam, fluid, body, newton)
            else:
                step_jacobian(h, 0.0, beam, fluid, body, fluid_work, newton)
        if not lu_factor(newton.jacobian, newton.permutation):
            return False, norm
    # The first pass works with a guess of what is held and need not go far; where nothing is held,
    # it goes all the way.
    held = fluid.varies
    enough = _PASS_TOLERANCE * solver.tolerance
    if held:
        part = 1.0 if adjoint and guessed else _FIRST_TOLERANCE
        enough = max(_FIRST_PASS * norm, part * solver.tolerance)
    accepted = False
    for number in range(_MOST_PASSES):
        size = np.inf
        for place in range(_MOST_IN_PASS):
            learnt = _correct(balance.residual, beam.element_length, place > 0, learnt, newton)
            new_size = _correction_size(newton.correction, beam.element_length)
            if not new_size <= size:
                break
            size = new_size
            for i in range(z.size):
                z[i] += newton.correction[i]
            norm = evaluate_step(p, torques, z, h, adjoint, True, beam, fluid, body, fluid_work)
            step.tally[CORRECTIONS] += 1
            if norm <= enough:
                break
        if held and guessed and number == 0:
            if adjoint:
                copy(z, newton.held)
                for i in range(z.size):
                    z[i] += state.lag[i]
        elif held:
            for i in range(z.size):
                newton.correction[i] = z[i] - newton.whole[i]
            moved = _correction_size(newton.correction, beam.element_length)
            if norm + _CHANGE_WITH_SHAPE * moved <= solver.tolerance:
                accepted = True
                norm += _CHANGE_WITH_SHAPE * moved
        if held and not accepted:
            norm = _evaluate(
                q, p, torques, z, h, adjoint, beam, fluid, solver, body, fluid_work, step
            )
            if not norm < np.inf:
                return False, norm
            copy(z, newton.whole)
            # The adjoint's added mass is to stay that of the increment.
            accepted = norm <= solver.tolerance
            if accepted and not adjoint:
                _correct_once_more(
                    norm, learnt, p, torques, h, beam, fluid, body, fluid_work, newton
                )
        elif not held:
            accepted = norm <= solver.tolerance
        enough = _PASS_TOLERANCE * solver.tolerance
        if accepted:
            step.tally[LEARNT] = learnt
            if held and adjoint and guessed:
                for i in range(z.size):
                    newton.lag[i] = z[i] - newton.held[i]
            return not turns_beyond(z, TRUSTED_TURN), norm
        if not held:
            break
    return False, norm


@linked_kernel
def newton_with_shortening(
    m: Member,
    torques: Array,
    h: float,
    adjoint: bool,
    beam: BeamConstants,
    fluid: FluidConstants,
    solver: SolverConstants,
) -> tuple[bool, float, bool]:
    """Improve the increment until the residual is met; parameters as `newton_in_passes`.

    The matrix is kept as long as corrections shrink. Corrections are shortened by Deuflhard's
    natural monotonicity test: the next correction with the same matrix has to be smaller. It does
    not depend on how residuals of turning and of shifting are compared.

    Returns
    -------
    solved, norm, at_round_off : bool, float, bool
        Whether it was met, the residual's norm, and whether rounding kept it from falling to the
        tolerance.
    """
    state, body, fluid_work, newton, step = m.state, m.body, m.fluid_work, m.newton, m.step
    q, p = state.q, state.p
    balance = body.balance
    z = newton.increment
    trial = newton.trial
    effort = step.effort
    norm = _evaluate(q, p, torques, z, h, adjoint, beam, fluid, solver, body, fluid_work, step)
    if not norm < np.inf:
        return False, norm, False
    if norm <= solver.tolerance:
        return True, norm, False
    step.tally[LEARNT] = -1
    difference = 0.0
    fresh = False
    renew = True
    size = 0.0
    for _ in range(MOST_ITERATIONS):
        if renew:
            effort[0] += solver.matrix_cost
            if difference > 0.0 and not adjoint and fluid.varies:
                effort[0] += z.size * solver.evaluation_cost
            if effort[0] > 1.0:
                return False, norm, False
            # Here the last evaluation was that of z.
            if adjoint:
                adjoint_jacobian(h, beam, fluid, body, newton)
            else:
                step_jacobian(h, difference, beam, fluid, body, fluid_work, newton)
            if not lu_factor(newton.jacobian, newton.permutation):
                return False, norm, False
            copy(balance.residual, newton.correction)
            lu_solve(newton.jacobian, newton.permutation, newton.correction)
            size = _correction_size(newton.correction, beam.element_length)
            fresh = True
            renew = False
        length = 1.0
        accepted = False
        new_size = np.inf
        for _ in range(MOST_SHORTENINGS):
            if effort[0] > 1.0:
                return False, norm, False
            for i in range(z.size):
                trial[i] = z[i] + length * newton.correction[i]
            if not turns_beyond(trial, TRUSTED_TURN):
                norm = _evaluate(
                    q, p, torques, trial, h, adjoint, beam, fluid, solver, body, fluid_work, step
                )
                step.tally[CORRECTIONS] += 1
                if norm <= solver.tolerance:
                    copy(trial, z)
                    return True, norm, False
                copy(balance.residual, newton.next_correction)
                lu_solve(newton.jacobian, newton.permutation, newton.next_correction)
                new_size = _correction_size(newton.next_correction, beam.element_length)
                if new_size <= (1.0 - 0.25 * length) * size:
                    accepted = True
                    break
                largest = max(solver.tolerance, LARGEST_ROUND_OFF)
                if norm <= min(
                    ROUND_OFF_MARGIN * round_off_floor(balance.size, balance.scale), largest
                ):
                    # Rounding keeps the residual from falling further: this is as exact as it
                    # gets.
                    copy(trial, z)
                    return True, norm, True
                if not fresh:
                    break
            length *= 0.5
        if accepted:
            copy(trial, z)
            copy(newton.next_correction, newton.correction)
            slow = new_size > 0.25 * size
            size = new_size
            fresh = False
            if slow:
                renew = True
                difference = SHAPE_DIFFERENCE
            continue
        if fresh and difference > 0.0:
            return False, norm, False
        difference = SHAPE_DIFFERENCE
        renew = True
        norm = _evaluate(q, p, torques, z, h, adjoint, beam, fluid, solver, body, fluid_work, step)
    return False, norm, False
