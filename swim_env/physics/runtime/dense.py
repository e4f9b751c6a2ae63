"""Dense linear algebra for the sizes of one swimmer, without calls into LAPACK.

The matrices of one body have some ten to a few hundred rows. There the overhead of library calls
is of the order of the arithmetic, and a plain loop over rows runs on vector registers.
All functions work in place on the arrays handed in and return whether they succeeded.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import entry_kernel, kernel, vector_kernel

Array = NDArray[np.float64]


@kernel
def copy(source: Array, target: Array) -> None:
    """Copy a vector (n,); an assignment of slices would make a copy in between."""
    for j in range(target.size):
        target[j] = source[j]


@vector_kernel
def _subtract_multiple(target: Array, source: Array, factor: float) -> None:
    for j in range(target.size):
        target[j] -= factor * source[j]


@vector_kernel
def add_multiple(target: Array, source: Array, factor: float) -> None:
    """Add a multiple of one padded row to another; their length is a multiple of 8."""
    for j in range((target.size >> 3) << 3):
        target[j] += factor * source[j]


@vector_kernel
def dot(a: Array, b: Array) -> float:
    """Return the scalar product of two vectors of equal length."""
    total = 0.0
    for j in range(a.size):
        total += a[j] * b[j]
    return total


@kernel
def mat_vec(matrix: Array, vector: Array, out: Array) -> None:
    """Write matrix (m, n) times vector (n,) into out (m,)."""
    for i in range(matrix.shape[0]):
        out[i] = dot(matrix[i], vector)


@vector_kernel
def mat_vec_transposed(matrix: Array, vector: Array, out: Array) -> None:
    """Write the transpose of matrix (m, n) times vector (m,) into out (n,)."""
    for j in range(matrix.shape[1]):
        out[j] = 0.0
    for i in range(matrix.shape[0]):
        factor = vector[i]
        for j in range(matrix.shape[1]):
            out[j] += matrix[i, j] * factor


@kernel
def _bring_up_pivot(matrix: Array, k: int, permutation: NDArray[np.int64]) -> bool:
    """Exchange row k with the row below that has the largest entry in column k, and note it."""
    pivot_row = k
    largest = abs(matrix[k, k])
    for i in range(k + 1, matrix.shape[0]):
        if abs(matrix[i, k]) > largest:
            largest = abs(matrix[i, k])
            pivot_row = i
    permutation[k] = pivot_row
    if not (largest > 0.0 and largest < np.inf):
        return False
    if pivot_row != k:
        for j in range(matrix.shape[1]):
            held = matrix[k, j]
            matrix[k, j] = matrix[pivot_row, j]
            matrix[pivot_row, j] = held
    return True


@entry_kernel
def invert(matrix: Array, permutation: NDArray[np.int64]) -> bool:
    """Invert a square matrix in place by Gauss-Jordan elimination with row pivoting.

    Parameters
    ----------
    matrix : (n, n) array
        Overwritten with its inverse.
    permutation : (n,) int array
        Work space.

    Returns
    -------
    bool
        False when a pivot is zero or not finite; the matrix is then of no use.
    """
    n = matrix.shape[0]
    for k in range(n):
        if not _bring_up_pivot(matrix, k, permutation):
            return False
        reciprocal = 1.0 / matrix[k, k]
        matrix[k, k] = 1.0
        for j in range(n):
            matrix[k, j] *= reciprocal
        for i in range(n):
            if i != k:
                factor = matrix[i, k]
                matrix[i, k] = 0.0
                _subtract_multiple(matrix[i], matrix[k], factor)
    # The row exchanges of the elimination are column exchanges of the inverse, undone backwards.
    for back in range(n):
        k = n - 1 - back
        other = permutation[k]
        if other != k:
            for i in range(n):
                held = matrix[i, k]
                matrix[i, k] = matrix[i, other]
                matrix[i, other] = held
    return True


@vector_kernel
def _add_four_rows(factors: Array, source: Array, k: int, out: Array) -> None:
    """Add factors[k : k + 4] times four source rows to a row."""
    a, b, c, d = factors[k], factors[k + 1], factors[k + 2], factors[k + 3]
    s0 = source[k]
    s1 = source[k + 1]
    s2 = source[k + 2]
    s3 = source[k + 3]
    for j in range((out.size >> 3) << 3):
        out[j] += a * s0[j] + b * s1[j] + c * s2[j] + d * s3[j]


@vector_kernel
def _add_four_rows_to_two(factors: Array, source: Array, i: int, k: int, out: Array) -> None:
    """Add factors[i : i + 2, k : k + 4] times four source rows to two rows."""
    a0, b0, c0, d0 = factors[i, k], factors[i, k + 1], factors[i, k + 2], factors[i, k + 3]
    last = i + 1
    a1, b1, c1, d1 = (
        factors[last, k],
        factors[last, k + 1],
        factors[last, k + 2],
        factors[last, k + 3],
    )
    s0 = source[k]
    s1 = source[k + 1]
    s2 = source[k + 2]
    s3 = source[k + 3]
    r0 = out[i]
    r1 = out[i + 1]
    for j in range((out.shape[1] >> 3) << 3):
        a = s0[j]
        b = s1[j]
        c = s2[j]
        d = s3[j]
        r0[j] += a0 * a + b0 * b + c0 * c + d0 * d
        r1[j] += a1 * a + b1 * b + c1 * c + d1 * d


@kernel
def multiply(factors: Array, source: Array, out: Array) -> None:
    """Write the product of factors (m, n or more) and source (n, k) into out (m, k).

    n is a multiple of 4, k of 8. Two rows and four factors at a time, numbers that are loaded serve
    several products.
    """
    rows = out.shape[0]
    out[:] = 0.0
    for i in range(0, rows // 2 * 2, 2):
        for k in range(0, source.shape[0], 4):
            _add_four_rows_to_two(factors, source, i, k, out)
    if rows % 2 == 1:
        for k in range(0, source.shape[0], 4):
            _add_four_rows(factors[rows - 1], source, k, out[rows - 1])


@kernel
def _invert_block(matrix: Array, first: int, smallest_pivot: float) -> bool:
    """Invert the block of rows and columns first ... first + 3 in place."""
    for k in range(first, first + 4):
        pivot = matrix[k, k]
        if not (abs(pivot) >= smallest_pivot and abs(pivot) < np.inf):
            return False
        reciprocal = 1.0 / pivot
        matrix[k, k] = 1.0
        for j in range(first, first + 4):
            matrix[k, j] *= reciprocal
        for i in range(first, first + 4):
            if i != k:
                factor = matrix[i, k]
                matrix[i, k] = 0.0
                for j in range(first, first + 4):
                    matrix[i, j] -= factor * matrix[k, j]
    return True


@vector_kernel
def _apply_block(pivots: Array, column: int) -> None:
    """Multiply four rows by the block in their columns column ... column + 3."""
    p0 = pivots[0]
    p1 = pivots[1]
    p2 = pivots[2]
    p3 = pivots[3]
    a0, b0, c0, d0 = p0[column], p0[column + 1], p0[column + 2], p0[column + 3]
    a1, b1, c1, d1 = p1[column], p1[column + 1], p1[column + 2], p1[column + 3]
    a2, b2, c2, d2 = p2[column], p2[column + 1], p2[column + 2], p2[column + 3]
    a3, b3, c3, d3 = p3[column], p3[column + 1], p3[column + 2], p3[column + 3]
    for j in range((pivots.shape[1] >> 3) << 3):
        a = p0[j]
        b = p1[j]
        c = p2[j]
        d = p3[j]
        p0[j] = a0 * a + b0 * b + c0 * c + d0 * d
        p1[j] = a1 * a + b1 * b + c1 * c + d1 * d
        p2[j] = a2 * a + b2 * b + c2 * c + d2 * d
        p3[j] = a3 * a + b3 * b + c3 * c + d3 * d
    p0[column], p0[column + 1], p0[column + 2], p0[column + 3] = a0, b0, c0, d0
    p1[column], p1[column + 1], p1[column + 2], p1[column + 3] = a1, b1, c1, d1
    p2[column], p2[column + 1], p2[column + 2], p2[column + 3] = a2, b2, c2, d2
    p3[column], p3[column + 1], p3[column + 2], p3[column + 3] = a3, b3, c3, d3


@vector_kernel
def _subtract_four_from_four(matrix: Array, row: int, pivots: Array, column: int) -> None:
    """Subtract multiples of four pivot rows from four rows, the factors read from the matrix."""
    p0 = pivots[0]
    p1 = pivots[1]
    p2 = pivots[2]
    p3 = pivots[3]
    r0 = matrix[row]
    r1 = matrix[row + 1]
    r2 = matrix[row + 2]
    r3 = matrix[row + 3]
    a0, b0, c0, d0 = r0[column], r0[column + 1], r0[column + 2], r0[column + 3]
    a1, b1, c1, d1 = r1[column], r1[column + 1], r1[column + 2], r1[column + 3]
    a2, b2, c2, d2 = r2[column], r2[column + 1], r2[column + 2], r2[column + 3]
    a3, b3, c3, d3 = r3[column], r3[column + 1], r3[column + 2], r3[column + 3]
    for j in range(column, column + 4):
        r0[j] = 0.0
        r1[j] = 0.0
        r2[j] = 0.0
        r3[j] = 0.0
    for j in range((matrix.shape[1] >> 3) << 3):
        a = p0[j]
        b = p1[j]
        c = p2[j]
        d = p3[j]
        r0[j] -= a0 * a + b0 * b + c0 * c + d0 * d
        r1[j] -= a1 * a + b1 * b + c1 * c + d1 * d
        r2[j] -= a2 * a + b2 * b + c2 * c + d2 * d
        r3[j] -= a3 * a + b3 * b + c3 * c + d3 * d


@entry_kernel
def invert_in_order(matrix: Array, smallest_pivot: float) -> bool:
    """Invert a square matrix in place by Gauss-Jordan elimination, four pivots at a time.

    Rows are not exchanged, which is safe as long as no pivot is small against the entries, and
    takes a third of the time of `invert`: every number that is loaded serves four products.

    Parameters
    ----------
    matrix : (n, n) array
        Overwritten with its inverse; n is a multiple of 8 (fill up with rows of the identity).
    smallest_pivot : float
        A pivot below this is not accepted.

    Returns
    -------
    bool
        False when a pivot is not accepted or not finite; the matrix is then of no use.
    """
    n = matrix.shape[0]
    for first in range(0, n, 4):
        if not _invert_block(matrix, first, smallest_pivot):
            return False
        pivots = matrix[first : first + 4]
        _apply_block(pivots, first)
        for row in range(0, n, 4):
            if row != first:
                _subtract_four_from_four(matrix, row, pivots, first)
    return True


@kernel
def lu_factor(matrix: Array, permutation: NDArray[np.int64]) -> bool:
    """Factorise a square matrix (n, n) in place, rows exchanged; False at a zero pivot.

    The diagonal is left with the pivots' reciprocals: a division takes as long as many products.
    """
    n = matrix.shape[0]
    for k in range(n):
        if not _bring_up_pivot(matrix, k, permutation):
            return False
        reciprocal = 1.0 / matrix[k, k]
        for i in range(k + 1, n):
            matrix[i, k] *= reciprocal
            _subtract_multiple(matrix[i, k + 1 :], matrix[k, k + 1 :], matrix[i, k])
        matrix[k, k] = reciprocal
    return True


@kernel
def lu_solve(factors: Array, permutation: NDArray[np.int64], vector: Array) -> None:
    """Solve in place for one right-hand side (n,) with the factors of `lu_factor`."""
    n = vector.size
    for k in range(n):
        other = permutation[k]
        if other != k:
            held = vector[k]
            vector[k] = vector[other]
            vector[other] = held
    # Column by column: what is taken off each row does not wait for the others.
    for k in range(n):
        known = vector[k]
        for i in range(k + 1, n):
            vector[i] -= factors[i, k] * known
    for back in range(n):
        k = n - 1 - back
        known = vector[k] * factors[k, k]
        vector[k] = known
        for i in range(k):
            vector[i] -= factors[i, k] * known


@kernel
def cholesky(matrix: Array) -> bool:
    """Overwrite the lower triangle of a symmetric matrix (n, n) with its Cholesky factor.

    Returns
    -------
    bool
        False when the matrix is not positive definite (or not finite).
    """
    n = matrix.shape[0]
    for i in range(n):
        for j in range(i):
            matrix[i, j] = (matrix[i, j] - dot(matrix[i, :j], matrix[j, :j])) / matrix[j, j]
        rest = matrix[i, i] - dot(matrix[i, :i], matrix[i, :i])
        if not (rest > 0.0 and rest < np.inf):
            return False
        matrix[i, i] = np.sqrt(rest)
    return True


@kernel
def cholesky_product(factor: Array, vector: Array, out: Array) -> None:
    """Write the matrix that `cholesky` factorised, times vector (n,), into out (n,)."""
    n = vector.size
    for i in range(n):
        out[i] = 0.0
        for k in range(i, n):
            out[i] += factor[k, i] * vector[k]
    for back in range(n):
        i = n - 1 - back
        out[i] = dot(factor[i, : i + 1], out[: i + 1])


@kernel
def cholesky_solve(factor: Array, vector: Array) -> None:
    """Solve in place for one right-hand side (n,) with the factor of `cholesky`."""
    n = vector.size
    for i in range(n):
        vector[i] = (vector[i] - dot(factor[i, :i], vector[:i])) / factor[i, i]
    for back in range(n):
        i = n - 1 - back
        rest = vector[i]
        for k in range(i + 1, n):
            rest -= factor[k, i] * vector[k]
        vector[i] = rest / factor[i, i]
