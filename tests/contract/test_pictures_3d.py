"""Pictures and commands of runs in space: three views at one scale, files, and refusals."""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from swim_env import SceneError, Simulator, Trajectory, load_scene
from swim_env.analysis.body_surface import BodySurface
from swim_env.analysis.pose import orientation_of
from swim_env.plots import (
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
        (
            "visualise",
            ("--policy", "paper_wave"),
            "a task needs a scene of dimension 2, got fish_3d",
        ),
        ("visualise", ("--flow-rate", "5"), "fish_3d has no fluid of panels (panels, frozen)"),
        ("replay", ("--env",), "a task needs a scene of dimension 2, got fish_3d"),
        ("replay", ("--accuracy", "0.1"), "needs a scene of dimension 2, got fish_3d"),
    ],
)
def test_what_is_of_the_plane_only_is_refused(capsys, tmp_path, name, arguments, text):
    place = "--output" if name == "visualise" else "--record"
    done = call_script(capsys, name, "--scene", "fish_3d", *arguments, place, tmp_path / "x.rrd")
    done.assert_refused(text)
    assert not list(tmp_path.iterdir())


def test_pictures_of_the_plane_refuse_runs_in_space():
    run = RUNS["one step"]()
    text = "this picture needs a scene of dimension 2, got eel_3d of dimension 3"
    for draw in (draw_kymographs, draw_torques, draw_energy, draw_paths):
        with refuses(SceneError, text):
            draw({"eel": run})
    with refuses(SceneError, text):
        draw_gaits({"eel": run}, {"eel": None})
    with refuses(SceneError, "a picture with a target needs a scene of dimension 2"):
        draw_path(run, target=(1.0, 0.0))
