"""Natural frequencies: of the free-free beam, in a fluid, and what they do not depend on."""

import numpy as np
import pytest

from swim_env import OptionError, Scene, Simulator, load_scene, natural_frequencies
from tests.support import run_python

#: beta l of the bending modes of a free-free beam.
FREE_FREE = np.array([4.730040745, 7.853204624, 10.995607838])


def test_a_beam_alone_tends_to_the_free_free_beam_at_second_order() -> None:
    alone = {"fluid": None, "beam.rotary_inertia": 1e-9}
    scene = load_scene("paper_i", alone)
    exact = FREE_FREE**2 * np.sqrt(5.0 / scene.beam.line_density) / (2.0 * np.pi)
    counts = (9, 18, 36, 72)
    found = np.array([natural_frequencies(scene.replace("beam.elements", n)) for n in counts])
    errors = found / exact - 1.0
    assert errors[0] == pytest.approx([0.027, 0.063, 0.12], abs=1e-3)
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.abs(orders[1:] - 2.0).max() < 0.1, f"orders {orders}"


@pytest.mark.parametrize("mode", [0, 1])
def test_a_body_in_its_fluid_vibrates_at_them(mode: int) -> None:
    """Of three elements the modes are known: two joints bend alike, or against each other."""
    changes = {"beam.elements": 3, "fluid.panels_per_element": 12, "actuation": None}
    scene = load_scene("paper_i", {**changes, "integrator.tolerance": 1e-13})
    omega = 2.0 * np.pi * natural_frequencies(scene)[mode]
    shape = np.array([1.0, 1.0 - 2.0 * mode])
    step = 0.2 / omega
    start = {"initial.joint_angles": (1e-4 * shape).tolist(), "integrator.time_step": step}
    joints = np.diff(Simulator(scene.replace(start)).rollout(np.zeros((200, 2))).angles, axis=1)
    x = joints @ shape / 2.0
    assert np.abs(joints - np.outer(x, shape)).max() < 1e-3 * np.abs(x).max()
    # A mode obeys x(n+1) + x(n-1) = 2 cos(omega' dt) x(n), and the midpoint rule slows it:
    # tan(omega' dt/2) = omega dt/2.
    cosine = (x[1:-1] @ (x[2:] + x[:-2])) / (2.0 * x[1:-1] @ x[1:-1])
    assert 2.0 * np.tan(0.5 * np.arccos(cosine)) == pytest.approx(0.2, rel=1e-5)


def test_the_papers_body_has_its_first_two_at_5_and_16_hz() -> None:
    scene = load_scene("paper_i")
    found = natural_frequencies(scene)
    assert found[:2] == pytest.approx([5.1, 15.7], abs=0.05)
    assert found == sorted(found) and len(found) == 3
    assert natural_frequencies(scene, 100)[:3] == found
    assert len(natural_frequencies(scene, 100)) == scene.beam.elements - 1
    with pytest.raises(OptionError, match="count must be at least 1, got 0"):
        natural_frequencies(scene, 0)


def test_drive_damping_stream_and_start_do_not_matter() -> None:
    scene = load_scene("paper_i")
    changes = {
        "actuation": None,
        "damping.retardation_time": 0.1,
        "stream.velocity": (0.3, 0.1),
        "initial.velocity": (0.1, 0.0),
        # A start that cannot be simulated.
        "initial.joint_angles": 2.0,
    }
    assert natural_frequencies(scene.replace(changes)) == natural_frequencies(scene)


def test_to_import_it_loads_no_scipy() -> None:
    code = "import sys, swim_env; print({'scipy.linalg', 'scipy.integrate'} & set(sys.modules))"
    assert run_python("-c", code).out == "set()\n"


def test_modes_in_space_are_those_of_the_fish_that_the_specification_measured():
    # Lateral, second lateral, dorsoventral ..., torsion; with strips.
    found = natural_frequencies(load_scene("fish_3d"), 24)
    assert len(found) == 24
    assert [found[0], found[2], found[4]] == pytest.approx([1.91, 6.1, 14.4], rel=0.01)


def test_a_body_in_space_has_the_modes_of_the_plane():
    # Without a fluid, with the same mass, rotary inertia and stiffness about d2.
    changes = {"beam.line_density": 0.31, "beam.rotary_inertia": 7.8e-6, "damping": None}
    planar = load_scene("paper_i", {**changes, "fluid": None})
    section = {"profile": "uniform", "half_width": 0.01, "half_height": 0.02}
    beam = {
        "elements": 9,
        "section": section,
        "line_density": 0.31,
        "rotary_inertia_1": 7.8e-6,
        "rotary_inertia_2": 3e-5,
        "lateral_stiffness": 5.0,
        "dorsoventral_stiffness": 80.0,
        "torsional_stiffness": 900.0,
    }
    spatial = Scene.from_dict({"dimension": 3, "beam": beam})
    found = natural_frequencies(spatial, 24)
    for frequency in natural_frequencies(planar, 8):
        assert np.abs(np.array(found) / frequency - 1.0).min() < 1e-9
