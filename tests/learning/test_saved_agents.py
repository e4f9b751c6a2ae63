"""Saved agents: the same actions again, no code run on the way, and refusals that name a field."""

import base64
import io
import json
import pickle
import shutil
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

import stable_baselines3
import torch
from gymnasium.vector import AutoresetMode
from swim_agents.learning.config import TrainingConfig
from swim_agents.learning.environment import make_batch
from swim_agents.learning.saved import AgentError, load_agent, load_bare_model, save_agent
from swim_agents.learning.smoothing import Smoothing
from swim_agents.learning.trainer import train
from swim_agents.policies import PRETRAINED_FOLDER, load_policy
from swim_agents.rollout import play_episodes

from swim_env import OptionError, load_scene
from tests.learning.small_runs import (
    KINDS,
    Bomb,
    assert_damage_is_one_clear_error,
    contents,
    hidden,
    small_config,
    untrained,
)
from tests.support import assert_one_line, call_script, refuses, run_python

#: A function that returns a model of a kind and the folder it was saved to.
Saved = Callable[[str], tuple[Any, Path]]


def model_of(config: TrainingConfig) -> Any:
    """Return a model whose actions reach from one end to the other."""
    model = untrained(config)
    with torch.no_grad():
        for value in model.policy.parameters():
            value.copy_(torch.randn(value.shape, generator=torch.Generator().manual_seed(1)))
    return model


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Saved:
    """Return a model of a kind and the folder that it was saved to, made once."""

    @cache
    def make(kind: str) -> tuple[Any, Path]:
        config, folder = small_config(kind), tmp_path_factory.mktemp(kind) / "agent"
        model = model_of(config)
        save_agent(folder, model, config, {"seed": 3, "steps": 0})
        return model, folder

    return make


@pytest.fixture(scope="module")
def swimmer_agent(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of an agent for scene swimmer as it ships."""
    config = TrainingConfig.from_dict({"name": "nine", "members": 2, "ppo": {"minibatch": 256}})
    folder = tmp_path_factory.mktemp("nine") / "agent"
    save_agent(folder, model_of(config), config, {})
    return folder


@pytest.fixture
def copied(saved: Saved, tmp_path: Path) -> Path:
    """Return a copy of an agent's folder, to be spoiled."""
    return Path(shutil.copytree(saved("ppo")[1], tmp_path / "agent"))


def observations(model: Any, rows: int) -> np.ndarray:
    numbers = np.random.default_rng(5).normal(size=(rows, *model.observation_space.shape))
    return numbers.astype(np.float32)


#: In place of a value: the field is not there.
MISSING = object()
REQUIRED = ("name", "algorithm", "task", "scene", "network", "observation", "format_version")


def describe(folder: Path, **changes: Any) -> None:
    """Change what `agent.json` says."""
    path = folder / "agent.json"
    data = {**json.loads(path.read_text()), **changes}
    path.write_text(json.dumps({name: one for name, one in data.items() if one is not MISSING}))


def rezip(folder: Path, changes: dict[str, bytes], compression: int = zipfile.ZIP_STORED) -> Path:
    """Replace members of `model.zip`."""
    path = folder / "model.zip"
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, content in {**members, **changes}.items():
            archive.writestr(name, content)
    return path


# ---- the same actions again --------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_a_loaded_agent_acts_like_the_model_that_was_saved(kind, saved):
    model, folder = saved(kind)
    agent = load_agent(folder)
    batch = observations(model, 50)
    actions, state = agent.predict(batch)
    assert (actions == model.predict(batch, deterministic=True)[0]).all()
    assert actions.shape == (50, 2) and np.abs(actions).max() <= 1.0
    assert actions.std() > 0.1, "all actions are the same"
    assert state is None
    for row in batch[:5]:
        one, state = agent.predict(row, "a state")
        assert (one == model.predict(row, deterministic=True)[0]).all()
        assert one.shape == (2,) and state == "a state"
    if kind == "ppo":  # the file is one that stable-baselines3 reads itself
        loaded = stable_baselines3.PPO.load(folder / "model.zip", device="cpu")
        assert (loaded.predict(batch, deterministic=True)[0] == actions).all()
    # Double precision and lists are accepted as well.
    assert (agent.predict(batch.astype(np.float64).tolist())[0] == actions).all()
    # Exploration is there on request.
    loud, _ = agent.predict(batch, deterministic=False)
    assert (loud != actions).any() and np.abs(loud).max() <= 1.0


#: Plays where some packages are not installed; its arguments are their names and a folder's.
PLAY_WITHOUT = """
import sys
import numpy as np
sys.modules.update(dict.fromkeys(sys.argv[1].split(",")))
from swim_agents import load_policy, play_episode
from swim_env import SwimEnv, SwimTargetEnv
for name in ("ppo_forward", "sac_forward", "ppo_target"):
    agent = load_policy(name)
    size = 22 if "target" in name else 21
    batch = np.random.default_rng(5).normal(size=(50, size)).astype(np.float32)
    np.save(f"{sys.argv[2]}/{name}.npy", agent.predict(batch)[0])
    env = (SwimTargetEnv if "target" in name else SwimEnv)("swimmer", max_episode_steps=3)
    assert play_episode(env, agent, seed=0, deterministic=False).truncated
print(sys.modules.keys() & {"stable_baselines3.common"})
"""


def test_shipped_agents_play_with_torch_alone_as_with_stable_baselines3(tmp_path):
    done = run_python("-W", "error", "-c", PLAY_WITHOUT, "stable_baselines3,tensorboard", tmp_path)
    assert done.code == 0 and done.out == "set()\n", done.err
    for name in ("ppo_forward", "sac_forward", "ppo_target"):
        kind = stable_baselines3.SAC if "sac" in name else stable_baselines3.PPO
        model = kind.load(
            PRETRAINED_FOLDER / name / "model.zip",
            device="cpu",
            custom_objects={"replay_buffer_class": None},
        )
        actions = np.load(tmp_path / f"{name}.npy")
        raw = model.predict(observations(model, 50), deterministic=True)[0]
        expected = Smoothing(load_scene("swimmer"), 0.15)(raw)
        assert (actions == expected).all() and actions.dtype == expected.dtype


@pytest.mark.parametrize(
    ("lacking", "arguments", "message"),
    [
        ("torch", "replay --scene swimmer --env --policy ppo_forward", "playing a trained agent"),
        ("torch", "train demo", "training needs stable-baselines3"),
        ("stable_baselines3", "train demo", "training needs stable-baselines3"),
        (
            "stable_baselines3",
            "compare --policies MODEL --trust",
            "a model file without agent.json",
        ),
    ],
)
def test_what_is_missing_is_said_for_what_is_done(lacking, arguments, message, saved, tmp_path):
    model = shutil.copy(saved("ppo")[1] / "model.zip", tmp_path / "bare.zip")
    code = (
        f"import sys; sys.modules.update({{{lacking!r}: None}}); "
        "from swim_agents.commands.main import main; sys.exit(main())"
    )
    given = arguments.replace("MODEL", str(model)).split()
    done = run_python("-c", code, *given, cwd=tmp_path)
    assert done.code == 2 and done.err.count("\n") == 1 and message in done.err, done.err
    assert ("training" in message) == ("training" in done.err)


#: Runs a command where a package cannot be found; the package is the first argument.
RUN_WITHOUT = """
import sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == lacking:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
lacking = sys.argv.pop(1)
sys.meta_path.insert(0, Finder())
from swim_agents.commands.main import main
sys.exit(main())
"""
NEEDS = (
    ("matplotlib", "view", "replay --scene paper_iv --output x"),
    ("matplotlib", "view", "compare --policies zero --output x"),
    ("matplotlib", "view", "tune --output x --plot y.png"),
    ("rerun", "view", "replay --scene paper_iv --record x"),
    ("rerun", "view", "compare --policies zero --record x"),
    ("rerun", "view", "train demo --record x"),
    ("pyarrow", "view", "visualise --scene paper_iv"),
    ("PIL", "view", "visualise --scene paper_iv --no-flow --picture x.png"),
    ("PIL", "view", "replay --scene paper_iv --env --record-video x"),
    ("moviepy", "view", "replay --scene paper_iv --env --record-video x"),
    ("tensorboard", "train", "train demo"),
)


@pytest.mark.parametrize(("lacking", "extra", "arguments"), NEEDS)
def test_a_command_says_which_extra_it_lacks_before_it_plays(lacking, extra, arguments, tmp_path):
    done = run_python("-c", RUN_WITHOUT, lacking, *arguments.split(), cwd=tmp_path)
    assert done.code == 2 and done.out == ""
    line = done.err.rstrip("\n")
    assert_one_line(
        line, "error: ", f"install the extra '{extra}' (pip install 'swim-env[{extra}]'"
    )
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_the_description_says_what_the_agent_is(saved):
    _, folder = saved("target")
    config = small_config("target")
    about = json.loads((folder / "agent.json").read_text())
    assert load_agent(folder).description == about
    assert load_agent(folder).name == "small_target"
    assert about["scene"] == config.scene.to_dict()
    assert about["environment"] == {"effort_weight": 0.1}
    assert about["observation"] == {"layout": 3, "size": 10}
    assert about["training"] == {"seed": 3, "steps": 0}
    assert sorted(contents(folder)) == ["agent.json", "model.zip"]


@pytest.mark.parametrize("kind", ["ppo", "target", "sac"])
def test_the_agent_of_a_run_plays_what_the_runs_evaluation_played(kind, tmp_path):
    config = small_config(kind, steps=128)
    record = train(config, tmp_path, 3, threads=1)
    agent = load_policy(tmp_path / "final_agent", config.scene, task=config.task)
    first = config.evaluation.seed
    env = make_batch(config, 2, 1, AutoresetMode.NEXT_STEP)
    rollouts = play_episodes(env, agent, [first, first + 1])
    reached = [one.net_displacement for one in rollouts]
    assert float(np.median(reached)) == record["last"]["net_displacement_median"]
    assert min(reached) == record["last"]["net_displacement_min"]


@pytest.mark.parametrize("shape", [(), (8,), (2, 10), (2, 2, 9), (0,)])
def test_an_observation_of_another_shape_is_refused(shape, saved):
    agent = load_agent(saved("ppo")[1])
    with refuses(OptionError, "observation must have shape (9,) or (M, 9)", f"got {shape}"):
        agent.predict(np.zeros(shape))


# ---- no code is run ----------------------------------------------------------------------------


def test_an_agent_is_loaded_without_unpickling_what_lies_beside_its_weights(
    copied, tmp_path, saved
):
    target = tmp_path / "touched"
    bomb = base64.b64encode(pickle.dumps(Bomb(target))).decode()
    data = json.dumps({"policy_class": {":type:": "x", ":serialized:": bomb}}).encode()
    path = rezip(copied, {"data": data})
    model, _ = saved("ppo")
    row = observations(model, 1)
    expected = model.predict(row, deterministic=True)[0]
    assert (load_agent(copied).predict(row)[0] == expected).all()
    for name in (copied, path):
        assert (load_policy(name, small_config().scene).predict(row)[0] == expected).all()
    assert not target.exists()
    # Not even a bare file is unpickled unasked.
    bare = shutil.copy(path, tmp_path / "bare.zip")
    with refuses(AgentError):
        load_policy(bare, small_config().scene)
    assert not target.exists()
    with pytest.raises(AgentError):
        load_policy(bare, small_config().scene, trust=True)
    assert target.exists(), "the bomb would not have gone off"


@pytest.mark.parametrize("form", ["pickle", "torch", "old torch"])
def test_weights_that_are_a_malicious_pickle_are_refused_and_not_run(form, copied, tmp_path):
    target, file = tmp_path / "touched", io.BytesIO()
    bomb = {"log_std": Bomb(target)}
    if form == "pickle":
        file.write(pickle.dumps(bomb, protocol=2))
    else:
        torch.save(bomb, file, _use_new_zipfile_serialization=form == "torch")
    rezip(copied, {"policy.pth": file.getvalue()})
    with refuses(AgentError, "model is damaged"):
        load_agent(copied)
    assert not target.exists()
    file.seek(0)
    pickle.load(file) if form == "pickle" else torch.load(file, weights_only=False)
    assert target.exists(), "the bomb would not have gone off"


# ---- damaged and foreign files -----------------------------------------------------------------


@pytest.mark.parametrize("compression", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_a_damaged_model_is_never_more_than_one_clear_error(compression, copied):
    path = rezip(copied, {}, compression)
    assert load_agent(copied).name == "small_ppo"
    assert_damage_is_one_clear_error(path, lambda: load_agent(copied), AgentError, 200)


@pytest.mark.parametrize("name", ["agent.json", "model.zip"])
def test_a_missing_file_is_named(name, copied):
    (copied / name).unlink()
    with refuses(AgentError, f"no agent there: {name} is missing ({copied})"):
        load_agent(copied)


@pytest.mark.parametrize("content", ["{", "[" * 100_000, "\udcff", "[]"])
def test_a_description_that_is_none_is_one_clear_error(content, copied):
    (copied / "agent.json").write_bytes(content.encode("utf-8", "surrogateescape"))
    with refuses(AgentError, "agent.json", str(copied)):
        load_agent(copied)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"format_version": 2}, "must be of format version 1, got 2"),
        ({"observation": {"layout": 2, "size": 9}}, "observes layout 2 with 9 numbers, this"),
        ({"observation": {"layout": 3, "size": 8}}, "observes layout 3 with 8 numbers, this"),
        ({"observation": []}, "agent.json"),
        ({"task": "target"}, "gives layout 3 with 10"),
        ({"task": "dance"}, "agent.json does not describe an agent"),
        ({"task": ["forward"]}, "agent.json does not describe an agent"),
        ({"algorithm": "DQN"}, "algorithm must be one of PPO, SAC, got 'DQN'"),
        ({"algorithm": "SAC"}, "weights in model.zip are not those of the agent"),
        ({"state_dependent_noise": False}, "weights in model.zip are not those of the agent"),
        ({"network": {"layers": [9]}}, "weights in model.zip are not those of the agent"),
        ({"network": {"layers": 8}}, "network.layers must be a list"),
        ({"network": {"layer": [8]}}, "agent.json does not describe an agent"),
        ({"network": [8]}, "agent.json does not describe an agent"),
        ({"scene": 3}, "scene must be a mapping"),
        ({"scene": {"beam": {"elements": "x"}}}, "beam.elements must be an integer"),
        ({"name": "two\nlines"}, "name must be text on one line"),
        *(({name: MISSING}, name.replace("_", " ")) for name in REQUIRED),
    ],
)
def test_a_description_that_does_not_fit_is_one_clear_error(changes, problem, copied):
    describe(copied, **changes)
    with refuses(AgentError, problem, str(copied)):
        load_agent(copied)


def test_weights_that_are_none_are_refused(copied):
    for content in ([1, 2], torch.zeros(3), {"log_std": 3}, {3: torch.zeros(1)}):
        file = io.BytesIO()
        torch.save(content, file)
        rezip(copied, {"policy.pth": file.getvalue()})
        with refuses(AgentError, "weights in model.zip are not those"):
            load_agent(copied)


# ---- what an agent may play --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "field", "there", "here"),
    [
        (["beam.elements=8"], "beam.elements", "8", "9"),
        (["beam.bending_stiffness=4.0"], "beam.bending_stiffness", "4.0", "5.0"),
        (["actuation.torque_limit=2.0"], "torque_limit", "2.0", "1.0"),
        (["actuation.active_until=0.5"], "actuation.active_until", "0.5", "1.0"),
        (["episode.control_interval=0.04"], "episode.control_interval", "0.04", "0.02"),
        (["fluid.density=20.0"], "fluid.density", "20.0", "10.0"),
        (["fluid.model=none"], "fluid.model", "none", "panels"),
        (["axial_added_mass=true"], "axial_added_mass", "{}", "None"),
        (["cross_flow_drag={}"], "cross_flow_drag", "{'coefficient': 1.0}", "None"),
        (["stream.velocity=[0.1, 0.0]"], "stream", "{'velocity': [0.1, 0.0]}", "None"),
        # The first difference is named and the others are counted.
        (["fluid.density=20", "beam.elements=8"], "beam.elements", "8", "9 in training (and 1"),
    ],
)
def test_another_body_fluid_or_control_is_refused_and_the_field_named(
    changes, field, there, here, swimmer_agent
):
    scene = load_scene("swimmer", [*changes, "name=other"])
    with refuses(
        AgentError,
        "agent nine was trained on scene swimmer and cannot play scene other",
        f"{field} is {there}, it was {here}",
    ):
        load_policy(swimmer_agent, scene)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("paper_i", []),
        ("swimmer", ["damping=null", "integrator.time_step=0.01", "integrator.tolerance=1e-8"]),
        ("swimmer", ["fluid.panels_per_element=6", "actuation.amplitude=0.5", "description=x"]),
        ("swimmer", ["episode.duration=5", "episode.bend_noise=0.1", "initial.heading=1.0"]),
    ],
)
def test_another_solver_damping_or_start_is_no_obstacle(name, changes, swimmer_agent):
    agent = load_policy(swimmer_agent, load_scene(name, changes), task="forward")
    assert agent.predict(np.zeros(21))[0].shape == (8,)


def test_another_task_is_refused(saved):
    for kind, own, other in (("ppo", "forward", "target"), ("target", "target", "forward")):
        scene, (model, folder) = small_config(kind).scene, saved(kind)
        with refuses(AgentError, f"agent small_{kind} was trained for task {own}, not for {other}"):
            load_policy(folder, scene, task=other)
        assert load_policy(folder, scene, task=own).predict(observations(model, 1))


# ---- by path -----------------------------------------------------------------------------------


def test_an_agent_replaces_another_and_is_found_by_folder_run_and_file(tmp_path):
    config, place = small_config(), tmp_path / "agent"
    best, last = model_of(config), model_of(config)
    with torch.no_grad():
        last.policy.action_net.bias.add_(0.5)
    row = observations(best, 3)
    expected, others = (model.predict(row, deterministic=True)[0] for model in (best, last))
    assert (expected != others).any()
    for name, model, seed in (("agent", last, 1), ("final_agent", last, 1), ("agent", best, 2)):
        save_agent(tmp_path / name, model, config, {"seed": seed})
    assert load_agent(place).description["training"]["seed"] == 2
    assert hidden(tmp_path) == []
    for path in (tmp_path, place, place / "model.zip", str(tmp_path), str(place / "model.zip")):
        assert (load_policy(path, config.scene).predict(row)[0] == expected).all()
    found = load_policy(tmp_path / "final_agent", config.scene)
    assert (found.predict(row)[0] == others).all()


@pytest.mark.parametrize("kind", KINDS)
def test_a_bare_model_is_read_only_if_it_is_trusted(kind, saved, tmp_path):
    model, folder = saved(kind)
    scene = small_config(kind).scene
    for name in ("model.zip", "mine.zip"):
        path = Path(shutil.copy(folder / "model.zip", tmp_path / name))
        with refuses(AgentError, f"{path} has no agent.json beside it", "trust=True"):
            load_policy(path, scene)
        agent = load_policy(path, scene, trust=True)
        row = observations(model, 4)
        assert (agent.predict(row)[0] == model.predict(row, deterministic=True)[0]).all()
    task = small_config(kind).task
    assert load_bare_model(path, scene, True).description["task"] == task
    with refuses(
        AgentError,
        f"observes ({9 + (task == 'target')},) and acts in (2,) numbers",
        "scene swimmer has (21,) (or (22,) with a target) and (8,)",
    ):
        load_policy(path, "swimmer", trust=True)
    other = "target" if task == "forward" else "forward"
    with refuses(AgentError, f"trained for task {task}, not for {other}"):
        load_policy(path, scene, task=other, trust=True)


class OneActionMore(gymnasium.Env):
    """What a swimmer of three elements observes, and another number of joints."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (9,))
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (3,))


def test_what_is_no_agent_is_refused(saved, tmp_path):
    stable_baselines3.PPO("MlpPolicy", OneActionMore(), device="cpu").save(tmp_path / "more.zip")
    with refuses(AgentError, "observes (9,) and acts in (3,) numbers"):
        load_policy(tmp_path / "more.zip", small_config().scene, trust=True)
    with refuses(AgentError, "agent.json is missing"):
        load_policy(tmp_path)
    with refuses(AgentError, "no such model file"):
        load_policy(tmp_path / "nothing.zip")
    whole = (saved("ppo")[1] / "model.zip").read_bytes()
    for content in (b"junk", b"", whole[: len(whole) // 2]):
        (tmp_path / "mine.zip").write_bytes(content)
        with refuses(AgentError, "the model is damaged or cut short, or neither PPO nor SAC"):
            load_policy(tmp_path / "mine.zip", trust=True)
    with refuses(OptionError, "unknown policy 'tuned_wav' (nearest: tuned_wave)"):
        load_policy("tuned_wav")


# ---- the training script -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["ppo_forwrd"], "no such configuration: ppo_forwrd (nearest: ppo_forward)"),
        (["ppo_forward", "--set", "step=3"], "unknown field step (nearest: steps)"),
        (["ppo_forward", "--seeds", "1", "2", "1"], "--seeds must differ, got 1 2 1"),
        (["ppo_forward", "--seeds", "-1"], "seed must be a whole number from 0"),
        (["ppo_forward", "--device", "gpu"], "cannot train on device 'gpu'"),
        (["ppo_forward", "--threads", "0"], "--threads must be at least 1, got 0"),
    ],
)
def test_bad_input_of_the_training_script_is_one_line_and_exit_code_2(
    arguments, problem, tmp_path, capsys
):
    output = tmp_path / "runs"
    call_script(capsys, "train", *arguments, "--output", output).assert_refused(problem)
    assert not output.exists()


def test_the_training_script_ends_with_its_runs_as_a_table_or_as_json(tmp_path, capsys):
    path = tmp_path / "small.yaml"
    small_config(steps=64).save(path)
    arguments = (path, "--seeds", "3", "4", "--output", tmp_path / "runs")
    table = call_script(capsys, "train", *arguments).out.splitlines()
    assert [line.split()[:2] for line in table[1:]] == [["3", "64"], ["4", "64"]]
    data = call_script(capsys, "train", *arguments, "--resume", "--json").figures()
    assert [one["seed"] for one in data["runs"]] == [3, 4]
    for one in data["runs"]:
        assert one["finished"] and one["last"]["steps"] == 64
        assert load_agent(Path(one["folder"]) / "agent").name == "small_ppo"
    call_script(capsys, "train", *arguments).assert_refused("the folder holds a run (finished)")


def test_a_folder_of_runs_is_its_only_agent(tmp_path):
    shutil.copytree(PRETRAINED_FOLDER / "ppo_forward", tmp_path / "seed_0" / "agent")
    found = load_policy(tmp_path)
    seen = np.zeros(21, dtype=np.float32)
    expected = load_policy("ppo_forward").predict(seen, deterministic=True)[0]
    np.testing.assert_array_equal(found.predict(seen, deterministic=True)[0], expected)
    shutil.copytree(tmp_path / "seed_0", tmp_path / "seed_1")
    with refuses(OptionError, "there are several agents in", str(tmp_path / "seed_1")):
        load_policy(tmp_path)
