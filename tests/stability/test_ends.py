"""Ends of runs: folds, steps that cannot be solved or are cut, spins, and what comes after."""

import time

import numpy as np
import pytest

from swim_env import (
    TERMINATION_REASONS,
    Initial,
    SimulationEndedError,
    Simulator,
    Trajectory,
    load_scene,
)
from tests.support import refuses

BAD_STARTS: dict[str, tuple[Initial, str]] = {
    "sharp mitre": (Initial(joint_angles=[3.0] + [0.0] * 7), "outline_degenerate"),
    "past a full turn": (Initial(joint_angles=[0.0] * 7 + [6.4]), "outline_degenerate"),
    "folded onto itself": (Initial(joint_angles=2.9), "outline_degenerate"),
    "closed ring": (Initial(joint_angles=2.0 * np.pi / 9.0), "under_resolved_gap"),
    "wound up": (Initial(joint_angles=0.9), "under_resolved_gap"),
    "crossing itself": (Initial(joint_angles=[0.0] + [1.5] * 3 + [0.0] * 4), "under_resolved_gap"),
    "overflowing energy": (Initial(velocity=(1e200, 1e200)), "state_not_finite"),
}
#: Torques (N m) of which the first step cannot be solved, whatever the scene.
each_torque = pytest.mark.parametrize("torque", [1e3, 1e6, 1e12, 1e300])
each_scene = pytest.mark.parametrize("name", ["paper_i", "swimmer", "paper_iv", "paper_xii"])


@pytest.mark.parametrize("name", BAD_STARTS)
def test_a_start_that_is_refused_leaves_the_simulator_as_it_was(name):
    start, reason = BAD_STARTS[name]
    simulator = Simulator("paper_i")
    simulator.rollout(simulator.prescribed_torques(10))
    before = simulator.snapshot()
    scene = simulator.scene.replace("initial", start)
    for begin in (lambda: simulator.reset(start), lambda: Simulator(scene)):
        with refuses(SimulationEndedError, f"t = 0 s: {reason}") as caught:
            begin()
        assert (caught.value.reason, caught.value.time) == (reason, 0.0)
    assert simulator.snapshot() == before, "the refused reset changed the state"


def pushed(name: str, torque: float) -> tuple[Simulator, np.ndarray]:
    """Return a simulator on its way, and torques that it cannot bear."""
    simulator = Simulator(name)
    simulator.rollout(simulator.prescribed_torques(20))
    return simulator, torque * np.cos(np.arange(simulator.elements - 1))


@each_torque
@each_scene
def test_a_step_that_cannot_be_solved_ends_by_name(name, torque):
    simulator, held = pushed(name, torque)
    with pytest.raises(SimulationEndedError) as caught:
        for _ in range(3):
            before = simulator.coordinates, simulator.momentum()
            simulator.step(held)
    assert caught.value.reason in TERMINATION_REASONS, caught.value.reason
    assert caught.value.time == simulator.time
    assert np.array_equal(before[0], simulator.coordinates), "the failed step moved the beam"
    assert np.array_equal(before[1], simulator.momentum()), "it changed the momentum"
    assert np.isfinite(simulator.coordinates).all()


@pytest.mark.release
@each_torque
@each_scene
def test_a_step_that_cannot_be_solved_ends_in_about_a_second(name, torque):
    simulator, held = pushed(name, torque)
    start = time.perf_counter()
    simulator.rollout(np.tile(held, (3, 1)))
    assert time.perf_counter() - start < 3.0


@pytest.mark.parametrize("torque", [40.0, 1e6])
def test_a_rollout_to_the_end_says_why_and_nothing_is_played_until_a_reset(torque):
    simulator = Simulator("swimmer")
    torques = simulator.prescribed_torques(40)
    fresh = simulator.rollout(torques)
    simulator.reset()
    violent = np.concatenate([torques[:30], np.full((2000, 8), torque)])
    run = simulator.rollout(violent)
    assert run.steps == 30 if torque == 1e6 else 30 < run.steps < 2030
    assert run.time[-1] == simulator.time == pytest.approx(run.steps * simulator.time_step)
    assert np.array_equal(run.centres[-1], simulator.centres)
    assert run.termination_reason == simulator.termination_reason in TERMINATION_REASONS
    for name in ("centres", "angles", "momentum", "energy", "work", "dissipated"):
        assert np.isfinite(getattr(run, name)).all(), name
    assert run.summary()["termination_reason"] == run.termination_reason
    assert np.isfinite(run.summary()["energy_drift"])
    ended = simulator.snapshot()
    for again in (lambda: simulator.step(np.zeros(8)), lambda: simulator.rollout(torques)):
        with refuses(SimulationEndedError, f"t = {simulator.time:.6g} s") as caught:
            again()
        assert (caught.value.reason, caught.value.time) == (run.termination_reason, simulator.time)
    assert simulator.snapshot() == ended, "a refused step changed the state"
    simulator.reset()
    assert simulator.termination_reason == "" and simulator.steps == 0
    again_played = simulator.rollout(torques)
    assert np.array_equal(again_played.centres, fresh.centres), "the reset left something behind"


# ---- cut steps ---------------------------------------------------------------------------------


def spin(time_step: float) -> Trajectory:
    """Spin three elements about their middle at 60 rad/s for a second."""
    scene = load_scene(
        "paper_iv",
        {
            "actuation": None,
            "initial.turning_rate": 60.0,
            "initial.velocity_slope": 60.0,
            "initial.velocity": (0.0, -30.0),
            "integrator.time_step": time_step,
        },
    )
    run = Simulator(scene).rollout(np.zeros((round(1.0 / time_step), 2)))
    assert run.termination_reason == "", run.termination_reason
    return run


def test_a_fast_spin_is_cut_into_parts_which_are_the_steps_of_a_finer_run():
    cut, fine = spin(0.01), spin(0.0025)
    assert (cut.parts > 1).all(), f"parts {np.unique(cut.parts)}"
    assert cut.duration == pytest.approx(1.0), "the outer step changed its length"
    turned = cut.heading_change
    assert abs(turned / 60.0 - 1.0) < 0.02, f"turned by {turned:.3f} rad, not about 60"
    middle = np.abs(cut.displacement).max()
    assert middle < 1e-10, f"the middle moved by {middle:.2g} m"
    figures = cut.summary()
    assert figures["momentum_drift"] < 1e-9, figures["momentum_drift"]
    assert figures["energy_drift"] < 0.02, figures["energy_drift"]
    assert (fine.parts == 1).all(), f"parts {np.unique(fine.parts)}"
    calm = np.flatnonzero(cut.parts != 4)
    upto = int(calm[0]) if calm.size else cut.steps
    assert upto >= 20, f"parts {cut.parts[:20]}"
    error = np.abs(cut.angles[: upto + 1] - fine.angles[::4][: upto + 1]).max()
    assert error < 1e-6, f"angles differ by {error:.2g} rad over {upto} steps"


def test_whole_steps_return_once_the_motion_calms_down():
    simulator = Simulator(load_scene("swimmer", {"integrator.time_step": 0.01}))
    kick = 20.0 * np.tile([1.0, -1.0], 4)
    run = simulator.rollout(np.concatenate([kick[None], np.zeros((60, 8))]))
    assert run.parts[0] > 1, f"parts {run.parts[:10]}"
    assert (run.parts[-40:] == 1).all(), f"parts {run.parts}"
    figures = run.summary()
    assert figures["halved_steps"] == (run.parts > 1).sum() > 0
    assert figures["most_parts"] == run.parts.max() > 1


# ---- tolerances --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["paper_i", "swimmer", "paper_v"])
def test_the_finest_tolerance_is_met(name):
    simulator = Simulator(load_scene(name, {"integrator.tolerance": 1e-13}))
    run = simulator.rollout(simulator.prescribed_torques(500))
    assert run.termination_reason == ""
    assert run.summary()["round_off_steps"] == 0
    assert 0.0 < run.residual.max() <= 1e-13


@pytest.mark.parametrize("thickness", [0.08, 0.1, 0.15, 0.2])
@pytest.mark.parametrize("bend", [0.02, 0.3])
def test_thick_bodies_with_a_straight_part_are_resolved(thickness, bend):
    """Panels on one line that is turned lie on either side of it by rounding, and do not cross."""
    scene = load_scene("swimmer", {"beam.half_thickness": thickness, "fluid.cap_panels": 4})
    for joint in range(8):
        angles = [bend * (joint == k) for k in range(8)]
        Simulator(scene.replace({"initial.joint_angles": angles, "initial.heading": 0.3})).energy()
