"""A gait in figures: its frequency, how it runs along the body, and how much of it is a wave.

Everywhere `times`, (T,), are at least 8 equidistant instants (s); `signals`, (T, J), are joint
angles or torques from head to tail at these times; and `places`, (J,), are the joints' s/l.
Arguments of other shapes, and values that are not finite, raise an `OptionError`.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.errors import OptionError

Array = NDArray[np.float64]

#: Frequencies that a gait is looked for in begin at one period in so many instants (0.2 Hz at
#: 50 instants a second), or at one in the record. The little less takes in a line that is there.
_LONGEST_PERIOD = 250.0 * (1.0 + 1e-10)
#: Wave numbers (rad per body length) that a fit tries, and grid points per frequency's resolution.
_LARGEST_WAVE_NUMBER, _FINER = 8.0 * math.pi, 4
#: Peaks of that grid from which a local search starts.
_MOST_PEAKS = 12
#: Joints that bend less than this share of the largest have no phase to speak of.
_STILL = 0.01


@dataclass(frozen=True)
class WaveFit:
    """The travelling wave A cos(f t - kappa s/l + phase) that fits signals best."""

    #: A, in the signals' unit, at least 0.
    amplitude: float
    #: f (rad/s), above 0.
    frequency: float
    #: kappa (rad per body length); positive runs from head to tail.
    wave_number: float
    #: rad, in [0, 2 pi), at time 0 and s = 0.
    phase: float
    #: Share of the signals' mean square: 1 minus the mean square of the residual over that of the
    #: signals.
    explained: float


@dataclass(frozen=True)
class OrthogonalModes:
    """The complex orthogonal decomposition of signals along the body (Feeny 2008)."""

    #: Orthonormal columns, the strongest first, (J, J).
    modes: NDArray[np.complex128]
    #: Their shares of the signals' mean square, (J,).
    shares: Array
    #: Travelling index of the strongest mode, 0 for a standing wave and 1 for one that only
    #: travels: the smaller over the larger singular value of its real and imaginary part.
    travelling_share: float


@dataclass(frozen=True)
class Gait:
    """A gait in figures."""

    #: Dominant frequency of the bending (Hz).
    frequency: float
    #: Dominant frequency of the torques (Hz).
    torque_frequency: float
    #: Amplitudes of the joint angles at the bending's frequency (rad), (J,).
    bending_amplitude: tuple[float, ...]
    #: By how much each joint's bending comes after the first joint's (rad), unwrapped along the
    #: body, (J,).
    phase_lags: tuple[float, ...]
    #: Slope of the phase lags (rad per body length), weighted with the squared amplitudes.
    wave_number: float
    #: Travelling index of the bending's strongest orthogonal mode, see `OrthogonalModes`.
    travelling_share: float
    #: Share of the bending's mean square in that mode.
    mode_share: float
    #: The same index of the torques.
    torque_travelling_share: float
    #: The travelling wave nearest to the torques (N m).
    wave: WaveFit

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and lists, for JSON."""
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
        }


def analyse_gait(
    times: ArrayLike, bending: ArrayLike, torques: ArrayLike, places: ArrayLike
) -> Gait:
    """Describe a gait by joint angles (rad) at the times, and torques (N m) held from them on."""
    moments, angles, at = _checked(times, bending, places)
    _, pushes, _ = _checked(times, torques, places)
    frequency = dominant_frequency(moments, angles)
    lags, amplitudes = phase_lags(moments, angles, frequency)
    modes, torque_modes = orthogonal_modes(angles), orthogonal_modes(pushes)
    return Gait(
        frequency=frequency,
        torque_frequency=dominant_frequency(moments, pushes),
        bending_amplitude=tuple(amplitudes.tolist()),
        phase_lags=tuple(lags.tolist()),
        wave_number=_slope(at, lags, amplitudes**2),
        travelling_share=modes.travelling_share,
        mode_share=float(modes.shares[0]),
        torque_travelling_share=torque_modes.travelling_share,
        wave=fit_wave(moments, pushes, at),
    )


def dominant_frequency(times: ArrayLike, signals: ArrayLike) -> float:
    """Return the frequency (Hz) with the largest power, summed over signals without their means.

    It may lie between the lines of the discrete spectrum; 0 where the signals are constant.
    """
    moments, values, _ = _checked(times, signals)
    values = _swing(values)
    if not np.any(values):
        return 0.0
    window = np.hanning(len(values) + 2)[1:-1, None]
    interval = float(moments[1] - moments[0])
    size = 8 * len(values)
    power = (np.abs(np.fft.rfft(values * window, size, axis=0)) ** 2).sum(axis=1)
    lines = np.fft.rfftfreq(size, interval)
    power[lines < _lowest_frequency(interval, len(values))] = 0.0
    best = int(power.argmax())
    if 0 < best < len(power) - 1 and power[best - 1] > 0.0:
        # A parabola through the logarithms: exact for a Gaussian, near enough for this window.
        left, middle, right = np.log(power[best - 1 : best + 2])
        curvature = left - 2.0 * middle + right
        shift = 0.5 * (left - right) / curvature if curvature else 0.0
        return float(lines[best] + shift * (lines[1] - lines[0]))
    return float(lines[best])


def phase_lags(times: ArrayLike, signals: ArrayLike, frequency: float) -> tuple[Array, Array]:
    """Return the lags of signals behind the first one at a frequency (Hz), and their amplitudes.

    The lags, (J,) (rad), are unwrapped from signal to signal; they are 0 for the first one that
    moves, and for those that hardly do. The amplitudes, (J,), are those of the least-squares cosine
    of each signal.
    """
    moments, values, _ = _checked(times, signals)
    angle = 2.0 * math.pi * frequency * moments
    basis = np.stack([np.cos(angle), np.sin(angle), np.ones_like(angle)], axis=1)
    (a, b, _), *_ = np.linalg.lstsq(basis, values, rcond=None)
    # a cos + b sin = r cos(angle - lag)
    lags, amplitudes = np.arctan2(b, a), np.hypot(a, b)
    moving = amplitudes > _STILL * amplitudes.max(initial=0.0)
    lags[moving] = np.unwrap(lags[moving])
    first = lags[moving][0] if moving.any() else 0.0
    return np.where(moving, lags - first, 0.0), amplitudes


def orthogonal_modes(signals: ArrayLike) -> OrthogonalModes:
    """Return the eigenvectors of the covariance of the analytic signals without their means."""
    from scipy.signal import hilbert

    _, values, _ = _checked(np.arange(np.shape(signals)[0] if np.ndim(signals) else 0), signals)
    values = _swing(values)
    joints = values.shape[1]
    if not np.any(values):
        return OrthogonalModes(np.eye(joints, dtype=np.complex128), np.zeros(joints), 0.0)
    analytic = hilbert(values, axis=0)
    # The transform takes the record for periodic; its ends are left out.
    edge = len(analytic) // 20
    analytic = analytic[edge : len(analytic) - edge]
    covariance = analytic.T @ analytic.conj() / len(analytic)
    powers, modes = np.linalg.eigh(covariance)
    powers, modes = powers[::-1].clip(0.0), modes[:, ::-1]
    strongest = modes[:, 0]
    singular = np.linalg.svd(np.stack([strongest.real, strongest.imag], axis=1), compute_uv=False)
    index = float(singular[-1] / singular[0]) if joints > 1 else 0.0
    return OrthogonalModes(modes, powers / powers.sum(), index)


def fit_wave(times: ArrayLike, signals: ArrayLike, places: ArrayLike) -> WaveFit:
    """Fit a travelling wave A cos(f t - kappa s/l + phase) to signals, in the least squares.

    A grid over frequency and wave number finds the neighbourhood of the best wave, a local search
    the wave itself; amplitude and phase follow from a linear problem.
    """
    from scipy.optimize import minimize

    moments, values, at = _checked(times, signals, places)
    total = float((values**2).mean())
    if total == 0.0:
        return WaveFit(0.0, 0.0, 0.0, 0.0, 0.0)
    interval = float(moments[1] - moments[0])
    size = _FINER * len(values)
    spectrum = np.fft.rfft(values, size, axis=0)
    frequencies = 2.0 * math.pi * np.fft.rfftfreq(size, interval)
    # Joints cannot tell wave numbers that differ by a turn from joint to joint.
    spacing = float(np.abs(np.diff(at)).min()) if len(at) > 1 else math.inf
    most = min(_LARGEST_WAVE_NUMBER, math.pi / spacing)
    numbers = np.linspace(-most, most, 129)
    lowest = 2.0 * math.pi * _lowest_frequency(interval, len(values))
    highest = math.pi / interval
    # Sum over joints of the spectrum, each turned back by the wave's phase at its place.
    power = np.abs(spectrum @ np.exp(1j * np.outer(at, numbers))) ** 2
    power[frequencies < lowest] = 0.0
    step = float(frequencies[1]), float(numbers[1] - numbers[0]) or 1.0

    def left_over(point: Array) -> float:
        f, kappa = point[0] * step[0], point[1] * step[1]
        if not (lowest <= f <= highest and -most <= kappa <= most):
            return 2.0
        return _wave_at(moments, values, at, f, kappa)[2] / total

    least, where = math.inf, np.zeros(2)
    for row, column in _peaks(power):
        centre = np.array([float(row), float(numbers[column]) / step[1]])
        corners = centre + np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.5]])
        corners[1, 0] -= 1.0 if corners[1, 0] * step[0] > highest else 0.0
        corners[2, 1] -= 1.0 if corners[2, 1] * step[1] > most else 0.0
        found = minimize(
            left_over,
            centre,
            method="Nelder-Mead",
            options={"initial_simplex": corners, "xatol": 1e-7, "fatol": 1e-14, "maxiter": 2000},
        )
        if found.fun < least:
            least, where = float(found.fun), found.x
        if least < 1e-12:
            break
    frequency, wave_number = float(where[0]) * step[0], float(where[1]) * step[1]
    amplitude, phase, rest = _wave_at(moments, values, at, frequency, wave_number)
    return WaveFit(amplitude, frequency, wave_number, phase, 1.0 - rest / total)


def _peaks(power: Array) -> list[tuple[int, int]]:
    """Return where a grid has its highest local maxima, the highest first.

    Between the grid's points a peak may be higher than another one that looks higher.
    """
    from scipy.ndimage import maximum_filter

    peak = power >= np.maximum(0.6 * power.max(), maximum_filter(power, 3, mode="constant"))
    places = np.argwhere(peak)
    order = np.argsort(-power[peak])[:_MOST_PEAKS]
    return [(int(row), int(column)) for row, column in places[order]]


def _wave_at(
    moments: Array, values: Array, at: Array, frequency: float, wave_number: float
) -> tuple[float, float, float]:
    """Return amplitude, phase and mean square residual of the best wave at a frequency (rad/s)."""
    angle = frequency * moments[:, None] - wave_number * at
    cosine, sine = np.cos(angle), np.sin(angle)
    cc, ss, cs = (cosine**2).sum(), (sine**2).sum(), (cosine * sine).sum()
    determinant = cc * ss - cs**2
    c, s = (values * cosine).sum(), (values * sine).sum()
    if determinant <= 1e-12 * cc * max(ss, 1.0):
        a, b = (c / cc if cc else 0.0), 0.0
    else:
        a, b = (c * ss - s * cs) / determinant, (s * cc - c * cs) / determinant
    rest = values - a * cosine - b * sine
    # a cos + b sin = A cos(angle + phase)
    phase = math.atan2(-b, a) % (2.0 * math.pi)
    if phase == 2.0 * math.pi:  # what a tiny negative angle rounds to
        phase = 0.0
    return math.hypot(a, b), phase, float((rest**2).mean())


def _slope(x: Array, y: Array, weights: Array) -> float:
    """Return the slope of a weighted straight line."""
    if len(x) < 2 or weights.sum() == 0.0:
        return 0.0
    x0, y0 = (float(np.average(one, weights=weights)) for one in (x, y))
    return float((weights * (x - x0) * (y - y0)).sum() / (weights * (x - x0) ** 2).sum())


def _checked(
    times: ArrayLike, signals: ArrayLike, places: ArrayLike | None = None
) -> tuple[Array, Array, Array]:
    moments = np.asarray(times, dtype=np.float64)
    values = np.asarray(signals, dtype=np.float64)
    at = np.zeros(0) if places is None else np.asarray(places, dtype=np.float64)
    if values.ndim != 2 or moments.shape != values.shape[:1] or len(moments) < 8:
        raise OptionError(
            "signals must have shape (T, J) and times (T,) with at least 8 instants, got "
            f"{values.shape} and {moments.shape}"
        )
    steps = np.diff(moments)
    if places is not None and at.shape != values.shape[1:]:
        raise OptionError(f"places must have shape ({values.shape[1]},), got {at.shape}")
    if not all(np.isfinite(one).all() for one in (values, moments, at)):
        raise OptionError("times and signals must be finite")
    if not (steps[0] > 0.0 and np.allclose(steps, steps[0], rtol=1e-6, atol=0.0)):
        raise OptionError("times must be equidistant and rising")
    return moments, values, at


def _lowest_frequency(interval: float, count: int) -> float:
    """Return where the frequencies (Hz) of a gait begin in a record of so many instants."""
    return 1.0 / (interval * max(_LONGEST_PERIOD, count))


def _swing(values: Array) -> Array:
    """Return signals without their means, exactly 0 where they are constant."""
    return np.where(np.ptp(values, axis=0) > 0.0, values - values.mean(axis=0), 0.0)
