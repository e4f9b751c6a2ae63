"""Effects that are absent, cross-flow drag and stream: what they do to motions."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swim_env import Simulator, load_scene
from tests.analytic.probes import StepProbe, fluid_constants, rigid_mass
from tests.analytic.test_derivatives import Step, angles_of, head_coordinates, make_step
from tests.invariants.runs import (
    VIOLENT,
    each_scheme,
    largest,
    normals_of,
    orders,
    passive,
    stiff_scene,
)
from tests.reference import independent, stored_runs
from tests.support import PAPERS_STEPS, Array, assert_same, held_torques, rollout

DENSITY = 10.0


# ---- runs that are stored ----------------------------------------------------------------------


Stored = tuple[dict[str, stored_runs.Run], str]


@pytest.fixture(scope="module")
def stored() -> Stored:
    return stored_runs.stored()


@pytest.mark.parametrize("name", sorted(stored_runs.cases()))
def test_stored_runs_change_no_bit(stored: Stored, name: str) -> None:
    runs, machine = stored
    found, wanted = stored_runs.run(stored_runs.cases()[name]), runs[name]
    if stored_runs.machine() == machine:
        said = stored_runs.difference(found, wanted)
        assert not said, f"{name} differs from before: {said}"
    else:
        # Another processor or compiler fuses products and sums in another order. Bits cannot be
        # compared then, but an effect that leaks would show far above what rounding grows to.
        assert found.numbers.shape == wanted.numbers.shape
        assert largest(found.numbers - wanted.numbers) < 1e-9 * largest(wanted.numbers)
        assert found.digests[0] == wanted.digests[0], f"{name} ends otherwise: {found.digests[0]}"


def test_stored_runs_have_cut_steps_and_early_ends(stored: Stored) -> None:
    runs, _ = stored
    assert runs.keys() == stored_runs.cases().keys()
    cut = {name for name, one in runs.items() if (one.counts[2] > 1).any()}
    assert {"cut_steps", "cut_steps_composed"} <= cut
    ended = {name: one.digests[0] for name, one in runs.items() if one.digests[0][-1] != ":"}
    assert ended == {
        "ends_in_contact": "termination_reason:self_contact",
        "ends_unexplained": "termination_reason:energy_unexplained",
    }


# ---- effects that are absent -------------------------------------------------------------------


@pytest.mark.parametrize(
    "effects",
    [{"self_contact": {}}, {"internal_forces": {}}, {"recording": {}}, {"stream.velocity": (0, 0)}],
    ids=lambda effects: next(iter(effects)),
)
@each_scheme
def test_effects_that_only_watch_change_no_bit(effects: dict[str, object], scheme: str) -> None:
    plain = load_scene("swimmer", {"integrator.scheme": scheme})
    torques = held_torques(plain, 80, 1)
    without = Simulator(plain).rollout(torques)
    found = Simulator(plain.replace(effects)).rollout(torques)
    assert_same(found, without, leave_out=("scene", "internal_forces"))


@pytest.mark.parametrize("nothing", [None, 0, [0.0] * 8, {"linear": {"head": 0, "tail": 0}}])
def test_no_stiffness_is_no_stiffness_however_it_is_written(nothing: object) -> None:
    scene = load_scene("paper_i").replace("beam.bending_stiffness", nothing)
    torques = held_torques(scene, 40, 2, 0.003)
    wanted = Simulator(scene.replace("beam.bending_stiffness", 0.0)).rollout(torques)
    assert np.array_equal(Simulator(scene).rollout(torques).centres, wanted.centres)
    # The energy is kinetic alone: a bent body at rest has none.
    assert Simulator(scene.replace("initial.joint_angles", 0.3)).energy() == 0.0


# ---- cross-flow drag ---------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["strip", "frozen", "expansion", "panels"])
@pytest.mark.parametrize("motion", ["sideways", "spinning, N=8", "spinning, N=3"])
def test_a_rigid_body_slows_down_as_its_equation_says(motion: str, model: str) -> None:
    # Sideways, m dv/dt = -rho C l |v| v/2, so v = v0/(1 + k v0 t) and y = log(1 + k v0 t)/k. The
    # moment on a spinning one is -rho C/2 w |w| times the integral of |x|^3, which is l^4/32. Two
    # Gauss points give all of it where the centre is at a node, and 4/(3 sqrt 3) of the part of an
    # element around the centre, on which the sign of the velocity changes.
    coefficient, duration = 2.0, 1.0
    speed, elements = (1.5, 9) if motion == "sideways" else (2.0, int(motion[-1]))
    slope = 0.0 if motion == "sideways" else speed
    changes = {"fluid.model": model, "beam.elements": elements, "initial.velocity_slope": slope}
    changes["initial.velocity"] = (0.0, speed if motion == "sideways" else -0.5 * speed)
    errors = []
    for time_step in (0.02, 0.01, 0.005):
        scene = stiff_scene(coefficient, time_step, changes)
        run, mass = passive(scene, duration), rigid_mass(Simulator(scene))
        if motion == "sideways":
            slowing = DENSITY * coefficient / (2.0 * mass.across)
            found, beside = run.displacement[1], (run.displacement[0], run.heading_change)
        else:
            missing = (1.0 - 4.0 / (3.0 * math.sqrt(3.0))) / elements**4
            share = 1.0 if elements % 2 == 0 else 1.0 - missing
            slowing = share * DENSITY * coefficient / (64.0 * mass.inertia)
            found, beside = run.heading_change, run.displacement
        errors.append(found - math.log1p(slowing * speed * duration) / slowing)
        assert largest(np.array(beside)) < (1e-6 if motion == "sideways" else 1e-9)
    # The drag is taken at the middle of a step, so errors are of second order; those of third were
    # 0.003 of them sideways.
    band, last = (0.02, 2e-6) if motion == "sideways" else (0.05, 5e-5)
    assert largest(orders(errors) - 2.0) < band, f"orders {orders(errors)}, errors {errors}"
    assert abs(errors[-1]) < last, f"errors {errors}"


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
            **PAPERS_STEPS,
            "damping": None,
            "cross_flow_drag.coefficient": coefficient,
            "initial": {"position": (0.4, -1.5), "heading": 0.7, "velocity": (0.3, 0.9)},
        },
    )
    dl, h = scene.beam.element_length, scene.integrator.time_step
    run = Simulator(scene).rollout(held_torques(scene, 100, 3, 0.3))
    turns = np.diff(run.angles, axis=0)
    normals = normals_of(run.angles[:-1] + 0.5 * turns)
    across = np.einsum("tki,tki->tk", normals, np.diff(run.centres, axis=0)) / h
    along, moments, powers = _drag_of_elements(across, turns / h, dl, 0.5 * DENSITY * coefficient)
    forces = along[..., None] * normals
    arms = 0.5 * (run.centres[1:] + run.centres[:-1])
    angular = (arms[..., 0] * forces[..., 1] - arms[..., 1] * forces[..., 0] + moments).sum(1)
    exact = h * np.column_stack([forces.sum(1), angular])
    # Two Gauss points are exact where the velocity has one sign on every element.
    smooth = (np.abs(across) > 0.5 * dl * np.abs(turns / h)).all(1)
    assert smooth.sum() > 20, f"only {smooth.sum()} steps without a change of sign"
    assert np.ptp(run.angles, axis=1).max() > 0.05, "the torques hardly bent the body"
    # Differences of centres divided by the time step leave 1e-13 of the velocity.
    assert largest((run.impulse - exact)[smooth]) < 1e-11 * largest(exact)
    loss = -h * powers.sum(1)
    gap = np.abs(run.dissipated - loss)[smooth].max() / loss.max()
    assert gap < 1e-11, f"losses are off by {gap:.2g} of the largest"
    # Elsewhere an element's force is off by no more than 8 % of what its turning alone would give:
    # with u = a + w x, |a| < w dl/2, the largest of (2 a + 2 a^3/3) - 4 a/sqrt 3 and its like.
    bound = 0.08 * 0.5 * DENSITY * coefficient * dl * (0.5 * dl * np.abs(turns / h)) ** 2
    gap = np.linalg.norm((run.impulse - exact)[:, :2], axis=1)
    assert (gap <= h * bound.sum(1) + 1e-14).all(), "two Gauss points are off by more than they may"


FACTOR = 15.0  # rho C/2


def _moving(elements: int, turning: float, model: str = "none") -> Step:
    """Return a step of a bent body that moves sideways and turns by up to an angle (rad)."""
    density = 0.0 if model == "none" else DENSITY
    fluid = fluid_constants(elements, 4, density=density, model=model)
    step = make_step(elements, fluid, 0.3, elements, retardation=0.0)
    shift = 0.03 * normals_of(step.q[2:].cumsum().mean())
    turns = np.diff(np.random.default_rng(elements).uniform(-turning, turning, elements), prepend=0)
    return step._replace(z=np.concatenate([shift, turns]))


def _drag_in(step: Step) -> StepProbe:
    """Return what drag adds to residual, change of momentum and Jacobian."""
    dragged = step._replace(fluid=step.fluid._replace(drag=FACTOR))
    return StepProbe(*(a - b for a, b in zip(dragged.probe(), step.probe(), strict=True)))


@pytest.mark.parametrize("elements", [2, 5, 9])
def test_drag_acts_on_every_unknown_by_its_virtual_work(elements: int) -> None:
    step = _moving(elements, 0.01)
    dl, h = step.beam.element_length, step.h

    def centres(x: NDArray[Any]) -> NDArray[Any]:
        return independent._redundant(head_coordinates(x, dl), dl)[0]

    x0, x1 = angles_of(step.q), angles_of(step.q + step.z)
    turns = (x1 - x0)[2:]
    normals = normals_of(x0[2:] + 0.5 * turns)
    across = np.einsum("ki,ki->k", normals, centres(x1) - centres(x0)) / h
    assert (np.abs(across) > 0.5 * dl * np.abs(turns) / h).all(), "a sign changes"
    along, moments, _ = _drag_of_elements(across, turns / h, dl, FACTOR)
    halves = []
    for x in (x0, x1):
        moved = centres(x + 1j * independent.STEP * np.eye(len(x))).imag / independent.STEP
        work = np.einsum("xki,ki->x", moved, along[:, None] * normals)
        work[2:] += moments
        halves.append(0.5 * h * work)
    found = _drag_in(step)
    # What is left of momenta that are a hundred times as large.
    scale = float(np.abs(halves[0]).max())
    assert largest(found.residual - halves[0]) < 1e-12 * scale
    assert largest(found.change - halves[0] - halves[1]) < 1e-12 * scale


@pytest.mark.parametrize("model", ["none", "panels"])
def test_newtons_matrix_knows_the_drag(model: str) -> None:
    # It holds the normals at the middle of the step, which takes off a share that falls with the
    # length of the step; a shift of the body leaves normals alone, and its columns are exact.
    case = _moving(6, 0.05, model)
    errors = []
    for length in (1.0, 0.1):
        step, size = case._replace(z=length * case.z), 1e-7 * length
        exact = np.empty((8, 8))
        for column, shift in enumerate(size * np.eye(8)):
            ahead = _drag_in(step._replace(z=step.z + shift)).residual
            behind = _drag_in(step._replace(z=step.z - shift)).residual
            exact[:, column] = (behind - ahead) / (2.0 * size)
        error = np.abs(_drag_in(step).jacobian - exact) / np.abs(exact).max()
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


@pytest.mark.parametrize("stream", [None, {"velocity": (0.3, -0.2)}], ids=["at rest", "stream"])
@each_scheme
def test_drag_takes_energy_in_every_step(scheme: str, stream: object) -> None:
    effects = {"damping": None, "cross_flow_drag": {}, "stream": stream}
    scene = load_scene("swimmer", {**effects, "integrator.scheme": scheme})
    run = rollout(scene, held_torques(scene, 300, 4))
    assert run.dissipated.min() > 0.0, f"{run.dissipated.min():.3g} J lost in a step"
    assert run.dissipated.sum() > 0.01, "the body hardly moved"


@pytest.mark.parametrize("model", ["strip", "panels"])
def test_drag_carries_a_body_at_rest_along_with_the_stream(model: str) -> None:
    # The velocity relative to the stream falls off as that of a body that moves sideways at rest.
    stream, coefficient = 1.5, 2.0
    changes = {"fluid.model": model, "stream": {"velocity": (0.0, stream)}}
    scene = stiff_scene(coefficient, 0.01, changes)
    simulator = Simulator(scene)
    assert not simulator.velocity().any(), "the body does not start at rest"
    slowing = (
        DENSITY * coefficient / (2.0 * rigid_mass(Simulator(scene.replace("stream", None))).across)
    )
    for duration in (0.5, 10.0):
        run = passive(scene, duration)
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
    # bit in the frame of the stream, in which both runs are then the same.
    stream, start = np.array([0.25, -0.5]), np.array([0.125, 0.0625])
    resting = load_scene("swimmer", {**GALILEAN[name], "initial.velocity": tuple(start)})
    carried = resting.replace(
        {"initial.velocity": tuple(start + stream), "stream": {"velocity": tuple(stream)}}
    )
    torques = held_torques(resting, 200, 7)
    if name == "cut steps":
        torques[7::20] = VIOLENT
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


def test_energy_and_momentum_are_those_relative_to_the_stream() -> None:
    stream = (0.25, -0.5)
    moving = {"stream.velocity": stream, "initial.velocity": stream, "actuation": None}
    drifting = load_scene("swimmer", {**PAPERS_STEPS, **moving})
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
