"""Named views of flat buffers: the same functions lay arrays out and compute their size."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Rows are padded to a multiple of this, so that loops over them fill vector registers and leave no
#: rest, and begin at a cache line.
LANES = 8


class _Measure:
    """A buffer of any length; every view of it is the buffer itself."""

    def __getitem__(self, key: object) -> _Measure:
        return self

    def reshape(self, shape: object) -> _Measure:
        return self


#: A buffer to measure with.
MEASURE: Any = _Measure()


def padded(count: int) -> int:
    """Return a count rounded up to a multiple of LANES."""
    return (count + LANES - 1) // LANES * LANES


def vector(buffer: Array, start: int, size: int) -> tuple[Array, int]:
    """Return a view (size,) of the buffer from an index on, and the index behind it."""
    end = start + size
    return buffer[start:end], end


def matrix(buffer: Array, start: int, rows: int, columns: int) -> tuple[Array, int]:
    """Return a view (rows, columns) of the buffer from an index on, and the index behind it."""
    end = start + rows * columns
    return buffer[start:end].reshape((rows, columns)), end
