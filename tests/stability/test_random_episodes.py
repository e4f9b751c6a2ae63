"""Random episodes of both environments: finite numbers, named ends, few of them early."""

from collections import Counter

import numpy as np
import pytest

from swim_env import TERMINATION_REASONS
from tests.support import FORWARD, TARGET, each_task, make_batch

#: Actions in an episode of scene swimmer: 20 s over 0.02 s.
LIMIT = 1000
#: Every end that is neither the time limit's nor the target's.
PHYSICS = {"", *TERMINATION_REASONS} - {"", "target_reached"}


@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    ("episodes", "members", "seed"),
    [
        (5, 5, 2024),
        pytest.param(20, 20, 2025, marks=[pytest.mark.slow, pytest.mark.ci_slice]),
        pytest.param(1000, 64, 7, marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("kind", ["uniform", "bang-bang"])
@each_task
def test_random_episodes_are_finite_and_end_by_name(task, kind, episodes, members, seed):
    """At least that many whole episodes."""
    envs = make_batch(task, members, autoreset_mode="SameStep")
    rng = np.random.default_rng(seed)
    observations, _ = envs.reset(seed=seed)
    assert observations in envs.observation_space
    ends: Counter[str] = Counter()
    length = np.zeros(members, dtype=np.int64)
    # Every member plays the same number of episodes, so that short ones do not count for more.
    played = np.zeros(members, dtype=np.int64)
    quota = -(-episodes // members)
    total = np.zeros(members)
    while (played < quota).any():
        actions = rng.uniform(-1.0, 1.0, envs.action_space.shape)
        observations, rewards, terminated, truncated, infos = envs.step(
            actions if kind == "uniform" else np.sign(actions)
        )
        length += 1
        total += rewards
        assert np.isfinite(observations).all(), f"observations after {length}"
        assert np.abs(observations).max() <= 100.0
        assert np.isfinite(rewards).all(), f"rewards after {length}"
        over = terminated | truncated
        np.testing.assert_array_equal(length >= LIMIT, truncated)
        if not over.any():
            assert "final_info" not in infos
            continue
        last = infos["final_info"]
        np.testing.assert_array_equal(infos["_final_info"], over)
        for member in np.flatnonzero(over):
            reason = last["termination_reason"][member]
            assert terminated[member] == (reason != ""), f"an end for {reason!r}"
            assert np.isfinite(infos["final_obs"][member]).all()
            for key in ("progress", "work", "positive_work", "heading_error", "time"):
                assert np.isfinite(last[key][member]), f"{key} at {reason!r}"
            assert abs(total[member] - last["progress"][member]) < 1e-12
            if task == TARGET:
                assert last["success"][member] == (reason == "target_reached")
                assert (last["distance"][member] <= 0.1) == (reason == "target_reached")
            if played[member] < quota:
                ends[reason or "time limit"] += 1
            played[member] += 1
        length[over] = 0
        total[over] = 0.0
    count = ends.total()
    assert count == quota * members >= episodes
    allowed = PHYSICS | {"time limit"} | ({"target_reached"} if task == TARGET else set())
    assert set(ends) <= allowed, ends
    if task == FORWARD:
        assert ends["time limit"] >= 0.99 * count, ends
