"""Everything in space that depends on the pose alone: total mass, velocity and energy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import kernel
from swim_env.physics.runtime.dense import cholesky, cholesky_solve, copy, dot
from swim_env.physics.runtime.linking import linked_kernel
from swim_env.physics.spatial.chain import SpatialBeam, set_pose
from swim_env.physics.spatial.constants import SpatialConstants
from swim_env.physics.spatial.joints import elastic_energy
from swim_env.physics.spatial.layout import ADDED, TOTAL, Body, Mass, Member
from swim_env.physics.spatial.matrix import mass_matrix
from swim_env.physics.spatial.panels.mass import PanelWork, panel_added_mass
from swim_env.physics.spatial.panels.surface import LARGEST_JOINT
from swim_env.physics.status import FINE, MASS_NOT_POSITIVE, OUTLINE_DEGENERATE, STATE_NOT_FINITE

Array = NDArray[np.float64]


@kernel
def energy_of_pose(p: Array, beam: SpatialBeam, body: Body) -> float:
    """Return H = p M^-1 p/2 + W (33) (J) of the pose that was prepared."""
    return 0.5 * dot(p, body.mass.velocity) + elastic_energy(beam, body.pose)


@kernel
def find_added_mass(
    directors: Array, scene: SpatialConstants, panels: PanelWork, mass: Mass
) -> int:
    """Evaluate the added mass of a shape, or lay a constant one out once; 0 or a reason's code."""
    fluid = scene.fluid
    if not fluid.present:
        return FINE
    if fluid.varies:
        return panel_added_mass(directors, scene.surface, panels, mass.added)
    if mass.known[ADDED] == 1:
        return FINE
    motions = 6 * directors.shape[0]
    mass.added[:] = 0.0
    for i in range(motions):
        for k in range(motions):
            mass.added[i, k] = fluid.added[motions * i + k]
    mass.known[ADDED] = 1
    return FINE


@linked_kernel
def prepare_spatial(m: Member, scene: SpatialConstants) -> int:
    """Evaluate pose, masses and velocity M^-1 p of a member's state; returns 0 or a reason's code.

    The work space remembers which coordinates its mass belongs to, and which momentum its
    velocity, so asking again costs nothing. Positions do not matter to it.
    """
    state, body, newton, step = m.state, m.body, m.newton, m.step
    beam, fluid, solver = scene.beam, scene.fluid, scene.solver
    q, p = state.q, state.p
    for i in range(q.size):
        if not np.isfinite(q[i]):
            return STATE_NOT_FINITE
    for i in range(p.size):
        if not np.isfinite(p[i]):
            return STATE_NOT_FINITE
    pose, mass = body.pose, body.mass
    known = mass.known[TOTAL] == 1
    for i in range(3, q.size):
        known = known and mass.pose[i] == q[i]
    same = known
    for i in range(p.size):
        same = same and mass.momentum[i] == p[i]
    if same:
        return FINE
    if not known:
        mass.known[TOTAL] = 0
        mass.momentum[:] = np.nan
        set_pose(q, pose)
        for j in range(beam.elements - 1):
            square = 0.0
            for i in range(3):
                square += pose.angles[j, i] * pose.angles[j, i]
            if not square <= LARGEST_JOINT * LARGEST_JOINT:
                return OUTLINE_DEGENERATE
        step.effort[0] += solver.matrix_cost + solver.added_mass_cost
        status = find_added_mass(pose.directors, scene, m.panels, mass)
        if status != FINE:
            return int(status)
        mass_matrix(beam, fluid, body, newton)
        if not cholesky(mass.total):
            return MASS_NOT_POSITIVE
        copy(q, mass.pose)
        mass.known[TOTAL] = 1
    copy(p, mass.velocity)
    cholesky_solve(mass.total, mass.velocity)
    if not np.isfinite(energy_of_pose(p, beam, body)):
        mass.momentum[:] = np.nan
        return STATE_NOT_FINITE
    copy(p, mass.momentum)
    return FINE
