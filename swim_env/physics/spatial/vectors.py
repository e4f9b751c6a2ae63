"""Vectors in space as three numbers, which kernels take from arrays and put into them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import embedded

Array = NDArray[np.float64]
Vector = tuple[float, float, float]


@embedded
def row(array: Array, i: int) -> Vector:
    """Return row i of an (n, 3) array."""
    return array[i, 0], array[i, 1], array[i, 2]


@embedded
def column(array: Array, first: int, i: int) -> Vector:
    """Return three rows' entries in column i."""
    return array[first, i], array[first + 1, i], array[first + 2, i]


@embedded
def part(vector: Array, first: int) -> Vector:
    """Return three entries of a vector."""
    return vector[first], vector[first + 1], vector[first + 2]


@embedded
def director(directors: Array, k: int, axis: int) -> Vector:
    """Return column `axis` of R_k."""
    return directors[k, 0, axis], directors[k, 1, axis], directors[k, 2, axis]


@embedded
def write_row(array: Array, i: int, a: Vector) -> None:
    """Write row i of an (n, 3) array."""
    array[i, 0], array[i, 1], array[i, 2] = a


@embedded
def add_row(array: Array, i: int, a: Vector) -> None:
    """Add to row i of an (n, 3) array."""
    array[i, 0] += a[0]
    array[i, 1] += a[1]
    array[i, 2] += a[2]


@embedded
def add_column(array: Array, first: int, i: int, a: Vector) -> None:
    """Add to three rows' entries in column i."""
    array[first, i] += a[0]
    array[first + 1, i] += a[1]
    array[first + 2, i] += a[2]


@embedded
def write_part(vector: Array, first: int, a: Vector) -> None:
    """Write three entries of a vector."""
    vector[first], vector[first + 1], vector[first + 2] = a


@embedded
def plus(a: Vector, factor: float, b: Vector) -> Vector:
    """Return a + factor b."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@embedded
def scaled(factor: float, a: Vector) -> Vector:
    """Return factor a."""
    return factor * a[0], factor * a[1], factor * a[2]


@embedded
def sum_of(x: float, a: Vector, y: float, b: Vector, z: float, c: Vector) -> Vector:
    """Return x a + y b + z c."""
    return (
        x * a[0] + y * b[0] + z * c[0],
        x * a[1] + y * b[1] + z * c[1],
        x * a[2] + y * b[2] + z * c[2],
    )


@embedded
def to_space(directors: Array, k: int, a: Vector) -> Vector:
    """Return R_k a."""
    first, second = director(directors, k, 0), director(directors, k, 1)
    return sum_of(a[0], first, a[1], second, a[2], director(directors, k, 2))


@embedded
def inner(a: Vector, b: Vector) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@embedded
def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@embedded
def size(a: Vector) -> float:
    """Return the length."""
    return math.sqrt(inner(a, a))
