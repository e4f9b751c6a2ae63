"""Still pictures of trajectories, in one style: SI units on every axis, colour-blind safe.

Drawn with matplotlib's object interface, so nothing global is touched and no window opens.
"""

from __future__ import annotations

import importlib.util
import os
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SwimError
from swim_env.files import write_atomically
from swim_env.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_path", "draw_wave_search", "require_matplotlib", "save_figure"]

#: Runs through colours that differ in lightness as well, from the beginning to the end of a run.
TIME_COLOURS = "viridis"
BLUE, ORANGE, GREY = "#0072B2", "#D55E00", "#666666"
SMALL = 8


def require_matplotlib() -> None:
    """Refuse to go on without matplotlib.

    Raises
    ------
    SwimError
        If it is not installed; the message says how to get it.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise SwimError(
            "pictures need matplotlib: install the extra 'view' (pip install 'swim-env[view]')"
        )


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of that size (inches), 150 pixels an inch."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a picture as PNG, whole or not at all.

    Raises
    ------
    SwimError
        If the file cannot be written.
    """

    def write(file: IO[bytes]) -> None:
        figure.savefig(file, format="png")

    try:
        write_atomically(path, write)
    except OSError as error:
        raise SwimError(
            f"cannot write the picture: {error.strerror or error} ({os.fspath(path)})"
        ) from None


def draw_path(trajectory: Trajectory, shapes: int = 6) -> Figure:
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

    Returns
    -------
    matplotlib.figure.Figure
        The picture; `save_figure` writes it.

    Raises
    ------
    SwimError
        If matplotlib is not installed.
    """
    require_matplotlib()
    from matplotlib import colormaps

    instants = np.unique(np.linspace(0, trajectory.steps, shapes).round().astype(int))
    colours = colormaps[TIME_COLOURS](np.linspace(0.0, 0.88, len(instants)))
    figure = new_figure(8.0, 6.4)
    rows = figure.add_gridspec(2, 2, height_ratios=(1.0, 1.25))
    plane = figure.add_subplot(rows[0, :])
    _draw_in_plane(plane, trajectory, instants, colours)
    _draw_apart(figure.add_subplot(rows[1, 0]), trajectory, instants, colours)
    _draw_displacement(figure.add_subplot(rows[1, 1]), trajectory)
    figure.suptitle(_title(trajectory), fontsize=10)
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


def style_axes(axes: Axes, x: str, y: str) -> None:
    """Label axes, in the size and with the frame that all pictures have."""
    axes.set_xlabel(x, fontsize=SMALL)
    axes.set_ylabel(y, fontsize=SMALL)
    axes.tick_params(labelsize=SMALL)
    axes.spines[["top", "right"]].set_visible(False)


def _draw_in_plane(
    axes: Axes, trajectory: Trajectory, instants: NDArray[np.int64], colours: Any
) -> None:
    """Draw shapes where they were, with directors, and the path of the mean centre."""
    beam = trajectory.scene.beam
    nodes = trajectory.nodes
    director = 0.4 * beam.element_length
    for colour, n in zip(colours, instants, strict=True):
        label = f"{trajectory.time[n]:g} s"
        axes.plot(*nodes[n].T, color=colour, linewidth=1.6, label=label, zorder=2)
        axes.plot(*nodes[n, 0], "o", color=colour, markersize=3.5, zorder=3)
        normals = np.stack([-np.sin(trajectory.angles[n]), np.cos(trajectory.angles[n])], axis=-1)
        tips = trajectory.centres[n] + director * normals
        segments = np.stack([trajectory.centres[n], tips], axis=1)
        for segment in segments:
            axes.plot(*segment.T, color=colour, linewidth=0.6, alpha=0.7, zorder=1)
    axes.plot(*trajectory.path.T, color=GREY, linewidth=0.8, label="mean centre", zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.04, 0.15)
    axes.legend(fontsize=SMALL - 1, ncols=4, frameon=False, loc="lower right")
    axes.set_title("centre line and normal directors (dot: head)", fontsize=SMALL, loc="left")
    style_axes(axes, "x (m)", "y (m)")


def _draw_apart(
    axes: Axes, trajectory: Trajectory, instants: NDArray[np.int64], colours: Any
) -> None:
    """Draw the same shapes with a shift downwards that grows with time."""
    nodes = trajectory.nodes
    moved = nodes[instants] - nodes[instants].mean(axis=1, keepdims=True)
    step = 1.2 * max(float(np.ptp(moved[..., 1], axis=1).max()), 0.1 * trajectory.scene.beam.length)
    for row, (colour, n) in enumerate(zip(colours, instants, strict=True)):
        shape = moved[row] + [nodes[n, :, 0].mean(), -row * step]
        axes.plot(*shape.T, color=colour, linewidth=2.0)
        axes.plot(*shape[0], "o", color=colour, markersize=4)
    start = float(trajectory.path[0, 0])
    axes.axvline(start, color=GREY, linewidth=0.6, linestyle=":")
    axes.set_yticks(-step * np.arange(len(instants)), [f"{trajectory.time[n]:g}" for n in instants])
    axes.set_title(
        "shapes moved apart, bending enlarged (dotted: start)", fontsize=SMALL, loc="left"
    )
    style_axes(axes, "x (m)", "time (s)")


def _draw_displacement(axes: Axes, trajectory: Trajectory) -> None:
    """Draw the displacement of the mean centre over time."""
    net = (trajectory.path - trajectory.path[0]) / trajectory.scene.beam.length
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    axes.plot(trajectory.time, net[:, 0], color=BLUE, linewidth=1.2, label="along x")
    axes.plot(trajectory.time, net[:, 1], color=ORANGE, linewidth=1.2, label="along y")
    axes.legend(fontsize=SMALL, frameon=False)
    axes.set_title("displacement of the mean centre", fontsize=SMALL, loc="left")
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
    require_matplotlib()
    grid = record["search"]["grid"]
    values = np.array(grid["net_displacement"])
    figure = new_figure(6.4, 4.2)
    axes = figure.add_subplot()
    largest = float(np.abs(values).max()) or 1.0
    image = axes.pcolormesh(
        np.array(grid["wave_number"]) / np.pi,
        grid["frequency_hz"],
        values,
        cmap="PuOr_r",
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
            color="black",
            markersize=11,
            markerfacecolor="white",
            label=f"tuned wave, {record['net_displacement']:.2f} body lengths",
        )
        axes.legend(fontsize=SMALL, loc="lower left")
    style_axes(axes, "wave number \u03ba (\u03c0 rad per body length)", "frequency (Hz)")
    axes.set_title(
        f"{record['scene']}: a wave of full torque over one episode", fontsize=SMALL, loc="left"
    )
    return figure
