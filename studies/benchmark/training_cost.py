"""What training spends its time on: physics, environment, policy, learner.

A short training run of stable-baselines3 with timers around its calls. The timers are exclusive: a
call that is timed inside another one is taken off the outer one, so the parts never count a moment
twice, and what no timer sees is left as ``other`` (the algorithm's own bookkeeping: buffers,
advantages, logs).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from swim_agents.learning.config import TrainingConfig
from swim_agents.learning.environment import make_training_env
from swim_agents.learning.models import make_model, torch_threads

from studies.benchmark.timing import spread_of
from swim_env.physics.runtime.threads import usable_threads

__all__ = ["CONFIGS", "PARTS", "measure_training"]

#: Where the time goes: `Bodies.advance`; the rest of `VecEnv.step`, in Python and the kernels of
#: observations; actions and values for the rollout; gradient updates; and what is left.
PARTS = ("physics", "environment", "policy", "learner", "other")

#: Shipped configurations whose training is measured.
CONFIGS = ("ppo_forward", "sac_forward")


class Timers:
    """Timers that may be nested; each counts only what no timer inside it counts.

    Attributes
    ----------
    seconds : dict of str to float
        What each timer has counted since the last `restart`.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._inside = [0.0]

    def restart(self) -> None:
        """Set every timer to zero."""
        self.seconds = {}

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
        """Count every call of an object's method, of this object alone."""
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
    progress: Callable[[int], object] | None = None,
) -> dict[str, Any]:
    """Train for a while and say where the time went.

    Parameters
    ----------
    config : TrainingConfig
        What is trained. Its evaluations and checkpoints are left out.
    seconds : float
        Rounds are played until that much time is over, at least two; a first one that warms up
        does not count. A round is a rollout of all members and the updates after it.
    threads : int, optional
        Threads of the batch; as many as numba is told to use unless given.
    progress : callable, optional
        Called with the whole seconds that are over since the last call.

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
    batch = env.venv.venv
    warm_up = config.round_steps + (config.sac.learning_starts if config.sac is not None else 0)
    try:
        with torch_threads(config.torch_threads):
            model = make_model(config, env, 0, "cpu")
            timers = Timers()
            timers.wrap(batch.env.episodes.bodies, "advance", "physics")
            timers.wrap(env, "step", "environment")
            # PPO asks the policy for actions and values at once, SAC by `predict`.
            for method in ("forward", "predict", "predict_values"):
                if hasattr(model.policy, method):
                    timers.wrap(model.policy, method, "policy")
            timers.wrap(model, "train", "learner")
            rounds = _play(model, timers, warm_up, config.round_steps, seconds, progress)
    finally:
        env.close()
    total = sum(elapsed for elapsed, _ in rounds)
    spent = {part: sum(parts[part] for _, parts in rounds) for part in PARTS}
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
        "shares": {part: spent[part] / total for part in PARTS},
        "shares_spread": {
            part: spread_of([parts[part] / elapsed for elapsed, parts in rounds]).as_dict()
            for part in PARTS
        },
        "steps_per_second": spread_of(
            [config.round_steps / elapsed for elapsed, _ in rounds]
        ).as_dict(),
    }


def _play(
    model: Any,
    timers: Timers,
    warm_up: int,
    steps_per_round: int,
    seconds: float,
    progress: Callable[[int], object] | None,
) -> list[tuple[float, dict[str, float]]]:
    """Train round after round; return the seconds of each, and those of its parts."""
    rounds: list[tuple[float, dict[str, float]]] = []
    model.learn(warm_up)
    begin, told = time.perf_counter(), 0
    while len(rounds) < 2 or time.perf_counter() - begin < seconds:
        timers.restart()
        start = time.perf_counter()
        model.learn(steps_per_round, reset_num_timesteps=False)
        elapsed = time.perf_counter() - start
        parts = {part: timers.seconds.get(part, 0.0) for part in PARTS}
        parts["other"] = elapsed - sum(parts.values())
        rounds.append((elapsed, parts))
        over = min(int(time.perf_counter() - begin), int(seconds))
        if progress is not None and over > told:
            progress(over - told)
            told = over
    return rounds
