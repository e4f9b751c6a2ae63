"""Still pictures: their numbers are the trajectory's, everything has a unit, nothing overlaps."""

import itertools
import sys
from collections.abc import Callable
from typing import Any
from unittest import mock

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.text import Text
from numpy.typing import NDArray

from studies.gallery.pictures import draw_learning, draw_pareto, pareto_front
from swim_env import Simulator, SwimError, Trajectory, load_scene
from swim_env.analysis.energy import split_energy
from swim_env.colours import torque_colours
from swim_env.plots import (
    draw_energy,
    draw_gaits,
    draw_kymographs,
    draw_path,
    draw_paths,
    draw_scores,
    draw_torques,
    draw_training,
    draw_wave_search,
)
from swim_env.plots.heat_maps import curvature
from swim_env.plots.style import diverging_map, policy_looks
from tests.support import refuses

Array = NDArray[np.float64]

EIGHT = (
    "paper_wave",
    "tuned_wave",
    *(f"{kind}_forward/seed_{seed}" for kind in ("ppo", "sac") for seed in range(3)),
)
#: A picture is shown this wide on a page (pixels), and text must then be this high.
PAGE, READABLE = 800, 9.0


def played(name: str, steps: int, strength: float = 1.0, **changes: Any) -> Trajectory:
    """Return a run under a wave of torque near the first resonance."""
    scene = load_scene(name, {"actuation.frequency": 30.0, **changes})
    simulator = Simulator(scene)
    return simulator.rollout(strength * simulator.prescribed_torques(steps))


@pytest.fixture(scope="module")
def run() -> Trajectory:
    return played("swimmer", 500)


@pytest.fixture(scope="module")
def runs(run: Trajectory) -> dict[str, Trajectory]:
    return {"tuned_wave": run, "ppo_forward": played("swimmer", 300, 0.5)}


def lines_of(axes: Axes, label: str) -> tuple[Array, Array]:
    """Return the numbers of the one line with a label."""
    (line,) = [line for line in axes.get_lines() if line.get_label() == label]
    return np.asarray(line.get_xdata()), np.asarray(line.get_ydata())


# ---- the numbers in the pictures ---------------------------------------------------------------


def test_maps_show_the_last_second_on_one_scale(runs):
    run = runs["tuned_wave"]
    shown = 200  # steps in a second
    assert curvature(run)[300, 4] == pytest.approx(9.0 * (run.angles[300, 5] - run.angles[300, 4]))
    for draw, values in (
        (draw_kymographs, lambda run: curvature(run)[1:]),
        (draw_torques, lambda run: run.torques),
    ):
        figure = draw(runs, seconds=1.0)
        *panels, bar = figure.axes
        limits = {panel.images[0].get_clim() for panel in panels}
        largest = max(np.abs(values(run)[-shown:]).max() for run in runs.values())
        assert limits == {(-largest, largest)}
        for panel, (name, run) in zip(panels, runs.items(), strict=True):
            assert np.array_equal(panel.images[0].get_array(), values(run)[-shown:].T)
            left, right, bottom, top = panel.images[0].get_extent()
            assert (left, right) == pytest.approx((run.duration - 1.0, run.duration))
            assert (bottom, top) == (8.5, 0.5)
            assert panel.get_title(loc="left").startswith(f"{name}, largest ")
        assert bar.get_ylabel() in ("curvature (1/m)", "joint torque (N m)")


def test_a_path_shows_shapes_where_they_were():
    """Shapes of a body that travels stand where they were, with a director at every centre."""
    scene = load_scene("paper_xi", {"initial.velocity": [0.5, 0.0]})
    run = Simulator(scene).rollout(np.zeros((200, scene.beam.elements - 1)))
    figure = draw_path(run, shapes=5, name="somebody", target=(2.0, 0.3), radius=0.1)
    plane, net, _ = figure.axes
    directors = [item for item in plane.collections if isinstance(item, LineCollection)]
    for number, n in enumerate((0, 50, 100, 150, 200)):
        label = f"{run.time[n]:.3g} s"
        assert np.array_equal(np.stack(lines_of(plane, label), axis=-1), run.nodes[n])
        segments = np.array(directors[number].get_segments())
        assert segments[:, 0] == pytest.approx(run.centres[n])
        along = np.stack([np.cos(run.angles[n]), np.sin(run.angles[n])], axis=-1)
        assert np.sum(along * (segments[:, 1] - segments[:, 0]), axis=1) == pytest.approx(0.0)
    assert np.array_equal(np.stack(lines_of(plane, "mean centre"), axis=-1), run.path)
    assert [float(at[0]) for at in lines_of(plane, "target")] == [2.0, 0.3]
    (circle,) = [patch for patch in plane.patches if isinstance(patch, Circle)]
    assert circle.get_radius() == 0.1
    (left, right), (low, high) = plane.get_xlim(), plane.get_ylim()
    assert left < run.nodes[..., 0].min() < run.nodes[..., 0].max() < right
    assert low < -0.0 < 0.4 < high
    assert plane.get_aspect() == 1.0
    assert lines_of(net, "along x")[1] == pytest.approx(run.path[:, 0] - run.path[0, 0])
    assert figure.get_suptitle().startswith("somebody on paper_xi: 2 s")


def test_what_cannot_be_drawn_is_refused(run):
    still = Simulator("swimmer").rollout(np.zeros((0, 8)))
    for draw in (draw_kymographs, draw_torques, draw_energy):
        with pytest.raises(SwimError, match="nothing to draw"):
            draw({})
        with pytest.raises(SwimError, match="without steps"):
            draw({"run": run, "still": still})
    with pytest.raises(SwimError, match="nothing to draw"):
        draw_pareto({"zero": [Simulator("swimmer").rollout(np.zeros((5, 8)))]})


def test_shapes_of_a_slow_swimmer_are_moved_apart(run):
    figure = draw_path(run, shapes=4)
    plane = figure.axes[0]
    tops = []
    for n in (0, 167, 333, 500):
        x, y = lines_of(plane, f"{run.time[n]:.3g} s")
        assert np.array_equal(x, run.nodes[n, :, 0])
        assert np.ptp(y) == pytest.approx(np.ptp(run.nodes[n, :, 1]))
        tops.append(y[0] - run.nodes[n, 0, 1])
    steps = np.diff(tops)
    assert (steps < -0.05).all()
    assert steps == pytest.approx(steps[0])
    assert f"moved apart by {-steps[0]:.2g} m" in figure.get_suptitle()


def test_the_budget_shows_the_parts_and_what_is_left(run):
    start = Simulator(run.scene).velocity()
    parts, spent, drift = draw_energy({"tuned_wave": run}, {"tuned_wave": start}).axes
    labels = [layer.get_label() for layer in parts.collections]
    assert labels == ["elastic", "kinetic, fluid", "kinetic, body"]
    tops = [layer.get_paths()[0].vertices[:, 1].max() for layer in parts.collections]
    shown = np.arange(300, 501)
    split = split_energy(run, start, shown)
    assert tops[0] == pytest.approx(split.elastic.max())
    assert tops[1] == pytest.approx((split.elastic + split.fluid).max())
    assert tops[2] == pytest.approx(run.energy[shown].max())
    assert lines_of(parts, "total")[1] == pytest.approx(run.energy[shown])
    assert lines_of(spent, "work of the torques")[1][-1] == pytest.approx(run.work.sum())
    assert lines_of(spent, "dissipated")[1][-1] == pytest.approx(run.dissipated.sum())
    assert lines_of(spent, "energy gained")[1][-1] == pytest.approx(run.energy[-1] - run.energy[0])
    whole = draw_energy({"tuned_wave": run}).axes[0]
    labels = [layer.get_label() for layer in whole.collections]
    assert labels == ["elastic", "kinetic, body and fluid"]
    assert whole.collections[1].get_paths()[0].vertices[:, 1].max() == pytest.approx(tops[2])
    band = drift.collections[0].get_paths()[0].vertices[:, 1]
    assert np.abs(band).max() == pytest.approx(100.0 * run.energy_drift)


def test_the_front_is_what_nothing_beats():
    random = np.random.default_rng(3)
    for _ in range(20):
        costs, gains = random.integers(0, 6, (2, 9)).astype(float)
        front = pareto_front(costs.tolist(), gains.tolist())
        no_worse = (costs[None] <= costs[:, None]) & (gains[None] >= gains[:, None])
        same = (costs[None] == costs[:, None]) & (gains[None] == gains[:, None])
        for i in range(9):
            # One of equals is on it unless another beats them.
            assert bool(same[i, front].any()) is not bool((no_worse[i] & ~same[i]).any())
        assert sorted(costs[front]) == costs[front].tolist()


def test_the_pareto_plot_holds_work_and_displacement():
    strengths = (0.3, 0.6, 1.0)
    some = [played("swimmer", 800, share) for share in strengths]
    backwards = played("swimmer", 40)
    axes = draw_pareto(
        {"tuned_wave": some, "paper_wave": [backwards]},
        {"tuned_wave": [False, True, True], "paper_wave": [False]},
    ).axes[0]
    ahead = [-run.displacement[0] / run.scene.beam.length for run in some]
    work = [run.positive_work.sum() for run in some]
    assert min(ahead) > 0.0
    full, hollow = (
        np.array(line.get_xydata())
        for line in axes.get_lines()
        if line.get_linestyle() == "None" and line.get_marker() == "o" and len(line.get_xydata())
    )
    assert full == pytest.approx(np.stack([work, ahead], axis=-1)[1:])
    assert hollow == pytest.approx(np.stack([work, ahead], axis=-1)[:1])
    x, y = lines_of(axes, "front: no run goes as far for less")
    assert x == pytest.approx(work[1:])
    assert y == pytest.approx(ahead[1:])
    names = [text.get_text() for text in axes.get_legend().get_texts()]
    assert "hollow: a finer computation disagrees" in names


def curve(values: list[float], every: float = 1e5) -> dict[str, list[float]]:
    """Return the columns of an evaluations.csv."""
    steps = [every * i for i in range(len(values))]
    return {
        "steps": steps,
        "seconds": [1e-3 * step for step in steps],
        "net_displacement_median": values,
        "net_displacement_min": [value - 0.1 for value in values],
        "net_displacement_max": [value + 0.1 for value in values],
        "success_rate": [min(1.0, 0.2 * value) for value in values],
    }


CURVES = [curve([0.0, 1.0, 3.0, 4.0]), curve([0.0, 2.0, 2.0]), curve([0.0, 3.0, 4.0, 4.5])]


def test_learning_has_the_median_and_the_spread_over_seeds():
    left, right = draw_learning(
        {"ppo_forward": CURVES}, {"ppo_target": CURVES[:1]}, ("tuned_wave", 2.4)
    ).axes
    x, y = lines_of(left, "ppo_forward, 3 seeds")
    assert x == pytest.approx([0.0, 0.1, 0.2])  # where all seeds have been
    assert y == pytest.approx([0.0, 2.0, 3.0])
    band = left.collections[0].get_paths()[0].vertices
    assert (band[:, 1].min(), band[:, 1].max()) == (0.0, 4.0)
    assert lines_of(left, "tuned_wave")[1] == pytest.approx([2.4, 2.4])
    assert lines_of(right, "ppo_target, 1 seed")[1] == pytest.approx([0.0, 20.0, 60.0, 80.0])
    assert not right.collections


def test_every_policy_is_shown(run):
    """Eight policies have eight rows in both pictures of a comparison."""
    eight = dict.fromkeys(EIGHT, run)
    figure = draw_paths(eight)
    assert [axes.get_ylabel() for axes in figure.axes[1:]] == list(EIGHT)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == list(EIGHT)
    figure = draw_gaits(eight, dict.fromkeys(EIGHT))
    told = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert told == list(EIGHT)
    assert sum(bool(axes.images) for axes in figure.axes) == 16


# ---- the style ---------------------------------------------------------------------------------


def test_a_policy_has_one_colour_everywhere():
    every = policy_looks(EIGHT)
    assert policy_looks(["sac_forward"])["sac_forward"]["color"] == every[EIGHT[-1]]["color"]
    assert len({look["color"] for look in every.values()}) == 4
    assert len({(look["color"], look["linestyle"]) for look in every.values()}) == 8
    own = policy_looks(["mine", "theirs"])
    assert own["mine"]["color"] != own["theirs"]["color"]


#: How colours look without the cones for green, for red, and for blue, on linear light (Machado,
#: Oliveira & Fernandes 2009, severity 1).
BLIND = {
    "deuteranopia": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "protanopia": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "tritanopia": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}


def seen(colours: Array, kind: str) -> Array:
    """Return colours (n, 3) of sRGB in CIE L*a*b* as they look to somebody."""
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    linear = np.clip(linear @ np.array(BLIND[kind]).T, 0.0, 1.0)
    to_xyz = np.array(
        [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    )
    shares = linear @ to_xyz.T / (0.9505, 1.0, 1.089)
    f = np.where(shares > 0.008856, np.cbrt(shares), 7.787 * shares + 16.0 / 116.0)
    return np.stack(
        [116.0 * f[:, 1] - 16.0, 500.0 * (f[:, 0] - f[:, 1]), 200.0 * (f[:, 1] - f[:, 2])], axis=-1
    )


@pytest.mark.parametrize("kind", BLIND)
def test_colours_are_told_apart_by_the_colour_blind(kind):
    """Policies that stand beside each other, and both ends of the map of signs."""
    from matplotlib.colors import to_rgb

    names = ("paper_wave", "tuned_wave", "ppo_forward", "sac_forward", "ppo_target")
    colours = np.array([to_rgb(look["color"]) for look in policy_looks(names).values()])
    for a, b in itertools.combinations(seen(colours, kind), 2):
        assert np.linalg.norm(a - b) > 10.0
    # Blue below zero and orange above as in frames, near white at zero, clipped beyond one.
    low, middle, high, beyond = torque_colours([-1.0, 0.0, 1.0, 7.0]).astype(int)
    ours = (255.0 * diverging_map()([0.0, 0.5, 1.0])[:, :3]).round()
    assert np.abs(ours - [low, middle, high]).max() <= 2 and (beyond == high).all()
    assert low[2] > low[0] + 100 and high[0] > high[2] + 100 and middle.min() >= 240
    shades = seen(diverging_map()(np.linspace(0.0, 1.0, 21))[:, :3], kind)
    assert np.linalg.norm(shades[0] - shades[-1]) > 40.0
    assert (np.diff(shades[:11, 0]) > 0.0).all()  # lightest in the middle
    assert (np.diff(shades[10:, 0]) < 0.0).all()


# ---- text --------------------------------------------------------------------------------------


def check_texts(figure: Figure) -> None:
    """Check that no text overlaps another or leaves the picture, and that all can be read."""
    drawn: list[Text] = []
    with mock.patch.object(Text, "draw", lambda text, renderer: drawn.append(text)):
        figure.canvas.draw()
    width, height = figure.bbox.size
    least = READABLE * width / PAGE * 72.0 / figure.dpi
    boxes = []
    for text in dict.fromkeys(drawn):
        if not text.get_visible() or not text.get_text().strip():
            continue
        assert text.get_fontsize() >= least, f"{text.get_text()!r} is too small"
        box = text.get_window_extent().padded(-1.5)
        assert box.x0 >= 0.0 and box.y0 >= 0.0, text.get_text()
        assert box.x1 <= width and box.y1 <= height, text.get_text()
        boxes.append((text.get_text(), box))
    assert len(boxes) > 5
    for (first, a), (second, b) in itertools.combinations(boxes, 2):
        assert not a.overlaps(b), f"{first!r} overlaps {second!r}"


GAIT = {"phase_lags": np.linspace(0.5, 4.5, 8), "frequency": 4.88, "travelling_share": 0.9}
SCORE = {
    "score": [2.0, 2.2],
    "closed_score": [2.1, 1.0],
    "verified": [True, False],
    "median": {"score": 2.1},
    "ratio_to_tuned_wave": 0.9,
}
SCORES = {
    "policies": dict.fromkeys(EIGHT, SCORE),
    "score": "net displacement (BL)",
    "duration": 20.0,
    "scene": "swimmer",
}
GRID = {
    "net_displacement": [[0.1, -0.2], [2.0, 0.4], [0.0, 0.3]],
    "wave_number": [-3.0, 6.0],
    "frequency_hz": [1.0, 2.0, 3.0],
}
SEARCH = {
    "search": {"grid": GRID},
    "wave": {"wave_number": 6.0, "frequency": 12.0},
    "net_displacement": 2.4,
    "scene": "swimmer",
}
PICTURES: dict[str, Callable[[dict[str, Trajectory]], Figure]] = {
    "path": lambda runs: draw_path(runs["tuned_wave"], 11),
    "kymographs": draw_kymographs,
    "torques": draw_torques,
    "energy": draw_energy,
    "pareto": lambda runs: draw_pareto({name: [run] for name, run in runs.items()}),
    "learning": lambda runs: draw_learning(
        {"ppo_forward": CURVES, "sac_forward": CURVES[:2]}, {"ppo_target": CURVES}, ("zero", 2.0)
    ),
    "training": lambda runs: draw_training({"ppo_forward": CURVES}),
    "paths": lambda runs: draw_paths(dict.fromkeys(EIGHT, runs["tuned_wave"])),
    "gaits": lambda runs: draw_gaits(
        dict.fromkeys(EIGHT, runs["tuned_wave"]), dict.fromkeys(EIGHT, GAIT)
    ),
    "scores": lambda runs: draw_scores(SCORES),
    "search": lambda runs: draw_wave_search(SEARCH),
}


@pytest.mark.parametrize("name", PICTURES)
def test_without_matplotlib_a_picture_says_what_to_install(name, runs, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with refuses(SwimError, "pictures need matplotlib: install the extra 'view'"):
        PICTURES[name](runs)


@pytest.mark.parametrize("name", PICTURES)
def test_texts_can_be_read_and_numbers_have_units(name, runs):
    """No text overlaps; every axis with numbers says of what, in which unit."""
    figure = PICTURES[name](runs)
    check_texts(figure)
    labels = {label for axes in figure.axes for label in (axes.get_xlabel(), axes.get_ylabel())}
    units = ("(s)", "(m)", "(BL)", "(J)", "(%)", "(N m)", "(1/m)", "(rad)", "(Hz)", "(\u00b0)")
    plain = ("body lengths", "body length)", "joint", "s/l", "millions", "minutes", *EIGHT)
    for label in labels - {""}:
        assert any(unit in label for unit in (*units, *plain)), label


@pytest.mark.parametrize("hertz", [0.7, 1.0, 3.0])
def test_a_turn_is_shown_in_whole_waves(hertz):
    """A body that swings and does not turn has a straight mean, whatever its frequency."""
    scene = load_scene("paper_i", {"actuation.frequency": 2.0 * np.pi * hertz})
    simulator = Simulator(scene)
    run = simulator.rollout(simulator.prescribed_torques(2000))
    turn = draw_path(run).axes[2]
    middle = turn.get_lines()[-1].get_ydata()
    angles = np.degrees(run.angles.mean(axis=1))
    assert np.ptp(np.asarray(middle)) < 0.02 * np.ptp(angles)
