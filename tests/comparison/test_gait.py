"""Gaits in figures: signals whose frequency, wave and modes are known must come back."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from swim_agents.comparison.gait import (
    WaveFit,
    _lowest_frequency,
    analyse_gait,
    dominant_frequency,
    fit_wave,
    orthogonal_modes,
    phase_lags,
)

from swim_env import OptionError
from tests.support import refuses

Array = NDArray[np.float64]

#: The control interval (s) and the joints of scene swimmer.
INTERVAL, JOINTS = 0.02, np.arange(1, 9) / 9.0
TURN = 2.0 * math.pi

examples = settings(max_examples=30, deadline=None, derandomize=True, database=None)


def clock(count: int, start: float = 0.0) -> Array:
    return np.asarray(start + INTERVAL * np.arange(count))


def wave(
    times: Array,
    places: Array,
    frequency: float,
    wave_number: float,
    phase: float = 0.0,
    amplitude: float = 1.0,
) -> Array:
    """Return A cos(f t - kappa s/l + phase), f in rad/s."""
    return amplitude * np.cos(frequency * times[:, None] - wave_number * places + phase)


def cycles(periods: float, count: int) -> float:
    """Return the frequency (rad/s) that has so many periods in a record."""
    return TURN * periods / (count * INTERVAL)


def angle_between(one: float, other: float) -> float:
    return abs((one - other + math.pi) % TURN - math.pi)


def assert_is_wave(
    found: WaveFit, amplitude: float, frequency: float, wave_number: float, phase: float
) -> None:
    assert found.amplitude == pytest.approx(amplitude, rel=1e-6)
    assert found.frequency == pytest.approx(frequency, rel=1e-6)
    assert found.wave_number == pytest.approx(wave_number, abs=1e-6)
    assert angle_between(found.phase, phase) < 1e-6
    assert 0.0 <= found.phase <= TURN


def shares_of_waves(
    times: Array, signals: Array, places: Array, frequencies: Array, wave_numbers: Array
) -> Array:
    """Return which share of the mean square the best wave of each pair explains, (F, K).

    Written in sums of exponentials, independently of the code under test: with C and S the
    products of the signals with cosine and sine, the share is the quadratic form of (C, S) with
    the inverse of the 2 by 2 matrix of products of cosine and sine.
    """
    turned = np.exp(-1j * np.outer(frequencies, times)) @ signals
    products = turned @ np.exp(1j * np.outer(places, wave_numbers))
    c, s = products.real, -products.imag
    doubled = np.outer(
        np.exp(-2j * np.outer(frequencies, times)).sum(axis=1),
        np.exp(2j * np.outer(places, wave_numbers)).sum(axis=0),
    )
    cc, ss = 0.5 * (signals.size + doubled.real), 0.5 * (signals.size - doubled.real)
    cs = -0.5 * doubled.imag
    determinant = cc * ss - cs**2
    form = ss * c**2 - 2.0 * cs * c * s + cc * s**2
    sound = determinant > 1e-6 * signals.size**2
    explained = np.where(sound, form / np.where(sound, determinant, 1.0), 0.0)
    shares: Array = explained / (signals**2).sum()
    return shares


# ---- fits of a wave: exact answers -------------------------------------------------------------


@pytest.mark.parametrize(
    ("count", "periods"),
    # Less than a period is enough for a clean wave, and so are 2.2 instants in a period.
    [*itertools.product([24, 50, 101, 750], [3.0, 3.37, 7.5, 10.9]), (40, 0.5), (40, 0.8)],
)
@pytest.mark.parametrize("wave_number", [-12.3, -4.68, 0.0, 1e-3, 6.283, 20.0, 25.0])
def test_a_wave_is_recovered_whatever_its_direction_and_between_the_lines(
    count, periods, wave_number
):
    frequency, phase, amplitude = cycles(periods, count), 1.0 + 0.3 * wave_number, 0.37
    times = clock(count)
    found = fit_wave(times, wave(times, JOINTS, frequency, wave_number, phase, amplitude), JOINTS)
    assert_is_wave(found, amplitude, frequency, wave_number, phase)
    assert found.explained == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("elements", [3, 5, 6, 7, 27])
@pytest.mark.parametrize("part", [-0.9, -0.7, -0.3, 0.2, 0.6, 0.9])
def test_the_wave_number_is_the_one_with_less_than_half_a_turn_from_joint_to_joint(elements, part):
    # Joints cannot tell kappa from kappa + 2 pi N: of these the slow one must be reported.
    places = np.arange(1, elements) / elements
    wave_number = part * min(math.pi * elements, 8.0 * math.pi)
    times, frequency = clock(100), cycles(10.3, 100)
    found = fit_wave(times, wave(times, places, frequency, wave_number, 0.4), places)
    assert_is_wave(found, 1.0, frequency, wave_number, 0.4)


def test_the_fit_stays_at_frequencies_of_a_gait_where_the_signals_hardly_change():
    # A wave slower than one period in the record, or 0.2 Hz, is no gait.
    times, constant = clock(100), np.ones((100, 8))
    drifting = constant + 0.01 * wave(times, JOINTS, cycles(0.1, 100), 1.0)
    steered = constant + wave(times, JOINTS, 6.0, 0.0)
    for signals in (constant, drifting, steered):
        found = fit_wave(times, signals, JOINTS)
        assert found.frequency == 0.0 or found.frequency >= TURN * 0.2 * (1.0 - 1e-9)
        assert found.amplitude <= 3.0 * np.abs(signals).max()
    assert fit_wave(times, np.zeros((100, 8)), JOINTS) == WaveFit(0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(("count", "lowest"), [(8, 0.2), (100, 0.2), (250, 0.2), (1000, 0.05)])
def test_frequencies_of_a_gait_begin_in_the_bodys_own_time(count, lowest):
    for pace in (1e-5, 1.0, 1e3):
        found = _lowest_frequency(pace * INTERVAL, count)
        assert found * pace == pytest.approx(lowest, rel=1e-9)


@pytest.mark.parametrize("pace", [1e-5, 1e3])
def test_a_gait_of_a_body_of_another_size_is_the_same_in_its_own_time(pace):
    times = clock(750)
    bending = wave(times, JOINTS, TURN * 0.3, 3.0) + 0.3 * wave(times, JOINTS, TURN * 0.15, 1.0)
    torques = wave(times, JOINTS, TURN * 0.3, 4.0, 1.0) + 0.5
    here, there = (analyse_gait(at, bending, torques, JOINTS) for at in (times, pace * times))
    assert there.frequency * pace == pytest.approx(here.frequency, rel=1e-9)
    assert there.torque_frequency * pace == pytest.approx(here.torque_frequency, rel=1e-9)
    assert there.wave.frequency * pace == pytest.approx(here.wave.frequency, rel=1e-6)
    for name in ("wave_number", "travelling_share", "phase_lags"):
        assert getattr(there, name) == pytest.approx(getattr(here, name), rel=1e-6, abs=1e-9)
    assert there.wave.explained == pytest.approx(here.wave.explained, rel=1e-6)


# ---- fits of a wave: the search is global ------------------------------------------------------


def random_signals(kind: str, seed: int) -> tuple[Array, Array]:
    """Return signals that no wave explains in full, at random times."""
    random = np.random.default_rng(seed)
    if kind == "noise":
        count = int(random.integers(16, 90))
        return clock(count, random.uniform(0.0, 3.0)), random.normal(size=(count, 8))
    if kind == "long":  # as in an episode, under noise of the same strength
        times = clock(750)
        return times, wave(times, JOINTS, 30.1, -4.68) + random.normal(size=(750, 8))
    times, periods, wave_number = clock(80), random.uniform(2.0, 12.0), random.uniform(-8.0, 8.0)
    signals = wave(times, JOINTS, cycles(periods, 80), wave_number)
    if kind == "clipped":  # as networks play: at the limits most of the time
        noisy = 4.0 * signals + 2.0 * random.normal(size=signals.shape)
        return times, np.clip(noisy, -1.0, 1.0)
    if kind == "square":
        return times, np.sign(signals)
    if kind == "offset":
        return times, signals + random.uniform(-0.6, 0.6)
    other = -wave_number if kind == "standing" else random.uniform(-8.0, 8.0)
    second = periods if kind == "standing" else random.uniform(2.0, 12.0)
    return times, signals + wave(times, JOINTS, cycles(second, 80), other, 2.0, 0.95)


@pytest.mark.parametrize(
    ("kind", "seeds"),
    [
        ("noise", 40),
        ("long", 2),
        ("clipped", 12),
        ("square", 4),
        ("offset", 4),
        ("two waves", 4),
        ("standing", 4),
    ],
)
def test_no_wave_explains_more_than_the_fit(kind, seeds):
    for seed in range(seeds):
        times, signals = random_signals(kind, seed)
        random = np.random.default_rng([seed, 1])
        found = fit_wave(times, signals, JOINTS)
        lowest = TURN * min(0.2, 1.0 / (len(times) * INTERVAL))
        frequencies = random.uniform(lowest, math.pi / INTERVAL, 1000)
        wave_numbers = random.uniform(-8.0 * math.pi, 8.0 * math.pi, 400)
        shares = shares_of_waves(times, signals, JOINTS, frequencies, wave_numbers)
        row, column = np.unravel_index(int(shares.argmax()), shares.shape)
        best = f"seed {seed}: f = {frequencies[row]:.6g}, kappa = {wave_numbers[column]:.6g}"
        assert found.explained >= shares[row, column] - 1e-9, f"{best} explain more than {found}"
        assert 0.0 < found.explained < 1.0
        # What is explained is what the wave does not leave over.
        fitted = wave(
            times, JOINTS, found.frequency, found.wave_number, found.phase, found.amplitude
        )
        left = ((signals - fitted) ** 2).mean() / (signals**2).mean()
        assert found.explained == pytest.approx(1.0 - left, abs=1e-12)


# ---- fits of a wave: invariances ---------------------------------------------------------------


@settings(examples, max_examples=60)
@given(
    seed=st.integers(0, 10_000),
    exponent=st.floats(-8.0, 8.0),
    sign=st.sampled_from((-1, 1)),
    shift=st.sampled_from((0.0, 20.0)) | st.floats(-20.0, 20.0),
    turned=st.sampled_from(("", "body", "time")),
)
def test_signals_scaled_mirrored_shifted_or_turned_have_the_wave_that_follows(
    seed, exponent, sign, shift, turned
):
    random = np.random.default_rng(seed)
    times, factor = clock(90), 10.0**exponent
    # A wave with another one, an offset and noise.
    signals = wave(times, JOINTS, cycles(8.3, 90), random.uniform(-8.0, 8.0), 1.0)
    signals += wave(times, JOINTS, cycles(15.1, 90), 3.0, 2.0, 0.4)
    signals += 0.3 * random.normal(size=signals.shape) + 0.1
    seen = {"": signals, "body": signals[:, ::-1], "time": signals[::-1]}[turned]
    one = fit_wave(times, signals, JOINTS)
    other = fit_wave(clock(90, shift), sign * factor * seen, JOINTS)
    assert other.amplitude == pytest.approx(factor * one.amplitude, rel=1e-5)
    assert other.frequency == pytest.approx(one.frequency, rel=1e-5)
    wave_number = -one.wave_number if turned else one.wave_number
    assert other.wave_number == pytest.approx(wave_number, abs=1e-4)
    assert other.explained == pytest.approx(one.explained, abs=1e-9)
    phase = {
        "": one.phase,
        "body": one.phase - one.wave_number,  # s becomes 1 - s
        "time": -one.phase - one.frequency * times[-1],
    }[turned]
    phase += (0.0 if sign > 0 else math.pi) - other.frequency * shift
    assert angle_between(other.phase, phase) < (1e-3 if turned or shift else 1e-4)


# ---- orthogonal modes --------------------------------------------------------------------------


#: Places on which whole wavelengths are orthogonal.
EVERYWHERE = np.arange(24) / 24


@pytest.mark.parametrize("wave_number", [-2.0 * TURN, TURN])
@pytest.mark.parametrize("periods", [10.4, 50.7])
def test_a_pure_travelling_wave_travels(wave_number, periods):
    modes = orthogonal_modes(wave(clock(500), EVERYWHERE, cycles(periods, 500), wave_number))
    # Whole periods are exact; the Hilbert transform of others is not, least so near the ends.
    assert modes.travelling_share == pytest.approx(1.0, abs=0.02)
    assert modes.shares[0] == pytest.approx(1.0, abs=1e-3)


@examples
@given(
    forward=st.floats(0.1, 2.0),
    back=st.floats(0.1, 2.0),
    wave_number=st.floats(0.5, 12.0),
    phase=st.floats(0.0, 6.28),
)
@example(forward=1.0, back=1.0, wave_number=math.pi, phase=math.pi)  # a standing wave
@example(forward=1.0, back=0.0, wave_number=TURN, phase=0.0)  # one that only travels
def test_the_index_on_given_joints_is_that_of_the_ellipse(forward, back, wave_number, phase):
    times, frequency = clock(300), cycles(20.0, 300)
    signals = wave(times, JOINTS, frequency, wave_number, 0.0, forward)
    signals += wave(times, JOINTS, frequency, -wave_number, phase, back)
    shape = forward * np.exp(-1j * wave_number * JOINTS)
    shape += back * np.exp(1j * (wave_number * JOINTS + phase))
    # The half axes' squares: (|u|^2 +- |sum u^2|) / 2.
    power, squares = (np.abs(shape) ** 2).sum(), abs((shape**2).sum())
    expected = math.sqrt(max(power - squares, 0.0) / (power + squares))
    modes = orthogonal_modes(signals)
    assert modes.shares[0] == pytest.approx(1.0, abs=1e-9)
    assert modes.travelling_share == pytest.approx(expected, abs=1e-6)
    # The mode is the shape, up to a complex factor.
    assert abs(modes.modes[:, 0].conj() @ shape) == pytest.approx(math.sqrt(power), rel=1e-9)


def test_modes_of_two_gaits_have_their_powers():
    times, places = clock(600), EVERYWHERE
    signals = wave(times, places, cycles(30.0, 600), TURN, 0.0, 2.0)
    signals += wave(times, places, cycles(50.0, 600), -2.0 * TURN, 1.0, 1.0)
    modes = orthogonal_modes(signals)
    assert modes.shares[:2] == pytest.approx([0.8, 0.2], abs=1e-3)
    assert modes.shares[2:] == pytest.approx(0.0, abs=1e-9)


@examples
@given(
    seed=st.integers(0, 10_000),
    count=st.integers(8, 120),
    joints=st.integers(2, 12),
    exponent=st.floats(-6.0, 6.0),
)
def test_modes_are_orthonormal_and_their_shares_sum_to_one(seed, count, joints, exponent):
    random = np.random.default_rng(seed)
    signals = random.normal(size=(count, joints)) * 10.0**exponent
    modes = orthogonal_modes(signals)
    assert modes.modes.shape == (joints, joints)
    assert modes.modes.conj().T @ modes.modes == pytest.approx(np.eye(joints), abs=1e-10)
    assert modes.shares.sum() == pytest.approx(1.0, abs=1e-12)
    assert (modes.shares >= 0.0).all()
    assert (np.diff(modes.shares) <= 0.0).all()
    assert 0.0 <= modes.travelling_share <= 1.0
    # Neither means, nor the scale, nor the direction of the body matter.
    other = orthogonal_modes(-3.0 * signals[:, ::-1] + 5.0 * 10.0**exponent)
    assert other.shares == pytest.approx(modes.shares, abs=1e-9)
    assert other.travelling_share == pytest.approx(modes.travelling_share, abs=1e-6)


def test_constant_signals_have_no_modes_and_no_frequency():
    # 0.1 and 0.3 times 49 and 50 are rounded: what is left of them without their mean is not 0.
    for count, value in itertools.product([49, 50], [0.0, 0.1, 0.25, 0.3]):
        signals = np.full((count, 4), value)
        modes = orthogonal_modes(signals)
        assert not modes.shares.any() and modes.travelling_share == 0.0
        assert (modes.modes == np.eye(4)).all()
        assert dominant_frequency(clock(count), signals) == 0.0


# ---- frequency and lags ------------------------------------------------------------------------


@examples
@given(
    count=st.sampled_from([50, 100, 200, 750]),
    share=st.floats(0.0, 1.0),
    wave_number=st.floats(-6.0, 6.0),
    phase=st.floats(0.0, 6.28),
    mean=st.floats(-5.0, 5.0),
)
def test_a_dominant_frequency_is_found_to_a_hundredth_of_a_line(
    count, share, wave_number, phase, mean
):
    # With 3 periods or more in the record and 2.4 instants or more in a period.
    periods = 3.0 + share * (count / 2.4 - 3.0)
    times, spacing = clock(count), 1.0 / (count * INTERVAL)
    signals = wave(times, JOINTS, cycles(periods, count), wave_number, phase)
    for seen in (signals, signals + mean * np.arange(8)):
        found = dominant_frequency(times, seen)
        assert found == pytest.approx(periods * spacing, abs=0.01 * spacing)


def test_the_stronger_of_two_frequencies_is_dominant_summed_over_joints():
    times = clock(500)
    strong = wave(times, JOINTS, TURN * 5.0, 1.0) * np.array([0, 0, 0, 0, 0, 0, 2.0, 2.0])
    weak = wave(times, JOINTS, TURN * 2.0, 1.0) * np.array([0.9] * 8)
    assert dominant_frequency(times, strong + weak) == pytest.approx(5.0, abs=1e-3)
    assert dominant_frequency(times, 0.5 * strong + weak) == pytest.approx(2.0, abs=1e-3)


@examples
@given(
    wave_number=st.floats(-25.0, 25.0),
    periods=st.floats(3.0, 20.0),
    phase=st.floats(0.0, 6.28),
    mean=st.floats(-3.0, 3.0),
)
def test_lags_are_the_wave_number_times_the_way_unwrapped(wave_number, periods, phase, mean):
    times, frequency = clock(200), cycles(periods, 200)
    strengths = np.linspace(0.3, 1.7, 8)
    signals = strengths * wave(times, JOINTS, frequency, wave_number, phase) + mean
    lags, amplitudes = phase_lags(times, signals, frequency / TURN)
    assert lags == pytest.approx(wave_number * (JOINTS - JOINTS[0]), abs=1e-9)
    assert lags[0] == 0.0
    assert amplitudes == pytest.approx(strengths, abs=1e-9)


def test_a_gait_has_the_figures_of_its_waves():
    times = clock(500)
    strengths = np.linspace(0.05, 0.2, 8)
    bending = 0.1 + strengths * wave(times, JOINTS, TURN * 5.0, 3.0, 0.7)
    torques = wave(times, JOINTS, TURN * 2.5, -4.5, 1.1, 0.6)
    gait = analyse_gait(times, bending, torques, JOINTS)
    assert gait.frequency == pytest.approx(5.0, abs=1e-3)
    assert gait.torque_frequency == pytest.approx(2.5, abs=1e-3)
    assert gait.bending_amplitude == pytest.approx(strengths, rel=1e-3)
    assert gait.phase_lags == pytest.approx(3.0 * (JOINTS - JOINTS[0]), abs=1e-3)
    assert gait.wave_number == pytest.approx(3.0, abs=1e-3)
    assert gait.mode_share == pytest.approx(1.0, abs=1e-6)
    assert_is_wave(gait.wave, 0.6, TURN * 2.5, -4.5, 1.1)
    # The ellipse of each shape, see above.
    for found, shape in (
        (gait.travelling_share, strengths * np.exp(-3.0j * JOINTS)),
        (gait.torque_travelling_share, np.exp(4.5j * JOINTS)),
    ):
        power, squares = (np.abs(shape) ** 2).sum(), abs((shape**2).sum())
        expected = math.sqrt((power - squares) / (power + squares))
        assert found == pytest.approx(expected, abs=1e-6)


def test_the_wave_number_is_the_slope_weighted_with_the_squared_amplitudes():
    # Two joints that lag as they please, and a weak one between them that hardly counts.
    times, frequency = clock(500), TURN * 5.0
    places, lags, strengths = np.array([0.2, 0.5, 0.8]), np.array([0.0, 1.5, 1.2]), [1.0, 0.01, 1.0]
    bending = np.array(strengths) * np.cos(frequency * times[:, None] - lags)
    gait = analyse_gait(times, bending, np.zeros_like(bending), places)
    weights = np.array(strengths) ** 2
    expected = np.polynomial.polynomial.polyfit(places, lags, 1, w=np.sqrt(weights))[1]
    assert gait.wave_number == pytest.approx(expected, abs=1e-3)
    assert gait.wave_number == pytest.approx(2.0, abs=1e-2)


def test_a_gait_without_torque_has_no_wave():
    times = clock(100)
    gait = analyse_gait(times, wave(times, JOINTS, 30.0, 2.0), np.zeros((100, 8)), JOINTS)
    assert gait.torque_frequency == gait.torque_travelling_share == gait.wave.amplitude == 0.0
    assert gait.frequency == pytest.approx(30.0 / TURN, abs=0.01)


# ---- bad input ---------------------------------------------------------------------------------

TIMES = clock(40)
GOOD = wave(TIMES, JOINTS, 30.0, 2.0)


def spoilt(values: Array, bad: float) -> Array:
    copy = values.copy()
    copy.flat[3] = bad
    return copy


@pytest.mark.parametrize(
    ("call", "part"),
    [
        (lambda: fit_wave(TIMES[:-1], GOOD, JOINTS), "must have shape"),
        (lambda: fit_wave(TIMES[:7], GOOD[:7], JOINTS), "at least 8 instants"),
        (lambda: fit_wave(TIMES, GOOD, JOINTS[:-1]), "places must have shape"),
        (lambda: fit_wave(spoilt(TIMES, math.inf), GOOD, JOINTS), "finite"),
        (lambda: fit_wave(TIMES, GOOD, spoilt(JOINTS, math.nan)), "finite"),
        (lambda: fit_wave(TIMES[::-1], GOOD, JOINTS), "equidistant"),
        (lambda: dominant_frequency(TIMES**2, GOOD), "equidistant"),
        (lambda: phase_lags(TIMES[1:], GOOD, 5.0), "must have shape"),
        (lambda: orthogonal_modes(GOOD[:, 0]), "must have shape"),
        (lambda: orthogonal_modes(spoilt(GOOD, math.nan)), "finite"),
        (lambda: analyse_gait(TIMES, GOOD, GOOD[:, :7], JOINTS), "must have shape"),
        (lambda: analyse_gait(TIMES, GOOD, spoilt(GOOD, math.inf), JOINTS), "finite"),
    ],
)
def test_bad_signals_get_one_clear_error(call, part):
    with refuses(OptionError, part):
        call()
