"""Kernels shared by the models with constant added mass, strip and frozen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.layout import FluidConstants, FluidWork, motion_count
from swim_env.physics.runtime.compile import kernel
from swim_env.physics.status import FINE

Array = NDArray[np.float64]


def triangle_of(matrix: Array) -> Array:
    """Return the lower triangle of a matrix row by row, as `FluidConstants.terms` holds it."""
    return np.ascontiguousarray(matrix[np.tril_indices(len(matrix))])


@kernel
def constant_added_mass(
    joint_angles: Array, fluid: FluidConstants, work: FluidWork, out: Array
) -> int:
    """Write the matrix whose lower triangle `fluid.terms` holds."""
    entry = 0
    for a in range(motion_count(fluid)):
        for b in range(a + 1):
            out[a, b] = fluid.terms[entry]
            out[b, a] = fluid.terms[entry]
            entry += 1
    return FINE


@kernel
def no_shape_force(motion: Array, fluid: FluidConstants, work: FluidWork, out: Array) -> None:
    """Write zeros: nothing changes with the shape."""
    out[:] = 0.0
