"""Gradients of runs against differences, tangents and an independent implementation."""

import functools
from typing import Any

import numpy as np
import pytest

from swim_env import OptionError, Scene, SimulationEndedError, load_scene
from swim_env.gradients import (
    OBJECTIVES,
    Objective,
    Slopes,
    Stretch,
    path_error,
    tangent,
    value_and_gradient,
)
from swim_env.gradients.objectives import objective_of
from swim_env.gradients.tape import Tape
from tests.reference import independent
from tests.support import Array, uniform

SWIMMER = load_scene("swimmer")
EEL = load_scene("eel_3d").replace("beam.elements", 6)
#: Planar cases: scene, steps, largest relative error.
PLANAR = {
    "no fluid": (SWIMMER.replace({"fluid": None, "integrator.time_step": 0.0025}), 300, 1e-8),
    "strip": (SWIMMER.replace("fluid.model", "strip"), 1000, 1e-8),
    "frozen, paper's scheme": (
        SWIMMER.replace({"fluid.model": "frozen", "integrator.scheme": "paper"}),
        1000,
        1e-8,
    ),
    "expansion": (
        SWIMMER.replace({"fluid.model": "expansion", "beam.elements": 5}),
        300,
        1e-8,
    ),
    "panels": (SWIMMER, 1000, 1e-8),
    "panels, axial, five elements": (
        SWIMMER.replace(
            {
                "beam.elements": 5,
                "integrator.scheme": "paper",
                "integrator.strain": "joint_angle",
                "axial_added_mass": {},
                "stream": {"velocity": [0.1, 0.05]},
            }
        ),
        200,
        1e-8,
    ),
}
SPACE = {
    "strip": EEL.replace("fluid.model", "strip"),
    "frozen, composed": EEL.replace({"fluid.model": "frozen", "integrator.scheme": "composed"}),
    "averaged directors, bent": EEL.replace(
        {
            "integrator.strain": "averaged_directors",
            "beam.natural_curvature": [0.4, -0.2, 0.3],
            "damping.retardation_time": [0.002, 0.001, 0.003],
        }
    ),
}


def run_of(scene: Scene, torques: Array, start: Any, objective: Any = "displacement") -> float:
    """Return an objective of a run whose steps are solved as exactly as they can be."""
    tape = Tape.of(scene, start, 1e-13)
    record = tape.play(torques, 0, len(torques))
    found = objective_of(objective)
    return found.combine(np.array([one(record.stretch)[0] for one in found.measures]))[0]


def slope(function: Any, size: float) -> float:
    """Differentiate a function of one number at 0 by differences, extrapolated to small ones."""
    sizes = size * 0.5 ** np.arange(3)
    wide, middle, narrow = ((function(e) - function(-e)) / (2.0 * e) for e in sizes)
    first, second = (4.0 * middle - wide) / 3.0, (4.0 * narrow - middle) / 3.0
    return (16.0 * second - first) / 15.0


def lively(scene: Scene, steps: int, seed: int = 0) -> Array:
    """Return torques that bend a body to all sides, held over four steps each."""
    shape = (steps // 4 + 1, *Tape.of(scene)._bodies.joint_shape)
    size = 0.5 * float(np.min(scene.torque_limit))
    torques = np.repeat(uniform(*shape, seed=seed, size=size), 4, axis=0)
    return torques[:steps]


def moving(scene: Scene) -> tuple[Array, Array]:
    """Return a start that is bent, and moves."""
    coordinates, velocity = (np.array(one) for one in Tape.of(scene).start)
    if scene.dimension == 2:
        coordinates[3:] += uniform(coordinates.size - 3, seed=1, size=0.1)
    velocity[: scene.dimension] += 0.05
    velocity[scene.dimension :] += uniform(velocity.size - scene.dimension, seed=2, size=0.2)
    return coordinates, velocity


@pytest.mark.parametrize("case", PLANAR)
def test_planar_gradients_are_the_slopes_of_runs(case):
    scene, steps, error = PLANAR[case]
    torques, start = lively(scene, steps), moving(scene)
    # Without a fluid a body turns, but its mean centre does not move.
    objective = "displacement" if scene.has_fluid else "turn"
    names = ["torques", "start.coordinates", "start.velocity"]
    _, gradient = value_and_gradient(scene, torques, objective, names, start=start)
    # Along the gradient itself, nothing cancels.
    by = {name: one / np.abs(one).max() for name, one in gradient.items()}

    def moved(e: float, name: str) -> float:
        held = torques + e * by["torques"] * (name == "torques")
        at = [one + e * by[f"start.{kind}"] * (name == f"start.{kind}") for kind, one in kinds]
        return run_of(scene, held, at, objective)

    kinds = list(zip(("coordinates", "velocity"), start, strict=True))
    for name, size in zip(names, (0.01, 0.005, 0.0005), strict=True):
        found = slope(functools.partial(moved, name=name), size)
        assert found == pytest.approx((by[name] * gradient[name]).sum(), rel=error), name


@pytest.mark.parametrize("case", ["strip", "panels, axial, five elements"])
@pytest.mark.parametrize(
    "name",
    [
        "beam.bending_stiffness",
        "beam.line_density",
        "beam.rotary_inertia",
        "damping.retardation_time",
        "fluid.density",
    ],
)
def test_gradients_by_fields_of_a_planar_scene(case, name):
    scene, steps, error = PLANAR[case]
    scene = scene.replace("beam.bending_stiffness", [5.0 + 0.1 * j for j in range(scene.joints)])
    torques, start = lively(scene, min(steps, 200)), moving(scene)
    _, gradient = value_and_gradient(scene, torques, "turn", name, start=start)
    block, field = name.split(".")
    value = np.array(getattr(getattr(scene, block), field))
    assert gradient[name].shape == value.shape
    along = gradient[name] / np.abs(gradient[name]).max()

    def moved(e: float) -> float:
        return run_of(scene.replace(name, (value + e * along).tolist()), torques, start, "turn")

    size = 0.01 * float(np.abs(value).min())
    # A small slope is a difference of large numbers.
    floor = 1e-13 / size
    expected = (along * gradient[name]).sum()
    assert slope(moved, size) == pytest.approx(expected, rel=max(10.0 * error, 1e-7), abs=floor)


@pytest.mark.parametrize("case", SPACE)
def test_gradients_in_space_are_the_slopes_of_runs(case):
    scene = SPACE[case]
    torques, start = lively(scene, 200), moving(scene)
    fields = [f"beam.{name}" for name in ("lateral_stiffness", "natural_curvature")]
    names = ["torques", "start.velocity", *fields, "fluid.density", "damping.retardation_time"]
    _, gradient = value_and_gradient(scene, torques, "displacement", names, start=start)
    along = gradient["torques"] / np.abs(gradient["torques"]).max()
    size = 0.01 * float(np.min(scene.torque_limit))
    found = slope(lambda e: run_of(scene, torques + e * along, start), size)
    assert found == pytest.approx((along * gradient["torques"]).sum(), rel=1e-8)
    coordinates, velocity = start
    along = gradient["start.velocity"] / np.abs(gradient["start.velocity"]).max()
    found = slope(lambda e: run_of(scene, torques, (coordinates, velocity + e * along)), 0.005)
    assert found == pytest.approx(along @ gradient["start.velocity"], rel=1e-8)
    for name in names[2:]:
        block, field = name.split(".")
        value = np.array(getattr(getattr(scene, block), field))
        along = gradient[name] / np.abs(gradient[name]).max()

        def moved(e: float, name: str = name, value: Any = value, along: Any = along) -> float:
            return run_of(scene.replace(name, (value + e * along).tolist()), torques, start)

        size = 0.02 * (float(np.abs(value).min()) or 0.2)
        expected = (along * gradient[name]).sum()
        assert slope(moved, size) == pytest.approx(expected, rel=1e-6, abs=1e-13 / size), name


@pytest.mark.parametrize("name", ["start.coordinates"])
def test_gradients_by_the_pose_in_space(name):
    scene = SPACE["averaged directors, bent"]
    torques, start = lively(scene, 40), moving(scene)
    _, gradient = value_and_gradient(scene, torques, "displacement", name, start=start)
    tape = Tape.of(scene, start)
    turns = uniform(tape._bodies.unknowns, seed=3)

    def moved(e: float) -> float:
        return run_of(scene, torques, (tape.moved(e * turns), start[1]))

    changes = (tape.moved(1e-6 * turns) - tape.moved(-1e-6 * turns)) / 2e-6
    assert slope(moved, 1e-3) == pytest.approx(gradient[name] @ changes, rel=1e-6)


@pytest.mark.parametrize("scene", [SWIMMER, SPACE["frozen, composed"]], ids=["plane", "space"])
@pytest.mark.parametrize("objective", ["displacement", "work", "squared_torque", "efficiency"])
def test_a_tangent_is_the_product_with_the_gradient(scene, objective):
    torques = lively(scene, 60)
    names = ("torques", "start.velocity", "fluid.density", "damping.retardation_time")
    direction = {
        "torques": lively(scene, 60, seed=5),
        "start.velocity": uniform(Tape.of(scene)._bodies.unknowns, seed=6, size=0.1),
        "fluid.density": 0.3,
        "damping.retardation_time": 1e-4,
    }
    value, gradient = value_and_gradient(scene, torques, objective, names)
    same, derivative = tangent(scene, torques, direction, objective)
    products = [np.sum(gradient[name] * direction[name]) for name in names]
    assert same == value
    assert derivative == pytest.approx(sum(products), rel=1e-6, abs=1e-9 * max(map(abs, products)))


@pytest.mark.parametrize("name", ["amplitude", "frequency", "wave_number", "phase"])
@pytest.mark.parametrize("scene", [SWIMMER, load_scene("helix_3d")], ids=["plane", "space"])
def test_gradients_by_the_prescribed_wave(scene, name):
    field = f"actuation.{name}"
    _, gradient = value_and_gradient(scene, None, "displacement", field, steps=150)
    value = getattr(scene.actuation, name)

    def moved(e: float) -> float:
        changed = scene.replace(field, value + e)
        return value_and_gradient(changed, None, "displacement", (), steps=150)[0]

    size = 1e-4 * max(1.0, abs(value))
    assert slope(moved, size) == pytest.approx(float(gradient[field]), rel=1e-5)


def test_gradient_of_an_independent_implementation():
    """Displacement by one torque, with all derivatives of the other side by a complex step."""
    scene = SWIMMER.replace(
        {"beam.elements": 3, "integrator.scheme": "paper", "integrator.tolerance": 1e-12}
    )
    torques = lively(scene, 30)
    _, gradient = value_and_gradient(scene, torques)

    def moved(e: float) -> float:
        changed = torques.copy()
        changed[4, 1] += e
        centres = independent.simulate(scene, changed)["centres"]
        return float(-(centres[-1] - centres[0]).mean(axis=0)[0] / scene.beam.length)

    assert slope(moved, 0.2) == pytest.approx(gradient["torques"][4, 1], rel=1e-6)


@pytest.mark.parametrize("space", [False, True], ids=["plane", "space"])
def test_a_start_at_rest_in_a_stream_has_momentum(space):
    body = SPACE["strip"] if space else SWIMMER.replace("fluid.model", "strip")
    scene = body.replace("stream", {"velocity": [0.1, 0.05, 0.02][: body.dimension]})
    torques = lively(scene, 60)
    coordinates, velocity = (np.array(one) for one in Tape.of(scene).start)
    assert not velocity.any()
    names = ("fluid.density", "start.coordinates")
    _, gradient = value_and_gradient(scene, torques, "displacement", names)

    def denser(e: float) -> float:
        changed = scene.replace("fluid.density", scene.fluid.density * (1.0 + e))
        return run_of(changed, torques, (coordinates, velocity))

    by_share = float(gradient["fluid.density"]) * scene.fluid.density
    assert slope(denser, 0.02) == pytest.approx(by_share, rel=1e-6, abs=1e-11)
    tape = Tape.of(scene)
    turns = uniform(tape._bodies.unknowns, seed=3)
    changes = (tape.moved(1e-6 * turns) - tape.moved(-1e-6 * turns)) / 2e-6
    found = slope(lambda e: run_of(scene, torques, (tape.moved(e * turns), velocity)), 1e-3)
    assert found == pytest.approx(gradient["start.coordinates"] @ changes, rel=1e-6)


def test_a_body_without_stiffness_has_a_gradient_by_it():
    scene = SWIMMER.replace(
        {"fluid.model": "strip", "damping": None, "beam.bending_stiffness": 0.0}
    )
    torques = 0.1 * lively(scene, 20)
    start = moving(scene)
    _, gradient = value_and_gradient(scene, torques, "turn", "beam.bending_stiffness", start=start)
    changed = scene.replace("beam.bending_stiffness", 1e-6)
    difference = run_of(changed, torques, start, "turn") - run_of(scene, torques, start, "turn")
    assert difference / 1e-6 == pytest.approx(float(gradient["beam.bending_stiffness"]), rel=1e-3)


def test_checkpoints_change_nothing():
    torques = lively(SWIMMER, 50)
    whole = value_and_gradient(SWIMMER, torques, "efficiency", ("torques", "fluid.density"))
    parts = value_and_gradient(
        SWIMMER, torques, "efficiency", ("torques", "fluid.density"), checkpoint=7
    )
    assert whole[0] == pytest.approx(parts[0], rel=1e-13)
    for name, gradient in whole[1].items():
        np.testing.assert_allclose(parts[1][name], gradient, rtol=1e-9, atol=1e-15)


def test_a_function_of_the_run_and_a_path():
    torques = lively(SWIMMER, 20)
    path = np.zeros((21, 2))

    def error(run: Stretch) -> tuple[float, Slopes]:
        away = run.coordinates[:, :2] - path
        slopes = np.zeros_like(run.coordinates)
        slopes[:, :2] = 2.0 * away / len(path)
        return (away**2).sum() / len(path), Slopes(coordinates=slopes)

    own = value_and_gradient(SWIMMER, torques, error)
    shipped = value_and_gradient(SWIMMER, torques, path_error(path), checkpoint=6)
    assert own[0] == pytest.approx(shipped[0], rel=1e-13)
    np.testing.assert_allclose(own[1]["torques"], shipped[1]["torques"], rtol=1e-9, atol=1e-14)


def test_what_has_no_gradient_is_one_clear_error():
    torques = np.zeros((4, 8))
    with pytest.raises(OptionError, match="with_respect_to must be of torques.*got 'beam.length'"):
        value_and_gradient(SWIMMER, torques, with_respect_to="beam.length")
    with pytest.raises(OptionError, match=r"actuation.phase changes nothing where torques are"):
        value_and_gradient(SWIMMER, torques, with_respect_to="actuation.phase")
    with pytest.raises(OptionError, match="objective must be one of displacement"):
        value_and_gradient(SWIMMER, torques, "distance")
    with pytest.raises(OptionError, match="cross_flow_drag; remove it"):
        value_and_gradient(SWIMMER.replace("cross_flow_drag", {"coefficient": 1.0}), torques)
    with pytest.raises(OptionError, match="no gradients with the fluid model panels"):
        value_and_gradient(EEL.replace("fluid.model", "panels"), np.zeros((2, 5, 3)))
    with pytest.raises(OptionError, match="derivatives by momenta must have the shape"):
        value_and_gradient(SWIMMER, torques, lambda run: (0.0, {"momenta": np.zeros(3)}))
    with pytest.raises(OptionError, match="efficiency needs positive work"):
        value_and_gradient(SWIMMER, torques, "efficiency")
    with pytest.raises(OptionError, match="is a law; give numbers"):
        stiff = SWIMMER.replace("beam.bending_stiffness", {"linear": {"head": 6.0, "tail": 4.0}})
        value_and_gradient(stiff, torques, with_respect_to="beam.bending_stiffness")
    with pytest.raises(OptionError, match=r"change of start.velocity must be finite numbers of sh"):
        tangent(SWIMMER, torques, {"start.velocity": [1.0]})
    violent = np.full((40, 8), 40.0)
    with pytest.raises((OptionError, SimulationEndedError), match=r"t = [0-9.]+ s"):
        value_and_gradient(SWIMMER, violent)


def test_objectives_by_name_are_those_of_the_trajectory():
    torques = lively(SWIMMER, 40)
    tape = Tape.of(SWIMMER)
    run = tape.simulator.rollout(torques)
    values = {name: value_and_gradient(SWIMMER, torques, name, ())[0] for name in OBJECTIVES}
    heading = np.array(SWIMMER.episode.heading)
    assert values["displacement"] == pytest.approx(run.displacement @ heading, abs=1e-12)
    assert values["turn"] == pytest.approx(run.heading_change, abs=1e-12)
    summary = run.summary()
    assert values["positive_work"] == pytest.approx(summary["positive_work"], rel=1e-12)
    assert values["work"] == pytest.approx(summary["work"], rel=1e-9)
    assert values["squared_torque"] == pytest.approx((torques**2).mean())
    assert isinstance(OBJECTIVES["work"], Objective)
