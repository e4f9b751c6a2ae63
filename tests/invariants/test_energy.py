"""Energy: orders of its error where modes are resolved, bounds elsewhere (PHYSICS section 6)."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from swim_env import Scene, Simulator, Trajectory, load_scene

TIME_STEPS = (0.005, 0.0025, 0.00125)
# Elements, EI (N m^2), joint angles at the start of passive runs (rad), torque amplitude (N m).
RESOLVED = {
    "N=3": (3, 5.0, 0.3, 1.0),
    "N=5, soft": (5, 0.05, 0.2, 0.01),
    "N=9, softer": (9, 0.004, 0.1, 0.0005),
}


def _resolved(case: str, time_step: float, fluid: bool, bent: bool) -> tuple[Scene, float]:
    elements, stiffness, bend, amplitude = RESOLVED[case]
    changes: dict[str, object] = {
        "beam.elements": elements,
        "beam.bending_stiffness": stiffness,
        "initial.joint_angles": bend if bent else 0.0,
        "integrator.time_step": time_step,
        "integrator.tolerance": 1e-12,
    }
    if not fluid:
        # Rotary inertia, and less stiffness, keep the highest mode of the bare beam resolved.
        changes |= {"fluid": None, "beam.rotary_inertia": 1e-3}
        changes["beam.bending_stiffness"] = min(stiffness, 0.4)
        amplitude = min(amplitude, 0.1)
    return load_scene("paper_i", changes), amplitude


def _highest_frequency(scene: Scene) -> float:
    """Return omega_max (rad/s) of the straight beam, mass by polarising the kinetic energy."""
    simulator = Simulator(scene.replace({"initial": {}, "actuation": None}))
    n = scene.beam.elements
    dl = scene.beam.element_length
    units = []
    for k in range(n):
        # Element k turns at a unit rate, those behind it are carried along.
        lateral = np.where(np.arange(n) > k, dl, np.where(np.arange(n) == k, 0.5 * dl, 0.0))
        units.append((lateral, np.eye(n)[k]))
    units.append((np.ones(n), np.zeros(n)))

    def kinetic(lateral: np.ndarray, turning: np.ndarray) -> float:
        initial = {
            "velocity": [(0.0, float(v)) for v in lateral],
            "turning_rate": [float(w) for w in turning],
        }
        simulator.reset(scene.replace("initial", initial).initial)
        return simulator.energy()

    mass = np.empty((n + 1, n + 1))
    own = [kinetic(*unit) for unit in units]
    for i, (v, w) in enumerate(units):
        for j, (v2, w2) in enumerate(units):
            mass[i, j] = kinetic(v + v2, w + w2) - own[i] - own[j]
    bend = np.diff(np.eye(n), axis=0)
    stiffness = np.zeros_like(mass)
    stiffness[:n, :n] = bend.T @ np.diag(scene.beam.stiffness_at_joints() / dl) @ bend
    return float(np.sqrt(scipy.linalg.eigh(stiffness, mass, eigvals_only=True)[-1]))


def _orders(errors: list[float]) -> np.ndarray:
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


def _play(scene: Scene, duration: float, torques: bool = False) -> Trajectory:
    simulator = Simulator(scene)
    steps = round(duration / simulator.time_step)
    held = simulator.prescribed_torques(steps)
    trajectory = simulator.rollout(held if torques else np.zeros_like(held))
    assert trajectory.steps == steps, trajectory.termination_reason
    return trajectory


def _amplitude(trajectory: Trajectory) -> float:
    return float(np.ptp(trajectory.energy) / trajectory.energy.mean())


@pytest.mark.parametrize(("fluid", "order"), [(True, 1.0), (False, 2.0)], ids=["fluid", "none"])
@pytest.mark.parametrize("case", RESOLVED)
class TestResolved:
    def test_passive_energy_oscillates_less_at_the_schemes_order(
        self, case: str, fluid: bool, order: float
    ) -> None:
        scenes = [_resolved(case, step, fluid, bent=True)[0] for step in TIME_STEPS]
        resolution = _highest_frequency(scenes[0]) * TIME_STEPS[0]
        assert resolution < 0.5, f"omega_max dt = {resolution:.3f}"
        errors = [_amplitude(_play(scene, 5.0)) for scene in scenes]
        observed = _orders(errors)
        assert np.abs(observed - order).max() < 0.12, f"orders {observed}, amplitudes {errors}"
        assert errors[0] < 5e-3, f"amplitudes {errors}"

    def test_driven_balance_closes_at_the_schemes_order(
        self, case: str, fluid: bool, order: float
    ) -> None:
        errors = []
        for step in TIME_STEPS:
            scene, amplitude = _resolved(case, step, fluid, bent=False)
            scene = scene.replace("actuation.amplitude", amplitude)
            trajectory = _play(scene, 5.0, torques=True)
            errors.append(trajectory.summary()["energy_drift"])
        observed = _orders(errors)
        assert np.abs(observed - order).max() < 0.2, f"orders {observed}, drifts {errors}"
        assert errors[0] < 5e-3, f"drifts {errors}"


def _quarters(steps: int) -> tuple[float, float]:
    scene = load_scene("paper_i", {"actuation": None, "initial.joint_angles": 0.1})
    trajectory = _play(scene, steps * scene.integrator.time_step)
    quarter = steps // 4
    first = float(trajectory.energy[:quarter].mean())
    return float(trajectory.energy[-quarter:].mean()) / first - 1.0, _amplitude(trajectory)


def test_unresolved_modes_leave_the_passive_energy_bounded() -> None:
    change, amplitude = _quarters(5_000)
    assert abs(change) < 0.03, (
        f"mean energy of the last quarter {change:+.2%} (swing {amplitude:.2%})"
    )


@pytest.mark.slow
def test_unresolved_modes_leave_the_passive_energy_bounded_for_1e5_steps() -> None:
    change, amplitude = _quarters(100_000)
    assert abs(change) < 0.03, (
        f"mean energy of the last quarter {change:+.2%} (swing {amplitude:.2%})"
    )


class TestDamping:
    def test_a_passive_damped_beam_only_loses_energy(self) -> None:
        scene = load_scene("swimmer", {"initial.joint_angles": 0.1, "integrator.time_step": 0.001})
        trajectory = _play(scene, 2.0)
        assert trajectory.dissipated.min() >= 0.0, f"{trajectory.dissipated.min():.3g} J in a step"
        assert trajectory.dissipated.sum() > 0.0
        drift = trajectory.summary()["energy_drift"] * trajectory.energy.max()
        rise = float(np.diff(trajectory.energy).max())
        assert rise <= drift, f"energy rises by {rise:.3g} J, balance's error {drift:.3g} J"
        share = drift / trajectory.energy[0]
        assert share < 0.01, f"balance's error {share:.3%} of the energy"
        left = float(trajectory.energy[-1] / trajectory.energy[0])
        assert left < 0.5, f"{left:.1%} of the energy is left"

    def test_the_damped_balance_closes_as_the_time_step_falls(self) -> None:
        errors = []
        for step in TIME_STEPS:
            scene, _ = _resolved("N=3", step, True, bent=True)
            scene = scene.replace("damping.retardation_time", 0.002)
            errors.append(_play(scene, 5.0).summary()["energy_drift"])
        observed = _orders(errors)
        assert np.abs(observed - 1.0).max() < 0.2, f"orders {observed}, drifts {errors}"

    def test_a_mode_decays_at_the_rate_of_its_retardation_time(self) -> None:
        # Kelvin-Voigt: a mode of frequency omega loses amplitude at omega^2 t_kv/2. Two elements
        # have a single bending mode.
        base = load_scene(
            "paper_i",
            {
                "beam.elements": 2,
                "beam.bending_stiffness": 0.5,
                "initial.joint_angles": 0.01,
                "integrator.time_step": 0.001,
                "integrator.tolerance": 1e-12,
            },
        )
        omega = _highest_frequency(base)
        time = 0.1 / omega
        trajectory = _play(base.replace("damping.retardation_time", time), 40.0 / omega)
        cycle = 2.0 * np.pi / omega
        t = trajectory.time
        late = (t > 2.0 * cycle) & (t < 6.0 * cycle)
        rate = -np.polyfit(t[late], np.log(trajectory.energy[late]), 1)[0]
        wanted = omega**2 * time
        assert abs(rate / wanted - 1.0) < 0.03, f"energy decays at {rate:.4g} 1/s, not {wanted:.4g}"


def test_energy_of_a_start_is_kinetic_and_elastic_energy() -> None:
    scene = load_scene("paper_i", {"initial.joint_angles": 0.2, "actuation": None})
    elastic = Simulator(scene).energy()
    wanted = 8 * 0.5 * 5.0 * 9.0 * np.sin(0.2) ** 2
    assert abs(elastic / wanted - 1.0) < 1e-13, f"W = {elastic!r} J, not {wanted!r}"
    moving = load_scene("paper_i", {"initial.velocity": (0.1, 0.0)})
    kinetic = Simulator(moving).energy()
    assert abs(kinetic / (0.5 * 0.31 * 0.01) - 1.0) < 1e-12, f"T = {kinetic!r} J"


def test_work_of_a_step_is_torque_times_the_change_of_the_joint_angle() -> None:
    simulator = Simulator("swimmer")
    trajectory = simulator.rollout(simulator.prescribed_torques(300))
    change = np.diff(np.diff(trajectory.angles, axis=1), axis=0)
    shares = trajectory.torques * change
    error = np.abs(trajectory.work - shares.sum(axis=1)).max()
    assert error < 1e-14, f"work is off by {error:.2g} J"
    error = np.abs(trajectory.positive_work - np.maximum(shares, 0.0).sum(axis=1)).max()
    assert error < 1e-14, f"positive work is off by {error:.2g} J"
    stiffness = 5.0 * 9.0 * 0.001
    lost = (stiffness * change**2).sum(axis=1) / simulator.time_step
    error = np.abs(trajectory.dissipated - lost).max()
    assert error < 1e-14, f"dissipated energy is off by {error:.2g} J"
