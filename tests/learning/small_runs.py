"""Training runs of a second, and what two of them must have in common."""

import csv
import os
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

from swim_agents.learning.config import TrainingConfig

from tests.support import files_of, refuses

#: Changes to `small_config`, by name.
KINDS: dict[str, dict[str, Any]] = {
    "ppo": {},
    "ppo_independent_noise": {"state_dependent_noise": False},
    # Rewards scaled by the spread of the returns so far.
    "ppo_own_scale": {"reward_scale": None},
    "target": {"task": "target", "environment": {"effort_weight": 0.1}},
    # The buffer wraps around: it holds 125 transitions of each member.
    "sac": {
        "algorithm": "SAC",
        "sac": {"buffer": 500, "minibatch": 16, "rollout": 4, "updates": 2, "learning_starts": 100},
    },
}
KINDS["sac_independent_noise"] = {**KINDS["sac"], "state_dependent_noise": False}


def small_config(kind: str = "ppo", **changes: Any) -> TrainingConfig:
    """Return a run of a second of four swimmers of three elements, with fields changed."""
    data: dict[str, Any] = {
        "name": f"small_{kind}",
        "scene": "swimmer",
        "overrides": {"beam.elements": 3, "fluid.panels_per_element": 2, "episode.duration": 0.4},
        "members": 4,
        "steps": 1600,
        "learning_rate": 0.01,
        "final_learning_rate": 0.001,
        "reward_scale": 1000.0,
        "network": {"layers": [8]},
        "evaluation": {"every": 600, "episodes": 2},
        "checkpoint_every": 400,
    }
    if not kind.startswith("sac"):
        data["ppo"] = {"rollout": 16, "minibatch": 32, "epochs": 2}
    return TrainingConfig.from_dict({**data, **KINDS[kind], **changes})


def untrained(config: TrainingConfig, seed: int = 0) -> Any:
    """Return the model with which a run begins."""
    from swim_agents.learning.environment import make_training_env
    from swim_agents.learning.models import make_model

    return make_model(config, make_training_env(config, seed, threads=1), seed, "cpu")


class Stopped(Exception):
    """What ends a run in the middle."""


def stop_at(steps: int) -> Callable[[int, str], None]:
    """Return a progress callback that ends a run after a number of steps of this process."""
    taken = 0

    def progress(now: int, text: str) -> None:
        nonlocal taken
        taken += now
        if taken >= steps:
            raise Stopped

    return progress


def table(folder: Path, name: str) -> list[list[str]]:
    """Return the rows of a log, header first, without the column of the wall clock."""
    with open(folder / name, newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    clock = rows[0].index("seconds")
    return [row[:clock] + row[clock + 1 :] for row in rows]


def weights(folder: Path) -> dict[str, bytes]:
    """Return the bits of every parameter of an agent, critics included."""
    from swim_agents.learning.saved import _weights

    kept = _weights(folder / "model.zip")
    return {name: value.numpy().tobytes() for name, value in kept.items()}


def assert_same_run(one: Path, other: Path) -> None:
    """Fail unless two finished runs have the same logs and agents, bit for bit."""
    for name in ("progress.csv", "evaluations.csv"):
        rows = table(one, name)
        assert len(rows) > 1, f"{name} is empty"
        assert rows == table(other, name), name
    for agent in ("agent", "final_agent"):
        assert weights(one / agent) == weights(other / agent), agent


def contents(folder: Path) -> dict[str, bytes]:
    """Return the bytes of all files of a run but its lock, by their path in it."""
    return files_of(folder, leave_out=(".lock",))


def hidden(folder: Path) -> list[str]:
    """Return the names of hidden files and folders in a run but its lock."""
    return sorted(path.name for path in folder.rglob(".*") if path.name != ".lock")


class Bomb:
    """Makes a folder when it is unpickled."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.folder),)


def assert_damage_is_one_clear_error(
    path: Path, load: Callable[[], object], error: type[Exception], tries: int
) -> None:
    """Cut a file short, which is refused, and spoil bytes at random, which often is, in a line."""
    content, numbers, caught = path.read_bytes(), random.Random(1), 0
    for share in (0.0, 0.001, 0.01, 0.5, 0.999):
        path.write_bytes(content[: int(share * len(content))])
        with refuses(error, "damaged or cut short", str(path)):
            load()
    for _ in range(tries):
        damaged = bytearray(content)
        for _ in range(numbers.choice([1, 10, 100])):
            damaged[numbers.randrange(len(damaged))] = numbers.randrange(256)
        path.write_bytes(damaged)
        try:
            load()
        except error as refused:
            caught += 1
            assert str(refused).isprintable()
    assert caught > tries // 5
