"""Rotations in space: unit quaternions, rotation vectors and what turns one into the other.

Quaternions have their real part first. With Q = exp(hat theta) the right Jacobian is defined by
exp(hat(theta + d)) = Q exp(hat(J_r d)), to first order in d; the left one is its transpose.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import embedded, kernel

Array = NDArray[np.float64]

#: Squares of angles (rad^2) up to which power series serve; the first terms left out are below the
#: rounding there.
_SERIES = 0.25


@embedded
def _sine_and_versine(square: float) -> tuple[float, float]:
    """Return sin(t)/t and (1 - cos(t))/t^2 of an angle by its square."""
    if square <= _SERIES:
        s = square
        sine = 1.0 - s / 110.0 * (1.0 - s / 156.0 * (1.0 - s / 210.0))
        sine = 1.0 - s / 6.0 * (1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0 * sine)))
        versine = 1.0 - s / 90.0 * (1.0 - s / 132.0 * (1.0 - s / 182.0))
        versine = 1.0 - s / 12.0 * (1.0 - s / 30.0 * (1.0 - s / 56.0 * versine))
        return sine, 0.5 * versine
    t = math.sqrt(square)
    half = math.sin(0.5 * t)
    return math.sin(t) / t, 2.0 * half * half / square


@embedded
def turn_less_one(phi: Array, out: Array) -> float:
    """Write F = exp(hat phi) - 1 (3, 3) without cancellation; returns sin|phi|/|phi|.

    That times `phi` is the axial vector of the skew part of exp(hat phi).
    """
    x, y, z = phi[0], phi[1], phi[2]
    sine, versine = _sine_and_versine(x * x + y * y + z * z)
    xx, yy, zz = versine * x * x, versine * y * y, versine * z * z
    xy, xz, yz = versine * x * y, versine * x * z, versine * y * z
    out[0, 0] = -(yy + zz)
    out[1, 1] = -(xx + zz)
    out[2, 2] = -(xx + yy)
    out[0, 1] = xy - sine * z
    out[1, 0] = xy + sine * z
    out[0, 2] = xz + sine * y
    out[2, 0] = xz - sine * y
    out[1, 2] = yz - sine * x
    out[2, 1] = yz + sine * x
    return sine


@embedded
def _curving(square: float) -> float:
    """Return (1 - (t/2) cot(t/2))/t^2 of an angle by its square."""
    if square <= 0.01:
        s = square
        return 1.0 / 12.0 + s * (
            1.0 / 720.0 + s * (1.0 / 30240.0 + s * (1.0 / 1209600.0 + s / 47900160.0))
        )
    t = math.sqrt(square)
    return (1.0 - 0.5 * t / math.tan(0.5 * t)) / square


@embedded
def inverse_jacobian(sign: float, theta: Array, vector: Array, out: Array) -> None:
    """Write J_r(theta)^-1 vector for a sign of 1, J_l(theta)^-1 vector for -1.

    That is v + sign/2 theta x v + c theta x (theta x v).
    """
    x, y, z = theta[0], theta[1], theta[2]
    a, b, c = vector[0], vector[1], vector[2]
    u, v, w = y * c - z * b, z * a - x * c, x * b - y * a
    half, curving = 0.5 * sign, _curving(x * x + y * y + z * z)
    out[0] = a + half * u + curving * (y * w - z * v)
    out[1] = b + half * v + curving * (z * u - x * w)
    out[2] = c + half * w + curving * (x * v - y * u)


@embedded
def cross_matrix(factor: float, v: Array, out: Array) -> None:
    """Write factor hat(v) (3, 3), the matrix of factor v x."""
    x, y, z = factor * v[0], factor * v[1], factor * v[2]
    out[0, 0], out[0, 1], out[0, 2] = 0.0, -z, y
    out[1, 0], out[1, 1], out[1, 2] = z, 0.0, -x
    out[2, 0], out[2, 1], out[2, 2] = -y, x, 0.0


@kernel
def inverse_jacobian_matrix(sign: float, theta: Array, out: Array) -> None:
    """Write J_r(theta)^-1 (3, 3) for a sign of 1, J_l(theta)^-1 for -1."""
    square = theta[0] * theta[0] + theta[1] * theta[1] + theta[2] * theta[2]
    curving = _curving(square)
    cross_matrix(0.5 * sign, theta, out)
    for i in range(3):
        for j in range(3):
            out[i, j] += curving * theta[i] * theta[j]
        out[i, i] += 1.0 - curving * square


@embedded
def quaternion_of_vector(phi: Array, out: Array) -> None:
    """Write the quaternion (4,) of a rotation vector."""
    square = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    sine, versine = _sine_and_versine(0.25 * square)
    out[0] = 1.0 - 0.25 * square * versine
    for i in range(3):
        out[1 + i] = 0.5 * sine * phi[i]


@embedded
def vector_of_quaternion(q: Array, out: Array) -> None:
    """Write the rotation vector (3,), of at most half a turn, of a unit quaternion."""
    square = q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    if square < 1e-8:
        factor = 2.0 * (1.0 + square / 6.0)
        if q[0] < 0.0:
            factor = -factor
    else:
        size = math.sqrt(square)
        if q[0] < 0.0:
            factor = -2.0 * math.atan2(size, -q[0]) / size
        else:
            factor = 2.0 * math.atan2(size, q[0]) / size
    for i in range(3):
        out[i] = factor * q[1 + i]


@embedded
def quaternion_product(sign: float, a: Array, b: Array, out: Array) -> None:
    """Write the product a b (4,), or for a sign of -1 that of a's inverse and b; not onto them."""
    w, x, y, z = a[0], sign * a[1], sign * a[2], sign * a[3]
    out[0] = w * b[0] - x * b[1] - y * b[2] - z * b[3]
    out[1] = w * b[1] + x * b[0] + y * b[3] - z * b[2]
    out[2] = w * b[2] - x * b[3] + y * b[0] + z * b[1]
    out[3] = w * b[3] + x * b[2] - y * b[1] + z * b[0]


@embedded
def normalise(q: Array) -> None:
    """Scale a quaternion (4,) to unit length, so that its rotation stays orthonormal."""
    factor = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for i in range(4):
        q[i] *= factor


@embedded
def matrix_of_quaternion(q: Array, out: Array) -> None:
    """Write the rotation (3, 3) of a unit quaternion."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    out[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    out[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    out[2, 2] = 1.0 - 2.0 * (x * x + y * y)
    out[0, 1] = 2.0 * (x * y - w * z)
    out[1, 0] = 2.0 * (x * y + w * z)
    out[0, 2] = 2.0 * (x * z + w * y)
    out[2, 0] = 2.0 * (x * z - w * y)
    out[1, 2] = 2.0 * (y * z - w * x)
    out[2, 1] = 2.0 * (y * z + w * x)


@embedded
def product(a: Array, b: Array, out: Array) -> None:
    """Write the product of two matrices (3, 3); not onto them."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@embedded
def transposed_product(a: Array, b: Array, out: Array) -> None:
    """Write the product of a's transpose and b, (3, 3); not onto them."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[0, i] * b[0, j] + a[1, i] * b[1, j] + a[2, i] * b[2, j]


@embedded
def rotate(a: Array, v: Array, out: Array) -> None:
    """Write a v (3,); not onto v."""
    for i in range(3):
        out[i] = a[i, 0] * v[0] + a[i, 1] * v[1] + a[i, 2] * v[2]


@embedded
def rotate_back(a: Array, v: Array, out: Array) -> None:
    """Write a's transpose times v (3,); not onto v."""
    for i in range(3):
        out[i] = a[0, i] * v[0] + a[1, i] * v[1] + a[2, i] * v[2]


@embedded
def turned_block(left: Array, block: Array, right: Array, work: Array, out: Array) -> None:
    """Write left block right^T (3, 3), by way of `work`; `out` may be `block`."""
    product(left, block, work)
    for i in range(3):
        for j in range(3):
            out[i, j] = (
                work[i, 0] * right[j, 0] + work[i, 1] * right[j, 1] + work[i, 2] * right[j, 2]
            )


@embedded
def trace_less(m: Array, transposed: bool, out: Array) -> None:
    """Write tr M - M (3, 3), or tr M - M^T."""
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    for i in range(3):
        for j in range(3):
            out[i, j] = -(m[j, i] if transposed else m[i, j])
        out[i, i] += trace
