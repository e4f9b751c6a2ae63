"""Training killed for real: `scripts/train.py --resume` makes the uninterrupted run of it."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("stable_baselines3")

from swim_agents.learning.checkpoints import load_checkpoint
from swim_agents.learning.config import TrainingConfig
from swim_agents.learning.trainer import run_status, train

from tests.learning.small_runs import assert_same_run, hidden, small_config, weights
from tests.support import ENVIRONMENT, ROOT, interrupt_script, run_python, run_script

SEED = 3
PATIENCE = 120.0  # seconds for a process to come to a point, on a busy machine


def arguments_of(config: Path, output: Path) -> list[str]:
    options = ["--seeds", str(SEED), "--threads", "1", "--output", str(output), "--resume"]
    return [str(config), *options]


def finish(arguments: list[str]) -> None:
    """Run a command to its end, which must be a good one."""
    done = run_script("train", *arguments, timeout=PATIENCE)
    assert done.code == 0, done.err[-2000:]


def steps_reached(folder: Path) -> int:
    """Return the steps of the last whole line of the evaluations, -1 before the first."""
    try:
        lines = (folder / "evaluations.csv").read_text().splitlines(keepends=True)
    except FileNotFoundError:
        return -1
    whole = [line for line in lines[1:] if line.endswith("\n")]
    return int(whole[-1].split(",")[0]) if whole else -1


def kill_after(arguments: list[str], folder: Path, steps: int | None, seconds: float) -> None:
    """Kill a process some time after its start, or after an evaluation at so many steps."""
    process = subprocess.Popen(
        [sys.executable, str(ROOT / "scripts" / "train.py"), *arguments],
        cwd=ROOT,
        env=ENVIRONMENT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        limit = time.monotonic() + PATIENCE
        while steps is not None and steps_reached(folder) < steps:
            assert process.poll() is None, "the run ended before it was to be killed"
            assert time.monotonic() < limit, "the run does not come to the point"
            time.sleep(0.01)
        time.sleep(seconds)
        assert process.poll() is None, "the run ended before it was killed"
    finally:
        process.send_signal(signal.SIGKILL)
        code = process.wait(PATIENCE)
    assert code == -signal.SIGKILL


def checkpoint_steps(folder: Path) -> int:
    """Return the steps of the checkpoint, 0 without one; one that is there must be loadable."""
    path = folder / "checkpoint.zip"
    if not path.exists():
        return 0
    return int(load_checkpoint(path)["model"]["counters"]["num_timesteps"])


def written(config: TrainingConfig, folder: Path) -> Path:
    path = folder / "config.yaml"
    config.save(path)
    return path


def assert_finished_like(folder: Path, other: Path, steps: int) -> None:
    record = run_status(folder)
    assert record is not None
    assert record["finished"]
    assert record["steps"] == steps
    assert_same_run(other, folder)
    assert hidden(folder) == []


def test_a_killed_run_continues_to_the_same_end(tmp_path: Path) -> None:
    steps = 3200
    config = small_config("ppo", steps=steps)
    arguments = arguments_of(written(config, tmp_path), tmp_path / "killed")
    folder = tmp_path / "killed" / f"seed_{SEED}"
    kill_after(arguments, folder, 1200, 0.1)
    assert 832 <= checkpoint_steps(folder) < steps
    finish(arguments)
    train(config, tmp_path / "whole", SEED)
    assert_finished_like(folder, tmp_path / "whole", steps)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("seed", [pytest.param(1, marks=pytest.mark.ci_slice), 2])
@pytest.mark.parametrize("kind", ["ppo", "sac"])
def test_a_run_that_was_killed_again_and_again_ends_like_one_that_was_not(
    kind: str, seed: int, tmp_path: Path
) -> None:
    steps = 16000
    path = written(small_config(kind, steps=steps), tmp_path)
    arguments = arguments_of(path, tmp_path / "killed")
    folder = tmp_path / "killed" / f"seed_{SEED}"
    numbers = random.Random(seed)
    # While Python starts, while the run is set up, and three times along the way.
    kill_after(arguments, folder, None, numbers.uniform(0.0, 1.0))
    checkpoint_steps(folder)
    kill_after(arguments, folder, None, numbers.uniform(1.0, 5.0))
    before = checkpoint_steps(folder)
    for share in sorted(numbers.uniform(0.15, 0.85) for _ in range(3)):
        kill_after(arguments, folder, int(share * steps), numbers.uniform(0.0, 0.3))
        now = checkpoint_steps(folder)
        assert before <= now < steps
        before = now
    assert before > 0, "it was never killed after a checkpoint"
    finish(arguments)
    finish(arguments_of(path, tmp_path / "whole"))
    assert_finished_like(folder, tmp_path / "whole" / f"seed_{SEED}", steps)


# ---- kills at the worst moments ----------------------------------------------------------------

#: Kills its own process just before or just after the N-th call of a function that moves a file or
#: folder NAME into its place.
DRIVER = """
import os, pathlib, signal
function, name, number, after = {function!r}, {name!r}, {number}, {after}
owner = os if function in ("replace", "fsync") else pathlib.Path
real, calls = getattr(owner, function), 0

def named(arguments):
    if function == "fsync":
        return os.readlink(f"/proc/self/fd/{{arguments[0]}}")
    return str(arguments[1])

def patched(*arguments):
    global calls
    calls += name in os.path.basename(named(arguments))
    if calls == number and not after:
        os.kill(os.getpid(), signal.SIGKILL)
    result = real(*arguments)
    if calls == number:
        os.kill(os.getpid(), signal.SIGKILL)
    return result

setattr(owner, function, patched)
from swim_agents.learning.config import load_config
from swim_agents.learning.trainer import train
train(load_config({config!r}), {folder!r}, {seed}, resume=True, threads=1)
"""

MOMENTS: list[tuple[str, str, int, bool]] = [
    ("fsync", "checkpoint.zip", 1, False),
    ("fsync", "checkpoint.zip", 2, True),
    ("replace", "checkpoint.zip", 1, True),
    ("replace", "checkpoint.zip", 3, False),
    ("replace", "run.json", 1, False),
    ("replace", "run.json", 2, False),
    ("replace", "config.yaml", 1, False),
    ("replace", "evaluations.csv", 1, True),
    # The agent's folder: the old one moves to `old`, the new one to `agent`.
    ("rename", "old", 1, False),
    ("rename", "old", 1, True),
    ("rename", "agent", 1, True),
    ("rename", "final_agent", 1, False),
    ("rename", "final_agent", 1, True),
]


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(("function", "name", "number", "after"), MOMENTS)
def test_a_kill_while_a_file_takes_its_place_does_no_harm(
    function: str, name: str, number: int, after: bool, tmp_path: Path
) -> None:
    config = small_config("ppo", name="small", steps=1600)
    path = written(config, tmp_path)
    folder = tmp_path / "killed"
    options: dict[str, Any] = {"config": str(path), "folder": str(folder), "seed": SEED}
    code = DRIVER.format(function=function, name=name, number=number, after=after, **options)
    done = run_python("-c", code, timeout=PATIENCE)
    assert done.code == -signal.SIGKILL, f"it was not killed: {done.err[-2000:]}"
    checkpoint_steps(folder)
    train(config, folder, SEED, resume=True)
    train(config, tmp_path / "whole", SEED)
    assert weights(folder / "agent")
    assert_finished_like(folder, tmp_path / "whole", 1600)


def test_an_interrupted_run_says_so_and_continues(tmp_path: Path) -> None:
    config = small_config("ppo", steps=3200)
    arguments = arguments_of(written(config, tmp_path), tmp_path / "runs")
    folder = tmp_path / "runs" / f"seed_{SEED}"
    done = interrupt_script("train", *arguments, when=lambda: steps_reached(folder) >= 1200)
    assert done.code == 130
    assert done.err.endswith("interrupted; --resume continues from the last checkpoint\n")
    assert 0 < checkpoint_steps(folder) < 3200
    assert train(config, folder, SEED, resume=True)["finished"]
    assert hidden(folder) == []
