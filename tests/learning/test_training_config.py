"""A training configuration: to and from YAML, and one clear error for whatever is wrong."""

import copy
import json
from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import Any

import pytest
import yaml

pytest.importorskip("stable_baselines3")

from swim_agents.learning.config import ConfigError, TrainingConfig, config_names, load_config

from swim_env import load_scene
from tests.support import refuses


def written(folder: Path, text: str, name: str = "mine.yaml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


# ---- to and from YAML --------------------------------------------------------------------------


@pytest.mark.parametrize("name", config_names())
def test_a_shipped_configuration_is_found_and_survives_the_way_through_a_file(name, tmp_path):
    config = load_config(name)
    assert config.name == name and config.description
    assert (config.ppo is None) == (config.algorithm == "SAC")
    assert (config.sac is None) == (config.algorithm == "PPO")
    changes: dict[str, Any] = {"description": "ünï: # 'x'\nsecond", "final_learning_rate": None}
    for one in (config, replace(config, **changes, environment={"effort_weight": 0.3})):
        assert TrainingConfig.from_dict(one.to_dict()) == one
        one.save(tmp_path / "saved.yaml")
        assert load_config(tmp_path / "saved.yaml") == one
    # What a configuration gives away does not change it.
    config.to_dict()["environment"]["effort_weight"] = 5.0
    assert config == load_config(name)


@pytest.mark.parametrize("name", ["swimmer", "stiff_head"])
def test_a_resolved_configuration_holds_the_scene_in_full(name, tmp_path):
    path = written(tmp_path, f"scene: {name}\noverrides: {{beam.half_thickness: 0.02}}\n")
    config = load_config(path)
    expected = load_scene(name, {"beam.half_thickness": 0.02})
    assert config.scene == expected
    config.save(tmp_path / "resolved.yaml")
    data = yaml.safe_load((tmp_path / "resolved.yaml").read_text())
    assert data["scene"] == expected.to_dict()
    assert data["scene"]["beam"]["half_thickness"] == 0.02
    assert "overrides" not in data
    assert data["network"]["layers"] == [64, 64]
    assert data["ppo"]["rollout"] == 128
    assert "sac" not in data
    assert (data["name"], data["steps"]) == ("mine", 1_000_000)  # named after the file


def test_arguments_of_the_task_are_the_same_as_tuples_and_as_lists(tmp_path):
    config = TrainingConfig(task="target", environment={"target_distance": (0.5, 1.0)})
    config.save(tmp_path / "saved.yaml")
    assert load_config(tmp_path / "saved.yaml") == replace(config, name="agent")
    assert TrainingConfig.from_dict(config.to_dict()).to_dict() == config.to_dict()


# ---- overrides ---------------------------------------------------------------------------------


def test_overrides_reach_fields_blocks_scene_and_task():
    before = load_config("ppo_forward").to_dict()
    changes = {
        "steps": 1000,
        "ppo.epochs": 3,
        "network.layers": [8, 4],
        "evaluation.every": 77,
        "scene.beam.elements": 18,
        "scene.fluid.density": 20.0,
        "environment.effort_weight": 0.5,
        "final_learning_rate": None,
    }
    expected = copy.deepcopy(before)
    for path, value in changes.items():
        *blocks, name = path.split(".")
        reduce(dict.__getitem__, blocks, expected)[name] = value
    typed = [f"{path}={json.dumps(value)}" for path, value in changes.items()]
    for given in (changes, typed):
        assert load_config("ppo_forward", given).to_dict() == expected
    assert load_config("ppo_forward", typed).make_task().effort_weight == 0.5
    assert load_config("ppo_forward").to_dict() == before


@pytest.mark.parametrize(
    "overrides", ["{integrator.tolerance: 1e-4}", "[integrator.tolerance=1e-4]"]
)
def test_a_number_without_a_dot_is_a_number_wherever_one_is_written(overrides, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        "steps: 1e6\nlearning_rate: 1e-4\nenvironment: {effort_weight: 1e-3}\n"
        f"scene: {{fluid: {{density: 1E3}}}}\noverrides: {overrides}\n"
    )
    changes = ["ppo.clip_range=1e-1", "environment.heading_weight=1e-2", "scene.damping=null"]
    config = load_config(path, [*changes, "scene.integrator.time_step=1e-2"])
    assert (config.steps, config.learning_rate) == (1_000_000, 1e-4)
    assert config.environment == {"effort_weight": 1e-3, "heading_weight": 1e-2}
    assert config.ppo is not None and config.ppo.clip_range == 0.1
    scene = config.scene
    assert scene.fluid is not None and scene.fluid.density == 1000.0
    assert (scene.integrator.tolerance, scene.integrator.time_step) == (1e-4, 0.01)
    assert load_config(path, [*changes, "steps=1e5"]).steps == 100_000


def test_overrides_hold_together():
    assert load_config("ppo_forward", ["members=8", "members=16"]).members == 16
    config = load_config("ppo_forward", ["scene=stiff_head", "scene.beam.half_thickness=0.02"])
    assert config.scene == load_scene("stiff_head", ["beam.half_thickness=0.02"])
    changes = ["scene.initial.joint_angles=[0.1, 0.2]", "scene.beam.elements=3"]
    assert load_config("ppo_forward", changes).scene.initial.joint_angles == (0.1, 0.2)
    config = load_config("ppo_forward", ["algorithm=SAC", "ppo=null", "sac.tau=0.5"])
    assert config.sac is not None
    assert (config.sac.tau, config.ppo) == (0.5, None)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        (["step=4"], "unknown field step (nearest: steps)"),
        (["ppo.epoch=4"], "unknown field ppo.epoch (nearest: epochs)"),
        (["netwrk.layers=[4]"], "unknown field netwrk.layers"),
        (["scene.beam.element=4"], "unknown field beam.element (nearest: beam.elements)"),
        (["scene.beam.elements=1.5"], "beam.elements must be an integer"),
        (["environment.efort_weight=1"], "environment.efort_weight (nearest: effort_weight)"),
        (["steps"], "override 'steps' must read"),
        (["steps="], "steps must be an integer, got null"),
        (["steps=[1"], "not valid YAML"),
        (["algorithm=SAC"], "a block ppo has no meaning with algorithm SAC"),
        (["ppo=3", "ppo.epochs=4"], "ppo must be a mapping"),
        (["environment=3", "environment.effort_weight=4"], "environment must be a mapping"),
    ],
)
def test_a_bad_override_is_named_with_its_file(changes, problem):
    with refuses(ConfigError, problem, "(configs/agents/ppo_forward.yaml with overrides)"):
        load_config("ppo_forward", changes)


# ---- misspelt fields and wrong values ----------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "field", "close"),
    [
        ("learning_rat: 0.1", "learning_rat", "learning_rate"),
        ("Members: 4", "Members", "members"),
        ("network: {layer: [4]}", "network.layer", "layers"),
        ("ppo: {roll_out: 4}", "ppo.roll_out", "rollout"),
        ("algorithm: SAC\nsac: {buffersize: 4}", "sac.buffersize", "buffer"),
        ("evaluation: {episode: 4}", "evaluation.episode", "episodes"),
        ("environment: {effort_wieght: 0.1}", "environment.effort_wieght", "effort_weight"),
        ("scene: swimmer\noverrides: {beam.elemets: 4}", "beam.elemets", "beam.elements"),
        ("scene: swimmer\noverrides: ['beam.elemets=4']", "beam.elemets", "beam.elements"),
        ("scene: {beam: {elemets: 4}}", "beam.elemets", "elements"),
    ],
)
def test_a_misspelt_field_is_named_with_the_nearest_one_and_the_file(text, field, close, tmp_path):
    path = written(tmp_path, text)
    with refuses(ConfigError, f"unknown field {field} (nearest: {close})", str(path)):
        load_config(path)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("discount: 1.0", "discount must be below 1, got 1"),
        ("discount: 0", "discount must be above 0, got 0"),
        ("discount: autoo", "discount must be a number or auto, got text 'autoo'"),
        ("noise_hold: autoo", "noise_hold must be a number or auto, got text 'autoo'"),
        ("ppo: {gae_lambda: autoo}", "ppo.gae_lambda must be a number or auto, got text 'autoo'"),
        ("learning_rate: .nan", "learning_rate must be a finite number, got nan"),
        ("learning_rate: 0", "learning_rate must be above 0, got 0"),
        ("final_learning_rate: -0.1", "final_learning_rate must be at least 0, got -0.1"),
        ("reward_scale: 0.0", "reward_scale must be above 0, got 0.0"),
        ("members: true", "members must be an integer, got true"),
        ("members: 0", "members must be at least 1, got 0"),
        ("steps: 1.5", "steps must be an integer, got 1.5"),
        ("checkpoint_every: 0", "checkpoint_every must be at least 1, got 0"),
        ("torch_threads: 0", "torch_threads must be at least 1, got 0"),
        ("noise_hold: -1", "noise_hold must be at least 1, got -1"),
        ("state_dependent_noise: 1", "state_dependent_noise must be true or false, got 1"),
        ("algorithm: DDPG", "algorithm must be one of PPO, SAC, got 'DDPG'"),
        (
            "task: froward",
            "unknown task 'froward' (nearest: forward); tasks: forward, target, turn",
        ),
        ("name: a/b", "name must be a short text without slashes, got 'a/b'"),
        ("name: ..", "name must be"),
        ("name: 7", "name must be text, got 7"),
        ("description: [a]", "description must be text, got a list of 1"),
        ("network: 3", "network must be a mapping of fields, got 3"),
        ("network: {layers: []}", "network.layers must be a list of widths such as [64, 64]"),
        ("network: {layers: [64, true]}", "network.layers[1] must be an integer, got true"),
        ("network: {layers: [0]}", "network.layers[0] must be at least 1, got 0"),
        ("network: {activation: gelu}", "network.activation must be one of tanh, relu, elu"),
        ("network: {log_std: 3}", "network.log_std must be at most 2, got 3"),
        ("ppo: {minibatch: 1000}", "ppo.minibatch must divide members * ppo.rollout = 8192"),
        ("ppo: {rollout: 1}", "ppo.rollout must be at least 2, got 1"),
        ("ppo: {gae_lambda: 1.1}", "ppo.gae_lambda must be at most 1, got 1.1"),
        ("ppo: {target_kl: 0}", "ppo.target_kl must be above 0, got 0"),
        ("sac: {}", "a block sac has no meaning with algorithm PPO"),
        (
            "algorithm: SAC\nreward_scale: 1\nsac: {buffer: 8}",
            "sac.buffer must be at least members = 64, got 8",
        ),
        ("algorithm: SAC", "reward_scale must be a number with algorithm SAC"),
        ("algorithm: SAC\nsac: {tau: 0}", "sac.tau must be above 0, got 0"),
        ("algorithm: SAC\nsac: {updates: 0}", "sac.updates must be at least 1, got 0"),
        ("algorithm: SAC\nsac: {temperature: 0}", "sac.temperature must be above 0, got 0"),
        ("evaluation: {episodes: 0}", "evaluation.episodes must be at least 1, got 0"),
        ("evaluation: {seed: -1}", "evaluation.seed must be at least 0, got -1"),
        ("environment: [1]", "environment must be a mapping of arguments, got a list of 1"),
        ("environment: {effort_weight: -1}", "effort_weight must be at least 0"),
        ("task: target\nenvironment: {target_radius: 0}", "target_radius must be above 0"),
        ("scene: 3", "a scene must be given as a name"),
        ("scene: swimer", "unknown scene 'swimer'"),
        ("overrides: 3", "overrides must be a mapping or a list, got 3"),
        ("- members", "a configuration must be a mapping of fields, got a list of 1"),
        ("", "the file is empty, must hold a training configuration"),
        ("members: 4\nmembers: 8", "line 2: field 'members' is given twice"),
        ("1: 2", "a field's name must be text"),
        ("members: !!python/object:os.system x", "not valid YAML"),
        ('environment: {"a\\nb": 1}', "unknown field environment."),
    ],
)
def test_a_wrong_value_is_reported_in_one_line_with_its_file(text, problem, tmp_path):
    path = written(tmp_path, text)
    with refuses(ConfigError, problem, str(path)) as caught:
        load_config(path)
    assert text.startswith("scene") or str(caught.value).endswith(f"({path})")


def test_what_is_no_file_of_text_is_refused(tmp_path):
    with refuses(ConfigError, "no such configuration: ppo_forwrd (nearest: ppo_forward)"):
        load_config("ppo_forwrd")
    with refuses(ConfigError, "somewhere/sac_forwad.yaml (nearest: sac_forward)", "shipped: "):
        load_config("somewhere/sac_forwad.yaml")
    path = tmp_path / "latin.yaml"
    path.write_bytes("description: Wärme".encode("latin-1"))
    with refuses(ConfigError, "the file must be UTF-8 text, byte 14 is not", str(path)):
        load_config(path)
    with refuses(ConfigError, "cannot read the configuration: Is a directory"):
        load_config(tmp_path)


# ---- what follows from it ----------------------------------------------------------------------


def test_the_learning_rate_goes_from_the_first_to_the_last_and_no_further():
    config = TrainingConfig(steps=1000, learning_rate=0.5, final_learning_rate=0.25)
    rates = [config.learning_rate_at(steps) for steps in (0, 250, 500, 1000, 5000)]
    assert rates == [0.5, 0.4375, 0.375, 0.25, 0.25]
    to_zero = replace(config, final_learning_rate=0.0)
    assert to_zero.learning_rate_at(1000) == 0.0
    constant = replace(config, final_learning_rate=None)
    assert [constant.learning_rate_at(steps) for steps in (0, 999, 5000)] == [0.5] * 3


def test_a_round_is_a_rollout_of_all_members():
    assert load_config("ppo_forward").round_steps == 64 * 128
    assert load_config("sac_forward", ["members=10", "sac.rollout=3"]).round_steps == 30


# ---- any body ----------------------------------------------------------------------------------

EEL = """
beam: {length: 0.5, elements: 5, half_thickness: 0.005, line_density: 0.156,
       bending_stiffness: 0.156}
fluid: {density: 10.0}
damping: {retardation_time: auto}
"""


@pytest.mark.parametrize(("name", "periods", "held"), [("ppo", 50.0, 4), ("sac", 20.0, 8)])
def test_what_is_counted_in_actions_follows_from_the_body(name, periods, held, tmp_path):
    scene = written(tmp_path, EEL, "eel.yaml")
    config = load_config(name, scene=scene)
    assert (config.name, config.scene) == (f"{name}_eel", load_scene(scene))
    # Ten actions in a period.
    assert 1.0 / (1.0 - config.discount) == pytest.approx(10.0 * periods)
    assert config.noise_hold == held
    quick = load_config(name, scene=scene, overrides={"scene.episode.control_interval": 0.002})
    times = config.scene.episode.control_interval / 0.002
    assert 1.0 / (1.0 - quick.discount) == pytest.approx(10.0 * periods * times)
    assert quick.noise_hold == round(held * times)
    if config.ppo is not None:
        assert config.ppo.gae_lambda == pytest.approx(0.95)
        assert quick.ppo.gae_lambda == pytest.approx(1.0 - 0.05 / times)
    assert load_config(name, ["discount=0.9"], scene).discount == 0.9


def test_changes_of_the_scene_count_before_the_body_sets_the_rest(tmp_path):
    scene = written(tmp_path, EEL, "eel.yaml")
    config = load_config("ppo", ["scene.beam.length=1.0", "steps=1000"], scene)
    longer = load_scene(scene, ["beam.length=1.0"])
    assert (config.scene, config.steps) == (longer, 1000)
    # Wherever the scene is named, or written out.
    inside = yaml.safe_load(EEL)
    inside["episode"] = {"control_interval": "auto"}
    for own in ("eel.yaml", inside):
        path = written(tmp_path, yaml.safe_dump({"discount": "auto", "scene": own}))
        expected = load_scene(scene if own == "eel.yaml" else inside, {"beam.length": 1.0})
        config = load_config(path, ["scene.beam.length=1.0"])
        assert config.scene == expected
        former = load_config(path)
        assert config.scene.episode.control_interval > 2.0 * former.scene.episode.control_interval
    config = load_config("ppo", [f"scene={scene}", "scene.beam.length=1.0"])
    assert config.scene == longer
    # Ten actions in a period: those of the former body, swimmer, are others.
    assert config.discount == pytest.approx(1.0 - 1.0 / 500.0)
    assert load_config("ppo").discount != pytest.approx(1.0 - 1.0 / 500.0)


def test_overrides_of_a_configuration_go_with_another_scene_too(tmp_path):
    scene = written(tmp_path, EEL, "eel.yaml")
    path = written(tmp_path, "scene: swimmer\noverrides: {beam.elements: 7, beam.length: 0.6}\n")
    expected = load_scene(scene, ["beam.elements=7", "beam.length=1.0"])
    assert load_config(path, ["scene.beam.length=1.0"], scene).scene == expected
    assert load_config(path, [f"scene={scene}", "scene.beam.length=1.0"]).scene == expected


def test_a_scene_that_cannot_be_used_is_an_error_of_the_configuration(tmp_path):
    with refuses(ConfigError, "no such scene file", "nowhere.yaml"):
        load_config("ppo", scene=tmp_path / "nowhere.yaml")
    scene = written(tmp_path, "beam: {elemets: 4}", "eel.yaml")
    with refuses(ConfigError, "unknown field beam.elemets", str(scene)):
        load_config("ppo", scene=scene)
    uneven = load_scene("swimmer", {"episode.control_interval": 0.0301})
    with refuses(ConfigError, "scene: episode.control_interval must be a whole number of steps"):
        TrainingConfig(scene=uneven)


def test_automatic_settings_of_a_body_without_a_period():
    limp = {"beam.bending_stiffness": [0.0, *[5.0] * 7]}
    data = {"discount": "auto", "noise_hold": "auto", "scene": "swimmer", "overrides": limp}
    config = TrainingConfig.from_dict(data)
    assert (config.discount, config.noise_hold) == (pytest.approx(1.0 - 1.0 / 500.0), 4)
