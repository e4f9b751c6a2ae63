#!/usr/bin/env python
"""Train PPO on the shipped tasks, and print its scores beside those of the baselines.

Scores are medians over the same starts, which no training draws; a run's folder is continued if it
is there.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from swim_agents.baselines import Policy
from swim_agents.commands.command_line import add_options, print_result, progress_bar, run
from swim_agents.files import check_file, write_json
from swim_agents.learning.config import TrainingConfig, load_config
from swim_agents.learning.environment import make_batch
from swim_agents.learning.trainer import train
from swim_agents.policies import load_policy
from swim_agents.rollout import play_episodes
from swim_agents.tables import text_table

from swim_env.envs.tasks import TASKS
from swim_env.files.provenance import where_and_when

BASELINES = ("zero", "random", "tuned_wave")
#: What tasks need beside the settings of configuration ppo: a stream to hold a place in, which is
#: half as fast as the tuned wave swims.
_CHANGES: dict[str, dict[str, Any]] = {"station": {"scene.stream.velocity": [0.06, 0.0]}}
_EPISODES, _FIRST_SEED = 20, 2_000_000


def config_of(task: str, steps: int | None) -> TrainingConfig:
    """Return the configuration of a task's training."""
    changes = {"task": task, "name": f"ppo_{task}", **_CHANGES.get(task, {})}
    if steps is not None:
        changes["steps"] = steps
    return load_config("ppo", changes)


def scores(config: TrainingConfig, policy: Policy) -> dict[str, float]:
    """Return the median score of a policy, and the share of episodes that succeeded."""
    env = make_batch(config, _EPISODES, mode=AutoresetMode.NEXT_STEP)
    seeds = range(_FIRST_SEED, _FIRST_SEED + _EPISODES)
    rollouts = play_episodes(env, policy, seeds, any_scene=True)
    return {
        "score": float(np.median([one.score for one in rollouts])),
        "success_rate": float(np.mean([one.info.get("success", False) for one in rollouts])),
        "energy_drift": max(float(one.info["energy_drift"]) for one in rollouts),
    }


def measure(
    config: TrainingConfig, seeds: list[int], folder: Path, progress: Callable[..., object]
) -> dict[str, Any]:
    """Return a task's row."""
    found = {name: scores(config, load_policy(name, "swimmer", 0)) for name in BASELINES}
    agents = []
    for seed in seeds:
        place = folder / config.task / f"seed_{seed}"
        record = train(config, place, seed, resume=True, progress=progress)
        agents.append({**scores(config, load_policy(place)), "seconds": record["seconds"]})
    task = config.make_task()
    return {
        "task": config.task,
        "score": task.score_name,
        "has_success": task.has_success,
        "baselines": found,
        "ppo": agents,
    }


def _table(rows: list[dict[str, Any]]) -> str:
    """Return the rows as text."""
    cells = []
    for row in rows:
        values = sorted(one["score"] for one in row["ppo"])
        succeeded = np.median([one["success_rate"] for one in row["ppo"]])
        cells.append(
            [
                row["task"],
                row["score"],
                *(f"{row['baselines'][name]['score']:.3f}" for name in BASELINES),
                f"{np.median(values):.3f} ({values[0]:.3f} to {values[-1]:.3f})",
                f"{succeeded:.0%}" if row["has_success"] else "",
            ]
        )
    return text_table([("task", "score", *BASELINES, "PPO", "succeed"), *cells])


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", nargs="+", choices=TASKS, default=list(TASKS), metavar="TASK")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2], metavar="N")
    parser.add_argument("--steps", type=int, metavar="N", help="of each training")
    parser.add_argument(
        "--runs", metavar="FOLDER", default="results/tasks", help="where the runs go"
    )
    parser.add_argument("--output", metavar="FILE", help="write the rows into this JSON file")
    add_options(parser, "json")
    options = parser.parse_args(arguments)
    if options.output is not None:
        check_file(options.output)
    rows = []
    for task in options.tasks:
        config = config_of(task, options.steps)
        total = config.steps * len(options.seeds)
        with progress_bar(total, "step", task, unit_scale=True) as progress:
            rows.append(measure(config, options.seeds, Path(options.runs), progress))
        if options.output is not None:
            write_json(options.output, {**where_and_when(), "tasks": rows})
    print_result({"tasks": rows}, options.json, lambda: _table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
