"""What the benchmark measures of a step: the floor does the real work, and the parts add up."""

from __future__ import annotations

import numpy as np
import pytest

from swim_env import SceneError, Simulator, load_scene
from swim_env.benchmark.floor import floor_calls
from swim_env.benchmark.parts import PARTS, measure_parts
from swim_env.bodies import Bodies, minimal_start
from swim_env.physics.outline import LENGTH


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
    for call in floor_calls(scene, 1).values():
        call()
        panels, motions, potentials = call.args[2], call.args[5], call.args[-1]
        weighted = motions * panels[LENGTH][:, None]
        mass = -scene.fluid.density * weighted.T @ potentials
        mass = 0.5 * (mass + mass.T)[: 2 * elements, : 2 * elements]
        np.testing.assert_allclose(mass, wanted, atol=1e-12 * np.abs(wanted).max())
        # A second call finds its work space used, and gives the same.
        before = potentials.copy()
        call()
        np.testing.assert_array_equal(potentials, before)


def test_there_is_no_floor_without_panels() -> None:
    with pytest.raises(SceneError, match="floor is that of fluid.model panels"):
        floor_calls(load_scene("paper_i").replace("fluid.model", "none"), 1)


@pytest.mark.parametrize("model", ["panels", "none"])
def test_parts_add_up_to_the_step(model: str) -> None:
    scene = load_scene("paper_i").replace("fluid.model", model)
    cell = measure_parts(scene, 5)
    assert tuple(cell["parts"]) == PARTS
    medians = {name: part["median"] for name, part in cell["parts"].items()}
    step = cell["step"]["median"]
    assert abs(sum(medians.values()) - step) < 0.5 * step  # medians of separate lists, noisy
    assert abs(medians["rest"]) < 0.5 * step
    assert cell["real_time"] == pytest.approx(1e6 * 0.01 / step)
    assert cell["fluid_model"] == model and cell["elements"] == 9
    if model == "panels":
        assert all(medians[name] > 0.0 for name in PARTS[:-1])
        assert cell["panels_per_element"] == 4
        assert 1.0 < cell["step_to_floor"]["median"] < 10.0
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
