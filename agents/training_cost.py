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

from agents.vec_env import make_swim_vec_env
from swim_env.benchmark.timing import spread_of
from swim_env.errors import OptionError
from swim_env.threads import usable_threads

__all__ = ["ALGORITHMS", "PARTS", "measure_training"]

#: Where the time goes: `Bodies.advance`; the rest of `VecEnv.step`, in Python and the kernels of
#: observations; actions and values for the rollout; gradient updates; and what is left.
PARTS = ("physics", "environment", "policy", "learner", "other")

#: Arguments of stable-baselines3's algorithms. PPO plays 128 steps of 64 members, 8192 in all, and
#: goes over them in minibatches of 2048; SAC makes one update every 16 environment steps.
ALGORITHMS: dict[str, dict[str, Any]] = {
    "PPO": {"n_steps": 128, "batch_size": 2048, "n_epochs": 5},
    "SAC": {
        "batch_size": 256,
        "buffer_size": 100_000,
        "gradient_steps": 4,
        "learning_starts": 1024,
        "train_freq": 1,
    },
}

#: Steps of the batch in one round of SAC, whose own rounds are single steps.
_SAC_STEPS = 32


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
    algorithm: str,
    *,
    seconds: float = 15.0,
    members: int = 64,
    threads: int | None = None,
    torch_threads: int = 1,
    scene: str = "swimmer",
    settings: dict[str, Any] | None = None,
    progress: Callable[[int], object] | None = None,
) -> dict[str, Any]:
    """Train for a while and say where the time went.

    Parameters
    ----------
    algorithm : str
        One of ALGORITHMS, with an MLP policy on the processor.
    seconds : float
        Rounds are played until that much time is over, at least two; a first one that warms up
        does not count. A round of PPO is a rollout and its update, one of SAC 32 steps of the batch
        with their updates.
    members : int
        Size of the batch.
    threads : int, optional
        Threads of the batch; as many as numba is told to use unless given.
    torch_threads : int
        Threads of PyTorch, whose number is set for the run and set back after it.
    scene : str
        What swims.
    settings : dict, optional
        Changes to the algorithm's arguments.
    progress : callable, optional
        Called with the whole seconds that are over since the last call.

    Returns
    -------
    dict
        ``algorithm``, ``scene``, ``members``, ``environment_threads``, ``torch_threads``,
        ``device``, ``settings``; ``rounds``, environment ``steps`` and ``seconds`` in them;
        ``shares`` of PARTS in all that time, which sum to 1, and ``shares_spread`` over the rounds;
        the spread ``steps_per_second``.

    Raises
    ------
    OptionError
        If there is no such algorithm.
    SwimError
        If an argument of the environment cannot be used.
    """
    if algorithm not in ALGORITHMS:
        raise OptionError(f"unknown algorithm {algorithm!r}; algorithms: {', '.join(ALGORITHMS)}")
    import stable_baselines3
    import torch
    from stable_baselines3.common.vec_env import VecMonitor

    options = {**ALGORITHMS[algorithm], **(settings or {})}
    threads = threads or usable_threads()
    batch = make_swim_vec_env(num_envs=members, seed=0, scene=scene, num_threads=threads)
    venv = VecMonitor(batch)
    steps_per_round = members * options.get("n_steps", _SAC_STEPS)
    threads_before = torch.get_num_threads()
    torch.set_num_threads(torch_threads)
    try:
        model = getattr(stable_baselines3, algorithm)(
            "MlpPolicy", venv, device="cpu", seed=0, **options
        )
        timers = Timers()
        timers.wrap(batch.env.episodes.bodies, "advance", "physics")
        timers.wrap(venv, "step", "environment")
        # PPO asks the policy for actions and values at once, SAC by `predict`.
        for method in ("forward", "predict", "predict_values"):
            if hasattr(model.policy, method):
                timers.wrap(model.policy, method, "policy")
        timers.wrap(model, "train", "learner")
        warm_up = steps_per_round + options.get("learning_starts", 0)
        rounds = _play(model, timers, warm_up, steps_per_round, seconds, progress)
    finally:
        torch.set_num_threads(threads_before)
        venv.close()
    total = sum(elapsed for elapsed, _ in rounds)
    spent = {part: sum(parts[part] for _, parts in rounds) for part in PARTS}
    return {
        "algorithm": algorithm,
        "scene": scene,
        "members": members,
        "environment_threads": threads,
        "torch_threads": torch_threads,
        "device": "cpu",
        "settings": options,
        "rounds": len(rounds),
        "steps": len(rounds) * steps_per_round,
        "seconds": total,
        "shares": {part: spent[part] / total for part in PARTS},
        "shares_spread": {
            part: spread_of([parts[part] / elapsed for elapsed, parts in rounds]).as_dict()
            for part in PARTS
        },
        "steps_per_second": spread_of(
            [steps_per_round / elapsed for elapsed, _ in rounds]
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
