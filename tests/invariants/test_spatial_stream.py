"""A uniform stream in space: it carries the motion at rest along, and its impulse is known."""

import numpy as np
import pytest

from swim_env import Scene, Simulator, load_scene
from tests.invariants.runs import largest
from tests.invariants.spatial_runs import SCHEMES
from tests.support import Array

FLUIDS: dict[str, dict[str, object]] = {
    "strip": {},
    "frozen": {"fluid.model": "frozen"},
    "panels": {"fluid.model": "panels"},
}
#: These numbers and their differences have few digits, so that both starts are the same to the bit
#: in the frame of the stream.
STREAM, START = np.array([0.25, -0.5, 0.375]), np.array([0.125, 0.0625, -0.25])
#: A body that rolls by more than half a radian in half a step, which is therefore cut.
CUT = {"integrator.time_step": 0.02, "initial.spin": [60.0, 1.0, -0.5]}
STEPS = 100


def _resting(fluid: str, scheme: str, **changes: object) -> Scene:
    small = {"beam.elements": 3, "fluid.rows": 1, "fluid.around": 8}
    moving = {"initial.velocity": START.tolist(), "initial.spin": [0.5, 1.0, -0.75]}
    scheme_and_fluid = {"integrator.scheme": scheme, **FLUIDS[fluid]}
    return load_scene("helix_3d", {**small, **moving, **scheme_and_fluid, **changes})


def _carried(resting: Scene) -> Scene:
    start = STREAM + resting.initial.velocity
    return resting.replace({"stream.velocity": STREAM.tolist(), "initial.velocity": start.tolist()})


def _torques(scene: Scene, steps: int = STEPS) -> Array:
    held = np.random.default_rng(7).uniform(-3.0, 3.0, (steps // 4, scene.joints, 3))
    return np.repeat(held, 4, axis=0)


@pytest.mark.parametrize("cut", [False, True], ids=["whole steps", "cut steps"])
@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("fluid", FLUIDS)
def test_a_stream_carries_the_motion_at_rest_along(fluid: str, scheme: str, cut: bool) -> None:
    resting = _resting(fluid, scheme, **(CUT if cut else {}))
    torques = _torques(resting)
    one, other = Simulator(resting), Simulator(_carried(resting))
    at_rest, run = one.rollout(torques), other.rollout(torques)
    assert at_rest.steps == run.steps == STEPS, at_rest.termination_reason
    assert (at_rest.parts.max() > 1) == cut
    assert np.ptp(run.joint_rotations, axis=0).min() > 0.01
    for field in ("directors", "energy", "work", "dissipated", "parts"):
        assert np.array_equal(getattr(run, field), getattr(at_rest, field)), field
    assert np.array_equal(run.momentum[:, :3], at_rest.momentum[:, :3])
    gap = largest(run.centres - at_rest.centres - np.outer(run.time, STREAM)[:, None])
    # A step adds a few numbers of order one to the position.
    assert gap < STEPS * 4e-16, f"the path is off by {gap:.2g} m"
    # Velocities are those over ground, of the simulator and of the batch.
    there = one.velocity() + np.concatenate([STREAM, np.zeros(9)])
    assert largest(other.velocity() - there) < 1e-15
    assert np.array_equal(other._bodies.velocities[0], other.velocity())


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("fluid", FLUIDS)
def test_momentum_changes_by_the_impulse_of_the_stream(fluid: str, scheme: str) -> None:
    """The angular one alone, as the origin does not move along: dJ = h U x p."""
    resting = _resting(fluid, scheme)
    torques = _torques(resting)
    at_rest, run = (Simulator(scene).rollout(torques) for scene in (resting, _carried(resting)))
    assert at_rest.steps == run.steps == STEPS
    linear = run.momentum[0, :3]
    turned = np.cross(run.duration * STREAM, linear)
    assert np.abs(turned).min() > 0.01
    assert run.impulse.sum(axis=0) == pytest.approx(
        np.concatenate([np.zeros(3), turned]), rel=1e-12
    )
    assert not at_rest.impulse.any() and not run.impulse[:, :3].any()
    # What is left is the round-off that there is at rest, but for that of the positions.
    left = largest(run.unexplained_momentum - at_rest.unexplained_momentum)
    assert left < STEPS * 4e-16 * np.linalg.norm(linear), f"{left:.2g} of the momentum is left"
    assert run.summary()["momentum_drift"] < 1e-11


def test_energy_and_momentum_are_those_relative_to_the_stream() -> None:
    drifting = _carried(_resting("strip", "paper", **{"initial.velocity": [0, 0, 0]})).replace(
        "initial.spin", [0, 0, 0]
    )
    simulator = Simulator(drifting)
    assert simulator.energy() == 0.0 and not simulator.momentum().any()
    simulator.rollout(np.zeros((10, 2, 3)))
    assert simulator.energy() == 0.0 and not simulator.momentum().any()
    assert np.array_equal(simulator.velocity()[:3], STREAM)
    # A body that the ground sees at rest moves against the stream.
    held = Simulator(drifting.replace("initial.velocity", [0.0] * 3))
    against = Simulator(drifting.replace({"stream": None, "initial.velocity": (-STREAM).tolist()}))
    assert held.energy() == against.energy() > 0.0
    assert np.array_equal(held.momentum(), against.momentum())
    assert not held.velocity().any()


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_restored_run_in_a_stream_is_the_same_to_the_bit(scheme: str) -> None:
    scene = _carried(_resting("panels", scheme))
    torques = _torques(scene, 40)
    simulator, other = Simulator(scene), Simulator(scene)
    simulator.rollout(torques[:20])
    other.restore(simulator.snapshot())
    first, second = simulator.rollout(torques[20:]), other.rollout(torques[20:])
    for field in ("centres", "directors", "momentum", "impulse", "energy"):
        assert np.array_equal(getattr(first, field), getattr(second, field)), field
    assert np.array_equal(simulator.velocity(), other.velocity())


def test_a_stream_of_no_speed_changes_no_bit() -> None:
    still = _resting("strip", "composed")
    runs = [
        Simulator(scene).rollout(_torques(still))
        for scene in (still, still.replace("stream.velocity", [0.0] * 3))
    ]
    assert not runs[1].impulse.any()
    for field in ("centres", "directors", "momentum", "energy", "dissipated"):
        assert getattr(runs[0], field).tobytes() == getattr(runs[1], field).tobytes(), field
