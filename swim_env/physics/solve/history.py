"""What a step remembers of those before it: increments and shape forces, to guess its own from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import inlined
from swim_env.physics.solve.state import KNOWN_INCREMENTS, LAST_PART

Array = NDArray[np.float64]


@inlined
def extrapolate(
    part: int, history: Array, shape_history: Array, counters: Array, increment: Array, shape: Array
) -> None:
    """Guess increment and shape force of a part from those before it.

    Beyond h0 + h1 - h2 the stiff modes, which turn by many radians a step, are carried away.
    """
    ratio = part / counters[LAST_PART]
    known = counters[KNOWN_INCREMENTS] if ratio == 1.0 else 1.0
    for i in range(increment.size):
        increment[i] = ratio * history[0, i]
        if known == 3.0:
            increment[i] += history[1, i] - history[2, i]
    for k in range(shape.size):
        shape[k] = ratio * ratio * shape_history[0, k]
        if known == 3.0:
            shape[k] += shape_history[1, k] - shape_history[2, k]


@inlined
def remember(
    part: int, increment: Array, shape: Array, history: Array, shape_history: Array, counters: Array
) -> None:
    """Keep increment and shape force of a part for the next guess."""
    for i in range(increment.size):
        history[2, i] = history[1, i]
        history[1, i] = history[0, i]
        history[0, i] = increment[i]
    for k in range(shape.size):
        shape_history[2, k] = shape_history[1, k]
        shape_history[1, k] = shape_history[0, k]
        shape_history[0, k] = shape[k]
    known = counters[KNOWN_INCREMENTS] if part == int(counters[LAST_PART]) else 0.0
    counters[KNOWN_INCREMENTS] = min(known + 1.0, 3.0)
    counters[LAST_PART] = part
