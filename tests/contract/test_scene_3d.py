"""Scenes of dimension 3: their blocks, values and messages, and what planar code says of them."""

import dataclasses
import math
import pickle

import numpy as np
import pytest

from swim_env import (
    Simulator,
    scene_names,
)
from swim_env.accuracy.reference import FINE, reference_of
from swim_env.analysis.flow import BodyFlow
from swim_env.errors import SceneError
from swim_env.scene import (
    Actuation,
    Beam,
    CrossFlowDrag,
    Damping,
    Episode,
    Fluid,
    Initial,
    Integrator,
    LinearStiffness,
    Scene,
    Section,
    SpatialActuation,
    SpatialBeam,
    SpatialDamping,
    SpatialEpisode,
    SpatialFluid,
    SpatialInitial,
    SpatialScene,
    SpatialStream,
    Stream,
    load_scene,
    scene_label,
)
from tests.support import refuses

SHIPPED = ["eel_3d", "ellipsoid_3d", "fish_3d", "helix_3d", "paper_i_3d"]
WATER = {"model": "strip", "density": 1000.0}
ROD = {"dimension": 3, "fluid": WATER}
ZERO = (0.0, 0.0, 0.0)
TABLE = [[0, 0, 0], [0.4, 0.03, 0.05], [1, 0, 0]]


def fails(call, *parts: str) -> None:
    """Assert that a call raises a one-line SceneError with these parts."""
    with refuses(SceneError, *parts):
        call()


# ---- the shipped scenes ------------------------------------------------------------------------


def test_shipped_scenes_of_both_dimensions_are_listed_together():
    assert list(scene_names()[-5:]) == SHIPPED, "planar ones first"
    for name in scene_names():
        scene = load_scene(name)
        assert scene.dimension == (3 if name in SHIPPED else 2)
        assert isinstance(scene, Scene)
        assert isinstance(scene, SpatialScene) == (scene.dimension == 3)


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_scene_survives_dictionary_text_file_and_pickle(name, tmp_path):
    scene = load_scene(name)
    path = tmp_path / "copy.yaml"
    scene.save(path)
    assert path.read_text(encoding="utf-8").startswith(f"dimension: 3\nname: {name}\n")
    for copy in (
        Scene.from_dict(scene.to_dict()),
        Scene.from_yaml(path),
        SpatialScene.from_yaml(path),
        load_scene(path),
        pickle.loads(pickle.dumps(scene)),
        scene.replace("name", name),
    ):
        assert copy == scene and hash(copy) == hash(scene)
        assert type(copy) is SpatialScene
    assert scene_label(scene) == name
    assert scene.steps_per_action > 0 and scene.frame_interval == 0.02
    assert scene.replace("beam.length", 1.5).source == scene.source


def test_fish_3d_is_as_specified():
    scene = load_scene("fish_3d")
    beam = scene.beam
    assert (beam.length, beam.elements, beam.density) == (1.0, 9, None)
    assert (scene.fluid.model, scene.fluid.density) == ("strip", 1000.0)
    assert beam.stiffness_at_joints().tolist() == [[16.0, 4.0, 8.0]] * 8
    assert scene.damping.times.tolist() == [0.02] * 3
    assert (scene.axes, scene.torque_limit) == (("pitch", "yaw", "roll"), (8.0, 6.0, 2.0))
    assert scene.integrator.time_step == 0.005
    assert scene.inertia_per_length()[:, 0].sum() * beam.element_length == pytest.approx(7.0, 1e-3)
    wave = scene.actuation
    assert (wave.amplitude, wave.frequency, wave.wave_number) == (6.0, 3 * math.pi, 2 * math.pi)


def test_paper_i_3d_has_the_inertia_of_table_1_and_the_drive_of_paper_i():
    scene, planar = load_scene("paper_i_3d"), load_scene("paper_i")
    assert (scene.beam.section.half_width, scene.beam.section.half_height) == (0.01, 1.0)
    mean = scene.inertia_per_length()[4]
    assert mean[:2] == pytest.approx([planar.beam.line_density, 7.8e-6], rel=0.02)
    np.testing.assert_array_equal(
        scene.beam.stiffness_at_joints()[:, 1], planar.beam.stiffness_at_joints()
    )
    times = np.arange(9) * 0.13
    torques = scene.actuation.torques(times, scene.beam)
    np.testing.assert_array_equal(torques[..., 1], planar.actuation.torques(times, planar.beam))
    assert not torques[..., [0, 2]].any()


# ---- making and changing scenes ----------------------------------------------------------------


def test_all_other_fields_survive_a_file(tmp_path):
    matrix = np.eye(12) + np.diag(np.arange(11) / 7, 1) + np.diag(np.arange(11) / 7, -1)
    scene = SpatialScene(
        beam=SpatialBeam(
            length=2.0,
            elements=2,
            section=Section("fish", table=TABLE),
            density=900.0,
            line_density=1e-3,
            rotary_inertia_1=1e-7,
            rotary_inertia_2=1e22,
            lateral_stiffness=[1.0],
            dorsoventral_stiffness={"pieces": [{"until": 1.0, "value": 2.0}]},
            torsional_stiffness=LinearStiffness(3.0, 4.0),
            natural_curvature=[[0.1, -0.2, 1 / 3]],
        ),
        fluid=SpatialFluid("given", 1.0, rows=3, around=8, matrix=matrix),
        damping=SpatialDamping([0.0, 0.1, 0.0]),
        stream=SpatialStream([-1e22, 1 / 3, 0]),
        actuation=SpatialActuation(
            1.0, torque_limit=[1, 2, 3], axes=("roll", "yaw", "pitch"), wave="helical_left"
        ),
        initial=SpatialInitial([1, 2, 3], [4, 5, 6], [[0.1, 0.2, 0.3]]),
        integrator=Integrator(scheme="composed", strain="joint_angle"),
        episode=SpatialEpisode(heading=(0.0, 0.6, 0.8)),
    )
    path = tmp_path / "s.yaml"
    flat = scene.replace({"fluid": {"model": "panels", "density": 1, "self_term": "flat"}})
    for each in (
        scene,
        flat,
        flat.replace({"fluid.self_term": "gauss", "fluid.rings": "inscribed"}),
    ):
        each.save(path)
        assert Scene.from_yaml(path) == Scene.from_dict(each.to_dict()) == each
    assert scene.beam.natural_curvature_at_joints().tolist() == [[0.1, -0.2, 1 / 3]]
    assert scene.initial.rotations(scene.beam).tolist() == [[0.1, 0.2, 0.3]]
    assert scene.actuation.limits == (1.0, 2.0, 3.0)


def test_the_dimension_of_a_mapping_decides_and_cannot_be_changed():
    assert Scene.from_dict({"dimension": 2}) == Scene.from_dict({}) == Scene()
    assert "dimension" not in Scene().to_dict()
    assert SpatialScene.from_dict({"fluid": WATER}) == Scene.from_dict(ROD)
    for bad, shown in ((4, "4"), (None, "null"), (True, "true"), ("3", "text '3'"), (2.5, "2.5")):
        fails(lambda bad=bad: Scene.from_dict({"dimension": bad}), f"must be 2 or 3, got {shown}")
    fails(lambda: SpatialScene.from_dict({"dimension": 2}), "dimension must be 3, got 2")
    for name in ("fish_3d", "paper_i"):
        for new in (2, 3):
            fails(
                lambda name=name, new=new: load_scene(name).replace("dimension", new),
                "dimension cannot be changed",
            )
            fails(lambda name=name, new=new: load_scene(name, [f"dimension={new}"]), "cannot be")


def test_changes_reach_the_fields_of_the_section():
    scene = load_scene("helix_3d")
    thin = scene.replace({"beam.section.half_width": 0.01, "beam.section.profile": "uniform"})
    assert thin.beam.section == Section("uniform", 0.01, 0.05)
    assert load_scene("helix_3d", ["beam.section.half_width=0.01"]).beam.section.half_width == 0.01
    mixed = scene.replace({"beam": SpatialBeam(elements=3), "beam.section.half_width": 0.01})
    assert mixed.beam == SpatialBeam(elements=3, section=Section("uniform", 0.01, 0.05))
    fails(lambda: scene.replace("beam.section.width", 1), "nearest: beam.section.half_width")
    fails(
        lambda: scene.replace({"beam.section": 5, "beam.section.profile": "fish"}),
        "section must be a mapping of fields, got 5",
    )


def test_a_matrix_needs_no_density_of_the_fluid():
    matrix = np.eye(54).tolist()
    fluid = {"model": "given", "matrix": matrix}
    scene = Scene.from_dict({"dimension": 3, "beam": {"density": 500.0}, "fluid": fluid})
    assert scene.fluid.density is None
    assert Scene.from_dict(scene.to_dict()) == scene
    assert Simulator(scene).velocity().shape == (30,)
    fails(lambda: Scene.from_dict({"dimension": 3, "fluid": fluid}), "beam.density is missing")


def test_model_none_drops_the_density_which_the_body_then_needs():
    scene = load_scene("fish_3d")
    fails(
        lambda: scene.replace("fluid.model", "none"), "beam.density is missing", "without a fluid"
    )
    dry = scene.replace({"fluid.model": "none", "beam.density": 1000.0})
    assert dry.fluid == SpatialFluid("none") and not dry.has_fluid
    np.testing.assert_array_equal(dry.inertia_per_length(), scene.inertia_per_length())


def test_a_file_has_the_defaults_of_the_classes(tmp_path):
    """But for what follows from the body, see test_bodies_3d.py."""
    path = tmp_path / "rod.yaml"
    path.write_text(
        "dimension: 3\nfluid: {model: strip, density: 1e3}\nactuation: {amplitude: 0}\n"
        "integrator: {time_step: 0.01}\nepisode: {control_interval: 0.02, duration: 20}\n"
    )
    scene = load_scene(path)
    assert scene.name == "rod"
    assert (scene.integrator, scene.episode) == (Integrator(), SpatialEpisode())
    assert (scene.axes, scene.torque_limit) == (("yaw",), (1.0,))
    passive = scene.replace({"actuation": None, "beam.dorsoventral_stiffness": 0.0})
    assert passive.torque_limit == pytest.approx((0.2 * 5.0,)), "0.2 EI/l of yaw"
    assert passive.effects == ("bending_stiffness",)
    assert scene.replace("stream.velocity", ZERO).effects == ("bending_stiffness", "stream")


# ---- section and inertia -----------------------------------------------------------------------


def test_a_uniform_body_has_the_area_integrals_of_an_ellipse():
    b, a, rho = 0.03, 0.08, 1100.0
    beam = SpatialBeam(length=2.0, section=Section("uniform", b, a))
    area, around_d2, around_d1 = math.pi * a * b, math.pi * a * b**3 / 4, math.pi * a**3 * b / 4
    expected = np.tile([rho * area, rho * around_d2, rho * around_d1], (9, 1))
    np.testing.assert_allclose(beam.inertia_per_length(rho), expected, rtol=1e-14)


def test_an_ellipsoid_has_its_volume_and_moments():
    """The integrals of (1 - x^2) and its square over -1 to 1 are 4/3 and 16/15."""
    b, a, length = 0.03, 0.08, 2.0
    beam = SpatialBeam(length=length, elements=7, section=Section("ellipsoid", b, a))
    whole = beam.inertia_per_length(1.0).sum(axis=0) * beam.element_length
    quarter = math.pi * a * b / 4 * 16 / 15 * length / 2
    expected = [4 / 3 * math.pi * a * b * length / 2, quarter * b**2, quarter * a**2]
    np.testing.assert_allclose(whole, expected, rtol=1e-13)
    s = np.array([0.0, 0.5, 1.0, 2.0])
    np.testing.assert_allclose(beam.half_width_at(s), b * np.sqrt([0, 0.75, 1, 0]), atol=1e-17)
    np.testing.assert_allclose(beam.half_height_at(s), a * np.sqrt([0, 0.75, 1, 0]), atol=1e-17)
    assert beam.half_width_at(1.0) == b


def test_a_fish_goes_through_its_table_and_not_beyond_it():
    scene = load_scene("fish_3d", ["beam.length=2"])
    table = np.array(scene.beam.section.table)
    np.testing.assert_allclose(scene.beam.half_width_at(2 * table[:, 0]), table[:, 1], atol=1e-17)
    np.testing.assert_allclose(scene.beam.half_height_at(2 * table[:, 0]), table[:, 2], atol=1e-17)
    for width, column in ((scene.beam.half_width_at, 1), (scene.beam.half_height_at, 2)):
        for left, right in zip(table, table[1:], strict=False):
            between = width(np.linspace(2 * left[0], 2 * right[0], 30))
            steps = np.diff(between) * np.sign(right[column] - left[column])
            assert (steps >= -1e-15).all(), "monotone between rows"


def test_means_are_those_of_eight_gauss_points_and_overrides_replace_them():
    scene = load_scene("fish_3d")
    s, weights = scene.beam.gauss_points()
    assert s.shape == (9, 8) and weights.sum() == pytest.approx(1.0, rel=1e-15)
    # They integrate polynomials of degree 15 exactly.
    dl = scene.beam.element_length
    np.testing.assert_allclose(s**15 @ weights * dl, np.diff((np.arange(10) * dl) ** 16) / 16)
    area = math.pi * scene.beam.half_width_at(s) * scene.beam.half_height_at(s)
    np.testing.assert_allclose(scene.inertia_per_length()[:, 0], 1000.0 * area @ weights)
    heavy = scene.replace({"beam.density": 2000.0, "beam.rotary_inertia_2": 7.0})
    ratio = heavy.inertia_per_length() / scene.inertia_per_length()
    np.testing.assert_allclose(ratio[:, :2], 2.0)
    assert heavy.inertia_per_length()[:, 2].tolist() == [7.0] * 9
    # With all three the density does not matter.
    own = {"beam.line_density": 1.0, "beam.rotary_inertia_1": 2.0, "beam.rotary_inertia_2": 3.0}
    dry = scene.replace({"fluid": None, **own})
    assert dry.inertia_per_length().tolist() == [[1.0, 2.0, 3.0]] * 9
    fails(lambda: dry.replace("beam.line_density", None), "beam.density is missing")


# ---- stiffness ---------------------------------------------------------------------------------


def test_stiffness_laws_are_those_of_the_plane_in_the_order_pitch_yaw_roll():
    pieces = {"pieces": [{"until": 0.5, "value": 50}, {"until": 1.0, "value": 5}]}
    linear = {"linear": {"head": 11, "tail": 2}}
    beam = SpatialBeam(
        elements=4,
        lateral_stiffness=pieces,
        dorsoventral_stiffness=linear,
        torsional_stiffness=[1, 2, 3],
    )
    expected = [
        Beam(elements=4, bending_stiffness=law).stiffness_at_joints()
        for law in (linear, pieces, [1, 2, 3])
    ]
    np.testing.assert_array_equal(beam.stiffness_at_joints(), np.transpose(expected))
    limp = SpatialBeam(
        lateral_stiffness=None, dorsoventral_stiffness=0, torsional_stiffness=0, density=1.0
    )
    assert SpatialScene(beam=limp).effects == ()


# ---- actuation ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wave", "hand"),
    [("planar", 0), ("dorsoventral", None), ("helical_right", 1), ("helical_left", -1)],
)
def test_waves_have_their_values_at_every_joint(wave, hand):
    beam = SpatialBeam(length=3.0, elements=5)
    drive = SpatialActuation(
        2.0, 5.0, 7.0, phase=0.3, axes=("roll", "pitch", "yaw"), wave=wave, end_time=0.5
    )
    times = np.array([0.0, 0.1, 0.49, 0.5])
    torques = drive.torques(times, beam)
    assert torques.shape == (4, 4, 3) and torques.dtype == np.float64
    for t, instant in zip(times[:3], torques, strict=False):
        for j, torque in enumerate(instant, start=1):
            angle = 5.0 * t - 7.0 * (j * beam.element_length) / beam.length + 0.3
            expected = [2.0 * math.cos(angle), 0.0, 0.0]
            if hand is not None:
                expected = [hand * 2.0 * math.sin(angle), 2.0 * math.cos(angle), 0.0]
            assert torque == pytest.approx(expected, rel=1e-13, abs=1e-14)
    assert not torques[3].any()
    assert drive.torques(0.1, beam).shape == (1, 4, 3)
    front = SpatialActuation(2.0, axes=("pitch", "yaw"), wave=wave, active_until=0.4)
    assert front.torques([0.0], beam)[0].any(axis=1).tolist() == [True, True, False, False]


def test_the_pitch_of_a_helical_wave_may_have_its_own_amplitude():
    round_one = SpatialActuation(2.0, axes=("pitch", "yaw"), wave="helical_left")
    flat = dataclasses.replace(round_one, pitch_amplitude=5.0)
    one, other = (wave.torques([0.0, 0.3], SpatialBeam()) for wave in (round_one, flat))
    np.testing.assert_allclose(other, one * [2.5, 1.0, 1.0], rtol=1e-15)


def test_the_torques_of_a_right_handed_wave_lie_on_a_right_handed_helix():
    """Along the body they turn about +d3, the more so the farther back."""
    drive = SpatialActuation(1.0, wave_number=1.0, axes=("pitch", "yaw"), wave="helical_right")
    torques = drive.torques([0.0], SpatialBeam())[0]
    assert (np.cross(torques[:-1], torques[1:])[:, 2] > 0.0).all()


# ---- bad values --------------------------------------------------------------------------------

RANGE = "0 to 1"
UNUSED = "has no meaning with"
#: A field of helix_3d, a value that it cannot have, and what is said of it.
BAD = [
    ("beam.length", 0, "must be above 0 m, got 0"),
    ("beam.elements", 1, "must be at least 2, got 1"),
    ("beam.elements", 1001, "must be at most 1000, got 1001"),
    ("beam.section", 3, "beam.section must be a mapping of fields, got 3"),
    ("beam.section", {"profile": "uniform"}, "uniform needs beam.section.half_width, a number"),
    ("beam.section", {"profile": "fish"}, "fish needs beam.section.table, a list of rows"),
    ("beam.section", {"width": 1}, "unknown field beam.section.width (nearest: half_width)"),
    ("beam.section.profile", "round", "must be one of uniform, ellipsoid, fish, got 'round'"),
    ("beam.section.profile", "fish", "fish needs beam.section.table"),
    ("beam.section.half_width", 0.0, "must be above 0 m, got 0.0"),
    ("beam.section.half_width", None, "ellipsoid needs beam.section.half_width, a number above 0"),
    ("beam.section.half_height", -1.0, "must be above 0 m, got -1.0"),
    ("beam.section.half_height", "tall", "must be a number in m, got text 'tall'"),
    ("beam.section.table", TABLE, f"{UNUSED} beam.section.profile ellipsoid, only with fish"),
    ("beam.density", 0.0, "must be above 0 kg/m^3, got 0.0"),
    ("beam.line_density", 0.0, "must be above 0 kg/m, got 0.0"),
    ("beam.rotary_inertia_1", 0.0, "must be above 0 kg m, got 0.0"),
    ("beam.rotary_inertia_2", math.nan, "must be a finite number in kg m, got nan"),
    ("beam.lateral_stiffness", -1.0, "must be at least 0 N m^2, got -1.0"),
    ("beam.lateral_stiffness", [1.0], "must list one value per joint, 8 for beam.elements = 9"),
    ("beam.dorsoventral_stiffness", "x", "a list of them, pieces or linear, got text 'x'"),
    ("beam.dorsoventral_stiffness", {"linear": {"head": 1}}, "stiffness.linear.tail is missing"),
    ("beam.dorsoventral_stiffness", {"linear": {"head": 1, "tail": -1}}, "ss.linear.tail must be"),
    ("beam.torsional_stiffness", {}, "must have either pieces or linear, got 0"),
    (
        "beam.torsional_stiffness",
        {"pieces": [{"until": 1.0, "value": "x"}]},
        "beam.torsional_stiffness.pieces[0].value must be a number in N m^2",
    ),
    (
        "beam.torsional_stiffness",
        {"pieces": [{"until": 0.9, "value": 1}]},
        "ss.pieces[0].until must",
    ),
    ("beam.natural_curvature", 1.0, "must be three numbers [pitch, yaw, roll] in 1/m, got 1.0"),
    ("beam.natural_curvature", [1.0, 2.0], "must be three numbers"),
    ("beam.natural_curvature", [ZERO] * 7, "must list one value per joint, 8, got 7"),
    (
        "beam.natural_curvature",
        [ZERO] * 7 + [(0, 0, "x")],
        "natural_curvature[7][2] must be a number",
    ),
    ("fluid.model", "expansion", "must be one of none, strip, frozen, panels, given"),
    ("fluid.density", None, "strip needs fluid.density"),
    ("fluid.rows", 0, "must be at least 1, got 0"),
    ("fluid.around", 0, "must be at least 4, got 0"),
    ("fluid.around", 10, "must be a multiple of 4"),
    ("fluid.self_term", "bare", "must be one of gauss, flat, got 'bare'"),
    ("fluid.self_term", "flat", f"{UNUSED} fluid.model strip, only with frozen or panels"),
    ("fluid.rings", "round", "must be one of area_true, inscribed"),
    ("fluid.rings", "inscribed", f"{UNUSED} fluid.model strip, only with frozen or panels"),
    ("fluid.matrix", [[1.0]], f"{UNUSED} fluid.model strip, only with given"),
    ("fluid.matrix", [], "must be a list of 6N rows of 6N numbers, got a list of 0"),
    ("fluid.matrix", 1.0, "must be a list of 6N rows of 6N numbers, got 1.0"),
    ("fluid.matrix", [[1.0, 2.0]], "must be square, 1 numbers in each of its rows, got 2"),
    ("fluid.matrix", [[1.0, 2.0], [2.1, 1.0]], "symmetric, got 2.0 in fluid.matrix[0][1] and 2.1"),
    ("fluid.matrix", [[math.inf]], "fluid.matrix[0][0] must be a finite number"),
    ("damping.retardation_time", 0.0, "must be above 0 s, got 0.0"),
    ("damping.retardation_time", [1.0, 1.0], "must be three numbers [pitch, yaw, roll] in s"),
    ("damping.retardation_time", [1.0, 1.0, -1.0], "retardation_time[2] must be at least 0 s"),
    ("damping.retardation_time", [0.0] * 3, "must be above 0 s for one axis at least"),
    ("actuation.amplitude", None, "must be a number in N m, got null"),
    ("actuation.axes", [], "must be a list of some of pitch, yaw, roll, got a list of 0"),
    ("actuation.axes", "yaw", "must be a list of some of pitch, yaw, roll, got text 'yaw'"),
    ("actuation.axes", ["yaw", "jaw"], "axes[1] must be one of pitch, yaw, roll, got 'jaw'"),
    ("actuation.axes", ["yaw", "pitch", "yaw"], "every axis at most once, got yaw twice"),
    ("actuation.axes", ["yaw"], "helical_right needs pitch and yaw among actuation.axes"),
    ("actuation.wave", "helical", "must be one of planar, dorsoventral, helical_right, helical_l"),
    ("actuation.pitch_amplitude", "x", "must be a number in N m, got text 'x'"),
    ("actuation.torque_limit", 0.0, "must be above 0 N m, got 0.0"),
    ("actuation.torque_limit", [1.0, 0.0], "torque_limit[1] must be above 0 N m, got 0.0"),
    ("actuation.torque_limit", [1.0] * 3, "one for each of actuation.axes, 2, got 3"),
    ("actuation.active_until", 0.0, "must be above 0, got 0.0"),
    ("actuation.end_time", -1.0, "must be at least 0 s, got -1.0"),
    ("initial.velocity", [1.0, 2.0], "must be three numbers [x, y, z] in m/s, got a list of 2"),
    ("initial.velocity", [ZERO] * 9, "must be three numbers [x, y, z] in m/s, got a list of 9"),
    ("initial.spin", 1.0, "must be three numbers [x, y, z] in rad/s, got 1.0"),
    ("initial.spin", [0.0, 0.0, None], "initial.spin[2] must be a number in rad/s, got null"),
    ("initial.joint_rotations", 0.1, "must be three numbers [pitch, yaw, roll] in rad, got 0.1"),
    ("initial.joint_rotations", [ZERO] * 9, "must list one value per joint, 8, got 9"),
    ("initial.joint_rotations", [2.0, 2.0, 2.0], "less than 0.9 pi = 2.82743 rad, got one by 3.46"),
    ("initial.joint_rotations", [ZERO] * 7 + [(3, 0, 0)], "joint_rotations[7] must be a rotation"),
    ("stream", {}, "stream.velocity is missing"),
    ("stream.velocity", [1.0, 0.0], "must be three numbers [x, y, z] in m/s, got a list of 2"),
    ("stream.velocity", [0.0, 1.0, None], "velocity[2] must be a number in m/s, got null"),
    ("integrator.strain", "mean_angles", "no meaning in a scene of dimension 3, which needs"),
    ("integrator.scheme", "euler", "must be one of paper, composed, got 'euler'"),
    ("integrator.tolerance", 1e-3, "must be at most 0.0001, got 0.001"),
    ("episode.heading", [-1.0, 0.0], "must be three numbers [x, y, z], got a list of 2"),
    ("episode.heading", [1.0, 1.0, 0.0], "must be a unit vector (x, y, z)"),
    ("episode.bend_noise", -1.0, "must be at least 0 rad"),
]


@pytest.mark.parametrize(
    ("path", "value", "part"), BAD, ids=[f"{i}-{b[0]}" for i, b in enumerate(BAD)]
)
def test_a_bad_value_is_refused_with_its_field_and_its_reason(path, value, part):
    scene = load_scene("helix_3d")
    fails(lambda: scene.replace(path, value), part, path)
    fails(lambda: load_scene("helix_3d", {path: value}), part, "(configs/scenes/helix_3d.yaml with")


@pytest.mark.parametrize(
    ("rows", "part"),
    [
        (5, "must be a list of at least three rows [s/l, half width, half height], got 5"),
        ([[0, 0, 0], [1, 0, 0]], "must be a list of at least three rows"),
        ([[0, 0], [0.5, 1, 1], [1, 0, 0]], "table[0] must be three numbers [s/l, half width"),
        (
            [[0, 0.1, 0], *TABLE[1:]],
            "table[0] must be [0, 0, 0], as the widths vanish at both ends",
        ),
        ([[0.1, 0, 0], *TABLE[1:]], "table[0] must be [0, 0, 0]"),
        ([*TABLE[:2], [1, 0, 0.1]], "table[2] must be [1, 0, 0]"),
        ([*TABLE[:2], [0.9, 0, 0]], "table[2] must be [1, 0, 0]"),
        (
            [TABLE[0], TABLE[1], TABLE[1], TABLE[2]],
            "table[2][0] must be above the s/l before it, 0.4",
        ),
        ([TABLE[0], [0.4, 0, 0.1], TABLE[2]], "table[1][1] must be above 0 m, got 0"),
        ([TABLE[0], [0.4, 0.1, -0.1], TABLE[2]], "table[1][2] must be above 0 m, got -0.1"),
        ([TABLE[0], [0.4, math.nan, 0.1], TABLE[2]], "table[1][1] must be a finite number"),
    ],
)
def test_a_bad_table_of_widths_is_refused(rows, part):
    section = {"profile": "fish", "table": rows}
    fails(
        lambda: Scene.from_dict({**ROD, "beam": {"section": section}}), "beam.section.table", part
    )


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        (
            {"beam.section": {"profile": "fish", "table": TABLE, "half_width": 0.1}},
            ("beam.section.half_width has no meaning", "fish, only with uniform or ellipsoid"),
        ),
        (
            {"fluid.model": "frozen", "beam.elements": 209},
            ("at most 5000 panels, got 5016", "fluid.rows times fluid.around"),
        ),
        (
            {"fluid.model": "panels", "beam.elements": 207, "beam.section.profile": "uniform"},
            ("at most 5000 panels, got 5016",),
        ),
        ({"fluid.model": "given"}, ("fluid.model given needs fluid.matrix, a list of 6N rows",)),
        (
            {"fluid.model": "given", "fluid.matrix": np.eye(48)},
            ("fluid.matrix must have 6N rows, 54 for beam.elements = 9, got 48",),
        ),
        (
            {"damping.retardation_time": [0.1, 0.1, 0.0], **{
                f"beam.{name}_stiffness": 0.0 for name in ("lateral", "dorsoventral")
            }},
            ("damping has no meaning", "leave damping out"),
        ),
        (
            {"actuation.wave": "planar", "actuation.axes": ["pitch"]},
            ("planar needs yaw among actuation.axes, or an amplitude of 0, got pitch",),
        ),
        ({"fluid": None}, ("beam.density is missing", "beam.rotary_inertia_1")),
        (
            {"fluid": None, "beam.density": 1.0, "stream.velocity": ZERO},
            ("stream has no meaning without a fluid; leave it out or give the scene a fluid",),
        ),
        (
            {"fluid.model": "none", "beam.density": 1.0, "stream.velocity": ZERO},
            ("stream has no meaning without a fluid",),
        ),
    ],
)  # fmt: skip
def test_fields_that_do_not_fit_together_are_refused(changes, parts):
    fails(lambda: load_scene("helix_3d").replace(changes), *parts)


def test_what_is_at_its_limit_is_allowed():
    scene = load_scene("helix_3d")
    for model in ("frozen", "panels"):
        assert scene.replace({"fluid.model": model, "beam.elements": 208}).beam.elements == 208
    scene.replace({"beam.elements": 1000, "fluid.around": 8})
    scene.replace("initial.joint_rotations", [2.827, 0.0, 0.0])
    idle = scene.replace({"actuation.amplitude": 0.0, "actuation.axes": ["roll"]})
    assert idle.axes == ("roll",)
    # Environments need no prescribed torque.
    limits = {"axes": ["roll", "yaw"], "torque_limit": [1, 2], "active_until": 0.5}
    assert scene.replace("actuation", limits).actuation.amplitude == 0.0
    assert load_scene({**scene.to_dict(), "actuation": limits}).torque_limit == (1.0, 2.0)


# ---- the other dimension -----------------------------------------------------------------------

PLANAR_ONLY = {
    "axial_added_mass": {},
    "cross_flow_drag": {},
    "self_contact": {},
    "internal_forces": {},
    "beam.half_thickness": 0.1,
    "beam.bending_stiffness": 1.0,
    "beam.rotary_inertia": 1.0,
    "fluid.panels_per_element": 4,
    "fluid.cap_panels": 1,
    "fluid.added_mass_per_length": 1.0,
    "fluid.variant": "consistent",
    "initial.position": [0, 0],
    "initial.heading": 0.1,
    "initial.joint_angles": 0.1,
    "initial.velocity_slope": 0.1,
    "initial.turning_rate": 0.1,
}
SPATIAL_ONLY = {
    "beam.section": {"profile": "uniform"},
    "beam.section.half_width": 0.1,
    "beam.density": 1.0,
    "beam.rotary_inertia_1": 1.0,
    "beam.lateral_stiffness": 1.0,
    "beam.torsional_stiffness": 1.0,
    "beam.natural_curvature": ZERO,
    "fluid.rows": 2,
    "fluid.around": 12,
    "fluid.matrix": None,
    "actuation.axes": ["yaw"],
    "actuation.wave": "planar",
    "initial.spin": ZERO,
    "initial.joint_rotations": ZERO,
}


@pytest.mark.parametrize(
    ("name", "path", "value", "other"),
    [
        *(("helix_3d", path, value, 2) for path, value in PLANAR_ONLY.items()),
        *(("paper_i", path, value, 3) for path, value in SPATIAL_ONLY.items()),
    ],
)
def test_a_field_of_the_other_dimension_is_refused_by_name(name, path, value, other):
    said = f"in a scene of dimension {5 - other}, only in one of dimension {other}"
    scene = load_scene(name)
    fails(lambda: scene.replace(path, value), f"{path} has no meaning {said}")
    fails(lambda: load_scene(name, {path: value}), f"{path} has no meaning {said}")
    block, _, field = path.partition(".")
    data = scene.to_dict()
    if field and "." not in field:
        value = {**data[block], field: value}
    if "." not in field:
        fails(lambda: Scene.from_dict({**data, block: value}), f"{path} has no meaning {said}")


def test_a_scene_made_by_hand_takes_blocks_of_its_dimension_only():
    spatial = {
        "beam": SpatialBeam(),
        "fluid": SpatialFluid("none"),
        "damping": SpatialDamping(0.1),
        "stream": SpatialStream((1, 0, 0)),
        "actuation": SpatialActuation(1.0),
        "initial": SpatialInitial(),
        "episode": SpatialEpisode(),
    }
    drive = Damping(0.1), Stream((1, 0)), Actuation(1.0)
    planar = (Beam(), Fluid("none"), *drive, Initial(), Episode())
    for (name, block), other in zip(spatial.items(), planar, strict=True):
        kinds = type(block).__name__, type(other).__name__
        said = "{} must be of type {}, got {}"
        fails(lambda name=name, one=block: Scene(**{name: one}), said.format(name, *kinds[::-1]))
        fails(lambda name=name, one=other: SpatialScene(**{name: one}), said.format(name, *kinds))
    fails(
        lambda: SpatialScene(cross_flow_drag=CrossFlowDrag()),
        "cross_flow_drag has no meaning in a scene of dimension",
    )


def test_a_wave_needs_its_axes_and_only_a_helical_one_has_two_amplitudes():
    fish = {"actuation.axes": ["yaw"], "actuation.torque_limit": 6.0}
    scene = load_scene("fish_3d", fish)
    said = "actuation.wave dorsoventral needs pitch among actuation.axes, or an amplitude of 0"
    fails(lambda: scene.replace("actuation.wave", "dorsoventral"), said)
    assert scene.replace({"actuation.wave": "dorsoventral", "actuation.amplitude": 0.0})
    said = "actuation.pitch_amplitude has no meaning with actuation.wave planar"
    fails(lambda: scene.replace("actuation.pitch_amplitude", 1.0), said, "got 1.0")


@pytest.mark.parametrize(
    "call",
    [
        BodyFlow,
        lambda scene: scene.for_accuracy(0.1),
        lambda scene: reference_of(scene, 1.0, FINE),
    ],
)
def test_what_only_works_in_the_plane_says_so_at_its_entrance(call):
    said = "needs a scene of dimension 2, got eel_3d of dimension 3"
    fails(lambda: call(load_scene("eel_3d")), said)
