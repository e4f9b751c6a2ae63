"""What the benchmark measures of a step: the floor does the real work, and the parts add up."""

from __future__ import annotations

import numpy as np
import pytest

from studies.benchmark import parts
from studies.benchmark.floor import FLOOR_WAYS, floor_arrays, floor_calls, potentials_of_motions
from studies.benchmark.parts import PARTS, measure_parts
from swim_env import SceneError, Simulator, load_scene
from swim_env.physics.fluid.outline import LENGTH
from swim_env.sim.batch import Bodies, minimal_start


@pytest.mark.parametrize("elements", [2, 9, 13])
def test_the_floor_gives_the_added_mass_either_way(elements: int) -> None:
    """-rho sym(B^T L phi) of the floor's potentials is the matrix that the step works with."""
    bend = [0.1 * (-1.0) ** k for k in range(elements - 1)]
    scene = load_scene("paper_i").replace("beam.elements", elements)
    scene = scene.replace("initial.joint_angles", bend)
    bodies = Bodies(scene)
    bodies.start(0, *minimal_start(scene, scene.initial))
    body = bodies.views(0)
    wanted = body.step.added_mass[: 2 * elements, : 2 * elements]
    for way in FLOOR_WAYS.values():
        floor = floor_arrays(scene)
        potentials_of_motions(1, way, *floor)
        weighted = floor.motions * floor.panels[LENGTH][:, None]
        mass = -scene.fluid.density * weighted.T @ floor.out
        mass = 0.5 * (mass + mass.T)[: 2 * elements, : 2 * elements]
        np.testing.assert_allclose(mass, wanted, atol=1e-12 * np.abs(wanted).max())
        # A second call finds its work space used, and gives the same.
        before = floor.out.copy()
        potentials_of_motions(1, way, *floor)
        np.testing.assert_array_equal(floor.out, before)


def test_there_is_no_floor_without_panels() -> None:
    with pytest.raises(SceneError, match="floor is that of fluid.model panels"):
        floor_calls(load_scene("paper_i").replace("fluid.model", "none"))


def test_parts_add_up_to_the_step() -> None:
    """What parts do not account for is the rest, round by round."""
    microseconds = {
        "step": 40.0, "outline": 0.5, "influence": 6.0, "factorisation": 5.0, "added mass": 16.0,
        "pose": 20.0, "jacobian": 2.0, "held": 0.5, "whole": 4.0, "shape": 3.5,
    }  # fmt: skip
    keys = ("step", *(str(code) for code in range(9)))
    drift = np.array([1.0, 2.0, 1.5])
    each = {key: value * drift for key, value in zip(keys, microseconds.values(), strict=True)}
    shares = parts._parts(each, corrections=7.0, evaluations=2.0, poses=1.0, with_panels=True)
    medians = {name: spread.median / 1.5 for name, spread in shares.items()}
    assert medians == pytest.approx(
        {
            "outline": 0.5,
            "influence assembly": 6.0,
            "factorisation": 5.0,
            "added mass": 4.5,
            "mass matrix": 4.0,
            "Newton iterations": 2.0 + 8 * 0.5 + 2 * 0.5,
            "shape gradient": 7.0,
            "rest": 6.0,
        }
    )
    assert tuple(shares) == PARTS


@pytest.mark.parametrize("model", ["panels", "none"])
def test_the_parts_of_a_scene(model: str) -> None:
    scene = load_scene("paper_i").replace("fluid.model", model)
    cell = measure_parts(scene, 3)
    assert tuple(cell["parts"]) == PARTS
    medians = {name: part["median"] for name, part in cell["parts"].items()}
    assert cell["real_time"] == pytest.approx(1e6 * 0.01 / cell["step"]["median"])
    assert cell["fluid_model"] == model and cell["elements"] == 9
    if model == "panels":
        assert medians["influence assembly"] > 0.0 and medians["shape gradient"] > 0.0
        assert cell["panels_per_element"] == 4
        assert cell["step_to_floor"]["median"] > 1.0
        assert 1.0 <= cell["iterations"]["evaluations"] <= 5.0
    else:
        assert medians["influence assembly"] == medians["added mass"] == 0.0
        assert cell["floor"] is cell["step_to_floor"] is cell["floor_way"] is None


def test_a_step_takes_few_evaluations_of_the_shape_force() -> None:
    """Two or three whole evaluations a step, and corrections in between, on the usual scenes."""
    for name, most in (("paper_i", 3.0), ("swimmer", 2.2)):
        simulator = Simulator(name)
        trajectory = simulator.rollout(simulator.prescribed_torques(400))
        assert 1.9 < trajectory.evaluations.mean() < most
        assert trajectory.iterations.mean() > trajectory.evaluations.mean()
        assert trajectory.summary()["evaluations_mean"] == trajectory.evaluations.mean()
