"""Baselines, tuning and verification of bodies in three dimensions."""

import json
from typing import Any

import numpy as np
import pytest
from swim_agents import WavePolicy, load_policy, play_episode, tuning, verify_rollout
from swim_agents.baselines import POLICY_NAMES, SPATIAL_POLICY_NAMES
from swim_agents.commands.main import main as call_main
from swim_agents.comparison.contest import references_on
from swim_agents.fit import AGENT_FIELDS, difference, is_similar
from swim_agents.policies import policy_names
from swim_agents.tuned_wave import find_tuned_wave, wave_file, wave_of_share, wave_on
from swim_agents.tuning import (
    Point,
    actions_to_play,
    check_candidates,
    net_displacements,
    record_of,
    search_wave,
)
from swim_agents.verification import fine_scene, finer_scenes

from swim_env import (
    OptionError,
    Scene,
    SceneError,
    Simulator,
    SwimEnv,
    load_scene,
    natural_frequencies,
)
from swim_env.scene import SpatialActuation
from tests.support import refuses

QUIET = {"noise": 0.0}
PRESCRIBED = ("lateral_wave", "dorsoventral_wave", "helical_wave_right", "helical_wave_left")
#: A body whose panels are quick: 5 elements and 40 panels and caps.
SHORT_EEL: dict[str, object] = {
    "beam.elements": 5,
    "fluid.model": "frozen",
    "fluid.around": 8,
    "fluid.rows": 1,
    "episode.duration": 1.0,
}


def _wave(scene: Scene, wave: str, share: float = 1.0, **fields: float) -> Any:
    given = {"frequency": 9.0, "wave_number": 6.0, "phase": 0.0, **fields}
    return wave_on(scene, **given, **wave_of_share(scene, wave, share))


# ---- prescribed waves --------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*PRESCRIBED, "paper_wave", "zero", "random"])
def test_a_policy_acts_within_the_space_for_one_observation_and_for_a_batch(name):
    env = SwimEnv("fish_3d")
    policy = load_policy(name, env.scene, seed=3)
    observation, _ = env.reset(seed=0)
    action, _ = policy.predict(observation, deterministic=True)
    assert action.shape == env.action_space.shape == (24,)
    assert (np.abs(action) <= 1.0).all()
    actions, _ = policy.predict(np.stack([observation] * 3), deterministic=True)
    assert actions.shape == (3, 24)
    if name != "random":
        assert (actions == action).all()


@pytest.mark.parametrize(
    ("name", "hand"), list(zip(PRESCRIBED, (None, None, 1.0, -1.0), strict=True)), ids=PRESCRIBED
)
def test_a_wave_takes_the_same_share_of_the_limit_of_each_of_its_axes(name, hand):
    # The prescribed one is 6 of 8 N m of yaw.
    limits = {"actuation.torque_limit": [9.0, 8.0, 2.0], "actuation.phase": 0.4}
    scene = load_scene("fish_3d", limits)
    policy = load_policy(name, scene)
    clock = np.array([0, 7, 40])
    actions = policy.predict(np.zeros((3, 5)), clock)[0].reshape(3, 8, 3)
    times = clock[:, None] * scene.episode.control_interval
    angle = 3.0 * np.pi * times - 2.0 * np.pi * np.arange(1, 9) / 9.0 + 0.4
    cosine, sine, none = 0.75 * np.cos(angle), 0.75 * np.sin(angle), np.zeros((3, 8))
    pitch = {"lateral_wave": none, "dorsoventral_wave": cosine}.get(name)
    pitch = hand * sine if pitch is None else pitch
    yaw = none if name == "dorsoventral_wave" else cosine
    np.testing.assert_allclose(actions, np.stack([pitch, yaw, none], axis=-1), atol=1e-13)


def test_the_share_is_that_of_the_prescribed_waves_own_axis():
    pitched = {"actuation.wave": "dorsoventral", "actuation.amplitude": 2.0}
    scene = load_scene("fish_3d", pitched)  # limits 8, 6 and 2 N m
    for name, (yaw, beside) in {
        "lateral_wave": (1.5, None),
        "dorsoventral_wave": (2.0, None),
        "helical_wave_left": (1.5, 2.0),
    }.items():
        wave = load_policy(name, scene).wave
        assert (wave.amplitude, wave.pitch_amplitude) == (yaw, beside)
        assert (wave.frequency, wave.wave_number) == (scene.actuation.frequency, 2.0 * np.pi)
    # A lateral prescribed wave is the lateral one, and without any there is no torque.
    assert load_policy("lateral_wave", "eel_3d").wave == load_scene("eel_3d").actuation
    passive = scene.replace("actuation.amplitude", 0.0)
    assert not load_policy("helical_wave_right", passive).predict(np.zeros(5))[0].any()


@pytest.mark.parametrize("name", SPATIAL_POLICY_NAMES)
def test_waves_of_axes_that_a_scene_has_not_are_refused(name):
    assert name in policy_names()
    with refuses(OptionError, "wave needs a scene of dimension 3, got swimmer of dimension 2"):
        load_policy(name, "swimmer")
    axes = {"actuation.axes": ["roll"], "actuation.torque_limit": 1.0, "actuation.amplitude": 0.0}
    with refuses(OptionError, "among actuation.axes, scene fish_3d has roll"):
        load_policy(name, load_scene("fish_3d", axes))
    assert name not in POLICY_NAMES


def test_a_policy_of_other_axes_or_another_dimension_is_refused_where_it_plays():
    quick = {"episode.duration": 0.04}
    own, other = load_scene("eel_3d", quick), load_scene("helix_3d", quick)
    with refuses(OptionError, "cannot play scene helix_3d: beam.elements is 9, it was 10"):
        play_episode(SwimEnv(other), load_policy("zero", own))
    with refuses(OptionError, "dimension is 3, it was 2 in its own scene"):
        play_episode(SwimEnv(own), load_policy("zero", "swimmer"))
    fewer = own.replace({"actuation.axes": ["yaw"], "actuation.torque_limit": 3.0})
    with refuses(OptionError, "axes is ['yaw'], it was ['pitch', 'yaw'] in its own scene"):
        play_episode(SwimEnv(fewer), load_policy("paper_wave", own))


@pytest.mark.parametrize("name", ["lateral_wave", "helical_wave_right", "random"])
def test_a_rollout_played_again_is_the_same_motion(name):
    env = SwimEnv("eel_3d", ["episode.duration=1.0"])
    rollout = play_episode(env, load_policy(name, env.scene, seed=5), seed=7)
    simulator = Simulator(env.scene)
    simulator.reset_to(rollout.coordinates, rollout.velocity)
    simulator.rollout(np.repeat(rollout.torques, env.scene.steps_per_action, axis=0))
    assert (simulator.coordinates == env.coordinates).all()
    assert rollout.info["progress"] == pytest.approx(rollout.net_displacement, abs=1e-13)


# ---- verification ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "refined"),
    [
        ({}, {"fluid.model": "panels"}),
        ({"fluid.model": "frozen", "fluid.rows": 3}, {"fluid.model": "panels"}),
        ({"fluid.model": "panels"}, {}),
        ({"fluid": None, "beam.density": 1000.0}, {}),
    ],
)
def test_the_finer_scene_has_panels_and_a_quarter_of_the_step(changes, refined):
    scene = load_scene("eel_3d", {"integrator.tolerance": 1e-5, **changes})
    step = {"integrator.time_step": 0.00125}
    assert fine_scene(scene) == scene.replace({**step, **refined})
    expected = {"time_step": scene.replace(step)}
    if refined:
        expected |= {"model": scene.replace(refined), "together": fine_scene(scene)}
    assert finer_scenes(scene) == expected


@pytest.mark.parametrize("model", ["frozen", "strip"])
def test_a_score_is_verified_with_panels(model):
    scene = load_scene("eel_3d", {**SHORT_EEL, "fluid.model": model})
    policy = load_policy("lateral_wave", scene)
    rollout = play_episode(SwimEnv(scene), policy, options=QUIET)
    closed_loop = play_episode(SwimEnv(fine_scene(scene)), policy, options=QUIET)
    seen: list[float] = []
    checked = verify_rollout(rollout, closed_loop, progress=seen.append)
    assert checked.changes.keys() == {"time_step", "model", "together", "closed_loop"}
    assert sum(seen) == pytest.approx(1.0)
    assert checked.closed_displacement == checked.fine_displacement, "waves see nothing"
    assert (checked.time_step, checked.panels_per_element) == (0.00125, None)
    assert 0.0 < abs(checked.changes["time_step"]) < 0.05
    json.dumps(checked.to_dict(), allow_nan=False)
    # The straight body's panels stand for every shape's; strips, which leave out how the flow
    # passes around the ends, do not.
    change = abs(checked.changes["model"])
    assert (change < 0.05) == checked.verified == (model == "frozen")
    # The torques alone are played again by the same rules.
    again = verify_rollout(rollout)
    assert again.fine_displacement == pytest.approx(checked.fine_displacement, abs=1e-12)


# ---- tuning ------------------------------------------------------------------------------------


@pytest.mark.parametrize("wave", ["lateral", "dorsoventral", "helical_right"])
def test_waves_score_in_a_batch_what_they_score_alone(wave):
    scene = load_scene("eel_3d", ["episode.duration=0.5"])
    waves = [_wave(scene, wave, share, frequency=f) for share, f in ((1.0, 9.0), (0.4, 20.0))]
    alone = [
        play_episode(SwimEnv(scene), WavePolicy(scene, one), options=QUIET).info["progress"]
        for one in waves
    ]
    assert net_displacements(scene, waves).tolist() == alone


def test_the_grid_lies_around_the_modes_of_the_waves_axes():
    scene = load_scene("eel_3d")
    first = {axis: natural_frequencies(scene, 2, (axis,)) for axis in ("pitch", "yaw")}
    for wave, (one, other) in {
        "lateral": first["yaw"],
        "dorsoventral": first["pitch"],
        "helical_left": (first["yaw"][0], first["pitch"][0]),
    }.items():
        hertz, _ = tuning._grid(scene, None, None, wave)
        assert hertz[0] == pytest.approx(0.25 * one)
        assert hertz[-2:] == pytest.approx([0.92 * other, other])
    with refuses(SceneError, "scene eel_3d has joints without stiffness"):
        tuning._grid(scene.replace("beam.lateral_stiffness", 0.0), None, None)


def test_the_search_finds_the_best_helix_of_what_it_tried():
    scene = load_scene("eel_3d", ["episode.duration=2", "actuation.torque_limit=[4.0, 3.0]"])
    sizes = {"frequencies": 2, "wave_numbers": 3, "generations": 1, "population": 8}
    seen: list[float] = []
    log: dict[Point, float] = {}
    found = search_wave(scene, **sizes, progress=seen.append, keep=log.update, wave="helical_left")
    assert sum(seen) == actions_to_play(scene, **sizes, wave="helical_left")
    assert found["wave"] == "helical_left"
    best = found["candidates"][0]
    assert best["net_displacement"] == max(log.values()) > 0.0
    record = record_of(scene, found)
    wave = SpatialActuation(axes=("pitch", "yaw"), **record["wave"])
    assert wave.wave == "helical_left"
    assert wave.pitch_amplitude == pytest.approx(wave.amplitude * 4.0 / 3.0)
    assert net_displacements(scene, [wave])[0] == record["net_displacement"]


def test_the_best_wave_alone_is_checked_with_a_bar_that_fills():
    scene = load_scene("eel_3d", {**SHORT_EEL, "episode.duration": 0.5})
    found = search_wave(scene, frequencies=2, wave_numbers=2, generations=0)
    seen: list[float] = []
    checked = check_candidates(scene, found, seen.append)
    assert len(checked) == 1 < len(found["candidates"])
    assert sum(seen) == pytest.approx(1.0), "the closed loop, and three finer scenes"
    record = record_of(scene, found, checked)
    assert record["checked"][0]["changes"].keys() >= {"time_step", "model", "together"}
    assert (record["wave"] is None) == (not checked[0]["verified"])


def test_tuned_waves_of_a_scene_lie_side_by_side(tmp_path, capsys):
    file = tmp_path / "eel.yaml"
    load_scene("eel_3d", {"episode.duration": 1.0, "name": "eel"}).save(file)
    sizes = ["--generations", "0", "--frequencies", "2", "--wave-numbers", "2", "--json"]
    told = {}
    for wave in ("lateral", "helical_right"):
        assert call_main(["tune", "--scene", str(file), "--wave", wave, *sizes]) == 0
        told[wave] = json.loads(capsys.readouterr().out.splitlines()[-1])
    kept = {"lateral": "eel.tuned_wave.json", "helical_right": "eel.helical_right.tuned_wave.json"}
    assert {path.name for path in tmp_path.iterdir()} == {"eel.yaml", *kept.values()}
    scene = load_scene(file)
    for wave, name in (("lateral", "tuned_wave"), ("helical_right", "tuned_helical_right")):
        for policy in (name, tmp_path / kept[wave]):
            played = play_episode(SwimEnv(scene), load_policy(policy, scene), options=QUIET)
            assert played.net_displacement == pytest.approx(told[wave]["net_displacement"])
    assert references_on(scene) == ["paper_wave", "tuned_wave"]
    with refuses(OptionError, "scene eel has no tuned helical_left wave", "--wave helical_left"):
        load_policy("tuned_helical_left", scene)
    with refuses(OptionError, "scene a/b has no tuned lateral wave"):
        load_policy("tuned_wave", Scene.from_dict({**scene.to_dict(), "name": "a/b"}))
    # Of the body as it was tuned, whatever axes are there besides.
    with refuses(OptionError, "beam.lateral_stiffness is 3.0, it was 2.8 in tuning"):
        load_policy("tuned_wave", scene.replace("beam.lateral_stiffness", 3.0))
    alone = scene.replace({"actuation.axes": ["yaw"], "actuation.torque_limit": 3.0})
    assert load_policy("tuned_wave", alone).predict(np.zeros(5))[0].shape == (9,)
    with refuses(OptionError, "needs yaw and pitch among actuation.axes, scene eel has yaw"):
        load_policy(tmp_path / kept["helical_right"], alone)
    with refuses(OptionError, "dimension is 2, it was 3 in tuning"):
        load_policy(tmp_path / kept["lateral"], "swimmer")
    # A record without what a wave in space has is damaged.
    record = json.loads((tmp_path / kept["lateral"]).read_text())
    del record["wave"]["wave"]
    (tmp_path / kept["lateral"]).write_text(json.dumps(record))
    with pytest.raises(Exception, match="cannot read the tuned wave"):
        load_policy("tuned_wave", scene)


def test_a_wave_that_a_scene_has_not_is_not_tuned(capsys):
    for scene, wave, said in (
        ("swimmer", "helical_left", "a helical_left wave needs a scene of dimension 3"),
        ("paper_i_3d", "dorsoventral", "a dorsoventral wave needs pitch among actuation.axes"),
    ):
        assert call_main(["tune", "--scene", scene, "--wave", wave, "--output", "x.json"]) == 2
        assert said in capsys.readouterr().err
    assert wave_file("a/b.yaml").name == "b.tuned_wave.json"


# ---- what ships --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["eel_3d", "fish_3d"])
def test_the_tuned_wave_that_ships_is_verified_and_what_its_record_says(name):
    # Verified with panels on every shape; strips are a quarter off or more.
    scene = load_scene(name, {"fluid.model": "frozen"})
    record = find_tuned_wave(scene)
    checked = record["checked"][-1]
    assert checked["verified"] and abs(checked["changes"]["model"]) < 0.02
    assert checked["wave"] == record["wave"]
    tuned, paper = (
        play_episode(SwimEnv(scene), load_policy(name, scene), options=QUIET).net_displacement
        for name in ("tuned_wave", "paper_wave")
    )
    assert record["net_displacement"] == pytest.approx(tuned, rel=1e-3)
    assert record["paper_wave"] == pytest.approx(paper, rel=1e-3)
    assert tuned > 1.5 * paper
    assert references_on(scene) == ["paper_wave", "tuned_wave"]
    # Models compute the same fluid, so the wave plays with each; another fluid is refused.
    for model in ("strip", "panels"):
        load_policy("tuned_wave", scene.replace("fluid.model", model))
    with refuses(OptionError, "fluid.density is 900.0, it was 1000.0 in tuning"):
        load_policy("tuned_wave", scene.replace("fluid.density", 900.0))


def test_helical_waves_of_either_hand_swim_as_far():
    """They are mirror images, so the search for one serves both."""
    scene = load_scene("eel_3d", ["episode.duration=1.0"])
    both = [_wave(scene, wave) for wave in ("helical_right", "helical_left")]
    right, left = net_displacements(scene, both)
    assert right == pytest.approx(left, rel=1e-9) and abs(right) > 1e-3


# ---- what an agent's body must share -------------------------------------------------------------


def test_a_body_of_twice_the_size_is_similar_however_it_is_described():
    own = load_scene("fish_3d")
    section = own.beam.section
    table = [[row[0], 2.0 * row[1], 2.0 * row[2]] for row in section.table]
    # In the same water, lengths twice: masses 8, times T, stiffness mass l^3/T^2 = 64/T^2.
    changes: dict[str, object] = {
        "beam.length": 2.0,
        "beam.section": {"profile": "fish", "table": table},
        "episode.control_interval": 0.04,
        "actuation.torque_limit": tuple(32.0 / 4.0 * one for one in own.torque_limit),
    }
    for name in ("lateral", "dorsoventral", "torsional"):
        path = f"beam.{name}_stiffness"
        changes[path] = 64.0 / 4.0 * getattr(own.beam, f"{name}_stiffness")
    other = own.replace(changes)
    assert difference(own, other, AGENT_FIELDS, "training").startswith("beam.length is 2.0")
    assert is_similar(own, other) and is_similar(own, own)
    for path, value in (
        ("beam.torsional_stiffness", 100.0),
        ("actuation.torque_limit", [64.0, 48.0, 17.0]),
        ("beam.length", 2.01),
        ("actuation.axes", ["yaw", "pitch", "roll"]),
        ("fluid.density", 900.0),
        ("beam.elements", 8),
    ):
        assert not is_similar(own, other.replace(path, value)), path
    assert not is_similar(own, load_scene("swimmer"))
