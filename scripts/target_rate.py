#!/usr/bin/env python
"""Count the unseen targets that an agent reaches, in its scene and in the finer one."""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
from swim_agents import load_policy
from swim_agents.commands.command_line import add_options, print_result, progress_bar, run
from swim_agents.comparison.contest import FIRST_SEED
from swim_agents.learning.saved import AgentPolicy
from swim_agents.rollout import Rollout, play_episode
from swim_agents.verification import fine_scene

from swim_env import Scene, SwimTargetEnv
from swim_env.envs.geometry import geometry_of
from swim_env.errors import SwimError
from swim_env.physics.runtime.threads import usable_threads


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("agent", metavar="AGENT", help="a shipped name, or an agent's folder")
    parser.add_argument("--targets", type=int, default=100, metavar="N", help="100 unless given")
    add_options(parser, "json")
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    options = _parser().parse_args(arguments)
    if options.targets < 1:
        raise SwimError(f"--targets must be at least 1, got {options.targets}")
    policy = load_policy(options.agent)
    if not isinstance(policy, AgentPolicy) or policy.description["task"] != "target":
        raise SwimError(f"{options.agent} is no agent that was trained on the task target")
    scene = policy.scene
    seeds = range(FIRST_SEED, FIRST_SEED + options.targets)
    found: dict[str, list[Rollout]] = {}
    with progress_bar(2 * options.targets, "episode", "targets") as progress:

        def play(played: Scene, seed: int) -> Rollout:
            env = SwimTargetEnv(played, **policy.description["environment"])
            rollout = play_episode(env, policy, seed=seed)
            progress(1)
            return rollout

        # The kernels release the interpreter's lock.
        with ThreadPoolExecutor(usable_threads()) as pool:
            for name, played in (("scene", scene), ("finer", fine_scene(scene))):
                geometry_of(played).load()
                found[name] = list(pool.map(partial(play, played), seeds))
    reached = {name: [one.info["success"] for one in runs] for name, runs in found.items()}
    record = {
        "agent": options.agent,
        "targets": options.targets,
        **{f"reached_in_{name}": sum(ones) for name, ones in reached.items()},
        "reached_in_both": sum(map(all, zip(*reached.values(), strict=True))),
        "median_seconds": float(np.median([one.info["time"] for one in found["scene"]])),
        "largest_energy_drift": max(
            one.info["energy_drift"] for runs in found.values() for one in runs
        ),
    }
    print_result(record, options.json, lambda: "\n".join(f"{k}: {v}" for k, v in record.items()))
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
