"""Timings on shared machines: several callables in turn, round after round, medians with spread.

The speed of a shared machine drifts by half within minutes. What is to be compared is therefore
timed in the same rounds, and compared by the ratios of the times that stand next to each other.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["Spread", "ratio", "spread_of", "time_in_turn"]


class Spread(NamedTuple):
    """The median of repeated measurements and how far they lie apart.

    Attributes
    ----------
    median, low, high : float
        Median and the quartiles below and above it.
    smallest : float
        The smallest value: other programs only ever add to a time.
    rounds : int
        Number of measurements.
    """

    median: float
    low: float
    high: float
    smallest: float
    rounds: int

    def scaled(self, factor: float) -> Spread:
        """Return the spread in another unit."""
        return Spread(
            factor * self.median,
            factor * self.low,
            factor * self.high,
            factor * self.smallest,
            self.rounds,
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the fields by name, for JSON."""
        return self._asdict()


def spread_of(values: ArrayLike) -> Spread:
    """Return the spread of a list of measurements, at least one."""
    numbers = np.asarray(values, dtype=np.float64).ravel()
    low, median, high = np.quantile(numbers, (0.25, 0.5, 0.75))
    return Spread(float(median), float(low), float(high), float(numbers.min()), numbers.size)


def time_in_turn(
    calls: Mapping[str, Callable[[], object]],
    *,
    rounds: int,
    after_round: Callable[[int], object] | None = None,
) -> dict[str, np.ndarray]:
    """Time several callables in turn, round after round.

    Parameters
    ----------
    calls : mapping of str to callable
        What to time; called once before the first round to warm up.
    rounds : int
        How often each is timed, at least 1.
    after_round : callable, optional
        Called with 1 after every round, for progress bars.

    Returns
    -------
    dict of str to (rounds,) array
        Seconds of every call; entries of one index come from the same round.
    """
    for call in calls.values():
        call()
    seconds = {name: np.empty(rounds) for name in calls}
    for index in range(rounds):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            seconds[name][index] = time.perf_counter() - start
        if after_round is not None:
            after_round(1)
    return seconds


def ratio(above: np.ndarray, below: np.ndarray) -> Spread:
    """Return the spread of the ratios of two lists of times, pair by pair of the same round."""
    return spread_of(above / below)
