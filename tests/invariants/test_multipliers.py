"""The constrained form (34) with multipliers moves as the null space form of the package."""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import ArrayLike

from swim_env import Scene, Simulator, load_scene
from tests.analytic.probes import mass_of
from tests.reference import independent
from tests.reference.multipliers import (
    D1,
    D3,
    Body,
    MultiplierTrajectory,
    Step,
    constraint_jacobian,
    constraints,
    discrete_lagrangian,
    redundant_pose,
    redundant_velocity,
    simulate,
)
from tests.support import Array, uniform

TOLERANCE = 1e-12
#: Bound on differences of the two forms in m, rad, kg m/s and kg m^2/s.
AGREEMENT = 100.0 * TOLERANCE
#: Bound on g, in m and dimensionless: 16 roundings of numbers up to 1.
ROUND_OFF = 16.0 * float(np.finfo(np.float64).eps)
STEPS = 60


class Case(NamedTuple):
    """A scene, its start in minimal coordinates and its torques."""

    scene: Scene
    q0: Array
    velocity: Array
    torques: Array


def make_case(
    changes: dict[str, object],
    pose: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    torques: Array | None = None,
) -> Case:
    scene = load_scene("paper_i", {"integrator.tolerance": TOLERANCE, **changes})
    n = scene.beam.elements
    q0 = np.array([0.5, *np.zeros(n + 1)]) if pose is None else np.array(pose)
    speed = np.zeros(n + 2) if velocity is None else np.array(velocity)
    return Case(scene, q0, speed, np.zeros((STEPS, n - 1)) if torques is None else torques)


def wave(elements: int, amplitude: float = 1.0) -> Array:
    time = 0.01 * np.arange(STEPS)[:, np.newaxis]
    return amplitude * np.cos(2.0 * np.pi * (time - np.arange(1, elements) / elements))


DAMPED = {"damping.retardation_time": 1e-3, "integrator.time_step": 0.005}
# Turned by more than one whole turn, bent by up to 0.4 rad a joint, whirling.
BENT = {
    "beam.elements": 4,
    "beam.bending_stiffness": [0.3, 0.5, 0.2],
    "fluid.panels_per_element": 8,
    "fluid.cap_panels": 3,
}
WHIRLING = ([0.3, -0.2, 7.0, 0.4, -0.3, 0.2], [0.2, -0.1, 2.0, 1.0, 3.0, -1.0])
CASES = {
    "paper_scene": make_case({}, torques=wave(9)),
    "coarse_drifting": make_case(
        {"beam.elements": 3, "fluid.panels_per_element": 12}, velocity=[0.1, 1e-4, 0.0, 0.0, 0.0]
    ),
    "damped_random": make_case(DAMPED, torques=np.repeat(uniform(15, 8, seed=0), 4, axis=0)),
    "bent_whirling": make_case(BENT, *WHIRLING, wave(4, 0.2)),
    "axial_damped": make_case(
        {"beam.elements": 5, "axial_added_mass": {}, **DAMPED},
        [0.5, 0.0, 0.3, 0.1, 0.2, 0.2, 0.1],
        [-0.3, 0.1, 0.2, 0.1, 0.0, -0.1, -0.2],
        np.repeat(uniform(15, 4, seed=1), 4, axis=0),
    ),
    "no_fluid": make_case(
        {"beam.elements": 5, "fluid": None},
        [0.3, 0.4, 1.0, 0.1, 0.2, -0.1, 0.2],
        [0.3, -0.1, 0.2, 0.4, -0.3, 0.1, 0.5],
        wave(5, 0.1),
    ),
}


@pytest.fixture(scope="module", params=CASES)
def solved(request: pytest.FixtureRequest) -> tuple[Case, MultiplierTrajectory]:
    case = CASES[request.param]
    return case, simulate(*case)


def test_both_forms_move_alike(solved: tuple[Case, MultiplierTrajectory]) -> None:
    case, result = solved
    simulator = Simulator(case.scene)
    simulator.reset_to(case.q0, case.velocity)
    run = simulator.rollout(case.torques)
    assert run.steps == STEPS, run.termination_reason
    # Only whole steps can be compared: the form with multipliers does not cut them.
    assert (run.parts == 1.0).all()
    centres = result.coordinates[:, :, 0]
    assert np.abs(np.diff(centres, axis=0)).max() > 1e6 * AGREEMENT
    np.testing.assert_allclose(centres, run.centres, rtol=0.0, atol=AGREEMENT)
    np.testing.assert_allclose(result.angles, run.angles, rtol=0.0, atol=AGREEMENT)
    np.testing.assert_allclose(result.momentum, run.momentum, rtol=0.0, atol=AGREEMENT)
    # Momenta along the motions that the constraints leave free are the minimal ones.
    pose, momenta = result.coordinates[-1], result.conjugate_momenta[-1]
    basis = np.eye(simulator.elements + 2)
    dl = case.scene.beam.element_length
    free = [(redundant_velocity(pose, v, dl) * momenta).sum() for v in basis]
    minimal = mass_of(simulator) @ simulator.velocity()
    np.testing.assert_allclose(free, minimal, rtol=0.0, atol=AGREEMENT)


def test_step_equations_are_solved_and_constraints_hold_to_round_off(
    solved: tuple[Case, MultiplierTrajectory],
) -> None:
    case, result = solved
    for pose in result.coordinates:
        assert np.abs(constraints(pose, case.scene.beam.element_length)).max() <= ROUND_OFF
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
    if not case.velocity.any():
        assert np.abs(result.momentum).max() <= bound


@pytest.mark.parametrize("name", ["bent_whirling", "axial_damped", "no_fluid"])
def test_derivatives_are_those_of_the_discrete_lagrangian(name: str) -> None:
    case = CASES[name]
    h, body = case.scene.integrator.time_step, Body.of(case.scene)
    q = redundant_pose(case.q0, body.dl)
    # Redundant coordinates are free in L_d: this increment leaves the constraints.
    dq = 0.05 * np.random.default_rng(3).normal(size=q.shape)
    step = Step(q, case.torques[0], h, body, *body.added_mass_and_tensor(q))
    by_start, by_end = np.zeros_like(q), np.zeros_like(q)
    for index, unit in zip(np.ndindex(*q.shape), 1j * independent.STEP * step.unit, strict=True):
        by_start[index] = discrete_lagrangian(q + unit, dq - unit, h, body).imag / independent.STEP
        by_end[index] = discrete_lagrangian(q, dq + unit, h, body).imag / independent.STEP
    size = np.abs(by_start).max()
    np.testing.assert_allclose(step.by_start(dq), by_start, rtol=0.0, atol=1e-12 * size)
    np.testing.assert_allclose(step.by_end(dq), by_end, rtol=0.0, atol=1e-13 * size)


def test_trajectory_and_multipliers_solve_the_printed_equations() -> None:
    """Without torques the three-level form (34) holds with the multipliers that are returned."""
    case = make_case(BENT, *WHIRLING, np.zeros((20, 3)))
    result = simulate(*case)
    h, body = case.scene.integrator.time_step, Body.of(case.scene)
    poses = result.coordinates
    steps = [Step(q, np.zeros(3), h, body, *body.added_mass_and_tensor(q)) for q in poses]
    for n in range(1, 20):
        by_start = steps[n].by_start(poses[n + 1] - poses[n])
        by_end = steps[n - 1].by_end(poses[n] - poses[n - 1])
        pull = constraint_jacobian(poses[n], body.dl).T @ result.multipliers[n]
        # Increments are taken from rounded poses here: 1e-16 m times 10 kg/0.01 s.
        np.testing.assert_allclose((by_start + by_end).ravel() - h * pull, 0.0, atol=AGREEMENT)
        assert np.abs(h * pull).max() > 1e-3


def test_chain_multiplier_is_the_force_at_the_node() -> None:
    """A straight beam that spins without a fluid: both nodes carry the tension of the ends."""
    case = make_case({"beam.elements": 3, "fluid": None}, velocity=[0.0, 0.0, 2.0, 2.0, 2.0])
    result = simulate(*case)
    turn = np.diff(result.angles[:, 0])
    dl, line_density = case.scene.beam.element_length, case.scene.beam.line_density
    h = case.scene.integrator.time_step
    # Second difference of the centre of element 1, which runs at a distance dl.
    force = dl * line_density * dl * (2.0 * np.sin(0.5 * turn) / h) ** 2
    expected = force[1:, np.newaxis] * result.coordinates[1:-1, 0, D3]
    assert force.min() > 0.1
    # Element 2 pulls element 1, and element 3 pulls element 2, towards the tail.
    for joint in (slice(9, 11), slice(11, 13)):
        np.testing.assert_allclose(result.multipliers[1:, joint], expected, rtol=0.0, atol=1e-9)
