"""The agents that ship: complete, loadable without a scene, and as good as their record says."""

import json

import numpy as np
import pytest
from swim_agents import load_policy, play_episode, policy_names
from swim_agents.policies import PRETRAINED_FOLDER, pretrained_names

from swim_env import SwimEnv, SwimTargetEnv, load_scene
from swim_env.envs.spatial import SwimTargetEnv3D

pytest.importorskip("stable_baselines3")

from swim_agents.comparison.contest import FIRST_SEED, entries_of, hold_contest
from swim_agents.learning.config import config_names, load_config
from swim_agents.learning.logs import read_log
from swim_agents.learning.saved import AgentError, AgentPolicy, load_agent
from swim_agents.learning.shipping import SHIPPED_FILES, command_of, scores_of, ship_agent
from swim_agents.learning.trainer import train

from tests.learning.small_runs import small_config
from tests.support import files_of, refuses

PLANAR = ("ppo_forward", "sac_forward", "ppo_target")
SWIM_IN_SPACE = ("ppo_eel_3d", "sac_eel_3d", "ppo_fish_3d", "sac_fish_3d")
NAMES = (*PLANAR, *SWIM_IN_SPACE, "ppo_target_3d")


def test_the_agents_that_are_promised_are_there():
    assert set(pretrained_names()) == set(NAMES) < set(policy_names())
    assert {*NAMES, "ppo_stiff_head", "demo", "ppo", "sac"} == set(config_names())


def rounded(data):
    """Return plain data with what follows from natural frequencies to twelve digits.

    Libraries of linear algebra differ in the last ones from processor to processor.
    """
    return json.loads(json.dumps(data), parse_float=lambda text: float(f"{float(text):.12g}"))


@pytest.mark.parametrize("name", NAMES)
def test_an_agent_ships_with_all_its_files(name):
    folder = PRETRAINED_FOLDER / name
    files = files_of(folder)
    assert sorted(files) == sorted(SHIPPED_FILES)
    assert sum(map(len, files.values())) < 1_000_000
    training = load_agent(folder).description["training"]
    assert training["command"] == f"swim-env train {name} --seeds {training['seed']}"
    assert training["run_seconds"] >= training["seconds"] > 0.0
    curve = read_log(folder / "evaluations.csv")
    assert curve["steps"][-1] == training["run_steps"]
    for file, content in files.items():
        private = file.endswith((".json", ".csv")) and (b"/tmp" in content or b"/home" in content)
        assert not private, file
    # The command trains with the configuration that is kept beside the agent.
    kept, shipped = (load_config(one).to_dict() for one in (folder / "config.yaml", name))
    for data in (kept, shipped):
        del data["description"], data["scene"]["description"]
    assert rounded(kept) == rounded(shipped)


@pytest.mark.parametrize("name", ["ppo_forward", "sac_forward"])
def test_a_forward_agent_does_as_its_record_says_and_more_than_the_tuned_wave(name):
    record = json.loads((PRETRAINED_FOLDER / name / "scores.json").read_text())
    assert record["seeds"][0] == FIRST_SEED and len(record["seeds"]) >= 20
    assert all(record["verified"])
    assert record["fine_ratio_to_tuned_wave"] > 1.5 and record["fine_ratio_to_paper_wave"] > 50.0
    rollout = play_episode(SwimEnv("swimmer"), load_policy(name), FIRST_SEED)
    # A network's products round otherwise for one observation than for a batch.
    assert rollout.net_displacement == pytest.approx(record["net_displacement"][0], rel=0.02)


@pytest.mark.parametrize("name", SWIM_IN_SPACE)
def test_an_agent_in_space_does_as_its_record_says_and_more_than_the_tuned_wave(name):
    """Closed loop and torques alone, with panels on every shape and a quarter of the step."""
    record = json.loads((PRETRAINED_FOLDER / name / "scores.json").read_text())
    assert record["seeds"][0] == FIRST_SEED and all(record["verified"])
    assert record["fine_ratio_to_tuned_wave"] > 1.2
    policy = load_policy(name)
    rollout = play_episode(SwimEnv(policy.scene), policy, FIRST_SEED)
    assert rollout.net_displacement == pytest.approx(record["net_displacement"][0], rel=0.02)


def test_the_target_agent_in_space_reaches_unseen_points():
    """All of 100 in its scene; `scripts/target_rate.py` counts in the finer one as well."""
    record = json.loads((PRETRAINED_FOLDER / "ppo_target_3d" / "scores.json").read_text())
    assert all(record["verified"]) and record["verified_success_rate"] == 1.0
    policy = load_policy("ppo_target_3d")
    env = SwimTargetEnv3D(policy.scene)
    seeds = range(FIRST_SEED + 100, FIRST_SEED + 106)
    assert all(play_episode(env, policy, seed).info["success"] for seed in seeds)


def test_the_target_agent_does_as_its_record_says():
    record = json.loads((PRETRAINED_FOLDER / "ppo_target" / "scores.json").read_text())
    assert len(record["seeds"]) >= 100 and record["success_rate"] >= 0.9
    assert 0.5 < record["verified_success_rate"] <= record["success_rate"]
    policy, env = load_policy("ppo_target", task="target"), SwimTargetEnv("swimmer")
    reached = [
        bool(play_episode(env, policy, seed).info["success"]) for seed in record["seeds"][:4]
    ]
    assert reached == record["success"][:4]


def test_an_agent_plays_another_solver_and_refuses_another_body():
    assert isinstance(load_policy("ppo_forward", "paper_i"), AgentPolicy)
    with refuses(AgentError, "cannot play scene paper_iv: beam.elements is 3"):
        load_policy("ppo_forward", "paper_iv")


def test_an_agent_ships_from_a_finished_run_with_its_true_command(tmp_path):
    config = small_config(steps=128)
    run = tmp_path / "run"
    train(config, run, 3, command="swim-env train mine.yaml --seeds 3")
    assert command_of(run) == "swim-env train mine.yaml --seeds 3"
    scene = load_scene(config.scene)
    entries = entries_of([str(run / "agent")], scene)
    record = hold_contest(scene, entries, [FIRST_SEED, FIRST_SEED + 1]).record
    found = scores_of(record, entries[-1].name)
    assert found["duration"] == 0.4 and found["durations"] == [0.4, 0.4]
    ship_agent(run, tmp_path / "ready" / "mine", found)
    shipped = load_agent(tmp_path / "ready" / "mine")
    assert shipped.name == "mine"
    assert shipped.description["training"]["command"].endswith("mine.yaml --seeds 3")
    assert shipped.description["training"]["run_steps"] == 128
    start = np.zeros(shipped.description["observation"]["size"], dtype=np.float32)
    assert (shipped.predict(start)[0] == load_agent(run / "agent").predict(start)[0]).all()
