"""The wrappers that record episodes: triggers, rewards, failures, members of a batch."""

from __future__ import annotations

import copy
import errno
import os
import subprocess
import sys
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

ROOT = Path(__file__).parents[2]
SHORT = {"episode": {"duration": 0.2}}


def record(folder, trigger=lambda number: True, **options) -> RecordEpisodes:
    return RecordEpisodes(SwimEnv(overrides=SHORT), folder, trigger, **options)


def play(env, seed: int, actions: int = 10):
    env.action_space.seed(seed)
    env.reset(seed=seed)
    return [env.step(env.action_space.sample()) for _ in range(actions)]


def only(path: Path):
    (one,) = read_recording(path).swimmers.values()
    return one


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


def test_triggers(tmp_path):
    """Only chosen episodes are kept; nothing is recorded in between."""
    env = record(tmp_path, lambda number: number in (1, 3), name_prefix="a")
    for seed in range(4):
        play(env, seed)
        assert env.unwrapped.episodes.bodies.recorder is None
    env.close()
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["a-episode-1.rrd", "a-episode-3.rrd"]


def test_default_trigger_is_gymnasiums(tmp_path):
    """Cubes, as RecordVideo does."""
    env = RecordEpisodes(SwimEnv(overrides=SHORT), tmp_path)
    for seed in range(9):
        play(env, seed, 1)
    env.close()
    numbers = sorted(int(path.stem.split("-")[-1]) for path in tmp_path.iterdir())
    assert numbers == [0, 1, 8]


def test_half_an_episode_is_a_recording(tmp_path):
    """By the next reset, by close, and after a refused action it goes on."""
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


def test_a_step_that_fails_leaves_a_file(tmp_path):
    """Whatever it fails with; the error comes through."""

    class Failing(gymnasium.Wrapper):
        def step(self, action):
            if self.env.unwrapped.steps >= 12:
                raise RuntimeError("the battery is empty")
            return self.env.step(action)

    env = RecordEpisodes(Failing(SwimEnv(overrides=SHORT)), tmp_path, lambda number: True)
    with pytest.raises(RuntimeError, match="battery"):
        play(env, 0)
    assert only(tmp_path / "swimmer-episode-0.rrd").series["reward"].shape == (3, 1)


def test_a_program_that_fails_leaves_a_file(tmp_path):
    """Nobody has closed the environment, and Python ends with an exception."""
    code = (
        "import numpy as np\n"
        "from swim_env import SwimEnv\n"
        "from swim_env.recording import RecordEpisodes\n"
        f"env = RecordEpisodes(SwimEnv(), {str(tmp_path)!r}, flow_rate=10.0)\n"
        "env.reset(seed=0)\n"
        "for _ in range(7): env.step(np.ones(8))\n"
        "raise RuntimeError('the learner has failed')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        timeout=200,
    )
    assert done.returncode == 1 and "the learner has failed" in done.stderr
    one = only(tmp_path / "swimmer-episode-0.rrd")
    assert one.time[-1] == pytest.approx(0.14)
    assert one.flow_time.size == 3


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_members_of_a_batch(tmp_path, mode):
    """Chosen members in every mode of starting anew: each file the member's own episode."""
    env = RecordVectorEpisodes(
        SwimVectorEnv(3, overrides=SHORT, autoreset_mode=mode),
        tmp_path,
        [0, 2],
        lambda number: True,
    )
    env.reset(seed=5)
    gains = []
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (24, 3, 8))
    for action in actions:
        _, rewards, _, truncated, _ = env.step(action)
        gains.append(rewards[2])
        if mode == "Disabled" and truncated.any():
            env.reset(options={"reset_mask": truncated})
    env.close()
    episodes = [only(tmp_path / f"swimmer-member-2-episode-{n}.rrd") for n in range(3)]
    # In mode NextStep one step between two episodes goes to the start.
    gap = 1 if mode == "NextStep" else 0
    for number, one in enumerate(episodes):
        first = number * (10 + gap)
        expected = gains[first : first + 10]
        assert one.series["reward"][:, 0].tolist() == expected
        assert one.series["progress"][-1, 0] == pytest.approx(sum(expected), abs=1e-12)
        assert one.time[-1] == pytest.approx(0.02 * len(expected))
    names = {path.name for path in tmp_path.iterdir()}
    assert len(names) == 6 and not any("member-1" in name for name in names)


def test_targets(tmp_path):
    """The episode's own target, also where the next episode has begun with another."""
    env = RecordVectorEpisodes(
        SwimTargetVectorEnv(1, overrides=SHORT, autoreset_mode="SameStep"),
        tmp_path,
        episode_trigger=lambda number: True,
    )
    _, infos = env.reset(seed=5)
    target = infos["target"][0].copy()
    for _ in range(10):
        env.step(np.zeros((1, 8)))
    read = read_recording(tmp_path / "swimmer-member-0-episode-0.rrd")
    centre = read.columns[("/world/swimmer-member-0/target", "Ellipses2D:centers")]
    assert centre.values[0][0] == pytest.approx(target, rel=1e-6)


def test_energy_is_split_where_asked(tmp_path):
    """Of a start with noise; for nothing unless asked."""
    for split, names in ((False, UNSPLIT_ENERGY), (True, GROUPS["energy"])):
        folder = tmp_path / str(split)
        env = record(folder, split_energy=split)
        play(env, 3)
        env.close()
        one = only(folder / "swimmer-episode-0.rrd")
        assert one.names["energy"] == list(names)
        energy = one.series["energy"]
        assert energy[:, :-1].sum(axis=1) == pytest.approx(energy[:, -1], rel=1e-12)


def test_a_scene_that_records_by_itself(tmp_path):
    """Goes on doing so."""
    env = RecordEpisodes(
        SwimEnv(overrides={**SHORT, "recording": {}}), tmp_path, lambda number: True
    )
    play(env, 0)
    assert env.unwrapped.recorded().steps == 40
    assert only(tmp_path / "swimmer-episode-0.rrd").time[-1] == pytest.approx(0.2)


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
    """In the middle of an action, whose reward stands at the last instant."""
    scene = {"actuation.torque_limit": 20.0, "episode.duration": 2.0}
    env = RecordEpisodes(SwimEnv(overrides=scene), tmp_path)
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


def test_a_failure_behind_the_physics(tmp_path):
    """The action that was played has its reward, in batches too."""

    class Failing(gymnasium.Wrapper):
        def step(self, action):
            self.env.step(action)
            raise RuntimeError("the battery is empty")

    class FailingBatch(gymnasium.vector.VectorWrapper):
        def step(self, actions):
            self.env.step(actions)
            raise RuntimeError("the battery is empty")

    for env, action in (
        (RecordEpisodes(Failing(SwimEnv(overrides=SHORT)), tmp_path), np.ones(8)),
        (
            RecordVectorEpisodes(FailingBatch(SwimVectorEnv(2, overrides=SHORT)), tmp_path, [1]),
            np.ones((2, 8)),
        ),
    ):
        env.reset(seed=0)
        with pytest.raises(RuntimeError, match="battery"):
            env.step(action)
        one = only(Path(env.written[-1].file))
        assert one.series["reward"].shape == (1, 1)
        assert one.series["reward"][0, 0] == pytest.approx(one.series["progress"][-1, 0])


def test_one_wrapper_at_a_time(tmp_path):
    """A second one would take the first one's steps; after close there may be another."""
    env = record(tmp_path)
    with pytest.raises(OptionError, match="is being recorded already: use one recording wrapper"):
        RecordEpisodes(env, tmp_path)
    env.close()
    with pytest.warns(UserWarning) as told:
        play(env, 0, 1)
        env.close()
        play(RecordEpisodes(env.unwrapped, tmp_path), 0)
    assert ["will be overwritten" in str(one.message) for one in told] == [True]
    batch = RecordVectorEpisodes(SwimVectorEnv(2, overrides=SHORT), tmp_path, [0])
    with pytest.raises(OptionError, match="is being recorded already"):
        RecordVectorEpisodes(batch, tmp_path, [1])
    del env, batch


def test_a_closed_wrapper_that_starts_again_counts(tmp_path):
    """It records again, unless another one does by now; and takes nothing from that one."""
    first = record(tmp_path / "a")
    swimmer = first.unwrapped
    first.close()
    first.reset(seed=0)
    with pytest.raises(OptionError, match="is being recorded already"):
        RecordEpisodes(swimmer, tmp_path / "b")
    first.close()
    second = RecordEpisodes(swimmer, tmp_path / "b")
    with pytest.raises(OptionError, match="is being recorded already"):
        first.reset(seed=0)
    first.close()
    with pytest.raises(OptionError, match="is being recorded already"):
        RecordEpisodes(swimmer, tmp_path / "c")
    play(second, 0)
    assert len(second.written) == 1

    batch = SwimVectorEnv(2, overrides=SHORT)
    one = RecordVectorEpisodes(batch, tmp_path / "d", [0])
    one.close()
    other = RecordVectorEpisodes(batch, tmp_path / "e", [1])
    with pytest.raises(OptionError, match="is being recorded already"):
        one.reset(seed=0)
    other.close()


RECORDING = {**SHORT, "recording": {}}


def test_a_wrapper_may_come_in_the_middle_of_an_episode(tmp_path):
    """Of a scene that records by itself: nothing is kept until the next start, nothing fails."""
    batch = SwimVectorEnv(2, overrides=RECORDING)
    batch.reset(seed=0)
    wrapped = RecordVectorEpisodes(batch, tmp_path / "a", [0])
    wrapped.step(np.zeros((2, 8)))
    assert batch.episodes.counters[:, 0].tolist() == [1, 1]
    assert batch.episodes.bodies.steps_taken.tolist() == [4.0, 4.0]
    wrapped.close()

    env = SwimEnv(overrides=RECORDING)
    env.reset(seed=0)
    env.step(np.zeros(8))
    late = RecordEpisodes(env, tmp_path / "b", lambda number: True)
    with pytest.raises(OptionError):
        late.reset(options={"noise": "bad"})
    late.step(np.zeros(8))
    assert env.episodes.counters[0, 0] == 2
    late.close()
    assert not list(tmp_path.rglob("*.rrd"))


def test_a_copy_records_its_own_rewards(tmp_path):
    """Of a wrapper in the middle of an episode."""
    env = record(tmp_path)
    env.reset(seed=0)
    rewards = [env.step(np.ones(8))[1]]
    other = copy.deepcopy(env)
    rewards += [other.step(np.ones(8))[1] for _ in range(3)]
    other.close()
    assert len(set(rewards)) == 4
    assert only(Path(other.written[-1].file)).series["reward"][:, 0].tolist() == rewards


def test_a_reset_after_the_end_is_the_only_start(tmp_path):
    """With next-step autoreset, whoever resets by hand begins an episode there."""
    env = RecordVectorEpisodes(
        SwimVectorEnv(1, overrides=SHORT, max_episode_steps=3), tmp_path, [0], lambda number: True
    )
    for seed in (0, 1):
        env.reset(seed=seed)
        paid = [env.step(np.full((1, 8), 0.5))[1][0] for _ in range(3)]
    env.close()
    assert [Path(one.file).name[-5] for one in env.written] == ["0", "1"]
    rewards = only(Path(env.written[-1].file)).series["reward"][:, 0]
    assert rewards.tolist() == pytest.approx(paid)


def test_a_start_that_cannot_be_simulated_costs_no_recording(tmp_path):
    """Members that it was not about go on, with the rewards from their start on."""
    env = RecordVectorEpisodes(
        SwimVectorEnv(2, overrides=SHORT), tmp_path, [0], lambda number: True
    )
    env.reset(seed=0)
    paid = [env.step(np.full((2, 8), 0.5))[1][0] for _ in range(3)]
    curled = {"joint_angles": [3.1] * 8, "noise": 0.0}
    with pytest.raises(SimulationEndedError):
        env.reset(options={"reset_mask": np.array([False, True]), **curled})
    paid += [env.step(np.full((2, 8), 0.5))[1][0] for _ in range(3)]
    env.close()
    (one,) = env.written
    assert only(Path(one.file)).series["reward"][:, 0].tolist() == pytest.approx(paid)


def test_after_close_nothing_is_recorded(tmp_path):
    """Until the wrapper is reset, even where a member is started anew by itself."""
    batch = SwimVectorEnv(1, overrides=SHORT, max_episode_steps=2)
    one = RecordVectorEpisodes(batch, tmp_path / "a", [0], lambda number: True)
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


def test_recordings_of_before_are_told_of(tmp_path):
    """Of the same names alone."""
    (tmp_path / "a-episode-0.rrd").touch()
    (tmp_path / "a-member-1-episode-7.rrd").touch()
    record(tmp_path, name_prefix="b").close()
    with pytest.warns(UserWarning, match="will be overwritten .a-episode-"):
        record(tmp_path, name_prefix="a")
    with pytest.warns(UserWarning, match="a-member-1-episode-"):
        RecordVectorEpisodes(SwimVectorEnv(2, overrides=SHORT), tmp_path, [0, 1], name_prefix="a")


def test_a_failing_disk_costs_no_episode(tmp_path, monkeypatch):
    """Steps and resets warn and give what they have; close raises."""

    def full(path, write):
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr("swim_env.recording.writer.write_atomically", full)
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
    batch = RecordVectorEpisodes(
        SwimVectorEnv(2, overrides=SHORT), tmp_path, [0, 1], lambda number: True
    )
    batch.reset(seed=0)
    with pytest.warns(UserWarning, match=why) as told:
        for _ in range(10):
            truncated = batch.step(np.zeros((2, 8)))[3]
    assert truncated.all() and len(told) == 2
    assert not batch.written


def test_bad_environments(tmp_path):
    """Others, and a batch where one is wanted or the other way round."""
    with pytest.raises(OptionError, match="needs a SwimEnv"):
        RecordEpisodes(gymnasium.make("CartPole-v1"), tmp_path)
    batch = SwimVectorEnv(2, overrides=SHORT)
    with pytest.raises(OptionError, match="RecordVectorEpisodes records a batch"):
        RecordEpisodes(batch, tmp_path)
    with pytest.raises(OptionError, match="RecordEpisodes records a single"):
        RecordVectorEpisodes(SwimEnv(overrides=SHORT), tmp_path)
    with pytest.raises(OptionError, match="needs a SwimVectorEnv, got str"):
        RecordVectorEpisodes("swimmer", tmp_path)


@pytest.mark.parametrize(
    ("options", "part"),
    [
        ({"frame_rate": 0.0}, "frame_rate must be a finite number above 0, got 0"),
        ({"frame_rate": None}, "frame_rate must be"),
        ({"frame_rate": "50"}, "frame_rate must be"),
        ({"flow_rate": float("nan")}, "flow_rate must be a finite number above 0, got nan"),
        ({"flow_rate": float("inf")}, "flow_rate must be"),
        ({"flow_rate": True}, "flow_rate must be"),
        ({"name_prefix": "a/b"}, "name_prefix must be the beginning of a file's name"),
        ({"name_prefix": ".."}, "name_prefix must be"),
        ({"name_prefix": ""}, "name_prefix must be"),
        ({"name_prefix": 3}, "name_prefix must be"),
        ({"members": [2]}, "whole numbers of 0 to 1, at least one of them, got 2"),
        ({"members": [-1]}, "members must be"),
        ({"members": []}, "got none"),
        ({"members": [0, 0]}, "got 0 twice"),
        ({"members": [0.0]}, "members must be"),
        ({"members": [True]}, "members must be"),
        ({"members": 1}, "members must be"),
        ({"members": "01"}, "members must be"),
    ],
)
def test_bad_arguments(tmp_path, options, part):
    """Told of before anything is played, and nothing is left."""
    folder = tmp_path / "new"
    with pytest.raises(OptionError, match=part):
        RecordVectorEpisodes(SwimVectorEnv(2, overrides=SHORT), folder, **options)
    if "members" not in options:
        with pytest.raises(OptionError, match=part):
            record(folder, **options)
    assert not folder.exists()


def test_members_may_be_an_array(tmp_path):
    """Of whole numbers of any width."""
    env = RecordVectorEpisodes(
        SwimVectorEnv(3, overrides=SHORT), tmp_path, np.array([2, 0], dtype=np.int16)
    )
    env.reset(seed=0)
    env.step(np.zeros((3, 8)))
    env.close()
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["swimmer-member-0-episode-0.rrd", "swimmer-member-2-episode-0.rrd"]


def test_cost_is_measured():
    """Every figure of the page, and a frame takes far less than one logged by itself."""
    from studies.benchmark.recording_cost import measure_cost

    found = measure_cost(1)
    assert 0.0 < found["frame_seconds"] < 2e-4
    assert 1e5 < found["bytes"] < 5e6
    assert found["bare_seconds"]["median"] > 0.0
    shares = {"while_playing", "with_file"}
    assert shares | {"file_seconds", "fixed_seconds", "commit"} <= found.keys()
