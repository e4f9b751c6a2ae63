"""A task of one's own trains, resumes after a kill, compares, replays and records."""

import json
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

import gymnasium
from stable_baselines3.common.vec_env import DummyVecEnv
from swim_agents.learning.config import ConfigError, TrainingConfig, load_config
from swim_agents.learning.saved import AgentError, load_agent
from swim_agents.learning.trainer import run_status, train
from swim_agents.policies import load_policy
from swim_agents.rollout import play_episode
from swim_agents.vec_env import SwimVecEnv
from swim_agents.verification import fine_scene, verify_rollout

from swim_env import OptionError, SwimEnv, SwimVectorEnv, Task, load_scene
from swim_env.recording.reader import read_recording
from tests.learning.small_runs import assert_same_run, small_config
from tests.support import (
    ROOT,
    SMALL,
    assert_same,
    interrupt_script,
    refuses,
    run_python,
    run_script,
    uniform,
)

TASK = """
import numpy as np
from swim_env import Task

class Cruise(Task):
    reasons = {"fast": "it is as fast as it should be"}
    successes = ("fast",)

    def state(self, count):
        return {"speed": np.zeros(count)}

    def draw_state(self, random):
        return {"speed": random.uniform(1e-4, 1e-3)}

    def observe(self, now):
        return {"speed": 1e3 * now.state["speed"]}

    def reward(self, now):
        return {"speed": -np.abs(now.velocity[:, 0] + now.state["speed"]) * now.seconds}

    def ends(self, now):
        return {"fast": -now.velocity[:, 0] > 5.0 * now.state["speed"]}
"""
CONFIG = """
name: cruise
task: tasks/cruise.py:Cruise
scene: body.yaml
overrides: {episode.duration: 0.4}
members: 4
steps: 3200
reward_scale: 1000.0
network: {layers: [8]}
evaluation: {every: 600, episodes: 2}
checkpoint_every: 400
ppo: {rollout: 16, minibatch: 32, epochs: 2}
"""


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a task, a scene and a configuration."""
    folder = tmp_path_factory.mktemp("project")
    (folder / "tasks").mkdir()
    (folder / "tasks" / "cruise.py").write_text(TASK)
    load_scene("swimmer", SMALL).replace("name", "body").save(folder / "body.yaml")
    (folder / "cruise.yaml").write_text(CONFIG)
    return folder


@pytest.fixture(scope="module")
def trained(project: Path) -> Path:
    """Return the folder of a run of it."""
    train(load_config(project / "cruise.yaml"), project / "whole", 0, threads=1)
    return project / "whole"


def test_the_task_is_short():
    assert len([line for line in TASK.splitlines() if line.strip()]) <= 25


def test_paths_in_a_configuration_are_relative_to_its_file(project, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = load_config(project / "cruise.yaml")
    assert config.scene.name == "body" and config.scene.beam.elements == 3
    assert config.task == f"{project / 'tasks' / 'cruise.py'}:Cruise"
    assert TrainingConfig.from_dict(config.to_dict()) == config
    with refuses(ConfigError, "no such scene file", "nowhere.yaml"):
        load_config(project / "cruise.yaml", ["scene=nowhere.yaml"])


def test_a_task_trains_and_resumes_after_a_kill(project, trained):
    output = project / "killed"
    arguments = [project / "cruise.yaml", "--threads", "1", "--output", output, "--resume"]

    def when() -> bool:
        try:
            reached = (output / "seed_0" / "evaluations.csv").read_text().count("\n") > 3
        except FileNotFoundError:
            return False
        time.sleep(0.1 * reached)
        return reached

    arguments = [str(one) for one in arguments]
    done = interrupt_script("train", *arguments, when=when, how=signal.SIGKILL)
    assert done.code == -signal.SIGKILL, "the run ended before it was killed"
    done = run_script("train", *arguments)
    assert done.code == 0, done.err
    assert "succeed" in done.out
    assert_same_run(trained, output / "seed_0")
    record = run_status(trained)
    assert record is not None and record["finished"]


def test_its_agent_plays_alone_and_finer_and_is_read_without_running_the_task(project, trained):
    name = f"{project / 'tasks' / 'cruise.py'}:Cruise"
    agent = load_policy(trained / "agent", task=name)
    env = SwimEnv(agent.scene, task=name)
    rollout = play_episode(env, agent, seed=5)
    closed = play_episode(SwimEnv(fine_scene(env.scene), task=name), agent, seed=5)
    checked = verify_rollout(rollout, closed)
    assert checked.verified == (rollout.info["success"] == closed.info["success"])
    assert rollout.score == rollout.rewards.sum() != rollout.net_displacement
    assert rollout.drawn["speed"] == closed.drawn["speed"]
    with refuses(AgentError, "was trained for task", "not for forward"):
        load_policy(trained / "agent", env.scene, task="forward")
    code = (
        "import sys; from swim_agents.learning.saved import load_agent\n"
        f"load_agent({str(trained / 'agent')!r})\n"
        "assert not [name for name in sys.modules if 'cruise' in name]"
    )
    assert run_python("-c", code).code == 0
    # The file may have moved with its project.
    description = json.loads((trained / "agent" / "agent.json").read_text())
    assert description["task"] == name and description["observation"]["size"] == 10
    load_agent(trained / "agent").check(env.scene, "/elsewhere/cruise.py:Cruise")


def test_it_compares_replays_and_records_by_the_commands(project, trained, tmp_path):
    task = ["--task", "tasks/cruise.py:Cruise", "--scene", "body.yaml"]
    done = run_script(
        "compare",
        *task,
        *("--policies", trained, "random", "--seeds", "1", "2", "--duration", "0.4", "--json"),
        *("--output", tmp_path / "contest", "--record", tmp_path / "contest.rrd"),
        cwd=project,
    )
    record = done.figures()
    assert record["score"] == "return (BL)"
    one = record["policies"]["cruise"]
    assert one["success_rate"] is not None and len(one["score"]) == 2
    assert one["closed_loop_change"][0] is None or abs(one["closed_loop_change"][0]) < 10.0
    assert "return (BL)" in (tmp_path / "contest" / "comparison.md").read_text()
    assert len(read_recording(tmp_path / "contest.rrd").swimmers) >= 2
    done = run_script(
        "replay",
        *task,
        *("--env", "--policy", trained, "--duration", "0.4", "--json"),
        cwd=project,
    )
    figures = done.figures()
    assert figures["task"].endswith("cruise.py:Cruise") and "reward_speed" in figures["info"]
    done = run_script(
        "visualise",
        *task,
        *("--policy", trained, "--duration", "0.4", "--no-flow", "--output", tmp_path / "v.rrd"),
        cwd=project,
    )
    assert done.code == 0, done.err
    assert (tmp_path / "v.rrd").stat().st_size > 1000


def test_options_of_a_task_are_given_to_the_commands(tmp_path):
    task = ["--scene", "swimmer", "--duration", "0.1", "--task", "turn"]
    near = ["--task-option", "turn=[0.2, 0.3]", "tolerance=0.199"]
    brief = [*task, *near, "--json"]
    figures = run_script("replay", *brief, "--env", "--policy", "zero").figures()
    assert figures["task_options"] == {"turn": [0.2, 0.3], "tolerance": 0.199}
    assert 0.15 < abs(figures["info"]["heading_error"]) < 0.35
    record = run_script(
        "compare", *brief, "--policies", "zero", "--seeds", "1", "--record", tmp_path
    ).figures()
    assert record["environment"] == figures["task_options"]
    for options in (near, []):
        more = ["--policy", "zero", "--no-flow", "--output", tmp_path]
        assert run_script("visualise", *task, *options, *more).code == 0
    # Recordings of unlike tasks have unlike names.
    assert len(list(tmp_path.glob("*.rrd"))) == 3


class Wide(Task):
    """Hands its options on to a class that takes none."""

    def __init__(self, scene, **options):
        super().__init__(scene, **options)


def test_an_option_that_nothing_takes_is_refused():
    with refuses(OptionError, "unknown option 'turning_wieght' of task", "Task.__init__()"):
        SwimEnv(task=Wide, task_options={"turning_wieght": 1.0})


class Wrong(Task):
    """Has a mistake of its own."""

    def __init__(self, scene, weight=1.0):
        super().__init__(scene, wieght=weight)


def test_a_mistake_in_a_task_is_not_taken_for_an_option():
    with pytest.raises(TypeError, match="'wieght'"):
        SwimEnv(task=Wrong, task_options={"weight": 1.0})


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"task": "turn", "environment": {"trun": 1}}, "unknown field environment.trun"),
        ({"task": "turn", "environment": {"turn": [2, 1]}}, "environment: turn must be two"),
        ({"task": "station"}, "environment: task station needs a stream"),
        ({"task": "tests.tasks.own_tasks:Glide"}, "no task 'Glide' in tests.tasks.own_tasks"),
        ({"task": "tests.tasks.test_own_task:Bad"}, "task tests.tasks.test_own_task:Bad: 'x'"),
    ],
)
def test_a_configuration_of_a_wrong_task_is_refused(changes, problem):
    with refuses(ConfigError, problem):
        small_config(**changes)


from swim_env import Task  # noqa: E402


class Bad(Task):
    def reward(self, now: Any) -> Any:
        return {"x": np.zeros(2)}


@pytest.mark.parametrize("task", ["turn", "path", "efficient", "station"])
def test_every_task_trains(task, tmp_path):
    overrides = {"beam.elements": 3, "fluid.panels_per_element": 2, "episode.duration": 0.4}
    if task == "station":
        overrides["stream.velocity"] = [0.1, 0.0]
    config = small_config(task=task, overrides=overrides, steps=800)
    record = train(config, tmp_path / "run", threads=1, record=tmp_path / "recordings")
    assert record["finished"] and np.isfinite(record["best"]["return_mean"])
    assert load_policy(tmp_path / "run" / "agent", task=task).description["task"] == task


def test_wrapped_batches_are_stepped_with_their_wrappers():
    def scaled(reward: Any) -> Any:
        return 2.0 * reward

    given = {"overrides": {**SMALL, "episode.duration": 0.2}, "task": "turn"}
    wrappers = gymnasium.wrappers.vector
    batch = SwimVectorEnv(3, "swimmer", autoreset_mode="SameStep", **given)
    batch = wrappers.RecordEpisodeStatistics(wrappers.TransformReward(batch, scaled))
    venv = SwimVecEnv(batch)
    single = DummyVecEnv([lambda: SwimEnv("swimmer", **given)] * 3)
    venv.seed(3)
    single.seed(3)
    assert_same(venv.reset(), single.reset())
    for actions in uniform(25, 3, 2).astype(np.float32):
        ours, theirs = venv.step(actions), single.step(actions)
        assert_same(ours[0], theirs[0])
        assert ours[1].tobytes() == (2.0 * theirs[1]).tobytes()
        assert_same(ours[2], theirs[2])
        for one, other in zip(ours[3], theirs[3], strict=True):
            assert {key: one[key] for key in other}.keys() == other.keys()
            if ours[2].all():
                assert one["episode"]["l"] == 10
    assert venv.batch is batch.unwrapped and venv.env is batch
    with pytest.raises(Exception, match="autoreset_mode='SameStep'"):
        SwimVecEnv(wrappers.TransformReward(SwimVectorEnv(2, "swimmer", SMALL), scaled))


@pytest.mark.parametrize(
    ("name", "arguments", "text"),
    [
        ("custom_reward", ["--steps", "20"], "what the bending cost"),
        ("custom_task", ["--steps", "20"], "reward_speed"),
        ("own_body", ["--steps", "50"], "bending modes"),
        ("ppo_plain_sb3", ["--steps", "256", "--members", "2"], "body lengths in 20 s"),
    ],
)
def test_an_example_runs(name, arguments, text, tmp_path):
    done = run_python(ROOT / "examples" / f"{name}.py", *arguments, cwd=tmp_path)
    assert done.code == 0, done.err
    assert text in done.out
    if name == "custom_task":
        assert load_config(ROOT / "examples" / "custom_task.yaml").task.endswith(":CruiseTask")
