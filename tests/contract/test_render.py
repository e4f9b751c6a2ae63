"""Frames of the environments, videos of them, and the window."""

import copy
import math
import pickle
import sys
import time
from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RecordVideo
from numpy.typing import NDArray

from swim_env import OptionError, SwimEnv, SwimError, SwimTargetEnv, SwimVectorEnv, load_scene
from swim_env.colours import BODY, GOAL, WATER, torque_colours
from swim_env.envs.render import window
from swim_env.envs.render.frames import GRID, FramePainter
from swim_env.scene import Scene
from tests.support import FORWARD, SMALL, assert_same, each_task, run_python

Array = NDArray[np.float64]
Frame = NDArray[np.uint8]


def wave(step: int, joints: int) -> Array:
    """Return the actions of a travelling wave that swims."""
    places = np.arange(1, joints + 1) / (joints + 1)
    action: Array = np.cos(0.2 * math.pi * step + 3.0 * places)
    return action


def played(env: SwimEnv, steps: int, **start: Any) -> list[Frame]:
    env.reset(**start)
    return played_on(env, steps)


def played_on(env: SwimEnv, steps: int) -> list[Frame]:
    frames = [env.render()]
    for step in range(steps):
        env.step(wave(step, env.scene.beam.elements - 1))
        frames.append(env.render())
    return frames


def pose(scene: Scene, bend: float = 0.0) -> Array:
    """Return minimal coordinates of a bent body that lies somewhere askew."""
    joints = scene.beam.elements - 1
    angles = bend * np.sin(np.linspace(0.0, math.pi, joints)) / max(1, joints)
    return np.concatenate([[1.3, -0.7, 0.4], angles])


def nodes_of(scene: Scene, coordinates: Array) -> Array:
    angles = np.cumsum(coordinates[2:])
    arms = scene.beam.element_length * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    line = np.concatenate([np.zeros((1, 2)), np.cumsum(arms, axis=0)])
    return line - 0.5 * (line[:-1] + line[1:]).mean(axis=0) + coordinates[:2]


def drawn(painter: FramePainter, coordinates: Array, torque: float = 0.0) -> Frame:
    """Return a frame of a pose; the goal is a direction."""
    torques = np.full(len(coordinates) - 3, torque)
    return painter.draw(coordinates, torques, 0.0, 0.0, (-1.0, 0.0))


def colours_at(frame: Frame, pixels: Array) -> NDArray[np.int64]:
    """Return the colours of the pixels that points (..., 2) lie in."""
    columns, rows = np.floor(pixels).astype(int).T
    return frame[rows, columns].astype(np.int64)


def off(colours: NDArray[np.int64], expected: tuple[int, int, int]) -> int:
    return int(np.abs(colours - np.array(expected)).max())


# ---- what a frame shows ------------------------------------------------------------------------

SCENES = {
    "nine": load_scene("swimmer"),
    "long": load_scene("paper_v"),
    "three": load_scene("paper_iv"),
    "two": load_scene("swimmer", {"beam.elements": 2}),
    "many": load_scene("swimmer", {"beam.elements": 81, "beam.length": 2.0}),
    "thick": load_scene("paper_iv", {"beam.half_thickness": 0.05}),
}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("size", [(640, 360), (800, 800)])
def test_the_body_is_where_it_is(name, size):
    """Body colour along the body and nowhere else, the torque's colour at its joints."""
    scene = SCENES[name]
    coordinates = pose(scene, bend=1.2)
    painter = FramePainter(scene, *size)
    frame = drawn(painter, coordinates, 1.0)
    assert frame.shape == (size[1], size[0], 3)
    assert frame.dtype == np.uint8
    nodes = nodes_of(scene, coordinates)
    line = painter.pixels(nodes)
    # x to the right, y upwards, by the same number of pixels.
    scale = np.hypot(*(line[1] - line[0])) * scene.beam.elements
    moved = painter.pixels(nodes + np.array([0.5, 0.25]) * scene.beam.length) - line
    assert moved == pytest.approx(np.tile(scale * np.array([0.5, -0.25]), (len(nodes), 1)))
    assert off(colours_at(frame, line[1:-1]), torque_colours(np.array([1.0]))[0]) <= 45
    middles = 0.5 * (line[:-1] + line[1:])
    if scene.beam.elements <= 9:
        # Behind the head, which has eyes.
        assert off(colours_at(frame, middles[1:]), BODY) <= 45
    # Body colour belongs to the body: outline, head, and the rings of its joints.
    half = max(1.6, scene.beam.half_thickness / scene.beam.length * scale)
    left, top = np.floor(line.min(axis=0) - 40).astype(int)
    right, bottom = np.ceil(line.max(axis=0) + 40).astype(int)
    view = frame[top:bottom, left:right].astype(np.int64)
    dark = np.argwhere(np.abs(view - np.array(BODY)).max(axis=-1) < 25)
    dark = dark[:, ::-1] + (left + 0.5, top + 0.5)
    fine = np.concatenate(
        [a + np.linspace(0.0, 1.0, 40)[:, None] * (b - a) for a, b in pairwise(line)]
    )
    away = np.hypot(*(dark[:, None] - fine[None]).transpose(2, 0, 1)).min(axis=1)
    assert len(dark) > 100
    assert away.max() <= 1.0 + max(1.5 * half, 9.0 * min(size[0] / 640, size[1] / 360))
    # The head end is the broad one, unless the body is broader than a head is drawn.
    ends = [np.hypot(*(dark - end).T) < 10.0 for end in (line[0], line[-1])]
    assert np.count_nonzero(ends[0]) > np.count_nonzero(ends[1]) or half > 9.0


@pytest.mark.parametrize("name", ["nine", "three", "thick"])
def test_the_body_has_its_true_thickness(name):
    """The covered length across a lying body is its thickness, within half a pixel."""
    scene = SCENES[name]
    coordinates = np.zeros(scene.beam.elements + 2)
    painter = FramePainter(scene)
    frame = drawn(painter, coordinates)
    nodes = painter.pixels(nodes_of(scene, coordinates))
    scale = (nodes[-1, 0] - nodes[0, 0]) / 1.0
    column = int(0.5 * (nodes[-2, 0] + nodes[-1, 0]))
    row = int(nodes[0, 1])
    strip = frame[row - 40 : row + 40, column - 2 : column + 3].astype(float).mean(axis=1)
    share = (WATER[0] - strip[:, 0]) / (WATER[0] - BODY[0])
    thickness = share[share > 0.25].sum()
    expected = 2.0 * scene.beam.half_thickness / scene.beam.length * scale
    assert thickness == pytest.approx(expected, abs=0.5)


def test_the_grid_rests_in_the_fluid():
    """Lines stand at the same places of the world while the camera moves."""
    scene = load_scene("swimmer", {"beam.length": 2.0})
    painter = FramePainter(scene)
    for step in range(12):
        coordinates = np.zeros(11)
        coordinates[:2] = (0.1 * step, 0.05 * step)
        frame = painter.draw(coordinates, np.zeros(8), 0.02 * step, 0.0, (-1.0, 0.0))
        # Numbered lines are 0.5 BL apart, so 1 m; a point between the finer lines is water.
        across = np.array([1.0 + 0.05 * step, 0.05 * step + 0.5])
        on_line = painter.pixels([round(across[0]), across[1]])
        row = int(painter.pixels([0.0, math.floor(across[1] / 0.2) * 0.2 + 0.1])[1])
        near = frame[row, int(on_line[0]) - 3 : int(on_line[0]) + 4].astype(int)
        assert off(near[[0, -1]], WATER) <= 2
        assert np.abs(near - np.array(WATER)).sum(axis=0)[0] >= 0.9 * (WATER[0] - GRID[0])


def test_a_target_is_a_circle_of_its_radius():
    """The ring lies at the target's radius; a target out of view is named with its distance."""
    scene = load_scene("swimmer")
    painter = FramePainter(scene, target_radius=0.1)
    coordinates, target = np.zeros(11), np.array([0.3, 0.4])
    frame = painter.draw(coordinates, np.zeros(8), 0.0, 0.0, target)
    angles = np.linspace(0.0, 2.0 * math.pi, 12)
    ring = target + (0.1 - 0.8 / 231) * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    assert off(colours_at(frame, painter.pixels(ring)), GOAL) <= 90
    assert off(colours_at(frame, painter.pixels(target[None])), GOAL) == 0
    inside = colours_at(frame, painter.pixels(target[None] + (0.05, 0.0)))[0]
    assert inside[0] < WATER[0] - 20
    painter.forget()
    far = painter.draw(coordinates, np.zeros(8), 0.0, 0.0, (50.0, 3.0))
    green = np.argwhere((far[40:300] == np.array(GOAL)).all(axis=-1))
    assert len(green) > 20
    assert green[:, 1].min() > 500


@pytest.mark.parametrize("elements", [2, 9, 81])
@pytest.mark.parametrize("target", [False, True])
def test_odd_states_are_drawn(elements, target):
    """Any finite state gives a frame: far, wound up, with time going anywhere."""
    scene = load_scene("swimmer", {"beam.elements": elements})
    painter = FramePainter(scene, target_radius=0.1 if target else None)
    goals = [(1e300, -2.0), (0.0, 1e9), (0.1, 0.1)] if target else [(0.0, 1.0), (0.6, -0.8)] * 2
    still = np.zeros(elements + 2)
    for x, y, angle, bend in (
        (0.0, 0.0, 0.0, 0.0),
        (1e5, -2e5, 1e6, 0.01),
        (1e200, -1e308, -1e17, 3.0),
        (-1e12, 1e12, 2.0, -1.5),
        (3.0, 2.0, 1.0, math.pi),
    ):
        still[:3], still[3:] = (x, y, angle), bend
        torques = np.linspace(-2.0, 2.0, elements - 1)
        for instant, progress, goal in zip(
            (0.0, 1e-9, 1e6), (0.0, -1e300, 1e7), goals[:3], strict=True
        ):
            frame = painter.draw(still, torques, instant, progress, goal)
            assert frame.shape == (360, 640, 3)

    with pytest.raises(OptionError, match="at least 480 x 270 pixels, got 320 x 360"):
        FramePainter(scene, 320, 360)


# ---- frames over an episode --------------------------------------------------------------------


@pytest.mark.parametrize("kind", [SwimEnv, SwimTargetEnv])
def test_the_same_episode_gives_the_same_frames(kind):
    """Frames depend on the episode alone, and not on what was shown before its reset."""
    env = kind(overrides=SMALL, render_mode="rgb_array")
    first = played(env, 8, seed=3)
    assert np.array_equal(env.render(), first[-1])
    first[-1][:] = 0
    assert env.render().any()
    other = played(env, 5, seed=4)
    again = played(env, 8, seed=3)
    assert all(np.array_equal(a, b) for a, b in zip(first[:-1], again[:-1], strict=True))
    assert not np.array_equal(other[5], again[5])
    fresh = played(kind(overrides=SMALL, render_mode="rgb_array"), 8, seed=3)
    assert all(np.array_equal(a, b) for a, b in zip(fresh, again, strict=True))


def test_the_camera_and_the_trail_follow():
    """The body stays in view however far it swims, and leaves a trail."""
    scene = load_scene("swimmer")
    painter = FramePainter(scene)
    coordinates = np.zeros(11)
    for step in range(400):
        coordinates[0] = -0.01 * step
        frame = painter.draw(coordinates, np.zeros(8), 0.02 * step, 0.01 * step, (-1.0, 0.0))
        column, row = painter.pixels(coordinates[:2])
        assert abs(column - 335) < 0.16 * 250
        assert abs(row - 168) < 2
    behind = colours_at(frame, painter.pixels(coordinates[:2] + [[0.7, 0.0], [0.9, 0.0]]))
    assert (behind[:, 0] < 170).all()
    above = colours_at(frame, painter.pixels(coordinates[:2] + [[0.73, 0.06]]))
    assert (above[:, 0] > 190).all()


def test_rendering_changes_nothing():
    """An episode that is rendered is bit for bit the one that is not."""
    seen, unseen = (SwimEnv(overrides=SMALL, render_mode=mode) for mode in ("rgb_array", None))
    assert_same(seen.reset(seed=1), unseen.reset(seed=1))
    for step in range(10):
        seen.render()
        assert_same(seen.step(wave(step, 2)), unseen.step(wave(step, 2)))
    assert unseen._viewer is None


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copies_render_what_the_original_renders_and_on_their_own(duplicate):
    """A copy has the trail and the camera; what the one shows then leaves no trace in the other."""
    env = SwimTargetEnv(overrides=SMALL, render_mode="rgb_array")
    played(env, 12, seed=0)
    twin = duplicate(duplicate(env))
    without_trail = SwimTargetEnv(overrides=SMALL, render_mode="rgb_array")
    without_trail.reset()
    without_trail.restore(env.snapshot())
    expected = played_on(env, 5)
    assert not np.array_equal(expected[0], without_trail.render())
    assert_same(played_on(twin, 5), expected)
    assert_same(played(duplicate(env), 2, seed=1), played(twin, 2, seed=1))
    batch = members(2)
    batch.reset(seed=0)
    for step in range(9):
        batch.render()
        batch.step(np.stack([wave(step, 2)] * 2))
    other = duplicate(batch)
    for one in (batch, other):
        one.reset(options={"reset_mask": np.array([True, False])}, seed=5)
    assert_same(other.render(), batch.render())


def test_restoring_starts_a_new_trail():
    """What was shown before leaves no trace in a restored episode."""
    env = SwimEnv(overrides=SMALL, render_mode="rgb_array")
    played(env, 3, seed=0)
    snapshot = env.snapshot()
    for step in range(20):
        env.step(wave(step, 2))
        env.render()
    env.restore(snapshot)
    other = SwimEnv(overrides=SMALL, render_mode="rgb_array")
    other.reset(seed=0)
    other.restore(snapshot)
    assert np.array_equal(env.render(), other.render())


def test_render_needs_an_episode_and_a_mode():
    """Before a reset there is an error, without a mode Gymnasium's warning."""
    for env in (SwimEnv(overrides=SMALL, render_mode="rgb_array"), members(2)):
        with pytest.raises(gymnasium.error.ResetNeeded, match="call reset before render"):
            env.render()
    for env in (SwimEnv(overrides=SMALL), members(2, render_mode=None)):
        env.reset()
        with pytest.warns(UserWarning, match="render was called without a render mode"):
            assert env.render() is None
    made = gymnasium.make(FORWARD, overrides=SMALL)
    made.reset()
    with pytest.warns(UserWarning, match=f"gymnasium.make.'{FORWARD}'"):
        made.unwrapped.render()


@pytest.mark.release
def test_frames_come_a_hundred_a_second():
    """Frames of 640 x 360 pixels along an episode, the median of the best of several rounds.

    Other programs only ever add to the time.
    """
    for kind in (SwimEnv, SwimTargetEnv):
        env = kind(scene="swimmer", render_mode="rgb_array")
        env.reset(seed=0)
        spent = np.empty((5, 25))
        for place in np.ndindex(spent.shape):
            env.step(wave(place[1], 8))
            start = time.perf_counter()
            env.render()
            spent[place] = time.perf_counter() - start
        assert 1.0 / np.median(spent, axis=1).min() > 100.0


# ---- many members ------------------------------------------------------------------------------


def members(count: int, **settings: Any) -> SwimVectorEnv:
    settings = {"overrides": SMALL, "render_mode": "rgb_array", **settings}
    return SwimVectorEnv(count, **settings)


@pytest.mark.parametrize("mode", ["SameStep", "NextStep"])
def test_members_look_as_they_do_alone(mode):
    """A batch gives a frame for each member, starts of new episodes included."""
    batch = members(2, max_episode_steps=3, autoreset_mode=mode)
    batch.reset(seed=5)
    alone = [SwimEnv(overrides=SMALL, render_mode="rgb_array") for _ in range(2)]
    for index, env in enumerate(alone):
        env.reset(seed=5 + index)
    # A time-out is followed by a start: in the same step, or instead of the next one.
    length = 3 if mode == "SameStep" else 4
    for step in range(8):
        for frame, env in zip(batch.render(), alone, strict=True):
            assert np.array_equal(frame, env.render())
        actions = np.stack([wave(step, 2), -wave(step, 2)])
        batch.step(actions)
        for action, env in zip(actions, alone, strict=True):
            if step % length < 3:
                env.step(action)
            if step % length == length - 1:
                env.reset()
    batch.close()
    batch.close()


# ---- videos ------------------------------------------------------------------------------------


def test_gymnasium_records_videos(tmp_path):
    """RecordVideo writes a file of all frames that plays in real time; no warning on the way."""
    import imageio_ffmpeg

    env = RecordVideo(gymnasium.make(FORWARD, render_mode="rgb_array"), str(tmp_path / "videos"))
    env.reset(seed=0)
    for step in range(25):
        env.step(wave(step, 8))
    env.close()
    (path,) = (tmp_path / "videos").iterdir()
    count, seconds = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert count == 26
    assert count / seconds == pytest.approx(env.metadata["render_fps"], rel=0.01)


# ---- the window --------------------------------------------------------------------------------


@pytest.fixture
def headless(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take away all displays, and forget which lines were printed."""
    if sys.platform in ("darwin", "win32"):
        pytest.skip("this system's display cannot be taken away")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(window, "_printed", set())


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Give windows a display that nobody sees and a clock that runs only while they wait."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr(window, "_printed", set())
    now = [100.0]

    def sleep(seconds: float) -> None:
        now[0] += seconds

    monkeypatch.setattr(time, "sleep", sleep)
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    return now


@each_task
def test_gymnasiums_checker_passes_with_its_render_checks(task, headless, capfd):
    """Every declared mode works without a display: no warning, one line on stderr."""
    check_env(gymnasium.make(task, overrides=SMALL).unwrapped)
    env = gymnasium.make(task, overrides=SMALL, render_mode="human")
    env.reset(seed=0)
    assert env.render() is None
    env.close()
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 1
    for part in ("no window", "no display", "rgb_array", "RecordVideo", "--env --record-video"):
        assert part in lines[0]


@pytest.mark.parametrize(("module", "name"), [("pygame", "pygame"), ("PIL", "Pillow")])
def test_what_a_window_lacks_is_named(module, name, clock, monkeypatch, capfd):
    """Without pygame or Pillow the line names the extra, and the episode continues."""
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.delitem(sys.modules, f"{module}.Image", raising=False)
    played(SwimEnv(overrides=SMALL, render_mode="human"), 3)
    captured = capfd.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert f"{name} is not installed" in captured.err
    assert "swim-env[view]" in captured.err


def test_a_missing_pillow_is_named(monkeypatch, headless):
    """Without Pillow frames are an error of this package, and a missing window still none."""
    monkeypatch.setitem(sys.modules, "PIL", None)
    for module in ("drawing", "frames"):
        monkeypatch.delitem(sys.modules, f"swim_env.envs.render.{module}")
    for build in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(SwimError, match=r"Pillow.*swim-env\[view\]"):
            build(FORWARD, overrides=SMALL, render_mode="rgb_array")
    played(SwimEnv(overrides=SMALL, render_mode="human"), 1)


def test_the_window_keeps_to_real_time(clock):
    """A second of the episode takes a second; a pause is not made up for."""
    env = SwimEnv(overrides=SMALL, render_mode="human")
    env.reset(seed=0)
    begin = clock[0]
    rate = env.metadata["render_fps"]
    for step in range(rate):
        assert env.step(wave(step, 2))[4]["time"] == pytest.approx((step + 1) / rate)
    assert clock[0] - begin == pytest.approx(1.0, rel=1e-6)
    clock[0] += 30.0
    env.step(wave(0, 2))
    before = clock[0]
    env.step(wave(0, 2))
    assert clock[0] - before == pytest.approx(1.0 / rate)
    env.close()
    env.close()


def test_the_window_shows_the_frames(clock):
    """The pixels in the window are those of "rgb_array"; a batch shows its member 0."""
    import pygame

    with_array = played(SwimEnv(overrides=SMALL, render_mode="rgb_array"), 4, seed=2)
    single = SwimEnv(overrides=SMALL, render_mode="human")
    batch = members(2, render_mode="human")
    for env in (single, batch):
        env.reset(seed=2)
        for step in range(4):
            action = wave(step, 2)
            env.step(action if env is single else np.stack([action, -action]))
        shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
        assert np.array_equal(shown, with_array[-1])
    assert batch.render() is None
    single.close()
    assert pygame.display.get_init()
    batch.close()
    assert not pygame.display.get_init()


def test_closing_the_window_ends_nothing(clock, capfd):
    """The episode continues without it, at full speed, and one line says so."""
    import pygame

    env, other = (SwimEnv(overrides=SMALL, render_mode="human") for _ in range(2))
    env.reset(seed=0)
    other.reset(seed=0)
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    env.step(wave(0, 2))
    assert not pygame.display.get_init()
    stopped = clock[0]
    for step in range(1, 5):
        env.step(wave(step, 2))
        other.step(wave(step, 2))
    env.reset()
    assert clock[0] == stopped
    assert not pygame.display.get_init()
    env.close()
    other.close()
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 1
    assert "window was closed" in lines[0]


def test_an_environment_that_is_not_rendered_loads_nothing_for_it():
    done = run_python(
        "-c",
        "import sys, swim_env\n"
        "env = swim_env.SwimEnv(overrides={'beam.elements': 3}); env.reset(seed=0)\n"
        "env.step([0.0, 0.0]); env.close()\n"
        "assert not {'PIL', 'pygame', 'matplotlib', 'rerun'} & set(sys.modules)\n",
    )
    assert done.code == 0, done.err
