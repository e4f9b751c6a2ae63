"""Entry points for Python: steps of spatial members, energy and momentum of a state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import entry_kernel, kernel
from swim_env.physics.runtime.dense import cholesky_product, copy
from swim_env.physics.solve.budget import begin_budget
from swim_env.physics.solve.state import unexplained_share
from swim_env.physics.spatial.constants import spatial_constants_at
from swim_env.physics.spatial.layout import spatial_member_at
from swim_env.physics.spatial.prepare import energy_of_pose, prepare_spatial
from swim_env.physics.spatial.step import spatial_step
from swim_env.physics.status import ENERGY_UNEXPLAINED, FINE

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@kernel
def _add_stream(sign: float, stream: Array, velocity: Array) -> None:
    """Make a velocity in the stream's frame one over ground; with the sign -1 the reverse."""
    for i in range(3):
        if stream[i] != 0.0:
            velocity[i] += sign * stream[i]


@entry_kernel
def advance_spatial(
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

    Parameters are those of `swim_env.physics.solve.advance.advance`, but for these.

    Parameters
    ----------
    torques : (M, R, N - 1, 3) array
        Joint torques (N m), conjugate to the joints' rotation vectors.
    constants : (C,) array
        The words of the scene's `swim_env.physics.spatial.constants.SpatialConstants`.
    trace : (M, T, 7 N + 6) array
        Overwritten: coordinates and momenta after each of the first T steps; T may be 0.
    record : (M, R hold, 9) array
        Overwritten: a row per step of the first of `swim_env.physics.solve.state.RECORD_NAMES`.
    velocities : (M, 3 N + 3) array
        Overwritten: M^-1 p at the last state: velocity of the mean centre over ground (m/s) and
        angular velocity of every element (rad/s), in the axes of space.
    """
    scene = spatial_constants_at(constants)
    for member in members:
        m = spatial_member_at(places[member])
        q = m.state.q
        p = m.state.p
        steps = torques.shape[1] * hold
        taken = 0
        status = FINE
        while taken < steps and status == FINE:
            held = torques[member, taken // hold]
            status = spatial_step(m, held, scene, record[member, taken])
            if status == FINE:
                if taken < trace.shape[1]:
                    row = trace[member, taken]
                    copy(q, row[: q.size])
                    copy(p, row[q.size : q.size + p.size])
                taken += 1
                if unexplained_share(m.state.counters) > scene.solver.energy_tolerance:
                    status = ENERGY_UNEXPLAINED
        outcome[member, 0] = taken
        outcome[member, 1] = status
        # A state that is handed out has been prepared before, so this does not fail.
        prepare_spatial(m, scene)
        copy(m.body.mass.velocity, velocities[member])
        _add_stream(1.0, scene.fluid.stream, velocities[member])


@entry_kernel
def spatial_energy(
    velocity: Array,
    constants: Integers,
    place: Integers,
) -> tuple[float, int]:
    """Find a member's energy and its velocity M^-1 p; parameters as in `advance_spatial`.

    Returns
    -------
    energy, status : float, int
        H = p M^-1 p/2 + W (J) and 0, or NaN and the code of the reason why there is none.
    """
    scene, m = spatial_constants_at(constants), spatial_member_at(place)
    status = prepare_spatial(m, scene)
    if status != FINE:
        return np.nan, status
    copy(m.body.mass.velocity, velocity)
    _add_stream(1.0, scene.fluid.stream, velocity)
    return energy_of_pose(m.state.p, scene.beam, m.body), FINE


@entry_kernel
def spatial_momentum(
    velocity: Array,
    constants: Integers,
    place: Integers,
) -> float:
    """Start a member by momentum: write p_0 = M v_0 to its state, and begin its energy budget.

    v_0 is in the stream's frame, what is given over ground. Call `spatial_energy` before, which
    prepares the mass of the pose; `velocity` is read.

    Returns
    -------
    float
        The energy of the start (J).
    """
    scene, m = spatial_constants_at(constants), spatial_member_at(place)
    beam, fluid = scene.beam, scene.fluid
    copy(velocity, m.body.mass.velocity)
    _add_stream(-1.0, fluid.stream, m.body.mass.velocity)
    m.body.mass.momentum[:] = np.nan
    cholesky_product(m.body.mass.total, m.body.mass.velocity, m.state.p)
    energy = energy_of_pose(m.state.p, beam, m.body)
    begin_budget(energy, m.state.counters)
    return energy
