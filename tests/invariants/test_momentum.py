"""The discrete momentum map is constant whatever the torques do (PHYSICS section 6, item 3)."""

from __future__ import annotations

import numpy as np
import pytest

from swim_env import Scene, Simulator, Trajectory, load_scene

SCENES: dict[str, tuple[str, dict[str, object]]] = {
    "fluid": ("paper_i", {}),
    "none": ("paper_i", {"fluid": None}),
    "axial": ("paper_i", {"axial_added_mass": {}}),
    "damped": ("swimmer", {}),
    "three elements": ("paper_iv", {}),
    "stiffness that varies": ("paper_vii", {}),
    "damped, axial, more panels": (
        "swimmer",
        {"axial_added_mass": {}, "fluid.panels_per_element": 8, "fluid.cap_panels": 2},
    ),
    "mean angles": ("paper_i", {"integrator.strain": "mean_angles"}),
    "composed": ("paper_i", {"integrator.scheme": "composed"}),
    "composed, none": ("paper_i", {"integrator.scheme": "composed", "fluid": None}),
    "composed, mean angles, damped, axial": (
        "swimmer",
        {
            "integrator.scheme": "composed",
            "integrator.strain": "mean_angles",
            "axial_added_mass": {},
        },
    ),
}
TOLERANCES = (1e-6, 1e-10, 1e-13)
STEPS = 300


def _scene(name: str, tolerance: float, **changes: object) -> Scene:
    base, others = SCENES[name]
    dotted = {key.replace("__", "."): value for key, value in changes.items()}
    return load_scene(base, {**others, **dotted, "integrator.tolerance": tolerance})


def _random_torques(scene: Scene, steps: int, seed: int) -> np.ndarray:
    held = np.random.default_rng(seed).uniform(-1.0, 1.0, (steps // 4 + 1, scene.beam.elements - 1))
    return np.repeat(held, 4, axis=0)[:steps]


def _assert_constant(trajectory: Trajectory, tolerance: float) -> None:
    """Compare |J_n - J_0| with 10 tolerances plus 1e-15 n times the size of J's terms."""
    drift = np.linalg.norm(trajectory.momentum - trajectory.momentum[0], axis=1)
    linear = float(np.hypot(*trajectory.momentum[0, :2]))
    arms = np.linalg.norm(trajectory.path, axis=1)
    terms = np.maximum(np.linalg.norm(trajectory.momentum[0]), arms * linear)
    bound = 10.0 * tolerance + 1e-15 * np.arange(len(drift)) * terms
    worst = int(np.argmax(drift - bound))
    assert drift[worst] <= bound[worst], (
        f"|J_n - J_0| = {drift[worst]:.3g} at step {worst}, allowed {bound[worst]:.3g} "
        f"(largest {drift.max():.3g})"
    )


@pytest.mark.parametrize("tolerance", TOLERANCES)
@pytest.mark.parametrize("name", SCENES)
def test_random_torques_from_rest_leave_the_momentum_zero(name: str, tolerance: float) -> None:
    scene = _scene(name, tolerance)
    simulator = Simulator(scene)
    trajectory = simulator.rollout(_random_torques(scene, STEPS, 1))
    assert trajectory.steps >= 100, f"only {trajectory.steps} steps to judge by"
    assert np.abs(trajectory.angles).max() > 0.02, "the torques hardly moved the beam"
    assert np.array_equal(trajectory.momentum[0], np.zeros(3)), trajectory.momentum[0]
    _assert_constant(trajectory, tolerance)


@pytest.mark.parametrize("tolerance", TOLERANCES)
@pytest.mark.parametrize("name", SCENES)
def test_random_torques_keep_the_momentum_of_a_moving_start(name: str, tolerance: float) -> None:
    scene = _scene(
        name,
        tolerance,
        initial__position=(0.4, -1.5),
        initial__heading=0.7,
        initial__velocity=(0.3, -0.2),
    )
    trajectory = Simulator(scene).rollout(_random_torques(scene, STEPS, 2))
    assert trajectory.steps >= 100, f"only {trajectory.steps} steps to judge by"
    assert np.abs(trajectory.momentum[0]).min() > 0.01, trajectory.momentum[0]
    _assert_constant(trajectory, tolerance)


@pytest.mark.parametrize("name", ["damped", "composed, mean angles, damped, axial"])
@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_steps_cut_into_parts_keep_the_momentum(tolerance: float, name: str) -> None:
    scene = _scene(name, tolerance, integrator__time_step=0.01, initial__velocity=(0.2, 0.1))
    simulator = Simulator(scene)
    torques = _random_torques(scene, 200, 3)
    torques[::20] = 20.0 * np.tile([1.0, -1.0], 4)
    trajectory = simulator.rollout(torques)
    assert (trajectory.parts > 1).sum() >= 5, f"{(trajectory.parts > 1).sum()} steps were cut"
    _assert_constant(trajectory, tolerance)


def test_momentum_at_the_start_is_that_of_body_and_fluid() -> None:
    # Along itself a straight body without axial added mass carries its own mass alone; across
    # itself the fluid's comes on top (4 to 7 % above pi l^2/4 of a plate).
    simulator = Simulator(load_scene("paper_i", {"initial.velocity": (0.1, 0.2)}))
    along, across, _ = simulator.momentum()
    assert abs(along - 0.31 * 0.1) < 1e-15, f"momentum along the body {along!r}, expected 0.031"
    ratio = (across / 0.2 - 0.31) / (10.0 * np.pi / 4.0)
    assert 1.04 < ratio < 1.07, f"lateral added mass {ratio:.4f} of a plate's"
    velocity = simulator.velocity()
    error = np.abs(velocity - np.concatenate([[0.1, 0.2], np.zeros(9)])).max()
    assert error < 1e-12, f"M^-1 p misses the given velocity by {error:.2g}"


def test_without_fluid_the_momentum_is_mass_times_the_centres_velocity() -> None:
    scene = _scene("none", 1e-12, initial__velocity=(0.3, -0.2))
    trajectory = Simulator(scene).rollout(_random_torques(scene, 200, 4))
    moved = trajectory.displacement / trajectory.duration
    error = np.abs(trajectory.momentum[-1, :2] - 0.31 * moved).max()
    assert error < 1e-12, f"P differs from m v by {error:.2g}"
