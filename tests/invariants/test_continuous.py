"""The equations in continuous time: the limit of both schemes, and what a solution conserves."""

import functools
import time

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import cumulative_simpson

from swim_env import Scene, SimulationEndedError, Simulator, SwimError, load_scene
from swim_env.analysis.continuous import METHODS, ContinuousRun, _Equations, integrate
from swim_env.physics.invariants import momentum_map
from swim_env.sim.batch import Bodies

Array = NDArray[np.float64]

#: Everything that enters the equations. Joints that differ tell one end from the other.
CASES: dict[str, dict[str, object]] = {
    "plain": {},
    "uneven": {"beam.bending_stiffness": (0.3, 0.8), "initial.joint_angles": (0.05, -0.1)},
    "moving": {"initial.velocity": (0.3, 0.1), "initial.joint_angles": 0.1},
    "damping": {"damping.retardation_time": 0.005},
    "drag in a stream": {"cross_flow_drag.coefficient": 2.0, "stream.velocity": (0.1, 0.05)},
    "axial": {"axial_added_mass": {}},
    "strip": {"fluid.model": "strip"},
    "frozen": {"fluid.model": "frozen"},
    "expansion": {"fluid.model": "expansion"},
    "centreline": {"fluid.model": "centreline"},
    "none": {"fluid": None, "beam.rotary_inertia": 1e-3},
    "ending": {"actuation.end_time": 0.5},
    "mean angles": {"integrator.strain": "mean_angles"},
    "joint angle": {"integrator.strain": "joint_angle"},
}
each_case = pytest.mark.parametrize("case", CASES)

DURATION = 1.0
#: Instants at which runs are compared, besides the start.
INSTANTS = 200
#: Steps a second; without a fluid the paper's scheme is of first order in the torques alone, whose
#: share shows late.
COMPOSED = (200, 400, 800)
PAPER, PAPER_ALONE = (800, 1600), (12_800, 25_600)


def _scene(changes: dict[str, object], steps: int = INSTANTS) -> Scene:
    """Return three soft elements under the paper's wave."""
    return load_scene(
        "paper_i",
        {
            "beam.elements": 3,
            "beam.bending_stiffness": 0.5,
            "actuation.amplitude": 0.2,
            "integrator.tolerance": 1e-13,
            "integrator.time_step": DURATION / steps,
            **changes,
        },
    )


@functools.cache
def _solution(case: str) -> dict[str, Array]:
    # Two digits beyond the smallest error that is compared with it.
    run = integrate(
        _scene(CASES[case]), DURATION, relative_tolerance=1e-10, absolute_tolerance=1e-12
    )
    return {
        "path": run.path,
        "angles": np.cumsum(run.coordinates[:, 2:], axis=1),
        "energy": run.energy,
    }


def _errors(case: str, scheme: str, steps: int) -> dict[str, float]:
    """Return how far a run of the simulator is off."""
    simulator = Simulator(_scene({**CASES[case], "integrator.scheme": scheme}, steps))
    run = simulator.rollout(simulator.prescribed_torques(steps))
    assert run.steps == steps, run.termination_reason
    assert (run.parts == 1).all(), "steps were cut"
    every = slice(None, None, steps // INSTANTS)
    found = {"path": run.path, "angles": run.angles, "energy": run.energy}
    return {
        name: float(np.abs(value[every] - _solution(case)[name]).max())
        for name, value in found.items()
    }


def _compared(case: str) -> tuple[str, ...]:
    # Without a fluid the mean centre never moves.
    return ("angles", "energy") if case == "none" else ("path", "angles", "energy")


# ---- the limit of the schemes ------------------------------------------------------------------


@each_case
def test_composed_steps_converge_to_it_at_second_order(case: str) -> None:
    runs = [_errors(case, "composed", steps) for steps in COMPOSED]
    for name in _compared(case):
        errors = np.array([run[name] for run in runs])
        orders = np.log2(errors[:-1] / errors[1:])
        # The beam alone vibrates faster, 0.97 and 0.98 of the order's two at the worst.
        assert np.abs(orders - 2.0).max() < 0.04, f"{name}: orders {orders}, errors {errors}"


@each_case
def test_the_papers_steps_converge_to_it_at_first_order(case: str) -> None:
    both = PAPER_ALONE if case == "none" else PAPER
    runs = [_errors(case, "paper", steps) for steps in both]
    for name in _compared(case):
        errors = np.array([run[name] for run in runs])
        order = np.log2(errors[0] / errors[1])
        # What is left of the second order is at most 0.07 at these steps.
        assert abs(order - 1.0) < 0.1, f"{name}: order {order:.3f}, errors {errors}"


def test_the_case_is_one_in_which_something_happens() -> None:
    """Bends of 9 degrees and more, and a body that gets somewhere: not the order of nothing."""
    for case in CASES:
        found = _solution(case)
        assert np.abs(np.diff(found["angles"], axis=1)).max() > 0.15, case
        moved = np.abs(found["path"] - found["path"][0]).max()
        assert moved < 1e-14 if case == "none" else moved > 2e-3, f"{case}: {moved:.2e} m"


# ---- the solvers -------------------------------------------------------------------------------


@functools.cache
def _exact(case: str) -> ContinuousRun:
    return integrate(_scene(CASES[case], 50), DURATION, "DOP853", 1e-11, 1e-13)


@pytest.mark.parametrize("method", METHODS)
def test_all_methods_solve_the_same_equations(method: str) -> None:
    scene, exact = _scene(CASES["damping"], 50), _exact("damping")
    run = integrate(scene, DURATION, method, 1e-8, 1e-10)
    assert run.time == pytest.approx(np.arange(51) / 50.0)
    for name in ("coordinates", "momenta", "energy"):
        found, wanted = getattr(run, name), getattr(exact, name)
        assert found.shape == wanted.shape
        # Errors add up over the second: BDF's to 6 times its relative tolerance.
        error = float(np.abs(found - wanted).max())
        assert error < 3e-7, f"{name}: {error:.2e}"


def test_the_place_does_not_matter() -> None:
    """Implicit solvers find that out by ever larger differences, and so try remote ones."""
    equations = _Equations(_scene({"initial.velocity": (0.3, 0.1), "initial.joint_angles": 0.1}))
    state = equations.start()
    remote = state.copy()
    remote[:2] = 1e12, np.inf
    assert (equations(0.1, remote) == equations(0.1, state)).all()
    energies = [equations.energy_and_velocity(0.1, one)[0] for one in (remote, state)]
    assert energies[0] == energies[1] > 0.0


@pytest.mark.parametrize("method", ["LSODA", "Radau"])
def test_every_evaluation_is_counted(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those for Jacobians too, which SciPy leaves out for Radau."""
    forces = _Equations._forces
    made: list[float] = []

    def counted(self: _Equations, time: float, *given: Array) -> Array:
        made.append(time)
        return forces(self, time, *given)

    monkeypatch.setattr(_Equations, "_forces", counted)
    start = time.perf_counter()
    run = integrate(_scene(CASES["ending"], 50), DURATION, method, 1e-4, 1e-6)
    assert run.evaluations == len(made) > 100
    assert 0.0 < run.seconds < time.perf_counter() - start


def test_the_tolerance_bounds_the_error_and_sets_the_cost() -> None:
    scene, exact = _scene(CASES["damping"], 50), _exact("damping")
    runs = [
        integrate(scene, DURATION, relative_tolerance=each, absolute_tolerance=1e-2 * each)
        for each in (1e-4, 1e-6, 1e-8)
    ]
    errors = [float(np.abs(run.coordinates - exact.coordinates).max()) for run in runs]
    assert errors[0] > 10.0 * errors[1] > 100.0 * errors[2], f"errors {errors}"
    costs = [run.evaluations for run in runs]
    assert costs == sorted(costs)
    assert costs[0] < costs[-1]


def test_a_longest_step_is_kept_to() -> None:
    scene = _scene(CASES["damping"], 50)
    free, short = (
        integrate(scene, 0.2, relative_tolerance=1e-4, largest_step=step) for step in (np.inf, 2e-3)
    )
    # 100 steps of 12 stages at the least.
    assert short.evaluations >= 1200 > 2 * free.evaluations
    assert short.coordinates == pytest.approx(free.coordinates, abs=1e-4)


def test_progress_counts_simulated_seconds() -> None:
    found: list[float] = []
    integrate(_scene(CASES["ending"], 50), 0.8, progress=found.append)
    assert found == pytest.approx([0.5, 0.3])


# ---- what is conserved -------------------------------------------------------------------------


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"axial_added_mass": {}},
        {"damping.retardation_time": 0.005},
        {"fluid.model": "strip"},
        {"fluid.model": "expansion"},
        {"fluid.model": "centreline"},
        {"fluid": None, "beam.rotary_inertia": 1e-3},
        {"stream.velocity": (0.1, 0.05)},
    ],
    ids=lambda changes: "+".join(changes) or "plain",
)
def test_momentum_is_conserved(changes: dict[str, object]) -> None:
    """Torques are internal. With the linear momentum constant, the angular one is linear in the
    state, and explicit solvers lose neither: loose tolerances show what the equations do.
    """
    scene = _scene({**CASES["moving"], **changes}, 50)
    run = integrate(scene, DURATION, "DOP853", 1e-4, 1e-6)
    momentum = momentum_map(run.coordinates, run.momenta)
    if scene.stream is not None:
        # Momentum is that in the stream's frame, which carries the origin's arm along.
        x, y = scene.stream.velocity
        momentum[:, 2] -= run.time * (x * momentum[:, 1] - y * momentum[:, 0])
    assert np.abs(momentum[0]).min() > 0.01, "nothing to conserve"
    drift = float(np.abs(momentum - momentum[0]).max())
    assert drift < 1e-13, f"{drift:.2e}"


@pytest.mark.parametrize("method", METHODS)
def test_no_method_loses_more_momentum_than_its_tolerance(method: str) -> None:
    """Implicit solvers stop their iterations somewhere below it."""
    run = integrate(_scene(CASES["moving"], 50), DURATION, method, 1e-6, 1e-8)
    momentum = momentum_map(run.coordinates, run.momenta)
    drift = float(np.abs(momentum - momentum[0]).max())
    assert drift < 1e-8, f"{drift:.2e}"


def test_drag_takes_momentum_as_it_does_from_the_simulator() -> None:
    scene = _scene({**CASES["moving"], "cross_flow_drag.coefficient": 2.0}, 800)
    scene = scene.replace("integrator.scheme", "composed")
    run = integrate(scene, DURATION)
    momentum = momentum_map(run.coordinates, run.momenta)
    simulator = Simulator(scene)
    other = simulator.rollout(simulator.prescribed_torques(800))
    lost = momentum - momentum[0]
    assert np.abs(lost[-1]).max() > 0.05
    # The composed steps' own error at 1/800 s.
    assert lost[1:] == pytest.approx(np.cumsum(other.impulse, axis=0), abs=2e-5)


def _rates(scene: Scene, run: ContinuousRun) -> Array:
    """Return the joints' rates of change from states."""
    bodies = Bodies(scene)
    rates = []
    for q, p in zip(run.coordinates, run.momenta, strict=True):
        bodies.move_to(0, q, p)
        rates.append(np.diff(bodies.energy_and_velocity(0)[1][2:]))
    return np.array(rates)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"damping.retardation_time": 0.005},
        {"fluid.model": "strip", "beam.bending_stiffness": (0.3, 0.8)},
        {
            "fluid.model": "expansion",
            "damping.retardation_time": 0.005,
            "stream.velocity": (0.1, 0.05),
        },
        {"fluid": None, "beam.rotary_inertia": 1e-3},
    ],
    ids=["plain", "damping", "strip", "expansion, damped, in a stream", "none"],
)
def test_energy_is_what_the_torques_put_in_less_what_damping_takes(
    changes: dict[str, object],
) -> None:
    scene = _scene({"initial.joint_angles": 0.1, **changes}, 1000)
    run = integrate(scene, DURATION, relative_tolerance=1e-10, absolute_tolerance=1e-12)
    rates = _rates(scene, run)
    assert scene.actuation is not None
    power = (scene.actuation.torques(run.time, scene.beam) * rates).sum(axis=1)
    if scene.damping is not None:
        stiffness = scene.beam.stiffness_at_joints() / scene.beam.element_length
        loss = scene.damping.retardation_time * (stiffness * rates**2).sum(axis=1)
        # More than a tenth of the energy goes this way.
        assert loss.mean() * DURATION > 0.1 * run.energy.max()
        power -= loss
    put_in = cumulative_simpson(power, x=run.time, initial=0.0)
    error = float(np.abs(run.energy - run.energy[0] - put_in).max())
    # Simpson's rule at 1 ms, whose error falls by 16 with the step: 2e-8 J of the fast beam alone.
    assert error < (5e-8 if scene.fluid is None else 2e-9), f"{error:.2e} J"


def test_torques_end_when_they_should() -> None:
    """Between two instants: the same before, nothing put in behind."""
    end = 0.4567
    scene = _scene({}, 100)
    going = integrate(scene, DURATION)
    ended = integrate(scene.replace("actuation.end_time", end), DURATION)
    assert ended.time == pytest.approx(going.time)
    before = going.time < end
    # Both to the tolerance of 1e-8, with steps of their own.
    assert ended.coordinates[before] == pytest.approx(going.coordinates[before], abs=1e-7)
    assert ended.energy[~before] == pytest.approx(ended.energy[~before][0], rel=1e-7)
    assert np.ptp(going.energy[~before]) > 0.01
    # Those of both parts; the kink between costs a few steps, not a crawl over it.
    assert 0.8 * going.evaluations < ended.evaluations < 2 * going.evaluations


def test_torques_that_have_ended_before_the_start_never_act() -> None:
    run = integrate(_scene({"actuation.end_time": 0.0}), 0.1)
    assert not run.energy.any()
    assert np.ptp(run.coordinates, axis=0).max() == 0.0


# ---- refusals ----------------------------------------------------------------------------------


def test_an_unknown_method_is_refused_with_those_there_are() -> None:
    with pytest.raises(SwimError, match="RK45, DOP853, Radau, BDF, LSODA, got 'RK23'"):
        integrate(_scene({}), DURATION, "RK23")


@pytest.mark.parametrize("duration", [0.0, -1.0, np.nan, np.inf])
def test_a_duration_that_is_none_is_refused(duration: float) -> None:
    with pytest.raises(SwimError, match="duration must be a positive number of seconds"):
        integrate(_scene({}), duration)


@pytest.mark.parametrize(
    ("amplitude", "reason"), [(2.0, "outline_degenerate"), (5.0, "under_resolved_gap")]
)
def test_a_shape_without_an_added_mass_ends_it_by_name(amplitude: float, reason: str) -> None:
    with pytest.raises(SimulationEndedError) as caught:
        integrate(_scene({"actuation.amplitude": amplitude}), DURATION)
    assert caught.value.reason == reason
    assert 0.0 < caught.value.time < 0.5


@pytest.mark.parametrize("method", METHODS)
def test_a_trial_where_there_is_no_added_mass_is_rejected(method: str) -> None:
    # First steps of 0.1 s and more fold the beam; the motion itself bends by 0.04 rad.
    scene = load_scene("swimmer", {"initial.velocity": [0.0, 0.03]})
    steps = Simulator(
        scene.replace({"integrator.time_step": 2.5e-4, "integrator.scheme": "composed"})
    )
    expected = steps.rollout(steps.prescribed_torques(800)).displacement
    path = integrate(scene, 0.2, method).path
    np.testing.assert_allclose(path[-1] - path[0], expected, rtol=0.0, atol=2e-7)
