"""What training spends its time on: physics, environment, policy, learner.

A short training run of stable-baselines3 with timers around its calls. The timers are exclusive: a
call that is timed inside another one is subtracted from the outer one, so no moment counts twice.
What no timer sees is ``other``: the algorithm's own bookkeeping of buffers, advantages and logs.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from swim_agents.learning.config import TrainingConfig
from swim_agents.learning.environment import make_training_env
from swim_agents.learning.models import make_model, torch_threads

from studies.benchmark.timing import Progress, no_progress, spread_of
from swim_env.physics.runtime.threads import usable_threads

#: Where the time goes: `Bodies.advance`; the rest of `VecEnv.step`, in Python and the kernels of
#: observations; actions and values for the rollout; gradient updates; and what is left.
PARTS = ("physics", "environment", "policy", "learner", "other")

#: Shipped configurations whose training is measured.
CONFIGS = ("ppo_forward", "sac_forward")


class Timers:
    """Timers that may be nested; `seconds` has by name what no timer inside has counted."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._inside = [0.0]

    @contextmanager
    def running(self, name: str) -> Iterator[None]:
        """Count the time of a block."""
        self._inside.append(0.0)
        start = time.perf_counter()
        try:
            yield
        finally:
            elapsed = time.perf_counter() - start
            own = elapsed - self._inside.pop()
            self._inside[-1] += elapsed
            self.seconds[name] = self.seconds.get(name, 0.0) + own

    def wrap(self, owner: Any, method: str, name: str) -> None:
        """Count every call of a method of one object."""
        call: Callable[..., Any] = getattr(owner, method)

        def timed(*arguments: Any, **named: Any) -> Any:
            with self.running(name):
                return call(*arguments, **named)

        setattr(owner, method, timed)


def measure_training(
    config: TrainingConfig,
    *,
    seconds: float = 15.0,
    threads: int | None = None,
    progress: Progress = no_progress,
) -> dict[str, Any]:
    """Train for a while, without evaluations and checkpoints, and measure where the time goes.

    A round is a rollout of all members and the updates after it. A first one warms up; then rounds
    are played for some seconds, at least two. `threads` of the batch are numba's unless given.

    Returns
    -------
    dict
        ``algorithm``, ``config``, ``scene``, ``members``, ``environment_threads``,
        ``torch_threads``, ``device``; ``rounds``, environment ``steps`` and ``seconds`` in them;
        ``shares`` of PARTS in all that time, which sum to 1, and ``shares_spread`` over the rounds;
        the spread ``steps_per_second``.
    """
    threads = threads or usable_threads()
    env = make_training_env(config, 0, threads)
    warm_up = config.round_steps + (config.sac.learning_starts if config.sac is not None else 0)
    try:
        with torch_threads(config.torch_threads):
            model = make_model(config, env, 0, "cpu")
            timers = Timers()
            timers.wrap(env.venv.venv.env.episodes.bodies, "advance", "physics")
            timers.wrap(env, "step", "environment")
            # PPO gets actions and values from `forward`, SAC actions from `predict`.
            for method in ("forward", "predict", "predict_values"):
                if hasattr(model.policy, method):
                    timers.wrap(model.policy, method, "policy")
            timers.wrap(model, "train", "learner")
            model.learn(warm_up)
            rounds = _play(model, timers, config.round_steps, seconds, progress)
    finally:
        env.close()
    elapsed = np.array([one[0] for one in rounds])
    parts = {part: np.array([one[1][part] for one in rounds]) for part in PARTS}
    total = float(elapsed.sum())
    return {
        "algorithm": config.algorithm,
        "config": config.name,
        "scene": config.scene.name,
        "members": config.members,
        "environment_threads": threads,
        "torch_threads": config.torch_threads,
        "device": "cpu",
        "rounds": len(rounds),
        "steps": len(rounds) * config.round_steps,
        "seconds": total,
        "shares": {part: float(values.sum()) / total for part, values in parts.items()},
        "shares_spread": {
            part: spread_of(values / elapsed).as_dict() for part, values in parts.items()
        },
        "steps_per_second": spread_of(config.round_steps / elapsed).as_dict(),
    }


def _play(
    model: Any, timers: Timers, steps_per_round: int, seconds: float, progress: Progress
) -> list[tuple[float, dict[str, float]]]:
    """Train round after round; return the seconds of each, and those of its parts."""
    rounds: list[tuple[float, dict[str, float]]] = []
    begin, passed = time.perf_counter(), 0
    while len(rounds) < 2 or time.perf_counter() - begin < seconds:
        timers.seconds = {}
        start = time.perf_counter()
        model.learn(steps_per_round, reset_num_timesteps=False)
        elapsed = time.perf_counter() - start
        parts = {part: timers.seconds.get(part, 0.0) for part in PARTS}
        parts["other"] = elapsed - sum(parts.values())
        rounds.append((elapsed, parts))
        before, passed = passed, min(int(time.perf_counter() - begin), int(seconds))
        progress(passed - before)
    return rounds
