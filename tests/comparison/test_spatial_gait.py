"""Gaits in space: fields of rotations whose axes, planes, hands and roll are known."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from swim_agents import load_policy, play_episode
from swim_agents.comparison.gait import analyse_gait
from swim_agents.comparison.performance import measure_gait
from swim_agents.comparison.spatial_gait import (
    SpatialGait,
    analyse_spatial_gait,
    bending_ellipse,
    helicity,
    plane_angle,
)

from swim_env import OptionError, SwimEnv, load_scene
from swim_env.physics.spatial.invariants import centres_of
from swim_env.scene import SpatialActuation
from tests.support import refuses

Array = NDArray[np.float64]

INTERVAL, COUNT = 0.02, 400
TIMES = INTERVAL * np.arange(COUNT)
#: Joints of a body of ten elements.
JOINTS = np.arange(1, 10) / 10.0
#: Ten whole periods in the record (rad/s), one wave and a bit on the body (rad per body length).
F, KAPPA = 2.0 * math.pi * 10.0 / (COUNT * INTERVAL), 7.0
STILL = np.broadcast_to(np.eye(3), (COUNT, 3, 3))
NOTHING = np.zeros((COUNT, len(JOINTS), 3))


def field(pitch: Any = 0.0, yaw: Any = 0.0, roll: Any = 0.0) -> Array:
    """Return rotations (T, J, 3) of parts that are functions of time and place, or numbers."""
    return np.stack([np.broadcast_to(part, NOTHING.shape[:2]) for part in (pitch, yaw, roll)], -1)


def angle_of(kappa: float = KAPPA) -> Array:
    return F * TIMES[:, None] - kappa * JOINTS


def measured(
    rotations: Array, torques: Array = NOTHING, frames: Array = STILL, speed: float = 0.0
) -> SpatialGait:
    return analyse_spatial_gait(TIMES, rotations, torques, JOINTS, frames, speed)


# ---- hands and planes --------------------------------------------------------------------------


@pytest.mark.parametrize("hand", [1, -1])
@pytest.mark.parametrize("kappa", [KAPPA, -KAPPA, 2.0])
def test_a_helix_has_the_hand_of_the_wave_that_makes_it(hand, kappa):
    # The whirl is that of the wave wherever it runs, the helix has the other hand if it runs
    # headwards. What stays bent does not count.
    phi = angle_of(kappa)
    gait = measured(field(0.2 * hand * np.sin(phi) + 0.3, 0.2 * np.cos(phi) - 0.1))
    assert gait.handedness == pytest.approx(hand * np.sign(kappa), abs=1e-9)
    for one in (gait.body, *gait.joints):
        assert (one.major, one.minor) == pytest.approx((0.2, 0.2), rel=1e-9)
        assert (one.whirl, one.ratio) == pytest.approx((hand, 1.0), abs=1e-9)
    assert gait.frequency == pytest.approx(F / (2.0 * math.pi), rel=1e-3)
    for about in (gait.yaw, gait.pitch):
        assert about is not None
        # As near as the frequency is found.
        assert about.wave_number == pytest.approx(kappa, rel=1e-5)
        assert about.frequency == pytest.approx(gait.frequency, rel=1e-3)
    assert (gait.roll, gait.torsion, gait.roll_rms) == (None, 0.0, 0.0)


@pytest.mark.parametrize("wave, hand", [("helical_right", 1.0), ("helical_left", -1.0)])
def test_the_hand_is_that_of_the_centre_line_and_of_the_actuation(wave, hand):
    """The centre line's own torsion (Frenet) has the sign of the handedness."""
    scene = load_scene("eel_3d", ["beam.elements=40"])
    beam, places = scene.beam, scene.beam.joint_fractions
    actuation = SpatialActuation(
        amplitude=0.1, frequency=F, wave_number=KAPPA, axes=("pitch", "yaw"), wave=wave
    )
    rotations = actuation.torques(TIMES, beam)
    frames = np.broadcast_to(np.eye(3), (COUNT, 3, 3))
    gait = analyse_spatial_gait(TIMES, rotations, rotations, places, frames, 0.0)
    assert gait.handedness == pytest.approx(hand, abs=1e-9)
    assert gait.body.whirl == pytest.approx(hand, abs=1e-9)
    directors = [np.eye(3)]
    for turn in Rotation.from_rotvec(rotations[7]).as_matrix():
        directors.append(directors[-1] @ turn)
    line = centres_of(np.zeros(3), np.array(directors), beam.element_length)
    first, second, third = (np.diff(line, n, axis=0)[:37] for n in (1, 2, 3))
    torsion = np.einsum("ki,ki->k", np.cross(first, second), third)
    assert (np.sign(torsion) == hand).all()
    # The wave of torque is found again, about both axes.
    for about in (gait.pitch, gait.yaw):
        assert about.wave.amplitude == pytest.approx(0.1, rel=1e-6)
        assert about.wave.wave_number == pytest.approx(KAPPA, rel=1e-6)


@pytest.mark.parametrize("tilt", [0.0, 0.4, -1.1, 0.5 * math.pi])
@pytest.mark.parametrize("kind", ["standing", "travelling"])
def test_a_wave_in_a_tilted_plane_has_its_angle_and_no_hand(tilt, kind):
    phi = angle_of()
    bend = 0.3 * (np.cos(phi) if kind == "travelling" else np.cos(F * TIMES)[:, None] + 0 * phi)
    gait = measured(field(math.sin(tilt) * bend, math.cos(tilt) * bend))
    for one in (gait.body, *gait.joints):
        assert one.major == pytest.approx(0.3, rel=1e-9)
        assert one.ratio < 1e-6
        assert abs(one.whirl) < 1e-12
        assert math.sin(one.angle - tilt) == pytest.approx(0.0, abs=1e-9)
        assert -0.5 * math.pi < one.angle <= 0.5 * math.pi
    assert abs(gait.handedness) < 1e-12
    assert gait.yaw_rms == pytest.approx(0.3 * math.sqrt(0.5) * abs(math.cos(tilt)), abs=1e-12)
    assert gait.pitch_rms == pytest.approx(0.3 * math.sqrt(0.5) * abs(math.sin(tilt)), abs=1e-12)
    lateral = gait.yaw if abs(math.cos(tilt)) > 0.1 else gait.pitch
    share = lateral.travelling_share
    assert share < 1e-6 if kind == "standing" else share > 0.5
    assert (gait.yaw is None) == (abs(math.cos(tilt)) < 0.01)
    assert (gait.pitch is None) == (abs(math.sin(tilt)) < 0.01)


def test_planes_that_turn_along_the_body_are_wide_together_and_have_a_hand():
    tilt = 3.0 * JOINTS
    bend = 0.2 * np.cos(F * TIMES)[:, None]
    gait = measured(field(np.sin(tilt) * bend, np.cos(tilt) * bend))
    for one, angle in zip(gait.joints, tilt, strict=True):
        assert one.ratio < 1e-6
        assert math.sin(one.angle - angle) == pytest.approx(0.0, abs=1e-9)
    assert gait.body.ratio > 0.5
    assert abs(gait.body.whirl) < 1e-12
    # From yaw to pitch along the body: the curved side, conj(z), turns about -d3.
    assert gait.handedness == pytest.approx(-1.0, abs=1e-9)


@pytest.mark.parametrize("a, b", [(0.3, 0.1), (0.1, 0.3), (0.2, -0.15)])
@pytest.mark.parametrize("tilt", [0.0, 0.7])
def test_an_ellipse_has_its_axes_and_the_helicity_of_its_shape(a, b, tilt):
    phi = 2.0 * math.pi * np.arange(200) / 200.0
    z = (np.exp(1j * tilt) * (a * np.cos(phi) + 1j * b * np.sin(phi)))[:, None]
    found = bending_ellipse(z)
    assert (found.major, found.minor) == pytest.approx((max(abs(a), abs(b)), min(abs(a), abs(b))))
    along = tilt if abs(a) > abs(b) else tilt + 0.5 * math.pi
    assert math.sin(found.angle - along) == pytest.approx(0.0, abs=1e-9)
    # All but the step from the last to the first.
    assert found.whirl == pytest.approx(2.0 * a * b / (a**2 + b**2), rel=5e-3)
    closed = np.concatenate([z, z[:1]])
    assert helicity(closed) == pytest.approx(2.0 * a * b / (a**2 + b**2), rel=1e-9)
    assert helicity(closed.conj()) == pytest.approx(-helicity(closed), rel=1e-12)
    assert helicity(closed[::-1]) == pytest.approx(-helicity(closed), rel=1e-12)


def test_half_arguments_are_those_of_planes():
    assert plane_angle(complex(-1.0, -0.0)) == plane_angle(complex(-1.0, 0.0)) == 0.5 * math.pi
    assert plane_angle(0j) == 0.0
    for angle in (-1.5, -0.3, 0.0, 1.5):
        assert plane_angle(np.exp(2j * angle)) == pytest.approx(angle, abs=1e-15)


# ---- torsion, roll, speed ----------------------------------------------------------------------


def test_pure_torsion_bends_in_no_plane():
    twist = 0.05 * np.sin(angle_of(3.0))
    gait = measured(field(roll=twist))
    assert gait.roll_rms == pytest.approx(0.05 * math.sqrt(0.5), rel=1e-3)
    # Ten elements to the body length.
    assert gait.torsion == pytest.approx(10.0 * gait.roll_rms, rel=1e-12)
    assert gait.roll.wave_number == pytest.approx(3.0, rel=1e-5)
    assert (gait.yaw, gait.pitch, gait.frequency, gait.handedness) == (None, None, 0.0, 0.0)
    assert (gait.body.major, gait.body.ratio, gait.body.whirl) == (0.0, 0.0, 0.0)


def test_the_roll_rate_is_about_the_bodys_own_axis_wherever_it_points():
    bend = field(yaw=0.1 * np.cos(angle_of()))
    rate, swing = 1.7, 0.4
    rolled = rate * TIMES + swing / F * np.sin(F * TIMES)
    roll = Rotation.from_rotvec(rolled[:, None] * [0.0, 0.0, 1.0])
    for start in Rotation.from_rotvec([[0.0, 0.0, 0.0], [1.0, -2.0, 0.5], [0.0, 1.57, 0.0]]):
        gait = measured(bend, frames=(start * roll).as_matrix())
        assert gait.roll_rate == pytest.approx(rate, rel=1e-3)
        assert gait.roll_swing == pytest.approx(swing * math.sqrt(0.5), rel=1e-2)
    # Turning sideways is no roll.
    turned = Rotation.from_rotvec(rolled[:, None] * [1.0, 0.0, 0.0])
    assert measured(bend, frames=turned.as_matrix()).roll_rate == pytest.approx(0.0, abs=1e-12)


def test_an_axis_has_the_gait_that_the_plane_finds():
    phi, slow = angle_of(), angle_of(2.0)
    torques = field(2.0 * np.cos(slow), np.cos(phi), 0.5 * np.sin(phi))
    rotations = field(0.1 * np.sin(slow), 0.2 * np.cos(phi), 1e-4 * np.cos(phi))
    gait = measured(rotations, torques)
    for axis, name in enumerate(("pitch", "yaw")):
        own = analyse_gait(TIMES, rotations[..., axis], torques[..., axis], JOINTS)
        assert getattr(gait, name) == own
    assert gait.roll is None  # 1e-4 of it is nothing beside 0.2
    data = gait.to_dict()
    assert data["yaw"] == gait.yaw.to_dict() and data["roll"] is None
    assert data["joints"][3]["angle"] == gait.joints[3].angle
    assert data["body"].keys() == {"major", "minor", "ratio", "angle", "whirl"}


@pytest.mark.parametrize(
    "change, text",
    [
        ({"rotations": NOTHING[..., :2]}, "rotations must have shape (400, 9, 3), got (400, 9, 2)"),
        ({"torques": NOTHING[1:]}, "torques must have shape (400, 9, 3), got (399, 9, 3)"),
        ({"frames": STILL[..., :2]}, "frames must have shape (400, 3, 3), got (400, 3, 2)"),
        ({"frames": STILL * math.nan}, "rotations, torques and frames must be finite"),
        ({"times": TIMES**2}, "times must be equidistant"),
    ],
)
def test_what_does_not_fit_is_refused(change, text):
    given = {"times": TIMES, "rotations": NOTHING, "torques": NOTHING, "frames": STILL, **change}
    with refuses(OptionError, text):
        analyse_spatial_gait(places=JOINTS, forward_speed=0.0, **given)


# ---- of an episode -----------------------------------------------------------------------------


def test_the_gait_of_an_episode_is_that_of_what_was_recorded():
    scene = load_scene("eel_3d", {"episode.duration": 2.0, "stream.velocity": [0.02, 0.01, 0.0]})
    rollout = play_episode(SwimEnv(scene), load_policy("paper_wave", scene), seed=1)
    run = rollout.simulate()
    gait = measure_gait(rollout, run)
    assert isinstance(gait, SpatialGait)
    hold, first = scene.steps_per_action, 25
    rotations = run.joint_rotations[first * hold : 100 * hold : hold]
    assert gait.yaw_rms == pytest.approx(np.sqrt((rotations[..., 1] ** 2).mean()), rel=1e-12)
    assert gait.yaw is not None and gait.pitch is gait.roll is None
    assert gait.yaw.wave.wave_number == pytest.approx(scene.actuation.wave_number, rel=0.02)
    assert gait.frequency == pytest.approx(1.5, abs=0.1)
    # It hardly turns, so the head's direction is -x: its way less that of the stream.
    way = run.path[99 * hold] - run.path[first * hold]
    drift = 74 * scene.episode.control_interval * 0.02
    speed = (drift - way[0]) / (74 * scene.episode.control_interval)
    assert gait.forward_speed == pytest.approx(speed, rel=0.05)
    assert speed > 0.01


def test_nothing_that_moves_has_no_gait():
    scene = load_scene("eel_3d", {"episode.duration": 1.0})
    env = SwimEnv(scene)
    still = play_episode(env, load_policy("zero", scene), seed=1, options={"noise": 0.0})
    assert measure_gait(still, still.simulate()) is None
