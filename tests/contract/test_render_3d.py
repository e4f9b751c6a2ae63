"""Frames of scenes in three dimensions, and clips of frames."""

import copy
import math
import pickle
import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from swim_env import OptionError, load_scene
from swim_env.analysis.body_surface import BodySurface
from swim_env.colours import BODY, GOAL
from swim_env.envs.render.clip import write_clip
from swim_env.envs.render.live import EpisodesViewer
from swim_env.envs.render.mesh import BodyMesh
from swim_env.envs.render.spatial_camera import SpatialCamera
from swim_env.envs.render.spatial_frames import SpatialFramePainter
from swim_env.physics.spatial.invariants import centres_of, directors_of

Array = NDArray[np.float64]
Frame = NDArray[np.uint8]

FISH, EEL, HELIX = (load_scene(name) for name in ("fish_3d", "eel_3d", "helix_3d"))
AHEAD = (-1.0, 0.0, 0.0)


def quaternion(axis: ArrayLike, angle: float) -> Array:
    """Return the rotation about a unit vector."""
    return np.array([math.cos(0.5 * angle), *(math.sin(0.5 * angle) * np.asarray(axis))])


def times(one: Array, other: Array) -> Array:
    """Return the product of two quaternions."""
    vector = one[0] * other[1:] + other[0] * one[1:] + np.cross(one[1:], other[1:])
    return np.array([one[0] * other[0] - one[1:] @ other[1:], *vector])


def pose(
    scene: Any,
    centre: ArrayLike = (0, 0, 0),
    axis: ArrayLike = AHEAD,
    angle: float = 0.0,
    bend: float = 0.0,
) -> Array:
    """Return coordinates of a body along x, turned in space and bent sideways (rad in all)."""
    first = times(quaternion(axis, angle), np.full(4, 0.5))
    joint = quaternion((0.0, 1.0, 0.0), bend / scene.joints)
    return np.concatenate([centre, first, np.tile(joint, scene.joints)])


def drawn(painter: Any, coordinates: Array, share: float = 0.0, goal: ArrayLike = AHEAD) -> Frame:
    """Return a frame; all torques of yaw have a share of their limit."""
    torques = np.zeros((painter.scene.joints, 3))
    torques[:, 1] = 1e3 * share
    shares = np.clip(painter.scene.actions_of(torques), -abs(share), abs(share))
    frame: Frame = painter.draw(coordinates, shares, 0.0, 0.0, goal)
    return frame


def colour_at(frame: Frame, pixel: Array) -> NDArray[np.int64]:
    """Return the mean colour of the 3 x 3 pixels around a place."""
    column, row = np.floor(pixel).astype(int)
    return np.rint(frame[row - 1 : row + 2, column - 1 : column + 2].mean(axis=(0, 1))).astype(int)


def is_dark(colour: NDArray[np.int64]) -> bool:
    """Whether it is the head's and the back's, in whatever light."""
    return bool((np.abs(colour - BODY) < 50).all())


def on_body(scene: Any, coordinates: Array, s: float, side: float, up: float) -> Array:
    """Return a point at s/l (m), so many half axes along d1 and d2 from the centre line."""
    directors, _ = directors_of(coordinates)
    centres = centres_of(coordinates[:3], directors, scene.beam.element_length)
    k = min(int(s * scene.beam.elements), scene.beam.elements - 1)
    place = s * scene.beam.length
    away = np.array(
        [
            side * scene.beam.half_width_at(place),
            up * scene.beam.half_height_at(place),
            place - (k + 0.5) * scene.beam.element_length,
        ]
    )
    return np.asarray(centres[k] + directors[k] @ away)


# ---- what a frame shows ------------------------------------------------------------------------


@pytest.mark.parametrize("scene", [FISH, EEL, HELIX], ids=lambda scene: scene.name)
def test_the_polygons_are_the_true_surface(scene):
    """Their corners lie on the body's sections; the areas point outwards and close."""
    mesh = BodyMesh(scene, 1.0)
    coordinates = pose(scene, bend=0.6)
    body = mesh.polygons(coordinates[3:], np.zeros(scene.action_places.size))
    directors, _ = directors_of(coordinates)
    surface = BodySurface(scene, rings=36, around=20)
    expected = surface.vertices(
        centres_of(np.zeros(3), directors, scene.beam.element_length), directors
    )
    count = len(surface.faces)
    np.testing.assert_allclose(body.corners[:count], expected[surface.faces] / scene.beam.length)
    across = body.corners[:, 2:] - body.corners[:, :2]
    areas = 0.5 * np.cross(across[:, 0], across[:, 1])
    assert np.linalg.norm(areas[:count].sum(axis=0)) < 1e-12
    outwards = (areas * body.normals).sum(axis=1)
    assert (outwards[:count] > 0.0).all()
    # The eyes stand on the surface and look to both sides.
    eyes = body.normals[count:] @ directors[0]
    assert (np.abs(eyes[:, 0]) > 0.5).all()
    assert (eyes[:, 0] > 0).sum() == (eyes[:, 0] < 0).sum() > 0
    assert (eyes[:, 1] > 0.0).all()


@pytest.mark.parametrize("size", [(640, 360), (480, 270), (1280, 720), (700, 700)])
@pytest.mark.parametrize("scene", [FISH, EEL, HELIX], ids=lambda scene: scene.name)
def test_head_and_back_are_dark_and_flanks_show_torques(scene, size):
    """So direction and roll can be seen: the camera looks at the right side, that of -d1."""
    painter = SpatialFramePainter(scene, *size)
    upright = pose(scene, (3.0, -2.0, 1.0))

    def colour(frame: Frame, coordinates: Array, *place: float) -> NDArray[np.int64]:
        return colour_at(frame, painter.pixels(on_body(scene, coordinates, *place)))

    frame = drawn(painter, upright)
    assert frame.shape == (size[1], size[0], 3)
    assert frame.dtype == np.uint8
    assert is_dark(colour(frame, upright, 0.115, -0.9, -0.3))
    assert is_dark(colour(frame, upright, 0.5, -0.3, 0.9))
    assert (colour(frame, upright, 0.5, -0.9, -0.3) > 150).all()
    assert (colour(frame, upright, 0.85, -0.9, -0.3) > 150).all()
    for share in (1.0, -1.0):
        frame = drawn(painter, upright, share)
        red, _, blue = colour(frame, upright, 0.5, -0.9, -0.3)
        assert share * (blue - red) > 60
    rolled = pose(scene, (3.0, -2.0, 1.0), AHEAD, math.pi)
    frame = drawn(painter, rolled)
    assert (colour(frame, rolled, 0.5, 0.3, -0.9) > 150).all()
    assert is_dark(colour(frame, rolled, 0.115, 0.9, 0.3))


def test_the_nearer_part_of_a_body_hides_the_other():
    """A body that points away from the eye shows its tail, and its head when it turns round."""
    painter = SpatialFramePainter(EEL)
    for turned, shows_head in ((0.5 * math.pi, True), (-0.5 * math.pi, False)):
        body = pose(EEL, axis=(0.0, 0.0, 1.0), angle=turned)
        end = on_body(EEL, body, 0.02 if shows_head else 0.98, 0.0, -0.5)
        colour = colour_at(drawn(painter, body), painter.pixels(end))
        assert is_dark(colour) == shows_head


def test_the_floor_rests_in_the_fluid_with_the_shadow_below_the_body():
    """Lines stand at multiples of half a body length while the camera moves."""
    scene = load_scene("fish_3d", {"beam.length": 2.0})
    painter = SpatialFramePainter(scene)
    for step in range(15):
        centre = np.array([0.1 * step, 0.07 * step, -0.04 * step])
        frame = painter.draw(pose(scene, centre), np.zeros(24), 0.02 * step, 0.0, AHEAD)
        (height, weight) = painter.camera.floors[-1]
        assert height % 0.5 == 0.0
        assert height < centre[2] / 2.0 - 0.29
        if weight < 0.99:
            continue
        # A line along x behind the body, and the middle between it and the next one.
        x, y = 0.5 * np.ceil(centre[:2] + (0.0, 0.2)) + (-0.25, 0.0)
        line, beside = (
            colour_at(frame, painter.pixels([2.0 * x, 2.0 * one, 2.0 * height]))
            for one in (y, y + 0.25)
        )
        assert beside[0] - line[0] > 10
        below = np.array([*centre[:2], 2.0 * height]) + (0.1, 0.0, 0.0)
        assert (beside - colour_at(frame, painter.pixels(below)) > 30).all()


def test_floors_change_as_the_body_dives():
    """There is always one below the body, near enough for its shadow to be in view."""
    middle, half, start = np.array([320.0, 178.0]), np.array([308.0, 144.0]), np.zeros(3)
    camera = SpatialCamera(middle, half, None, 1.5, 0.6, start, np.array(AHEAD), 0.0)
    seen = set()
    for step in range(400):
        centre = np.array([0.0, 0.0, math.sin(0.02 * step) - 0.005 * step])
        camera.follow(centre, np.array(AHEAD), 0.02 * step)
        heights = [height for height, _ in camera.floors]
        assert len(set(heights)) == len(heights)
        assert 0.3 <= centre[2] - heights[-1] <= 0.9
        weights = [weight for _, weight in camera.floors]
        assert min(weights) >= 0.0
        assert 0.5 < sum(weights) <= 1.0 + 1e-12
        shadow = camera.on_screen(np.array([0.0, 0.0, heights[-1]]))
        assert (np.abs(shadow - middle) < half).all()
        seen.update(heights)
    assert len(seen) >= 5


def test_a_target_is_a_ball_of_its_radius():
    """It hides what is behind it in part; far ones are named at the side where they are."""
    painter = SpatialFramePainter(FISH, target_radius=0.2)
    target = np.array([-0.9, 0.4, 0.3])
    frame = drawn(painter, pose(FISH), goal=target)
    middle = painter.pixels(target)
    assert (np.abs(colour_at(frame, middle) - GOAL) < 25).all()
    right = painter.camera.on_screen(
        target + 0.2 * np.array([math.cos(0.4538), -math.sin(0.4538), 0])
    )
    radius = float(np.hypot(*(right - middle)))
    for angle in np.linspace(0.0, 2.0 * math.pi, 8, endpoint=False):
        way = np.array([math.cos(angle), math.sin(angle)])
        inside, outside = (colour_at(frame, middle + part * radius * way) for part in (0.92, 1.12))
        assert outside[0] - inside[0] > 60
    painter.forget()
    for far in ((40.0, 3.0, 8.0), (-40.0, 3.0, 8.0), (30.0, -60.0, 0.0)):
        frame = drawn(painter, pose(FISH), goal=far)
        painter.forget()
        green = np.argwhere((frame[36:320, 12:628] == GOAL).all(axis=-1))
        assert len(green) > 20
        assert (green[:, 1] > 450).all() if far[0] > 0.0 else (green[:, 1] < 150).all()


def test_a_body_in_front_of_a_target_hides_it():
    painter = SpatialFramePainter(FISH, target_radius=0.1)
    body = pose(FISH)
    forward = np.array([0.4, 0.82, -0.41])
    behind, before = (
        colour_at(drawn(painter, body, goal=way * forward), painter.pixels(way * forward))
        for way in (0.4, -0.4)
    )
    assert (np.abs(before - GOAL) < 25).all()
    assert (np.abs(behind - GOAL) > 30).any()


@pytest.mark.parametrize(
    "goal", [AHEAD, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.0, -1.0, 0.0)]
)
def test_a_direction_is_an_arrow_at_its_side(goal):
    frame = drawn(SpatialFramePainter(HELIX), pose(HELIX), goal=goal)
    red, green, blue = np.moveaxis(frame.astype(int), -1, 0)
    places = np.argwhere((green - red > 80) & (green - blue > 20))
    assert len(places) > 150
    assert (places[:, 1] < 110).all() or (places[:, 1] > 530).all()
    if goal[0]:
        assert (places[:, 1].mean() - 320.0) * goal[0] > 0.0
    if goal[2]:
        assert (places[:, 0].mean() - 178.0) * goal[2] < 0.0


@pytest.mark.parametrize("elements", [2, 9, 40])
@pytest.mark.parametrize("radius", [None, 0.1])
def test_odd_states_are_drawn(elements, radius):
    """Any finite state gives a frame: far, wound up, folded, with time going anywhere."""
    scene = load_scene("eel_3d", {"beam.elements": elements})
    painter = SpatialFramePainter(scene, target_radius=radius)
    random = np.random.default_rng(1)
    goals = [AHEAD, (0.6, 0.0, -0.8), (0.0, 0.0, 1.0)]
    if radius:
        goals = [(1e300, -2.0, 1e9), (0.0, 1e9, 0.0), (0.1, -2.9, 1.0)]
    for centre in ((0, 0, 0), (1e5, -2e5, 1e6), (1e200, -1e308, 1e12), (-1e12, 1e12, -1e12)):
        for folded in (False, True):
            turns = random.normal(size=(elements, 4))
            if folded:
                turns[:] = (0.0, 1.0, 0.0, 0.0)
            turns /= np.linalg.norm(turns, axis=1, keepdims=True)
            state = np.concatenate([centre, turns.ravel()])
            shares = random.normal(size=2 * (elements - 1)) * 2.0
            for instant, progress, goal in zip(
                (0.0, 1e-9, 1e6), (0.0, -1e300, 1e7), goals, strict=True
            ):
                frame = painter.draw(state, shares, instant, progress, goal)
                assert frame.shape == (360, 640, 3)
    with pytest.raises(OptionError, match="at least 480 x 270 pixels, got 320 x 360"):
        SpatialFramePainter(scene, 320, 360)


# ---- frames over an episode --------------------------------------------------------------------


def episode(painter: Any, steps: int, speed: float = 0.5) -> list[Frame]:
    """Return the frames of a body that swims on a rising circle."""
    frames = []
    for step in range(steps):
        angle = 0.03 * step
        centre = speed * np.array([-math.sin(angle), 1.0 - math.cos(angle), 0.1 * angle])
        body = pose(FISH, centre, (0, 0, 1), -angle, 0.3 * math.sin(step))
        frames.append(painter.draw(body, np.full(24, math.cos(step)), 0.02 * step, 0.0, AHEAD))
    return frames


def test_the_same_episode_gives_the_same_frames():
    """Frames depend on the episode alone, and not on what was shown before `forget`."""
    painter = SpatialFramePainter(FISH)
    first = episode(painter, 40)
    kept = first[-1].copy()
    first[-1][:] = 0
    painter.forget()
    other = episode(painter, 20, speed=2.0)
    painter.forget()
    again = episode(painter, 40)
    assert not np.array_equal(other[-1], again[19])
    assert np.array_equal(kept, again[-1])
    assert all(np.array_equal(a, b) for a, b in zip(first[:-1], again, strict=False))
    # Time that goes back is a new episode as well.
    assert np.array_equal(episode(painter, 1)[0], again[0])
    # Without `forget` there is a trail.
    painter.forget()
    angle = 0.03 * 39
    centre = 0.5 * np.array([-math.sin(angle), 1.0 - math.cos(angle), 0.1 * angle])
    body = pose(FISH, centre, (0, 0, 1), -angle, 0.3 * math.sin(39))
    alone = painter.draw(body, np.full(24, math.cos(39)), 0.02 * 39, 0.0, AHEAD)
    assert not np.array_equal(alone, kept)


@pytest.mark.parametrize("size", [(640, 360), (500, 700)])
@pytest.mark.parametrize("target", [None, (2.0, 1.0, -0.7), (-0.5, -40.0, 9.0)])
def test_the_camera_keeps_the_body_in_view(size, target):
    """However it is turned, and wherever it swims at two body lengths a second."""
    radius = 0.2 if target else None
    random = np.random.default_rng(2)
    for _ in range(6):
        painter = SpatialFramePainter(FISH, *size, target_radius=radius)
        way, axis = random.normal(size=(2, 3))
        way, axis = way / np.linalg.norm(way), axis / np.linalg.norm(axis)
        for step in range(0, 120, 10):
            body = pose(FISH, 0.04 * step * way, axis, 0.05 * step, 0.8)
            painter.draw(body, np.zeros(24), 0.02 * step, 0.0, target or AHEAD)
            left, top, right, bottom = painter._plot
            ends = [on_body(FISH, body, s, 0.0, 0.0) for s in (0.0, 0.5, 1.0)]
            for column, row in painter.pixels(ends):
                assert left <= column <= right
                assert top <= row <= bottom


def stand_in(scene: Any, count: int, radius: float | None = None) -> Any:
    """Return what a viewer needs of episodes."""
    task = SimpleNamespace(scene=scene, radius=radius, goal_is_point=radius is not None)
    return SimpleNamespace(
        task=task,
        all_members=np.arange(count),
        bodies=SimpleNamespace(coordinates=np.stack([pose(scene)] * count)),
        torques=np.zeros((count, 1, scene.joints, 3)),
        goals=np.tile(AHEAD, (count, 1)),
        instant=0.0,
    )


class Viewed:
    """Episodes and their viewer, which are copied together as an environment is."""

    def __init__(self, scene: Any, count: int, radius: float | None = None) -> None:
        self.episodes = stand_in(scene, count, radius)
        self.viewer = EpisodesViewer(self.episodes, 50.0)
        self.step = 0
        self.episodes.info = self.info

    def info(self, member: int) -> dict[str, float]:
        return {"time": 0.02 * self.step, "progress": 0.1 * member}

    def played(self, steps: int) -> list[tuple[Frame, ...]]:
        frames = []
        for _ in range(steps):
            self.step += 1
            self.episodes.bodies.coordinates[:, 0] -= 0.05
            self.episodes.torques[0, 0, :, 1] = 6.0 * math.sin(self.step)
            frames.append(self.viewer.frames())
        return frames


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
@pytest.mark.parametrize("radius", [None, 0.3])
def test_copies_continue_on_their_own(duplicate, radius):
    """The viewer picks the painter of the dimension; copies keep camera, floors and trail."""
    original = Viewed(FISH, 2, radius)
    first = original.played(12)[-1]
    assert len(first) == 2
    assert not np.array_equal(*first)
    twin = duplicate(duplicate(original))
    expected, found = original.played(4), twin.played(4)
    assert all(map(np.array_equal, np.array(found), np.array(expected)))
    for one in (original, twin):
        one.viewer.forget(0)
    expected, found = original.played(1)[0], twin.played(1)[0]
    assert np.array_equal(found, expected)
    fresh = Viewed(FISH, 2, radius)
    fresh.step, fresh.episodes.bodies.coordinates[:] = 16, original.episodes.bodies.coordinates
    fresh.episodes.bodies.coordinates[:, 0] += 0.05
    alone = fresh.played(1)[0]
    assert np.array_equal(alone[0], expected[0])
    assert not np.array_equal(alone[1], expected[1])


def test_torques_are_shown_as_shares_of_their_own_limits():
    """The limit of yaw, 6 N m, gives the same frame whatever the torque of roll is."""
    viewed = Viewed(FISH, 1)
    viewed.episodes.torques[0, 0] = (0.0, 6.0, 2.0)
    (frame,) = viewed.viewer.frames()
    painter = SpatialFramePainter(FISH)
    assert np.array_equal(frame, drawn(painter, pose(FISH), 1.0))


@pytest.mark.release
def test_frames_come_fifty_a_second():
    """Frames of 640 x 360 pixels along an episode, the median of the best of several rounds."""
    for radius in (None, 0.2):
        painter = SpatialFramePainter(FISH, target_radius=radius)
        spent = np.empty((5, 25))
        for place in np.ndindex(spent.shape):
            body = pose(FISH, (-0.01 * place[1], 0.0, 0.0), bend=0.3 * math.sin(place[1]))
            start = time.perf_counter()
            painter.draw(body, np.full(24, math.cos(place[1])), 0.02 * place[1], 0.0, AHEAD)
            spent[place] = time.perf_counter() - start
        assert 1.0 / np.median(spent, axis=1).min() > 50.0


# ---- clips -------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [".webp", ".gif"])
def test_clips_play_in_real_time(kind, tmp_path):
    """All frames, for the true time in all, in colours close to their own; and over again."""
    frames = episode(SpatialFramePainter(FISH), 7)
    write_clip(tmp_path / f"clip{kind}", frames, 30.0, shrink=2)
    with Image.open(tmp_path / f"clip{kind}") as clip:
        assert clip.size == (320, 180)
        assert clip.n_frames == 7
        assert clip.info["loop"] == 0
        spent = 0
        for number, frame in enumerate(frames):
            clip.seek(number)
            shown = np.array(clip.convert("RGB")).astype(float)
            spent += clip.info["duration"]
            assert np.abs(shown - np.array(Image.fromarray(frame).reduce(2))).mean() < 4.0
    assert spent == pytest.approx(7000.0 / 30.0, abs=5.0)


def test_clips_that_cannot_be_are_refused(tmp_path):
    frame = np.zeros((8, 8, 3), dtype=np.uint8)
    for name, frames, rate, options, message in (
        ("a.mp4", [frame], 10.0, {}, r"ends with \.webp or \.gif \(.*a\.mp4\)"),
        ("a.gif", [frame], 60.0, {}, r"at most 50 in a \.gif, got 60"),
        ("a.webp", [frame], 0.0, {}, "rate must be above 0"),
        ("a.webp", [frame], math.nan, {}, "rate must be above 0"),
        ("a.webp", [frame], 10.0, {"shrink": 0}, "shrink must be at least 1, got 0"),
        ("a.webp", [], 10.0, {}, "one frame at least"),
        ("a.webp", [frame, frame[:4]], 10.0, {}, r"of one size, got \(8, 4\), \(8, 8\)"),
    ):
        with pytest.raises(OptionError, match=message):
            write_clip(tmp_path / name, frames, rate, **options)
    assert not list(tmp_path.iterdir())
