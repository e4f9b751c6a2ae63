"""Sweeps over the steps of a run in space, as `planar_sweep`: adjoint backward, tangent forward."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.gradients.planar_sweep import linear_system
from swim_env.physics.gradients.spatial_variation import (
    SpatialVariation,
    new_spatial_variation,
    spatial_parameter_count,
    vary_spatial,
)
from swim_env.physics.runtime.compile import entry_kernel, kernel
from swim_env.physics.runtime.dense import copy, lu_factor, lu_solve
from swim_env.physics.runtime.linking import linked_kernel
from swim_env.physics.runtime.references import reader
from swim_env.physics.spatial.chain import set_pose
from swim_env.physics.spatial.constants import SpatialConstants, spatial_constants_at
from swim_env.physics.spatial.equations import evaluate_spatial_step
from swim_env.physics.spatial.layout import Member, spatial_member_at
from swim_env.physics.spatial.matrix import spatial_jacobian, turn_added_mass
from swim_env.physics.spatial.prepare import find_added_mass
from swim_env.physics.status import FINE, STEP_NOT_SOLVED

Array = NDArray[np.float64]
# Of complex numbers; kernels that take real ones elsewhere take them too.
Complex = NDArray[Any]
Integers = NDArray[np.int64]


class SpatialSweep(NamedTuple):
    """Work space of a sweep, as `planar_sweep.Sweep`.

    Attributes
    ----------
    matrix : (3 N + 3, 3 N + 3) array
        J or its transpose, and its factors.
    z, zero, solved, early, late, early_too, late_too : (3 N + 3,) arrays
        The increment from `a` to `b`; no direction; the unknown of the linear system; derivatives
        by the earlier and the later coordinates, for one direction and for another.
    held, no_torques, unused_torques : (N - 1, 3) arrays
        Torques less what damping takes (N m), no change of any, and derivatives by them that nobody
        asked for.
    no_changes, unused : (P,) arrays
        The same of parameters.
    variation : SpatialVariation
        That of `vary_spatial`.
    """

    matrix: Array
    z: Array
    zero: Array
    solved: Array
    early: Array
    late: Array
    early_too: Array
    late_too: Array
    held: Array
    no_torques: Array
    unused_torques: Array
    no_changes: Array
    unused: Array
    variation: SpatialVariation


def new_spatial_sweep(elements: int) -> SpatialSweep:
    """Return the work space of a sweep over the steps of a body."""
    n, parameters = 3 * elements + 3, spatial_parameter_count(elements)
    return SpatialSweep(
        **linear_system(n),
        held=np.zeros((elements - 1, 3)),
        no_torques=np.zeros((elements - 1, 3)),
        unused_torques=np.zeros((elements - 1, 3)),
        no_changes=np.zeros(parameters),
        unused=np.zeros(parameters),
        variation=new_spatial_variation(elements),
    )


#: Returns the sweep whose words a kernel is given.
spatial_sweep_at = reader(lambda: new_spatial_sweep(2))


@linked_kernel
def begin_spatial_half(
    q: Array,
    z: Array,
    torques: Array,
    h: float,
    second: bool,
    scene: SpatialConstants,
    m: Member,
    sweep: SpatialSweep,
) -> int:
    """Evaluate a half from its end `a`, which has the coordinates q, and write J.

    `z` (3 N + 3,) is the half's increment. Returns 0 or a reason's code.
    """
    beam, fluid, body, newton = scene.beam, scene.fluid, m.body, m.newton
    set_pose(q, body.pose)
    status = find_added_mass(body.pose.directors, scene, m.panels, body.mass)
    if status != FINE:
        return int(status)
    if fluid.present:
        turn_added_mass(fluid, body.mass.added, body.pose.directors, newton.columns, newton.blocks)
    for i in range(z.size):
        sweep.z[i] = -z[i] if second else z[i]
    evaluate_spatial_step(q, sweep.zero, torques, sweep.z, h, False, beam, fluid, body, newton)
    spatial_jacobian(h, False, beam, fluid, body, newton)
    for j in range(beam.elements - 1):
        for i in range(3):
            turned = body.inc.angles[j, i] - body.pose.angles[j, i]
            if second:
                turned = -turned
            sweep.held[j, i] = torques[j, i] - beam.damping[j, i] * turned / h
    return FINE


@kernel
def _solve(transposed: bool, m: Member, sweep: SpatialSweep) -> bool:
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


@entry_kernel
def pull_back_spatial(
    q: Array,
    z: Array,
    torques: Array,
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

    Parameters are those of `planar_sweep.pull_back`, but for these. Vectors (3 N + 3,) that are
    derivatives by coordinates belong to the mean centre and rotations of the elements in the axes
    of space.

    Parameters
    ----------
    q : (T + 1, 4 N + 3) array
        Minimal coordinates before and after every step.
    z : (T, H, 3 N + 3) array
        Increments of its H parts.
    torques : (T, N - 1, 3) array
        Joint torques (N m).
    places : (2, W) array
        The words of two members, of which only the first one's work space is used.
    """
    scene, sweep = spatial_constants_at(constants), spatial_sweep_at(place)
    beam, fluid, solver = scene.beam, scene.fluid, scene.solver
    m, v = spatial_member_at(places[0]), sweep.variation
    parts = z.shape[1]
    h = solver.time_step / parts
    sweep.zero[:] = 0.0
    sweep.no_changes[:] = 0.0
    sweep.no_torques[:] = 0.0
    by_end, by_momentum = adjoint[0], adjoint[1]
    no_changes, no_torques = sweep.no_changes, sweep.no_torques
    for back in range(torques.shape[0]):
        step = torques.shape[0] - 1 - back
        held = torques[step]
        for part in range(parts - 1, -1, -1):
            second = part == 1
            status = begin_spatial_half(
                q[step + part], z[step, part], held, h, second, scene, m, sweep
            )
            if status != FINE:
                return int(status), step
            early, late = sweep.early, sweep.late
            early_too, late_too = sweep.early_too, sweep.late_too
            # The direction (0, pi) of the earlier and the later coordinates.
            u_a, u_b, out_a, out_b = sweep.zero, by_momentum, early, late
            if second:
                u_a, u_b, out_a, out_b = by_momentum, sweep.zero, late, early
            vary_spatial(
                *(sweep.z, h, u_a, u_b, no_changes, sweep.held, no_torques, True, second),
                *(beam, fluid, m.body, v, out_a, out_b, by_torques[step], parameters),
            )
            for i in range(by_end.size):
                sweep.solved[i] = by_end[i] + late[i]
            if not _solve(not second, m, sweep):
                return STEP_NOT_SOLVED, step
            u_a, u_b, out_a, out_b = sweep.solved, sweep.zero, early_too, late_too
            if second:
                u_a, u_b, out_a, out_b = sweep.zero, sweep.solved, late_too, early_too
            vary_spatial(
                *(sweep.z, h, u_a, u_b, no_changes, sweep.held, no_torques, True, second),
                *(beam, fluid, m.body, v, out_a, out_b, by_torques[step], parameters),
            )
            for i in range(by_end.size):
                by_end[i] = early[i] + early_too[i]
            copy(sweep.solved, by_momentum)
        for i in range(by_end.size):
            by_end[i] += by_q[step, i]
            by_momentum[i] += by_p[step, i]
    return FINE, 0


@entry_kernel
def push_forward_spatial(
    q: Array,
    z: Array,
    torques: Array,
    constants: Integers,
    places: Integers,
    place: Integers,
    changes: Array,
    torque_changes: Array,
    tangents: Array,
) -> tuple[int, int]:
    """Carry a change of the start, of torques and of parameters forward to every later state.

    Parameters are those of `pull_back_spatial` and of `planar_sweep.push_forward`, with torques
    (T, N - 1, 3) and tangents (T + 1, 2, 3 N + 3).
    """
    scene, sweep = spatial_constants_at(constants), spatial_sweep_at(place)
    beam, fluid, solver = scene.beam, scene.fluid, scene.solver
    m, v = spatial_member_at(places[0]), sweep.variation
    parts = z.shape[1]
    h = solver.time_step / parts
    sweep.zero[:] = 0.0
    sweep.no_changes[:] = 0.0
    sweep.no_torques[:] = 0.0
    no_changes, no_torques, unused = sweep.no_changes, sweep.no_torques, sweep.unused
    for step in range(torques.shape[0]):
        held, turning = torques[step], torque_changes[step]
        start, momentum = tangents[step + 1, 0], tangents[step + 1, 1]
        copy(tangents[step, 0], start)
        copy(tangents[step, 1], momentum)
        for part in range(parts):
            second = part == 1
            status = begin_spatial_half(
                q[step + part], z[step, part], held, h, second, scene, m, sweep
            )
            if status != FINE:
                return int(status), step
            early, late = sweep.early, sweep.late
            early_too, late_too = sweep.early_too, sweep.late_too
            u_a, u_b, out_a, out_b = start, sweep.zero, early, late
            if second:
                u_a, u_b, out_a, out_b = sweep.zero, start, late, early
            vary_spatial(
                *(sweep.z, h, u_a, u_b, changes, sweep.held, turning, False, second),
                *(beam, fluid, m.body, v, out_a, out_b, sweep.unused_torques, unused),
            )
            for i in range(start.size):
                sweep.solved[i] = momentum[i] + early[i]
            if not _solve(second, m, sweep):
                return STEP_NOT_SOLVED, step
            u_a, u_b, out_a, out_b = sweep.zero, sweep.solved, early_too, late_too
            if second:
                u_a, u_b, out_a, out_b = sweep.solved, sweep.zero, late_too, early_too
            vary_spatial(
                *(sweep.z, h, u_a, u_b, no_changes, sweep.held, no_torques, False, second),
                *(beam, fluid, m.body, v, out_a, out_b, sweep.unused_torques, unused),
            )
            for i in range(start.size):
                momentum[i] = late[i] + late_too[i]
                start[i] = sweep.solved[i]
    return FINE, 0
