"""What torques do to a body in space: rolling, reversal in time, coming to rest, fluid models."""

import numpy as np
import pytest

from swim_env import Simulator, load_scene
from swim_env.sim.spatial.trajectory import SpatialTrajectory
from tests.invariants.runs import largest
from tests.reference.spatial import log
from tests.support import Array

DURATION = 4.0


def _still(simulator: Simulator, duration: float) -> Array:
    steps = round(duration / simulator.time_step)
    return np.zeros((steps, simulator.elements - 1, 3))


def _rolled(run: SpatialTrajectory) -> Array:
    """Return how far every element turned about its own d3, (N,) (degrees)."""
    steps = np.swapaxes(run.directors[:-1], -1, -2) @ run.directors[1:]
    return np.degrees(log(steps)[..., 2].sum(axis=0))


def test_a_helical_wave_rolls_the_body_and_the_other_hand_rolls_it_back() -> None:
    runs = {}
    for hand in ("helical_right", "helical_left"):
        simulator = Simulator(load_scene("helix_3d", {"actuation.wave": hand}))
        runs[hand] = simulator.rollout(simulator.prescribed_torques(800))
    right, left = runs.values()
    roll = _rolled(right)
    print(f"rolls by {roll.min():.0f} to {roll.max():.0f} degrees in 4 s")
    assert right.time[-1] == pytest.approx(DURATION)
    assert roll.min() > 360.0
    wave = right.scene.actuation
    phase = wave.frequency * right.time[:-1, None] - wave.wave_number * np.arange(1, 9) / 9.0
    turning = 3.0 * np.stack([np.sin(phase), np.cos(phase), 0.0 * phase], axis=-1)
    np.testing.assert_allclose(right.torques, turning, rtol=0.0, atol=1e-13)
    # The mirror is the x-y plane.
    np.testing.assert_allclose(_rolled(left), -roll, rtol=0.0, atol=1e-9)
    mirrored = right.centres * [1.0, 1.0, -1.0]
    np.testing.assert_allclose(left.centres, mirrored, rtol=0.0, atol=1e-13)


def test_torques_reversed_in_time_undo_the_swimming_but_not_the_roll() -> None:
    """In potential flow from rest the path of shapes alone decides; its ends are not retraced."""
    simulator = Simulator("helix_3d")
    torques = simulator.prescribed_torques(800)
    there = simulator.rollout(torques)
    back, rest = simulator.rollout(torques[::-1]), simulator.rollout(_still(simulator, 2.0))
    assert simulator.time == pytest.approx(2.0 * DURATION + 2.0)
    left = rest.centres[-1].mean(axis=0) - there.centres[0].mean(axis=0)
    rolls = [float(_rolled(run).mean()) for run in (there, back, rest)]
    print(f"there {there.displacement} m, left {left} m; rolls {np.round(rolls, 2)} degrees")
    assert largest(rest.joint_rotations[-1]) < 1e-4, "it is not straight again"
    assert largest(there.displacement) > 0.02
    assert largest(left) < 2e-4
    assert abs(sum(rolls)) > 1.0


@pytest.mark.parametrize("fluid", ["strip", "frozen", "panels"])
def test_a_body_from_rest_stops_when_its_deformation_stops(fluid: str) -> None:
    panels = {"fluid.rows": 1, "fluid.around": 8, "beam.elements": 5}
    simulator = Simulator(load_scene("fish_3d", {"fluid.model": fluid, **panels}))
    time = np.arange(100)[:, None, None] * simulator.time_step
    waves = np.cos(9.0 * time + np.arange(4)[:, None] + [0.0, 1.0, 2.0]) * [3.0, 2.0, 1.0]
    first = simulator.rollout(waves)
    second = np.ptp(first.centres[50:], axis=0).max()
    last = simulator.rollout(_still(simulator, 12.0))
    end = slice(-round(1.0 / simulator.time_step), None)
    deforming = np.ptp(last.joint_rotations[end], axis=0).max()
    moved = np.ptp(last.centres[end], axis=0).max()
    print(
        f"{fluid}: {second:.1e} m under torques, {moved:.1e} m in the last second while joints "
        f"turned by {deforming:.1e} rad"
    )
    assert second > 0.01
    assert deforming < 1e-6
    assert moved < 1e-7


#: Half width at most by aspect, and bounds on the shares by which `frozen` and `strip` differ from
#: `panels` in the distance swum.
SLENDER = {6: (0.08, 1.0), 10: (0.025, 0.4), 20: (0.006, 0.15)}


def test_fluid_models_agree_the_better_the_more_slender_the_body_is() -> None:
    differences = []
    for aspect, bounds in SLENDER.items():
        half = 0.5 / aspect
        scale = (half / 0.05) ** 2  # as the mass
        stiffness = {f"beam.{a}_stiffness": 5.0 * scale for a in ("lateral", "dorsoventral")}
        changes = {
            **stiffness,
            "beam.section": {"profile": "ellipsoid", "half_width": half, "half_height": half},
            "actuation.amplitude": 3.0 * scale,
            "actuation.axes": ["yaw"],
            "actuation.wave": "planar",
            "actuation.torque_limit": 10.0,
            "integrator.time_step": 0.01,
        }
        swum = {}
        for model in ("panels", "frozen", "strip"):
            simulator = Simulator(load_scene("helix_3d", {**changes, "fluid.model": model}))
            run = simulator.rollout(simulator.prescribed_torques(200))
            assert run.steps == 200 and largest(run.joint_rotations) > 0.05
            swum[model] = float(run.displacement[0])
        shares = [swum[model] / swum["panels"] - 1.0 for model in ("frozen", "strip")]
        print(
            f"1:{aspect}: panels {swum['panels']:.5f} m, frozen {100 * shares[0]:+.1f} %, "
            f"strip {100 * shares[1]:+.1f} %"
        )
        assert swum["panels"] < 0.0, "it swims tail first"
        assert (np.abs(shares) < bounds).all()
        differences.append(np.abs(shares))
    assert (np.diff(differences, axis=0) < 0.0).all()
