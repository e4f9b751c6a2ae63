"""What a body in three dimensions is like, and what its scene's file may leave to it."""

import json
import math

import numpy as np
import pytest
from swim_agents.commands.main import main as call_main
from swim_agents.learning.automatic import resolve

from swim_env import Scene, characterise, load_scene, natural_frequencies
from swim_env.analysis.modes import driven_axis
from swim_env.errors import SceneError
from swim_env.scene import Integrator, SpatialEpisode
from swim_env.scene.scene import AUTOMATIC
from tests.support import refuses

BODY = """dimension: 3
beam: {elements: 9, section: {half_width: 0.03, half_height: 0.04},
  lateral_stiffness: 2.8, dorsoventral_stiffness: 5.0, torsional_stiffness: 4.0}
fluid: {model: strip, density: 1000.0}
damping: {retardation_time: auto}
"""
AXES = ("pitch", "yaw", "roll")
#: All that may follow from the body.
ALL_AUTO: dict[str, object] = {
    "integrator": "auto",
    "episode.control_interval": "auto",
    "episode.duration": "auto",
    "damping.retardation_time": "auto",
    "actuation.torque_limit": "auto",
    "actuation.amplitude": "auto",
    "actuation.frequency": "auto",
}


def _first(scene: Scene, axis: str) -> float:
    return natural_frequencies(scene, 1, (axis,))[0]


# ---- modes -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["fish_3d", "helix_3d", "paper_i_3d"])
def test_the_modes_about_the_three_axes_are_all_modes(name):
    scene = load_scene(name)
    count = scene.joints
    each = [natural_frequencies(scene, 99, (axis,)) for axis in AXES]
    assert [len(one) for one in each] == [count] * 3
    every = natural_frequencies(scene, 99)
    assert sorted(np.concatenate(each)) == pytest.approx(every, rel=1e-9)
    assert natural_frequencies(scene, 4, ("yaw", "roll")) == sorted(each[1] + each[2])[:4]


@pytest.mark.parametrize(
    ("changes", "axis"),
    [
        ({}, "yaw"),
        ({"actuation": {"axes": ["roll", "pitch"]}}, "pitch"),
        ({"actuation": {"axes": ["roll"]}}, "roll"),
        ({"beam.dorsoventral_stiffness": 0.5}, "pitch"),
        # Soft to pitch, but nothing drives that; and where nothing is driven.
        ({"beam.dorsoventral_stiffness": 0.5, "actuation": {"axes": ["yaw"]}}, "yaw"),
        ({"beam.dorsoventral_stiffness": 0.5, "actuation": None}, "yaw"),
        # Torsion is soft, but it does not swim.
        ({"beam.torsional_stiffness": 0.001}, "yaw"),
    ],
)
def test_the_driven_axis_is_the_softest_that_torques_bend(changes, axis):
    scene = load_scene("fish_3d", changes)
    assert driven_axis(scene) == axis
    assert characterise(scene).driven_axis == axis
    # Learning counts in periods of that mode.
    held = resolve({"noise_hold": "auto", "discount": 0.9}, scene, "SAC")["noise_hold"]
    assert held == max(1, round(0.8 / (_first(scene, axis) * scene.episode.control_interval)))


def test_of_a_round_body_yaw_is_driven():
    assert driven_axis(load_scene("helix_3d")) == "yaw"


# ---- what is left to the body ------------------------------------------------------------------


def test_what_a_file_leaves_out_follows_from_the_body(tmp_path):
    path = tmp_path / "eel.yaml"
    path.write_text(BODY + "actuation: {amplitude: auto, axes: [yaw, pitch], frequency: auto}\n")
    scene = load_scene(path)
    first = _first(scene, "yaw")
    assert scene.episode.control_interval == pytest.approx(0.1 / first, rel=1e-12)
    assert scene.episode.duration == pytest.approx(100 / first, rel=1e-12)
    assert scene.integrator == Integrator(
        time_step=scene.episode.control_interval / 4, tolerance=1e-4, scheme="composed"
    )
    assert scene.damping is not None
    assert scene.damping.retardation_time == pytest.approx(0.005 / first, rel=1e-12)
    # One limit for each axis in their order, 0.2 EI/l.
    assert scene.torque_limit == pytest.approx((0.56, 1.0), rel=1e-12)
    assert scene.actuation.amplitude == pytest.approx(0.56, rel=1e-12)
    assert scene.actuation.frequency == pytest.approx(math.tau * first, rel=1e-12)
    assert scene.fluid.rows == 2, "panels are not automatic"
    assert Scene.from_dict(scene.to_dict()) == scene
    # Driven by pitch alone it is slower to command, as its first mode is faster.
    pitched = load_scene(path, ["actuation.axes=[pitch]", "actuation.wave=dorsoventral"])
    assert pitched.torque_limit == pytest.approx((1.0,), rel=1e-12)
    assert pitched.episode.control_interval == pytest.approx(0.1 / _first(scene, "pitch"))
    assert pitched.actuation.amplitude == pytest.approx(1.0, rel=1e-12)
    helical = load_scene(path, ["actuation.wave=helical_left"])
    assert helical.actuation.amplitude == pytest.approx(0.56, rel=1e-12), "within both limits"


def test_what_a_file_says_stays(tmp_path):
    path = tmp_path / "eel.yaml"
    path.write_text(
        BODY + "integrator: {time_step: 0.003}\nepisode: {duration: 7.0}\n"
        "actuation: {amplitude: 0.1, torque_limit: [0.5, 0.25], axes: [roll, yaw]}\n"
    )
    scene = load_scene(path)
    assert scene.integrator == Integrator(time_step=0.003)
    steps = round(0.1 / _first(scene, "yaw") / 0.003)
    assert scene.episode.control_interval == pytest.approx(steps * 0.003, rel=1e-12)
    assert (scene.episode.duration, scene.torque_limit) == (7.0, (0.5, 0.25))
    assert scene.replace("actuation.amplitude", "auto").actuation.amplitude == 0.25


@pytest.mark.parametrize("path", AUTOMATIC[1:])
def test_an_actuated_axis_without_stiffness_leaves_nothing_automatic(path):
    scene = load_scene("fish_3d", {"beam.torsional_stiffness": 0.0})
    with refuses(SceneError, f"{path} cannot be auto without bending stiffness at every joint"):
        scene.replace(path, "auto")
    assert scene.torque_limit == (8.0, 6.0, 2.0)
    assert scene.replace({"actuation.axes": ["yaw"], "actuation.torque_limit": 6.0, path: "auto"})
    found = characterise(scene)
    assert found.period is None and "no bending stiffness" in found.advice[0]
    assert found.bend_per_torque[2] is None and found.bend_at_limit[2] is None
    assert set(found.modes) == {"lateral", "dorsoventral"}
    assert "static roll" not in str(found) and "T1" not in str(found)


def test_a_file_of_a_body_without_stiffness_has_the_defaults(tmp_path):
    path = tmp_path / "rope.yaml"
    path.write_text("dimension: 3\nbeam: {lateral_stiffness: 0}\nfluid: {density: 1e3}\n")
    scene = load_scene(path)
    assert (scene.episode, scene.integrator) == (SpatialEpisode(), Integrator())
    assert scene.torque_limit == (1.0,)


def test_panels_and_lengths_are_not_automatic():
    for path, said in (
        ("fluid.panels_per_element", "has no meaning in a scene of dimension 3"),
        ("fluid.rows", "fluid.rows must be"),
        ("beam.length", "beam.length must be a number in m, got text 'auto'"),
    ):
        with refuses(SceneError, said):
            load_scene("fish_3d", {path: "auto"})


# ---- characteristics ---------------------------------------------------------------------------


def test_characteristics_of_the_eel_are_those_of_a_uniform_elliptic_rod():
    scene = load_scene("eel_3d", {"fluid.model": "strip"})
    found = characterise(scene)
    b, a, rho, n = 0.03, 0.04, 1000.0, scene.beam.elements
    mass = rho * math.pi * a * b
    assert found.mass == pytest.approx(mass, rel=1e-12)
    # Strips: rho pi a^2 against lateral motion, rho pi b^2 against the other, nothing along.
    assert found.added_mass_lateral == pytest.approx(rho * math.pi * a**2, rel=1e-9)
    assert found.added_mass_dorsoventral == pytest.approx(rho * math.pi * b**2, rel=1e-9)
    assert found.added_mass_along == 0.0
    rod = mass / 12.0 * (1.0 - 1.0 / n**2)  # elements are rigid, their own extent does not turn
    around_d1, around_d2 = mass * a**2 / 4.0, mass * b**2 / 4.0
    expected = (rod + around_d1, rod + around_d2, around_d1 + around_d2)
    assert found.rotary_inertia == pytest.approx(expected, rel=1e-12)
    added = (rho * math.pi * b**2 / 12, rho * math.pi * a**2 / 12, rho * math.pi / 8)
    expected = (*added[:2], added[2] * (a**2 - b**2) ** 2)
    assert found.added_rotary_inertia == pytest.approx(expected, rel=1e-9)
    assert found.natural_frequencies == pytest.approx(natural_frequencies(scene, 27), rel=1e-9)
    assert found.modes[:3] == ("lateral", "dorsoventral", "lateral")
    assert found.period == pytest.approx(1.0 / _first(scene, "yaw"), rel=1e-12)
    assert found.bend_per_torque == pytest.approx((1 / 5.0, 1 / 2.8))
    assert found.bend_at_limit == pytest.approx((5.0 / 5.0, 3.0 / 2.8))
    assert found.actions_per_period == pytest.approx(found.period / 0.02)
    shares = np.array(found.natural_frequencies)
    bending = shares[np.array(found.modes) != "torsion"]
    assert found.commanded_modes == (bending * 0.02 * 4 <= 1.0).sum()
    assert found.resolved_modes == (shares * 0.005 * 8 <= 1.0).sum()
    assert found.advice == ()


def test_the_command_shows_them(capsys):
    assert call_main(["characterise", "--scene", "fish_3d"]) == 0
    shown = capsys.readouterr().out
    assert "T1 = 524 ms, of the first lateral mode" in shown
    assert "0.5 rad at the torque limit of 8 N m" in shown
    assert call_main(["characterise", "--scene", "fish_3d", "--json"]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["axes"] == list(AXES) and told["driven_axis"] == "yaw"
    assert told["mass"] == pytest.approx(7.0, rel=1e-3)


def test_advice_names_the_axis_and_the_mode_and_following_it_helps():
    scene = load_scene(
        "fish_3d",
        {
            "damping": None,
            "episode.duration": 2.0,
            "episode.control_interval": 0.24,
            "integrator.time_step": 0.08,
            "actuation.torque_limit": [8.0, 0.01, 20.0],
        },
    )
    advice = characterise(scene).advice
    parts = (
        "torques are held for 240 ms, the first lateral mode has a period of 524 ms",
        "hardly resolves the first lateral mode's period",
        "damps",
        "the torque limit of 0.01 N m of yaw bends the body by 0.0025 rad in all, little",
        "the torque limit of 20 N m of roll twists the body by 2.5 rad in all, much",
        "too few to get under way",
    )
    assert len(advice) == len(parts)
    for part, text in zip(parts, advice, strict=True):
        assert part in text and "(or auto)" in text
    assert "take actuation.torque_limit=[3.2,0.8,1.6] (or auto)" in advice[3]
    assert characterise(scene.replace(ALL_AUTO)).advice == ()
