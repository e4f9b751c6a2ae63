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
    draws, workers : int
        Number of random runs, and of processes side by side (one for each processor unless given).
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
    found: dict[int, Any] = {}
    with closing(in_fresh_processes(calls, workers, load_kernels)) as results:
        for index, result in results:
            found[index] = result
            progress(1)
    verdicts: list[Verdict] = [found[order.index(i)] for i in range(len(runs))]
    others = [found[i] for i in range(len(runs), len(calls))]
    return {
        **where_and_when(),
        "kernels": kernel_digest(),
        "runs": [
            {**asdict(one), "trusted": one.trusted, "claimed": one.claimed} for one in verdicts
        ],
        "onsets": others[: len(onsets)],
        "drawn": _together(others[len(onsets) :]),
    }


def drawn_runs(first: int, last: int) -> dict[str, Any]:
    """Play the random runs of some seeds; returns what `measure_stability` says of them."""
    verdicts = [play(draw_run(seed)) for seed in range(first, last)]
    return {
        "count": len(verdicts),
        "ends": dict(sorted(Counter(one.reason for one in verdicts).items())),
        "failures": [f"{one.label}: {text}" for one in verdicts for text in one.failures],
        "untrusted": sum(not one.trusted for one in verdicts),
        "slowest": max((one.slowest for one in verdicts), default=0.0),
    }


def _together(parts: list[dict[str, Any]]) -> dict[str, Any]:
    ends = sum((Counter(part["ends"]) for part in parts), Counter[str]())
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
