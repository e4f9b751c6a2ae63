"""Random bodies in space, tossed about: finite numbers, named ends, a momentum that stays."""

from collections import Counter
from collections.abc import Iterable

import numpy as np
import pytest

from swim_env import TERMINATION_REASONS, Scene, Simulator
from swim_env.errors import SimulationEndedError
from tests.support import Array

STEPS = 20
MODELS = ("none", "strip", "frozen")


def _scene(rng: np.random.Generator) -> Scene:
    """Return a body of any size, thickness and stiffness, bent and with a spin to 100 rad/s."""

    def any_size(lowest: float, highest: float) -> float:
        return float(10.0 ** rng.uniform(lowest, highest))

    n, length = int(rng.integers(2, 21)), any_size(-1.0, 1.0)
    axis = rng.normal(size=3)
    curvature = 0.3 * n / length * rng.uniform(-1.0, 1.0, (n - 1, 3)) * (rng.random() < 0.3)
    model = str(rng.choice(MODELS))
    scene = {
        "dimension": 3,
        "beam": {
            "length": length,
            "elements": n,
            "density": any_size(2.0, 4.0),
            "section": {
                "profile": str(rng.choice(["uniform", "ellipsoid"])),
                "half_width": length * any_size(-2.3, -0.7),
                "half_height": length * any_size(-2.3, -0.7),
            },
            "dorsoventral_stiffness": any_size(-2.0, 6.0),
            "lateral_stiffness": any_size(-2.0, 6.0),
            "torsional_stiffness": any_size(-2.0, 6.0),
            "natural_curvature": curvature.tolist(),
        },
        "initial": {
            "velocity": (length * rng.normal(size=3)).tolist(),
            "spin": (any_size(-1.0, 2.0) * axis / np.linalg.norm(axis)).tolist(),
            "joint_rotations": rng.uniform(-0.3, 0.3, (n - 1, 3)).tolist(),
        },
        "integrator": {
            "time_step": any_size(-3.0, -1.7),
            "tolerance": any_size(-13.0, -8.0),
            "scheme": str(rng.choice(["paper", "composed"])),
            "strain": str(rng.choice(["averaged_directors", "joint_angle"])),
        },
    }
    if model != "none":
        mesh = {"rows": 1, "around": 8} if model == "frozen" else {}
        scene["fluid"] = {"model": model, "density": 1000.0, **mesh}
    if rng.random() < 0.6:
        scene["damping"] = {"retardation_time": any_size(-4.0, -1.0)}
    return Scene.from_dict(scene)


def _play(seed: int) -> str:
    """Check one run; return why it ended, or nothing if it did not."""
    rng = np.random.default_rng(seed)
    scene = _scene(rng)
    simulator = Simulator(scene)
    # Up to ten times what bends the body by a radian at every joint.
    stiffness = scene.beam.stiffness_at_joints() * scene.beam.elements / scene.beam.length
    size = stiffness * 10.0 ** rng.uniform(-4.0, 1.0)
    begin, scale = simulator.momentum(), 0.0
    for step in range(STEPS):
        try:
            simulator.step(rng.uniform(-size, size))
        except SimulationEndedError as error:
            assert simulator.termination_reason in str(error), seed
            assert simulator.termination_reason in TERMINATION_REASONS, seed
        momentum, carried = simulator.momentum(), simulator._bodies.momenta[0]
        reached: tuple[Array, ...] = (
            simulator.coordinates,
            simulator.centres,
            simulator.directors,
            simulator.joint_rotations,
            simulator.velocity(),
            np.array(simulator.energy()),
            momentum,
            carried,
        )
        assert all(np.isfinite(each).all() for each in reached), f"seed {seed}, step {step}"
        # The sum of the elements' momenta, about the origin: what round-off is a share of.
        arm = 1.0 + np.abs(simulator.centres).max()
        scale = max(scale, np.abs(carried[3:]).sum() + arm * np.abs(begin).max())
        allowed = (10.0 * scene.integrator.tolerance + 1e-15 * (step + 1)) * scale
        drift = np.abs(momentum - begin).max()
        assert drift <= allowed, f"seed {seed}, step {step}: {drift:.2e}, allowed {allowed:.2e}"
        if simulator.termination_reason:
            break
    product = np.swapaxes(simulator.directors, -1, -2) @ simulator.directors
    assert np.abs(product - np.eye(3)).max() < 2e-14, seed
    return simulator.termination_reason


def _check(seeds: Iterable[int]) -> None:
    ends = Counter(_play(seed) for seed in seeds)
    print(dict(ends))
    assert ends[""] > 0.2 * ends.total(), ends
    assert len(ends) > 2, f"the runs are not violent: {ends}"


def test_random_bodies_stay_finite_and_end_by_name() -> None:
    _check(range(100))


@pytest.mark.slow
@pytest.mark.ci_slice
def test_other_random_bodies_stay_finite_and_end_by_name() -> None:
    _check(range(1000, 1500))


@pytest.mark.slow
@pytest.mark.release
@pytest.mark.timeout(3600)
def test_ten_thousand_random_bodies_stay_finite_and_end_by_name() -> None:
    _check(range(10_000, 20_000))
