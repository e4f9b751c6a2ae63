"""Dense linear algebra for the sizes of one swimmer, without calls into LAPACK.

The matrices of one body have some ten to a few hundred rows. There the overhead of library calls
is of the order of the arithmetic, and a plain loop over rows runs on vector registers.
All functions work in place on the arrays handed in and return whether they succeeded.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import embedded, entry_kernel, kernel, vector_kernel

Array = NDArray[np.float64]
Four = tuple[float, float, float, float]
#: Four rows of a matrix, four columns of each.
Block = tuple[Four, Four, Four, Four]


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


@vector_kernel
def _dot_four(a: Array, b: Array, c: Array, d: Array, vector: Array) -> Four:
    total_a = 0.0
    total_b = 0.0
    total_c = 0.0
    total_d = 0.0
    for j in range(vector.size):
        factor = vector[j]
        total_a += a[j] * factor
        total_b += b[j] * factor
        total_c += c[j] * factor
        total_d += d[j] * factor
    return total_a, total_b, total_c, total_d


@kernel
def mat_vec(matrix: Array, vector: Array, out: Array) -> None:
    """Write matrix (m, n) times vector (n,) into out (m,)."""
    rows = matrix.shape[0]
    first = rows % 4
    for i in range(first):
        out[i] = dot(matrix[i], vector)
    for i in range(first, rows, 4):
        out[i], out[i + 1], out[i + 2], out[i + 3] = _dot_four(
            matrix[i], matrix[i + 1], matrix[i + 2], matrix[i + 3], vector
        )


@kernel
def mat_vec_transposed(matrix: Array, vector: Array, out: Array) -> None:
    """Write the transpose of matrix (m, n) times vector (m,) into out (n,)."""
    rows = matrix.shape[0]
    first = rows % 4
    out[:] = 0.0
    for i in range(first):
        _subtract_multiple(out, matrix[i], -vector[i])
    for i in range(first, rows, 4):
        _add_four(vector[i : i + 4], matrix[i], matrix[i + 1], matrix[i + 2], matrix[i + 3], out)


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
def _add_four(factors: Array, s0: Array, s1: Array, s2: Array, s3: Array, out: Array) -> None:
    """Add four factors times four rows to a row."""
    a, b, c, d = factors[0], factors[1], factors[2], factors[3]
    for j in range(out.size):
        out[j] += a * s0[j] + b * s1[j] + c * s2[j] + d * s3[j]


@embedded
def block_of(matrix: Array, row: int, column: int, factor: float) -> Block:
    """Return a factor times four rows and columns of a matrix, as numbers of their own."""
    r0, r1, r2, r3 = matrix[row], matrix[row + 1], matrix[row + 2], matrix[row + 3]
    a, b, c, d = column, column + 1, column + 2, column + 3
    return (
        (factor * r0[a], factor * r0[b], factor * r0[c], factor * r0[d]),
        (factor * r1[a], factor * r1[b], factor * r1[c], factor * r1[d]),
        (factor * r2[a], factor * r2[b], factor * r2[c], factor * r2[d]),
        (factor * r3[a], factor * r3[b], factor * r3[c], factor * r3[d]),
    )


@vector_kernel
def add_block_times_rows(
    block: Block,
    s0: Array,
    s1: Array,
    s2: Array,
    s3: Array,
    r0: Array,
    r1: Array,
    r2: Array,
    r3: Array,
) -> None:
    """Add a block times four padded rows to four others."""
    (a0, b0, c0, d0), (a1, b1, c1, d1), (a2, b2, c2, d2), (a3, b3, c3, d3) = block
    for j in range((s0.size >> 3) << 3):
        a, b, c, d = s0[j], s1[j], s2[j], s3[j]
        r0[j] += a0 * a + b0 * b + c0 * c + d0 * d
        r1[j] += a1 * a + b1 * b + c1 * c + d1 * d
        r2[j] += a2 * a + b2 * b + c2 * c + d2 * d
        r3[j] += a3 * a + b3 * b + c3 * c + d3 * d


@vector_kernel
def _multiply_rows(block: Block, p0: Array, p1: Array, p2: Array, p3: Array) -> None:
    """Replace four padded rows by a block times them."""
    (a0, b0, c0, d0), (a1, b1, c1, d1), (a2, b2, c2, d2), (a3, b3, c3, d3) = block
    for j in range((p0.size >> 3) << 3):
        a, b, c, d = p0[j], p1[j], p2[j], p3[j]
        p0[j] = a0 * a + b0 * b + c0 * c + d0 * d
        p1[j] = a1 * a + b1 * b + c1 * c + d1 * d
        p2[j] = a2 * a + b2 * b + c2 * c + d2 * d
        p3[j] = a3 * a + b3 * b + c3 * c + d3 * d


@kernel
def multiply(factors: Array, source: Array, out: Array) -> None:
    """Write the product of factors (m, n or more) and source (n, k) into out (m, k).

    n is a multiple of 4, k of 8. Four rows and four factors at a time: numbers that are loaded
    serve several products.
    """
    rows = out.shape[0]
    whole = rows // 4 * 4
    out[:] = 0.0
    for k in range(0, source.shape[0], 4):
        s0, s1, s2, s3 = source[k], source[k + 1], source[k + 2], source[k + 3]
        for i in range(0, whole, 4):
            block = block_of(factors, i, k, 1.0)
            r0, r1, r2, r3 = out[i], out[i + 1], out[i + 2], out[i + 3]
            add_block_times_rows(block, s0, s1, s2, s3, r0, r1, r2, r3)
        for i in range(whole, rows):
            _add_four(factors[i, k : k + 4], s0, s1, s2, s3, out[i])


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
        block = block_of(matrix, first, first, 1.0)
        p0, p1, p2, p3 = matrix[first], matrix[first + 1], matrix[first + 2], matrix[first + 3]
        _multiply_rows(block, p0, p1, p2, p3)
        for k in range(4):
            column = first + k
            p0[column], p1[column], p2[column], p3[column] = (
                block[0][k],
                block[1][k],
                block[2][k],
                block[3][k],
            )
        for row in range(0, n, 4):
            if row != first:
                block = block_of(matrix, row, first, -1.0)
                r0, r1, r2, r3 = matrix[row], matrix[row + 1], matrix[row + 2], matrix[row + 3]
                for j in range(first, first + 4):
                    r0[j], r1[j], r2[j], r3[j] = 0.0, 0.0, 0.0, 0.0
                add_block_times_rows(block, p0, p1, p2, p3, r0, r1, r2, r3)
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
