"""The paper's Figs. 3 to 8 redrawn from our runs, in its style: directors at every centre."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swim_env.plots import style
from swim_env.plots.style import GREY, SMALL, TIME_COLOURS, name_panel, new_figure, style_axes
from swim_env.scene import load_scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Arrays = Mapping[str, NDArray[Any]]
Run = Mapping[str, Any]

#: The paper's figures of configurations: scenes from top to bottom, and the seconds between shapes.
PAPER_FIGURES: dict[str, tuple[tuple[str, ...], int]] = {
    "fig4": (("i", "ii", "iii"), 20),
    "fig5": (("iv", "v"), 20),
    "fig6": (("vi", "vii"), 20),
    "fig7": (("viii", "ix"), 20),
    "fig8": (("x", "xi", "xii"), 10),
}
#: Colours of lines in the order in which they are taken.
LINES = (style.BLUE, style.ORANGE, style.GREEN, style.PINK, style.AMBER, style.SKY, style.BLACK)
#: A swimmer that covers less than this (body lengths) hides its own track: shapes are moved apart.
_COVERED = 0.7
#: How far apart (body lengths), and the length of a director (element lengths).
_APART, _DIRECTOR = 0.075, 0.4
#: A heading that turns by less than this (°) does not turn.
_TURN = 1.0


def draw_torques(arrays: Arrays) -> Figure:
    """Draw Fig. 3, the torque at every joint over the last second of scene i."""
    from matplotlib import colormaps

    torque = arrays["torque"]
    count = torque.shape[1]
    time = np.arange(len(torque)) / len(torque)
    figure = new_figure(6.2, 2.6)
    axes = figure.add_subplot()
    colours = colormaps[TIME_COLOURS](np.linspace(0.0, 0.88, count))
    for j in range(count):
        label = f"s = {(j + 1) / (count + 1):.2f} l"
        axes.plot(time, torque[:, j], color=colours[j], linewidth=1.2, label=label)
    figure.legend(loc="outside right upper", fontsize=SMALL - 1, frameon=False)
    words = "torques between the elements of scene i (s from the head, l the length)"
    name_panel(axes, f"Fig. 3, {words}")
    style_axes(axes, "time in the last second (s)", "torque (N m)")
    return figure


class _Shapes:
    """The shapes of a scene that are drawn, moved apart where they would hide each other."""

    def __init__(self, scene: str, run: Run, arrays: Arrays, between: int) -> None:
        times, middle = arrays["time"], arrays["nodes"].mean(axis=1)
        self.length = float(run["length"])
        self.half_thickness = load_scene(f"paper_{scene}").beam.half_thickness
        self.is_apart = bool(np.ptp(middle, axis=0).max() < _COVERED * self.length)
        instants = slice(None, None, min(between, max(1, len(times) // 4)))
        self.times, self.angles = times[instants], arrays["angles"][instants]
        self.nodes = arrays["nodes"][instants].copy()
        if self.is_apart:
            self.nodes[..., 1] -= _APART * self.length * np.arange(len(self.times))[:, None]
        #: Of all instants, from left to right.
        self.reach = arrays["nodes"][..., 0].min(), arrays["nodes"][..., 0].max()

    @property
    def height(self) -> float:
        """How high (inches) the axes should be at true scale in the left column."""
        width, height = np.ptp(self.nodes.reshape(-1, 2), axis=0)
        return float(np.clip(5.4 * height / width + 0.6, 1.2, 3.4))


def draw_configurations(name: str, runs: Mapping[str, tuple[Run, Arrays]]) -> Figure:
    """Draw one of `PAPER_FIGURES`: bodies with both directors, and how the heading turns.

    ``runs`` are figures and arrays of `studies.paper.runs.play_run` by scene.
    """
    numerals, between = PAPER_FIGURES[name]
    scenes = {one: _Shapes(one, *runs[one], between) for one in numerals if one in runs}
    heights = [shapes.height for shapes in scenes.values()]
    apart = [shapes.reach for shapes in scenes.values() if shapes.is_apart]
    if len(apart) == len(scenes):
        heights = [max(heights)] * len(heights)
    turned = {one: _turned(runs[one][0]) for one in scenes}
    # A panel of its own only where something turns: else the titles say by how much.
    turns = max(float(np.abs(one).max()) for one in turned.values()) > _TURN
    figure = new_figure(8.6 if turns else 6.3, max(2.6, min(8.0, 0.9 + sum(heights))))
    widths = (2.5, 1.0) if turns else (1.0,)
    grid = figure.add_gridspec(len(scenes), len(widths), width_ratios=widths, height_ratios=heights)
    for row, (scene, shapes) in enumerate(scenes.items()):
        axes = figure.add_subplot(grid[row, 0])
        _draw_scene(axes, scene, shapes, "" if turns else _words(turned[scene]))
        if shapes.is_apart:
            # The same piece of x for all, so that ways can be compared.
            left, right = min(low for low, _ in apart), max(high for _, high in apart)
            axes.update_datalim([(left, 0.0), (right, 0.0)])
            axes.autoscale_view()
    if turns:
        _draw_turning(figure.add_subplot(grid[:, 1]), turned)
    figure.suptitle(f"Fig. {name[-1]}, configurations of our runs", fontsize=SMALL + 1)
    return figure


def _turned(run: Run) -> NDArray[np.float64]:
    """Return by how much the heading has turned in each second's mean (°), left positive."""
    turned: NDArray[np.float64] = np.degrees(np.array(run["heading"]) - run["heading"][0])
    return turned


def _words(turned: NDArray[np.float64]) -> str:
    return f", heading turns by {float(np.abs(turned).max()):.1g}° at most"


def _draw_scene(axes: Axes, scene: str, shapes: _Shapes, turn: str) -> None:
    """Draw shapes with both directors at every element's centre; `turn` ends the title."""
    from matplotlib import colormaps
    from matplotlib.collections import LineCollection

    colours = colormaps[TIME_COLOURS](np.linspace(0.0, 0.88, len(shapes.times)))
    arm = min(_DIRECTOR / shapes.angles.shape[1], 0.045) * shapes.length
    for shape, angle, colour in zip(shapes.nodes, shapes.angles, colours, strict=True):
        style.draw_body(axes, shape, shapes.half_thickness, colour)
        centres = 0.5 * (shape[:-1] + shape[1:])
        tangents = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        normals = np.stack([-tangents[:, 1], tangents[:, 0]], axis=-1)
        for direction, width in ((normals, 0.7), (tangents, 1.8)):
            ends = np.stack([centres, centres + arm * direction], axis=1)
            lines = LineCollection(list(ends), colors=[colour], linewidths=width, zorder=3)
            axes.add_collection(lines)
    _label_instants(axes, shapes, colours)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06, 0.12)
    note = ""
    if shapes.is_apart:
        note = f", shapes moved apart by {_APART * shapes.length:.2g} m"
        axes.set_yticks([])
    name_panel(axes, f"{scene}){note}{turn}".replace("),", ")"))
    style_axes(axes, "x (m)", "" if note else "y (m)")
    # Where shapes are moved apart there is no scale.
    axes.spines["left"].set_visible(not note)


def _label_instants(axes: Axes, shapes: _Shapes, colours: NDArray[Any]) -> None:
    """Name shapes, each at its tail; where they overlap above its head, beyond what covers it."""
    length = float(np.hypot(*np.diff(shapes.nodes[0], axis=0).T).sum())
    nodes = shapes.nodes.reshape(-1, 2)
    for shape, time, colour in zip(shapes.nodes, shapes.times, colours, strict=True):
        look = {"textcoords": "offset points", "fontsize": SMALL - 2, "color": colour}
        if shapes.is_apart:
            axes.annotate(f"{time:.0f} s", shape[-1], xytext=(5, 0), va="center", **look)
            continue
        near = np.abs(nodes[:, 0] - shape[0, 0]) < 0.25 * length
        top = float(nodes[near, 1].max())
        axes.plot([shape[0, 0]] * 2, [shape[0, 1], top], color=colour, linewidth=0.4, zorder=1)
        place = (float(shape[0, 0]), top)
        axes.annotate(f"{time:.0f} s", place, xytext=(0, 7), va="bottom", ha="center", **look)


def _draw_turning(axes: Axes, turned: Mapping[str, NDArray[np.float64]]) -> None:
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    for colour, stroke, (scene, way) in zip(LINES, ("-", "--", ":"), turned.items(), strict=False):
        seconds = 0.5 + np.arange(len(way))
        axes.plot(seconds, way, color=colour, linestyle=stroke, linewidth=1.4, label=scene)
    axes.legend(fontsize=SMALL - 1, frameon=False)
    name_panel(axes, "turn of the heading")
    style_axes(axes, "time (s)", "mean of a second (°), left positive")
