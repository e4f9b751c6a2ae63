"""Random torques held for 0.02 s over 10 s: nothing but finite numbers and named ends."""

from dataclasses import fields

import numpy as np
import pytest

from swim_env import TERMINATION_REASONS, Simulator, Trajectory

DURATION = 10.0
HELD = 0.02
KINDS = ("uniform", "bang-bang")
#: Early ends allowed: the damped scene for learning has to last, the paper's need not.
SHARE_THAT_LASTS = {"swimmer": 0.99, "paper_i": 0.0}
#: The undamped beam becomes violent, and each of its steps costs many.
FEW_SEEDS = {"swimmer": range(8), "paper_i": range(4)}


def _play(simulator: Simulator, kind: str, seed: int) -> Trajectory:
    rng = np.random.default_rng(seed)
    shape = (round(DURATION / HELD), simulator.elements - 1)
    held = rng.uniform(-1.0, 1.0, shape) if kind == "uniform" else rng.choice([-1.0, 1.0], shape)
    simulator.reset()
    return simulator.rollout(np.repeat(held, round(HELD / simulator.time_step), axis=0))


def _check(name: str, kind: str, seeds: range) -> None:
    simulator = Simulator(name)
    lasted = 0
    ends: dict[str, int] = {}
    not_finite = []
    for seed in seeds:
        trajectory = _play(simulator, kind, seed)
        assert trajectory.termination_reason in {"", *TERMINATION_REASONS}
        full = trajectory.steps == round(DURATION / simulator.time_step)
        assert full == (trajectory.termination_reason == ""), (
            f"seed {seed}: {trajectory.steps} steps, reason {trajectory.termination_reason!r}"
        )
        lasted += full
        ends[trajectory.termination_reason] = ends.get(trajectory.termination_reason, 0) + 1
        for field in fields(Trajectory):
            values = getattr(trajectory, field.name)
            if isinstance(values, np.ndarray) and not np.isfinite(values).all():
                first = int(np.argwhere(~np.isfinite(values))[0, 0])
                not_finite.append(
                    f"seed {seed}: {field.name}[{first}] of {len(values)} "
                    f"({trajectory.termination_reason})"
                )
    assert not not_finite, f"not finite: {not_finite}"
    share = lasted / len(seeds)
    assert share >= SHARE_THAT_LASTS[name], f"{share:.0%} of the runs lasted, ends {ends}"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SHARE_THAT_LASTS)
def test_a_few_seeds_stay_finite_and_end_by_name(name, kind):
    _check(name, kind, FEW_SEEDS[name])


@pytest.mark.slow
@pytest.mark.ci_slice
@pytest.mark.parametrize("kind", KINDS)
def test_other_seeds_stay_finite_and_end_by_name(kind):
    _check("swimmer", kind, range(100, 120))
    _check("paper_i", kind, range(100, 102))


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SHARE_THAT_LASTS)
def test_a_hundred_seeds_stay_finite_and_end_by_name(name, kind):
    _check(name, kind, range(100))
