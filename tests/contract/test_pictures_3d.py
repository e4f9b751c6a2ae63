"""Pictures and commands of runs in space: three views at one scale, files, and refusals."""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from swim_agents.comparison.spatial_gait import analyse_spatial_gait

from swim_env import SceneError, Simulator, SwimError, Trajectory, load_scene
from swim_env.analysis.body_surface import BodySurface
from swim_env.analysis.pose import orientation_of
from swim_env.analysis.spatial_energy import spatial_elastic_energy
from swim_env.physics.spatial.invariants import heading_of
from swim_env.plots import (
    draw_bending,
    draw_energy,
    draw_gaits,
    draw_kymographs,
    draw_path,
    draw_paths,
    draw_torques,
)
from swim_env.plots.results import RESULT_FILES
from swim_env.recording import read_recording
from tests.contract.test_pictures import check_texts
from tests.support import assert_is_a_picture, call_script, refuses


def played(name: str, steps: int, **changes: Any) -> Trajectory:
    """Return a run under the prescribed torque, or a free one."""
    simulator = Simulator(load_scene(name, changes))
    return simulator.rollout(simulator.prescribed_torques(steps))


RUNS: dict[str, Callable[[], Trajectory]] = {
    "slow": lambda: played("fish_3d", 300),
    "rolling": lambda: played("helix_3d", 200),
    "far": lambda: played("fish_3d", 200, **{"initial.velocity": [-2.5, 0.4, 0.6]}),
    "tumbling": lambda: played("ellipsoid_3d", 400, **{"initial.velocity": [2.0, 1.5, -1.0]}),
    "sheet": lambda: played("paper_i_3d", 3),
    "one step": lambda: played("eel_3d", 1),
    "no step": lambda: played("eel_3d", 0),
}


@pytest.fixture(scope="module", params=RUNS)
def drawn(request) -> tuple[Trajectory, Figure]:
    run = RUNS[request.param]()
    return run, draw_path(run)


def views_of(figure: Figure) -> dict[str, Axes]:
    axes = {one.get_title(loc="left"): one for one in figure.axes}
    return {view: axes[view] for view in ("top", "side", "front")}


def scale_of(axes: Axes) -> tuple[float, float]:
    """Return pixels for a metre to the right and upwards."""
    size = axes.get_window_extent().size
    right, up = axes.get_xlim(), axes.get_ylim()
    return size[0] / abs(right[1] - right[0]), size[1] / (up[1] - up[0])


def test_three_views_have_one_scale_and_texts_can_be_read(drawn):
    run, figure = drawn
    check_texts(figure)
    views = views_of(figure)
    scales = np.array([scale_of(axes) for axes in views.values()])
    assert scales == pytest.approx(scales[0, 0], rel=1e-6)
    assert views["top"].get_xlim() == views["side"].get_xlim()
    assert views["side"].get_ylim() == views["front"].get_ylim()
    left, right = views["front"].get_xlim()
    assert left > right  # seen from the head, which looks towards -x
    units = ("(m)", "(s)", "(\u00b0)", "body lengths", "joint")
    for axes in figure.axes:
        for label in {axes.get_xlabel(), axes.get_ylabel()} - {""}:
            assert any(unit in label for unit in units), label
    assert figure.get_suptitle().startswith(f"{run.scene.name}: {run.duration:g} s, net")
    assert figure.bbox.height < 1.6 * figure.bbox.width


@pytest.mark.parametrize("name, moved_apart", [("far", False), ("slow", True)])
def test_outlines_are_the_bodys_where_it_was(name, moved_apart):
    run = RUNS[name]()
    figure = draw_path(run, shapes=3)
    surface = BodySurface(run.scene, rings=45, around=32)
    instants = [0, run.steps // 2, run.steps]
    assert ("moved apart" in figure.get_suptitle()) is moved_apart
    for axes, at in zip(views_of(figure).values(), ((0, 1), (0, 2), (1, 2)), strict=True):
        bodies = axes.collections[::2]
        assert len(bodies) == len(axes.collections[1::2]) == 3
        tops = []
        for n, body in zip(instants, bodies, strict=True):
            drawn = np.concatenate([path.vertices for path in body.get_paths()])
            shape = surface.vertices(run.centres[n], run.directors[n])[:, at]
            assert np.ptp(drawn, axis=0) == pytest.approx(np.ptp(shape, axis=0))
            assert drawn[:, 0].min() == pytest.approx(shape[:, 0].min())
            tops.append(drawn[:, 1].max() - shape[:, 1].max())
            (head,) = [
                line for line in axes.get_lines() if line.get_label() == f"{run.time[n]:.3g} s"
            ]
            place = np.ravel(head.get_xydata()) - (0.0, tops[-1])
            assert place == pytest.approx(run.nodes[n, 0, list(at)])
        steps = np.diff(tops)
        assert (steps < -0.06).all() if moved_apart else (np.abs(tops) < 1e-12).all()
        lines = {line.get_label(): line.get_xydata() for line in axes.get_lines()}
        if not moved_apart:
            assert np.array_equal(lines["mean centre"], run.path[:, at])
            assert np.array_equal(lines["head"], run.nodes[:, 0, at])


def test_charts_hold_displacement_orientation_and_rotations():
    run = RUNS["rolling"]()
    figure = draw_path(run)
    charts = {axes.get_title(loc="left").split(",")[0]: axes for axes in figure.axes}
    net = charts["displacement of the mean centre"]
    turn = charts["turn of the body: roll about its axis"]
    turned = np.degrees(orientation_of(run.directors))
    for axes, names, values in (
        (net, ("along x", "along y", "along z"), run.path - run.path[0]),
        (turn, ("roll", "pitch", "yaw"), turned - turned[0]),
    ):
        lines = {line.get_label(): line.get_ydata() for line in axes.get_lines()}
        for name, column in zip(names, values.T, strict=True):
            assert lines[name] == pytest.approx(column)
    for axis, column in (("yaw", 1), ("pitch", 0)):
        image = charts[f"{axis} of the joints"].images[0].get_array()
        assert np.asarray(image) == pytest.approx(np.degrees(run.joint_rotations[1:, :, column]).T)
    assert "roll of the joints" not in charts  # it hardly twists


def test_orientation_is_what_turned_the_body():
    """Roll, pitch and yaw of straight and bent bodies, in whole turns; pitch lifts the head."""
    scene = load_scene("fish_3d", {"initial.joint_rotations": [0.02, 0.05, 0.1]})
    bent = Simulator(scene).directors
    first = orientation_of(bent[None])[0]
    size = np.linspace(0.0, 1.0, 60)
    for axis, angles in ((0, (5.0, 0.0, 0.0)), (2, (0.0, 0.0, 9.0))):
        turns = np.stack([rotation(*(one * np.array(angles))) for one in size])
        straight = Simulator("fish_3d").directors
        found = orientation_of(np.einsum("tij,njk->tnik", turns, straight))
        assert found == pytest.approx(size[:, None] * np.array(angles), abs=1e-12), axis
    angles = np.array([0.4, -0.7, 1.1])
    found = orientation_of((rotation(*angles) @ Simulator("fish_3d").directors)[None])[0]
    assert found == pytest.approx(angles)
    lifted = rotation(0.0, 0.3, 0.0) @ [-1.0, 0.0, 0.0]
    assert lifted[2] > 0.0  # the head looks towards -x
    yawed = orientation_of((rotation(0.0, 0.0, 0.5) @ bent)[None])[0]
    assert yawed - first == pytest.approx([0.0, 0.0, 0.5])


def rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return the rotation about z, the turned y, and the x that both have turned."""

    def about(axis: int, angle: float) -> np.ndarray:
        turn = np.eye(3)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn[i, i] = turn[j, j] = np.cos(angle)
        turn[i, j], turn[j, i] = -np.sin(angle), np.sin(angle)
        return turn

    return about(2, yaw) @ about(1, pitch) @ about(0, roll)


# ---- commands ----------------------------------------------------------------------------------


def test_replay_writes_results_and_a_recording(capsys, tmp_path):
    folder, file = tmp_path / "results", tmp_path / "x.rrd"
    arguments = ("--scene", "fish_3d", "--duration", "0.5", "--output", folder)
    done = call_script(capsys, "replay", *arguments, "--record", file, "--json")
    figures = done.figures()
    assert {one.name for one in folder.iterdir()} == set(RESULT_FILES)
    assert json.loads((folder / "summary.json").read_text()) == figures
    run = Trajectory.load(folder / "trajectory.npz")
    assert figures["displacement"] == run.displacement.tolist() and run.steps == 100
    assert load_scene(folder / "scene.yaml") == run.scene == load_scene("fish_3d")
    assert_is_a_picture(folder / "path.png")
    assert list(read_recording(file).swimmers) == ["prescribed"]
    assert figures["recording"]["frames"] == 26
    table = call_script(capsys, "replay", *arguments[:4]).out
    assert table.split("net displacement")[1].splitlines()[0].count(",") == 2


def test_visualise_records_the_wave_and_saved_runs(capsys, tmp_path):
    changes = ("fluid.model=panels", "fluid.rows=1", "fluid.around=8")
    file = tmp_path / "x.rrd"
    arguments = ("--scene", "fish_3d", "--set", *changes, "--duration", "0.1")
    done = call_script(capsys, "visualise", *arguments, "--output", file, "--json")
    assert done.figures()["flow_frames"] == 4
    saved = tmp_path / "run.npz"
    RUNS["slow"]().save(saved)
    arguments = ("--trajectory", saved, "--colour", "moment", "--output", tmp_path / "y.rrd")
    done = call_script(capsys, "visualise", *arguments, "--json")
    assert (done.figures()["frames"], done.figures()["flow_frames"]) == (76, 0)
    assert list(read_recording(tmp_path / "y.rrd").swimmers) == ["run"]


@pytest.mark.parametrize(
    "name, arguments, text",
    [
        ("visualise", ("--flow-rate", "5"), "fish_3d has no fluid of panels (panels, frozen)"),
        ("replay", ("--accuracy", "0.1"), "needs a scene of dimension 2, got fish_3d"),
    ],
)
def test_what_is_of_the_plane_only_is_refused(capsys, tmp_path, name, arguments, text):
    place = "--output" if name == "visualise" else "--record"
    done = call_script(capsys, name, "--scene", "fish_3d", *arguments, place, tmp_path / "x.rrd")
    done.assert_refused(text)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("task", ["forward", "target"])
def test_episodes_are_recorded_with_rewards_and_target(capsys, tmp_path, task):
    arguments = ("--scene", "eel_3d", "--policy", "paper_wave", "--duration", "0.4")
    arguments += ("--task", task, "--seed", "3", "--json")
    file, again = tmp_path / "x.rrd", tmp_path / "y.rrd"
    done = call_script(capsys, "visualise", *arguments, "--output", file)
    assert done.figures()["frames"] == 21
    replayed = call_script(capsys, "replay", "--env", *arguments, "--record", again).figures()
    assert replayed["actions"] == 20 and replayed["net_displacement"] != 0.0
    for one in (file, again):
        recording = read_recording(one)
        shown = recording.swimmers["paper_wave"]
        ball = ("/world/paper_wave/target", "Ellipsoids3D:half_sizes")
        assert (ball in recording.columns) is (task == "target")
        assert shown.series["reward"].shape == (20, 1)
        assert shown.series["reward"].sum() == pytest.approx(replayed["return"], abs=1e-6)


# ---- many runs side by side --------------------------------------------------------------------


@pytest.fixture(scope="module")
def compared() -> tuple[dict[str, Trajectory], dict[str, Any]]:
    """Runs of both hands, of a plane and of nothing, with their gaits."""
    scene = load_scene("fish_3d", {"episode.duration": 1.5})
    runs, gaits = {}, {}
    for name, wave in (("helical_wave_right", "helical_right"), ("lateral_wave", "planar")):
        changes = {"actuation.wave": wave, "actuation.amplitude": 5.0}
        runs[name] = played("fish_3d", 300, **changes)
    runs["zero"] = Simulator(scene).rollout(np.zeros((300, 8, 3)))
    for name, run in runs.items():
        now = slice(100, 300, 4)
        frames = heading_of(run.directors[now])
        turns, torques = run.joint_rotations[now], run.torques[now]
        found = analyse_spatial_gait(
            run.time[now], turns, torques, scene.beam.joint_fractions, frames, 0.0
        )
        gaits[name] = found.to_dict() if turns.any() else None
    return runs, gaits


def shown_by(image: AxesImage) -> np.ndarray:
    return np.asarray(image.get_array())


def test_maps_show_the_last_second_of_every_axis_on_one_scale(compared):
    runs = compared[0]
    for draw, values, axes in (
        (draw_kymographs, lambda run: 9.0 * run.joint_rotations[1:], {"yaw": 1, "pitch": 0}),
        (draw_torques, lambda run: run.torques, {"yaw": 1, "pitch": 0}),
    ):
        figure = draw(runs)
        check_texts(figure)
        *panels, _ = figure.axes
        largest = max(np.abs(values(run)[-200:]).max() for run in runs.values())
        shown = iter(panels)
        for name, run in runs.items():
            for axis, number in axes.items():
                panel = next(shown)
                assert panel.get_title(loc="left").startswith(f"{name}, {axis}, largest ")
                image = panel.images[0]
                assert image.get_clim() == pytest.approx((-largest, largest))
                assert shown_by(image) == pytest.approx(values(run)[-200:, :, number].T)
        assert next(shown, None) is None


def test_gaits_have_two_rows_of_axes_for_each_policy(compared):
    runs, gaits = compared
    figure = draw_gaits(runs, gaits)
    check_texts(figure)
    told = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert told == list(runs)
    maps = [axes.images[0] for axes in figure.axes if axes.images]
    assert len(maps) == 2 * 3 * len(runs)
    run = runs["helical_wave_right"]
    for image, axis, limit in zip(maps, (1, 0, 2), (6.0, 8.0, 2.0), strict=False):
        assert shown_by(image) == pytest.approx(run.torques[-200:, :, axis].T / limit)
        assert image.get_clim() == (-1.0, 1.0)
    turns = run.joint_rotations[100:300]
    for image, axis in zip(maps[3:], (1, 0, 2), strict=False):
        assert shown_by(image) == pytest.approx(turns[..., axis].T)
        assert image.get_clim()[1] == pytest.approx(np.abs(turns).max())
    assert maps[-1].get_clim()[1] == pytest.approx(np.radians(1.0))  # what does not move
    lines = {line.get_label(): line for axes in figure.axes for line in axes.lines}
    (yaw,) = {label for label in lines if label.startswith("yaw") and "_" not in label} - {
        f"yaw {gaits['lateral_wave']['yaw']['frequency']:.2f} Hz, "
        f"{gaits['lateral_wave']['yaw']['travelling_share']:.2f}"
    }
    lags = gaits["helical_wave_right"]["yaw"]["phase_lags"]
    assert lines[yaw].get_ydata() == pytest.approx(lags)


def test_an_axis_that_is_not_actuated_says_so():
    run = played("eel_3d", 60, **{"actuation.axes": ["yaw"], "actuation.torque_limit": [3.0]})
    gait = {axis: None for axis in ("yaw", "roll")}
    about = {"phase_lags": np.zeros(9), "frequency": 1.5, "travelling_share": 0.4}
    figure = draw_gaits({"eel": run}, {"eel": {**gait, "pitch": about}})
    told = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert told == ["eel", "not actuated"]
    assert sum(bool(axes.images) for axes in figure.axes) == 4


def test_ellipses_are_those_of_the_gait_in_the_colours_of_their_hand(compared):
    runs, gaits = compared
    figure = draw_bending(runs, gaits)
    check_texts(figure)
    right, body = figure.axes[:2]
    assert len(right.patches) == 8 and len(body.patches) == 1
    whole = gaits["helical_wave_right"]["body"]
    outline = body.patches[0].get_xy() @ [1.0, 1j]
    along = (outline * np.exp(-1j * whole["angle"])).real
    across = (outline * np.exp(-1j * whole["angle"])).imag
    assert (along.max(), across.max()) == pytest.approx((whole["major"], whole["minor"]), rel=1e-3)
    red, _, blue, _ = body.patches[0].get_facecolor()
    assert whole["whirl"] > 0.2 and red > blue
    for patch, place in zip(right.patches, np.arange(1, 9) / 9.0, strict=True):
        middle = patch.get_xy()[:-1].mean(axis=0)
        assert middle == pytest.approx([place, 0.0], abs=2e-3)
        assert np.ptp(patch.get_xy()[:, 0]) < 1.0 / 9.0
    words = right.get_title(loc="left")
    assert f"handedness {gaits['helical_wave_right']['handedness']:+.2f}" in words
    assert "no gait" in [text.get_text() for text in figure.axes[4].texts]
    assert not figure.axes[4].patches


def test_paths_are_seen_from_three_sides_with_targets(compared):
    runs = compared[0]
    goal = np.array([-0.9, 0.4, 0.2])
    figure = draw_paths(runs, dict.fromkeys(runs, goal))
    check_texts(figure)
    views = views_of(figure)
    scales = np.array([scale_of(axes) for axes in views.values()])
    assert scales == pytest.approx(scales[0, 0], rel=1e-6)
    for axes, at in zip(views.values(), ([0, 1], [0, 2], [1, 2]), strict=True):
        lines = {line.get_label(): line for line in axes.lines}
        stars = [line for line in axes.lines if line.get_marker() == "*"]
        for name, run in runs.items():
            moved = run.path - run.path[0]  # of a body of 1 m
            assert lines[name].get_xydata() == pytest.approx(moved[:, at])
            assert stars[0].get_xydata()[0] == pytest.approx((goal - run.path[0])[at])
    assert [text.get_text() for text in figure.legends or figure.subfigs[0].legends[0].get_texts()]
    strips = [axes for axes in figure.subfigs[1].axes]
    assert [axes.get_ylabel() for axes in strips[::2]] == list(runs)
    # In the body's frame, head left: what bends laterally is seen from the top alone.
    top, side = strips[2:4]
    line = top.lines[-1].get_xydata()
    assert line[0, 0] < -0.45 < 0.45 < line[-1, 0]
    assert np.ptp(line[:, 1]) > 0.01 > 1e-6 > np.ptp(side.lines[-1].get_xydata()[:, 1])


def test_the_energy_in_space_is_elastic_and_kinetic(compared):
    run = compared[0]["lateral_wave"]
    figure = draw_energy({"lateral_wave": run}, seconds=0.5)
    check_texts(figure)
    elastic, kinetic = (part.get_paths()[0].vertices for part in figure.axes[0].collections)
    (total,) = (line for line in figure.axes[0].lines if line.get_label() == "total")
    assert kinetic[:, 1].max() == pytest.approx(total.get_ydata().max())
    last = spatial_elastic_energy(run.scene, run.joint_rotations[-101:])
    assert elastic[:, 1].max() == pytest.approx(last.max(), rel=1e-9)


def test_runs_of_both_dimensions_are_not_compared(compared):
    plane = Simulator("swimmer").rollout(np.zeros((5, 8)))
    mixed = {"plane": plane, "space": compared[0]["zero"]}
    for draw in (draw_kymographs, draw_torques, draw_energy, draw_paths):
        with refuses(SwimError, "in the plane or in space, got some of both"):
            draw(mixed)


def test_a_picture_with_a_target_is_of_the_plane_only():
    with refuses(SceneError, "a picture with a target needs a scene of dimension 2"):
        draw_path(RUNS["one step"](), target=(1.0, 0.0))
