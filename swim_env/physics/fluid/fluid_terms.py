r"""Constants of the fluid models that are cheaper than panels.

``strip``: every element carries the added mass of its own length and none of the others',
diag(m' dl, m' dl^3 / 12) per element; m' is by default the plate's mean value rho pi l / 4, the
added mass rho pi l^2 / 4 of a straight plate spread over its length.

``frozen``: the straight body's full matrix, from panels, in the elements' frames.

``expansion``: besides, the second derivatives by the joint angles a at the straight body,

.. math:: A(a) = A_0 + \tfrac{1}{2} \sum_{ij} a_i a_j A_{ij}.

A mirror image turns all joint angles and all velocities around, so A is even in a: the error of the
frozen matrix is of second order in the bend and that of the expansion of fourth.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SwimError
from swim_env.physics.fluid.added_mass import (
    PANELS,
    FluidConstants,
    added_mass,
    carve_fluid_work,
    fluid_work_sizes,
    motion_count,
)
from swim_env.physics.fluid.outline import FluidGeometry, padded
from swim_env.physics.status import FINE, TERMINATION_REASONS

__all__ = ["expansion_terms", "frozen_terms", "plate_added_mass", "strip_terms"]

Array = NDArray[np.float64]

#: Bends (rad) from which the second derivatives are extrapolated to none (Richardson): truncation
#: and rounding both stay below 1e-7 of the largest entry there.
_BENDS = (0.02, 0.01)


def plate_added_mass(density: float, length: float) -> float:
    """Return rho pi l / 4, the mean added mass per length of a straight plate (kg/m)."""
    return 0.25 * math.pi * density * length


def strip_terms(geometry: FluidGeometry, added_mass_per_length: float) -> Array:
    """Return the lower triangle of the strips' A, row by row.

    Parameters
    ----------
    geometry : FluidGeometry
        The chain.
    added_mass_per_length : float
        m' (kg/m).
    """
    n, dl = geometry.elements, geometry.element_length
    lateral = np.full(n, added_mass_per_length * dl)
    rotary = np.full(n, added_mass_per_length * dl**3 / 12.0)
    return _triangle(np.diag(np.concatenate([lateral, rotary])))


@lru_cache(maxsize=32)
def frozen_terms(geometry: FluidGeometry, density: float) -> Array:
    """Return the lower triangle of the straight body's A, row by row.

    Raises
    ------
    SwimError
        If the straight body has no added mass that panels can give.
    """
    terms = _triangle(_Shapes(geometry, density).added_mass(np.zeros(geometry.elements - 1)))
    terms.flags.writeable = False
    return terms


@lru_cache(maxsize=32)
def expansion_terms(geometry: FluidGeometry, density: float) -> Array:
    """Return the triangles of A_0 and of A_ij, i from the head and j up to i.

    Differences of A at small bends; as A is even, A(h e_i) - A_0 and
    A(h e_i + h e_j) - A(h e_i - h e_j) are enough.

    Raises
    ------
    SwimError
        If a shape near the straight one has no added mass that panels can give.
    """
    shapes = _Shapes(geometry, density)
    joints = geometry.elements - 1
    straight = shapes.added_mass(np.zeros(joints))
    rows = [_triangle(straight)]
    unit = np.eye(joints)
    for i in range(joints):
        for j in range(i + 1):
            found = []
            for bend in _BENDS:
                if i == j:
                    change = 2.0 * (shapes.added_mass(bend * unit[i]) - straight)
                else:
                    change = 0.5 * (
                        shapes.added_mass(bend * (unit[i] + unit[j]))
                        - shapes.added_mass(bend * (unit[i] - unit[j]))
                    )
                found.append(change / bend**2)
            coarse, fine = found
            rows.append(_triangle((4.0 * fine - coarse) / 3.0))
    terms = np.concatenate(rows)
    terms.flags.writeable = False
    return terms


class _Shapes:
    """The panels' added mass of shapes of one body."""

    def __init__(self, geometry: FluidGeometry, density: float) -> None:
        self._fluid = FluidConstants(PANELS, geometry, density, False, np.zeros(0))
        floats, integers = fluid_work_sizes(self._fluid)
        self._work = carve_fluid_work(
            np.zeros(floats), np.zeros(integers, dtype=np.int64), self._fluid
        )
        self._size = int(motion_count(self._fluid))

    def added_mass(self, joint_angles: Array) -> Array:
        out = np.zeros((padded(self._size), padded(self._size)))
        status = added_mass(joint_angles, self._fluid, self._work, out)
        if status != FINE:
            raise SwimError(
                "panels give no added mass of the straight body, or of one that is hardly bent: "
                f"{TERMINATION_REASONS[status]}"
            )
        return out[: self._size, : self._size]


def _triangle(matrix: Array) -> Array:
    return np.ascontiguousarray(matrix[np.tril_indices(len(matrix))])
