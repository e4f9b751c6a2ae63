"""Elementary functions and products of the kernels against exact and library ones."""

import mpmath
import numpy as np
import pytest

from swim_env.physics.runtime.compile import entry_kernel
from swim_env.physics.runtime.dense import mat_vec, mat_vec_transposed, multiply
from swim_env.physics.runtime.elementary import (
    SMALL_ANGLE,
    atan2,
    cos_small,
    log,
    log_quotient,
    sin_small,
)
from tests.support import Array


@entry_kernel
def _logs(x: Array, out: Array) -> None:
    for i in range(x.size):
        out[i] = log(x[i])


@entry_kernel
def _log_quotients(s: Array, d: Array, out: Array) -> None:
    for i in range(s.size):
        out[i] = log_quotient(s[i], d[i])


@entry_kernel
def _angles(y: Array, x: Array, out: Array) -> None:
    for i in range(x.size):
        out[i] = atan2(y[i], x[i])


@entry_kernel
def _small(x: Array, sines: Array, cosines: Array) -> None:
    for i in range(x.size):
        sines[i] = sin_small(x[i])
        cosines[i] = cos_small(x[i])


@entry_kernel
def _product(factors: Array, source: Array, out: Array) -> None:
    multiply(factors, source, out)


@entry_kernel
def _vector_products(matrix: Array, right: Array, left: Array, out: Array, across: Array) -> None:
    mat_vec(matrix, right, out)
    mat_vec_transposed(matrix, left, across)


def units_off(found: Array, exact: list[mpmath.mpf]) -> float:
    """Return the largest error in units of the last place of the exact result."""
    return max(
        float(abs(mpmath.mpf(float(a)) - b)) / float(np.spacing(abs(float(b)) or 5e-324))
        for a, b in zip(found, exact, strict=True)
    )


@pytest.fixture(autouse=True)
def _digits():
    with mpmath.workdps(40):
        yield


def test_logarithm_over_all_magnitudes_and_next_to_one():
    random = np.random.default_rng(0)
    x = np.concatenate(
        [10.0 ** random.uniform(-300, 300, 500), 1.0 + random.uniform(-1e-3, 1e-3, 500), [1.0]]
    )
    out = np.empty_like(x)
    _logs(x, out)
    assert out[-1] == 0.0
    assert units_off(out[:-1], [mpmath.log(mpmath.mpf(float(v))) for v in x[:-1]]) < 2.0


def test_logarithm_of_quotients_from_small_to_nearly_infinite():
    random = np.random.default_rng(4)
    s = 10.0 ** random.uniform(-12, 12, 1000)
    share = np.concatenate(
        [10.0 ** random.uniform(-12, 0, 500), random.uniform(0.0, 1.0, 499), [0]]
    )
    d = share * s
    out = np.empty_like(s)
    _log_quotients(s, d, out)
    pairs = [(mpmath.mpf(float(a)), mpmath.mpf(float(b))) for a, b in zip(s, d, strict=True)]
    exact = [mpmath.log((a + b) / (a - b)) for a, b in pairs]
    assert out[-1] == 0.0
    # The sum and the difference are rounded, which is worth a unit each where the result is 0.4.
    assert units_off(out[:-1], exact[:-1]) < 5.0
    # On an edge it is finite, and what is not finite stays so.
    _log_quotients(np.array([2.0, np.nan]), np.array([2.0, 1.0]), out[:2])
    assert 35.0 < out[0] < 45.0 and np.isnan(out[1])


def test_angle_in_all_quadrants_and_on_the_axes():
    random = np.random.default_rng(1)
    x, y = random.normal(size=(2, 1000)) * 10.0 ** random.uniform(-5, 5, (2, 1000))
    axes = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [0.0, 0.0]])
    x, y = np.concatenate([x, axes[:, 0]]), np.concatenate([y, axes[:, 1]])
    out = np.empty_like(x)
    _angles(y, x, out)
    np.testing.assert_allclose(out[-5:], [0.0, np.pi / 2, np.pi, -np.pi / 2, 0.0], rtol=1e-16)
    exact = [
        mpmath.atan2(mpmath.mpf(float(b)), mpmath.mpf(float(a)))
        for a, b in zip(x[:-5], y[:-5], strict=True)
    ]
    assert units_off(out[:-5], exact) < 3.0


def test_sine_and_cosine_of_small_angles():
    x = np.concatenate([np.linspace(-SMALL_ANGLE, SMALL_ANGLE, 1001), [1e-300, -1e-9, 0.0]])
    sines, cosines = np.empty((2, x.size))
    _small(x, sines, cosines)
    assert sines[-1] == 0.0 and cosines[-1] == 1.0
    exact = [mpmath.mpf(float(v)) for v in x]
    nonzero = np.flatnonzero(x)
    assert units_off(sines[nonzero], [mpmath.sin(exact[i]) for i in nonzero]) < 1.5
    assert units_off(cosines, [mpmath.cos(v) for v in exact]) < 1.5


@pytest.mark.parametrize("rows", [1, 2, 3, 8, 11, 18])
@pytest.mark.parametrize(("inner", "columns"), [(4, 8), (20, 24), (40, 40)])
def test_product_of_even_and_odd_numbers_of_rows(rows: int, inner: int, columns: int):
    random = np.random.default_rng(rows)
    factors = random.normal(size=(rows, inner + 4))  # more columns than the product takes
    source = random.normal(size=(inner, columns))
    out = np.full((rows, columns), np.nan)
    _product(factors, source, out)
    np.testing.assert_allclose(out, factors[:, :inner] @ source, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("rows", range(1, 10))
@pytest.mark.parametrize("columns", [3, 8, 24])
def test_products_with_vectors_of_any_number_of_rows(rows: int, columns: int):
    random = np.random.default_rng(rows)
    matrix = random.normal(size=(rows, columns))
    right, left = random.normal(size=columns), random.normal(size=rows)
    out, across = np.full(rows, np.nan), np.full(columns, np.nan)
    _vector_products(matrix, right, left, out, across)
    np.testing.assert_allclose(out, matrix @ right, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(across, matrix.T @ left, rtol=1e-13, atol=1e-13)
