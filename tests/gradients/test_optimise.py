"""The command `optimise`: what it finds, how it is kept, played, resumed and refused."""

import json
from pathlib import Path

import numpy as np
import pytest
from swim_agents import load_policy
from swim_agents.commands.main import command
from swim_agents.commands.optimise import check_gait
from swim_agents.optimal_gait import find_optimal_gait
from swim_agents.optimising import Problem, improve, starts

from swim_env import OptionError, SwimError, load_scene, natural_frequencies

BODY = {
    "beam.elements": 5,
    "fluid.model": "strip",
    "episode.duration": 3.0,
    "beam.bending_stiffness": 4.0,
}
optimise = command("optimise", "swim-env optimise")


@pytest.fixture
def body(tmp_path: Path) -> Path:
    """Write the scene of a small body and return its file."""
    place = tmp_path / "eel.yaml"
    load_scene("swimmer").replace({**BODY, "name": "eel"}).save(place)
    return place


def record_of(place: Path, goal: str) -> dict:
    """Return the record that lies beside a scene's file."""
    return json.loads(place.with_suffix(f".{goal}.optimal_gait.json").read_text())


def test_a_gait_is_found_kept_and_played_by_name(body, capsys):
    assert optimise(["--scene", str(body), "--minutes", "0.1", "--verify", "--json"]) == 0
    record = record_of(body, "displacement")
    assert json.loads(capsys.readouterr().out)["net_displacement"] == record["net_displacement"]
    assert record["verification"]["verified"]
    scene = load_scene(body)
    gait = load_policy("optimal_displacement", scene)
    np.testing.assert_array_equal(gait.table, record["actions"])
    assert np.abs(gait.table).max() <= 1.0
    # Far beyond the wave that it began with.
    first = starts(
        Problem(scene, "displacement", 1, scene.actions_per_episode),
        natural_frequencies(scene, 2),
        0,
    )
    problem = Problem(scene, "displacement", first[0][0], scene.actions_per_episode)
    wave = -problem.evaluate(first[0][1], problem.objective())[0]
    assert record["net_displacement"] > 1.5 * wave
    stiffer = scene.replace("beam.bending_stiffness", 6.0)
    with pytest.raises(OptionError, match=r"optimised on scene eel.*beam.bending_stiffness"):
        load_policy("optimal_displacement", stiffer)
    with pytest.raises(OptionError, match="no optimal gait for turn"):
        find_optimal_gait(scene, "turn")


def test_gradients_by_actions_and_stiffness(body):
    scene = load_scene(body)
    problem = Problem(scene, "displacement", 7, 40, design=True)
    unknowns = np.random.default_rng(0).uniform(-0.5, 0.5, 7 * 4 + 4)
    objective = problem.objective()
    _, gradient = problem.evaluate(unknowns, objective)
    for place in (3, 30):
        step = 1e-4 * np.eye(unknowns.size)[place]
        ahead, behind = (problem.evaluate(unknowns + s * step, objective)[0] for s in (1, -1))
        assert (ahead - behind) / 2e-4 == pytest.approx(gradient[place], rel=1e-5)


def test_an_efficient_gait_reaches_what_it_must(body):
    scene = load_scene(body)
    period, unknowns = starts(
        Problem(scene, "efficiency", 1, 100), natural_frequencies(scene, 2), 0
    )[0]
    far = Problem(scene, "displacement", period, 100)
    moved = -far.evaluate(unknowns, far.objective())[0]
    problem = Problem(scene, "efficiency", period, 100, at_least=moved)
    before = problem.evaluate(unknowns, problem.objective())[0]
    from swim_agents.optimising import Result

    found = improve(problem, Result(unknowns), 6.0)
    reached = -far.evaluate(found.unknowns, far.objective())[0]
    assert reached > 0.97 * moved
    # The logarithm of the work has fallen by half.
    assert found.value < before - 0.7


@pytest.mark.parametrize(
    ("goal", "moved", "turned", "at_least"),
    [("displacement", -1.1, 0.0, None), ("efficiency", 2.2, 0.0, 2.5), ("turn", 1.0, -0.1, None)],
)
def test_a_gait_that_fails_its_goal_is_refused(goal, moved, turned, at_least):
    record = {"goal": goal, "net_displacement": moved, "heading_change": turned}
    with pytest.raises(SwimError, match="too little time, or too much asked"):
        check_gait({**record, "at_least": at_least}, 0.5)


def test_a_design_is_a_body_with_its_gait(body, tmp_path):
    place = tmp_path / "best.displacement.optimal_gait.json"
    arguments = ["--scene", str(body), "--design", "--minutes", "0.08", "--output", str(place)]
    assert optimise(arguments) == 0
    scene = load_scene(tmp_path / "best.yaml")
    stiffness = np.array(scene.beam.bending_stiffness)
    assert stiffness.shape == (4,) and np.ptp(stiffness) > 0.0
    assert ((stiffness >= 1.0 - 1e-9) & (stiffness <= 16.0 + 1e-9)).all()
    load_policy("optimal_displacement", scene)
    with pytest.raises(SwimError, match=r"best.yaml exists, and would be the design's body"):
        optimise(arguments)


def test_an_interrupted_search_goes_on(body, tmp_path, monkeypatch):
    from swim_agents.commands import optimise as module

    asked = []

    def stop(*_, known, keep, **__):
        asked.append(dict(known))
        from swim_agents.optimising import Result

        keep(2, 5, Result(np.full(20, 0.25), -1.5, done=True))
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "search_gait", stop)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            optimise(["--scene", str(body)])
    assert asked[0] == {}
    period, result = asked[1][2]
    assert (period, result.value, result.done) == (5, -1.5, True)
    np.testing.assert_array_equal(result.unknowns, np.full(20, 0.25))
    with pytest.raises(KeyboardInterrupt):
        optimise(["--scene", str(body), "--for", "turn"])
    assert asked[2] == {}, "another goal begins anew"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--scene", "swimmer"], "name the record's file with --output"),
        (["--output", "gait.json"], "must end with .optimal_gait.json"),
        (["--minutes", "0"], "--minutes must be above 0"),
        (
            ["--for", "efficiency", "--set", "episode.duration=1"],
            "no tuned wave for this episode; give the displacement",
        ),
        (["--set", "cross_flow_drag.coefficient=1.0"], "has cross_flow_drag"),
        (
            ["--design", "--set", "beam.bending_stiffness={linear: {head: 6, tail: 4}}"],
            "a design needs numbers",
        ),
    ],
)
def test_bad_input_is_one_error(arguments, message, tmp_path):
    if not {"--output", "--scene"} & set(arguments):
        arguments = [*arguments, "--output", str(tmp_path / "x.displacement.optimal_gait.json")]
    with pytest.raises(SwimError, match=message):
        optimise(arguments)
