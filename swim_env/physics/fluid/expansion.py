r"""Fluid model ``expansion``: the straight body's matrix and its second derivatives.

.. math:: A(a) = A_0 + \tfrac{1}{2} \sum_{ij} a_i a_j A_{ij}

with the joint angles a. A mirror image turns all joint angles and all velocities around, so A is
even in a: the error of the frozen matrix is of second order in the bend and that of the expansion
of fourth. The constants are the triangles of A_0 and of A_ij, i from the head and j up to i.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.constant import triangle_of
from swim_env.physics.fluid.layout import FluidConstants, FluidWork, motion_count
from swim_env.physics.fluid.model import Costs, Model
from swim_env.physics.fluid.outline import FluidGeometry
from swim_env.physics.fluid.straight import NearlyStraight
from swim_env.physics.runtime.linking import linked_kernel
from swim_env.physics.status import FINE
from swim_env.scene import Fluid

Array = NDArray[np.float64]

#: Bends (rad) from which the second derivatives are extrapolated to none (Richardson): truncation
#: and rounding both stay below 1e-7 of the largest entry there.
_BENDS = (0.02, 0.01)


@linked_kernel
def _added_mass(joint_angles: Array, fluid: FluidConstants, work: FluidWork, out: Array) -> int:
    """Sum A_0 + sum_ij a_i a_j A_ij / 2 over joints, and keep the angles for the shape force."""
    motions = motion_count(fluid)
    entries = motions * (motions + 1) // 2
    total = work.squares
    for entry in range(entries):
        total[entry] = fluid.terms[entry]
    start = entries
    for i in range(joint_angles.size):
        work.joint_gradient[i] = joint_angles[i]
        for j in range(i + 1):
            weight = joint_angles[i] * joint_angles[j] * (0.5 if i == j else 1.0)
            row = fluid.terms[start : start + entries]
            for entry in range(entries):
                total[entry] += weight * row[entry]
            start += entries
    entry = 0
    for a in range(motions):
        for b in range(a + 1):
            out[a, b] = total[entry]
            out[b, a] = total[entry]
            entry += 1
    return FINE


@linked_kernel
def _shape_force(motion: Array, fluid: FluidConstants, work: FluidWork, out: Array) -> None:
    """Differentiate V^T A V / 2: sum_j a_j V^T A_ij V / 2 for joint i, then by elements."""
    elements = fluid.geometry.elements
    motions = motion_count(fluid)
    entries = motions * (motions + 1) // 2
    squares = work.squares
    entry = 0
    for a in range(motions):
        for b in range(a + 1):
            squares[entry] = motion[a] * motion[b] * (0.5 if a == b else 1.0)
            entry += 1
    out[:] = 0.0
    angles = work.joint_gradient
    start = entries
    for i in range(elements - 1):
        for j in range(i + 1):
            row = fluid.terms[start : start + entries]
            energy = 0.0
            for entry in range(entries):
                energy += row[entry] * squares[entry]
            start += entries
            # A joint turns the element behind it against the one in front.
            out[i + 1] += angles[j] * energy
            out[i] -= angles[j] * energy
            if j < i:
                out[j + 1] += angles[i] * energy
                out[j] -= angles[i] * energy


@lru_cache(maxsize=32)
def _triangles(geometry: FluidGeometry, density: float) -> Array:
    """Return the triangles of A_0 and of A_ij, i from the head and j up to i.

    Differences of A at small bends; as A is even, A(h e_i) - A_0 and
    A(h e_i + h e_j) - A(h e_i - h e_j) are enough.
    """
    shapes = NearlyStraight(geometry, density)
    joints = geometry.elements - 1
    straight = shapes.added_mass(np.zeros(joints))
    rows = [triangle_of(straight)]
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
            rows.append(triangle_of((4.0 * fine - coarse) / 3.0))
    terms = np.concatenate(rows)
    terms.flags.writeable = False
    return terms


def _terms(fluid: Fluid, geometry: FluidGeometry) -> Array:
    return _triangles(geometry, fluid.density or 0.0)


def _squares(motions: int) -> int:
    return motions * (motions + 1) // 2


def _costs(elements: int, panels: int) -> Costs:
    return 1e-9 * elements**4, 1e-9 * elements**4


MODEL = Model(_added_mass, _shape_force, varies=True, terms=_terms, squares=_squares, costs=_costs)
