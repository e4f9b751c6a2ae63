"""Scenes: the values of Table 1, validation and its messages, YAML, overrides, files."""

import dataclasses
import json
import math
import os
import pickle
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from swim_env import characterise, natural_frequencies
from swim_env.errors import SceneError, SwimError
from swim_env.scene import (
    EFFECT_NAMES,
    FLUID_MODEL_NAMES,
    Actuation,
    AxialAddedMass,
    Beam,
    CrossFlowDrag,
    Damping,
    Episode,
    Fluid,
    Initial,
    Integrator,
    InternalForces,
    LinearStiffness,
    PiecewiseStiffness,
    Recording,
    Scene,
    SelfContact,
    StiffnessPiece,
    Stream,
    load_scene,
    scene_names,
)
from swim_env.scene.scene import AUTOMATIC
from tests.support import ROOT, full_disk, refuses, run_python

PAPER = ["i", "ii", "iii", "iv", "v", "vi", "vii", "viii", "ix", "x", "xi", "xii"]
SHIPPED = [f"paper_{number}" for number in PAPER] + ["swimmer"]
WATER = Fluid("panels", 10.0)
TWO_PI = 2.0 * math.pi
MODELS = "none, strip, frozen, expansion, panels, centreline"

#: All effects that have a block, in their order.
EFFECTS: dict[str, object] = {
    "axial_added_mass": AxialAddedMass(),
    "damping": Damping(1e-300),
    "cross_flow_drag": CrossFlowDrag(1e-7),
    "stream": Stream((-1e22, 1 / 3)),
    "self_contact": SelfContact(),
    "internal_forces": InternalForces(),
    "recording": Recording(),
}
#: Those whose block has no fields.
BARE = ("axial_added_mass", "self_contact", "internal_forces", "recording")


def fails(call, *parts: str) -> SceneError:
    """Assert that a call raises a one-line SceneError with these parts, and return it."""
    with refuses(SceneError, *parts) as caught:
        call()
    return caught.value


# ---- the shipped scenes ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("number", "amplitude", "stiffness", "length", "elements", "velocity"),
    [
        ("i", 1.0, [5.0] * 8, 1.0, 9, (0.0, 0.0)),
        ("ii", 1.0, [10.0] * 8, 1.0, 9, (0.0, 0.0)),
        ("iii", 0.5, [5.0] * 8, 1.0, 9, (0.0, 0.0)),
        ("iv", 1.0, [5.0] * 2, 1.0, 3, (0.0, 0.0)),
        ("v", 0.5, [5.0] * 8, 2.0, 9, (0.0, 0.0)),
        ("vi", 1.0, [50.0] * 4 + [5.0] * 4, 1.0, 9, (0.0, 0.0)),
        ("vii", 1.0, [10.0, 9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 3.0], 1.0, 9, (0.0, 0.0)),
        ("viii", 1.0, [5.0] * 8, 1.0, 9, (0.0, 0.0)),
        ("ix", 1.0, [5.0] * 8, 1.0, 9, (0.0, 0.0)),
        ("x", None, [5.0] * 2, 1.0, 3, (0.1, 1e-4)),
        ("xi", None, [5.0] * 8, 1.0, 9, (0.1, 1e-4)),
        ("xii", None, [5.0] * 26, 1.0, 27, (0.1, 1e-4)),
    ],
)
def test_every_paper_scene_has_the_values_of_table_1(
    number, amplitude, stiffness, length, elements, velocity
):
    scene = load_scene(f"paper_{number}")
    assert scene.name == f"paper_{number}"
    assert scene.description
    beam = scene.beam
    assert (beam.length, beam.elements) == (length, elements)
    assert (beam.line_density, beam.rotary_inertia, beam.half_thickness) == (0.31, 7.8e-6, 0.01)
    np.testing.assert_allclose(beam.stiffness_at_joints(), stiffness, rtol=1e-15)
    assert scene.fluid == Fluid("panels", 10.0, 12 if elements == 3 else 4, 1)
    assert scene.effects == ("bending_stiffness",)
    assert scene.initial == Initial(velocity=velocity)
    assert scene.integrator == Integrator(0.01, 1e-10, "paper", "averaged_directors")
    assert scene.episode.duration == 100.0
    if amplitude is None:
        assert scene.actuation is None
    else:
        wave = Actuation(amplitude, TWO_PI, TWO_PI)
        special = {"viii": {"end_time": 50.0}, "ix": {"active_until": 0.5}}.get(number, {})
        assert scene.actuation == dataclasses.replace(wave, **special)


def test_swimmer_is_paper_i_with_damping_and_settings_of_its_own():
    expected = load_scene("paper_i").replace(
        {
            "name": "swimmer",
            "description": load_scene("swimmer").description,
            "damping.retardation_time": 1e-3,
            "fluid.cap_panels": 2,
            "integrator.scheme": "composed",
            "integrator.time_step": 0.005,
            "integrator.tolerance": 1e-4,
            "episode.duration": 20.0,
        }
    )
    assert load_scene("swimmer") == expected
    assert expected.effects == ("bending_stiffness", "damping")


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_scene_survives_dictionary_text_file_and_pickle(name, tmp_path):
    scene = load_scene(name)
    path = tmp_path / "copy.yaml"
    scene.save(path)
    for copy in (
        Scene.from_dict(scene.to_dict()),
        Scene.from_yaml(path),
        load_scene(path),
        load_scene(str(path)),
        load_scene(scene),
        pickle.loads(pickle.dumps(scene)),
    ):
        assert copy == scene
        assert hash(copy) == hash(scene)
    assert path.read_text(encoding="utf-8") == scene.to_yaml()
    assert [entry.name for entry in tmp_path.iterdir()] == ["copy.yaml"]


def test_all_other_fields_and_awkward_numbers_and_texts_survive_a_file(tmp_path):
    turn = Initial(
        position=(0.1, -1e-5),
        heading=1 / 3,
        joint_angles=(0.1, 0.2),
        velocity=((0.0, 0.0), (0.0, 0.0), (0.0, 0.0)),
        turning_rate=(0.0, 0.0, 0.0),
    )
    scene = Scene(
        name="1e-3",
        description="yes: 'no', #5\nβ",
        beam=Beam(elements=3, bending_stiffness=(1e22, 1e-7)),
        fluid=WATER,
        actuation=Actuation(-1.0, -2.0, 0.1, 3.0, 0.5, 0.0, 1e-9),
        initial=turn,
        integrator=Integrator(scheme="composed", strain="mean_angles"),
        **EFFECTS,
    )
    path = tmp_path / "s.yaml"
    for each in (scene, Scene(), Scene(fluid=Fluid("none"))):
        each.save(path)
        assert Scene.from_yaml(path) == Scene.from_dict(each.to_dict()) == each
    # Absent effects leave no trace in a file.
    assert not set(EFFECTS) & set(load_scene("paper_i").to_dict())


# ---- effects -----------------------------------------------------------------------------------


def test_effects_are_listed_in_one_order_whatever_the_order_they_are_put_in():
    assert EFFECT_NAMES == ("bending_stiffness", *EFFECTS)
    scene = load_scene("paper_i")
    assert scene.effects == ("bending_stiffness",)
    for name in reversed(EFFECTS):
        scene = scene.replace(name, EFFECTS[name])
    assert scene.effects == EFFECT_NAMES
    for name in EFFECTS:
        left = tuple(each for each in EFFECT_NAMES if each != name)
        assert scene.replace(name, None).effects == left


def test_a_beam_without_stiffness_has_not_even_the_first_effect():
    scene = load_scene("paper_i")
    without = scene.replace("beam.bending_stiffness", None)
    assert without.effects == Scene(beam=Beam(bending_stiffness=0.0)).effects == ()
    assert without == scene.replace("beam.bending_stiffness", 0.0)
    assert Scene.from_dict({"beam": {"bending_stiffness": None}}).effects == ()
    assert Scene(beam=Beam(bending_stiffness=[0.0] * 7 + [1e-300])).effects == EFFECT_NAMES[:1]


@pytest.mark.parametrize("name", EFFECTS)
def test_blocks_are_there_in_all_their_forms_and_absent_where_null(name):
    plain = load_scene("paper_i")
    forms = (True, {}) if name in BARE else ()
    for present in (EFFECTS[name], *forms):
        assert plain.replace(name, present).effects == tuple(
            each for each in EFFECT_NAMES if each in ("bending_stiffness", name)
        )
    assert plain.replace(name, EFFECTS[name]).replace(name, None) == plain
    data = {**plain.to_dict(), name: None}
    if name in BARE:  # a bare `recording:` might be meant as its presence
        fails(lambda: Scene.from_dict(data), f"{name} must be {{}} or true", "got null")
    else:
        assert Scene.from_dict(data) == plain


def test_the_short_forms_of_a_file_take_default_values(tmp_path):
    file = tmp_path / "short.yaml"
    text = "name: short\nfluid: {density: 10}\ncross_flow_drag: {}\nstream: {velocity: [1, 0]}\n"
    file.write_text(text + "self_contact: {}\nrecording: true\ninternal_forces: {}\n")
    short = Scene.from_yaml(file)
    assert short.cross_flow_drag == CrossFlowDrag(1.0) and short.stream == Stream((1.0, 0.0))
    assert short.effects == (EFFECT_NAMES[0], *EFFECT_NAMES[3:])


def test_names_and_defaults():
    default = Integrator()
    assert (default.scheme, default.strain) == ("paper", "averaged_directors")
    assert default.energy_excess == "warn"
    assert ", ".join(FLUID_MODEL_NAMES) == MODELS


# ---- beam --------------------------------------------------------------------------------------


@pytest.mark.parametrize("elements", [2, 3, 8, 9, 10, 27])
def test_stiffness_laws_mean_the_same_at_every_resolution(elements):
    """The laws of vi and vii give EI at s = (k-1) dl whatever N is."""
    thin = {"beam.elements": elements, "beam.half_thickness": 1e-3}
    place = np.arange(1, elements) / elements
    halves = load_scene("paper_vi", thin).beam.stiffness_at_joints()
    np.testing.assert_array_equal(halves, np.where(place < 0.5, 50.0, 5.0))
    linear = load_scene("paper_vii", thin).beam.stiffness_at_joints()
    np.testing.assert_allclose(linear, 11.0 - 9.0 * place, rtol=1e-15)
    assert halves.dtype == linear.dtype == np.float64
    assert halves.shape == linear.shape == (elements - 1,)


def test_a_list_is_taken_as_it_is_a_number_everywhere_a_joint_on_a_border_is_behind_it():
    assert Beam(elements=4, bending_stiffness=[1, 2, 3]).stiffness_at_joints().tolist() == [1, 2, 3]
    assert Beam(elements=4, bending_stiffness=7).stiffness_at_joints().tolist() == [7, 7, 7]
    pieces = {"pieces": [{"until": u, "value": v} for u, v in ((0.25, 1), (0.5, 2), (1.0, 3))]}
    beam = Beam(elements=8, bending_stiffness=pieces)
    assert beam.stiffness_at_joints().tolist() == [1, 2, 2, 3, 3, 3, 3]
    assert beam.element_length == 0.125
    expected = PiecewiseStiffness(
        (StiffnessPiece(0.25, 1.0), StiffnessPiece(0.5, 2.0), StiffnessPiece(1.0, 3.0))
    )
    assert beam.bending_stiffness == expected
    assert Beam(bending_stiffness={"linear": {"head": 3, "tail": 1}}) == Beam(
        bending_stiffness=LinearStiffness(3.0, 1.0)
    )


def test_blocks_are_frozen_and_numpy_values_become_plain_ones():
    beam = Beam(
        length=np.float32(2.0), elements=np.int64(3), bending_stiffness=np.array([1.0, 2.0])
    )
    assert beam == Beam(length=2.0, elements=3, bending_stiffness=(1.0, 2.0))
    assert hash(beam) == hash(Beam(length=2, elements=3, bending_stiffness=[1, 2]))
    assert type(beam.length) is float and type(beam.elements) is int
    with pytest.raises(dataclasses.FrozenInstanceError):
        beam.length = 1.0


# ---- actuation ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["paper_i", "paper_iii", "paper_iv", "paper_v"])
def test_torque_formula(name):
    """The wave is A cos(f t - kappa s/l + phase) at s = (k-1) dl."""
    scene = load_scene(name, ["actuation.phase=0.3"])
    wave, beam = scene.actuation, scene.beam
    times = np.arange(7) * 0.13
    torques = wave.torques(times, beam)
    assert torques.shape == (7, beam.elements - 1)
    for t, row in zip(times, torques, strict=True):
        for k in range(2, beam.elements + 1):
            s = (k - 1) * beam.element_length
            expected = wave.amplitude * math.cos(TWO_PI * t - TWO_PI * s / beam.length + 0.3)
            assert row[k - 2] == pytest.approx(expected, rel=1e-13, abs=1e-14)


def test_scene_viii_is_scene_i_before_50_s_and_then_without_torque():
    scene = load_scene("paper_viii")
    times = np.arange(4990, 5010) * scene.integrator.time_step
    torques = scene.actuation.torques(times, scene.beam)
    before = times < 50.0
    assert before.sum() == 10
    same = load_scene("paper_i").actuation.torques(times[before], scene.beam)
    np.testing.assert_array_equal(torques[before], same)
    assert not torques[~before].any()


def test_scene_ix_drives_the_joints_of_the_front_half_as_scene_i_does_and_no_other():
    scene = load_scene("paper_ix")
    times = np.linspace(0.0, 1.0, 11)
    torques = scene.actuation.torques(times, scene.beam)
    whole = load_scene("paper_i").actuation.torques(times, scene.beam)
    np.testing.assert_array_equal(torques[:, :4], whole[:, :4])
    assert not torques[:, 4:].any()
    even = scene.replace("beam.elements", 10)
    assert (
        even.actuation.torques([0.05], even.beam)[0].astype(bool).tolist()
        == [True] * 5 + [False] * 4
    )


def test_the_torque_limit_does_not_clip_the_wave():
    scene = load_scene("paper_i", {"actuation.amplitude": 5.0, "actuation.torque_limit": 2.0})
    assert np.abs(scene.actuation.torques(np.arange(0, 1, 0.01), scene.beam)).max() > 4.9


# ---- initial state -----------------------------------------------------------------------------


def test_by_default_the_body_lies_straight_along_x_with_the_head_at_the_origin_at_rest():
    beam = Beam(length=2.0, elements=4)
    centres, angles = Initial().pose(beam)
    np.testing.assert_allclose(centres, [[0.25, 0], [0.75, 0], [1.25, 0], [1.75, 0]], atol=1e-15)
    assert not angles.any() and angles.shape == (4,)
    moving, rates = Initial().velocities(beam)
    assert moving.shape == (4, 2) and rates.shape == (4,)
    assert not moving.any() and not rates.any()


def test_joint_angles_add_up_behind_the_heading_and_elements_meet_at_nodes():
    beam = Beam(elements=3)
    start = Initial(position=(1.0, 2.0), heading=0.4, joint_angles=[0.5, -0.2])
    centres, angles = start.pose(beam)
    np.testing.assert_allclose(angles, [0.4, 0.9, 0.7], rtol=1e-15)
    arm = 0.5 * beam.element_length * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    np.testing.assert_allclose((centres - arm)[0], [1.0, 2.0], rtol=1e-15)
    np.testing.assert_allclose((centres + arm)[:-1], (centres - arm)[1:], rtol=1e-14)
    same = Initial(joint_angles=0.1).pose(beam)[1]
    np.testing.assert_allclose(same, [0.0, 0.1, 0.2], rtol=1e-15)


def test_velocity_slope_turns_the_straight_body():
    """A lateral velocity linear in x goes with the same turning rate and passes (15)."""
    scene = load_scene("paper_xi", ["initial.velocity_slope=-1e-4"])
    centres, _ = scene.initial.pose(scene.beam)
    moving, rates = scene.initial.velocities(scene.beam)
    np.testing.assert_allclose(moving[:, 0], 0.1)
    np.testing.assert_allclose(moving[:, 1], 1e-4 - 1e-4 * centres[:, 0], rtol=1e-14)
    np.testing.assert_array_equal(rates, np.full(9, -1e-4))


def test_velocities_of_a_bent_body_that_obey_inextensibility_are_accepted():
    beam = Beam(elements=4)
    pose = {"position": [3.0, -7.0], "heading": 2.0, "joint_angles": [0.3, -0.8, 0.5]}
    rates = np.array([0.7, -0.4, 1.3, 0.2])
    _, angles = Initial(**pose).pose(beam)
    swing = 0.5 * beam.element_length * rates[:, None]
    swing = swing * np.stack([-np.sin(angles), np.cos(angles)], axis=1)
    moving = np.array([0.2, 0.1]) + 2 * np.cumsum(swing, axis=0) - swing
    start = Initial(**pose, velocity=moving, turning_rate=rates)
    scene = Scene(beam=beam, initial=start)
    assert Scene.from_dict(scene.to_dict()) == scene
    np.testing.assert_array_equal(scene.initial.velocities(beam)[0], moving)
    moving[2] += [1e-7, 0.0]
    with refuses(SceneError, "initial.velocity", "inextensibility (15)", "elements 2", "1e-07 m/s"):
        Scene(beam=beam, initial=dataclasses.replace(start, velocity=moving))


# ---- bad values --------------------------------------------------------------------------------

#: A field of paper_i, a value that it cannot have, and what is said of it.
BAD = [
    # lengths and other numbers out of range
    ("beam.length", 0, "must be above 0 m, got 0"),
    ("beam.length", -1.0, "must be above 0 m, got -1.0"),
    ("beam.elements", 1, "beam.elements must be at least 2, got 1"),
    ("beam.half_thickness", -0.01, "must be at least 0 m, got -0.01"),
    ("beam.half_thickness", 0.0, "above 0 and below a quarter of the length"),
    ("beam.half_thickness", 0.2501, "0.25 m, for an outline of panels"),
    ("beam.line_density", 0.0, "must be above 0 kg/m, got 0.0"),
    ("beam.rotary_inertia", -1e-9, "must be at least 0 kg m, got -1e-09"),
    ("beam.bending_stiffness", -5.0, "must be at least 0 N m^2, got -5.0"),
    ("fluid.density", 0.0, "must be above 0 kg/m^3, got 0.0"),
    ("fluid.density", None, "panels needs fluid.density"),
    ("fluid.panels_per_element", 5, "must be even"),
    ("fluid.panels_per_element", 0, "must be at least 2, got 0"),
    ("fluid.cap_panels", 0, "must be at least 1, got 0"),
    ("damping.retardation_time", 0.0, "must be above 0 s, got 0.0"),
    ("actuation.torque_limit", 0, "must be above 0 N m, got 0"),
    ("actuation.end_time", -1.0, "must be at least 0 s, got -1.0"),
    ("actuation.active_until", 0.0, "must be above 0, got 0.0"),
    ("actuation.active_until", 1.1, "must be at most 1, got 1.1"),
    ("integrator.time_step", 0.0, "must be above 0 s, got 0.0"),
    ("integrator.tolerance", 1e-14, "must be at least 1e-13, got 1e-14"),
    ("integrator.tolerance", 1e-3, "must be at most 0.0001, got 0.001"),
    ("episode.duration", -20, "must be above 0 s, got -20"),
    # not finite
    ("beam.length", math.nan, "must be a finite number in m, got nan"),
    ("actuation.amplitude", math.inf, "must be a finite number in N m, got inf"),
    ("initial.heading", 10**5000, "must be a finite number in rad, got an integer of more"),
    # wrong types
    ("beam.length", True, "must be a number in m, got true"),
    ("beam.length", "5", "must be a number in m, got text '5'"),
    ("beam.length", [1.0], "must be a number in m, got a list of 1"),
    ("beam.length", 1j, "must be a number in m, got 1j"),
    ("beam.length", np.zeros((2, 2)), "must be a number in m, got a list of 2"),
    ("beam.elements", 9.5, "must be an integer, got 9.5"),
    ("beam.elements", math.inf, "must be an integer, got inf"),
    ("beam.elements", False, "must be an integer, got false"),
    ("beam.elements", np.float64(math.nan), "must be an integer, got nan"),
    ("fluid.panels_per_element", "four", "must be an integer or auto, got text 'four'"),
    ("damping.retardation_time", None, "must be a number in s, got null"),
    ("actuation.end_time", "never", "must be a number in s, got text 'never'"),
    ("name", 5, "name must be text, got 5"),
    ("name", " ", "name must be text on one line"),
    ("name", "a\nb", "name must be text on one line"),
    ("name", "a\x85b", "name must be text on one line, of printable characters"),
    ("name", "\x1b[31mred", "name must be text on one line, of printable characters"),
    ("name", "bad\udcff", "name must be text on one line, of printable characters"),
    ("description", ["a"], "description must be text, got a list of 1"),
    ("beam", 3, "beam must be a mapping of fields, got 3"),
    ("beam", None, "beam must be a mapping of fields, got null"),
    ("fluid", "none", "fluid must be a mapping of fields, got text 'none'"),
    ("cross_flow_drag", True, "cross_flow_drag must be a mapping of fields, got true"),
    ("cross_flow_drag", {"c": 1}, "unknown field cross_flow_drag.c; known fields: coefficient"),
    ("cross_flow_drag", {"coefficient": 0}, "cross_flow_drag.coefficient must be above 0, got 0"),
    ("cross_flow_drag", {"coefficient": math.nan}, "coefficient must be a finite number"),
    ("cross_flow_drag", {"coefficient": "1"}, "coefficient must be a number, got text '1'"),
    ("stream", {}, "stream.velocity is missing"),
    ("stream", [1.0, 0.0], "stream must be a mapping of fields, got a list of 2"),
    ("stream", {"speed": 1.0}, "unknown field stream.speed; known fields: velocity"),
    ("stream", {"velocity": 1.0}, "stream.velocity must be two numbers [x, y] in m/s"),
    ("stream", {"velocity": [1.0] * 3}, "stream.velocity must be two numbers"),
    ("stream", {"velocity": [1.0, None]}, "stream.velocity[1] must be a number in m/s"),
    *((name, False, f"{name} must be {{}} or true, or left out") for name in BARE),
    *((name, 1, f"{name} must be a mapping of fields, got 1") for name in BARE),
    *((name, {"a": 1}, f"unknown field {name}.a; it has no fields") for name in BARE),
    # names
    ("fluid.model", "panel", f"must be one of {MODELS}, got 'panel' (nearest: panels)"),
    ("fluid.model", None, f"must be one of {MODELS}, got null"),
    ("integrator.scheme", "Paper", "must be one of paper, composed, got 'Paper' (nearest: paper)"),
    ("integrator.strain", "mean_angle", "joint_angle, got 'mean_angle' (nearest: mean_angles)"),
    ("integrator.energy_tolerance", 0.0, "energy_tolerance must be above 0, got 0.0"),
    ("integrator.energy_excess", "stop", "must be one of warn, end, got 'stop'"),
    # stiffness
    ("beam.bending_stiffness", [5.0] * 9, "one value per joint, 8 for beam.elements = 9, got 9"),
    ("beam.bending_stiffness", [], "one value per joint, 8 for beam.elements = 9, got 0"),
    ("beam.bending_stiffness", [5.0] * 7 + [-1], "bending_stiffness[7] must be at least 0"),
    ("beam.bending_stiffness", [5.0] * 7 + ["x"], "bending_stiffness[7] must be a number"),
    ("beam.bending_stiffness", True, "a list of them, pieces or linear, got true"),
    ("beam.bending_stiffness", "stiff", "a list of them, pieces or linear, got text 'stiff'"),
    ("beam.bending_stiffness", {}, "must have either pieces or linear, got 0"),
    ("beam.bending_stiffness", {"lineer": {}}, "beam.bending_stiffness.lineer (nearest: linear)"),
    ("beam.bending_stiffness", {"linear": {"head": 1}}, "linear.tail is missing"),
    ("beam.bending_stiffness", {"linear": {"head": 1, "tail": -1}}, "linear.tail must be at"),
    ("beam.bending_stiffness", {"linear": [1, 2]}, "linear must be a mapping"),
    ("beam.bending_stiffness", {"pieces": 5}, "pieces must be a list"),
    ("beam.bending_stiffness", {"pieces": []}, "pieces must be a list"),
    ("beam.bending_stiffness", {"pieces": [1.0]}, "pieces[0] must be a mapping"),
    ("beam.bending_stiffness", {"pieces": [{"until": 1.0}]}, "pieces[0].value is missing"),
    (
        "beam.bending_stiffness",
        {"pieces": [{"until": 0.5, "value": 1}, {"until": 1.0, "value": "x"}]},
        "beam.bending_stiffness.pieces[1].value must be a number in N m^2, got text 'x'",
    ),
    (
        "beam.bending_stiffness",
        {"pieces": [{"until": 0.5, "value": 1}, {"until": 0.5, "value": 1}]},
        "pieces[1].until must be above the one before it, 0.5, got 0.5",
    ),
    (
        "beam.bending_stiffness",
        {"pieces": [{"until": 0.5, "value": 1}, {"until": 0.9, "value": 1}]},
        "pieces[1].until must be 1.0, the tail, as the last one, got 0.9",
    ),
    # initial state
    ("initial.position", [1.0], "must be two numbers [x, y] in m, got a list of 1"),
    ("initial.position", 0.0, "must be two numbers [x, y] in m, got 0.0"),
    ("initial.velocity", [0.1, "y"], "initial.velocity[1] must be a number in m/s"),
    ("initial.velocity", [], "must be two numbers [x, y] in m/s, got a list of 0"),
    ("initial.velocity", [[0.0, 0.0]] * 8, "one value per element, 9, got 8"),
    ("initial.velocity", [[0.0, 0.0]] * 8 + [[0.0]], "initial.velocity[8] must be two numbers"),
    ("initial.joint_angles", [0.1] * 9, "initial.joint_angles must list one value per joint, 8"),
    ("initial.joint_angles", [math.nan] * 8, "initial.joint_angles[0] must be a finite number"),
    ("initial.turning_rate", [0.0] * 8, "initial.turning_rate must list one value per element, 9"),
    ("initial.turning_rate", "fast", "initial.turning_rate must be a number in rad/s"),
]

#: The same for several fields at once.
BAD_TOGETHER: list[tuple[dict[str, object], tuple[str, ...]]] = [
    # Velocities that break inextensibility (15): the first joint, and the mismatch there.
    *(
        ({f"initial.{name}": value for name, value in fields.items()}, ("(15)", joint, gap))
        for fields, joint, gap in (
            ({"turning_rate": 0.9}, "elements 1 and 2", "0.1 m/s"),
            ({"velocity_slope": 0.9, "turning_rate": 0.0}, "elements 1 and 2", "0.1"),
            ({"velocity_slope": 0.9, "heading": 0.1}, "elements 1 and 2", "m/s"),
            ({"velocity": [[0, 0]] * 5 + [[1, 0]] * 4}, "elements 5 and 6", "1 m/s"),
            ({"velocity": [[1, 0]] * 8 + [[1, 1e-8]]}, "elements 8 and 9", "1e-08"),
            ({"velocity": [1e308, 0], "turning_rate": 1e308}, "elements 1", "m/s"),
        )
    ),
    # Effects that can do nothing, and a singular mass.
    *(
        ({name: block, "fluid": fluid}, (f"{name} has no meaning without a fluid", "leave it out"))
        for name, block in (("cross_flow_drag", {}), ("stream", {"velocity": [0.1, 0.0]}))
        for fluid in (None, {"model": "none", "density": None})
    ),
    *(
        ({"axial_added_mass": {}, **fluid}, ("no meaning without fluid.model panels", found))
        for fluid, found in (
            ({"fluid": None}, ""),
            ({"fluid.model": "none"}, ""),
            ({"fluid.model": "strip"}, "got strip"),
        )
    ),
    *(
        (
            {"beam.rotary_inertia": 0, "fluid": fluid},
            ("beam.rotary_inertia must be above 0 kg m without a fluid", "singular"),
        )
        for fluid in (None, {"model": "none", "density": None})
    ),
    *(
        (
            {"damping": {"retardation_time": 0.001}, "beam.bending_stiffness": nothing},
            ("damping has no meaning where beam.bending_stiffness is zero", "leave damping out"),
        )
        for nothing in (None, 0, [0.0] * 8, {"linear": {"head": 0, "tail": 0}})
    ),
    (
        {"self_contact": {}, "fluid": None, "beam.half_thickness": 0.0},
        ("self_contact needs beam.half_thickness, a number above 0 in m, got 0.0",),
    ),
    *(
        (
            {"fluid.cap_panels": caps, "beam.elements": elements, "beam.half_thickness": thickness},
            (f"fluid.cap_panels must be at least {needed}, or proportional, got {caps}", "ends"),
        )
        for elements, thickness, caps, needed in (
            (9, 0.24, 1, 2),
            (40, 0.05, 1, 2),
            (40, 0.24, 4, 5),
        )
    ),
]
ALL_BAD = [*(({path: value}, (part,)) for path, value, part in BAD), *BAD_TOGETHER]


@pytest.mark.parametrize(
    ("changes", "parts"),
    ALL_BAD,
    ids=[f"{i}-{next(iter(bad[0]))}" for i, bad in enumerate(ALL_BAD)],
)
def test_a_bad_value_is_refused_with_its_field_its_reason_and_its_file(changes, parts):
    scene = load_scene("paper_i")
    error = fails(lambda: scene.replace(changes), *parts, next(iter(changes)).split(".")[0])
    assert isinstance(error, SwimError) and isinstance(error, ValueError)
    assert error.source is None
    source = "configs/scenes/paper_i.yaml with overrides"
    fails(lambda: load_scene("paper_i", changes), *parts, f"({source})")


def test_the_message_of_a_file_has_field_bound_value_and_the_path_as_given(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("x.yaml").write_text("beam: {elements: 1}\n", encoding="utf-8")
    error = fails(lambda: load_scene("x.yaml"))
    assert str(error) == "beam.elements must be at least 2, got 1 (x.yaml)"
    assert str(pickle.loads(pickle.dumps(error))) == str(error)
    Path("dry.yaml").write_text("name: dry\ncross_flow_drag: {}\n", encoding="utf-8")
    fails(lambda: load_scene("dry.yaml"), "cross_flow_drag has no meaning", "(dry.yaml)")


@pytest.mark.parametrize(
    ("data", "parts"),
    [
        ({"beem": {}}, ["unknown field beem (nearest: beam)"]),
        ({"beam": {"lenght": 1.0}}, ["unknown field beam.lenght (nearest: length)"]),
        ({"fluid": {"qqq": 1}}, ["unknown field fluid.qqq; known fields: model, density"]),
        ({"damping": {}}, ["damping.retardation_time is missing"]),
        ({"actuation": {"frequency": 1}}, ["actuation.amplitude is missing"]),
        ({"actuation": {}}, ["actuation.amplitude is missing"]),
        ({"integrator": "autoo"}, ["integrator must be a mapping of fields or auto, got text 'au"]),
        (
            {"integrator": {"time_step": "autoo"}},
            ["integrator.time_step must be a number or auto, got text 'autoo'"],
        ),
        ({"fluid": {}}, ["panels needs fluid.density"]),
        ({"fluid": {"model": "none", "density": 10}}, ["fluid.density has no meaning", "got 10"]),
        ({"name": None}, ["name must be text, got null"]),
        ([1, 2], ["scene must be a mapping of fields, got a list of 2"]),
        ("paper_i", ["scene must be a mapping of fields, got text 'paper_i'"]),
        ({1: 2}, ["unknown field 1"]),
        ({"be\nam": {}}, ["unknown field be am"]),
    ],
)
def test_a_bad_mapping_is_refused_with_its_source(data, parts):
    fails(lambda: Scene.from_dict(data, source="some.yaml"), *parts, "(some.yaml)")


def test_what_is_at_its_limit_is_allowed():
    """A massless rotation in a fluid, a stiffness at one joint, and any thickness without fluid."""
    Scene(fluid=WATER, beam=Beam(rotary_inertia=0), axial_added_mass=AxialAddedMass())
    Scene(beam=Beam(bending_stiffness=[0] * 7 + [1]), damping=Damping(1e-3))
    for thickness in (0.0, 3.0):
        Scene(beam=Beam(half_thickness=thickness))
    for share in (1e-6, 0.2, 0.499):
        Scene(fluid=WATER, beam=Beam(half_thickness=share / 9))
    Scene(fluid=WATER, beam=Beam(elements=161))


def test_a_scene_made_by_hand_takes_blocks_and_not_mappings():
    fails(lambda: Scene(beam={}), "beam must be of type Beam, got dict")
    fails(lambda: Scene(integrator=None), "integrator must be of type Integrator, got NoneType")
    fails(lambda: Scene(damping=1e-3), "damping must be of type Damping, got float")


# ---- replace and overrides ---------------------------------------------------------------------


def test_replace_changes_one_field_or_several_that_are_only_valid_together():
    scene = load_scene("paper_i")
    more = scene.replace("fluid.panels_per_element", 12)
    assert more.fluid == Fluid("panels", 10.0, 12)
    assert scene.fluid == Fluid("panels", 10.0, 4)
    changes = {"beam.bending_stiffness": [1, 2, 3, 4], "beam.elements": 5}
    assert scene.replace(changes).beam == Beam(elements=5, bending_stiffness=(1, 2, 3, 4))
    for missing in (("beam.elements",), ({"beam.elements": 5}, 5)):
        with pytest.raises(TypeError):
            scene.replace(*missing)


def test_replace_makes_and_removes_blocks():
    """A path into an absent block makes it; None removes it; blocks go in as objects or maps."""
    scene = load_scene("paper_i")
    damped = scene.replace("damping.retardation_time", 1e-3)
    assert damped.damping == Damping(1e-3)
    assert damped == scene.replace("damping", Damping(1e-3))
    assert damped == scene.replace("damping", {"retardation_time": 1e-3})
    assert damped.replace("damping", None) == scene == scene.replace("damping", None)
    passive = load_scene("paper_xi")
    fails(lambda: passive.replace("actuation.frequency", 1.0), "actuation.amplitude is missing")
    # What is for environments prescribes no torque.
    limited = passive.replace("actuation.torque_limit", 0.5)
    assert limited.actuation == Actuation(0.0, torque_limit=0.5) and limited.torque_limit == 0.5
    assert load_scene("paper_xi", ["actuation.torque_limit=0.5"]) == limited
    assert passive.replace("actuation.active_until", 0.5).actuation.active_until == 0.5
    paper_wave = passive.replace("actuation.amplitude", 1.0).actuation
    assert paper_wave == Actuation(1.0, TWO_PI, TWO_PI)
    wave = {"amplitude": 1.0, "frequency": 2.0, "wave_number": 3.0}
    driven = passive.replace({f"actuation.{key}": value for key, value in wave.items()})
    assert driven.actuation == Actuation(1.0, 2.0, 3.0)
    assert driven == passive.replace("actuation", wave)
    slower = scene.replace({"damping": Damping(1.0), "damping.retardation_time": 2.0})
    assert slower.damping == Damping(2.0)
    assert scene.replace("beam", Beam(elements=3)).beam.elements == 3


def test_model_none_drops_the_density_and_going_back_needs_one():
    scene = load_scene("paper_i")
    dry = scene.replace("fluid.model", "none")
    assert dry.fluid == Fluid("none")
    assert not dry.fluid.present
    assert load_scene("paper_i", ["fluid.model=none"]) == dry
    assert scene.replace("fluid", None).fluid is None
    fails(lambda: dry.replace("fluid.model", "panels"), "panels needs fluid.density")
    assert dry.replace({"fluid.model": "panels", "fluid.density": 10.0}) == scene
    fails(
        lambda: scene.replace({"fluid.model": "none", "fluid.density": 5}), "fluid.density has no"
    )


@pytest.mark.parametrize(
    ("path", "parts"),
    [
        ("fluid.panel_per_element", ["nearest: fluid.panels_per_element"]),
        ("dampning", ["nearest: damping"]),
        ("beam.time_step", ["nearest: integrator.time_step"]),
        ("elements", ["nearest: beam.elements"]),
        ("beam.bending_stiffness.linear.head", ["nearest: beam.bending_stiffness"]),
        ("zzz", ["a scene has name, description, beam, fluid"]),
        ("", ["unknown field"]),
        ("beam.", ["unknown field beam."]),
        (3, ["unknown field 3"]),
    ],
)
def test_an_unknown_path_is_refused_with_the_nearest_one_there_is(path, parts):
    fails(lambda: Scene().replace(path, 1), f"unknown field {path}", *parts)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("integrator.tolerance=1e-12", 1e-12),
        ("integrator.tolerance = 1.0e-12", 1e-12),
        ("actuation.amplitude=-5", -5.0),
        ("actuation.amplitude=+.5", 0.5),
        ("actuation.amplitude=5.", 5.0),
        ("actuation.amplitude=1E2", 100.0),
        ("actuation.end_time=null", None),
        ("beam.elements=010", 10),
        ("fluid.panels_per_element=12", 12),
        ("beam.bending_stiffness={linear: {head: 1e1, tail: 2}}", LinearStiffness(10.0, 2.0)),
        ("beam.bending_stiffness=[1, 2, 3, 4, 5, 6, 7, 1e-8]", (1, 2, 3, 4, 5, 6, 7, 1e-8)),
        ("name=a=b", "a=b"),
        ("name=no", "no"),
        ("axial_added_mass={}", AxialAddedMass()),
        ("axial_added_mass=true", AxialAddedMass()),
        ("damping=null", None),
        ("damping={retardation_time: 1e-3}", Damping(1e-3)),
    ],
)
def test_a_text_as_on_a_command_line_sets_the_field_that_it_names(text, value):
    found: object = load_scene("paper_i", [text])
    for name in text.split("=")[0].strip().split("."):
        found = getattr(found, name)
    assert found == value and type(found) is type(value)


def test_overrides_apply_together_and_the_last_of_a_kind_counts():
    scene = load_scene("paper_i", ["beam.bending_stiffness=[1, 2]", "beam.elements=3"])
    assert scene.beam.stiffness_at_joints().tolist() == [1.0, 2.0]
    assert load_scene("paper_i", ["beam.elements=3", "beam.elements=5"]).beam.elements == 5
    assert load_scene("paper_i", "beam.elements=3").beam.elements == 3
    assert load_scene("paper_i", {"beam.elements": 3}) == load_scene("paper_i", "beam.elements=3")
    assert load_scene("paper_i", []) == load_scene("paper_i", {}) == load_scene("paper_i")


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("beam.elements", "override 'beam.elements' must read block.field=value"),
        ("=3", "must read block.field=value"),
        ("beam.bending_stiffness=[1, 2", "override 'beam.bending_stiffness=[1, 2': not valid YAML"),
        ("beam={length: 1, length: 2}", "field 'length' is given twice"),
        ("beam.elemnts=3", "unknown field beam.elemnts (nearest: beam.elements)"),
        ("beam.elements=1.5e0", "beam.elements must be an integer, got 1.5"),
        ("beam.elements=", "beam.elements must be an integer, got null"),
        ("name=!!python/object:os.system x", "not valid YAML"),
        (7, "override 7 must read block.field=value"),
    ],
)
def test_an_override_that_cannot_be_read_is_refused(text, part):
    fails(lambda: load_scene("paper_i", [text]), part)


# ---- files -------------------------------------------------------------------------------------


def test_a_file_may_say_1e_3_and_be_without_a_name(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("damping: {retardation_time: 1e-3}\nbeam:\n  length: 2\n", encoding="utf-8")
    scene = load_scene(path)
    assert scene.damping == Damping(1e-3)
    assert (scene.name, scene.beam) == ("mine", Beam(length=2.0))
    assert scene.source == str(path)
    assert scene.replace("beam.length", 1.0).source == str(path)


# ---- what is left to the body ------------------------------------------------------------------

EEL = """
beam: {length: 0.5, elements: 15, half_thickness: 0.005, line_density: 0.156,
       bending_stiffness: 0.156}
fluid: {density: 10.0}
"""


#: Stiffnesses of a body with one joint that has none.
LIMP = [0.0, *[5.0] * 7]


def _file(folder, text):
    path = folder / "eel.yaml"
    path.write_text(text)
    return path


def test_what_a_file_leaves_out_follows_from_the_body(tmp_path):
    scene = load_scene(_file(tmp_path, EEL))
    period = 1.0 / natural_frequencies(scene, 1)[0]
    assert scene.episode.control_interval == pytest.approx(period / 10, rel=1e-12)
    assert scene.episode.duration == pytest.approx(100 * period, rel=1e-12)
    assert scene.integrator == Integrator(
        time_step=scene.episode.control_interval / 4, tolerance=1e-4, scheme="composed"
    )
    assert scene.torque_limit == pytest.approx(0.2 * 0.156 / 0.5, rel=1e-12)
    assert scene.damping is scene.actuation is None, "effects are there only where they are named"
    assert Scene.from_yaml(tmp_path / "eel.yaml") == scene
    assert Scene.from_dict(scene.to_dict()) == scene


def test_what_a_file_says_stays(tmp_path):
    text = EEL + "integrator: {time_step: 0.003}\nepisode: {duration: 7.0}\n"
    text += "actuation: {amplitude: 0.01, frequency: auto}\n"
    scene = load_scene(_file(tmp_path, text))
    assert scene.integrator == Integrator(time_step=0.003)
    # A whole number of time steps.
    assert scene.episode.control_interval == pytest.approx(7 * 0.003, rel=1e-12)
    assert scene.episode.duration == 7.0
    assert scene.actuation.torque_limit == pytest.approx(0.2 * 0.156 / 0.5)
    assert scene.actuation.amplitude == 0.01
    first = natural_frequencies(scene, 1)[0]
    assert scene.actuation.frequency == pytest.approx(2 * np.pi * first)


def test_changes_count_before_the_body_sets_the_rest(tmp_path):
    path = _file(tmp_path, EEL)
    scene = load_scene(path, ["beam.length=1.0", "episode.control_interval=0.3"])
    period = 1.0 / natural_frequencies(scene, 1)[0]
    assert period > 4 / natural_frequencies(load_scene(path), 1)[0]
    assert scene.episode.duration == pytest.approx(100 * period)
    assert scene.steps_per_action == pytest.approx(0.3 / period * 40, abs=1.0)
    finer = load_scene(path, ["integrator.scheme=paper"])
    assert finer.steps_per_action == 8
    sharper = load_scene(path, ["integrator.tolerance=1e-6"])
    expected = load_scene(path).integrator
    assert sharper.integrator == dataclasses.replace(expected, tolerance=1e-6)
    with pytest.raises(SceneError, match=r"control_interval must be a number.*with overrides"):
        load_scene(path, ["episode.control_interval=automatic"])


def test_a_scene_holds_numbers_and_can_be_asked_again():
    scene = load_scene("swimmer", {"damping.retardation_time": "auto", "integrator": "auto"})
    period = 1.0 / natural_frequencies(scene, 1)[0]
    assert scene.damping.retardation_time == pytest.approx(period / 200)
    assert scene.integrator.time_step == pytest.approx(0.02 / 5), "a whole part of 0.02 s"
    longer = scene.replace({"beam.length": 2.0, "episode.control_interval": "auto"})
    assert longer.damping == scene.damping
    assert longer.episode.control_interval > 3 * 0.02


@pytest.mark.parametrize("path", AUTOMATIC[1:])
def test_without_stiffness_no_time_or_torque_is_automatic(tmp_path, path):
    limp = {"beam.bending_stiffness": LIMP, path: "auto"}
    with pytest.raises(SceneError, match="cannot be auto without bending stiffness"):
        load_scene("swimmer", {"actuation": {"amplitude": 1.0}, **limp})
    text = "beam: {bending_stiffness: 0}\nfluid: {density: 10}\n"
    scene = load_scene(_file(tmp_path, text))
    assert (scene.episode, scene.integrator, scene.torque_limit) == (Episode(), Integrator(), 1.0)


@pytest.mark.parametrize(("elements", "panels"), [(2, 18), (5, 8), (8, 6), (9, 4), (20, 4)])
def test_few_elements_have_more_panels_each(tmp_path, elements, panels):
    text = f"beam: {{elements: {elements}, half_thickness: 0.01}}\nfluid: {{density: 10}}\n"
    assert load_scene(_file(tmp_path, text)).fluid.panels_per_element == panels
    limp = load_scene(
        "swimmer",
        {
            "beam.elements": elements,
            "beam.bending_stiffness": 0.0,
            "damping": None,
            "fluid.panels_per_element": "auto",
        },
    )
    assert limp.fluid.panels_per_element == panels
    strips = _file(tmp_path, text.replace("density", "model: strip, density"))
    assert load_scene(strips).fluid.panels_per_element == 4


def test_only_what_follows_from_the_body_is_automatic():
    with pytest.raises(SceneError, match=r"beam.length must be a number in m, got text 'auto'"):
        load_scene("swimmer", {"beam.length": "auto"})


# ---- what a body is like -----------------------------------------------------------------------


def test_characteristics_of_the_swimmer():
    found = characterise(load_scene("swimmer"))
    assert found.natural_frequencies == tuple(natural_frequencies(load_scene("swimmer"), 8))
    assert found.mass == pytest.approx(0.31)
    # A flat plate's, pi/4 density length^2, and what the thickness and the ends add.
    assert found.added_mass_across == pytest.approx(np.pi / 4 * 10.0, rel=0.06)
    assert found.added_rotary_inertia == pytest.approx(np.pi / 128 * 10.0, rel=0.09)
    assert found.added_mass_along == pytest.approx(0.0, abs=1e-12)
    assert found.rotary_inertia == pytest.approx(0.31 / 12, rel=0.02)
    assert (found.bend_per_torque, found.bend_at_limit) == pytest.approx((0.2, 0.2))
    assert found.actions_per_period == pytest.approx(found.period / 0.02)
    assert (found.commanded_modes, found.resolved_modes) == (1, 2)
    assert found.advice == ()
    assert "first period T1 = 196 ms" in str(found)
    assert json.loads(json.dumps(found.to_dict()))["period"] == found.period


def test_advice_says_what_would_help_and_following_it_helps():
    scene = load_scene(
        "swimmer",
        {
            "beam.length": 0.5,
            "damping": None,
            "episode.duration": 0.5,
            "integrator.time_step": 0.02,
            "actuation.torque_limit": 1e-3,
        },
    )
    advice = characterise(scene).advice
    parts = ("torques are held for 20 ms", "time step", "damps", "torque limit", "an episode of")
    assert len(advice) == len(parts)
    for part, text in zip(parts, advice, strict=True):
        assert part in text
        assert "(or auto)" in text
    paths = [re.search(r"take (\S+)=(\S+) \(or auto\)", one).groups() for one in advice]
    assert characterise(scene.replace(dict.fromkeys(dict(paths), "auto"))).advice == ()
    # In the order of the names a control interval comes before the time step.
    taken = scene.replace({path: float(value) for path, value in paths})
    assert characterise(taken).advice == ()


def test_a_body_of_suspicious_density_is_told_that_the_fluid_is_a_metre_deep():
    water = {"fluid.density": 1000.0, "beam.half_thickness": 0.012, "beam.line_density": 0.6}
    (advice,) = [one for one in characterise(load_scene("swimmer", water)).advice if "dense" in one]
    assert "0.025 times as dense" in advice and advice.endswith("beam.line_density=24")
    # However slender, a body as dense as the fluid is not suspicious.
    thin = {"beam.half_thickness": 0.0005, "beam.line_density": 0.01}
    assert not [one for one in characterise(load_scene("swimmer", thin)).advice if "dense" in one]


def test_a_body_without_stiffness_has_no_period():
    found = characterise(load_scene("swimmer", {"beam.bending_stiffness": LIMP}))
    assert found.period is None and found.natural_frequencies == ()
    assert "no bending stiffness" in found.advice[0]
    assert "bending modes" not in str(found)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        (b"beam:\n  length: 1\n  length: 2\n", ["line 3", "field 'length' is given twice"]),
        (b"beam: {}\nname: x\nbeam: {}\n", ["line 3", "field 'beam' is given twice"]),
        (b"name: x\nbeam: [1, 2\n", ["not valid YAML, line"]),
        (b"name: x\n\tbeam: 1\n", ["not valid YAML, line 2"]),
        (b"a: 1\n---\nb: 2\n", ["not valid YAML, line 2"]),
        (b"beam: &b {length: 1}\nfluid: *c\n", ["line 2", "undefined alias"]),
        (b"beam: &b {length: *b}\n", ["beam.length must be a number in m, got a mapping"]),
        (b"name: !!python/object/apply:os.getcwd []\n", ["not valid YAML, line 1"]),
        (b"name: !!float x\n", ["not valid YAML: a tag"]),
        (b"name: !!bool x\n", ["not valid YAML: a tag"]),
        (b"name: !!timestamp x\n", ["not valid YAML: a tag"]),
        (b"1: 2\n", ["line 1", "a field's name must be text"]),
        (b"[1, 2]: 2\n", ["line 1"]),
        (b"<<: {name: x}\n", ["unknown field <<"]),
        (b"beam: {elements: " + b"9" * 5000 + b"}\n", ["line 1"]),
        (b"name: \x00\n", ["not valid YAML"]),
        (b"name: \xff\n", ["must be UTF-8 text, byte 6"]),
        (b"[" * 3000, ["not valid YAML"]),
        (b"", ["the file is empty"]),
        (b"# nothing\n", ["the file is empty"]),
        (b"beam: {length: 1:30}\n", ["beam.length must be a number in m, got text '1:30'"]),
        (b"beam: {length: .nan}\n", ["beam.length must be a finite number in m, got nan"]),
        (b"beam: {length: -.inf}\n", ["beam.length must be a finite number in m, got -inf"]),
    ],
    ids=range(23),
)
def test_a_file_that_is_not_a_scene_is_refused(text, parts, tmp_path, monkeypatch):
    """With the line where YAML breaks, and the file's name."""
    monkeypatch.chdir(tmp_path)
    Path("bad.yaml").write_bytes(text)
    error = fails(lambda: Scene.from_yaml("bad.yaml"), *parts, "(bad.yaml)")
    assert str(tmp_path) not in str(error)


def test_what_is_not_there_is_refused_with_the_nearest_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.yaml").write_text("{}", encoding="utf-8")
    for call in (
        lambda: load_scene("min.yaml"),
        lambda: load_scene(Path("min.yaml")),
        lambda: Scene.from_yaml("min.yaml"),
    ):
        error = fails(call, "no such scene file: min.yaml", "(nearest: mine.yaml)", "paper_xii")
        assert str(tmp_path) not in str(error)
    fails(lambda: load_scene("no/where/paper_i.yaml"), "no/where/paper_i.yaml (nearest: paper_i)")
    fails(lambda: load_scene("papr_i"), "unknown scene 'papr_i' (nearest: paper_i)", "swimmer")
    fails(lambda: load_scene(""), "unknown scene ''", "shipped scenes: paper_i,")
    fails(lambda: load_scene("x" * 5000), "unknown scene")
    fails(lambda: load_scene("a\0b.yaml"), "no such scene file")
    fails(lambda: load_scene(7), "must be given as a name, a path, a Scene or a mapping, got int")
    Path("folder.yaml").mkdir()
    fails(lambda: load_scene("folder.yaml"), "cannot read the scene file", "(folder.yaml)")


def test_a_failed_save_leaves_the_old_file_and_nothing_half_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    load_scene("paper_i").save("s.yaml")
    before = Path("s.yaml").read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full_disk)
        fails(lambda: Scene().save("s.yaml"), "cannot write", "No space left", "(s.yaml)")
    assert Path("s.yaml").read_bytes() == before
    assert os.listdir() == ["s.yaml"]
    fails(lambda: Scene().save("no/s.yaml"), "cannot write the scene file", "(no/s.yaml)")


def test_scenes_are_found_inside_the_package_where_a_wheel_puts_them(tmp_path):
    package = tmp_path / "swim_env"
    shutil.copytree(ROOT / "swim_env", package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "configs" / "scenes", package / "configs" / "scenes")
    code = "import swim_env as s; print(s.__file__, s.scene_names(), s.load_scene('swimmer'))"
    variables = {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    done = run_python("-c", code, cwd=tmp_path, **variables)
    assert done.out.startswith(f"{package / '__init__.py'} {scene_names()} Scene(name='swimmer")
