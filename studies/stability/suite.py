"""Playing all hard runs side by side, and what is kept of them."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict
from typing import Any

from studies.fingerprint import kernel_digest
from studies.fresh_processes import Call, in_fresh_processes
from studies.stability.cases import hard_runs
from studies.stability.drawn import draw_run
from studies.stability.instability import measure_onset
from studies.stability.runs import HardRun, Verdict, play
from swim_env.files.provenance import where_and_when
from swim_env.physics.loading import load_kernels

__all__ = ["ONSETS", "drawn_runs", "measure_stability", "work_of"]

#: Elements and stiffness (N m^2) of the straight bodies that are watched.
ONSETS = tuple(itertools.product((2, 3, 5, 9, 18, 27), (5.0, 1e4)))
#: Random runs that are played in one go.
_TOGETHER = 200


def work_of(names: tuple[str, ...] | None, draws: int) -> int:
    """Return how many times `measure_stability` calls its progress function."""
    onsets = len(ONSETS) if names is None else 0
    return len(hard_runs(names)) + onsets + -(-draws // _TOGETHER)


def measure_stability(
    names: tuple[str, ...] | None = None,
    draws: int = 100_000,
    workers: int | None = None,
    progress: Callable[[int], object] = lambda done: None,
) -> dict[str, Any]:
    """Play hard runs and judge them.

    Parameters
    ----------
    names : tuple of str, optional
        Only these cases; all of them, and the onset of the instability, unless given.
    draws : int
        Number of random runs.
    workers : int, optional
        Processes side by side, as many as there are processors unless given.
    progress : callable, optional
        Called with 1 after every run and every few hundred random ones.

    Returns
    -------
    dict
        Where and when, ``kernels``, the fingerprint of what was measured, ``runs`` with every
        verdict, ``onsets``, and ``drawn``: how many random runs there were, their ends by reason,
        failures, how many are not to be trusted by their energy, and the slowest step (s).
    """
    load_kernels()
    runs = hard_runs(names)
    onsets = ONSETS if names is None else ()
    # The long ones first, so that none is left over at the end.
    order = sorted(range(len(runs)), key=lambda i: -_cost(runs[i]))
    parts = [(first, min(first + _TOGETHER, draws)) for first in range(0, draws, _TOGETHER)]
    calls: list[Call] = [(play, (runs[i],)) for i in order]
    calls += [(measure_onset, key) for key in onsets]
    calls += [(drawn_runs, part) for part in parts]
    found: list[Any] = [None] * len(calls)
    with closing(in_fresh_processes(calls, workers, load_kernels)) as results:
        for index, result in results:
            found[index] = result
            progress(1)
    verdicts: dict[int, Verdict] = dict(zip(order, found, strict=False))
    last = len(runs) + len(onsets)
    return {
        **where_and_when(),
        "kernels": kernel_digest(),
        "runs": [
            {**asdict(one), "trusted": one.trusted, "claimed": one.claimed}
            for _, one in sorted(verdicts.items())
        ],
        "onsets": found[len(runs) : last],
        "drawn": _together(found[last:]),
    }


def drawn_runs(first: int, last: int) -> dict[str, Any]:
    """Play the random runs of some seeds; returns what `measure_stability` says of them."""
    parts = []
    for seed in range(first, last):
        verdict = play(draw_run(seed))
        parts.append(
            {
                "count": 1,
                "ends": {verdict.reason: 1},
                "failures": [f"seed {seed}: {text}" for text in verdict.failures],
                "untrusted": int(not verdict.trusted),
                "slowest": verdict.slowest,
            }
        )
    return _together(parts)


def _together(parts: list[dict[str, Any]]) -> dict[str, Any]:
    ends: Counter[str] = Counter()
    for part in parts:
        ends.update(part["ends"])
    return {
        "count": sum(part["count"] for part in parts),
        "ends": dict(sorted(ends.items())),
        "failures": [text for part in parts for text in part["failures"]],
        "untrusted": sum(part["untrusted"] for part in parts),
        "slowest": max((part["slowest"] for part in parts), default=0.0),
    }


def _cost(run: HardRun) -> float:
    """Return a guess of how long a run takes, in steps of nine elements."""
    steps = run.duration / run.scene.integrator.time_step
    return steps * (run.scene.beam.elements / 9.0) ** 2
