"""The constrained form (34) with multipliers moves as the null space form that runs."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from swim_env.physics.planar.beam import BeamConstants, centres_of_trajectory
from swim_env.physics.solve.integrator import (
    RECORD_NAMES,
    SolverConstants,
    advance,
    pack_constants,
    state_size,
    weigh,
    work_sizes,
)

from swim_env.errors import SceneError, SimulationEndedError, TorqueError
from swim_env.physics.fluid.added_mass import FLUID_MODELS, FluidConstants
from swim_env.physics.fluid.outline import FluidGeometry
from tests.reference.multipliers import (
    D1,
    D3,
    MultiplierTrajectory,
    constraint_jacobian,
    constraints,
    discrete_lagrangian,
    discrete_lagrangian_by_end,
    discrete_lagrangian_by_start,
    mass_at,
    redundant_pose,
    redundant_velocity,
    simulate_with_multipliers,
)

Array = NDArray[np.float64]

TOLERANCE = 1e-12
#: Bound on differences of the two forms in m, rad, kg m/s and kg m^2/s.
AGREEMENT = 100.0 * TOLERANCE
#: Bound on g, in m and dimensionless: 16 roundings of numbers up to 1.
ROUND_OFF = 16.0 * float(np.finfo(np.float64).eps)
STEPS = 60


class Case(NamedTuple):
    """A beam, its start and its torques."""

    beam: BeamConstants
    fluid: FluidConstants
    time_step: float
    q0: Array
    velocity: Array
    torques: Array


def make_case(
    elements: int,
    panels: int = 4,
    *,
    model: str = "panels",
    axial: bool = False,
    caps: int = 1,
    stiffness: Any = 5.0,
    retardation: float = 0.0,
    time_step: float = 0.01,
    pose: Any = None,
    velocity: Any = None,
    torques: Array | None = None,
) -> Case:
    dl = 1.0 / elements
    rigidity = np.broadcast_to(np.asarray(stiffness, float), (elements - 1,)) / dl
    beam = BeamConstants(
        elements, dl, 0.31 * dl, 7.8e-6 * dl, rigidity.copy(), rigidity * retardation
    )
    geometry = FluidGeometry(elements, dl, 0.01, panels // 2, caps)
    fluid = FluidConstants(FLUID_MODELS[model], geometry, 10.0, axial)
    q0 = np.zeros(elements + 2)
    q0[0] = 0.5
    if pose is not None:
        q0[:] = pose
    speed = np.zeros(elements + 2)
    if velocity is not None:
        speed[:] = velocity
    if torques is None:
        torques = np.zeros((STEPS, elements - 1))
    return Case(beam, fluid, time_step, q0, speed, torques)


def wave(elements: int, time_step: float, amplitude: float = 1.0) -> Array:
    time = np.arange(STEPS)[:, np.newaxis] * time_step
    along = np.arange(1, elements) / elements
    return amplitude * np.cos(2.0 * np.pi * (time - along))


def random_torques(elements: int, seed: int) -> Array:
    held = np.random.default_rng(seed).uniform(-1.0, 1.0, (STEPS // 4, elements - 1))
    return np.repeat(held, 4, axis=0)


CASES = {
    "paper_scene": lambda: make_case(9, torques=wave(9, 0.01)),
    "coarse_drifting": lambda: make_case(3, 12, velocity=[0.1, 1e-4, 0.0, 0.0, 0.0]),
    "damped_random": lambda: make_case(
        9, retardation=1e-3, time_step=0.005, torques=random_torques(9, 0)
    ),
    # Turned by more than one whole turn, bent by up to 0.4 rad a joint, whirling.
    "bent_whirling": lambda: make_case(
        4,
        8,
        caps=3,
        stiffness=[0.3, 0.5, 0.2],
        pose=[0.3, -0.2, 7.0, 0.4, -0.3, 0.2],
        velocity=[0.2, -0.1, 2.0, 1.0, 3.0, -1.0],
        torques=wave(4, 0.01, 0.2),
    ),
    "axial_damped": lambda: make_case(
        5,
        axial=True,
        retardation=1e-3,
        time_step=0.005,
        pose=[0.5, 0.0, 0.3, 0.1, 0.2, 0.2, 0.1],
        velocity=[-0.3, 0.1, 0.2, 0.1, 0.0, -0.1, -0.2],
        torques=random_torques(5, 1),
    ),
    "no_fluid": lambda: make_case(
        5,
        model="none",
        pose=[0.3, 0.4, 1.0, 0.1, 0.2, -0.1, 0.2],
        velocity=[0.3, -0.1, 0.2, 0.4, -0.3, 0.1, 0.5],
        torques=wave(5, 0.01, 0.1),
    ),
}


def by_kernels(case: Case) -> tuple[Array, Array, Array]:
    """Run the null space form; return minimal coordinates, momenta and the record."""
    beam, fluid = case.beam, case.fluid
    floats, integers = (
        np.zeros(size, kind)
        for size, kind in zip(work_sizes(beam, fluid), (np.float64, np.int64), strict=True)
    )
    constants = pack_constants(beam, fluid, SolverConstants(case.time_step, TOLERANCE))
    states = np.zeros((1, state_size(beam.elements)))
    states[0, : case.q0.size] = case.q0
    _, status = weigh(states[0], case.velocity.copy(), True, *constants, floats, integers)
    assert status == 0
    count = case.torques.shape[0]
    trace = np.zeros((1, count, 2 * case.q0.size))
    record = np.zeros((1, count, len(RECORD_NAMES)))
    outcome = np.zeros((1, 2), dtype=np.int64)
    advance(
        np.zeros(1, dtype=np.int64),
        states,
        case.torques[None],
        1,
        *constants,
        floats[None],
        integers[None],
        trace,
        record,
        np.zeros((1, case.q0.size)),
        outcome,
    )
    assert outcome.tolist() == [[count, 0]]
    # Only whole steps can be compared: the form with multipliers does not cut them.
    assert (record[0, :, RECORD_NAMES.index("parts")] == 1.0).all()
    q, p = np.split(trace[0], 2, axis=1)
    return q, p, record[0]


def by_multipliers(case: Case) -> MultiplierTrajectory:
    return simulate_with_multipliers(
        case.beam,
        case.fluid,
        case.q0,
        case.velocity,
        case.torques,
        case.time_step,
        TOLERANCE,
    )


@pytest.fixture(scope="module", params=list(CASES))
def solved(request: pytest.FixtureRequest) -> tuple[Case, MultiplierTrajectory]:
    case = CASES[request.param]()
    return case, by_multipliers(case)


def test_both_forms_move_alike(solved: tuple[Case, MultiplierTrajectory]) -> None:
    case, result = solved
    q, p, _ = by_kernels(case)
    n, dl = case.beam.elements, case.beam.element_length
    centres = np.zeros((q.shape[0], n, 2))
    centres_of_trajectory(q, dl, centres)
    assert np.abs(np.diff(result.centres, axis=0)).max() > 1e6 * AGREEMENT
    np.testing.assert_allclose(result.centres[1:], centres, rtol=0.0, atol=AGREEMENT)
    angles = np.cumsum(q[:, 2:], axis=1)
    np.testing.assert_allclose(result.angles[1:], angles, rtol=0.0, atol=AGREEMENT)
    # Momenta along the motions that the constraints leave free are the minimal ones.
    basis = np.eye(n + 2)
    for pose, momenta, minimal in zip(
        result.coordinates[1:], result.conjugate_momenta[1:], p, strict=True
    ):
        free = [(redundant_velocity(pose, v, dl) * momenta).sum() for v in basis]
        np.testing.assert_allclose(free, minimal, rtol=0.0, atol=AGREEMENT)


def test_step_equations_are_solved_and_constraints_hold_to_round_off(
    solved: tuple[Case, MultiplierTrajectory],
) -> None:
    case, result = solved
    for pose in result.coordinates:
        assert np.abs(constraints(pose, case.beam.element_length)).max() <= ROUND_OFF
    # The mirrored frame would meet the constraints too.
    d1, d3 = result.coordinates[:, :, D1], result.coordinates[:, :, D3]
    handedness = d3[..., 0] * d1[..., 1] - d3[..., 1] * d1[..., 0]
    np.testing.assert_allclose(handedness, 1.0, rtol=0.0, atol=ROUND_OFF)
    assert np.abs(result.multipliers).max() > 1e-6
    # The balance of momentum is solved as well, at every step.
    assert result.residual.max() <= TOLERANCE


def test_momentum_is_conserved(solved: tuple[Case, MultiplierTrajectory]) -> None:
    case, result = solved
    scale = max(1.0, float(np.abs(result.momentum[0]).max()))
    bound = 10.0 * TOLERANCE * scale
    assert np.abs(result.momentum - result.momentum[0]).max() <= bound
    # From rest it is zero; otherwise it is that of the minimal form, whose start is M v_0.
    if not case.velocity.any():
        assert np.abs(result.momentum).max() <= bound
    _, p, _ = by_kernels(case)
    np.testing.assert_allclose(result.momentum[-1, :2], p[-1, :2], rtol=0.0, atol=AGREEMENT)


@pytest.mark.parametrize("name", ["bent_whirling", "axial_damped", "no_fluid"])
def test_derivatives_are_those_of_the_discrete_lagrangian(name: str) -> None:
    case = CASES[name]()
    h, beam, fluid = case.time_step, case.beam, case.fluid
    q = redundant_pose(case.q0, beam.element_length)
    rng = np.random.default_rng(3)
    # Redundant coordinates are free in L_d: this increment leaves the constraints.
    dq = 0.05 * rng.normal(size=q.shape)
    mass, status = mass_at(q, fluid)
    assert status == 0
    by_start = np.zeros_like(q)
    by_end = np.zeros_like(q)
    for index in np.ndindex(*q.shape):
        step = np.zeros(q.shape, complex)
        step[index] = 1e-30j
        by_end[index] = discrete_lagrangian(q, q + dq + step, h, beam, mass).imag / 1e-30
        by_start[index] = discrete_lagrangian(q + step, q + dq, h, beam, mass).imag / 1e-30
        # A(q_n) by central differences.
        shift = np.zeros_like(q)
        shift[index] = 1e-5
        ahead, _ = mass_at(q + shift, fluid)
        behind, _ = mass_at(q - shift, fluid)
        by_start[index] += (
            discrete_lagrangian(q, q + dq, h, beam, ahead)
            - discrete_lagrangian(q, q + dq, h, beam, behind)
        ) / 2e-5
    size = np.abs(by_start).max()
    np.testing.assert_allclose(
        discrete_lagrangian_by_end(q, dq, h, beam, mass), by_end, rtol=0.0, atol=1e-13 * size
    )
    np.testing.assert_allclose(
        discrete_lagrangian_by_start(q, dq, h, beam, mass), by_start, rtol=0.0, atol=1e-8 * size
    )


def test_trajectory_and_multipliers_solve_the_printed_equations() -> None:
    """Without torques the three-level form (34) holds with the multipliers that are returned."""
    case = CASES["bent_whirling"]()._replace(torques=np.zeros((20, 3)))
    result = by_multipliers(case)
    h, beam = case.time_step, case.beam
    poses = result.coordinates
    for n in range(1, 20):
        mass, _ = mass_at(poses[n], case.fluid)
        before, _ = mass_at(poses[n - 1], case.fluid)
        left = (
            discrete_lagrangian_by_start(poses[n], poses[n + 1] - poses[n], h, beam, mass)
            + discrete_lagrangian_by_end(poses[n - 1], poses[n] - poses[n - 1], h, beam, before)
        ).ravel()
        pull = constraint_jacobian(poses[n], beam.element_length).T @ result.multipliers[n]
        # Increments are taken from rounded poses here: 1e-16 m times 10 kg/0.01 s.
        np.testing.assert_allclose(left - h * pull, 0.0, atol=AGREEMENT)
        assert np.abs(h * pull).max() > 1e-3


def test_chain_multiplier_is_the_force_at_the_node() -> None:
    """A straight beam that spins without a fluid: both nodes carry the tension of the ends."""
    case = make_case(3, model="none", velocity=[0.0, 0.0, 2.0, 2.0, 2.0])
    result = by_multipliers(case)
    turn = np.diff(result.angles[:, 0])
    dl, mass = case.beam.element_length, case.beam.element_mass
    # Second difference of the centre of element 1, which runs at a distance dl.
    force = mass * dl * (2.0 * np.sin(0.5 * turn) / case.time_step) ** 2
    tangent = result.coordinates[1:-1, 0, D3]
    expected = force[1:, np.newaxis] * tangent
    assert force.min() > 0.1
    # Element 2 pulls element 1, and element 3 pulls element 2, towards the tail.
    for joint in (slice(9, 11), slice(11, 13)):
        np.testing.assert_allclose(result.multipliers[1:, joint], expected, rtol=0.0, atol=1e-9)


def test_ends_without_a_solution_are_named() -> None:
    folded = make_case(3, pose=[0.5, 0.0, 0.0, 3.0, 0.0])
    with pytest.raises(SimulationEndedError, match="t = 0 s: outline_degenerate") as caught:
        by_multipliers(folded)
    assert (caught.value.reason, caught.value.time) == ("outline_degenerate", 0.0)
    whirling = make_case(3, model="none", velocity=[0.0, 0.0, 60.0, 60.0, 60.0])
    with pytest.raises(SimulationEndedError, match=r"turn_too_large .*by 0\.6\d rad"):
        by_multipliers(whirling)
    massless = make_case(3, model="none")
    massless = massless._replace(
        beam=massless.beam._replace(element_inertia=0.0, joint_stiffness=np.zeros(2)),
        torques=np.ones((1, 2)),
    )
    with pytest.raises(SimulationEndedError, match="step_not_solved .*did not solve"):
        by_multipliers(massless)


def test_arguments_that_do_not_fit_are_refused() -> None:
    case = make_case(3)
    for error, change, words in (
        (
            TorqueError,
            {"torques": np.zeros((5, 3))},
            r"torques must have shape \(T, 2\), got \(5, 3\)",
        ),
        (TorqueError, {"torques": np.full((5, 2), np.inf)}, "torques must be finite"),
        (SceneError, {"velocity": np.zeros(4)}, r"velocity must have shape \(5,\), got \(4,\)"),
        (SceneError, {"q0": np.full(5, np.nan)}, "q0 must be finite"),
        (SceneError, {"time_step": 0.0}, "time_step must be positive and finite, got 0.0"),
        (SceneError, {"fluid": make_case(4).fluid}, "fluid.geometry must wrap the beam's own"),
    ):
        with pytest.raises(error, match=words):
            by_multipliers(case._replace(**change))
