"""Pictures of one run: where it went, in which shapes; and of the search for the best wave."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.trajectory import Trajectory
from swim_env.viewer.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LINE,
    ORANGE,
    SMALL,
    SMALLER,
    THICK,
    THIN,
    TIME_COLOURS,
    WIDTH,
    diverging_map,
    name_panel,
    new_figure,
    style_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Those of the style are kept for modules that look for them here.
__all__ = [
    "BLUE",
    "GREY",
    "ORANGE",
    "SMALL",
    "TIME_COLOURS",
    "draw_path",
    "draw_wave_search",
    "new_figure",
    "style_axes",
]

Array = NDArray[np.float64]

#: Room for axes in a picture (inches): across, and above and below what they show.
_ACROSS, _AROUND = 7.1, 0.95
#: How low and how high the plane may become (inches).
_LOWEST, _HIGHEST = 0.9, 4.6
#: Length of a director (element lengths).
_DIRECTOR = 0.4


def draw_path(
    trajectory: Trajectory,
    shapes: int = 6,
    target: ArrayLike | None = None,
    radius: float = 0.0,
) -> Figure:
    """Draw where a run went: body shapes at intervals, as in the paper's Figs. 4 to 8.

    Above, the centre line at equal intervals of time in the plane, with the normal director at
    every element's centre and the path of the mean centre. Below, the same shapes moved apart by
    time, since a slow swimmer covers its own track, and the net displacement over time.

    Parameters
    ----------
    trajectory : Trajectory
        The run.
    shapes : int
        Number of shapes, the first and the last instant among them.
    target : (2,) array_like, optional
        A point (m) that was to be reached, ...
    radius : float
        ... this close (m).

    Returns
    -------
    matplotlib.figure.Figure
        The picture; `save_figure` writes it.

    Raises
    ------
    SwimError
        If matplotlib is not installed.
    """
    figure = new_figure(WIDTH, 1.0)
    from matplotlib import colormaps

    instants = np.unique(np.linspace(0, trajectory.steps, shapes).round().astype(int))
    colours = colormaps[TIME_COLOURS](np.linspace(0.0, 0.88, len(instants)))
    box = _box(trajectory, instants, target, radius)
    scale = _ACROSS / float(box[1, 0] - box[0, 0])
    height = float(np.clip(scale * (box[1, 1] - box[0, 1]), _LOWEST, _HIGHEST))
    figure.set_size_inches(WIDTH, height + _AROUND + 2.9)
    rows = figure.add_gridspec(2, 2, height_ratios=(height + _AROUND, 2.6))
    plane = figure.add_subplot(rows[0, :])
    _draw_in_plane(plane, trajectory, instants, colours)
    if target is not None:
        _draw_target(plane, np.asarray(target, dtype=np.float64), radius)
    _fit(plane, box, height)
    plane.legend(
        fontsize=SMALLER,
        frameon=False,
        ncols=len(instants) + 2,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        borderaxespad=0.1,
        handlelength=1.2,
        columnspacing=1.0,
    )
    _draw_apart(figure.add_subplot(rows[1, 0]), trajectory, instants, colours)
    _draw_displacement(figure.add_subplot(rows[1, 1]), trajectory)
    figure.suptitle(_title(trajectory), fontsize=SMALL + 1)
    return figure


def _title(trajectory: Trajectory) -> str:
    dx, dy = trajectory.displacement / trajectory.scene.beam.length
    text = (
        f"{trajectory.scene.name}: {trajectory.duration:g} s, net displacement "
        f"({dx:+.3g}, {dy:+.3g}) body lengths"
    )
    if trajectory.termination_reason:
        text += f", ended early: {trajectory.termination_reason}"
    return text


def _box(
    trajectory: Trajectory, instants: NDArray[np.int64], target: ArrayLike | None, radius: float
) -> Array:
    """Return the corners (m) of what the plane shows: lower left, upper right."""
    director = _DIRECTOR * trajectory.scene.beam.element_length
    points = [trajectory.nodes[instants].reshape(-1, 2), trajectory.path]
    low, high = (end(np.concatenate(points), axis=0) for end in (np.min, np.max))
    if target is not None:
        low = np.minimum(low, np.asarray(target) - radius)
        high = np.maximum(high, np.asarray(target) + radius)
    margin = director + 0.02 * float(high[0] - low[0])
    return np.array([low - margin, high + margin])


def _fit(axes: Axes, box: Array, height: float) -> None:
    """Show a box at one scale in axes of a known height, its middle in theirs."""
    size = box[1] - box[0]
    scale = min(_ACROSS / size[0], height / size[1])
    middle, half = 0.5 * (box[0] + box[1]), 0.5 * np.array([_ACROSS, height]) / scale
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    axes.set_aspect("equal", adjustable="datalim")


def _draw_in_plane(
    axes: Axes, trajectory: Trajectory, instants: NDArray[np.int64], colours: Any
) -> None:
    """Draw shapes where they were, with directors, and the path of the mean centre."""
    from matplotlib.collections import LineCollection

    nodes = trajectory.nodes
    director = _DIRECTOR * trajectory.scene.beam.element_length
    for colour, n in zip(colours, instants, strict=True):
        label = f"{trajectory.time[n]:g} s"
        axes.plot(*nodes[n].T, color=colour, linewidth=1.6, label=label, zorder=2)
        axes.plot(*nodes[n, 0], "o", color=colour, markersize=3.5, zorder=3)
        normals = np.stack([-np.sin(trajectory.angles[n]), np.cos(trajectory.angles[n])], axis=-1)
        tips = trajectory.centres[n] + director * normals
        lines = np.stack([trajectory.centres[n], tips], axis=1)
        axes.add_collection(
            LineCollection(list(lines), colors=[colour], linewidths=THIN, alpha=0.8, zorder=1)
        )
    axes.plot(*trajectory.path.T, color=GREY, linewidth=0.8, label="mean centre", zorder=4)
    style_axes(axes, "x (m)", "y (m)")


def _draw_target(axes: Axes, target: Array, radius: float) -> None:
    """Draw a target as the circle that counts as reached."""
    from matplotlib.patches import Circle

    axes.add_patch(
        Circle((target[0], target[1]), radius, facecolor=GREEN, alpha=0.25, linewidth=0, zorder=0)
    )
    axes.plot(*target, "*", color=GREEN, markersize=7, linestyle="", label="target", zorder=5)


def _draw_apart(
    axes: Axes, trajectory: Trajectory, instants: NDArray[np.int64], colours: Any
) -> None:
    """Draw the same shapes with a shift downwards that grows with time."""
    nodes = trajectory.nodes
    moved = nodes[instants] - nodes[instants].mean(axis=1, keepdims=True)
    step = 1.2 * max(float(np.ptp(moved[..., 1], axis=1).max()), 0.1 * trajectory.scene.beam.length)
    for row, (colour, n) in enumerate(zip(colours, instants, strict=True)):
        shape = moved[row] + [nodes[n, :, 0].mean(), -row * step]
        axes.plot(*shape.T, color=colour, linewidth=THICK)
        axes.plot(*shape[0], "o", color=colour, markersize=4)
    start = float(trajectory.path[0, 0])
    axes.axvline(start, color=GREY, linewidth=0.8, linestyle=":")
    axes.set_yticks(-step * np.arange(len(instants)), [f"{trajectory.time[n]:g}" for n in instants])
    name_panel(axes, "shapes moved apart, not to scale (dot: head, dotted: start)")
    style_axes(axes, "x (m)", "time (s)")


def _draw_displacement(axes: Axes, trajectory: Trajectory) -> None:
    """Draw the displacement of the mean centre over time."""
    net = (trajectory.path - trajectory.path[0]) / trajectory.scene.beam.length
    axes.axhline(0.0, color=GREY, linewidth=THIN)
    axes.plot(trajectory.time, net[:, 0], color=BLUE, linewidth=LINE, label="along x")
    axes.plot(trajectory.time, net[:, 1], color=ORANGE, linewidth=LINE, label="along y")
    axes.legend(fontsize=SMALL, frameon=False)
    name_panel(axes, "displacement of the mean centre")
    style_axes(axes, "time (s)", "displacement (body lengths)")


def draw_wave_search(record: dict[str, Any]) -> Figure:
    """Draw how far travelling waves of torque swim, over frequency and wave number.

    Parameters
    ----------
    record : dict
        From `agents.tuning.check_candidates`.

    Returns
    -------
    matplotlib.figure.Figure
        The grid of the search at full amplitude, and the wave that was chosen.

    Raises
    ------
    SwimError
        If matplotlib is not installed.
    """
    grid = record["search"]["grid"]
    values = np.array(grid["net_displacement"])
    figure = new_figure(0.8 * WIDTH, 4.2)
    axes = figure.add_subplot()
    largest = float(np.abs(values).max()) or 1.0
    image = axes.pcolormesh(
        np.array(grid["wave_number"]) / np.pi,
        grid["frequency_hz"],
        values,
        cmap=diverging_map(),
        vmin=-largest,
        vmax=largest,
        shading="nearest",
    )
    bar = figure.colorbar(image, ax=axes)
    bar.set_label("net displacement along the heading (body lengths)", fontsize=SMALL)
    bar.ax.tick_params(labelsize=SMALL)
    wave = record["wave"]
    if wave is not None:
        axes.plot(
            wave["wave_number"] / np.pi,
            wave["frequency"] / (2.0 * np.pi),
            "*",
            color=BLACK,
            markersize=11,
            markerfacecolor="white",
            label=f"tuned wave, {record['net_displacement']:.2f} body lengths",
        )
        axes.legend(fontsize=SMALL, loc="lower left")
    style_axes(axes, "wave number \u03ba (\u03c0 rad per body length)", "frequency (Hz)", grid=False)
    name_panel(axes, f"{record['scene']}: a wave of full torque over one episode")
    return figure
