"""Momentum in space over long runs, and rotations that stay orthonormal."""

import numpy as np
import pytest

from swim_env import Simulator, load_scene
from swim_env.scene.spatial.scene import SpatialScene
from tests.invariants.runs import largest
from tests.invariants.spatial_runs import SCHEMES, coupled_matrix

FLUIDS: dict[str, dict[str, object]] = {
    "none": {"fluid": None, "beam.density": 1000.0},
    "strip": {},
    "frozen": {"fluid.model": "frozen"},
    "given": {"fluid": {"model": "given", "density": 1000.0}},
    "panels": {"fluid.model": "panels", "fluid.rows": 1, "fluid.around": 8},
}
MOVING = {"initial.velocity": [0.2, -0.1, 0.15], "initial.spin": [0.5, 1.0, -0.7]}
TOLERANCE = 1e-12
BLOCK = 1000


def _scene(fluid: str, **changes: object) -> SpatialScene:
    block = dict(FLUIDS[fluid])
    if fluid == "given":
        matrix = coupled_matrix(3, np.random.default_rng(1), 3.0)
        block["fluid"] = {"model": "given", "density": 1000.0, "matrix": matrix.tolist()}
    base = {"beam.elements": 3, "integrator.tolerance": TOLERANCE, **block}
    scene = load_scene("helix_3d", {**base, **changes})
    assert isinstance(scene, SpatialScene)
    return scene


def _drift(scene: SpatialScene, steps: int) -> tuple[float, float]:
    """Run under random torques, and return the drift of J and its share of what is allowed."""
    simulator = Simulator(scene)
    rng = np.random.default_rng(11)
    begin = simulator.momentum()
    worst, drift = 0.0, 0.0
    for block in range(steps // BLOCK):
        held = rng.uniform(-3.0, 3.0, (BLOCK // 4, scene.beam.elements - 1, 3))
        run = simulator.rollout(np.repeat(held, 4, axis=0))
        assert run.steps == BLOCK, run.termination_reason
        change = np.linalg.norm(run.momentum - begin, axis=1)
        # Angular momentum is about the origin, from which the body moves away.
        arm = np.linalg.norm(run.centres.mean(axis=1), axis=1).max()
        scale = max(np.linalg.norm(begin), arm * np.linalg.norm(begin[:3]))
        allowed = 10.0 * TOLERANCE + 1e-15 * (block * BLOCK + np.arange(BLOCK + 1)) * scale
        worst, drift = max(worst, (change / allowed).max()), max(drift, change.max())
    assert largest(run.joint_rotations) > 0.01
    return float(drift), float(worst)


@pytest.mark.parametrize("start", [{}, MOVING], ids=["from rest", "moving"])
@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("fluid", FLUIDS)
def test_torques_leave_momentum_alone(fluid: str, scheme: str, start: dict[str, object]) -> None:
    scene = _scene(fluid, **start, **{"integrator.scheme": scheme})
    drift, share = _drift(scene, 1000 if fluid == "panels" else 5000)
    print(f"{fluid}, {scheme}: drift {drift:.1e}, {share:.1e} of the bound")
    assert share < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("start", [{}, MOVING], ids=["from rest", "moving"])
@pytest.mark.parametrize("fluid", FLUIDS)
def test_torques_leave_momentum_alone_for_1e5_steps(fluid: str, start: dict[str, object]) -> None:
    drift, share = _drift(_scene(fluid, **start), 100_000)
    print(f"{fluid}: drift {drift:.1e}, {share:.1e} of the bound")
    assert share < 1.0


def _departure(steps: int) -> float:
    """Return the largest |R^T R - 1| after so many steps of a small body that is tossed about."""
    simulator = Simulator(_scene("strip", **MOVING, **{"beam.elements": 2}))
    rng = np.random.default_rng(2)
    worst = 0.0
    for _ in range(steps // BLOCK):
        run = simulator.rollout(np.repeat(rng.uniform(-3.0, 3.0, (BLOCK // 4, 1, 3)), 4, axis=0))
        assert run.steps == BLOCK, run.termination_reason
        last = simulator.directors
        worst = max(worst, largest(np.swapaxes(last, -1, -2) @ last - np.eye(3)))
    assert simulator.steps == steps
    return worst


def test_directors_stay_orthonormal() -> None:
    worst = _departure(20_000)
    print(f"|R^T R - 1| = {worst:.1e} in 2e4 steps")
    assert worst < 4e-15


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_directors_stay_orthonormal_for_1e6_steps() -> None:
    worst = _departure(1_000_000)
    print(f"|R^T R - 1| = {worst:.1e} in 1e6 steps")
    assert worst < 4e-15
