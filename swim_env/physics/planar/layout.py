"""Work space of the planar step equations: named arrays in one flat buffer.

The same functions lay the arrays out and, called with `MEASURE` instead of a buffer, measure how
many numbers they take.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.outline import padded
from swim_env.physics.runtime.compile import shared

__all__ = [
    "ADDED",
    "MEASURE",
    "TOTAL",
    "Balance",
    "Body",
    "Drag",
    "Increment",
    "Mass",
    "Newton",
    "Pose",
    "balance_views",
    "drag_views",
    "increment_views",
    "mass_views",
    "matrix",
    "newton_views",
    "pose_views",
    "vector",
]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class _Measure:
    """Stands for a buffer of any length: views of it are itself."""

    def __getitem__(self, key: object) -> _Measure:
        return self

    def reshape(self, shape: object) -> _Measure:
        return self


#: A buffer to measure with.
MEASURE: Any = _Measure()


@shared
def vector(buffer: Array, start: int, size: int) -> tuple[Array, int]:
    """Return a view (size,) of the buffer from an index on, and the index behind it."""
    end = start + size
    return buffer[start:end], end


@shared
def matrix(buffer: Array, start: int, rows: int, columns: int) -> tuple[Array, int]:
    """Return a view (rows, columns) of the buffer from an index on, and the index behind it."""
    end = start + rows * columns
    return buffer[start:end].reshape((rows, columns)), end


class Pose(NamedTuple):
    """Directors and joints at q_n.

    Attributes
    ----------
    d1, d3 : (2, N) arrays
        Normals and tangents of the elements.
    joint_sine, joint_cosine : (N - 1,) arrays
        Of the joint angles; the angle and 1 where the strain is linear in it.
    """

    d1: Array
    d3: Array
    joint_sine: Array
    joint_cosine: Array


@shared
def pose_views(buffer: Array, start: int, elements: int) -> tuple[Pose, int]:
    """Lay out a `Pose`; returns it and the index behind it."""
    d1, start = matrix(buffer, start, 2, elements)
    d3, start = matrix(buffer, start, 2, elements)
    joint_sine, start = vector(buffer, start, elements - 1)
    joint_cosine, start = vector(buffer, start, elements - 1)
    return Pose(d1, d3, joint_sine, joint_cosine), start


class Increment(NamedTuple):
    """How the body moves in an increment z of the minimal coordinates.

    Attributes
    ----------
    turn_sine, turn_cosine, half_sine, half_cosine : (N,) arrays
        Of the turn delta_k of every element, and of half of it.
    mean_sine, mean_cosine : (N - 1,) arrays
        Of the joint angles at the middle of the step; the angle and 1 where the strain is linear.
    new_d1 : (2, N) array
        Normals at q_{n+1}.
    shift : (2, N) array
        Increment of every element's centre (m).
    motion, impulse : (K',) arrays
        V, and the fluid's impulse per unit motion A V/h; zeros behind the K motions.
    """

    turn_sine: Array
    turn_cosine: Array
    half_sine: Array
    half_cosine: Array
    mean_sine: Array
    mean_cosine: Array
    new_d1: Array
    shift: Array
    motion: Array
    impulse: Array


@shared
def increment_views(
    buffer: Array, start: int, elements: int, motions: int
) -> tuple[Increment, int]:
    """Lay out an `Increment`; returns it and the index behind it."""
    start = padded(start)
    motion, start = vector(buffer, start, padded(motions))
    impulse, start = vector(buffer, start, padded(motions))
    turn_sine, start = vector(buffer, start, elements)
    turn_cosine, start = vector(buffer, start, elements)
    half_sine, start = vector(buffer, start, elements)
    half_cosine, start = vector(buffer, start, elements)
    mean_sine, start = vector(buffer, start, elements)
    mean_cosine, start = vector(buffer, start, elements)
    new_d1, start = matrix(buffer, start, 2, elements)
    shift, start = matrix(buffer, start, 2, elements)
    views = Increment(
        turn_sine,
        turn_cosine,
        half_sine,
        half_cosine,
        mean_sine,
        mean_cosine,
        new_d1,
        shift,
        motion,
        impulse,
    )
    return views, start


class Balance(NamedTuple):
    """Momentum balance of a step: its residual, and what it is made of.

    Attributes
    ----------
    momentum : (2, N) array
        P^k, momentum of every element with the fluid's impulse on its panels (kg m/s).
    lever : (2, N) array
        sum_k E_kj P^k (kg m^2/s).
    shape : (N,) array
        V^T dA/dtheta V/2, the shape force times h.
    elastic, elastic_sum, elastic_size : (N,) arrays
        h dW/dtheta at q_n, its sum with that at q_{n+1}, and the magnitude of the terms.
    torque, torque_size : (N,) arrays
        Impulse h F of torques and damping, and the magnitude of its terms.
    residual, scale, size : (N + 2,) arrays
        p_n + D1 L_d + h F/2, the scale it is measured with, and the magnitude of its terms.
    change : (N + 2,) array
        D1 L_d + D2 L_d + h F, the change of the momentum.
    sums : (2, N) array
        Scratch.
    """

    momentum: Array
    lever: Array
    shape: Array
    elastic: Array
    elastic_sum: Array
    elastic_size: Array
    torque: Array
    torque_size: Array
    residual: Array
    scale: Array
    size: Array
    change: Array
    sums: Array


@shared
def balance_views(buffer: Array, start: int, elements: int) -> tuple[Balance, int]:
    """Lay out a `Balance`; returns it and the index behind it."""
    momentum, start = matrix(buffer, start, 2, elements)
    lever, start = matrix(buffer, start, 2, elements)
    shape, start = vector(buffer, start, elements)
    elastic, start = vector(buffer, start, elements)
    elastic_sum, start = vector(buffer, start, elements)
    elastic_size, start = vector(buffer, start, elements)
    torque, start = vector(buffer, start, elements)
    torque_size, start = vector(buffer, start, elements)
    sums, start = matrix(buffer, start, 2, elements)
    residual, start = vector(buffer, start, elements + 2)
    scale, start = vector(buffer, start, elements + 2)
    size, start = vector(buffer, start, elements + 2)
    change, start = vector(buffer, start, elements + 2)
    views = Balance(
        momentum,
        lever,
        shape,
        elastic,
        elastic_sum,
        elastic_size,
        torque,
        torque_size,
        residual,
        scale,
        size,
        change,
        sums,
    )
    return views, start


class Drag(NamedTuple):
    """Cross-flow drag in a step.

    Attributes
    ----------
    impulse : (2, N) array
        On every element (kg m/s).
    moment : (N,) array
        Its moment about the element's centre (kg m^2/s).
    lever : (2, N) array
        What the joints in front feel of it, like that of `Balance`.
    slope, cross, turn_slope : (N,) arrays
        Derivatives of minus the impulse by the shift of the centre along the normal, of either by
        the other, and of the moment by the turn.
    """

    impulse: Array
    moment: Array
    lever: Array
    slope: Array
    cross: Array
    turn_slope: Array


@shared
def drag_views(buffer: Array, start: int, elements: int) -> tuple[Drag, int]:
    """Lay out a `Drag`; returns it and the index behind it."""
    impulse, start = matrix(buffer, start, 2, elements)
    moment, start = vector(buffer, start, elements)
    lever, start = matrix(buffer, start, 2, elements)
    slope, start = vector(buffer, start, elements)
    cross, start = vector(buffer, start, elements)
    turn_slope, start = vector(buffer, start, elements)
    return Drag(impulse, moment, lever, slope, cross, turn_slope), start


#: Entries of `Mass.known`.
TOTAL, ADDED = range(2)


class Mass(NamedTuple):
    """Masses of a pose, and which pose they belong to.

    Attributes
    ----------
    added : (K', K') array
        Added mass A at q_n, or in the second half of a composed step at q_{n+1}.
    total : (N + 2, N + 2) array
        Reduced total mass at q_n; its Cholesky factor replaces the diagonal and what is below.
    diagonal : (N + 2,) array
        Diagonal of the total mass.
    velocity : (N + 2,) array
        M^-1 p.
    pose, momentum : (N + 2,) arrays
        Coordinates that `total` belongs to, and momentum that `velocity` belongs to (NaN for none).
    shape : (N - 1,) array
        Joint angles that `added` belongs to.
    trial_shape : (N - 1,) array
        Joint angles at the end of a trial increment.
    known : (2,) int array
        1 where `total` (TOTAL) and `added` (ADDED) are those of `pose` and `shape`.
    """

    added: Array
    total: Array
    diagonal: Array
    velocity: Array
    pose: Array
    momentum: Array
    shape: Array
    trial_shape: Array
    known: Integers


@shared
def mass_views(
    buffer: Array, start: int, known: Integers, elements: int, motions: int
) -> tuple[Mass, int]:
    """Lay out a `Mass`; returns it and the index behind it."""
    n = elements + 2
    k = padded(motions)
    added, start = matrix(buffer, start, k, k)
    total, start = matrix(buffer, start, n, n)
    diagonal, start = vector(buffer, start, n)
    velocity, start = vector(buffer, start, n)
    pose, start = vector(buffer, start, n)
    momentum, start = vector(buffer, start, n)
    shape, start = vector(buffer, start, elements - 1)
    trial_shape, start = vector(buffer, start, elements - 1)
    views = Mass(added, total, diagonal, velocity, pose, momentum, shape, trial_shape, known)
    return views, start


class Newton(NamedTuple):
    """Newton's method: increments, corrections and matrices.

    Attributes
    ----------
    increment, trial : (N + 2,) arrays
        The increment z that is improved, and one that is tried.
    start : (N + 2,) array
        The increment that the method started from.
    correction, next_correction : (N + 2,) arrays
        The correction of `increment`, and that of `trial` with the same matrix.
    jacobian, transposed : (N + 2, N + 2) arrays
        Minus the derivative of the residual (its factors), and the rows of its transpose.
    motions, impulses : (N + 2, K') arrays
        Derivatives of V and of A V by the unknowns, a row each.
    moved : (K',) array
        Scratch: V beside that of the increment.
    shape : (N,) array
        Scratch: its shape force.
    permutation : (N + 2,) int array
        Row exchanges of the factors.
    """

    increment: Array
    trial: Array
    start: Array
    correction: Array
    next_correction: Array
    jacobian: Array
    transposed: Array
    motions: Array
    impulses: Array
    moved: Array
    shape: Array
    permutation: Integers


@shared
def newton_views(
    buffer: Array, start: int, permutation: Integers, elements: int, motions: int
) -> tuple[Newton, int]:
    """Lay out a `Newton`; returns it and the index behind it."""
    n = elements + 2
    k = padded(motions)
    # Rows of motions begin at a cache line: loads across two take twice as long.
    start = padded(start)
    column_motions, start = matrix(buffer, start, n, k)
    column_impulses, start = matrix(buffer, start, n, k)
    moved, start = vector(buffer, start, k)
    jacobian, start = matrix(buffer, start, n, n)
    transposed, start = matrix(buffer, start, n, n)
    increment, start = vector(buffer, start, n)
    trial, start = vector(buffer, start, n)
    first, start = vector(buffer, start, n)
    correction, start = vector(buffer, start, n)
    next_correction, start = vector(buffer, start, n)
    shape, start = vector(buffer, start, elements)
    views = Newton(
        increment,
        trial,
        first,
        correction,
        next_correction,
        jacobian,
        transposed,
        column_motions,
        column_impulses,
        moved,
        shape,
        permutation,
    )
    return views, start


class Body(NamedTuple):
    """What the step equations of one body work with."""

    pose: Pose
    inc: Increment
    balance: Balance
    drag: Drag
    mass: Mass
