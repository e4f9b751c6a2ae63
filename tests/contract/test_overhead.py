"""Python's part of an environment step; run with -s, and alone, to see the figures."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from swim_env import SwimEnv, SwimVectorEnv, episodes
from swim_env.sim.batch import Bodies

pytestmark = pytest.mark.slow

ROUNDS, STEPS = 7, 60


def beside_the_physics(
    monkeypatch: pytest.MonkeyPatch, step: Callable[[np.ndarray], Any], shape: tuple[int, ...]
) -> float:
    """Return the time of a step less that of the kernels for physics and observations in it (us).

    The physics really runs, so that what comes after it finds the processor's caches as it leaves
    them. It is the median of a round, in the best of several rounds: other programs only ever add.
    """
    spent = [0.0]

    def timed(call: Callable[..., None]) -> Callable[..., None]:
        def wrapper(*arguments: Any, **named: Any) -> None:
            start = time.perf_counter()
            call(*arguments, **named)
            spent[0] += time.perf_counter() - start

        return wrapper

    monkeypatch.setattr(Bodies, "advance", timed(Bodies.advance))
    monkeypatch.setattr(episodes, "assess", timed(episodes.assess))
    random = np.random.default_rng(0)
    medians = []
    for _ in range(ROUNDS):
        costs = []
        for _ in range(STEPS):
            actions = random.uniform(-1.0, 1.0, shape)
            spent[0] = 0.0
            start = time.perf_counter()
            step(actions)
            costs.append(time.perf_counter() - start - spent[0])
        medians.append(1e6 * float(np.median(costs)))
    return min(medians)


def test_a_single_step_costs_under_20_microseconds_beside_the_physics(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    env = SwimEnv()
    env.reset(seed=0)
    cost = beside_the_physics(monkeypatch, env.step, (8,))
    print(f"single step beside the physics: {cost:.1f} us")
    assert cost < 20.0


@pytest.mark.parametrize("threads", [1, 2])
def test_a_batched_step_costs_under_3_microseconds_a_member_beside_the_physics(
    monkeypatch: pytest.MonkeyPatch, threads: int
) -> None:
    envs = SwimVectorEnv(64, num_threads=threads)
    envs.reset(seed=0)
    cost = beside_the_physics(monkeypatch, envs.step, (64, 8)) / 64
    print(f"batched step beside the physics, {threads} threads: {cost:.2f} us a member")
    assert cost < 3.0
