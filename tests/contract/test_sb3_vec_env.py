"""The batch as a VecEnv of stable-baselines3: the same as its own of single environments."""

from __future__ import annotations

import importlib.util
import pickle
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO, SAC
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
from tests.support import FORWARD, TARGET, assert_same, uniform

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
    """Return the batch and its like of single environments, unseeded."""
    env_id, single, kwargs = TASKS[name]
    return (
        make_swim_vec_env(env_id, num_envs, **kwargs),
        DummyVecEnv([lambda: single(**kwargs)] * num_envs),
    )


def actions_for(venv: VecEnv, steps: int, seed: int = 0) -> np.ndarray:
    return uniform(steps, venv.num_envs, *venv.action_space.shape, seed=seed).astype(np.float32)


@pytest.mark.parametrize("name", TASKS)
def test_it_gives_what_single_environments_give_bit_for_bit(name: str) -> None:
    """Over episodes of many lengths: seeded, then on from there, then with options."""
    ours, theirs = pair(name, 4)
    ends = set()
    each = [{}, {"noise": 0.0}, {"heading": 0.3}, {"noise": 0.0}]
    for number, options in enumerate([None, {"noise": 0.5}, each]):
        for venv in (ours, theirs):
            if number == 0:
                assert venv.seed(11) == [11, 12, 13, 14]
            if options is not None:
                venv.set_options(options)
        assert_same(ours.reset(), theirs.reset(), f"reset {number}")
        assert_same(ours.reset_infos, theirs.reset_infos, f"reset {number}")
        length = np.zeros(4, dtype=int)
        for step, actions in enumerate(actions_for(ours, 45, number)):
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


def test_a_first_reset_takes_options_for_each_member() -> None:
    options = [{"target": (0.3, 0.1 * i), "noise": 0.0} if i else {} for i in range(4)]
    ours, theirs = pair("drifting", 4)
    for venv in (ours, theirs):
        venv.seed(3)
        venv.set_options(options)
    assert_same(ours.reset(), theirs.reset(), "observations")
    assert_same(ours.reset_infos, theirs.reset_infos, "reset_infos")
    assert ours.reset_infos[2]["target"].tolist() == [0.3, 0.2]


def test_seeds_and_options_serve_one_reset() -> None:
    venv = small(seed=7)
    first = venv.reset()
    for member, row in enumerate(first):
        alone, _ = SwimEnv(overrides=SMALL).reset(seed=7 + member)
        assert_same(row, alone, f"member {member}")
    second = venv.reset()
    assert not np.array_equal(second, first), "the seeds were used again"
    venv.set_options({"noise": 0.0})
    still = venv.reset()
    assert np.array_equal(still[0], still[1]), "there is noise"
    noisy = venv.reset()
    assert not np.array_equal(noisy[0], noisy[1]), "the options were used again"
    venv.seed(7)
    assert_same(venv.reset(), first, "the same seed again")
    assert make_swim_vec_env(num_envs=3, seed=5).action_space.sample().tolist() == (
        make_swim_vec_env(num_envs=2, seed=5).action_space.sample().tolist()
    )


def test_a_refused_reset_changes_nothing_and_keeps_what_waits() -> None:
    venv = small()
    venv.reset()
    before = venv.env.snapshot().episodes.arrays
    venv.seed(5)
    venv.set_options([{"noise": 0.0}, {}, {"noize": 1.0}])
    with pytest.raises(OptionError, match="unknown option 'noize'"):
        venv.reset()
    after = venv.env.snapshot().episodes.arrays
    assert all(np.array_equal(before[name], after[name]) for name in before)
    with pytest.raises(OptionError, match="one mapping or 3 of them, got 2"):
        venv.set_options([{}, {}])
    venv.set_options({"reset_mask": np.ones(3, dtype=bool)})
    with pytest.raises(OptionError, match="reset_mask"):
        venv.reset()
    venv.set_options()
    assert_same(venv.reset(), small(seed=5).reset(), "the seed that waited")


def test_arguments_reach_the_batch_which_must_restart_in_the_same_step() -> None:
    for mode in ("NextStep", "Disabled"):
        with pytest.raises(OptionError, match=f"autoreset_mode='SameStep', not '{mode}'"):
            SwimVecEnv(SwimVectorEnv(2, autoreset_mode=mode))
    with pytest.raises(OptionError, match="autoreset_mode='SameStep'"):
        make_swim_vec_env(num_envs=2, autoreset_mode="NextStep")
    with pytest.raises(OptionError, match="got SyncVectorEnv"):
        SwimVecEnv(gymnasium.make_vec("CartPole-v1", 2, vectorization_mode="sync"))
    with pytest.raises(OptionError, match="num_envs must be at least 1"):
        make_swim_vec_env(num_envs=0)
    with pytest.raises(SceneError):
        make_swim_vec_env(scene="no such scene")
    venv = make_swim_vec_env(TARGET, 2, overrides=SMALL, max_episode_steps=3, num_threads=1)
    assert isinstance(venv.env, SwimTargetVectorEnv)
    assert (venv.num_envs, venv.env.num_threads, venv.env.episodes.limit) == (2, 1, 3)
    assert venv.spec.id == TARGET


def test_misuse_is_reported() -> None:
    venv = small()
    with pytest.raises(SwimError, match="step_async before step_wait"):
        venv.step_wait()
    with pytest.raises(gymnasium.error.ResetNeeded):
        venv.step(np.zeros((3, JOINTS)))
    venv.reset()
    venv.step_async(np.zeros((3, JOINTS)))
    venv.reset()
    with pytest.raises(SwimError, match="step_async before step_wait"):
        venv.step_wait()
    venv.close()
    venv.close()


def test_results_stay_as_they_were_given() -> None:
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
        other[1][:] = 1e9
        for info in other[3]:
            info["position"][:] = 1e9
            info["progress"] = 1e9
            info.get("terminal_observation", np.zeros(1))[:] = 1e9
        other[0][:] = 1e9
    for index, (array, copy) in enumerate(zip(kept, copies, strict=True)):
        assert_same(array, copy, f"result {index}")


def test_attributes_are_those_of_single_environments() -> None:
    ours, theirs = pair("drifting", 3)
    for venv in (ours, theirs):
        venv.seed(2)
        venv.reset()
        venv.step(actions_for(venv, 1)[0])
    for name in ("coordinates", "velocity", "torques", "goal"):
        values, expected = ours.get_attr(name), theirs.get_attr(name)
        for member in range(3):
            assert_same(values[member], expected[member], f"{name} of member {member}")
    for name in ("scene", "metadata", "action_space", "observation_space", "render_mode"):
        assert ours.get_attr(name) == theirs.get_attr(name), name
        assert ours.get_attr(name, [2, 0]) == theirs.get_attr(name, [2, 0]), name
    assert [task.identity for task in ours.get_attr("task", 1)] == [ours.env.task.identity]
    assert [spec.id for spec in ours.get_attr("spec")] == [TARGET] * 3
    assert_same(
        ours.get_attr("goal", -1)[0], theirs.get_attr("goal", -1)[0], "goal of the last member"
    )
    for name in ("num_envs", "action_space", "observation_space", "render_mode", "metadata"):
        assert getattr(ours, name) == getattr(theirs, name), name
    assert ours.env_is_wrapped(Monitor) == [False] * 3
    assert ours.env_is_wrapped(Monitor, indices=[1]) == [False]
    assert ours.has_attr("goal")
    assert not ours.has_attr("compute_reward")
    assert not hasattr(VecMonitor(ours), "no_such_name")
    for name in ("no_such_name", "episodes", "num_envs", "_randoms", "step"):
        with pytest.raises(AttributeError, match=f"no attribute {name!r}; it has .*coordinates"):
            ours.get_attr(name)
    with pytest.raises(IndexError):
        ours.get_attr("scene", 3)


def test_what_members_share_is_set_for_all_or_not_at_all() -> None:
    venv = small()
    with pytest.raises(OptionError, match="cannot be set for 2 of 3"):
        venv.set_attr("render_mode", "rgb_array", indices=[0, 1])
    assert venv.get_attr("render_mode") == [None] * 3
    venv.set_attr("render_mode", "rgb_array", indices=[2, 0, 1])
    assert venv.get_attr("render_mode") == ["rgb_array"] * 3
    assert venv.render_mode == "rgb_array"
    with pytest.raises(OptionError, match="unknown render_mode"):
        venv.set_attr("render_mode", "rgb_aray")
    for name in ("scene", "task", "goal", "snapshot", "action_space"):
        with pytest.raises(AttributeError, match=f"{name} of a batch cannot be set"):
            venv.set_attr(name, None)
    with pytest.raises(AttributeError, match="no attribute 'no_such_name'"):
        venv.set_attr("no_such_name", 1)


def test_a_members_snapshot_continues_in_a_single_environment() -> None:
    venv = small(seed=4)
    with pytest.raises(SwimError, match="call reset first"):
        venv.env_method("snapshot")
    venv.reset()
    actions = actions_for(venv, 25)
    for now in actions[:7]:
        venv.step(now)
    [snapshot] = venv.env_method("snapshot", indices=1)
    assert len(venv.env_method("snapshot")) == 3
    assert len(venv.get_attr("snapshot")[2]().episodes.randoms) == 1
    single = SwimEnv(overrides=SMALL)
    single.reset()
    single.restore(snapshot)
    for now in actions[7:]:
        observations, rewards, dones, infos = venv.step(now)
        observation, reward, terminated, truncated, info = single.step(now[1])
        if dones[1]:
            assert_same(infos[1]["terminal_observation"], observation, "at the end")
            observation, _ = single.reset()
        assert_same(observations[1], observation, "observation")
        assert rewards[1] == np.float32(reward)
        assert dones[1] == (terminated or truncated)
        assert infos[1]["time"] == info["time"]
    for name in ("reset", "step", "restore", "close"):
        with pytest.raises(AttributeError, match=f"whole batch, as SwimVecEnv.env.{name}"):
            venv.env_method(name)
    with pytest.raises(AttributeError, match="no method 'compute_reward' of its own"):
        venv.env_method("compute_reward")
    with pytest.raises(TypeError, match="takes no arguments"):
        venv.env_method("snapshot", 1)


class Drawn(SwimVectorEnv):
    """A batch that draws its members' numbers."""

    def render(self):
        return tuple(np.full((2, 3, 3), member, dtype=np.uint8) for member in range(self.num_envs))


def test_frames_are_tiled_into_one() -> None:
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


def test_rewards_sum_to_the_net_displacement_of_a_whole_episode() -> None:
    """In 20 s, although stable-baselines3 keeps rewards in half the precision."""
    swimmers = make_swim_vec_env(num_envs=3, seed=1)
    venv = VecMonitor(swimmers)
    venv.reset()
    scene = venv.get_attr("scene", 0)[0]
    heading = np.array(scene.episode.heading)
    start = [info["position"] for info in swimmers.reset_infos]
    actions = actions_for(venv, scene.actions_per_episode)
    time = scene.episode.control_interval * np.arange(len(actions))
    wave = 2.0 * np.pi * (time[:, None] - np.linspace(0.0, 1.0, actions.shape[2]))
    actions[:, 0] = np.sin(wave)
    actions[:, 1] = np.sin(2.0 * wave)
    totals = np.zeros(3)
    for now in actions:
        _, rewards, dones, infos = venv.step(now)
        totals += rewards
    assert dones.all()
    for member, info in enumerate(infos):
        assert info["time"] == pytest.approx(20.0)
        moved = float((info["position"] - start[member]) @ heading) / scene.beam.length
        assert totals[member] == pytest.approx(moved, abs=1e-5), f"member {member}"
        assert float(info["episode"]["r"]) == pytest.approx(moved, abs=1e-5), f"member {member}"
        assert info["episode"]["l"] == len(actions)
    assert np.abs(totals).max() > 0.02, f"nobody moved: {totals}"


def test_wrappers_of_stable_baselines3(tmp_path: Path) -> None:
    log, statistics = str(tmp_path / "log"), str(tmp_path / "statistics.pkl")
    checked = VecCheckNan(VecMonitor(small(seed=3), log), raise_exception=True)
    venv = VecNormalize(VecFrameStack(checked, 2))
    plain = small(seed=3)
    size = plain.observation_space.shape[0]
    venv.reset()
    assert_same(venv.get_original_obs()[:, size:], plain.reset(), "first observations")
    totals = np.zeros(3)
    for actions in actions_for(plain, 10):
        observations, _, dones, infos = venv.step(actions)
        expected, rewards, _, plain_infos = plain.step(actions)
        assert observations.shape == (3, 2 * size)
        assert_same(venv.get_original_obs()[:, size:], expected, "observations")
        assert_same(venv.get_original_reward(), rewards, "rewards")
        totals += rewards
    assert dones.all()
    for member, info in enumerate(infos):
        assert info["episode"]["r"] == pytest.approx(totals[member], abs=1e-6)
        last = venv.unnormalize_obs(info["terminal_observation"])[size:]
        assert last == pytest.approx(plain_infos[member]["terminal_observation"], abs=1e-5)
    assert FORWARD in Path(log + ".monitor.csv").read_text().splitlines()[0]

    venv.save(statistics)
    loaded = VecNormalize.load(statistics, VecFrameStack(small(seed=3), 2))
    again = pickle.loads(pickle.dumps(venv))
    for copy in (loaded, again):
        assert_same(copy.obs_rms.mean, venv.obs_rms.mean, "mean of observations")
        assert_same(copy.ret_rms.var, venv.ret_rms.var, "variance of returns")
    loaded.training = False
    assert loaded.reset() == pytest.approx(venv.normalize_obs(loaded.get_original_obs()))
    venv.close()
    loaded.close()


@pytest.mark.parametrize("env_id", [FORWARD, TARGET])
def test_ppo_learns_on_it_and_is_evaluated(env_id: str) -> None:
    venv = VecNormalize(VecMonitor(make_swim_vec_env(env_id, 8, overrides=SMALL)))
    model = PPO("MlpPolicy", venv, n_steps=16, batch_size=64, n_epochs=2, seed=0, device="cpu")
    before = [value.clone() for value in model.policy.parameters()]
    model.learn(512)
    assert model.num_timesteps == 512
    after = list(model.policy.parameters())
    assert all(value.isfinite().all() for value in after)
    assert any(not one.equal(other) for one, other in zip(before, after, strict=True))
    assert len(model.ep_info_buffer) == 8 * (64 // 10)
    fresh = VecMonitor(make_swim_vec_env(env_id, 4, overrides=SMALL))
    for played in (venv, fresh):
        returns, lengths = evaluate_policy(model, played, 6, return_episode_rewards=True)
        assert lengths == [10] * 6
        assert np.isfinite(returns).all()
    with pytest.warns(UserWarning, match="not wrapped with a ``Monitor``"):
        evaluate_policy(model, fresh.venv, 1)


def test_sac_learns_on_it() -> None:
    venv = VecMonitor(small(4))
    model = SAC(
        "MlpPolicy", venv, learning_starts=80, batch_size=32, train_freq=4, seed=0, device="cpu",
        buffer_size=2000, policy_kwargs={"net_arch": [16]},
    )  # fmt: skip
    model.learn(400)
    assert model.num_timesteps == 400
    assert model._n_updates > 0
    assert all(value.isfinite().all() for value in model.policy.parameters())
    buffer = model.replay_buffer
    ends = buffer.dones[: buffer.pos]
    assert ends.sum() == 4 * 10
    assert np.array_equal(ends, buffer.timeouts[: buffer.pos]), "ends that are no time limits"
    # The buffer holds where the episodes ended, not where the next ones began.
    ended = ends[:-1].astype(bool)
    reached = buffer.next_observations[: buffer.pos - 1]
    following = buffer.observations[1 : buffer.pos]
    assert np.array_equal(reached[~ended], following[~ended])
    assert not (reached[ended] == following[ended]).all(axis=1).any()


def test_without_stable_baselines3_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in list(sys.modules):
        if name.split(".")[0] == "stable_baselines3":
            monkeypatch.setitem(sys.modules, name, None)
    path = Path(__file__).parents[2] / "agents" / "swim_agents" / "vec_env.py"
    spec = importlib.util.spec_from_file_location("vec_env_alone", path)
    module = importlib.util.module_from_spec(spec)
    with pytest.raises(SwimError, match=r"'train' \(pip install 'swim-env\[train\]'\)") as caught:
        spec.loader.exec_module(module)
    assert isinstance(caught.value, ImportError)
