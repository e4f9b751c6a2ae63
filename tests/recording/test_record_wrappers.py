"""The wrappers that record episodes: triggers, rewards, failures, members of a batch."""

import copy
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from swim_env import (
    ActionError,
    OptionError,
    SimulationEndedError,
    SwimEnv,
    SwimError,
    SwimTargetVectorEnv,
    SwimVectorEnv,
)
from swim_env.recording import RecordEpisodes, RecordVectorEpisodes, read_recording
from swim_env.recording.schema import GROUPS, UNSPLIT_ENERGY
from tests.support import full_disk, run_python

SHORT = {"episode": {"duration": 0.2}}
TAKEN = "is being recorded already: use one recording wrapper"


def always(number: int) -> bool:
    return True


def record(folder, trigger=always, scene=SHORT, **options) -> RecordEpisodes:
    return RecordEpisodes(SwimEnv(overrides=scene), folder, trigger, **options)


def record_batch(folder, count, members, trigger=always, settings=None) -> RecordVectorEpisodes:
    batch = SwimVectorEnv(count, overrides=SHORT, **(settings or {}))
    return RecordVectorEpisodes(batch, folder, members, trigger)


def play(env, seed: int, actions: int = 10):
    env.action_space.seed(seed)
    env.reset(seed=seed)
    return [env.step(env.action_space.sample()) for _ in range(actions)]


def only(path: Path | str):
    (one,) = read_recording(path).swimmers.values()
    return one


def rewards_of(path: Path | str) -> list[float]:
    return only(path).series["reward"][:, 0].tolist()


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


# ---- single environments -----------------------------------------------------------------------


def test_an_episode_is_what_it_is_unrecorded(tmp_path):
    """Same observations, and a file with the same rewards and path."""
    bare, recorded = SwimEnv(overrides=SHORT), record(tmp_path)
    expected, found = play(bare, 3), play(recorded, 3)
    for one, other in zip(expected, found, strict=True):
        assert (one[0] == other[0]).all() and one[1] == other[1]
    one = only(tmp_path / "swimmer-episode-0.rrd")
    assert one.series["reward"][:, 0].tolist() == [step[1] for step in expected]
    assert one.series["position"][-1] == pytest.approx(expected[-1][4]["position"], abs=1e-15)
    assert one.time[-1] == pytest.approx(0.2)
    assert one.scene == bare.scene
    recorded.close()
    assert len(recorded.written) == 1


@pytest.mark.parametrize(
    ("trigger", "numbers"),
    [(lambda number: number in (1, 3), [1, 3]), (None, [0, 1, 8])],
    ids=["chosen", "as RecordVideo does"],
)
def test_triggers(tmp_path, trigger, numbers):
    """Only chosen episodes are kept; nothing is recorded in between."""
    env = record(tmp_path, trigger, name_prefix="a")
    for seed in range(9):
        play(env, seed)
        assert env.unwrapped.episodes.bodies.recorder is None
    env.close()
    assert names_in(tmp_path) == [f"a-episode-{number}.rrd" for number in numbers]


def test_half_an_episode_is_a_recording(tmp_path):
    """By the next reset, by close, and after a refused action it continues."""
    env = record(tmp_path)
    play(env, 0, 4)
    with pytest.raises(ActionError):
        env.step(np.full(8, np.nan))
    env.step(np.zeros(8))
    env.reset(seed=1)
    assert only(tmp_path / "swimmer-episode-0.rrd").time[-1] == pytest.approx(0.1)
    env.step(np.zeros(8))
    env.close()
    env.close()
    assert only(tmp_path / "swimmer-episode-1.rrd").time[-1] == pytest.approx(0.02)


def test_a_program_that_fails_leaves_a_file(tmp_path):
    """The environment is not closed, and Python ends with an exception."""
    code = (
        "import numpy as np\n"
        "from swim_env import SwimEnv\n"
        "from swim_env.recording import RecordEpisodes\n"
        f"env = RecordEpisodes(SwimEnv(), {str(tmp_path)!r}, flow_rate=10.0)\n"
        "env.reset(seed=0)\n"
        "for _ in range(7): env.step(np.ones(8))\n"
        "raise RuntimeError('the learner has failed')\n"
    )
    done = run_python("-c", code)
    assert done.code == 1 and "the learner has failed" in done.err
    one = only(tmp_path / "swimmer-episode-0.rrd")
    assert one.time[-1] == pytest.approx(0.14)
    assert one.flow_time.size == 3


def test_energy_is_split_where_asked(tmp_path):
    """Of a start with noise; not unless asked."""
    for split, names in ((False, UNSPLIT_ENERGY), (True, GROUPS["energy"])):
        env = record(tmp_path / str(split), split_energy=split)
        play(env, 3)
        env.close()
        one = only(env.written[-1].file)
        assert one.names["energy"] == list(names)
        energy = one.series["energy"]
        assert energy[:, :-1].sum(axis=1) == pytest.approx(energy[:, -1], rel=1e-12)


def test_a_snapshot_restored_while_recording(tmp_path):
    """The recording begins there, with the rewards since then and no others."""
    env = record(tmp_path, split_energy=True)
    env.reset(seed=0)
    for action in np.ones((3, 8)):
        env.step(action)
    snapshot = env.unwrapped.snapshot()
    for action in -np.ones((5, 8)):
        env.step(action)
    env.unwrapped.restore(snapshot)
    rewards = [env.step(action)[1] for action in np.zeros((4, 8))]
    env.close()
    one = only(tmp_path / "swimmer-episode-0.rrd")
    assert one.time[[0, -1]] == pytest.approx([0.06, 0.14])
    assert one.series["reward"][:, 0].tolist() == rewards
    assert one.reward_time == pytest.approx([0.08, 0.10, 0.12, 0.14])
    assert one.series["progress"][-1, 0] == pytest.approx(sum(rewards), abs=1e-12)
    assert one.names["energy"] == list(UNSPLIT_ENERGY)


def test_an_episode_that_the_physics_ends(tmp_path):
    """In the middle of an action, whose reward is at the last instant."""
    env = record(tmp_path, scene={"actuation.torque_limit": 20.0, "episode.duration": 2.0})
    env.reset(seed=1)
    rewards, terminated = [], False
    while not terminated:
        _, reward, terminated, _, info = env.step(np.ones(8))
        rewards.append(reward)
    one = only(tmp_path / "swimmer-episode-0.rrd")
    assert one.termination_reason == info["termination_reason"] != ""
    assert env.unwrapped.steps % env.unwrapped.scene.steps_per_action > 0
    assert one.series["reward"][:, 0].tolist() == rewards
    assert one.reward_time[-1] == pytest.approx(one.time[-1])


def test_a_copy_records_its_own_rewards(tmp_path):
    """Of a wrapper in the middle of an episode."""
    env = record(tmp_path)
    env.reset(seed=0)
    rewards = [env.step(np.ones(8))[1]]
    other = copy.deepcopy(env)
    rewards += [other.step(np.ones(8))[1] for _ in range(3)]
    other.close()
    assert len(set(rewards)) == 4
    assert rewards_of(other.written[-1].file) == rewards


# ---- batches -----------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_members_of_a_batch(tmp_path, mode):
    """Chosen members in every mode of starting anew: each file the member's own episode."""
    members = np.array([2, 0], dtype=np.int16)
    env = record_batch(tmp_path, 3, members, settings={"autoreset_mode": mode})
    env.reset(seed=5)
    gains = []
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (24, 3, 8))
    for action in actions:
        _, rewards, _, truncated, _ = env.step(action)
        gains.append(rewards[2])
        if mode == "Disabled" and truncated.any():
            env.reset(options={"reset_mask": truncated})
    env.close()
    # In mode NextStep one step between two episodes goes to the start.
    gap = 1 if mode == "NextStep" else 0
    for number in range(3):
        one = only(tmp_path / f"swimmer-member-2-episode-{number}.rrd")
        first = number * (10 + gap)
        expected = gains[first : first + 10]
        assert one.series["reward"][:, 0].tolist() == expected
        assert one.series["progress"][-1, 0] == pytest.approx(sum(expected), abs=1e-12)
        assert one.time[-1] == pytest.approx(0.02 * len(expected))
    names = names_in(tmp_path)
    assert len(names) == 6 and not any("member-1" in name for name in names)


def test_targets(tmp_path):
    """The episode's own target, also where the next episode has begun with another."""
    env = RecordVectorEpisodes(
        SwimTargetVectorEnv(1, overrides=SHORT, autoreset_mode="SameStep"),
        tmp_path,
        episode_trigger=always,
    )
    _, infos = env.reset(seed=5)
    target = infos["target"][0].copy()
    for _ in range(10):
        env.step(np.zeros((1, 8)))
    read = read_recording(tmp_path / "swimmer-member-0-episode-0.rrd")
    centre = read.columns[("/world/swimmer-member-0/target", "Ellipses2D:centers")]
    assert centre.values[0][0] == pytest.approx(target, rel=1e-6)


def test_a_reset_after_the_end_is_the_only_start(tmp_path):
    """With next-step autoreset, a reset by hand begins the episode."""
    env = record_batch(tmp_path, 1, [0], settings={"max_episode_steps": 3})
    for seed in (0, 1):
        env.reset(seed=seed)
        paid = [env.step(np.full((1, 8), 0.5))[1][0] for _ in range(3)]
    env.close()
    assert [Path(one.file).name[-5] for one in env.written] == ["0", "1"]
    assert rewards_of(env.written[-1].file) == pytest.approx(paid)


def test_a_start_that_cannot_be_simulated_costs_no_recording(tmp_path):
    """Members that it was not about continue, with the rewards from their start on."""
    env = record_batch(tmp_path, 2, [0])
    env.reset(seed=0)
    paid = [env.step(np.full((2, 8), 0.5))[1][0] for _ in range(3)]
    curled = {"joint_angles": [3.1] * 8, "noise": 0.0}
    with pytest.raises(SimulationEndedError):
        env.reset(options={"reset_mask": np.array([False, True]), **curled})
    paid += [env.step(np.full((2, 8), 0.5))[1][0] for _ in range(3)]
    env.close()
    (one,) = env.written
    assert rewards_of(one.file) == pytest.approx(paid)


# ---- failures ----------------------------------------------------------------------------------


class Failing(gymnasium.Wrapper):
    """Fails with the fourth action, before or after the physics."""

    after = False

    def step(self, action):
        hold = self.unwrapped.scene.steps_per_action
        early = self.unwrapped.steps == 3 * hold and not self.after
        result = None if early else self.env.step(action)
        if result is None or self.unwrapped.steps == 4 * hold:
            raise RuntimeError("the battery is empty")
        return result


class FailingBatch(gymnasium.vector.VectorWrapper):
    def step(self, actions):
        self.env.step(actions)
        raise RuntimeError("the battery is empty")


@pytest.mark.parametrize(("kind", "rewards"), [("before", 3), ("after", 4), ("batch", 1)])
def test_a_step_that_fails_leaves_a_file(tmp_path, kind, rewards):
    """The error comes through, and an action that was played has its reward."""
    failing = Failing(SwimEnv(overrides=SHORT))
    failing.after = kind == "after"
    env = RecordEpisodes(failing, tmp_path, always)
    if kind == "batch":
        env = RecordVectorEpisodes(FailingBatch(SwimVectorEnv(2, overrides=SHORT)), tmp_path, [1])
    with pytest.raises(RuntimeError, match="battery"):
        play(env, 0)
    one = only(env.written[-1].file)
    assert one.series["reward"].shape == (rewards, 1)
    assert one.series["reward"].sum() == pytest.approx(one.series["progress"][-1, 0])


def test_a_failing_disk_costs_no_episode(tmp_path, monkeypatch):
    """Steps and resets warn and return what they have; close raises."""
    monkeypatch.setattr("swim_env.recording.writer.write_atomically", full_disk)
    env = record(tmp_path)
    why = "an episode was not recorded: cannot write the recording: No space left"
    with pytest.warns(UserWarning, match=why):
        last = play(env, 0)[-1]
    assert last[3]
    env.reset(seed=1)
    env.step(np.zeros(8))
    with pytest.warns(UserWarning, match=why):
        observation, _ = env.reset(seed=2)
    assert env.observation_space.contains(observation)
    env.step(np.zeros(8))
    with pytest.raises(SwimError, match="No space left"):
        env.close()
    batch = record_batch(tmp_path, 2, [0, 1])
    batch.reset(seed=0)
    with pytest.warns(UserWarning, match=why) as told:
        for _ in range(10):
            truncated = batch.step(np.zeros((2, 8)))[3]
    assert truncated.all() and len(told) == 2
    assert not batch.written


# ---- one wrapper at a time ---------------------------------------------------------------------


@pytest.mark.parametrize("batch", [False, True])
def test_a_second_wrapper_waits_for_the_first_to_be_closed(tmp_path, batch):
    """A closed one that is reset records again, unless another one does by now."""
    swimmer = (SwimVectorEnv(2, overrides=SHORT) if batch else SwimEnv(overrides=SHORT)).unwrapped
    wrapper = RecordVectorEpisodes if batch else RecordEpisodes
    first = wrapper(swimmer, tmp_path / "a")
    first.close()
    first.reset(seed=0)
    with pytest.raises(OptionError, match=TAKEN):
        wrapper(swimmer, tmp_path / "b", **({"members": [1]} if batch else {}))
    first.close()
    second = wrapper(swimmer, tmp_path / "b")
    with pytest.raises(OptionError, match=TAKEN):
        first.reset(seed=0)
    first.close()
    with pytest.raises(OptionError, match=TAKEN):
        wrapper(swimmer, tmp_path / "c")
    play(second, 0)
    second.close()
    assert len(second.written) == 1


def test_after_close_nothing_is_recorded(tmp_path):
    """Until the wrapper is reset, even where a member is started anew by itself."""
    one = record_batch(tmp_path, 1, [0], settings={"max_episode_steps": 2})
    one.reset(seed=0)
    for _ in range(2):
        one.step(np.zeros((1, 8)))
    one.close()
    for _ in range(3):
        one.step(np.zeros((1, 8)))
    one.close()
    assert len(one.written) == 1
    one.reset(seed=0)
    one.step(np.zeros((1, 8)))
    one.close()
    assert len(one.written) == 2


@pytest.mark.parametrize("batch", [False, True])
def test_a_scene_that_records_by_itself(tmp_path, batch):
    """Continues to do so; a wrapper in the middle of an episode begins with the next."""
    scene = {**SHORT, "recording": {}}
    if not batch:
        env = record(tmp_path / "a", scene=scene)
        play(env, 0)
        assert env.unwrapped.recorded().steps == 10 * env.unwrapped.scene.steps_per_action
        one = only(tmp_path / "a" / "swimmer-episode-0.rrd")
        assert one.time[-1] == pytest.approx(0.2)
    env = SwimVectorEnv(2, overrides=scene) if batch else SwimEnv(overrides=scene)
    env.reset(seed=0)
    late = (RecordVectorEpisodes if batch else RecordEpisodes)(env, tmp_path / "b")
    with pytest.raises(OptionError):
        late.reset(options={"noise": "bad"})
    late.step(np.zeros(env.action_space.shape))
    assert (env.episodes.counters[:, 0] == 1).all()
    assert (env.episodes.bodies.steps_taken == env.scene.steps_per_action).all()
    late.close()
    assert not names_in(tmp_path / "b")


# ---- arguments ---------------------------------------------------------------------------------


def test_recordings_of_before_are_warned_of(tmp_path):
    """Of the same names alone."""
    (tmp_path / "a-episode-0.rrd").touch()
    (tmp_path / "a-member-1-episode-7.rrd").touch()
    record(tmp_path, name_prefix="b").close()
    with pytest.warns(UserWarning, match="will be overwritten .a-episode-") as told:
        record(tmp_path, name_prefix="a")
    assert len(told) == 1 and told[0].filename == __file__
    with pytest.warns(UserWarning, match="a-member-1-episode-"):
        RecordVectorEpisodes(SwimVectorEnv(2, overrides=SHORT), tmp_path, [0, 1], name_prefix="a")


def test_bad_environments(tmp_path):
    """Others, and a batch where one is wanted or the other way round."""
    for wrapper, env, part in (
        (RecordEpisodes, gymnasium.make("CartPole-v1"), "RecordEpisodes needs a SwimEnv, got Cart"),
        (RecordEpisodes, SwimVectorEnv(2), "RecordVectorEpisodes records a batch"),
        (RecordVectorEpisodes, SwimEnv(), "RecordEpisodes records a single"),
        (RecordVectorEpisodes, "swimmer", "RecordVectorEpisodes needs a SwimVectorEnv, got str"),
    ):
        with pytest.raises(OptionError, match=part):
            wrapper(env, tmp_path)


@pytest.mark.parametrize(
    ("options", "part"),
    [
        ({"frame_rate": 0.0}, "frame_rate must be above 0, got 0"),
        ({"frame_rate": True}, "frame_rate must be a number, got true"),
        ({"frame_rate": "50"}, "frame_rate must be"),
        ({"flow_rate": float("nan")}, "flow_rate must be a finite number, got nan"),
        ({"flow_rate": True}, "flow_rate must be"),
        ({"name_prefix": "a/b"}, "name_prefix must be the beginning of a file's name"),
        ({"name_prefix": ".."}, "name_prefix must be"),
        ({"name_prefix": ""}, "name_prefix must be"),
        ({"name_prefix": 3}, "name_prefix must be"),
        ({"members": [2]}, "whole numbers of 0 to 1, at least one of them, got 2"),
        ({"members": [-1]}, "got -1"),
        ({"members": []}, "got none"),
        ({"members": [0, 0]}, "got 0, 0"),
        ({"members": [0.5]}, "members must be"),
        ({"members": [True]}, "members must be"),
        ({"members": 1}, "members must be"),
        ({"members": "01"}, "members must be"),
    ],
)
def test_bad_arguments_are_refused_before_anything_is_played(tmp_path, options, part):
    folder = tmp_path / "new"
    with pytest.raises(OptionError, match=part):
        RecordVectorEpisodes(SwimVectorEnv(2, overrides=SHORT), folder, **options)
    if "members" not in options:
        with pytest.raises(OptionError, match=part):
            record(folder, **options)
    assert not folder.exists()


@pytest.mark.release
def test_cost_is_measured():
    """Every figure of the page, and a frame takes far less than one logged by itself."""
    from studies.benchmark.recording_cost import measure_cost

    found = measure_cost(1)
    assert 0.0 < found["frame_seconds"] < 2e-4
    assert 1e5 < found["bytes"] < 5e6
    assert found["bare_seconds"]["median"] > 0.0
    shares = {"while_playing", "with_file"}
    assert shares | {"file_seconds", "fixed_seconds", "commit"} <= found.keys()
