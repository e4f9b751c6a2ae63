"""Newton's method for the increment of a step in space.

Corrections share the matrix of the first increment while they shrink fast; where that fails, they
are shortened by Deuflhard's natural monotonicity test, with a matrix of their own where need be.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.planar.equations import round_off_floor
from swim_env.physics.runtime.compile import embedded, kernel
from swim_env.physics.runtime.dense import copy, lu_factor, lu_solve
from swim_env.physics.runtime.linking import linked_kernel
from swim_env.physics.solve.newton import (
    LARGEST_ROUND_OFF,
    MOST_ITERATIONS,
    MOST_SHORTENINGS,
    ROUND_OFF_MARGIN,
    TRUSTED_TURN,
)
from swim_env.physics.solve.state import CORRECTIONS, EVALUATED, SHAPE_FAILURE
from swim_env.physics.spatial.constants import SpatialConstants
from swim_env.physics.spatial.equations import evaluate_spatial_step
from swim_env.physics.spatial.layout import Member
from swim_env.physics.spatial.matrix import add_correction, spatial_jacobian
from swim_env.physics.spatial.panels.mass import panel_shape_force
from swim_env.physics.spatial.prepare import find_added_mass
from swim_env.physics.status import FINE

Array = NDArray[np.float64]

#: Corrections with one matrix before they may be shortened, and passes.
_MOST_QUICK = 8
_MOST_PASSES = 12
#: Passes in which something is held go this much below the tolerance.
_PASS_TOLERANCE = 0.1


@kernel
def _correction_size(step: Array, dl: float) -> float:
    """Return the largest turn of an element (rad) or shift (element lengths) in a correction."""
    largest = 0.0
    for i in range(step.size):
        size = abs(step[i])
        if i < 3:
            size /= dl
        if not size <= largest:
            largest = size if size == size else math.inf
    return largest


@kernel
def turns_beyond(z: Array, limit: float) -> bool:
    """Return whether an element, or a joint by its elements, turns by more than a limit (rad)."""
    for first in range(3, z.size, 3):
        square = 0.0
        apart = 0.0
        for i in range(first, first + 3):
            square += z[i] * z[i]
            if first > 3:
                apart += (z[i] - z[i - 3]) ** 2
        if not (square <= limit * limit and apart <= limit * limit):
            return True
    return False


@embedded
def evaluate(
    m: Member, torques: Array, z: Array, h: float, adjoint: bool, scene: SpatialConstants
) -> float:
    """Evaluate the residual of a member's step, see `evaluate_spatial_step`."""
    q, p = m.state.q, m.state.p
    return evaluate_spatial_step(
        q, p, torques, z, h, adjoint, scene.beam, scene.fluid, m.body, m.newton
    )


@kernel
def evaluate_with_shape(
    m: Member,
    torques: Array,
    z: Array,
    h: float,
    adjoint: bool,
    scene: SpatialConstants,
) -> float:
    """Evaluate the residual with what depends on the increment through the panels; or infinite.

    That is the shape force, or in the adjoint the added mass of the shape at the end.
    """
    body, step = m.body, m.step
    step.tally[EVALUATED] += 1
    evaluate(m, torques, z, h, adjoint, scene)
    if adjoint:
        step.effort[0] += scene.solver.added_mass_cost
        status = find_added_mass(body.inc.directors, scene, m.panels, body.mass)
        step.tally[SHAPE_FAILURE] = status
        if status != FINE:
            return np.inf
    else:
        step.effort[0] += 0.5 * scene.solver.added_mass_cost
        panel_shape_force(
            body.pose.directors, body.inc.motion, scene.surface, m.panels, body.balance.shape
        )
    return evaluate(m, torques, z, h, adjoint, scene)


@linked_kernel
def spatial_newton(
    m: Member,
    torques: Array,
    h: float,
    adjoint: bool,
    scene: SpatialConstants,
    guessed: bool,
) -> tuple[bool, float, bool]:
    """Improve the increment `newton.increment` until the residual is met.

    Where the added mass varies it works in passes, in which the shape force, or in the adjoint the
    added mass of the end, is held: it costs a hundred times as much as the rest and changes little.

    Parameters
    ----------
    m : Member
        The member.
    torques : (N - 1, 3) array
        Joint torques (N m).
    h : float
        Length of the step (s).
    adjoint : bool
        Whether the step is that of the adjoint map, with the inertia of its end.
    scene : SpatialConstants
        The scene.
    guessed : bool
        Whether to begin with what is held as it is: a guess of the shape force, or in the adjoint
        the added mass of the part's beginning.

    Returns
    -------
    solved, norm, at_round_off : bool, float, bool
        Whether it was met, the residual's norm, and whether rounding kept it from falling to the
        tolerance.
    """
    tolerance = scene.solver.tolerance
    if not scene.fluid.varies:
        return _newton(m, torques, h, adjoint, tolerance, scene)
    z = m.newton.increment
    norm = np.inf
    for number in range(_MOST_PASSES):
        if number > 0 or not guessed:
            norm = evaluate_with_shape(m, torques, z, h, adjoint, scene)
            if norm <= tolerance:
                return True, norm, False
            if not norm < np.inf or m.step.effort[0] > 1.0:
                return False, norm, False
        within = _PASS_TOLERANCE * tolerance
        solved, _, at_round_off = _newton(m, torques, h, adjoint, within, scene)
        if not solved:
            return False, norm, False
        if at_round_off:
            norm = evaluate_with_shape(m, torques, z, h, adjoint, scene)
            return norm <= LARGEST_ROUND_OFF, norm, True
    return False, norm, False


@kernel
def _newton(
    m: Member, torques: Array, h: float, adjoint: bool, tolerance: float, scene: SpatialConstants
) -> tuple[bool, float, bool]:
    """Improve the increment with shape force and added mass held; as `spatial_newton`."""
    body, newton, step = m.body, m.newton, m.step
    beam, fluid, solver = scene.beam, scene.fluid, scene.solver
    z, trial, balance = newton.increment, newton.trial, body.balance
    effort = step.effort
    copy(z, newton.start)
    norm = evaluate(m, torques, z, h, adjoint, scene)
    effort[0] += solver.evaluation_cost
    step.tally[EVALUATED] += 0 if fluid.varies else 1
    if not norm < np.inf:
        return False, norm, False
    if norm <= tolerance:
        return True, norm, False
    quick = True
    fresh = False
    renew = True
    size = np.inf
    for iteration in range(_MOST_QUICK + MOST_ITERATIONS):
        if quick and iteration == _MOST_QUICK:
            quick = False
            copy(newton.start, z)
            renew = True
        if renew:
            effort[0] += solver.matrix_cost + solver.evaluation_cost
            if effort[0] > 1.0:
                return False, norm, False
            if iteration > 0:
                norm = evaluate(m, torques, z, h, adjoint, scene)
            spatial_jacobian(h, adjoint, beam, fluid, body, newton)
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
            copy(z, trial)
            add_correction(newton.correction, length, body.inc, trial, newton.blocks[0])
            if not turns_beyond(trial, TRUSTED_TURN):
                norm = evaluate(m, torques, trial, h, adjoint, scene)
                effort[0] += solver.evaluation_cost
                step.tally[EVALUATED] += 0 if fluid.varies else 1
                step.tally[CORRECTIONS] += 1
                if norm <= tolerance:
                    copy(trial, z)
                    return True, norm, False
                copy(balance.residual, newton.next_correction)
                lu_solve(newton.jacobian, newton.permutation, newton.next_correction)
                new_size = _correction_size(newton.next_correction, beam.element_length)
                if new_size <= (1.0 - 0.25 * length) * size:
                    accepted = True
                    break
                floor = ROUND_OFF_MARGIN * round_off_floor(balance.size, balance.scale)
                if norm <= min(floor, max(tolerance, LARGEST_ROUND_OFF)):
                    copy(trial, z)
                    return True, norm, True
            if quick or not fresh:
                break
            # What is corrected was overwritten by the trial.
            evaluate(m, torques, z, h, adjoint, scene)
            length *= 0.5
        if accepted:
            copy(trial, z)
            copy(newton.next_correction, newton.correction)
            renew = new_size > 0.25 * size
            size = new_size
            fresh = False
        elif quick:
            quick = False
            copy(newton.start, z)
            renew = True
        elif fresh:
            return False, norm, False
        else:
            renew = True
    return False, norm, False
