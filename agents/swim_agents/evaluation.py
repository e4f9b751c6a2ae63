"""Playing many episodes side by side, one for each seed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from swim_agents.baselines import Policy
from swim_agents.rollout import EpisodeLog, Rollout
from swim_env.envs.vector import SwimVectorEnv
from swim_env.errors import OptionError

__all__ = ["play_episodes"]


def play_episodes(
    env: SwimVectorEnv,
    policy: Policy,
    seeds: Sequence[int],
    options: Mapping[str, Any] | None = None,
    deterministic: bool = True,
    progress: Callable[[int], object] | None = None,
) -> list[Rollout]:
    """Play one episode for each seed.

    With the same actions an episode is bit for bit the one that `play_episode` plays. The
    actions of a network can differ from those in the last digit, since a product of matrices may
    round otherwise for a batch.

    Parameters
    ----------
    env : SwimVectorEnv
        A batch of as many members, in autoreset mode NEXT_STEP; else it is an OptionError.
    policy, options, deterministic
        As for `play_episode`, the same for all.
    seeds : sequence of int
        Of the starts.
    progress : callable, optional
        Called with 1 after every action of the batch.

    Returns
    -------
    list of Rollout
        One for each seed.
    """
    count = len(seeds)
    if env.num_envs != count or env.autoreset_mode is not AutoresetMode.NEXT_STEP:
        raise OptionError(
            f"play_episodes needs a batch of {count} members in mode NextStep, got "
            f"{env.num_envs} in mode {env.autoreset_mode.value}"
        )
    observations, infos = env.reset(
        seed=list(seeds), options=None if options is None else dict(options)
    )
    episodes = env.episodes
    logs = [
        EpisodeLog(episodes, member, int(seed), infos["position"][member])
        for member, seed in enumerate(seeds)
    ]
    ended: dict[int, Rollout] = {}
    state: Any = None
    start = np.ones(count, dtype=np.bool_)
    while len(ended) < count:
        actions, state = policy.predict(observations, state, start, deterministic)
        observations, rewards, terminated, truncated, infos = env.step(actions)
        start = np.zeros(count, dtype=np.bool_)
        for member, log in enumerate(logs):
            if member in ended:
                continue
            log.add(rewards[member], infos["position"][member])
            ends = terminated[member], truncated[member]
            if any(ends):
                ended[member] = log.rollout(episodes.info(member), *ends)
        if progress is not None:
            progress(1)
    return [ended[member] for member in range(count)]
