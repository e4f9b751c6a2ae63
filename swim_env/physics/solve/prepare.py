"""Everything that depends on the pose alone: added mass, total mass, velocity and energy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.contact import touches_itself
from swim_env.physics.fluid.layout import FluidConstants, FluidWork
from swim_env.physics.fluid.models import added_mass
from swim_env.physics.planar.chain import BeamConstants
from swim_env.physics.planar.elastic import with_elastic_energy
from swim_env.physics.planar.equations import set_pose
from swim_env.physics.planar.layout import ADDED, TOTAL, Body, Mass, Newton, Pose
from swim_env.physics.planar.matrix import mass_matrix
from swim_env.physics.runtime.compile import inlined, kernel
from swim_env.physics.runtime.dense import cholesky, cholesky_solve, copy, dot
from swim_env.physics.runtime.linking import linked_kernel
from swim_env.physics.solve.constants import SolverConstants
from swim_env.physics.solve.state import State
from swim_env.physics.status import FINE, MASS_NOT_POSITIVE, SELF_CONTACT, STATE_NOT_FINITE

Array = NDArray[np.float64]


@kernel
def energy_of_pose(p: Array, beam: BeamConstants, pose: Pose, mass: Mass) -> float:
    """Return H = p M^-1 p/2 + W (33) (J) of the pose that was prepared."""
    return with_elastic_energy(0.5 * dot(p, mass.velocity), beam, pose)


@inlined
def find_added_mass(
    joint_angles: Array,
    fluid: FluidConstants,
    solver: SolverConstants,
    fluid_work: FluidWork,
    mass: Mass,
    effort: Array,
) -> int:
    """Evaluate the added mass of a shape unless it is the last one that was evaluated."""
    if not fluid.present:
        return FINE
    same = mass.known[ADDED] == 1
    if fluid.varies:
        for j in range(joint_angles.size):
            same = same and mass.shape[j] == joint_angles[j]
    if same:
        return FINE
    mass.known[ADDED] = 0
    effort[0] += solver.added_mass_cost
    status: int = added_mass(joint_angles, fluid, fluid_work, mass.added)
    if status == FINE:
        mass.known[ADDED] = 1
        for j in range(joint_angles.size):
            mass.shape[j] = joint_angles[j]
    return status


@linked_kernel
def prepare(
    state: State,
    beam: BeamConstants,
    fluid: FluidConstants,
    solver: SolverConstants,
    body: Body,
    fluid_work: FluidWork,
    newton: Newton,
    effort: Array,
) -> int:
    """Evaluate pose, masses and the velocity M^-1 p of a state; returns 0 or a reason's code.

    The work space remembers which angles its mass belongs to, and which momentum its velocity, so
    asking again costs nothing. Positions do not matter to it.
    """
    q, p, inertia = state.q, state.p, state.inertia
    for i in range(q.size):
        if not (np.isfinite(q[i]) and np.isfinite(p[i])):
            return STATE_NOT_FINITE
    pose, balance, mass = body.pose, body.balance, body.mass
    known = mass.known[TOTAL] == 1
    for i in range(2, q.size):
        known = known and mass.pose[i] == q[i]
    if fluid.varies:
        for j in range(inertia.size):
            known = known and mass.shape[j] == inertia[j]
    same = known
    for i in range(q.size):
        same = same and mass.momentum[i] == p[i]
    if same:
        return FINE
    if not known:
        mass.known[TOTAL] = 0
        mass.momentum[:] = np.nan
        set_pose(q, beam, pose)
        if beam.contact_radius > 0.0:
            radius = beam.contact_radius
            dl = beam.element_length
            if touches_itself(beam.elements, pose.d3, radius, dl, balance.sums):
                return SELF_CONTACT
        status = find_added_mass(inertia, fluid, solver, fluid_work, mass, effort)
        if status != FINE:
            return status
        effort[0] += solver.matrix_cost
        mass_matrix(beam, fluid, body, newton)
        if not cholesky(mass.total):
            return MASS_NOT_POSITIVE
        copy(q, mass.pose)
        mass.known[TOTAL] = 1
    copy(p, mass.velocity)
    cholesky_solve(mass.total, mass.velocity)
    if not np.isfinite(energy_of_pose(p, beam, pose, mass)):
        mass.momentum[:] = np.nan
        return STATE_NOT_FINITE
    copy(p, mass.momentum)
    return FINE
