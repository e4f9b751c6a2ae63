"""Timings on shared machines: several callables in turn, round after round, medians with spread.

The speed of a shared machine drifts by half within minutes. What is to be compared is therefore
timed in the same rounds, and compared by the ratios of times of the same round.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

#: Called with the number of things done since the last call.
Progress = Callable[[int], object]


def no_progress(done: int) -> None:
    """Tell nobody how far the work is."""


class Spread(NamedTuple):
    """Median, lower and upper quartile, smallest value and number of repeated measurements.

    Other programs only ever add to a time, which is why the smallest is kept.
    """

    median: float
    low: float
    high: float
    smallest: float
    rounds: int

    def as_dict(self) -> dict[str, Any]:
        """Return the fields by name, for JSON."""
        return self._asdict()


def spread_of(values: ArrayLike) -> Spread:
    """Return the spread of measurements, at least one."""
    numbers = np.asarray(values, dtype=np.float64).ravel()
    low, median, high = np.quantile(numbers, (0.25, 0.5, 0.75))
    return Spread(float(median), float(low), float(high), float(numbers.min()), numbers.size)


def time_in_turn(
    calls: Mapping[str, Callable[[], object]], *, rounds: int, after_round: Progress = no_progress
) -> dict[str, np.ndarray]:
    """Time callables in turn, each `rounds` times, after one call each to warm up.

    Returns
    -------
    dict of str to (rounds,) array
        Seconds of every call; entries with the same index come from the same round.
    """
    for call in calls.values():
        call()
    seconds = {name: np.empty(rounds) for name in calls}
    for index in range(rounds):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            seconds[name][index] = time.perf_counter() - start
        after_round(1)
    return seconds


def ratio(above: np.ndarray, below: np.ndarray) -> Spread:
    """Return the spread of the ratios of two arrays of times, round by round."""
    return spread_of(above / below)
