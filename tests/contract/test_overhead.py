"""Python's part of an environment step; run with -s, and alone, to see the figures."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from swim_env.envs import episodes
from swim_env.sim.batch import Bodies
from tests.support import make, make_batch

pytestmark = pytest.mark.release

ROUNDS, STEPS = 7, 60


@pytest.mark.parametrize(
    ("members", "threads", "most"), [(None, None, 20.0), (64, 1, 3.0), (64, 2, 3.0)]
)
def test_a_step_costs_few_microseconds_a_member_beside_the_physics(
    members, threads, most, monkeypatch
):
    """The time of a step less that of the kernels for physics and observations in it.

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
    env: Any = make() if members is None else make_batch(num_envs=members, num_threads=threads)
    env.reset(seed=0)
    random = np.random.default_rng(0)
    medians = []
    for _ in range(ROUNDS):
        costs = []
        for _ in range(STEPS):
            actions = random.uniform(-1.0, 1.0, env.action_space.shape)
            spent[0] = 0.0
            start = time.perf_counter()
            env.step(actions)
            costs.append(time.perf_counter() - start - spent[0])
        medians.append(1e6 * float(np.median(costs)))
    cost = min(medians) / (members or 1)
    print(f"{members or 1} members, {threads or 1} threads: {cost:.2f} us a member")
    assert cost < most
