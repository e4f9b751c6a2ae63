"""A training that is killed and resumed gives what the uninterrupted run gives."""

import random
import signal
import time
from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3")

from swim_agents.learning.checkpoints import load_checkpoint
from swim_agents.learning.config import TrainingConfig
from swim_agents.learning.trainer import run_status, train

from tests.learning.small_runs import assert_same_run, hidden, small_config
from tests.support import interrupt_script, run_python, run_script

SEED = 3


def arguments_of(config: TrainingConfig, output: Path) -> list[str]:
    """Return the command's arguments for a run in the folder OUTPUT/seed_3."""
    path = output.parent / "config.yaml"
    config.save(path)
    options = ["--seeds", str(SEED), "--threads", "1", "--output", str(output), "--resume"]
    return [str(path), *options]


def steps_reached(folder: Path) -> int:
    """Return the steps of the last whole line of the evaluations, -1 before the first."""
    try:
        lines = (folder / "evaluations.csv").read_text().split("\n")[1:-1]
    except FileNotFoundError:
        return -1
    return int(lines[-1].split(",")[0]) if lines else -1


def kill_after(arguments: list[str], folder: Path, steps: int, seconds: float) -> None:
    """Kill a process some time after its start (-1) or after an evaluation at so many steps."""

    def when() -> bool:
        reached = steps_reached(folder) >= steps
        time.sleep(seconds if reached else 0.0)
        return reached

    done = interrupt_script("train", *arguments, when=when, how=signal.SIGKILL)
    assert done.code == -signal.SIGKILL, "the run ended before it was killed"


def checkpoint_steps(folder: Path) -> int:
    """Return the steps of the checkpoint, 0 without one; one that is there must be loadable."""
    path = folder / "checkpoint.zip"
    if not path.exists():
        return 0
    return int(load_checkpoint(path)["model"]["counters"]["num_timesteps"])


def assert_finished_like(folder: Path, other: Path, steps: int) -> None:
    record = run_status(folder)
    assert record is not None
    assert (record["finished"], record["steps"]) == (True, steps)
    assert_same_run(other, folder)
    assert hidden(folder) == []


def test_a_killed_run_continues_to_the_same_end(tmp_path):
    steps = 3200
    config = small_config("ppo", steps=steps)
    arguments = arguments_of(config, tmp_path / "killed")
    folder = tmp_path / "killed" / f"seed_{SEED}"
    kill_after(arguments, folder, 1200, 0.1)
    assert 832 <= checkpoint_steps(folder) < steps
    assert run_script("train", *arguments).code == 0
    train(config, tmp_path / "whole", SEED)
    assert_finished_like(folder, tmp_path / "whole", steps)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("kind", "seed"),
    [pytest.param("ppo", 1, marks=pytest.mark.ci_slice), ("ppo", 2), ("sac", 1), ("sac", 2)],
)
def test_a_run_that_was_killed_again_and_again_ends_like_one_that_was_not(kind, seed, tmp_path):
    steps, numbers = 16000, random.Random(seed)
    config = small_config(kind, steps=steps)
    arguments = arguments_of(config, tmp_path / "killed")
    folder = tmp_path / "killed" / f"seed_{SEED}"
    # While Python starts, while the run is set up, and three times along the way.
    moments = [(-1, numbers.uniform(0.0, 1.0)), (-1, numbers.uniform(1.0, 5.0))]
    for share in sorted(numbers.uniform(0.15, 0.85) for _ in range(3)):
        moments.append((int(share * steps), numbers.uniform(0.0, 0.3)))
    before = 0
    for reached, seconds in moments:
        kill_after(arguments, folder, reached, seconds)
        now = checkpoint_steps(folder)
        assert before <= now < steps
        before = now
    assert before > 0, "it was never killed after a checkpoint"
    assert run_script("train", *arguments).code == 0
    train(config, tmp_path / "whole", SEED)
    assert_finished_like(folder, tmp_path / "whole", steps)


# ---- kills at the worst moments ----------------------------------------------------------------

#: Kills its own process just before or just after the N-th time that a function makes a file or
#: folder NAME safe or moves it into its place.
DRIVER = """
import os, pathlib, signal, sys
from swim_agents.learning.config import load_config
from swim_agents.learning.trainer import train

config, folder, seed, function, name, number, after = sys.argv[1:]
owner = pathlib.Path if function == "rename" else os
real, calls = getattr(owner, function), 0

def patched(first, *rest):
    global calls
    target = rest[0] if rest else os.readlink(f"/proc/self/fd/{first}")
    calls += name in os.path.basename(target)
    if calls == int(number) and after == "False":
        os.kill(os.getpid(), signal.SIGKILL)
    result = real(first, *rest)
    if calls == int(number):
        os.kill(os.getpid(), signal.SIGKILL)
    return result

setattr(owner, function, patched)
train(load_config(config), folder, int(seed), resume=True, threads=1)
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
def test_a_kill_while_a_file_takes_its_place_does_no_harm(function, name, number, after, tmp_path):
    config, folder = small_config("ppo", name="small"), tmp_path / "killed"
    config.save(tmp_path / "config.yaml")
    moment = (function, name, str(number), str(after))
    done = run_python("-c", DRIVER, tmp_path / "config.yaml", folder, str(SEED), *moment)
    assert done.code == -signal.SIGKILL, f"it was not killed: {done.err[-2000:]}"
    checkpoint_steps(folder)
    train(config, folder, SEED, resume=True)
    train(config, tmp_path / "whole", SEED)
    assert_finished_like(folder, tmp_path / "whole", 1600)


def test_an_interrupted_run_says_so_and_continues(tmp_path):
    config = small_config("ppo", steps=3200)
    arguments = arguments_of(config, tmp_path / "runs")
    folder = tmp_path / "runs" / f"seed_{SEED}"
    done = interrupt_script("train", *arguments, when=lambda: steps_reached(folder) >= 1200)
    assert done.code == 130
    assert done.err.endswith("interrupted; --resume continues from the last checkpoint\n")
    assert 0 < checkpoint_steps(folder) < 3200
    assert train(config, folder, SEED, resume=True)["finished"]
    assert hidden(folder) == []
