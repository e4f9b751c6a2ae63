"""The energy budget of a run: what start, work and losses explain, and what they do not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import kernel
from swim_env.physics.solve.state import (
    DISSIPATED,
    ENERGY,
    EXPLAINED,
    LARGEST,
    LOST,
    UNEXPLAINED,
    WORK,
)

Array = NDArray[np.float64]


@kernel
def begin_budget(energy: float, counters: Array) -> None:
    """Begin with the energy (J) of a start."""
    counters[EXPLAINED] = energy
    counters[LARGEST] = energy
    counters[LOST] = 0.0
    counters[UNEXPLAINED] = 0.0


@kernel
def keep_budget(counters: Array, record: Array) -> None:
    """Compare the energy after a step with what start, work and losses explain."""
    counters[EXPLAINED] += record[WORK] - record[DISSIPATED]
    counters[LOST] += max(record[DISSIPATED], 0.0)
    counters[LARGEST] = max(counters[LARGEST], record[ENERGY])
    gap = abs(record[ENERGY] - counters[EXPLAINED])
    if not gap <= counters[UNEXPLAINED]:
        counters[UNEXPLAINED] = gap if gap == gap else np.inf
