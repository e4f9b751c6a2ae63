"""The batch as a VecEnv of stable-baselines3: the same as its own of single environments."""

import importlib.util
import pickle
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    VecCheckNan,
    VecEnv,
    VecFrameStack,
    VecMonitor,
    VecNormalize,
)
from swim_agents.vec_env import SwimVecEnv, make_swim_vec_env

from swim_env import (
    OptionError,
    SceneError,
    SwimEnv,
    SwimError,
    SwimTargetEnv,
    SwimTargetVectorEnv,
    SwimVectorEnv,
)
from tests.support import FORWARD, ROOT, TARGET, assert_same, refuses, uniform

JOINTS = 4
SMALL = ["beam.elements=5", "episode.duration=0.2"]

# Ten actions at most; the members end apart from each other. Torques that break the body, which
# may happen in the very action in which the time is up, and pushes that carry it to its target.
BREAKING = {"overrides": [*SMALL, "episode.bend_noise=0.4", "actuation.torque_limit=10"]}
DRIFTING = {
    "overrides": [*SMALL, "episode.velocity_noise=2.0"],
    "target_distance": (0.105, 0.3),
    "target_bearing": 3.1,
    "effort_weight": 0.3,
}
TASKS = {"breaking": (FORWARD, SwimEnv, BREAKING), "drifting": (TARGET, SwimTargetEnv, DRIFTING)}


def small(num_envs: int = 3, seed: int | None = 0, **kwargs) -> SwimVecEnv:
    return make_swim_vec_env(num_envs=num_envs, seed=seed, **{"overrides": SMALL, **kwargs})


def pair(name: str, num_envs: int) -> tuple[SwimVecEnv, DummyVecEnv]:
    """Return the batch and a DummyVecEnv of single environments, unseeded."""
    env_id, single, kwargs = TASKS[name]
    return (
        make_swim_vec_env(env_id, num_envs, **kwargs),
        DummyVecEnv([lambda: single(**kwargs)] * num_envs),
    )


def actions_for(venv: VecEnv, steps: int, seed: int = 0) -> np.ndarray:
    return uniform(steps, venv.num_envs, *venv.action_space.shape, seed=seed).astype(np.float32)


@pytest.mark.parametrize("name", TASKS)
def test_it_gives_what_single_environments_give_bit_for_bit(name):
    """Over episodes of many lengths: seeded, then on from there, with options and without."""
    ours, theirs = pair(name, 4)
    ends = set()
    each = [{}, {"noise": 0.0}, {"heading": 0.3}, {"noise": 0.0}]
    for number, options in enumerate([None, {"noise": 0.5}, each, None]):
        for venv in (ours, theirs):
            if number == 0:
                assert venv.seed(11) == [11, 12, 13, 14]
            if options is not None:
                venv.set_options(options)
        assert_same(ours.reset(), theirs.reset(), f"reset {number}")
        assert_same(ours.reset_infos, theirs.reset_infos, f"reset {number}")
        length = np.zeros(4, dtype=int)
        for step, actions in enumerate(actions_for(ours, 45 if number < 3 else 15, number)):
            where = f"reset {number}, step {step}"
            one, other = ours.step(actions), theirs.step(actions)
            assert_same(tuple(one), tuple(other), where)
            assert_same(ours.reset_infos, theirs.reset_infos, where)
            length += 1
            for member in np.flatnonzero(one[2]):
                info = one[3][member]
                ends.add((length[member], info["termination_reason"], info["TimeLimit.truncated"]))
                length[member] = 0
    assert len({steps for steps, _, _ in ends}) >= 4, f"episodes too much alike: {ends}"
    assert (10, "", True) in ends, ends
    assert any(reason and not truncated for _, reason, truncated in ends), ends
    if name == "breaking":
        both = [end for end in ends if end[0] == 10 and end[1]]
        assert both, f"nobody broke in the last action: {ends}"
        assert not any(truncated for _, _, truncated in both), both


def test_a_first_reset_takes_options_for_each_member():
    options = [{"target": (0.3, 0.1 * i), "noise": 0.0} if i else {} for i in range(4)]
    ours, theirs = pair("drifting", 4)
    for venv in (ours, theirs):
        venv.seed(3)
        venv.set_options(options)
    assert_same(ours.reset(), theirs.reset(), "observations")
    assert_same(ours.reset_infos, theirs.reset_infos, "reset_infos")
    assert ours.reset_infos[2]["target"].tolist() == [0.3, 0.2]


def test_a_refused_reset_changes_nothing_and_keeps_what_waits():
    venv = small()
    venv.reset()
    venv.seed(5)
    venv.set_options([{"noise": 0.0}, {}, {"noize": 1.0}])
    with refuses(OptionError, "unknown option 'noize'", leaving=venv.env):
        venv.reset()
    with refuses(OptionError, "one mapping or 3 of them, got 2"):
        venv.set_options([{}, {}])
    venv.set_options({"reset_mask": np.ones(3, dtype=bool)})
    with refuses(OptionError, "reset_mask", leaving=venv.env):
        venv.reset()
    venv.set_options()
    assert_same(venv.reset(), small(seed=5).reset(), "the seed that waited")


def test_arguments_reach_the_batch_which_must_restart_in_the_same_step():
    for mode in ("NextStep", "Disabled"):
        with refuses(OptionError, f"autoreset_mode='SameStep', not '{mode}'"):
            make_swim_vec_env(num_envs=2, autoreset_mode=mode)
    with refuses(OptionError, "got SyncVectorEnv"):
        SwimVecEnv(gymnasium.make_vec("CartPole-v1", 2, vectorization_mode="sync"))
    with refuses(OptionError, "num_envs must be at least 1"):
        make_swim_vec_env(num_envs=0)
    with pytest.raises(SceneError):
        make_swim_vec_env(scene="no such scene")
    given = {"overrides": SMALL, "max_episode_steps": 3, "num_threads": 1}
    venv, other = (make_swim_vec_env(TARGET, count, seed=5, **given) for count in (2, 3))
    assert isinstance(venv.env, SwimTargetVectorEnv)
    assert (venv.num_envs, venv.env.num_threads, venv.env.episodes.limit) == (2, 1, 3)
    assert venv.spec.id == TARGET
    assert (venv.action_space.sample() == other.action_space.sample()).all(), "not seeded"


def test_misuse_is_reported():
    venv = small()
    with refuses(SwimError, "step_async before step_wait"):
        venv.step_wait()
    with pytest.raises(gymnasium.error.ResetNeeded):
        venv.step(np.zeros((3, JOINTS)))
    venv.reset()
    venv.step_async(np.zeros((3, JOINTS)))
    venv.reset()
    with refuses(SwimError, "step_async before step_wait"):
        venv.step_wait()
    venv.close()
    venv.close()


def test_results_stay_as_they_were_given():
    """What was returned is the caller's: later steps do not change it, nor it them."""
    ours, theirs = small(), small()
    kept = [ours.reset()]
    copies = [kept[0].copy()]
    theirs.reset()
    for actions in actions_for(ours, 12):
        one, other = ours.step(actions), theirs.step(actions)
        assert_same(one[0], other[0], "after the writing")
        kept += [*one[:3], *(info["position"] for info in one[3])]
        copies += [array.copy() for array in kept[len(copies) :]]
        for info in other[3]:
            info["progress"] = 1e9
        ends = [info["terminal_observation"] for info in other[3] if "terminal_observation" in info]
        for array in (*other[:2], *ends, *(info["position"] for info in other[3])):
            array[:] = 1e9
    assert_same(kept, copies, "results")


def test_attributes_are_those_of_single_environments():
    ours, theirs = pair("drifting", 3)
    for venv in (ours, theirs):
        venv.seed(2)
        venv.reset()
        venv.step(actions_for(venv, 1)[0])
    for name in ("coordinates", "velocity", "torques", "goal"):
        for members in (None, [2, 0], -1):
            assert_same(ours.get_attr(name, members), theirs.get_attr(name, members), name)
    for name in ("scene", "metadata", "action_space", "observation_space", "render_mode"):
        for members in (None, [2, 0]):
            assert ours.get_attr(name, members) == theirs.get_attr(name, members), name
    assert [task.identity for task in ours.get_attr("task", 1)] == [ours.env.task.identity]
    assert [spec.id for spec in ours.get_attr("spec")] == [TARGET] * 3
    for name in ("num_envs", "action_space", "observation_space", "render_mode", "metadata"):
        assert getattr(ours, name) == getattr(theirs, name), name
    assert ours.env_is_wrapped(Monitor) == [False] * 3
    assert ours.env_is_wrapped(Monitor, indices=[1]) == [False]
    assert ours.has_attr("goal") and not ours.has_attr("compute_reward")
    assert not hasattr(VecMonitor(ours), "no_such_name")
    for name in ("no_such_name", "episodes", "num_envs", "_randoms", "step"):
        with refuses(AttributeError, f"no attribute {name!r}; it has", "coordinates"):
            ours.get_attr(name)
    with pytest.raises(IndexError):
        ours.get_attr("scene", 3)


def test_what_members_share_is_set_for_all_or_not_at_all():
    venv = small()
    with refuses(OptionError, "cannot be set for 2 of 3"):
        venv.set_attr("render_mode", "rgb_array", indices=[0, 1])
    assert venv.get_attr("render_mode") == [None] * 3
    venv.set_attr("render_mode", "rgb_array", indices=[2, 0, 1])
    assert venv.get_attr("render_mode") == ["rgb_array"] * 3
    assert venv.render_mode == "rgb_array"
    with refuses(OptionError, "unknown render_mode"):
        venv.set_attr("render_mode", "rgb_aray")
    for name in ("scene", "task", "goal", "snapshot", "action_space", "no_such_name"):
        with refuses(AttributeError, f"{name} of a batch cannot be set"):
            venv.set_attr(name, None)


def test_a_members_snapshot_continues_in_a_single_environment():
    venv = small(seed=4)
    with refuses(SwimError, "call reset first"):
        venv.env_method("snapshot")
    venv.reset()
    actions = actions_for(venv, 25)
    for now in actions[:7]:
        venv.step(now)
    [snapshot] = venv.env_method("snapshot", indices=1)
    assert len(venv.env_method("snapshot")) == 3
    assert len(venv.get_attr("snapshot")[2]().randoms) == 1
    single = DummyVecEnv([lambda: SwimEnv(overrides=SMALL)])
    single.reset()
    single.envs[0].restore(snapshot)
    for now in actions[7:]:
        observations, rewards, dones, infos = venv.step(now)
        alone = single.step(now[1:2])
        assert_same((observations[1:2], rewards[1:2], dones[1:2], infos[1:2]), alone)
    for name in ("reset", "step", "restore", "close"):
        with refuses(AttributeError, f"whole batch, as SwimVecEnv.batch.{name}"):
            venv.env_method(name)
    with refuses(AttributeError, "no method 'compute_reward' of its own"):
        venv.env_method("compute_reward")
    with refuses(TypeError, "takes no arguments"):
        venv.env_method("snapshot", 1)


class Drawn(SwimVectorEnv):
    """A batch that draws its members' numbers."""

    def render(self):
        return tuple(np.full((2, 3, 3), member, dtype=np.uint8) for member in range(self.num_envs))


def test_frames_are_tiled_into_one():
    venv = SwimVecEnv(Drawn(3, overrides=SMALL, render_mode="rgb_array", autoreset_mode="SameStep"))
    venv.reset()
    assert [int(image[0, 0, 0]) for image in venv.get_images()] == [0, 1, 2]
    assert [int(image[0, 0, 0]) for image in venv.env_method("render", indices=[2, 1])] == [2, 1]
    for wrapped in (venv, VecMonitor(venv)):
        frame = wrapped.render()
        assert frame.shape == (4, 6, 3)
        assert frame[::2, ::3, 0].tolist() == [[0, 1], [2, 0]]
    without = small()
    with pytest.warns(UserWarning, match="rgb_array"):
        assert without.get_images() == [None] * 3
    with pytest.warns(UserWarning, match="no `render_mode`"):
        assert without.render() is None


@pytest.mark.parametrize("env_id", [FORWARD, TARGET])
def test_ppo_learns_on_it_in_wrappers_and_is_evaluated(env_id, tmp_path):
    log, statistics = str(tmp_path / "log"), str(tmp_path / "statistics.pkl")
    monitored = VecMonitor(make_swim_vec_env(env_id, 8, overrides=SMALL), log)
    stacked = VecFrameStack(VecCheckNan(monitored, raise_exception=True), 2)
    venv = VecNormalize(stacked)
    model = PPO("MlpPolicy", venv, n_steps=16, batch_size=64, n_epochs=2, seed=0, device="cpu")
    before = [value.clone() for value in model.policy.parameters()]
    model.learn(512)
    assert model.num_timesteps == 512
    after = list(model.policy.parameters())
    assert all(value.isfinite().all() for value in after)
    assert any(not one.equal(other) for one, other in zip(before, after, strict=True))
    assert len(model.ep_info_buffer) == 8 * (64 // 10)
    assert env_id in Path(log + ".monitor.csv").read_text().splitlines()[0]
    returns, lengths = evaluate_policy(model, venv, 6, return_episode_rewards=True)
    assert lengths == [10] * 6
    assert np.isfinite(returns).all()
    venv.save(statistics)
    again = pickle.loads(pickle.dumps(venv))
    for copy in (VecNormalize.load(statistics, stacked), again):
        assert_same(copy.obs_rms.mean, venv.obs_rms.mean, "mean of observations")
        assert_same(copy.ret_rms.var, venv.ret_rms.var, "variance of returns")
    venv.close()


def test_without_stable_baselines3_the_extra_is_named(monkeypatch):
    for name in list(sys.modules):
        if name.split(".")[0] == "stable_baselines3":
            monkeypatch.setitem(sys.modules, name, None)
    path = ROOT / "agents" / "swim_agents" / "vec_env.py"
    spec = importlib.util.spec_from_file_location("vec_env_alone", path)
    module = importlib.util.module_from_spec(spec)
    with pytest.raises(SwimError, match=r"'train' \(pip install 'swim-env\[train\]'\)") as caught:
        spec.loader.exec_module(module)
    assert isinstance(caught.value, ImportError)
