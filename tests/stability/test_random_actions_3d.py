"""Random actions in space: finite numbers, ends with a name, and both stay so for millions."""

from collections import Counter
from typing import Any

import numpy as np
import pytest

from swim_env import TERMINATION_REASONS, SwimVectorEnv

#: Soft, strong and hardly damped: joints pass their limit, and steps cannot be solved.
VIOLENT: dict[str, Any] = {
    "beam.lateral_stiffness": 0.5,
    "beam.dorsoventral_stiffness": 0.5,
    "beam.torsional_stiffness": 0.5,
    "damping.retardation_time": 0.002,
    "episode.duration": 10.0,
}
#: An action for each step, of a body of few elements.
SHORT: dict[str, Any] = {"beam.elements": 4, "episode.control_interval": 0.005}
#: Scene, changes, and share of the actions.
BODIES: list[tuple[str, dict[str, Any], float]] = [
    ("eel_3d", {"fluid.model": "strip"}, 0.05),
    ("fish_3d", {"fluid.model": "frozen"}, 0.05),
    ("eel_3d", {**SHORT, "fluid.model": "frozen"}, 0.44),
    ("fish_3d", SHORT, 0.44),
    # Steps that are cut into many parts take long.
    ("fish_3d", {**VIOLENT, **SHORT}, 0.02),
]


@pytest.mark.timeout(7200)
@pytest.mark.parametrize("task", ["forward", "target"])
@pytest.mark.parametrize(
    "actions", [20_000, pytest.param(10_000_000, marks=[pytest.mark.slow, pytest.mark.release])]
)
def test_random_actions_are_finite_and_end_by_name(task, actions):
    """Uniform, at the limits, and held for a while; the large numbers are 20 million in all."""
    rng = np.random.default_rng(actions)
    ends: Counter[str] = Counter()
    total = 0
    for scene, changes, share in BODIES:
        envs = SwimVectorEnv(64, scene, changes, autoreset_mode="SameStep", task=task)
        envs.reset(seed=1)
        held = np.zeros(envs.action_space.shape)
        for step in range(max(100, round(share * actions / 64))):
            drawn = rng.uniform(-1.0, 1.0, envs.action_space.shape)
            kind = step // 200 % 3
            if kind == 1:
                drawn = np.sign(drawn)
            if kind == 2 and step % 20:
                drawn = held
            held[:] = drawn
            observations, rewards, terminated, truncated, infos = envs.step(drawn)
            total += 64
            assert np.isfinite(observations).all() and np.abs(observations).max() <= 100.0
            assert np.isfinite(rewards).all()
            for key in ("position", "progress", "work", "heading_error", "energy_drift", "time"):
                assert np.isfinite(infos[key]).all(), key
            over = terminated | truncated
            if over.any():
                last = infos["final_info"]
                for reason, early in zip(
                    last["termination_reason"][over], terminated[over], strict=True
                ):
                    assert early == (reason != "")
                    ends[reason] += 1
                for key in ("progress", "work", "heading_error"):
                    assert np.isfinite(last[key][over]).all(), key
    assert total >= 0.99 * actions
    assert set(ends) <= {"", *TERMINATION_REASONS}, ends
    assert sum(ends.values()) - ends[""] > 0, "violent bodies end early"
