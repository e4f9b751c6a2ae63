"""The figures of an episode, each computed once more from what was recorded."""

import json
import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from swim_agents import Rollout, load_policy, play_episode, verify_rollout
from swim_agents.baselines import tuned_wave
from swim_agents.comparison.gait import analyse_gait
from swim_agents.comparison.performance import Performance, measure_performance
from swim_agents.tuned_wave import load_tuned_wave
from swim_agents.verification import fine_scene

from swim_env import SwimEnv, SwimTargetEnv, Trajectory

POLICIES = ("tuned_wave", "zero", "random", "paper_wave")
BODIES: dict[str, tuple[str, ...]] = {
    "swimmer": ("episode.duration=2.0",),
    # Nothing about it is 1, and it swims along a slanted line.
    "other body": (
        "episode.duration=2.0",
        "episode.heading=[-0.8, 0.6]",
        "initial.heading=-0.6435011087932844",
        "beam.length=1.3",
        "beam.line_density=0.4",
        "actuation.torque_limit=0.7",
    ),
}

Played = tuple[Rollout, Trajectory, Performance]


def measured(rollout: Rollout) -> Played:
    trajectory = rollout.simulate()
    return rollout, trajectory, measure_performance(rollout, trajectory, verify_rollout(rollout))


def play(env: SwimEnv, name: str, noise: float = 1.0) -> Rollout:
    """Play a policy's episode, the tuned wave's on any body."""
    tuned = name == "tuned_wave"
    policy = tuned_wave(env.scene) if tuned else load_policy(name, env.scene, seed=5)
    return play_episode(env, policy, seed=3, options={"noise": noise}, any_scene=tuned)


def finely(rollout: Rollout, name: str, noise: float = 1.0) -> Rollout:
    """Play an episode's policy in the finer scene."""
    return play(SwimEnv(fine_scene(rollout.scene)), name, noise)


@cache
def played(
    name: str, body: str = "swimmer", task: str = "forward", noise: float = 1.0, extra: str = ""
) -> Played:
    made = SwimTargetEnv if task == "target" else SwimEnv
    env = made("swimmer", [*BODIES[body], *extra.split()])
    return measured(play(env, name, noise))


each_policy = pytest.mark.parametrize("name", POLICIES)
every_body = pytest.mark.parametrize("body", BODIES)


# ---- motion and effort ---------------------------------------------------------------------------


@each_policy
@every_body
def test_the_figures_are_those_computed_once_more(name, body):
    rollout, run, figures = played(name, body)
    scene, beam = rollout.scene, rollout.scene.beam
    assert (figures.seed, figures.success, figures.termination_reason) == (3, None, "")
    # The way of the mean centre along the heading.
    way = run.centres[-1].mean(axis=0) - run.centres[0].mean(axis=0)
    metres = float(np.dot(way, scene.episode.heading))
    along = metres / beam.length
    assert figures.net_displacement == pytest.approx(along, rel=1e-9, abs=1e-12)
    assert figures.net_displacement != 0.0
    assert figures.duration == pytest.approx(2.0, abs=1e-12)
    assert figures.speed == pytest.approx(along / 2.0, rel=1e-9, abs=1e-12)
    turn = run.angles[-1].mean() - run.angles[0].mean()
    assert figures.heading_change == pytest.approx(turn, abs=1e-14)
    # Verification.
    checked = verify_rollout(rollout)
    assert figures.fine_displacement == checked.fine_displacement != figures.net_displacement
    assert figures.verified is checked.verified
    finer = {
        "time_step": {
            "integrator.time_step": 0.25 * scene.integrator.time_step,
            "integrator.tolerance": 1e-6,
        },
        "panels": {"fluid.panels_per_element": 12},
        "ends": {"fluid.cap_panels": 6},
    }
    finer["together"] = {key: value for one in finer.values() for key, value in one.items()}
    drifts = []
    for source, changes in finer.items():
        played_again = rollout.simulate(scene.replace(changes))
        drifts.append(played_again.energy_drift)
        way = played_again.centres[-1].mean(axis=0) - run.centres[0].mean(axis=0)
        gap = float(np.dot(way, scene.episode.heading)) / beam.length - along
        change = getattr(figures, f"{source}_change")
        assert change == pytest.approx(gap / abs(along), rel=1e-6, abs=1e-9), source
    assert figures.fine_energy_drift == max(drifts)
    assert figures.closed_displacement is figures.closed_loop_change is None
    # And with the policy in the finer scene, as contests do it.
    closed_loop = finely(rollout, name)
    checked = verify_rollout(rollout, closed_loop)
    closed = measure_performance(rollout, run, checked)
    assert closed.closed_displacement == closed_loop.net_displacement
    assert closed.closed_loop_change == checked.changes["closed_loop"] != 0.0
    assert closed.closed_energy_drift == closed_loop.info["energy_drift"]
    assert (closed.closed_termination_reason, closed.closed_success) == ("", None)
    # Torque times bending where it is positive, over mass and way.
    turned = np.diff(np.diff(run.angles, axis=1), axis=0)
    work = np.maximum(run.torques * turned, 0.0).sum()
    assert figures.positive_work == pytest.approx(work, rel=1e-9)
    assert (figures.positive_work > 1e-3) == (name != "zero")
    work = float(run.positive_work.sum())
    if metres > 0.0:
        cost = work / (beam.line_density * beam.length * metres)
        assert figures.cost_of_transport == pytest.approx(cost, rel=1e-9)
    else:
        assert figures.cost_of_transport == math.inf
    # What the balance misses of what went through.
    miss = run.energy[1:] - run.energy[0] - np.cumsum(run.work) + np.cumsum(run.dissipated)
    drift = np.abs(miss).max() / (run.energy.max() + np.maximum(run.dissipated, 0.0).sum())
    assert figures.energy_drift == pytest.approx(drift, rel=1e-9, abs=1e-12)
    assert 0.0 < figures.energy_drift < 0.2
    # Plain values, for JSON.
    data = json.loads(json.dumps(figures.to_dict(), allow_nan=False))
    assert data.keys() == vars(figures).keys()
    assert data["net_displacement"] == figures.net_displacement
    assert data["verified"] is figures.verified
    assert figures.gait is not None
    assert data["gait"]["phase_lags"] == list(figures.gait.phase_lags)
    assert data["gait"]["wave"] == vars(figures.gait.wave)
    assert (data["cost_of_transport"] is None) == math.isinf(figures.cost_of_transport)
    # Squared torques, integrated over time and summed over joints.
    integral = (rollout.torques**2).sum() * scene.episode.control_interval
    assert figures.torque_squared == pytest.approx(integral, rel=1e-12)
    if name == "tuned_wave" and body == "swimmer":
        # A cosine of amplitude 1 N m at 8 joints for 2 s.
        assert figures.torque_squared == pytest.approx(0.5 * 8 * 2.0, rel=0.02)


@each_policy
def test_the_net_displacement_to_a_target_is_by_how_much_it_came_closer(name):
    rollout, run, figures = played(name, task="target")
    start, end = run.centres[[0, -1]].mean(axis=1)
    closer = math.dist(rollout.goal, start) - math.dist(rollout.goal, end)
    closer /= rollout.scene.beam.length
    assert figures.net_displacement == pytest.approx(closer, abs=1e-12)
    assert figures.speed == pytest.approx(closer / 2.0, abs=1e-12)
    assert figures.success is False


# ---- gait --------------------------------------------------------------------------------------


@each_policy
@every_body
def test_the_gait_is_that_of_the_last_three_quarters(name, body):
    rollout, run, figures = played(name, body)
    gait = figures.gait
    assert gait is not None
    # The first 25 of 100 actions do not count.
    hold = rollout.scene.steps_per_action
    bending = np.diff(run.angles[hold * np.arange(25, 100)], axis=1)
    times = 0.02 * np.arange(25, 100)
    expected = analyse_gait(times, bending, rollout.torques[25:], np.arange(1, 9) / 9.0)
    assert gait.frequency == pytest.approx(expected.frequency, rel=1e-12)
    assert gait.bending_amplitude == pytest.approx(expected.bending_amplitude, rel=1e-9)
    for figure in ("phase_lags", "wave_number", "travelling_share"):
        assert getattr(gait, figure) == pytest.approx(getattr(expected, figure), abs=1e-9), figure
    assert gait.wave.explained == pytest.approx(expected.wave.explained, abs=1e-9)
    assert gait.wave.frequency == pytest.approx(expected.wave.frequency, rel=1e-6)
    per_cycle = figures.speed / gait.frequency
    assert figures.displacement_per_cycle == pytest.approx(per_cycle, rel=1e-12)
    assert math.isfinite(figures.displacement_per_cycle)


def test_the_tuned_waves_own_torques_are_recovered_with_the_episodes_clock():
    _, _, figures = played("tuned_wave")
    stored = load_tuned_wave()["wave"]
    assert figures.gait is not None
    wave = figures.gait.wave
    assert wave.amplitude == pytest.approx(stored["amplitude"], rel=1e-5)
    assert wave.frequency == pytest.approx(stored["frequency"], rel=1e-5)
    assert wave.wave_number == pytest.approx(stored["wave_number"], abs=1e-5)
    assert wave.phase == pytest.approx(stored["phase"], abs=1e-4)
    assert wave.explained == pytest.approx(1.0, abs=1e-9)
    _, _, noise = played("random")  # is no wave
    assert noise.gait is not None and 0.0 < noise.gait.wave.explained < 0.1
    # The body swings as it is driven; a line of this short record's spectrum is 0.67 Hz wide.
    hertz = stored["frequency"] / (2.0 * math.pi)
    assert figures.gait.torque_frequency == pytest.approx(hertz, abs=0.01)
    assert figures.gait.frequency == pytest.approx(hertz, abs=0.3)


def test_a_body_at_rest_has_no_gait_and_no_finite_cost():
    _, _, figures = played("zero", noise=0.0)
    assert figures.gait is None
    for name in ("net_displacement", "speed", "positive_work", "torque_squared"):
        assert getattr(figures, name) == 0.0, name
    assert figures.cost_of_transport == math.inf
    assert math.isnan(figures.displacement_per_cycle)
    assert figures.verified
    data = figures.to_dict()
    assert data["cost_of_transport"] is data["displacement_per_cycle"] is data["gait"] is None


@pytest.mark.parametrize(("duration", "enough"), [("0.42", False), ("0.44", True)])
def test_sixteen_actions_after_the_start_make_a_gait(duration, enough):
    _, _, figures = played("tuned_wave", extra=f"episode.duration={duration}")
    assert (figures.gait is not None) == enough
    assert math.isfinite(figures.displacement_per_cycle) == enough
    json.dumps(figures.to_dict(), allow_nan=False)


# ---- ends before the time ----------------------------------------------------------------------


def test_a_broken_episode_counts_up_to_its_end():
    # A soft beam folds under the torque, in the middle of an action.
    rollout, run, figures = played("paper_wave", noise=0.0, extra="beam.bending_stiffness=0.05")
    assert figures.termination_reason == rollout.info["termination_reason"] != ""
    assert not figures.verified
    hold, step = rollout.scene.steps_per_action, rollout.scene.integrator.time_step
    assert run.steps == rollout.steps < hold * len(rollout.torques)
    assert figures.duration == pytest.approx(step * rollout.steps, abs=1e-12)
    assert figures.duration < 2.0
    assert figures.speed == pytest.approx(figures.net_displacement / figures.duration, rel=1e-12)
    held = np.repeat(rollout.torques, hold, axis=0)[: rollout.steps]
    assert figures.torque_squared == pytest.approx((held**2).sum() * step, rel=1e-12)
    json.dumps(figures.to_dict(), allow_nan=False)


def test_a_target_that_is_reached_is_a_success():
    env = SwimTargetEnv("swimmer", ["episode.duration=2.0", "episode.velocity_noise=0.0"])
    policy = load_policy("zero", env.scene)
    options: dict[str, Any] = {"noise": 0.0, "velocity": [-0.5, 0.0], "target": [0.2, 0.0]}
    rollout, _, figures = measured(play_episode(env, policy, seed=0, options=options))
    assert rollout.terminated
    assert figures.success is True
    assert figures.termination_reason == "target_reached"
    assert figures.verified
    assert figures.duration < 2.0
    # From 0.3 m to within 0.1 BL.
    assert 0.2 <= figures.net_displacement < 0.25


# ---- plain values ------------------------------------------------------------------------------


def test_a_start_without_a_seed_is_minus_one():
    env = SwimEnv("swimmer", ["episode.duration=0.1"])
    rollout = play_episode(env, load_policy("zero", env.scene), options={"noise": 0.0})
    assert measured(rollout)[2].seed == -1
