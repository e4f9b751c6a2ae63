"""Exact added mass of bodies whose exterior is a conformal map of the circle's."""

import functools

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

_TERMS = 20_000


def mapped_mass(boundary: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the (3, 3) added mass of unit density of a body given by f(e^{i t}).

    On the boundary the stream function of the unit motions along x, along y and about the origin
    is y, -x and -|z|^2/2 up to a constant. With Fourier coefficients c_n in the circle's plane,
    where energy is the same, twice the energy is 2 pi sum_n |n| |c_n|^2.
    """
    stream = np.array([boundary.imag, -boundary.real, -0.5 * np.abs(boundary) ** 2])
    c = np.fft.fft(stream, axis=1) / len(boundary)
    order = np.abs(np.fft.fftfreq(len(boundary), 1.0 / len(boundary)))
    mass: NDArray[np.float64] = 2.0 * np.pi * ((c * order) @ c.conj().T).real
    return mass


def series_boundary(coefficients: list[complex], points: int) -> NDArray[np.complex128]:
    """Return f = zeta + sum_k c_k zeta^-k at equidistant points of the unit circle."""
    zeta = np.exp(2j * np.pi * np.arange(points) / points)
    return zeta + sum(c * zeta ** -(k + 1.0) for k, c in enumerate(coefficients))


def _rectangle_series(alpha: float) -> NDArray[np.float64]:
    """Return a_n of f = zeta - sum_n a_n zeta^(1 - 2 n); Schwarz and Christoffel.

    f' is the root of the product of (1 - zeta_k/zeta) over the corners at +-exp(+-i alpha), that
    is, the generating function of the Gegenbauer polynomials of order -1/2.
    """
    x = np.cos(2.0 * alpha)
    g = [1.0, -x]
    for n in range(2, _TERMS):
        g.append((2.0 * x * (n - 1.5) * g[-1] - (n - 3.0) * g[-2]) / n)
    n = np.arange(1, _TERMS)
    return np.array(g[1:]) / (2.0 * n - 1.0)


def _corner(alpha: float) -> complex:
    n = np.arange(1, _TERMS)
    tail = _rectangle_series(alpha) * np.exp(1j * alpha * (1.0 - 2.0 * n))
    return complex(np.exp(1j * alpha) - tail.sum())


@functools.cache
def rectangle_mass(width: float, height: float) -> NDArray[np.float64]:
    """Return the diagonal (3,) of a rectangle's added mass about its centre at unit density."""
    alpha = brentq(
        lambda a: _corner(a).imag * width - _corner(a).real * height, 1e-3, 1.5, xtol=1e-13
    )
    points = 4 * _TERMS
    spectrum = np.zeros(points, dtype=complex)
    spectrum[1] = 1.0
    spectrum[1 - 2 * np.arange(1, _TERMS)] = -_rectangle_series(alpha)
    scale = 0.5 * width / _corner(alpha).real
    return np.diag(mapped_mass(scale * np.fft.ifft(spectrum) * points))
