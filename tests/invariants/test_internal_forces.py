"""Internal forces at the joints against the momentum balance of the elements."""

import math

import numpy as np
import pytest

from swim_env import SimulationEndedError, Simulator, Trajectory, load_scene
from tests.invariants.runs import (
    SCHEMES,
    VIOLENT,
    each_scheme,
    largest,
    normals_of,
    orders,
    passive,
    stiff_scene,
)
from tests.reference import independent
from tests.support import PAPERS_STEPS, Array, held_torques, rollout


def _forces(run: Trajectory) -> Array:
    assert run.internal_forces is not None
    return run.internal_forces


def _net_forces(run: Trajectory) -> Array:
    """Return what every element gets from its neighbours (T, N, 2), from joint to joint."""
    return np.diff(np.pad(_forces(run), ((0, 0), (1, 1), (0, 0))), axis=1)


def _spinning(rate: float, elements: int) -> dict[str, object]:
    return {
        "internal_forces": {},
        "beam.elements": elements,
        "initial.velocity": (0.0, -0.5 * rate),
        "initial.velocity_slope": rate,
    }


@pytest.mark.parametrize(
    "changes",
    [{}, {"damping": None}, {"beam.bending_stiffness": None, "damping": None}],
    ids=["damped", "elastic", "loose"],
)
def test_without_fluid_forces_are_mass_times_acceleration(changes: dict[str, object]) -> None:
    scene = load_scene("swimmer", {"fluid": None, "internal_forces": {}, **changes})
    limit = 0.01 if scene.beam.bending_stiffness == 0.0 else 1.0
    run = Simulator(scene).rollout(held_torques(scene, 120, 9, limit))
    assert run.steps >= 60, run.termination_reason
    mass = scene.beam.element_length * scene.beam.line_density
    second = np.diff(run.centres, n=2, axis=0) / scene.integrator.time_step**2
    net = _net_forces(run)[1:]
    # Rounding of centres over dt^2 is 1e-11 m/s^2, forces are of order 1 to 100 N.
    assert largest(mass * second - net) < 1e-9 * largest(_forces(run)[1:])


FORCE_SCENES: dict[str, dict[str, object]] = {
    "panels": {},
    "axial": {"axial_added_mass": {}},
    "drag": {"cross_flow_drag": {"coefficient": 3.0}},
    "drag, stream, axial": {
        "cross_flow_drag": {"coefficient": 3.0},
        "stream": {"velocity": (0.3, -0.2)},
        "axial_added_mass": {},
    },
}


@pytest.mark.parametrize("name", FORCE_SCENES)
def test_with_fluid_forces_balance_the_momenta_of_elements(name: str) -> None:
    # An element carries its own momentum and the fluid's impulse on its own panels, the added mass
    # here being that of the independent implementation; drag acts by halves at a step's ends.
    start = {"heading": 0.7, "velocity": (0.3, -0.4), "joint_angles": 0.1}
    changes = {**PAPERS_STEPS, "internal_forces": {}, "initial": start, **FORCE_SCENES[name]}
    scene = load_scene("swimmer", changes)
    run = Simulator(scene).rollout(held_torques(scene, 24, 10))
    n, dl, h = 9, scene.beam.element_length, scene.integrator.time_step
    stream = np.array(scene.stream.velocity if scene.stream else (0.0, 0.0))
    moves = np.diff(run.centres, axis=0) - h * stream
    turns = np.diff(run.angles, axis=0)
    momenta = dl * scene.beam.line_density * moves / h
    fluid = independent.fluid_arguments(scene)
    assert fluid is not None
    axial = fluid["axial"]
    for step, angles in enumerate(run.angles[:-1]):
        mass = independent.added_mass(np.diff(angles), elements=n, **fluid)
        normals = normals_of(angles)
        tangents = np.stack([normals[:, 1], -normals[:, 0]], axis=-1)
        motion = [(normals * moves[step]).sum(1), np.sin(turns[step])]
        motion += [(tangents * moves[step]).sum(1)] if axial else []
        impulse = mass @ np.concatenate(motion) / h
        momenta[step] += impulse[:n, None] * normals
        if axial:
            momenta[step] += impulse[2 * n :, None] * tangents
    drag = np.zeros_like(momenta)
    if scene.cross_flow_drag:
        # Two points, as the kernel has them: sums over the body: see test_effects.
        normals = normals_of(run.angles[:-1] + 0.5 * turns)
        across = np.einsum("tki,tki->tk", normals, moves) / h
        factor = 0.5 * 10.0 * scene.cross_flow_drag.coefficient
        for side in (-1.0, 1.0):
            u = across + side * dl / math.sqrt(12.0) * turns / h
            drag -= (0.5 * h * dl * factor * np.abs(u) * u)[..., None] * normals
    wanted = (momenta[1:] - momenta[:-1] - 0.5 * (drag[1:] + drag[:-1])) / h
    # The step's tolerance over dt, 2e-8 kg m/s^2, against forces of order 10 N.
    assert largest(_net_forces(run)[1:] - wanted) < 1e-8 * largest(_forces(run)[1:])


@each_scheme
@pytest.mark.parametrize("elements", [2, 5, 8])
def test_a_spinning_beam_is_under_tension(elements: int, scheme: str) -> None:
    # rho_B A w^2 (l^2/4 - x^2)/2, which is exact for masses at the elements' centres; in steps,
    # w^2 is 2 (1 - cos(w dt))/dt^2. The body is under it at the beginning of the step.
    rate = 3.0
    integrator = {"tolerance": 1e-13, "scheme": scheme}
    bare = {"fluid": None, "actuation": None, "integrator": integrator}
    scene = load_scene("paper_i", {**_spinning(rate, elements), **bare})
    run = passive(scene, 0.5)
    angles = run.angles[:-1].mean(axis=1)
    tangents = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    along = np.einsum("tji,ti->tj", _forces(run), tangents)[1:]
    across = np.einsum("tji,ti->tj", _forces(run), normals_of(angles))[1:]
    turn, h = run.heading_change / run.steps, scene.integrator.time_step
    places = scene.beam.joint_fractions - 0.5
    square = 2.0 * (1.0 - math.cos(turn)) / h**2
    tension = 0.5 * scene.beam.line_density * square * (0.25 - places**2)
    assert abs(square / rate**2 - 1.0) < 1e-3
    # The composed scheme has steps of half the length, so it may differ in (w dt)^2.
    bound = 1e-9 if scheme == "paper" else rate**2 * h**2
    assert largest(along / tension - 1.0) < bound
    assert largest(across) < bound * tension.max()


@pytest.mark.parametrize(("scheme", "rate"), [("paper", 52.0), ("composed", 101.0)])
def test_steps_in_parts_are_under_the_same_tension(scheme: str, rate: float) -> None:
    # So fast that steps have to be cut, until drag has slowed the turning down to half a radian in
    # a step, or in half of one. Hardly any fluid moves with the body.
    strip = {"model": "strip", "density": 10.0, "added_mass_per_length": 1e-9}
    changes = {"fluid": strip, "integrator.scheme": scheme}
    scene = stiff_scene(0.0015, 0.01, {**_spinning(rate, 4), **changes})
    run = passive(scene, 0.8)
    assert {1.0, 2.0} == set(run.parts), "no steps were cut, or none whole again"
    turns = np.diff(run.angles.mean(axis=1)) / 0.01
    rates = 0.5 * (turns[1:] + turns[:-1])
    places = scene.beam.joint_fractions - 0.5
    tension = 0.5 * scene.beam.line_density * np.outer(rates**2, 0.25 - places**2)
    share = np.linalg.norm(_forces(run)[1:], axis=-1) / tension
    # The mean over a step in which the body turns by up to a radian takes (sin(1/2)/(1/2))^2 off,
    # 8 %. Time that is counted twice or not at all where steps become whole would make a quarter.
    assert 0.91 < share.min() and share.max() < 1.0, f"{share.min():.3f} to {share.max():.3f} of it"


def test_evenly_loaded_elements_do_not_pull_at_each_other() -> None:
    # Strips and drag load all elements alike; panels load the ends less, which takes shear.
    changes = {"internal_forces": {}, "stream": {"velocity": (0.0, 1.0)}}
    even = passive(stiff_scene(2.0, 0.01, {**changes, "fluid.model": "strip"}), 0.5)
    uneven = passive(stiff_scene(2.0, 0.01, changes), 0.5)
    # The drag on an element is 1 N at first; the tolerance over dt is 1e-11.
    assert largest(_forces(even)[1:]) < 1e-9
    axial, shear = np.moveaxis(_forces(uneven)[1:], -1, 0)
    # The load sets in suddenly. Normals that ring by 1e-6 rad in a step turn 8 kg m/s of the fluid.
    assert np.abs(axial).max() < 1e-3 * np.abs(shear).max(), "a straight body is pulled along"
    assert np.abs(shear).max() > 0.1
    assert largest(shear + shear[:, ::-1]) < 1e-6 * largest(shear)


def test_internal_forces_of_pieces_are_those_of_one_rollout() -> None:
    scene = load_scene("swimmer", {"internal_forces": {}, "cross_flow_drag": {}})
    torques = held_torques(scene, 450, 11)
    simulator = Simulator(scene)
    whole = simulator.rollout(torques).internal_forces
    assert whole is not None and whole.shape == (450, 8, 2)
    # At the start there is no step before.
    assert np.isnan(whole[0]).all() and np.isfinite(whole[1:]).all()
    simulator.reset()
    pieces = [simulator.rollout(held).internal_forces for held in np.split(torques, 5)]
    assert np.array_equal(np.concatenate(pieces), whole, equal_nan=True)
    simulator.reset()
    watched = simulator.rollout(torques, progress=lambda steps: None).internal_forces
    assert np.array_equal(watched, whole, equal_nan=True)
    assert np.isnan(Simulator(scene).rollout(torques[:1]).internal_forces).all()
    simulator.reset()
    for held in torques[:10]:
        simulator.step(held)
    rest = simulator.rollout(torques[10:]).internal_forces
    assert np.array_equal(rest, whole[10:]), f"{rest[0, 0]} instead of {whole[10, 0]}"


def test_internal_forces_after_a_snapshot() -> None:
    scene = load_scene("swimmer", {"internal_forces": {}})
    torques = held_torques(scene, 30, 12)
    simulator = Simulator(scene)
    whole = simulator.rollout(torques).internal_forces
    simulator.reset()
    simulator.rollout(torques[:20])
    kept = simulator.snapshot()
    simulator.restore(kept)
    assert np.array_equal(simulator.rollout(torques[20:]).internal_forces, whole[20:])
    # Elsewhere too, and after other steps: the step before is in the snapshot.
    other = Simulator(scene)
    for one in (simulator, other):
        one.restore(kept)
        assert np.array_equal(one.rollout(torques[20:]).internal_forces, whole[20:])
    # A step that was taken back leaves nothing.
    simulator.reset()
    simulator.rollout(torques[:20])
    simulator.step(-torques[20])
    simulator.restore(kept)
    found = simulator.rollout(torques[20:]).internal_forces
    assert np.array_equal(found, whole[20:]), f"{found[0, 0]}, not {whole[20, 0]}"


def test_a_step_that_failed_leaves_nothing_in_the_internal_forces() -> None:
    changes = {"beam.half_thickness": 0.03, "beam.bending_stiffness": 0.5}
    changes |= {"damping.retardation_time": 0.02, "integrator.time_step": 0.005}
    watched = {"fluid": None, "self_contact": {}, "internal_forces": {}}
    scene = load_scene("paper_i", {**changes, **watched})
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


@each_scheme
def test_cut_steps_have_internal_forces(scheme: str) -> None:
    changes = {"internal_forces": {}, "integrator": {"time_step": 0.01, "scheme": scheme}}
    scene = load_scene("swimmer", changes)
    torques = held_torques(scene, 40, 13)
    torques[7::20] = VIOLENT
    run = rollout(scene, torques)
    assert (run.parts > 1).sum() >= 2, f"{(run.parts > 1).sum()} steps were cut"
    assert np.flatnonzero(np.isnan(_forces(run)).any(axis=(1, 2))).tolist() == [0]


@pytest.mark.parametrize("fluid", [True, False], ids=["fluid", "none"])
def test_internal_forces_of_both_schemes_approach_each_other(fluid: bool) -> None:
    changes: dict[str, object] = {
        "actuation": None,
        "internal_forces": {},
        "beam.elements": 3,
        "beam.bending_stiffness": 0.4,
        "initial": {"joint_angles": 0.3, "velocity": (0.2, 0.3)},
    }
    changes |= {"cross_flow_drag": {}} if fluid else {"fluid": None, "beam.rotary_inertia": 1e-3}
    gaps = []
    for count in (100, 200, 400):
        found = []
        for scheme in SCHEMES:
            integrator = {"time_step": 0.4 / count, "tolerance": 1e-12, "scheme": scheme}
            run = passive(load_scene("paper_i", {**changes, "integrator": integrator}), 0.4)
            found.append(_forces(run)[count // 4 :: count // 4])
        gaps.append(largest(found[0] - found[1]))
    assert (orders(gaps) > 0.8).all(), f"orders {orders(gaps)}, gaps {gaps} N"
    assert gaps[-1] < 0.05 * largest(found[0]), f"gaps {gaps} N"
