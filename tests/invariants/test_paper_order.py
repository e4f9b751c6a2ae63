"""How far the swimmers of the paper's scenes get in the paper's 100 s."""

import functools

import numpy as np
import pytest

from swim_env import Simulator, Trajectory, load_scene

DURATION = 100.0
#: The paper's time step, and a finer one at which the same must hold.
TIME_STEPS = [0.01, pytest.param(0.0025, marks=pytest.mark.slow)]


@functools.cache
def _play(name: str, time_step: float) -> Trajectory:
    simulator = Simulator(load_scene(f"paper_{name}", {"integrator.time_step": time_step}))
    trajectory = simulator.rollout(simulator.prescribed_torques(round(DURATION / time_step)))
    assert trajectory.termination_reason == "", f"{name}: {trajectory.termination_reason}"
    return trajectory


def _net(name: str, time_step: float) -> float:
    return float(np.hypot(*_play(name, time_step).displacement))


def _mean_speed(trajectory: Trajectory, start: float, end: float) -> float:
    """Return the speed (m/s) of the straight line that fits the path between two times best."""
    chosen = (trajectory.time >= start) & (trajectory.time <= end)
    slopes = np.polyfit(trajectory.time[chosen], trajectory.path[chosen], 1)[0]
    return float(np.hypot(*slopes))


@pytest.mark.parametrize("time_step", TIME_STEPS)
@pytest.mark.parametrize(
    ("farther", "others"),
    [
        ("i", ["ii", "iii"]),
        ("vii", ["vi"]),
        ("v", ["i", "ii", "iii", "iv", "vi", "vii", "viii", "ix"]),
    ],
)
def test_net_displacement_ranks_as_in_the_paper(
    farther: str, others: list[str], time_step: float
) -> None:
    most = _net(farther, time_step)
    rest = {name: _net(name, time_step) for name in others}
    # Claims of the paper are read off its figures; a tenth keeps them clear of chance.
    assert most > 1.1 * max(rest.values()), f"{farther} {most:.4f} m, others {rest}"


@pytest.mark.parametrize("time_step", TIME_STEPS)
def test_ix_is_slow_and_almost_straight(time_step: float) -> None:
    slow, whole = _net("ix", time_step), _net("i", time_step)
    assert 0.01 < slow < 0.5 * whole, f"ix {slow:.4f} m, i {whole:.4f} m"
    trajectory = _play("ix", time_step)
    aside = abs(trajectory.displacement[1]) / slow
    assert trajectory.displacement[0] < 0.0, f"displacement {trajectory.displacement} m"
    assert aside < 0.05, f"{aside:.1%} of the way is sideways"


@pytest.mark.parametrize("time_step", TIME_STEPS)
def test_viii_stops_advancing_when_its_torques_stop(time_step: float) -> None:
    trajectory = _play("viii", time_step)
    stop = round(50.0 / time_step)
    assert not trajectory.torques[stop:].any()
    assert trajectory.torques[stop - 1].any()
    driven = _mean_speed(trajectory, 10.0, 50.0)
    passive = _mean_speed(trajectory, 60.0, 100.0)
    assert driven > 2e-3, f"driven at {driven:.2g} m/s"
    assert passive < 1e-3 * driven, f"{passive:.2g} m/s after the torques, {driven:.2g} before"


@pytest.mark.parametrize("time_step", TIME_STEPS)
def test_viii_moves_as_i_while_its_torques_last(time_step: float) -> None:
    stop = round(50.0 / time_step) + 1
    with_torques = _play("i", time_step)
    other = _play("viii", time_step)
    assert np.array_equal(with_torques.centres[:stop], other.centres[:stop])


@pytest.mark.parametrize("name", ["i", "ii", "iii", "iv", "vi", "vii", "ix"])
def test_they_swim_head_first(name: str) -> None:
    moved = _play(name, 0.01).displacement
    assert moved[0] < -0.03, f"{name} moves by {moved} m"
