#!/usr/bin/env python
"""Film episodes of policies side by side, as an animated WebP or GIF."""

from __future__ import annotations

import argparse
import sys

import numpy as np
from numpy.typing import NDArray
from swim_agents import load_policy
from swim_agents.commands.command_line import progress_bar, run
from swim_agents.learning.saved import AgentPolicy

from swim_env import SwimEnv
from swim_env.envs.render.clip import write_clip
from swim_env.errors import SwimError

Frame = NDArray[np.uint8]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", metavar="FILE", help="the clip, .webp or .gif")
    parser.add_argument(
        "--policies",
        nargs="+",
        default=["ppo_forward", "ppo_target_3d"],
        metavar="AGENT",
        help="trained agents, each on its own scene; ppo_forward ppo_target_3d unless given",
    )
    parser.add_argument("--seed", type=int, default=2_000_000, help="of the starts")
    parser.add_argument("--start", type=float, default=0.0, metavar="S", help="where it begins, s")
    parser.add_argument("--seconds", type=float, default=12.0, metavar="S", help="12 unless given")
    parser.add_argument("--speed", type=float, default=1.0, help="of the motion; 1 unless given")
    parser.add_argument("--rate", type=int, default=15, help="frames a second; 15 unless given")
    parser.add_argument("--quality", type=int, default=60, help="of WebP; 60 unless given")
    return parser


def _film(agent: str, options: argparse.Namespace) -> list[Frame]:
    """Return frames of an agent's episode, the last one again where that ends early."""
    policy = load_policy(agent)
    if not isinstance(policy, AgentPolicy):
        raise SwimError(f"{agent} is no trained agent")
    about = policy.description
    env = SwimEnv(
        policy.scene,
        render_mode="rgb_array",
        task=about["task"],
        task_options=about["environment"],
    )
    observation, _ = env.reset(seed=options.seed)
    frames: list[Frame] = []
    state, time, ended = None, 0.0, False
    interval = options.speed / options.rate
    while len(frames) < round(options.seconds * options.rate):
        while not ended and time < options.start + len(frames) * interval:
            action, state = policy.predict(observation, state, deterministic=True)
            observation, _, terminated, truncated, info = env.step(action)
            time, ended = info["time"], terminated or truncated
        frames.append(env.render())
    return frames


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    options = _parser().parse_args(arguments)
    with progress_bar(len(options.policies), "episode", "film") as progress:
        films = []
        for agent in options.policies:
            films.append(_film(agent, options))
            progress(1)
    frames = [np.concatenate(together, axis=1) for together in zip(*films, strict=True)]
    write_clip(options.file, frames, options.rate, quality=options.quality)
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
