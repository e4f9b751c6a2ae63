"""Training runs: the same twice, the same with and without an interruption, or one clear error."""

import gc
import json
import random
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

import torch
from swim_agents.learning.checkpoints import CheckpointError, load_checkpoint, save_checkpoint
from swim_agents.learning.config import ConfigError, load_config
from swim_agents.learning.environment import make_training_env
from swim_agents.learning.logs import read_log
from swim_agents.learning.trainer import (
    EVALUATION_COLUMNS,
    RunExistsError,
    check_run,
    run_status,
    train,
)
from swim_agents.rollout import Rollout, play_episodes

from swim_env import SwimError
from tests.learning.small_runs import (
    KINDS,
    Bomb,
    Stopped,
    assert_damage_is_one_clear_error,
    assert_same_run,
    contents,
    hidden,
    small_config,
    stop_at,
    table,
    untrained,
    weights,
)
from tests.stability.test_interrupts import files_of_at_most
from tests.support import full_disk, refuses

#: A function that returns the folder of an uninterrupted run of a kind.
Whole = Callable[[str], Path]


@pytest.fixture(scope="module", autouse=True)
def _a_line_of_progress_every_round_or_two() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swim_agents.learning.trainer._LOG_EVERY", 100)
        yield


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Whole:
    """Return the folder of an uninterrupted run of a kind, seed 3, made once."""

    @cache
    def run(kind: str) -> Path:
        folder = tmp_path_factory.mktemp(kind) / "run"
        train(small_config(kind), folder, 3, threads=2)
        return folder

    return run


def stopped(folder: Path, steps: int, kind: str = "ppo", **options: Any) -> None:
    """Train until a run is stopped after so many steps of this call."""
    with pytest.raises(Stopped):
        train(small_config(kind), folder, 3, progress=stop_at(steps), **options)


@pytest.fixture(scope="module")
def _half(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("half") / "run"
    stopped(folder, 900)
    return folder


@pytest.fixture
def half(_half: Path, tmp_path: Path) -> Path:
    """Return the folder of a run that was stopped after 900 steps, with a checkpoint at 832."""
    return Path(shutil.copytree(_half, tmp_path / "run"))


def draw_elsewhere() -> None:
    """Draw what must not matter: the numbers that are left of what was played before."""
    np.random.seed(99)
    torch.manual_seed(99)
    random.seed(99)


# ---- the same run twice ------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_two_runs_with_one_seed_are_the_same(kind, whole, tmp_path):
    """Whatever was drawn before, and with another number of threads."""
    draw_elsewhere()
    train(small_config(kind), tmp_path, 3, threads=1)
    assert_same_run(whole(kind), tmp_path)
    ended = load_checkpoint(tmp_path / "checkpoint.zip")["model"]["parameters"]["policy"]
    begun = untrained(small_config(kind), 3).policy.state_dict()
    assert ended.keys() == begun.keys()
    for name, value in ended.items():
        assert value.isfinite().all(), name
        assert not value.equal(begun[name]), f"{name} is not trained"


@pytest.mark.parametrize("kind", ["ppo", "sac"])
def test_another_seed_is_another_run(kind, whole, tmp_path):
    train(small_config(kind), tmp_path, 4)
    other = whole(kind)
    assert table(tmp_path, "progress.csv") != table(other, "progress.csv")
    assert table(tmp_path, "evaluations.csv")[1:] != table(other, "evaluations.csv")[1:]
    assert weights(tmp_path / "final_agent") != weights(other / "final_agent")


def test_runs_with_different_seeds_share_no_start():
    config = small_config()
    starts = [row for seed in (0, 1) for row in make_training_env(config, seed, 1).reset().tolist()]
    assert len({tuple(row) for row in starts}) == 2 * config.members


@pytest.mark.parametrize("kind", ["ppo", "target", "sac"])
def test_evaluations_and_checkpoints_do_not_disturb_the_training(kind, whole, tmp_path):
    often = {"every": 100, "episodes": 2, "seed": 70}
    train(small_config(kind, evaluation=often, checkpoint_every=50), tmp_path, 3)
    ours, theirs = (table(folder, "evaluations.csv") for folder in (tmp_path, whole(kind)))
    assert len(ours) > len(theirs)
    assert ours[1] != theirs[1], "their seed does not decide what evaluations play"
    assert weights(tmp_path / "final_agent") == weights(whole(kind) / "final_agent")
    assert table(tmp_path, "progress.csv") == table(whole(kind), "progress.csv")


# ---- what a run leaves -------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["ppo", "target", "sac"])
def test_the_logs_have_a_line_for_every_interval(kind, whole):
    folder, config = whole(kind), small_config(kind)
    progress = read_log(folder / "progress.csv")
    evaluations = read_log(folder / "evaluations.csv")
    end = -(-config.steps // config.round_steps) * config.round_steps
    assert tuple(evaluations) == EVALUATION_COLUMNS
    assert evaluations["steps"][0] == 0
    for steps in (progress["steps"], evaluations["steps"]):
        assert steps[-1] == end
        assert sorted(set(steps)) == steps
    between = [steps // config.evaluation.every for steps in evaluations["steps"]]
    assert between == [0, 1, 2, end // config.evaluation.every]
    assert len(progress["steps"]) >= 10
    assert (np.diff(progress["seconds"]) > 0.0).all()
    # Each rate is that of the line's steps: falling in a straight line.
    falling = [config.learning_rate_at(int(steps)) for steps in progress["steps"]]
    assert progress["learning_rate"] == falling
    assert np.isfinite(progress["return_mean"]).all()
    assert np.isfinite(evaluations["return_mean"]).all()
    assert set(progress["length_mean"]) == {20.0}


def test_the_record_says_how_the_run_ended(whole):
    folder = whole("ppo")
    record = run_status(folder)
    assert record is not None
    evaluations = read_log(folder / "evaluations.csv")
    assert (record["finished"], record["seed"], record["steps"]) == (True, 3, 1600)
    assert record["last"] == {name: values[-1] for name, values in evaluations.items()}
    medians, least = (evaluations[f"net_displacement_{name}"] for name in ("median", "min"))
    best = int(np.argmax(np.add(medians, least)))
    assert record["best"]["steps"] == evaluations["steps"][best]
    assert run_status(folder / "nothing") is None
    assert hidden(folder) == []


def test_where_nothing_is_learned_a_line_says_so_once_and_what_to_look_at(tmp_path):
    config = small_config(**{"learning_rate": 1e-9, "final_learning_rate": None})
    told: list[str] = []
    train(config, tmp_path / "a", notice=told.append)
    (line,) = told
    assert line.startswith("nothing learned after 640 steps: returns have gained ")
    assert "nothing damps" not in line
    assert "explained_variance" in line or "an episode of" in line
    # Whoever resumes is told as well, if that point was not reached before.
    told.clear()
    with pytest.raises(Stopped):
        train(config, tmp_path / "b", progress=stop_at(500), notice=told.append)
    assert told == []
    train(config, tmp_path / "b", resume=True, notice=told.append)
    assert told == [line]


@pytest.mark.parametrize("unit", [1e-4, 1e4])
@pytest.mark.parametrize(("gain", "told"), [(0.9, 1), (1.1, 0)])
def test_what_counts_as_learned_is_a_matter_of_how_much_returns_differ(
    unit, gain, told, tmp_path, monkeypatch
):
    played = []

    def play(*arguments: Any) -> list[Rollout]:
        """Play episodes whose returns differ by one unit, and gain so many once."""
        rollouts = play_episodes(*arguments)
        gained = gain if len(played) == 1 else 0.0
        played.append(rollouts)
        signs = np.where(np.arange(len(rollouts)) % 2, 1.0, -1.0)
        return [
            replace(one, rewards=np.array([unit * (sign + gained)]))
            for one, sign in zip(rollouts, signs, strict=True)
        ]

    monkeypatch.setattr("swim_agents.learning.trainer.play_episodes", play)
    lines: list[str] = []
    train(small_config(), tmp_path / "a", notice=lines.append)
    assert len(played) > 2 and len(lines) == told


def test_a_run_of_an_earlier_version_is_not_judged_by_what_it_had_learned(tmp_path):
    config = small_config(**{"learning_rate": 1e-9, "final_learning_rate": None})
    with pytest.raises(Stopped):
        train(config, tmp_path / "a", progress=stop_at(500))
    checkpoint = tmp_path / "a" / "checkpoint.zip"
    state = load_checkpoint(checkpoint)
    del state["returns"]
    save_checkpoint(checkpoint, state)
    record = train(config, tmp_path / "a", resume=True, notice=pytest.fail)
    assert record["finished"]


def test_the_number_of_pytorchs_threads_is_left_as_it_was(tmp_path):
    before, inside = torch.get_num_threads(), set()

    def progress(steps: int, text: str) -> None:
        inside.add(torch.get_num_threads())
        raise Stopped

    torch.set_num_threads(2)
    try:
        with pytest.raises(Stopped):
            train(small_config(torch_threads=1), tmp_path, progress=progress)
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
    assert inside == {1}


# ---- continuing after an interruption -----------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_a_run_that_was_stopped_twice_ends_like_one_that_was_not(kind, whole, tmp_path):
    stopped(tmp_path, 700, kind)
    early = load_checkpoint(tmp_path / "checkpoint.zip")
    stopped(tmp_path, 1200, kind, resume=True)
    assert load_checkpoint(tmp_path / "checkpoint.zip")["seconds"] > early["seconds"]
    draw_elsewhere()
    assert train(small_config(kind), tmp_path, 3, resume=True)["finished"]
    assert_same_run(whole(kind), tmp_path)
    if kind.startswith("sac"):
        kept = load_checkpoint(tmp_path / "checkpoint.zip")["model"]["buffer"]
        assert kept["full"], "the buffer did not wrap around"


@pytest.mark.parametrize("steps", [1, 390, 500, 1599])
@pytest.mark.parametrize("kind", ["ppo", "sac"])
def test_it_does_not_matter_where_a_run_is_stopped(kind, steps, whole, tmp_path):
    """Before the first checkpoint, with random actions in the buffer, after the last round."""
    stopped(tmp_path, steps, kind)
    assert not (run_status(tmp_path) or {})["finished"]
    train(small_config(kind), tmp_path, 3, resume=True)
    assert_same_run(whole(kind), tmp_path)


def test_reported_progress_adds_up_from_the_start(half, tmp_path):
    seen: list[tuple[int, str]] = []
    progress = lambda steps, text: seen.append((steps, text))  # noqa: E731
    train(small_config(steps=300), tmp_path / "new", 3, progress=progress)
    assert [steps for steps, _ in seen if steps] == [64] * 5
    # Evaluations, which may take longer than all of that, are told before they begin.
    assert seen[0] == (0, "evaluating")
    assert all(text == "evaluating" if not steps else text.endswith(" BL") for steps, text in seen)
    seen.clear()
    train(small_config(), half, 3, resume=True, progress=progress)
    assert seen[0][0] == 832 + 64
    assert sum(steps for steps, _ in seen) == 1600


def test_half_a_line_in_a_log_is_taken_out(whole, half):
    for name in ("progress.csv", "evaluations.csv"):
        path = half / name
        path.write_text(path.read_text() + "1000,2.5,0.")
    train(small_config(), half, 3, resume=True)
    assert_same_run(whole("ppo"), half)


def test_what_a_kill_left_half_written_is_gone_in_the_end(half):
    """Names are those that `write_atomically` and `write_folder` give."""
    kept = (half / "agent" / "agent.json").read_bytes()
    (half / ".checkpoint.zip.0123456789ab.tmp").write_bytes(b"half")
    (half / ".run.json.0123456789ab.tmp").write_bytes(b"half")
    aside = half / ".agent.abcd1234"
    (aside / "new").mkdir(parents=True)
    (aside / "new" / "agent.json").write_text("{")
    # Killed between the two renames: the old agent is put back.
    (half / "agent").rename(aside / "old")
    stopped(half, 1, resume=True)
    assert (half / "agent" / "agent.json").read_bytes() == kept
    train(small_config(), half, 3, resume=True)
    assert hidden(half) == []


# ---- runs that are left alone ------------------------------------------------------------------


def test_a_finished_run_is_left_as_it_is(whole):
    folder = whole("ppo")
    before = contents(folder)
    times = {name: (folder / name).stat().st_mtime_ns for name in before}
    record = train(small_config(), folder, 3, resume=True)
    assert (record["finished"], record["steps"]) == (True, 1600)
    assert record == run_status(folder)
    assert contents(folder) == before
    assert {name: (folder / name).stat().st_mtime_ns for name in before} == times


def test_a_folder_with_a_run_is_refused_without_resume(whole, half):
    for folder, state in ((whole("ppo"), "finished"), (half, "at 832 steps")):
        before = contents(folder)
        with refuses(RunExistsError, f"holds a run ({state})", "--resume"):
            train(small_config(), folder, 3)
        assert contents(folder) == before


@pytest.mark.parametrize(
    "text", [None, "{", '{"steps": 3}', "[]", '{"steps": "x", "finished": false}']
)
def test_a_checkpoint_without_a_sound_record_is_not_resumed(text, half):
    """Nothing says then whether it belongs to this configuration and seed."""
    if text is None:
        (half / "run.json").unlink()
    else:
        (half / "run.json").write_text(text)
    before = contents(half)
    for resume in (False, True):
        with refuses(SwimError, str(half)):
            train(small_config(network={"layers": [4]}), half, 5, resume=resume)
    assert contents(half) == before


CHANGES: list[tuple[dict[str, Any], str]] = [
    ({"network": {"layers": [4]}}, "network"),
    ({"evaluation": {"every": 601, "episodes": 2}}, "evaluation"),
    ({"ppo": {"rollout": 16, "minibatch": 32, "epochs": 3}}, "ppo"),
    ({"environment": {"effort_weight": 0.1}}, "environment"),
    ({"overrides": {"beam.elements": 3, "episode.duration": 0.4}}, "scene"),
]


@pytest.mark.parametrize(("changes", "name"), CHANGES)
def test_another_configuration_is_refused_and_the_field_named(changes, name, whole):
    folder = whole("ppo")
    before = contents(folder)
    with refuses(
        ConfigError, f"another configuration, {name} differs", str(folder / "config.yaml")
    ):
        train(small_config(**changes), folder, 3, resume=True)
    assert contents(folder) == before


# ---- prolonged runs ----------------------------------------------------------------------------

#: The rates and the evaluations of a long run are those of a short one in its first 800 steps.
STEADY: dict[str, Any] = {
    "final_learning_rate": None,
    "evaluation": {"every": 400, "episodes": 2},
    "checkpoint_every": 400,
}


@pytest.mark.parametrize("kind", ["ppo", "sac", "target"])
def test_a_prolonged_run_is_the_longer_run(kind, tmp_path):
    short, long = (small_config(kind, steps=steps, **STEADY) for steps in (800, 1600))
    one, other = tmp_path / "one", tmp_path / "other"
    taken = train(long, one, 3)["steps"]
    half = train(short, other, 3)["steps"]
    record = check_run(long, other, 3, resume=True)
    assert record is not None and (record["finished"], record["steps"]) == (False, half)
    with pytest.raises(Stopped):
        train(long, other, 3, resume=True, progress=stop_at(half + 300))
    assert load_config(other / "config.yaml").steps == 1600
    assert train(long, other, 3, resume=True)["steps"] == taken
    assert_same_run(one, other)
    assert load_config(other / "config.yaml") == long
    assert (run_status(other) or {})["finished"]


def test_the_rate_of_a_prolonged_run_is_that_of_its_new_length(tmp_path):
    short, long = small_config(steps=640), small_config(steps=1280)
    for config in (short, long):
        train(config, tmp_path, 3, resume=True)
    log = read_log(tmp_path / "progress.csv")
    rates = [(short if now <= 640 else long).learning_rate_at(int(now)) for now in log["steps"]]
    assert log["learning_rate"] == rates
    assert log["steps"][-1] == 1280


def test_a_run_cannot_be_prolonged_to_what_it_has_taken_or_without_its_checkpoint(whole, tmp_path):
    folder = Path(shutil.copytree(whole("ppo"), tmp_path / "run"))
    before = contents(folder)
    for steps in (1, 1599):
        with refuses(
            ConfigError, "has taken 1,600 steps of 1,600: steps must be more", f"{steps:,}"
        ):
            train(small_config(steps=steps), folder, 3, resume=True)
    with refuses(ConfigError, "another configuration, network differs"):
        train(small_config(steps=3200, network={"layers": [4]}), folder, 3, resume=True)
    assert contents(folder) == before
    (folder / "checkpoint.zip").unlink()
    with refuses(CheckpointError, "cannot be prolonged without its checkpoint.zip"):
        train(small_config(steps=3200), folder, 3, resume=True)


def test_another_seed_or_device_is_refused_by_name(half):
    with refuses(ConfigError, "the run was begun with seed 3, not 4"):
        train(small_config(), half, 4, resume=True)
    (half / "run.json").write_text(json.dumps({**(run_status(half) or {}), "device": "cuda"}))
    with refuses(ConfigError, "the run was begun with device cuda, not cpu"):
        train(small_config(), half, 3, resume=True)


# Four members and evaluations from 1,000,000 on.
@pytest.mark.parametrize("seed", [-1, 250_000, 2**31, True])
def test_a_seed_that_is_none_is_refused(seed, tmp_path):
    with refuses(ConfigError, "seed must be"):
        train(small_config(), tmp_path / "run", seed)
    assert not (tmp_path / "run").exists()


def test_nobody_else_gets_in_during_a_run(tmp_path):
    calls: list[int] = []

    def progress(steps: int, text: str) -> None:
        calls.append(steps)
        before = contents(tmp_path)
        for resume in (False, True):
            with refuses(RunExistsError, "another process is training there"):
                train(small_config(), tmp_path, 3, resume=resume)
        assert contents(tmp_path) == before

    train(small_config(steps=64), tmp_path, 3, progress=progress)
    assert [steps for steps in calls if steps] == [64]
    assert train(small_config(steps=64), tmp_path, 3, resume=True)["finished"]


# ---- damaged files and full disks --------------------------------------------------------------


def test_a_damaged_or_foreign_checkpoint_is_one_clear_error_and_the_run_is_untouched(half):
    path = half / "checkpoint.zip"
    whole = path.read_bytes()
    assert_damage_is_one_clear_error(path, lambda: load_checkpoint(path), CheckpointError, 150)
    torch.save({"format_version": 1}, path)
    for content, problem in (
        (path.read_bytes(), "must be of format version 2, got 1"),
        (whole[: len(whole) // 2], "damaged or cut short"),
    ):
        path.write_bytes(content)
        before = contents(half)
        with refuses(CheckpointError, problem):
            train(small_config(), half, 3, resume=True)
        assert contents(half) == before


def test_a_checkpoint_runs_no_code(half, tmp_path):
    touched, path = tmp_path / "touched", half / "checkpoint.zip"
    torch.save({"format_version": 2, "model": Bomb(touched)}, path)
    with refuses(CheckpointError, "no checkpoint"):
        train(small_config(), half, 3, resume=True)
    assert not touched.exists()
    torch.load(path, weights_only=False)
    assert touched.exists(), "the bomb would not have gone off"


def test_a_full_disk_leaves_the_earlier_checkpoint_to_continue_from(whole, tmp_path):
    path, kept = tmp_path / "checkpoint.zip", list[bytes]()
    with pytest.MonkeyPatch.context() as patch:

        def progress(steps: int, text: str) -> None:
            if path.exists() and not kept:
                kept.append(path.read_bytes())
                patch.setattr("swim_env.files.atomic.os.fsync", full_disk)

        with refuses(CheckpointError, "cannot write the checkpoint: No space left", "--resume"):
            train(small_config(), tmp_path, 3, progress=progress)
    assert path.read_bytes() == kept[0]
    assert hidden(tmp_path) == []
    train(small_config(), tmp_path, 3, resume=True)
    assert_same_run(whole("ppo"), tmp_path)


# stable-baselines3 leaves the file open that it cannot write.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("limit", [300, 5_000, 20_000, 36_000])
def test_files_that_do_not_fit_are_one_clear_error(limit, whole, tmp_path):
    """The limit strikes, in turn, a file of settings, a model, and a checkpoint."""
    with files_of_at_most(limit), refuses(SwimError, "File too large", str(tmp_path)):
        train(small_config(), tmp_path, 3)
    gc.collect()
    assert hidden(tmp_path) == []
    train(small_config(), tmp_path, 3, resume=True)
    assert_same_run(whole("ppo"), tmp_path)


def test_a_folder_or_a_device_that_cannot_be_used_is_one_clear_error(tmp_path):
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file" / "run", tmp_path / "file"):
        with refuses(SwimError, "cannot make the run's folder"):
            train(small_config(), folder)
    with refuses(SwimError, "cannot train on device 'cuda:77'"):
        train(small_config(), tmp_path / "run", device="cuda:77")
    assert not (tmp_path / "run").exists()
