"""What the effects of a scene do to the motion, each against arithmetic of its own."""

from __future__ import annotations

import math
from dataclasses import fields

import numpy as np
import pytest
from numpy.typing import NDArray
from swim_env.physics.planar.beam import BeamConstants

from swim_env import Scene, SimulationEndedError, Simulator, Trajectory, load_scene
from swim_env.physics.fluid.added_mass import FluidConstants
from tests.analytic.probes import StepProbe, fluid_constants, probe_step, rigid_mass
from tests.reference import before_effects, independent

Array = NDArray[np.float64]

DENSITY = 10.0
STREAM = (0.3, -0.2)


def _random_torques(scene: Scene, steps: int, seed: int, limit: float = 1.0) -> Array:
    rng = np.random.default_rng(seed)
    held = rng.uniform(-limit, limit, (steps // 4 + 1, scene.beam.elements - 1))
    return np.repeat(held, 4, axis=0)[:steps]


def _passive(scene: Scene, duration: float) -> Trajectory:
    steps = round(duration / scene.integrator.time_step)
    trajectory = Simulator(scene).rollout(np.zeros((steps, scene.beam.elements - 1)))
    assert trajectory.steps == steps, trajectory.termination_reason
    return trajectory


def _orders(errors: list[float]) -> Array:
    return np.log2(np.abs(errors[:-1]) / np.abs(errors[1:]))


def _normals(angles: Array) -> Array:
    return np.stack([-np.sin(angles), np.cos(angles)], axis=-1)


# ---- effects that are absent -------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(before_effects.scenes()))
def test_absent_effects_change_no_bit(name: str) -> None:
    result = before_effects.run(before_effects.scenes()[name])
    with np.load(before_effects.STORED) as stored:
        wanted, machine = stored[name], str(stored["machine"])
    if before_effects.machine() == machine:
        gap = np.abs(result - wanted).max()
        assert np.array_equal(result, wanted), f"{name} differs by {gap:.2g} from before"
    else:
        # Another processor or compiler fuses products and sums in another order. Bits cannot be
        # compared then, but an effect that leaks would show far above what rounding grows to.
        gap = np.abs(result - wanted).max() / np.abs(wanted).max()
        assert gap < 1e-9, f"{name} differs by {gap:.2g} of the largest number from before"


@pytest.mark.parametrize(
    "effects",
    [{"self_contact": {}}, {"internal_forces": {}}, {"recording": {}}, {"stream.velocity": (0, 0)}],
    ids=lambda effects: next(iter(effects)),
)
@pytest.mark.parametrize("scheme", ["paper", "composed"])
def test_effects_that_only_watch_change_no_bit(effects: dict[str, object], scheme: str) -> None:
    plain = load_scene("swimmer", {"integrator.scheme": scheme})
    torques = _random_torques(plain, 80, 1)
    without = Simulator(plain).rollout(torques)
    found = Simulator(plain.replace(effects)).rollout(torques)
    for field in fields(Trajectory):
        if field.name not in ("scene", "internal_forces"):
            same = np.array_equal(getattr(found, field.name), getattr(without, field.name))
            assert same, f"{field.name} is another with {effects}"


@pytest.mark.parametrize("nothing", [None, 0, [0.0] * 8, {"linear": {"head": 0, "tail": 0}}])
def test_no_stiffness_is_no_stiffness_however_it_is_written(nothing: object) -> None:
    scene = load_scene("paper_i").replace("beam.bending_stiffness", nothing)
    torques = _random_torques(scene, 40, 2, 0.003)
    wanted = Simulator(scene.replace("beam.bending_stiffness", 0.0)).rollout(torques)
    assert np.array_equal(Simulator(scene).rollout(torques).centres, wanted.centres)
    # The energy is kinetic alone: a bent body at rest has none.
    assert Simulator(scene.replace("initial.joint_angles", 0.3)).energy() == 0.0


# ---- cross-flow drag ---------------------------------------------------------------------------

#: Bends the body by less than 1e-6 rad where fluid and drag load it unevenly.
STIFF = 1e5
TIME_STEPS = (0.02, 0.01, 0.005)


def _straight(coefficient: float, time_step: float, changes: dict[str, object]) -> Scene:
    return load_scene(
        "paper_i",
        {
            "actuation": None,
            "beam.bending_stiffness": STIFF,
            "cross_flow_drag.coefficient": coefficient,
            "integrator.time_step": time_step,
            "integrator.tolerance": 1e-13,
            **changes,
        },
    )


@pytest.mark.parametrize("model", ["strip", "frozen", "expansion", "panels"])
def test_a_body_that_moves_sideways_slows_down_as_its_equation_says(model: str) -> None:
    # m dv/dt = -rho C l |v| v/2, so v = v0/(1 + k v0 t) and y = log(1 + k v0 t)/k.
    coefficient, speed, duration = 2.0, 1.5, 1.0
    errors = []
    for time_step in TIME_STEPS:
        changes = {"fluid.model": model, "initial.velocity": (0.0, speed)}
        scene = _straight(coefficient, time_step, changes)
        slowing = DENSITY * coefficient / (2.0 * rigid_mass(Simulator(scene)).across)
        exact = math.log1p(slowing * speed * duration) / slowing
        trajectory = _passive(scene, duration)
        errors.append(trajectory.displacement[1] - exact)
        assert abs(trajectory.displacement[0]) < 1e-6 and abs(trajectory.heading_change) < 1e-6
    # The drag is taken at the middle of a step, so errors are of second order; those of third were
    # 0.003 of them.
    assert np.abs(_orders(errors) - 2.0).max() < 0.02, f"orders {_orders(errors)}, {errors}"
    assert abs(errors[-1]) < 2e-6, f"the way is off by {errors} m"


@pytest.mark.parametrize("model", ["strip", "panels"])
@pytest.mark.parametrize("elements", [8, 3])
def test_a_body_that_spins_slows_down_as_its_equation_says(elements: int, model: str) -> None:
    # The moment is -rho C/2 w |w| times the integral of |x|^3, which is l^4/32. Two Gauss points
    # give all of it where the centre is at a node, and 4/(3 sqrt 3) of the part of an element
    # around the centre, on which the sign of the velocity changes.
    coefficient, rate, duration = 2.0, 2.0, 1.0
    share = 1.0 if elements % 2 == 0 else 1.0 - (1.0 - 4.0 / (3.0 * math.sqrt(3.0))) / elements**4
    errors = []
    for time_step in TIME_STEPS:
        changes = {
            "beam.elements": elements,
            "fluid.model": model,
            "initial.velocity": (0.0, -0.5 * rate),
            "initial.velocity_slope": rate,
        }
        scene = _straight(coefficient, time_step, changes)
        inertia = rigid_mass(Simulator(scene)).inertia
        slowing = share * DENSITY * coefficient / (64.0 * inertia)
        exact = math.log1p(slowing * rate * duration) / slowing
        trajectory = _passive(scene, duration)
        errors.append(trajectory.heading_change - exact)
        assert np.abs(trajectory.displacement).max() < 1e-9, "the centre does not stay"
    assert np.abs(_orders(errors) - 2.0).max() < 0.05, f"orders {_orders(errors)}, {errors}"
    assert abs(errors[-1]) < 5e-5, f"the turn is off by {errors} rad"


def _drag_of_elements(
    across: Array, rates: Array, length: float, factor: float
) -> tuple[Array, Array, Array]:
    """Integrate -factor |u| u, u = across + rate x, over elements with 256 points each.

    Returns the forces along the normals, the moments about the centres, and the powers.
    """
    places, weights = np.polynomial.legendre.leggauss(4)
    cut = (np.arange(64)[:, None] + 0.5 + 0.5 * places) / 64.0 - 0.5
    x = length * cut.ravel()
    dx = np.tile(weights, 64) * length / 128.0
    u = across[..., None] + rates[..., None] * x
    force = -factor * np.abs(u) * u
    return (force * dx).sum(-1), (force * x * dx).sum(-1), (force * u * dx).sum(-1)


def test_recorded_impulses_and_losses_are_those_of_the_force_per_length() -> None:
    coefficient = 1.7
    scene = load_scene(
        "swimmer",
        {
            "damping": None,
            "cross_flow_drag.coefficient": coefficient,
            "initial": {"position": (0.4, -1.5), "heading": 0.7, "velocity": (0.3, 0.9)},
        },
    )
    dl, h = scene.beam.element_length, scene.integrator.time_step
    run = Simulator(scene).rollout(_random_torques(scene, 100, 3, 0.3))
    turns = np.diff(run.angles, axis=0)
    normals = _normals(run.angles[:-1] + 0.5 * turns)
    across = np.einsum("tki,tki->tk", normals, np.diff(run.centres, axis=0)) / h
    along, moments, powers = _drag_of_elements(across, turns / h, dl, 0.5 * DENSITY * coefficient)
    forces = along[..., None] * normals
    arms = 0.5 * (run.centres[1:] + run.centres[:-1])
    angular = (arms[..., 0] * forces[..., 1] - arms[..., 1] * forces[..., 0] + moments).sum(1)
    exact = h * np.column_stack([forces.sum(1), angular])
    # Two Gauss points are exact where the velocity has one sign on every element.
    smooth = (np.abs(across) > 0.5 * dl * np.abs(turns / h)).all(1)
    assert smooth.sum() > 20, f"{smooth.sum()} steps to judge by"
    assert np.ptp(run.angles, axis=1).max() > 0.05, "the torques hardly bent the body"
    # Differences of centres divided by the time step leave 1e-13 of the velocity.
    gap = np.abs(run.impulse - exact)[smooth].max() / np.abs(exact).max()
    assert gap < 1e-11, f"impulses are off by {gap:.2g} of the largest"
    loss = -h * powers.sum(1)
    gap = np.abs(run.dissipated - loss)[smooth].max() / loss.max()
    assert gap < 1e-11, f"losses are off by {gap:.2g} of the largest"
    # Elsewhere an element's force is off by no more than 8 % of what its turning alone would give:
    # with u = a + w x, |a| < w dl/2, the largest of (2 a + 2 a^3/3) - 4 a/sqrt 3 and its like.
    bound = 0.08 * 0.5 * DENSITY * coefficient * dl * (0.5 * dl * np.abs(turns / h)) ** 2
    gap = np.linalg.norm((run.impulse - exact)[:, :2], axis=1)
    assert (gap <= h * bound.sum(1) + 1e-14).all(), "two Gauss points are off by more than they may"


class Drag:
    """One step of a bent, moving body, evaluated with and without drag."""

    FACTOR = 15.0  # rho C/2

    def __init__(self, elements: int, turning: float, model: str = "none") -> None:
        rng = np.random.default_rng(elements)
        dl = 1.0 / elements
        self.elements, self.dl, self.h = elements, dl, 0.01
        stiffness = np.full(elements - 1, 5.0 / dl)
        self.beam = BeamConstants(
            elements, dl, 0.31 * dl, 1e-3 * dl, stiffness, np.zeros(elements - 1)
        )
        density = 0.0 if model == "none" else DENSITY
        self.fluid = fluid_constants(elements, 4, density=density, model=model)
        self.q = np.concatenate([[0.4, -0.7, 2.5], rng.uniform(-0.6, 0.6, elements - 1)])
        self.p, self.torques = rng.normal(size=elements + 2), rng.normal(size=elements - 1)
        shift = 0.03 * np.array([-np.sin(2.5), np.cos(2.5)])
        self.z = np.concatenate([shift, turning * rng.uniform(-1.0, 1.0, elements)])

    def _evaluate(self, z: Array, fluid: FluidConstants) -> StepProbe:
        return probe_step(self.q, self.p, self.torques, z, self.h, self.beam, fluid)

    def own_part(self, z: Array) -> StepProbe:
        """Return what drag adds to residual, change of momentum and Jacobian."""
        with_drag = self._evaluate(z, self.fluid._replace(drag=self.FACTOR))
        without = self._evaluate(z, self.fluid)
        return StepProbe(*(a - b for a, b in zip(with_drag, without, strict=True)))

    def centres(self, x: NDArray) -> NDArray:
        """Return the centres (..., N, 2) of (mean centre, element angles), complex if need be."""
        tangents = np.stack([np.cos(x[..., 2:]), np.sin(x[..., 2:])], axis=-1)
        centres = self.dl * (np.cumsum(tangents, axis=-2) - 0.5 * tangents)
        return centres + (x[..., :2] - centres.mean(axis=-2))[..., None, :]

    def generalised(self, x: Array, forces: Array, moments: Array) -> Array:
        """Return the virtual work of forces at the centres and of moments, per unknown."""
        moved = self.centres(x + 1e-30j * np.eye(len(x))).imag / 1e-30
        work = np.einsum("xki,ki->x", moved, forces)
        work[2:] += moments
        return work


@pytest.mark.parametrize("elements", [2, 5, 9])
def test_drag_acts_on_every_unknown_by_its_virtual_work(elements: int) -> None:
    case = Drag(elements, 0.01)
    x0 = np.concatenate([case.q[:2], np.cumsum(case.q[2:])])
    x1 = np.concatenate([(case.q + case.z)[:2], np.cumsum((case.q + case.z)[2:])])
    turns = (x1 - x0)[2:]
    normals = _normals(x0[2:] + 0.5 * turns)
    across = np.einsum("ki,ki->k", normals, case.centres(x1) - case.centres(x0)) / case.h
    assert (np.abs(across) > 0.5 * case.dl * np.abs(turns) / case.h).all(), "a sign changes"
    along, moments, _ = _drag_of_elements(across, turns / case.h, case.dl, case.FACTOR)
    first, last = (
        0.5 * case.h * case.generalised(x, along[:, None] * normals, moments) for x in (x0, x1)
    )
    found = case.own_part(case.z)
    # What is left of momenta that are a hundred times as large.
    scale = float(np.abs(first).max())
    error = float(np.abs(found.residual - first).max()) / scale
    assert error < 1e-12, f"drag's half impulse at the step's beginning is off by {error:.2g}"
    error = float(np.abs(found.change - first - last).max()) / scale
    assert error < 1e-12, f"drag's whole impulse is off by {error:.2g}"


@pytest.mark.parametrize("model", ["none", "panels"])
def test_newtons_matrix_knows_the_drag(model: str) -> None:
    # It holds the normals at the middle of the step, which takes off a share that falls with the
    # length of the step; a shift of the body leaves normals alone, and its columns are exact.
    case = Drag(6, 0.05, model)
    errors = []
    for length in (1.0, 0.1):
        z, size = length * case.z, 1e-7 * length
        exact = np.empty((8, 8))
        for column, probe in enumerate(size * np.eye(8)):
            ahead, behind = case.own_part(z + probe), case.own_part(z - probe)
            exact[:, column] = (behind.residual - ahead.residual) / (2.0 * size)
        error = np.abs(case.own_part(z).jacobian - exact) / np.abs(exact).max()
        errors.append(error.max())
        # Differences of residuals of order one, over 1e-8, leave 1e-8 of slopes of order one.
        assert error[:, :2].max() < 1e-7, f"columns of a shift are off by {error[:, :2].max():.2g}"
    assert errors[0] < 0.05, f"off by {errors} of the largest"
    assert errors[1] < 0.15 * errors[0], f"errors do not fall with the step: {errors}"


@pytest.mark.parametrize("coefficient", [1.0, 10.0, 100.0])
def test_newtons_corrections_stay_few(coefficient: float) -> None:
    scene = load_scene("swimmer", {"cross_flow_drag.coefficient": coefficient})
    simulator = Simulator(scene)
    run = simulator.rollout(simulator.prescribed_torques(400))
    # 3.9 at most were seen, as without drag, and no more evaluations of the panels.
    assert run.iterations.mean() < 6.0, f"{run.iterations.mean():.2f} corrections a step"
    assert run.evaluations.mean() < 2.2, f"{run.evaluations.mean():.2f} evaluations a step"
    assert (run.parts == 1).all() and not run.at_round_off.any()


@pytest.mark.parametrize("stream", [None, {"velocity": STREAM}], ids=["at rest", "stream"])
@pytest.mark.parametrize("scheme", ["paper", "composed"])
def test_drag_takes_energy_in_every_step(scheme: str, stream: object) -> None:
    changes = {
        "damping": None,
        "cross_flow_drag": {},
        "stream": stream,
        "integrator.scheme": scheme,
    }
    scene = load_scene("swimmer", changes)
    run = Simulator(scene).rollout(_random_torques(scene, 300, 4))
    assert run.steps == 300, run.termination_reason
    assert run.dissipated.min() > 0.0, f"{run.dissipated.min():.3g} J lost in a step"
    assert run.dissipated.sum() > 0.01, "the body hardly moved"


# Sources of momentum: see `tests.invariants.test_momentum` for those without effects.
MOMENTUM_SCENES: dict[str, tuple[str, dict[str, object]]] = {
    "fluid": ("paper_i", {}),
    "damped, axial": ("swimmer", {"axial_added_mass": {}}),
    "strip": ("swimmer", {"fluid.model": "strip"}),
    "composed": ("swimmer", {"integrator.scheme": "composed"}),
}


def _assert_balanced(run: Trajectory, tolerance: float) -> None:
    """Compare |J_n - J_0 - impulses| with 10 tolerances plus 1e-15 n times the size of J's terms.

    Impulses are terms as well, and so is what they swing about the origin.
    """
    change = run.momentum - run.momentum[0]
    change[1:] -= np.cumsum(run.impulse, axis=0)
    drift = np.linalg.norm(change, axis=1)
    linear = np.hypot(*run.momentum[:, :2].T)
    terms = np.maximum(
        np.linalg.norm(run.momentum, axis=1), np.linalg.norm(run.path, axis=1) * linear
    )
    terms[1:] += np.cumsum(np.linalg.norm(run.impulse, axis=1))
    terms = np.maximum.accumulate(terms)
    bound = 10.0 * tolerance + 1e-15 * np.arange(len(drift)) * terms
    worst = int(np.argmax(drift - bound))
    assert drift[worst] <= bound[worst], (
        f"|J_n - J_0 - impulses| = {drift[worst]:.3g} at step {worst}, allowed {bound[worst]:.3g}"
    )


@pytest.mark.parametrize("tolerance", [1e-6, 1e-10, 1e-13])
@pytest.mark.parametrize("effects", ["drag", "stream", "drag, stream"])
@pytest.mark.parametrize("name", MOMENTUM_SCENES)
def test_momentum_changes_by_the_impulse_from_outside(
    name: str, effects: str, tolerance: float
) -> None:
    base, changes = MOMENTUM_SCENES[name]
    start = {"position": (0.4, -1.5), "heading": 0.7, "velocity": (0.3, -0.4)}
    changes = {**changes, "initial": start, "integrator.tolerance": tolerance}
    if "drag" in effects:
        changes["cross_flow_drag"] = {"coefficient": 3.0}
    if "stream" in effects:
        changes["stream"] = {"velocity": (-0.2, 0.5)}
    scene = load_scene(base, changes)
    run = Simulator(scene).rollout(_random_torques(scene, 200, 5))
    assert run.steps >= 100, f"only {run.steps} steps to judge by"
    moved = np.abs(run.momentum - run.momentum[0]).max(axis=0)
    # A stream alone carries a momentum along, which swings about the origin.
    felt = moved if "drag" in effects else moved[2:]
    assert felt.min() > 0.1, f"the momentum changed by {moved} only"
    _assert_balanced(run, tolerance)
    assert run.summary()["momentum_drift"] < 1e-5


@pytest.mark.parametrize("scheme", ["paper", "composed"])
def test_cut_steps_balance_as_well(scheme: str) -> None:
    changes = {
        "cross_flow_drag": {"coefficient": 3.0},
        "stream": {"velocity": (-0.2, 0.5)},
        "initial": {"position": (0.4, -1.5), "velocity": (0.3, -0.4)},
        "integrator.time_step": 0.01,
        "integrator.scheme": scheme,
    }
    scene = load_scene("swimmer", changes)
    torques = _random_torques(scene, 100, 6)
    torques[7::20] = 20.0 * np.tile([1.0, -1.0], 4)
    run = Simulator(scene).rollout(torques)
    assert (run.parts > 1).sum() >= 4, f"{(run.parts > 1).sum()} steps were cut"
    assert run.dissipated.min() > 0.0
    _assert_balanced(run, scene.integrator.tolerance)


@pytest.mark.parametrize(("scheme", "order"), [("paper", 1.0), ("composed", 2.0)])
@pytest.mark.parametrize("stream", [None, {"velocity": STREAM}], ids=["at rest", "stream"])
def test_energy_balance_closes_at_the_schemes_order(
    stream: object, scheme: str, order: float
) -> None:
    # Three elements keep the highest mode resolved, see `tests.invariants.test_energy`.
    errors = []
    for time_step in (0.005, 0.0025, 0.00125):
        changes = {
            "beam.elements": 3,
            "cross_flow_drag": {"coefficient": 4.0},
            "stream": stream,
            "initial.velocity": (0.1, 0.3),
            "integrator": {"time_step": time_step, "tolerance": 1e-12, "scheme": scheme},
        }
        simulator = Simulator(load_scene("paper_i", changes))
        run = simulator.rollout(simulator.prescribed_torques(round(2.0 / time_step)))
        summary = run.summary()
        assert summary["dissipated"] > 0.1 * run.energy.max(), "drag took too little to tell"
        errors.append(summary["energy_drift"])
    assert np.abs(_orders(errors) - order).max() < 0.25, f"{_orders(errors)}, drifts {errors}"
    assert errors[0] < 5e-3, f"drifts {errors}"


@pytest.mark.parametrize("model", ["strip", "panels"])
def test_drag_carries_a_body_at_rest_along_with_the_stream(model: str) -> None:
    # The velocity relative to the stream falls off as that of a body that moves sideways at rest.
    stream, coefficient = 1.5, 2.0
    changes = {"fluid.model": model, "stream": {"velocity": (0.0, stream)}}
    scene = _straight(coefficient, 0.01, changes)
    simulator = Simulator(scene)
    assert not simulator.velocity().any(), "the body does not start at rest"
    slowing = (
        DENSITY * coefficient / (2.0 * rigid_mass(Simulator(scene.replace("stream", None))).across)
    )
    for duration in (0.5, 10.0):
        run = _passive(scene, duration)
        exact = stream * duration - math.log1p(slowing * stream * duration) / slowing
        error = run.displacement[1] - exact
        assert abs(error) < 2e-5, f"carried {run.displacement[1]} m, off by {error:.2g}"
    speed = (run.path[-1, 1] - run.path[-101, 1]) / 1.0
    assert 0.93 * stream < speed < stream, f"{speed:.3f} m/s after 10 s in {stream} m/s"
    assert 0.0 < run.energy[-1] < 0.01 * run.energy[0], "energy is not that relative to the stream"


# ---- stream ------------------------------------------------------------------------------------

GALILEAN: dict[str, dict[str, object]] = {
    "plain": {},
    "drag": {"cross_flow_drag": {"coefficient": 2.0}},
    "axial": {"axial_added_mass": {}},
    "strip, drag": {"fluid.model": "strip", "cross_flow_drag": {}},
    "composed, drag": {"integrator.scheme": "composed", "cross_flow_drag": {}},
    "cut steps": {"integrator.time_step": 0.01, "cross_flow_drag": {}},
}


@pytest.mark.parametrize("name", GALILEAN)
def test_a_stream_carries_the_motion_at_rest_along(name: str) -> None:
    # These numbers and their differences have few digits, so that both starts are the same to the
    # bit in the frame of the stream, where nothing then tells the runs apart.
    stream, start = np.array([0.25, -0.5]), np.array([0.125, 0.0625])
    resting = load_scene("swimmer", {**GALILEAN[name], "initial.velocity": tuple(start)})
    carried = resting.replace(
        {"initial.velocity": tuple(start + stream), "stream": {"velocity": tuple(stream)}}
    )
    torques = _random_torques(resting, 200, 7)
    if name == "cut steps":
        torques[7::20] = 20.0 * np.tile([1.0, -1.0], 4)
    one, other = (Simulator(scene) for scene in (resting, carried))
    at_rest, run = one.rollout(torques), other.rollout(torques)
    assert at_rest.steps == run.steps == 200
    assert (at_rest.parts.max() > 1) == (name == "cut steps")
    for field in ("angles", "energy", "work", "dissipated", "parts"):
        assert np.array_equal(getattr(run, field), getattr(at_rest, field)), field
    assert np.array_equal(run.momentum[:, :2], at_rest.momentum[:, :2])
    gap = np.abs(run.centres - at_rest.centres - np.outer(run.time, stream)[:, None]).max()
    # A step adds two numbers of order one to the position.
    assert gap < 200 * 4e-16, f"the path is off by {gap:.2g} m"
    # Velocities are those over ground.
    there = one.velocity() + np.concatenate([stream, np.zeros(9)])
    assert np.abs(other.velocity() - there).max() < 1e-15


def test_a_stream_of_any_velocity_carries_along() -> None:
    # Here starts differ by rounding, which the light modes of the chain let grow.
    stream = np.array([0.3141, -0.2718])
    resting = load_scene("swimmer", {"cross_flow_drag": {}})
    changes = {"initial.velocity": tuple(stream), "stream.velocity": tuple(stream)}
    torques = _random_torques(resting, 200, 8)
    at_rest = Simulator(resting).rollout(torques)
    run = Simulator(resting.replace(changes)).rollout(torques)
    gap = np.abs(run.centres - at_rest.centres - np.outer(run.time, stream)[:, None]).max()
    assert gap < 1e-9, f"the path is off by {gap:.2g} m"
    assert np.abs(run.angles - at_rest.angles).max() < 1e-9


def test_energy_and_momentum_are_those_relative_to_the_stream() -> None:
    stream = (0.25, -0.5)
    drifting = load_scene(
        "swimmer", {"stream.velocity": stream, "initial.velocity": stream, "actuation": None}
    )
    simulator = Simulator(drifting)
    assert simulator.energy() == 0.0 and not simulator.momentum().any()
    simulator.rollout(np.zeros((10, 8)))
    assert simulator.energy() < 1e-25 and np.abs(simulator.momentum()).max() < 1e-13
    assert np.abs(simulator.velocity()[:2] - stream).max() < 1e-15
    # A body that the ground sees at rest moves against the stream.
    held = Simulator(drifting.replace("initial.velocity", (0.0, 0.0)))
    against = Simulator(
        drifting.replace({"stream": None, "initial.velocity": (-stream[0], -stream[1])})
    )
    assert held.energy() == against.energy() > 0.0
    assert np.array_equal(held.momentum(), against.momentum())
    assert not held.velocity().any()


# ---- self-contact ------------------------------------------------------------------------------


def _point_gap(point: Array, start: Array, end: Array) -> float:
    """Return the distance of a point from a segment."""
    along = np.clip((point - start) @ (end - start) / ((end - start) @ (end - start)), 0.0, 1.0)
    return float(np.linalg.norm(point - start - along * (end - start)))


def _segment_gap(a: Array, b: Array, c: Array, d: Array) -> float:
    """Return the distance of the segments ab and cd.

    It is the least value of a convex function over a square: the best of the corners, of the edges,
    and of the inside where the lines meet there.
    """
    gap = min(_point_gap(a, c, d), _point_gap(b, c, d), _point_gap(c, a, b), _point_gap(d, a, b))
    sides = np.column_stack([b - a, c - d])
    if abs(np.linalg.det(sides)) > 1e-14:
        s, t = np.linalg.solve(sides, c - a)
        if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
            return 0.0
    return gap


def _touches(angles: Array, length: float, radius: float) -> tuple[bool, float]:
    """Tell whether stadia overlap that are half a turn around the radius apart along the body.

    Also how close the decision was (m).
    """
    dl = length / len(angles)
    steps = dl * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    nodes = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    touching, margin = False, np.inf
    for k in range(len(angles)):
        for m in range(k + 1, len(angles)):
            # Neighbours share a node, their other ends are an element apart.
            if max(m - k - 1, 1) * dl < math.pi * radius:
                continue
            here, there = (nodes[k], nodes[k + 1]), (nodes[m], nodes[m + 1])
            if m == k + 1:
                gap = min(_point_gap(there[1], *here), _point_gap(here[0], *there))
            else:
                gap = _segment_gap(*here, *there)
            touching |= gap < 2.0 * radius
            margin = min(margin, abs(gap - 2.0 * radius))
    return touching, margin


def _watched(elements: int, half_thickness: float, **changes: object) -> Scene:
    return load_scene(
        "paper_i",
        {
            "fluid": None,
            "actuation": None,
            "self_contact": {},
            "beam.elements": elements,
            "beam.half_thickness": half_thickness,
            **changes,
        },
    )


def _is_reported(simulator: Simulator, angles: Array) -> bool:
    coordinates = np.concatenate([[0.3, -0.2, angles[0]], np.diff(angles)])
    try:
        simulator.reset_to(coordinates, np.zeros(len(coordinates)))
    except SimulationEndedError as error:
        assert error.reason == "self_contact"
        return True
    return False


@pytest.mark.parametrize("elements", [2, 3, 5, 9, 20])
@pytest.mark.parametrize("share", [0.001, 0.1, 0.31, 0.33, 0.7, 2.0])
def test_contact_is_that_of_the_stadia(elements: int, share: float) -> None:
    # Half thicknesses around dl/pi, from where on neighbours are too near to touch.
    radius = share / elements
    simulator = Simulator(_watched(elements, radius))
    rng = np.random.default_rng(elements)
    found = []
    for bend in np.linspace(0.2, 3.1, 30):
        joints = rng.uniform(-bend, bend, elements - 1)
        # Half of the poses curl one way, the others fold both ways.
        angles = np.cumsum(np.concatenate([rng.uniform(-3.0, 3.0, 1), joints]))
        if rng.random() < 0.5:
            angles = np.linspace(0.0, 2.5 * bend, elements) + 0.3 * rng.normal()
        wanted, margin = _touches(angles, 1.0, radius)
        if margin > 1e-12:
            assert _is_reported(simulator, angles) == wanted, f"{angles.tolist()}, {margin:.2g}"
            found.append(wanted)
    assert len(found) > 25
    # Both answers came up, but where all elements are too near along the body to touch. Two alone
    # touch in poses that chance may not find, see below.
    possible = (elements - 2) / elements >= math.pi * radius
    if elements > 2:
        assert any(found) == possible, f"{sum(found)} of {len(found)} touch"
    assert not all(found)


def test_segments_that_cross_are_seen_however_thin() -> None:
    # No end is near the other segment: only the crossing tells.
    simulator = Simulator(_watched(3, 1e-9))
    crossing = np.array([0.0, 0.75 * math.pi, 1.5 * math.pi])
    assert _touches(crossing, 1.0, 1e-9)[0]
    assert _is_reported(simulator, crossing)
    assert not _is_reported(simulator, np.array([0.0, 0.6 * math.pi, 1.2 * math.pi]))


@pytest.mark.parametrize("half_thickness", [0.001, 0.05, 0.2, 0.249])
@pytest.mark.parametrize("elements", [2, 9, 40, 150])
def test_a_straight_body_does_not_touch_itself(elements: int, half_thickness: float) -> None:
    # However many elements are within its thickness of each other.
    simulator = Simulator(_watched(elements, half_thickness))
    assert not _is_reported(simulator, np.full(elements, 0.4))
    # Nor does one that is bent less than its own thickness allows.
    radius = max(1.5 * half_thickness, 0.25)
    gentle = np.linspace(0.0, (1.0 - 1.0 / elements) / radius, elements)
    assert not _is_reported(simulator, gentle)


def test_neighbours_touch_where_the_joint_folds() -> None:
    # The far end of one is 2 dl sin(a/2) off the other's, and dl sin(a) off its line, when folded
    # back by pi - a.
    radius, dl = 0.02, 0.5
    simulator = Simulator(_watched(2, radius))
    limit = math.asin(2.0 * radius / dl)
    for off, touching in ((-1e-9, True), (1e-9, False)):
        angle = math.pi - (limit + off)
        assert _is_reported(simulator, np.array([0.0, angle])) is touching
        assert _is_reported(simulator, np.array([0.7, 0.7 - angle])) is touching


CURLS: dict[str, dict[str, object]] = {
    "none": {"fluid": None},
    "strip": {"fluid.model": "strip"},
    "frozen": {"fluid.model": "frozen"},
    "expansion": {"fluid.model": "expansion"},
    "panels": {},
    "composed": {"fluid.model": "strip", "integrator.scheme": "composed"},
    "drag in a stream": {
        "fluid.model": "strip",
        "cross_flow_drag": {},
        "stream": {"velocity": STREAM},
    },
}


@pytest.mark.parametrize("name", CURLS)
def test_a_run_that_curls_ends_before_it_touches(name: str) -> None:
    scene = load_scene(
        "paper_i",
        {
            "actuation": None,
            "beam.bending_stiffness": 0.5,
            "damping": {"retardation_time": 0.02},
            "integrator.time_step": 0.005,
            "self_contact": {},
            **CURLS[name],
        },
    )
    torques = np.full((200, 8), 8.0)
    simulator = Simulator(scene)
    run = simulator.rollout(torques)
    assert run.termination_reason == simulator.termination_reason == "self_contact"
    assert 3 < run.steps < 100
    assert np.array_equal(simulator.angles, run.angles[-1])
    assert np.isfinite(simulator.energy())
    assert not any(_touches(angles, 1.0, 0.01)[0] for angles in run.angles)
    with pytest.raises(SimulationEndedError, match="self_contact"):
        simulator.step(np.zeros(8))
    # Without the effect the same run goes on to the pose that touches, unless the panels refuse it.
    unwatched = Simulator(scene.replace("self_contact", None))
    beyond = unwatched.rollout(torques[: run.steps + 1])
    assert np.array_equal(beyond.angles[: run.steps + 1], run.angles)
    if beyond.steps > run.steps:
        assert _touches(beyond.angles[-1], 1.0, 0.01)[0], "the next pose does not touch"
    else:
        assert scene.fluid is not None and scene.fluid.model == "panels", beyond.termination_reason


def test_a_start_that_touches_is_refused() -> None:
    with pytest.raises(SimulationEndedError, match="t = 0 s: self_contact"):
        Simulator(_watched(9, 0.01, **{"initial.joint_angles": 0.9}))


# ---- internal forces ---------------------------------------------------------------------------


def _net_forces(run: Trajectory) -> Array:
    """Return what every element gets from its neighbours (T, N, 2), from joint to joint."""
    assert run.internal_forces is not None
    return np.diff(np.pad(run.internal_forces, ((0, 0), (1, 1), (0, 0))), axis=1)


@pytest.mark.parametrize(
    "changes",
    [{}, {"damping": None}, {"beam.bending_stiffness": None, "damping": None}],
    ids=["damped", "elastic", "loose"],
)
def test_without_fluid_forces_are_mass_times_acceleration(changes: dict[str, object]) -> None:
    scene = load_scene("swimmer", {"fluid": None, "internal_forces": {}, **changes})
    limit = 0.01 if scene.beam.bending_stiffness == 0.0 else 1.0
    run = Simulator(scene).rollout(_random_torques(scene, 120, 9, limit))
    assert run.steps >= 60, run.termination_reason
    mass = scene.beam.element_length * scene.beam.line_density
    second = np.diff(run.centres, n=2, axis=0) / scene.integrator.time_step**2
    net = _net_forces(run)[1:]
    error = np.abs(mass * second - net).max() / np.abs(run.internal_forces[1:]).max()
    # Rounding of centres over dt^2 is 1e-11 m/s^2, forces are of order 1 to 100 N.
    assert error < 1e-9, f"forces miss mass times acceleration by {error:.2g} of the largest"


FORCE_SCENES: dict[str, dict[str, object]] = {
    "panels": {},
    "axial": {"axial_added_mass": {}},
    "drag": {"cross_flow_drag": {"coefficient": 3.0}},
    "drag, stream, axial": {
        "cross_flow_drag": {"coefficient": 3.0},
        "stream": {"velocity": STREAM},
        "axial_added_mass": {},
    },
}


@pytest.mark.parametrize("name", FORCE_SCENES)
def test_with_fluid_forces_balance_the_momenta_of_elements(name: str) -> None:
    # An element carries its own momentum and the fluid's impulse on its own panels, the added mass
    # here being that of the independent implementation; drag acts by halves at a step's ends.
    start = {"heading": 0.7, "velocity": (0.3, -0.4), "joint_angles": 0.1}
    scene = load_scene("swimmer", {"internal_forces": {}, "initial": start, **FORCE_SCENES[name]})
    run = Simulator(scene).rollout(_random_torques(scene, 24, 10))
    n, dl, h = 9, scene.beam.element_length, scene.integrator.time_step
    stream = np.array(scene.stream.velocity if scene.stream else (0.0, 0.0))
    moves = np.diff(run.centres, axis=0) - h * stream
    turns = np.diff(run.angles, axis=0)
    momenta = dl * scene.beam.line_density * moves / h
    axial = scene.axial_added_mass is not None
    for step, angles in enumerate(run.angles[:-1]):
        mass = independent.added_mass(
            np.diff(angles),
            length=1.0,
            elements=n,
            half_thickness=scene.beam.half_thickness,
            density=DENSITY,
            panels_per_element=4,
            cap_panels=1,
            axial=axial,
        )
        normals = _normals(angles)
        tangents = np.stack([normals[:, 1], -normals[:, 0]], axis=-1)
        motion = [(normals * moves[step]).sum(1), np.sin(turns[step])]
        motion += [(tangents * moves[step]).sum(1)] if axial else []
        impulse = mass @ np.concatenate(motion) / h
        momenta[step] += impulse[:n, None] * normals
        if axial:
            momenta[step] += impulse[2 * n :, None] * tangents
    drag = np.zeros_like(momenta)
    if scene.cross_flow_drag:
        # Two points, as the kernel has them: sums over the body are tested above.
        normals = _normals(run.angles[:-1] + 0.5 * turns)
        across = np.einsum("tki,tki->tk", normals, moves) / h
        factor = 0.5 * DENSITY * scene.cross_flow_drag.coefficient
        for side in (-1.0, 1.0):
            u = across + side * dl / math.sqrt(12.0) * turns / h
            drag -= (0.5 * h * dl * factor * np.abs(u) * u)[..., None] * normals
    wanted = (momenta[1:] - momenta[:-1] - 0.5 * (drag[1:] + drag[:-1])) / h
    error = np.abs(_net_forces(run)[1:] - wanted).max() / np.abs(run.internal_forces[1:]).max()
    # The step's tolerance over dt, 2e-8 kg m/s^2, against forces of order 10 N.
    assert error < 1e-8, f"forces miss the momentum balance by {error:.2g} of the largest"


@pytest.mark.parametrize(
    "scheme",
    [
        "paper",
        "composed",
    ],
)
@pytest.mark.parametrize("elements", [2, 5, 8])
def test_a_spinning_beam_is_under_tension(elements: int, scheme: str) -> None:
    # rho_B A w^2 (l^2/4 - x^2)/2, which is exact for masses at the elements' centres; in steps,
    # w^2 is 2 (1 - cos(w dt))/dt^2. The body is under it at the beginning of the step.
    rate = 3.0
    scene = load_scene(
        "paper_i",
        {
            "fluid": None,
            "actuation": None,
            "internal_forces": {},
            "beam.elements": elements,
            "initial.velocity": (0.0, -0.5 * rate),
            "initial.velocity_slope": rate,
            "integrator": {"tolerance": 1e-13, "scheme": scheme},
        },
    )
    run = _passive(scene, 0.5)
    assert run.internal_forces is not None
    angles = run.angles[:-1].mean(axis=1)
    tangents = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    along = np.einsum("tji,ti->tj", run.internal_forces, tangents)[1:]
    across = np.einsum("tji,ti->tj", run.internal_forces, _normals(angles))[1:]
    turn, h = run.heading_change / run.steps, scene.integrator.time_step
    places = scene.beam.joint_fractions - 0.5
    square = 2.0 * (1.0 - math.cos(turn)) / h**2
    tension = 0.5 * scene.beam.line_density * square * (0.25 - places**2)
    assert abs(square / rate**2 - 1.0) < 1e-3
    worst = np.abs(along / tension - 1.0).max()
    # The composed scheme has steps of half the length, so it may differ in (w dt)^2.
    assert worst < (1e-9 if scheme == "paper" else rate**2 * h**2), f"tension off by {worst:.2g}"
    worst = np.abs(across).max() / tension.max()
    assert worst < (1e-9 if scheme == "paper" else rate**2 * h**2), f"{worst:.2g} of it is shear"


@pytest.mark.parametrize(("scheme", "rate"), [("paper", 52.0), ("composed", 101.0)])
def test_steps_in_parts_are_under_the_same_tension(scheme: str, rate: float) -> None:
    # So fast that steps have to be cut, until drag has slowed the turning down to half a radian in
    # a step, or in half of one. Hardly any fluid moves with the body.
    changes = {
        "internal_forces": {},
        "beam.elements": 4,
        "fluid": {"model": "strip", "density": DENSITY, "added_mass_per_length": 1e-9},
        "initial.velocity": (0.0, -0.5 * rate),
        "initial.velocity_slope": rate,
        "integrator.scheme": scheme,
    }
    scene = _straight(0.0015, 0.01, changes)
    run = _passive(scene, 0.8)
    assert {1.0, 2.0} == set(run.parts), "steps were to be cut, and then whole again"
    turns = np.diff(run.angles.mean(axis=1)) / 0.01
    rates = 0.5 * (turns[1:] + turns[:-1])
    places = scene.beam.joint_fractions - 0.5
    tension = 0.5 * scene.beam.line_density * np.outer(rates**2, 0.25 - places**2)
    assert run.internal_forces is not None
    share = np.linalg.norm(run.internal_forces[1:], axis=-1) / tension
    # The mean over a step in which the body turns by up to a radian takes (sin(1/2)/(1/2))^2 off,
    # 8 %. Time that is counted twice or not at all where steps become whole would make a quarter.
    assert 0.91 < share.min() and share.max() < 1.0, f"{share.min():.3f} to {share.max():.3f} of it"


def test_evenly_loaded_elements_do_not_pull_at_each_other() -> None:
    # Strips and drag load all elements alike; panels load the ends less, which takes shear.
    changes = {"internal_forces": {}, "stream": {"velocity": (0.0, 1.0)}}
    even = _passive(_straight(2.0, 0.01, {**changes, "fluid.model": "strip"}), 0.5)
    uneven = _passive(_straight(2.0, 0.01, changes), 0.5)
    assert even.internal_forces is not None and uneven.internal_forces is not None
    # The drag on an element is 1 N at first; the tolerance over dt is 1e-11.
    assert np.abs(even.internal_forces[1:]).max() < 1e-9
    axial, shear = np.moveaxis(uneven.internal_forces[1:], -1, 0)
    # The load sets in suddenly. Normals that ring by 1e-6 rad in a step turn 8 kg m/s of the fluid.
    assert np.abs(axial).max() < 1e-3 * np.abs(shear).max(), "a straight body is pulled along"
    assert np.abs(shear).max() > 0.1
    gap = np.abs(shear + shear[:, ::-1]).max() / np.abs(shear).max()
    assert gap < 1e-6, f"head and tail are not loaded alike, by {gap:.2g}"


def test_internal_forces_in_chunks_are_those_of_one_rollout() -> None:
    scene = load_scene("swimmer", {"internal_forces": {}, "cross_flow_drag": {}})
    torques = _random_torques(scene, 450, 11)
    simulator = Simulator(scene)
    whole = simulator.rollout(torques).internal_forces
    assert whole is not None and whole.shape == (450, 8, 2)
    # At the start nothing is known of the step before.
    assert np.isnan(whole[0]).all() and np.isfinite(whole[1:]).all()
    simulator.reset()
    chunks = [
        simulator.rollout(torques[first : first + 90]).internal_forces
        for first in range(0, 450, 90)
    ]
    assert np.array_equal(np.concatenate(chunks), whole, equal_nan=True)
    simulator.reset()
    watched = simulator.rollout(torques, progress=lambda steps: None).internal_forces
    assert np.array_equal(watched, whole, equal_nan=True)
    assert np.isnan(Simulator(scene).rollout(torques[:1]).internal_forces).all()


def test_internal_forces_go_on_after_single_steps() -> None:
    scene = load_scene("swimmer", {"internal_forces": {}})
    torques = _random_torques(scene, 20, 11)
    whole = Simulator(scene).rollout(torques).internal_forces
    simulator = Simulator(scene)
    for row in torques[:10]:
        simulator.step(row)
    rest = simulator.rollout(torques[10:]).internal_forces
    assert whole is not None and rest is not None
    assert np.array_equal(rest, whole[10:]), f"{rest[0, 0]} instead of {whole[10, 0]}"


def test_internal_forces_after_a_snapshot_know_nothing_of_a_step_that_was_taken_back() -> None:
    scene = load_scene("swimmer", {"internal_forces": {}})
    torques = _random_torques(scene, 12, 11)
    simulator = Simulator(scene)
    simulator.rollout(torques[:10])
    kept = simulator.snapshot()
    wanted = simulator.rollout(torques[10:]).internal_forces
    simulator.reset()
    simulator.rollout(torques[:10])
    simulator.step(-torques[10])
    simulator.restore(kept)
    found = simulator.rollout(torques[10:]).internal_forces
    assert found is not None and wanted is not None
    known = np.isfinite(found)
    assert np.array_equal(found[known], wanted[known]), f"{found[0, 0]} instead of {wanted[0, 0]}"


def test_internal_forces_after_a_snapshot_begin_anew_or_go_on() -> None:
    scene = load_scene("swimmer", {"internal_forces": {}})
    torques = _random_torques(scene, 30, 12)
    simulator = Simulator(scene)
    whole = simulator.rollout(torques).internal_forces
    simulator.reset()
    simulator.rollout(torques[:20])
    kept = simulator.snapshot()
    simulator.restore(kept)
    assert np.array_equal(simulator.rollout(torques[20:]).internal_forces, whole[20:])
    # Elsewhere, or after other steps, the step before the snapshot is not known.
    other = Simulator(scene)
    for one in (simulator, other):
        one.restore(kept)
        forces = one.rollout(torques[20:]).internal_forces
        assert np.isnan(forces[0]).all() and np.array_equal(forces[1:], whole[21:])


def test_a_step_that_failed_leaves_nothing_in_the_internal_forces() -> None:
    changes = {"internal_forces": {}, "damping": {"retardation_time": 0.02}}
    scene = _watched(9, 0.03, **changes, **{"beam.bending_stiffness": 0.5})
    scene = scene.replace("integrator.time_step", 0.005)
    simulator = Simulator(scene)
    simulator.rollout(np.full((4, 8), 8.0))
    kept = simulator.snapshot()
    wanted = simulator.rollout(np.full((1, 8), -8.0)).internal_forces
    simulator.reset()
    simulator.rollout(np.full((4, 8), 8.0))
    with pytest.raises(SimulationEndedError, match="self_contact"):
        simulator.step(np.full(8, 300.0))
    simulator.restore(kept)
    found = simulator.rollout(np.full((1, 8), -8.0)).internal_forces
    known = np.isfinite(found)
    assert np.allclose(found[known], wanted[known], rtol=1e-9), f"{found[0, 0]}, {wanted[0, 0]}"


@pytest.mark.parametrize(
    "scheme",
    [
        "paper",
        "composed",
    ],
)
def test_cut_steps_have_internal_forces(scheme: str) -> None:
    changes = {"internal_forces": {}, "integrator": {"time_step": 0.01, "scheme": scheme}}
    scene = load_scene("swimmer", changes)
    torques = _random_torques(scene, 40, 13)
    torques[7::20] = 20.0 * np.tile([1.0, -1.0], 4)
    run = Simulator(scene).rollout(torques)
    assert run.internal_forces is not None
    assert (run.parts > 1).sum() >= 2, f"{(run.parts > 1).sum()} steps were cut"
    unknown = np.flatnonzero(np.isnan(run.internal_forces).any(axis=(1, 2)))
    assert unknown.tolist() == [0], f"no forces in steps {unknown}"


@pytest.mark.parametrize("fluid", [True, False], ids=["fluid", "none"])
def test_internal_forces_of_both_schemes_approach_each_other(fluid: bool) -> None:
    runs: dict[str, list[Array]] = {}
    steps = (100, 200, 400)
    for scheme in ("paper", "composed"):
        for count in steps:
            changes: dict[str, object] = {
                "actuation": None,
                "internal_forces": {},
                "beam.elements": 3,
                "beam.bending_stiffness": 0.4,
                "initial": {"joint_angles": 0.3, "velocity": (0.2, 0.3)},
                "integrator": {"time_step": 0.4 / count, "tolerance": 1e-12, "scheme": scheme},
            }
            changes |= (
                {"cross_flow_drag": {}} if fluid else {"fluid": None, "beam.rotary_inertia": 1e-3}
            )
            run = _passive(load_scene("paper_i", changes), 0.4)
            assert run.internal_forces is not None
            runs.setdefault(scheme, []).append(run.internal_forces[count // 4 :: count // 4])
    gaps = [float(np.abs(a - b).max()) for a, b in zip(*runs.values(), strict=True)]
    largest = float(np.abs(runs["paper"][-1]).max())
    assert (_orders(gaps) > 0.8).all(), f"orders {_orders(gaps)}, gaps {gaps} N"
    assert gaps[-1] < 0.05 * largest, f"gaps {gaps} N of {largest:.3g} N"
