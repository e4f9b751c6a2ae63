"""What the benchmark measures of a step: the floor does the real work, and the parts add up."""

import numpy as np
import pytest

from studies.benchmark import parts
from studies.benchmark.effects import measure_effects
from studies.benchmark.floor import FLOOR_WAYS, floor_arrays, floor_calls, potentials_of_motions
from studies.benchmark.parts import PARTS, measure_parts
from swim_env import SceneError, Simulator, load_scene
from swim_env.sim.batch import Bodies, minimal_start


@pytest.mark.parametrize("elements", [2, 9, 13])
def test_the_floor_gives_the_added_mass_either_way(elements):
    """-rho sym(B^T L phi) of the floor's potentials is the matrix that the step works with."""
    bend = [0.1 * (-1.0) ** k for k in range(elements - 1)]
    scene = load_scene("paper_i", {"beam.elements": elements, "initial.joint_angles": bend})
    bodies = Bodies(scene)
    bodies.start(0, *minimal_start(scene, scene.initial))
    wanted = bodies.views(0).body.mass.added[: 2 * elements, : 2 * elements]
    for way in FLOOR_WAYS.values():
        floor = floor_arrays(scene)
        potentials_of_motions(1, way, floor)
        mass = -scene.fluid.density * (floor.motions * floor.length[:, None]).T @ floor.out
        mass = 0.5 * (mass + mass.T)[: 2 * elements, : 2 * elements]
        np.testing.assert_allclose(mass, wanted, atol=1e-12 * np.abs(wanted).max())
        # A second call finds its work space used, and gives the same.
        before = floor.out.copy()
        potentials_of_motions(1, way, floor)
        np.testing.assert_array_equal(floor.out, before)


def test_there_is_no_floor_without_panels():
    with pytest.raises(SceneError, match="floor is that of fluid.model panels"):
        floor_calls(load_scene("paper_i", {"fluid.model": "none"}))


def test_parts_add_up_to_the_step():
    """What parts do not account for is the rest, round by round."""
    microseconds = {
        "step": 40.0, "outline": 0.5, "influence": 6.0, "factorisation": 5.0, "added mass": 16.0,
        "pose": 20.0, "jacobian": 2.0, "held step": 0.5, "whole step": 4.0, "shape force": 3.5,
    }  # fmt: skip
    drift = np.array([1.0, 2.0, 1.5])
    each = {name: value * drift for name, value in microseconds.items()}
    shares = parts._parts(each, corrections=7.0, evaluations=2.0, poses=1.0)
    medians = {name: spread.median / 1.5 for name, spread in shares.items()}
    amounts = (0.5, 6.0, 5.0, 4.5, 4.0, 2.0 + 8 * 0.5 + 2 * 0.5, 7.0, 6.0)
    assert medians == pytest.approx(dict(zip(PARTS, amounts, strict=True)))


@pytest.mark.parametrize("model", ["panels", "none"])
def test_the_parts_of_a_scene(model):
    cell = measure_parts(load_scene("paper_i", {"fluid.model": model}), 3)
    assert tuple(cell["parts"]) == PARTS
    medians = {name: part["median"] for name, part in cell["parts"].items()}
    assert cell["real_time"] == pytest.approx(1e6 * 0.01 / cell["step"]["median"])
    assert cell["fluid_model"] == model and cell["elements"] == 9
    if model == "panels":
        assert medians["influence assembly"] > 0.0 and medians["shape gradient"] > 0.0
        assert cell["panels_per_element"] == 4 and cell["floor_way"] in FLOOR_WAYS
        assert cell["step_to_floor"]["median"] > 0.0
        assert 1.0 <= cell["iterations"]["evaluations"] <= 5.0
    else:
        assert medians["influence assembly"] == medians["added mass"] == 0.0
        assert cell["floor"] is cell["step_to_floor"] is cell["floor_way"] is None


@pytest.mark.release
def test_a_step_takes_longer_than_its_floor_and_a_pose_than_its_added_mass():
    cell = measure_parts(load_scene("paper_i"), 5)
    assert cell["step_to_floor"]["median"] > 1.0
    assert cell["parts"]["mass matrix"]["median"] > 0.0
    for one in measure_effects(1):
        # A step takes some ten microseconds; a hundredth of a second would be no step.
        assert all(1.0 < one[name]["median"] < 1e4 for name in ("with", "without")), one


def test_a_step_takes_few_evaluations_of_the_shape_force():
    """Two or three whole evaluations a step, and corrections in between, on the usual scenes."""
    for name, most in (("paper_i", 3.0), ("swimmer", 2.2)):
        simulator = Simulator(name)
        trajectory = simulator.rollout(simulator.prescribed_torques(400))
        assert 1.9 < trajectory.evaluations.mean() < most
        assert trajectory.iterations.mean() > trajectory.evaluations.mean()
        assert trajectory.summary()["evaluations_mean"] == trajectory.evaluations.mean()
