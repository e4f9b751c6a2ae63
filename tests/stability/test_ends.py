"""Hard cases: folds, closing gaps, steps that cannot be solved, spins, and what comes after."""

from __future__ import annotations

import time

import numpy as np
import pytest

from swim_env import (
    TERMINATION_REASONS,
    Scene,
    SimulationEndedError,
    Simulator,
    Trajectory,
    load_scene,
)

REASONS = set(TERMINATION_REASONS)
FOLDS: dict[str, tuple[list[float], str]] = {
    "sharp mitre": ([3.0] + [0.0] * 7, "outline_degenerate"),
    "past a full turn": ([0.0] * 7 + [6.4], "outline_degenerate"),
    "closed ring": ([2.0 * np.pi / 9.0] * 8, "under_resolved_gap"),
    "wound up": ([0.9] * 8, "under_resolved_gap"),
    "crossing itself": ([0.0, 1.5, 1.5, 1.5, 0.0, 0.0, 0.0, 0.0], "under_resolved_gap"),
}
KICK = 20.0 * np.tile([1.0, -1.0], 4)


def _bent(angles: list[float]) -> Scene:
    return load_scene("paper_i", {"initial.joint_angles": angles})


def _assert_finite(trajectory: Trajectory) -> None:
    for name in ("centres", "angles", "momentum", "energy", "work", "dissipated"):
        values = getattr(trajectory, name)
        bad = np.argwhere(~np.isfinite(values))
        assert not bad.size, f"{name}[{bad[0, 0]}] of {len(values)} is {values[tuple(bad[0])]}"


@pytest.mark.parametrize("name", FOLDS)
def test_a_body_folded_onto_itself_is_refused_with_the_reason_and_time(name: str) -> None:
    angles, reason = FOLDS[name]
    with pytest.raises(SimulationEndedError) as caught:
        Simulator(_bent(angles))
    assert caught.value.reason == reason, str(caught.value)
    assert caught.value.time == 0.0
    assert f"t = 0 s: {reason}" in str(caught.value), str(caught.value)


def test_a_fold_that_reset_refuses_leaves_the_simulator_as_it_was() -> None:
    simulator = Simulator("paper_i")
    simulator.rollout(simulator.prescribed_torques(10))
    before = simulator.snapshot()
    with pytest.raises(SimulationEndedError) as caught:
        simulator.reset(_bent(FOLDS["closed ring"][0]).initial)
    assert caught.value.reason == "under_resolved_gap"
    assert simulator.snapshot() == before, "the refused reset changed the state"


@pytest.mark.parametrize("retardation", [0.001, 0.05, None])
def test_curling_up_ends_when_the_gap_closes(retardation: float | None) -> None:
    damping = None if retardation is None else {"retardation_time": retardation}
    simulator = Simulator(load_scene("swimmer", {"damping": damping}))
    ramp = np.linspace(0.0, 45.0, 400)[:, None] * np.ones(8)
    trajectory = simulator.rollout(ramp)
    # Slowly enough, it is the gap that closes by and by.
    ends = {"under_resolved_gap"} | ({"outline_degenerate"} if retardation != 0.05 else set())
    assert trajectory.termination_reason in ends, f"after {trajectory.steps} steps"
    assert 0 < trajectory.steps < 400, trajectory.steps
    bend = np.abs(np.diff(trajectory.angles, axis=1)).max()
    assert bend > 0.5, f"ended at a joint angle of {bend:.2f} rad"
    assert simulator.steps == trajectory.steps
    assert np.array_equal(simulator.centres, trajectory.centres[-1])
    assert np.isfinite(simulator.coordinates).all()
    assert np.isfinite(simulator.momentum()).all()
    _assert_finite(trajectory)


@pytest.mark.parametrize("torque", [1e3, 1e6, 1e12, 1e300])
@pytest.mark.parametrize("name", ["paper_i", "swimmer", "paper_iv", "paper_xii"])
def test_a_step_that_cannot_be_solved_ends_by_name(name: str, torque: float) -> None:
    simulator = Simulator(name)
    simulator.rollout(simulator.prescribed_torques(20))
    before = simulator.coordinates, simulator.momentum()
    held = torque * np.cos(np.arange(simulator.elements - 1))
    with pytest.raises(SimulationEndedError) as caught:
        for _ in range(3):
            before = simulator.coordinates, simulator.momentum()
            simulator.step(held)
    assert caught.value.reason in REASONS, caught.value.reason
    assert caught.value.time == simulator.time
    after = simulator.coordinates, simulator.momentum()
    assert np.array_equal(before[0], after[0]), "the failed step moved the beam"
    assert np.array_equal(before[1], after[1]), "the failed step changed the momentum"
    assert np.isfinite(after[0]).all()


@pytest.mark.release
@pytest.mark.parametrize("torque", [1e3, 1e6, 1e12, 1e300])
@pytest.mark.parametrize("name", ["paper_i", "swimmer", "paper_iv", "paper_xii"])
def test_a_step_that_cannot_be_solved_ends_in_about_a_second(name: str, torque: float) -> None:
    simulator = Simulator(name)
    simulator.rollout(simulator.prescribed_torques(20))
    held = torque * np.cos(np.arange(simulator.elements - 1))
    start = time.perf_counter()
    simulator.rollout(np.tile(held, (3, 1)))
    assert time.perf_counter() - start < 3.0


def test_after_the_end_steps_are_refused_until_a_reset() -> None:
    simulator = Simulator("swimmer")
    torques = simulator.prescribed_torques(50)
    fresh = simulator.rollout(torques)
    with pytest.raises(SimulationEndedError) as first:
        simulator.step(np.full(8, 1e6))
    assert simulator.termination_reason == first.value.reason != ""
    ended = simulator.snapshot()
    for again in (lambda: simulator.step(np.zeros(8)), lambda: simulator.rollout(torques)):
        with pytest.raises(SimulationEndedError) as caught:
            again()
        assert (caught.value.reason, caught.value.time) == (first.value.reason, first.value.time)
    assert simulator.snapshot() == ended, "a refused step changed the state"
    simulator.reset()
    assert simulator.termination_reason == ""
    assert simulator.steps == 0
    again_played = simulator.rollout(torques)
    assert np.array_equal(again_played.centres, fresh.centres), "the reset left something behind"


def test_a_rollout_to_the_end_says_why_and_the_next_one_raises() -> None:
    simulator = Simulator("swimmer")
    torques = simulator.prescribed_torques(40)
    torques[30:] = 1e6
    trajectory = simulator.rollout(torques)
    assert trajectory.steps == 30, trajectory.steps
    assert trajectory.termination_reason in REASONS
    assert trajectory.time[-1] == 30 * 0.005
    _assert_finite(trajectory)
    with pytest.raises(SimulationEndedError):
        simulator.rollout(torques)


class TestCutSteps:
    @staticmethod
    def _spin(time_step: float) -> Trajectory:
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
        trajectory = Simulator(scene).rollout(np.zeros((round(1.0 / time_step), 2)))
        assert trajectory.termination_reason == "", trajectory.termination_reason
        return trajectory

    def test_a_fast_spin_is_cut_into_parts_and_works(self) -> None:
        trajectory = self._spin(0.01)
        assert (trajectory.parts > 1).all(), f"parts {np.unique(trajectory.parts)}"
        assert trajectory.duration == pytest.approx(1.0), "the outer step changed its length"
        turned = trajectory.heading_change
        assert abs(turned / 60.0 - 1.0) < 0.02, f"turned by {turned:.3f} rad, not about 60"
        middle = np.abs(trajectory.displacement).max()
        assert middle < 1e-10, f"the middle moved by {middle:.2g} m"
        figures = trajectory.summary()
        assert figures["momentum_drift"] < 1e-9, figures["momentum_drift"]
        assert figures["energy_drift"] < 0.02, figures["energy_drift"]

    def test_parts_of_a_step_are_the_steps_of_a_finer_run(self) -> None:
        cut = self._spin(0.01)
        fine = self._spin(0.0025)
        assert (fine.parts == 1).all(), f"parts {np.unique(fine.parts)}"
        calm = np.flatnonzero(cut.parts != 4)
        upto = int(calm[0]) if calm.size else cut.steps
        assert upto >= 20, f"parts {cut.parts[:20]}"
        error = np.abs(cut.angles[: upto + 1] - fine.angles[::4][: upto + 1]).max()
        assert error < 1e-6, f"angles differ by {error:.2g} rad over {upto} steps"

    def test_whole_steps_return_once_the_motion_calms_down(self) -> None:
        simulator = Simulator(load_scene("swimmer", {"integrator.time_step": 0.01}))
        trajectory = simulator.rollout(np.concatenate([KICK[None], np.zeros((60, 8))]))
        parts = trajectory.parts
        assert parts[0] > 1, f"parts {parts[:10]}"
        assert (parts[-40:] == 1).all(), f"parts {parts}"
        figures = trajectory.summary()
        assert figures["halved_steps"] == (parts > 1).sum() > 0
        assert figures["most_parts"] == parts.max() > 1


class TestTolerance:
    @pytest.mark.parametrize("name", ["paper_i", "swimmer", "paper_v"])
    def test_the_finest_tolerance_stops_at_round_off_and_says_so(self, name: str) -> None:
        simulator = Simulator(load_scene(name, {"integrator.tolerance": 1e-13}))
        trajectory = simulator.rollout(simulator.prescribed_torques(500))
        assert trajectory.termination_reason == ""
        stopped = trajectory.at_round_off == 1.0
        share = stopped.mean()
        assert trajectory.summary()["round_off_steps"] == stopped.sum() > 0, f"{share:.0%}"
        met = trajectory.residual[~stopped].max()
        assert met <= 1e-13, f"a residual of {met:.2g} was taken for 1e-13"
        left = trajectory.residual[stopped].max()
        assert left < 1e-10, f"round-off leaves {left:.2g}"

    @pytest.mark.parametrize("tolerance", [1e-4, 1e-7, 1e-10])
    def test_ordinary_tolerances_are_met(self, tolerance: float) -> None:
        simulator = Simulator(load_scene("paper_i", {"integrator.tolerance": tolerance}))
        trajectory = simulator.rollout(simulator.prescribed_torques(500))
        figures = trajectory.summary()
        assert figures["round_off_steps"] == 0, figures["round_off_steps"]
        assert 0.0 < figures["max_residual"] <= tolerance, figures["max_residual"]
