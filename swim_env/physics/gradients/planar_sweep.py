r"""Sweeps over the steps of a planar run: the discrete adjoint backward, the tangent forward.

With L the discrete Lagrangian of a step (or of half a composed one), f = (h tau - C z)/2 the
impulse of torques and damping at either end, and J = -d(D_1 L + f)/dq_{n+1} the matrix of Newton's
method, a step is

.. math:: p_n + D_1 L + f = 0, \quad p_{n+1} = D_2 L + f.

With adjoints lambda of q_{n+1} and pi of p_{n+1}, the implicit function theorem gives

.. math::
    J^T \mu &= \lambda + \partial_{q_{n+1}} (\pi \cdot (D_2 L + f)), \\
    \lambda_n &= \partial_{q_n} (\pi \cdot (D_2 L + f) + \mu \cdot (D_1 L + f)), \quad \pi_n = \mu,

and derivatives by torques and parameters are those of the same two products.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.layout import FluidConstants, motion_count
from swim_env.physics.fluid.models import shape_force
from swim_env.physics.gradients.planar_variation import (
    JOINTS,
    Variation,
    new_variation,
    parameter_count,
    vary,
)
from swim_env.physics.planar.chain import BeamConstants
from swim_env.physics.planar.equations import evaluate_step, set_pose
from swim_env.physics.planar.matrix import step_jacobian
from swim_env.physics.runtime.compile import entry_kernel, kernel
from swim_env.physics.runtime.dense import copy, lu_factor, lu_solve
from swim_env.physics.runtime.linking import linked_kernel
from swim_env.physics.runtime.references import reader
from swim_env.physics.solve.constants import SolverConstants, constants_at
from swim_env.physics.solve.prepare import find_added_mass
from swim_env.physics.solve.state import Member, member_at
from swim_env.physics.status import FINE, STEP_NOT_SOLVED

Array = NDArray[np.float64]
# Of complex numbers; kernels that take real ones elsewhere take them too.
Complex = NDArray[Any]
Integers = NDArray[np.int64]


#: Part of a motion by which it is changed for a difference quotient.
_SHARE = 1e-6


class Sweep(NamedTuple):
    """Work space of a sweep.

    Attributes
    ----------
    matrix : (N + 2, N + 2) array
        J or its transpose, and its factors.
    pose, z : (N + 2,) arrays
        Coordinates of `a` and the increment from there to `b`, see `planar_variation`.
    zero, solved, early, late, early_too, late_too : (N + 2,) arrays
        No direction; the unknown of the linear system; derivatives by the earlier and the later
        coordinates, for one direction and for another.
    mu, early_last, late_last : (N + 2,) arrays
        The solution, and derivatives along its correction.
    no_changes, unused : (P,) arrays
        No change of parameters, and derivatives that nobody asked for.
    variation : Variation
        That of `vary`.
    """

    matrix: Array
    pose: Array
    z: Array
    zero: Array
    solved: Array
    early: Array
    late: Array
    early_too: Array
    late_too: Array
    mu: Array
    early_last: Array
    late_last: Array
    no_changes: Array
    unused: Array
    variation: Variation


def linear_system(n: int) -> dict[str, Array]:
    """Return what every sweep solves for n unknowns with, by the names of its fields."""
    rows = ("z", "zero", "solved", "early", "late", "early_too", "late_too")
    return {"matrix": np.zeros((n, n)), **{name: np.zeros(n) for name in rows}}


def new_sweep(elements: int, motions: int) -> Sweep:
    """Return the work space of a sweep over the steps of a body with so many motions."""
    n, parameters = elements + 2, parameter_count(elements)
    return Sweep(
        **linear_system(n),
        pose=np.zeros(n),
        mu=np.zeros(n),
        early_last=np.zeros(n),
        late_last=np.zeros(n),
        no_changes=np.zeros(parameters),
        unused=np.zeros(parameters),
        variation=new_variation(elements, motions),
    )


#: Returns the sweep whose words a kernel is given.
sweep_at = reader(lambda: new_sweep(2, 4))


@linked_kernel
def begin_half(
    torques: Array,
    h: float,
    beam: BeamConstants,
    fluid: FluidConstants,
    solver: SolverConstants,
    m: Member,
    sweep: Sweep,
) -> int:
    """Evaluate a step from `sweep.pose` by `sweep.z` and write J to `newton.jacobian`.

    Rows and columns belong to the mean centre and the elements' angles. Returns 0 or the code of
    the reason why there is no added mass.
    """
    newton, inc = m.newton, m.body.inc
    set_pose(sweep.pose, beam, m.body.pose)
    status = find_added_mass(
        sweep.pose[3:], fluid, solver, m.fluid_work, m.body.mass, m.step.effort
    )
    if status != FINE:
        return int(status)
    evaluate_step(sweep.zero, torques, sweep.z, h, False, False, beam, fluid, m.body, m.fluid_work)
    step_jacobian(h, 0.0, beam, fluid, m.body, m.fluid_work, newton)
    jacobian = newton.jacobian
    n = beam.elements + 2
    for i in range(n):
        for column in range(2, n - 1):
            jacobian[i, column] -= jacobian[i, column + 1]
    if fluid.varies:
        motions = motion_count(fluid)
        largest = 0.0
        for i in range(motions):
            largest = max(largest, abs(inc.motion[i]))
        # The shape force is a small part of the matrix, and what its difference quotients to one
        # side leave is corrected: they are right to six digits.
        size = _SHARE * max(largest, 1e-100)
        for column in range(n):
            row = newton.motions[column]
            for i in range(newton.moved.size):
                newton.moved[i] = inc.motion[i] + size * row[i]
            shape_force(newton.moved, fluid, m.fluid_work, newton.shape)
            for k in range(beam.elements):
                change = newton.shape[k] - m.body.balance.shape[k]
                jacobian[2 + k, column] -= change / (size * h)
    return FINE


@kernel
def _solve(transposed: bool, m: Member, sweep: Sweep) -> bool:
    """Solve for `sweep.solved` in place with J, or with its transpose."""
    n = sweep.zero.size
    for i in range(n):
        for j in range(n):
            here = m.newton.jacobian[j, i] if transposed else m.newton.jacobian[i, j]
            sweep.matrix[i, j] = here
    if not lu_factor(sweep.matrix, m.newton.permutation):
        return False
    lu_solve(sweep.matrix, m.newton.permutation, sweep.solved)
    return True


@kernel
def _correct(m: Member, sweep: Sweep) -> None:
    """Solve for `sweep.solved` once more with the same factors, and add it to `sweep.mu`."""
    lu_solve(sweep.matrix, m.newton.permutation, sweep.solved)
    for i in range(sweep.mu.size):
        sweep.mu[i] += sweep.solved[i]


@kernel
def _joint(u: Array, j: int) -> float:
    """Return the change of joint angle j in a direction."""
    return float(u[3 + j] - u[2 + j])


@kernel
def _add_joint(u: Array, j: int, impulse: float) -> None:
    """Add an impulse between the elements of joint j."""
    u[3 + j] += impulse
    u[2 + j] -= impulse


@kernel
def _place_half(q: Array, z: Array, second: bool, sweep: Sweep) -> None:
    """Take the inertia's end of a half as `a`: `q` is where the half begins, or where it ends."""
    for i in range(z.size):
        sweep.pose[i] = q[i]
        sweep.z[i] = -z[i] if second else z[i]


@entry_kernel
def pull_back(
    q: Array,
    z: Array,
    torques: Array,
    bend: float,
    constants: Integers,
    places: Integers,
    place: Integers,
    by_q: Array,
    by_p: Array,
    adjoint: Array,
    by_torques: Array,
    parameters: Array,
) -> tuple[int, int]:
    """Carry the adjoint of a run's end back to its start.

    Vectors (N + 2,) that are derivatives by coordinates belong to the mean centre and the angles
    of the elements.

    Parameters
    ----------
    q : (T + 1, N + 2) array
        Minimal coordinates before and after every step.
    z : (T, H, N + 2) array
        Increments of its H parts, two with the composed scheme.
    torques : (T, N - 1) array
        Joint torques (N m).
    bend : float
        As in `vary`.
    constants : (C,) array
        The words of the scene's `swim_env.physics.solve.constants.Constants`.
    places : (2, W) array
        Those of two members, of which only the work space is used.
    place : (S,) array
        Those of a `Sweep`.
    by_q, by_p : (T + 1, N + 2) arrays
        The objective's own derivatives by coordinates and momenta at every time but the end's.
    adjoint : (2, N + 2) array
        Overwritten: derivatives by coordinates and momenta of the end with those of the start.
    by_torques : (T, N - 1) array
        The derivatives are added.
    parameters : (P,) array
        The derivatives are added, see `parameter_count`.

    Returns
    -------
    status, step : int, int
        0 or a reason's code, and the step where it stopped.
    """
    scene, sweep = constants_at(constants), sweep_at(place)
    beam, fluid, solver = scene.beam, scene.fluid, scene.solver
    m, beside, v = member_at(places[0]), member_at(places[1]), sweep.variation
    n = beam.elements + 2
    parts = z.shape[1]
    h = solver.time_step / parts
    dampers = JOINTS + beam.elements - 1
    sweep.zero[:] = 0.0
    sweep.no_changes[:] = 0.0
    by_end, by_momentum = adjoint[0], adjoint[1]
    for back in range(torques.shape[0]):
        step = torques.shape[0] - 1 - back
        held = torques[step]
        for part in range(parts - 1, -1, -1):
            second = part == 1
            increment = z[step, part]
            _place_half(q[step + part], increment, second, sweep)
            status = begin_half(held, h, beam, fluid, solver, m, sweep)
            if status != FINE:
                return int(status), step
            early, late, early_too, late_too = (
                sweep.early,
                sweep.late,
                sweep.early_too,
                sweep.late_too,
            )
            # The direction (0, pi) of the earlier and the later coordinates. Where the inertia is
            # that of the earlier ones, it is gone through again with mu.
            u_a, u_b, out_a, out_b, kept = sweep.zero, by_momentum, early, late, sweep.unused
            if second:
                u_a, u_b, out_a, out_b, kept = by_momentum, sweep.zero, late, early, parameters
            status = vary(
                *(sweep.pose, sweep.z, h, u_a, u_b, sweep.no_changes, bend, second),
                *(beam, fluid, m, beside, v, out_a, out_b, kept),
            )
            if status != FINE:
                return int(status), step
            for i in range(n):
                sweep.solved[i] = by_end[i] + late[i]
            for j in range(beam.elements - 1):
                turned = 0.5 * beam.joint_damping[j] * _joint(by_momentum, j)
                _add_joint(sweep.solved, j, -turned)
            if not _solve(not second, m, sweep):
                return STEP_NOT_SOLVED, step
            mu = sweep.mu
            copy(sweep.solved, mu)
            u_a, u_b, out_a, out_b = mu, by_momentum, early_too, late_too
            if second:
                u_a, u_b, out_a, out_b = sweep.zero, mu, late_too, early_too
            else:
                early[:] = 0.0
                late[:] = 0.0
            status = vary(
                *(sweep.pose, sweep.z, h, u_a, u_b, sweep.no_changes, bend, True),
                *(beam, fluid, m, beside, v, out_a, out_b, parameters),
            )
            if status != FINE:
                return int(status), step
            if fluid.varies:
                # Nothing may be left of the derivative by the later coordinates.
                for i in range(n):
                    sweep.solved[i] = by_end[i] + late[i] + late_too[i]
                for j in range(beam.elements - 1):
                    turned = _joint(by_momentum, j) + _joint(mu, j)
                    _add_joint(sweep.solved, j, -0.5 * beam.joint_damping[j] * turned)
                _correct(m, sweep)
                u_a, u_b = sweep.solved, sweep.zero
                out_a, out_b = sweep.early_last, sweep.late_last
                if second:
                    u_a, u_b, out_a, out_b = u_b, u_a, out_b, out_a
                vary(
                    *(sweep.pose, sweep.z, h, u_a, u_b, sweep.no_changes, 0.0, False),
                    *(beam, fluid, m, beside, v, out_a, out_b, parameters),
                )
                for i in range(n):
                    early[i] += sweep.early_last[i]
            for i in range(n):
                by_end[i] = early[i] + early_too[i]
            for j in range(beam.elements - 1):
                turned = _joint(mu, j) + _joint(by_momentum, j)
                _add_joint(by_end, j, 0.5 * beam.joint_damping[j] * turned)
                by_torques[step, j] += 0.5 * h * turned
                parameters[dampers + j] -= 0.5 * turned * increment[3 + j]
            copy(mu, by_momentum)
        for i in range(n):
            by_end[i] += by_q[step, i]
            by_momentum[i] += by_p[step, i]
    return FINE, 0


@entry_kernel
def push_forward(
    q: Array,
    z: Array,
    torques: Array,
    bend: float,
    constants: Integers,
    places: Integers,
    place: Integers,
    changes: Array,
    torque_changes: Array,
    tangents: Array,
) -> tuple[int, int]:
    """Carry a change of the start, of torques and of parameters forward to every later state.

    Parameters are those of `pull_back`, but for these.

    Parameters
    ----------
    changes : (P,) array
        The change of the parameters.
    torque_changes : (T, N - 1) array
        That of the torques.
    tangents : (T + 1, 2, N + 2) array
        The change of coordinates and momenta; the first is given, the rest is overwritten.

    Returns
    -------
    status, step : int, int
        0 or a reason's code, and the step where it stopped.
    """
    scene, sweep = constants_at(constants), sweep_at(place)
    beam, fluid, solver = scene.beam, scene.fluid, scene.solver
    m, beside, v = member_at(places[0]), member_at(places[1]), sweep.variation
    n = beam.elements + 2
    parts = z.shape[1]
    h = solver.time_step / parts
    dampers = JOINTS + beam.elements - 1
    sweep.zero[:] = 0.0
    sweep.no_changes[:] = 0.0
    for step in range(torques.shape[0]):
        held = torques[step]
        start, momentum = tangents[step + 1, 0], tangents[step + 1, 1]
        copy(tangents[step, 0], start)
        copy(tangents[step, 1], momentum)
        for part in range(parts):
            second = part == 1
            increment = z[step, part]
            _place_half(q[step + part], increment, second, sweep)
            status = begin_half(held, h, beam, fluid, solver, m, sweep)
            if status != FINE:
                return int(status), step
            early, late, early_too, late_too = (
                sweep.early,
                sweep.late,
                sweep.early_too,
                sweep.late_too,
            )
            u_a, u_b, out_a, out_b = start, sweep.zero, early, late
            if second:
                u_a, u_b, out_a, out_b = sweep.zero, start, late, early
            status = vary(
                *(sweep.pose, sweep.z, h, u_a, u_b, changes, bend, True),
                *(beam, fluid, m, beside, v, out_a, out_b, sweep.unused),
            )
            if status != FINE:
                return int(status), step
            for j in range(beam.elements - 1):
                impulse = h * torque_changes[step, j] - changes[dampers + j] * increment[3 + j]
                impulse += beam.joint_damping[j] * _joint(start, j)
                _add_joint(early, j, 0.5 * impulse)
                _add_joint(late, j, 0.5 * impulse)
            for i in range(n):
                sweep.solved[i] = momentum[i] + early[i]
            if not _solve(second, m, sweep):
                return STEP_NOT_SOLVED, step
            end = sweep.mu
            copy(sweep.solved, end)
            u_a, u_b, out_a, out_b = sweep.zero, end, early_too, late_too
            if second:
                u_a, u_b, out_a, out_b = end, sweep.zero, late_too, early_too
            status = vary(
                *(sweep.pose, sweep.z, h, u_a, u_b, sweep.no_changes, bend, True),
                *(beam, fluid, m, beside, v, out_a, out_b, sweep.unused),
            )
            if status != FINE:
                return int(status), step
            if fluid.varies:
                # The changed equation of the earlier momentum has to hold.
                for i in range(n):
                    sweep.solved[i] = momentum[i] + early[i] + early_too[i]
                for j in range(beam.elements - 1):
                    _add_joint(sweep.solved, j, -0.5 * beam.joint_damping[j] * _joint(end, j))
                _correct(m, sweep)
                u_a, u_b = sweep.zero, sweep.solved
                out_a, out_b = sweep.early_last, sweep.late_last
                if second:
                    u_a, u_b, out_a, out_b = u_b, u_a, out_b, out_a
                vary(
                    *(sweep.pose, sweep.z, h, u_a, u_b, sweep.no_changes, 0.0, False),
                    *(beam, fluid, m, beside, v, out_a, out_b, sweep.unused),
                )
                for i in range(n):
                    late[i] += sweep.late_last[i]
            for i in range(n):
                momentum[i] = late[i] + late_too[i]
                start[i] = end[i]
            for j in range(beam.elements - 1):
                _add_joint(momentum, j, -0.5 * beam.joint_damping[j] * _joint(end, j))
    return FINE, 0
