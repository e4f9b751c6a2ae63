"""The paper's Figs. 3 to 8 redrawn from our runs, in its style: directors at every centre."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swim_env.plots.style import (
    GREY,
    OKABE_ITO,
    SMALL,
    TIME_COLOURS,
    name_panel,
    new_figure,
    style_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["PAPER_FIGURES", "draw_configurations", "draw_torques"]

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
#: A swimmer that covers less than this (body lengths) hides its own track: shapes are moved apart.
_COVERED = 0.7
#: How far apart (body lengths), and the length of a director (element lengths).
_APART, _DIRECTOR = 0.075, 0.4


def draw_torques(arrays: Arrays) -> Figure:
    """Draw Fig. 3, the torque at every joint over the last second of a run.

    Parameters
    ----------
    arrays : mapping
        Of scene i; ``torque`` (T, N - 1) in N m, over one second.
    """
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
    name_panel(
        axes, "Fig. 3, torques between the elements of scene i (s from the head, l the length)"
    )
    style_axes(axes, "time in the last second (s)", "torque (N m)")
    return figure


def draw_configurations(name: str, runs: Mapping[str, tuple[Run, Arrays]]) -> Figure:
    """Draw one of Figs. 4 to 8: shapes with both directors, and beside them how the heading turns.

    Parameters
    ----------
    name : str
        A key of PAPER_FIGURES.
    runs : mapping
        By scene, figures and arrays of `studies.paper.runs.play_run`.
    """
    scenes, between = PAPER_FIGURES[name]
    scenes = tuple(scene for scene in scenes if scene in runs)
    heights = [_height(*runs[scene], between) for scene in scenes]
    if all(_is_apart(*runs[scene]) for scene in scenes):
        heights = [max(heights)] * len(heights)
    figure = new_figure(8.6, max(2.6, min(8.0, 0.9 + sum(heights))))
    grid = figure.add_gridspec(len(scenes), 2, width_ratios=(2.5, 1.0), height_ratios=heights)
    apart = [runs[scene][1]["nodes"][..., 0] for scene in scenes if _is_apart(*runs[scene])]
    for row, scene in enumerate(scenes):
        axes = figure.add_subplot(grid[row, 0])
        _draw_scene(axes, scene, *runs[scene], between)
        if _is_apart(*runs[scene]):
            # The same piece of x for all, so that ways can be compared.
            left, right = (min(x.min() for x in apart), max(x.max() for x in apart))
            axes.update_datalim([(left, 0.0), (right, 0.0)])
            axes.autoscale_view()
    _draw_turning(figure.add_subplot(grid[:, 1]), scenes, runs)
    figure.suptitle(f"Fig. {name[-1]}, configurations of our runs", fontsize=SMALL + 1)
    return figure


def _shown(arrays: Arrays, between: int) -> Sequence[int]:
    return list(range(0, len(arrays["time"]), min(between, max(1, len(arrays["time"]) // 4))))


def _is_apart(run: Run, arrays: Arrays) -> bool:
    middle = arrays["nodes"].mean(axis=1)
    return bool(np.ptp(middle, axis=0).max() < _COVERED * run["length"])


def _height(run: Run, arrays: Arrays, between: int) -> float:
    """Return how high (inches) a scene's axes should be at true scale in the left column."""
    shapes = _placed(run, arrays, _shown(arrays, between))
    width, height = np.ptp(shapes.reshape(-1, 2), axis=0)
    return float(np.clip(5.4 * height / width + 0.6, 1.2, 3.4))


def _placed(run: Run, arrays: Arrays, instants: Sequence[int]) -> NDArray[Any]:
    shapes: NDArray[Any] = arrays["nodes"][list(instants)].copy()
    if _is_apart(run, arrays):
        shapes[..., 1] -= _APART * run["length"] * np.arange(len(instants))[:, None]
    return shapes


def _draw_scene(axes: Axes, scene: str, run: Run, arrays: Arrays, between: int) -> None:
    """Draw shapes with both directors at every element's centre."""
    from matplotlib import colormaps
    from matplotlib.collections import LineCollection

    instants = _shown(arrays, between)
    shapes = _placed(run, arrays, instants)
    colours = colormaps[TIME_COLOURS](np.linspace(0.0, 0.88, len(instants)))
    elements = shapes.shape[1] - 1
    arm = min(_DIRECTOR / elements, 0.045) * run["length"]
    for n, shape, colour in zip(instants, shapes, colours, strict=True):
        axes.plot(*shape.T, color=colour, linewidth=1.3, zorder=2)
        axes.plot(*shape[0], "o", color=colour, markersize=3.5, zorder=3)
        centres = 0.5 * (shape[:-1] + shape[1:])
        angle = arrays["angles"][n]
        tangents = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        normals = np.stack([-tangents[:, 1], tangents[:, 0]], axis=-1)
        for direction, width in ((normals, 0.7), (tangents, 1.8)):
            ends = np.stack([centres, centres + arm * direction], axis=1)
            lines = LineCollection(list(ends), colors=[colour], linewidths=width, zorder=2)
            axes.add_collection(lines)
        if _is_apart(run, arrays):
            axes.annotate(
                f"{arrays['time'][n]:.0f} s",
                shape[-1],
                xytext=(5, 0),
                textcoords="offset points",
                fontsize=SMALL - 2,
                color=colour,
                va="center",
            )
    if not _is_apart(run, arrays):
        _label_instants(axes, shapes, arrays["time"][instants], colours)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06, 0.12)
    note = ""
    if _is_apart(run, arrays):
        note = f", shapes moved apart by {_APART * run['length']:.2g} m"
        axes.set_yticks([])
    name_panel(axes, f"{scene}) dot: head{note}")
    style_axes(axes, "x (m)", "" if note else "y (m)")
    # Where shapes are moved apart there is no scale.
    axes.spines["left"].set_visible(not note)


def _label_instants(
    axes: Axes, shapes: NDArray[Any], times: NDArray[Any], colours: NDArray[Any]
) -> None:
    """Name shapes that overlap, each above its head, beyond what any shape covers there."""
    length = float(np.hypot(*np.diff(shapes[0], axis=0).T).sum())
    nodes = shapes.reshape(-1, 2)
    for shape, time, colour in zip(shapes, times, colours, strict=True):
        near = np.abs(nodes[:, 0] - shape[0, 0]) < 0.25 * length
        top = float(nodes[near, 1].max())
        axes.plot([shape[0, 0]] * 2, [shape[0, 1], top], color=colour, linewidth=0.4, zorder=1)
        axes.annotate(
            f"{time:.0f} s",
            (float(shape[0, 0]), top),
            xytext=(0, 7),
            textcoords="offset points",
            fontsize=SMALL - 2,
            color=colour,
            va="bottom",
            ha="center",
        )


def _draw_turning(
    axes: Axes, scenes: Sequence[str], runs: Mapping[str, tuple[Run, Arrays]]
) -> None:
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    for colour, style, scene in zip(OKABE_ITO, ("-", "--", ":"), scenes, strict=False):
        run, _ = runs[scene]
        turned = np.degrees(np.array(run["heading"]) - run["heading"][0])
        seconds = 0.5 + np.arange(len(turned))
        axes.plot(seconds, turned, color=colour, linestyle=style, linewidth=1.4, label=scene)
    low, high = axes.get_ylim()
    # So that a turn of a thousandth of a degree does not look like a curve.
    axes.set_ylim(min(low, -1.5), max(high, 1.5))
    axes.legend(fontsize=SMALL - 1, frameon=False)
    name_panel(axes, "turn of the heading")
    style_axes(axes, "time (s)", "mean of a second (°), left positive")
