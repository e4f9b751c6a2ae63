"""A picture of one run: where it went, and in which shapes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.plots import style
from swim_env.plots.spatial_stills import draw_spatial_path
from swim_env.scene import require_planar
from swim_env.sim.spatial.trajectory import SpatialTrajectory
from swim_env.sim.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_path"]

Array = NDArray[np.float64]

#: Room for axes in a picture (inches): across, and above and below what they show.
_ACROSS, _AROUND = 7.1, 0.95
#: How low and how high the plane may become (inches).
_LOWEST, _HIGHEST = 1.0, 4.6
#: Length of a director (element lengths).
_DIRECTOR = 0.4
#: Most pieces of time that a swing is shown in, and the fewest waves of a run that has a wave.
_PIECES, _FEWEST = 40, 3
#: A swimmer that covers less than this hides its own track: its shapes are moved apart, by at
#: least this (body lengths).
_COVERED, _APART = 0.4, 0.06


def draw_path(
    trajectory: Trajectory | SpatialTrajectory,
    shapes: int = 6,
    name: str = "",
    target: ArrayLike | None = None,
    radius: float = 0.0,
) -> Figure:
    """Draw where a run went: body shapes at intervals, as in the paper's Figs. 4 to 8.

    Above, the body at equal intervals of time in the plane, with the normal director at every
    element's centre and the path of the mean centre; a slow swimmer covers its own track, so
    its shapes are moved apart, downwards with time. Below, displacement and heading over time. A
    run in space is drawn from three sides, with its true sections and without a target.

    Parameters
    ----------
    trajectory : Trajectory or SpatialTrajectory
        The run.
    shapes : int
        Number of shapes, the first and the last instant among them.
    name : str
        What swims, for the title.
    target, radius : (2,) array_like, float, optional
        A point that was to be reached, and how close (m).
    """
    if isinstance(trajectory, SpatialTrajectory):
        if target is not None:
            require_planar(trajectory.scene, "a picture with a target")
        return draw_spatial_path(trajectory, shapes, name)
    figure = style.new_figure(style.WIDTH, 1.0)
    instants = np.unique(np.linspace(0, trajectory.steps, shapes).round().astype(int))
    colours = style.time_colours(len(instants))
    step = _step_apart(trajectory, instants) if target is None else 0.0
    # Shapes of a slow swimmer are moved down one after the other.
    down = step * np.arange(len(instants))[:, None, None] * np.array([0.0, 1.0])
    nodes, centres = trajectory.nodes[instants] - down, trajectory.centres[instants] - down
    shown = [nodes.reshape(-1, 2)] if step else [nodes.reshape(-1, 2), trajectory.path]
    if target is not None:
        shown.append(np.add.outer([-radius, radius], np.asarray(target)))
    points = np.concatenate(shown)
    box = np.array([points.min(axis=0), points.max(axis=0)])
    director = _DIRECTOR * trajectory.scene.beam.element_length
    half = trajectory.scene.beam.half_thickness
    margin = director + half + 0.02 * float(box[1, 0] - box[0, 0])
    box += np.array([[-margin], [margin]])
    scale = _ACROSS / float(box[1, 0] - box[0, 0])
    height = float(np.clip(scale * (box[1, 1] - box[0, 1]), _LOWEST, _HIGHEST))
    figure.set_size_inches(style.WIDTH, height + _AROUND + 2.3)
    rows = figure.add_gridspec(2, 2, height_ratios=(height + _AROUND, 2.0))
    plane = figure.add_subplot(rows[0, :])
    for row, n in enumerate(instants):
        label, angles = f"{trajectory.time[n]:.3g} s", trajectory.angles[n]
        style.draw_body(plane, nodes[row], half, colours[row], label)
        _draw_directors(plane, centres[row], angles, director, colours[row])
    if step:
        plane.set_yticks([])
    else:
        path = trajectory.path.T
        plane.plot(*path, color=style.GREY, linewidth=0.8, label="mean centre", zorder=4)
    style.style_axes(plane, "x (m)", "" if step else "y (m)")
    if target is not None:
        _draw_target(plane, np.asarray(target, dtype=np.float64), radius)
    style.show_plane(plane, box)
    style.add_legend(
        plane,
        ncols=len(instants) + 2,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        borderaxespad=0.1,
        handlelength=1.2,
        columnspacing=0.9,
    )
    _draw_displacement(figure.add_subplot(rows[1, 0]), trajectory)
    _draw_heading(figure.add_subplot(rows[1, 1]), trajectory)
    title = style.title_of(trajectory, name) + (
        f"; shapes moved apart by {step:.2g} m" if step else ""
    )
    figure.suptitle(style.literal(title), fontsize=style.SMALL + 1)
    # The limits of equal scales are known only now, and with them the widths of their numbers.
    figure.draw_without_rendering()
    return figure


def _step_apart(trajectory: Trajectory, instants: NDArray[np.int64]) -> float:
    """Return by how much each shape is moved down (m), 0 where none hides another."""
    length = trajectory.scene.beam.length
    if float(np.ptp(trajectory.path, axis=0).max()) >= _COVERED * length:
        return 0.0
    heights = np.ptp(trajectory.nodes[instants, :, 1], axis=1)
    return max(float(heights.max()), _APART * length)


def _draw_directors(
    axes: Axes, centres: Array, angles: Array, director: float, colour: Any
) -> None:
    """Draw the normal directors of a shape, of some length (m)."""
    from matplotlib.collections import LineCollection

    normals = np.stack([-np.sin(angles), np.cos(angles)], axis=-1)
    lines = list(np.stack([centres, centres + director * normals], axis=1))
    looks: dict[str, Any] = {"linewidths": style.THIN, "alpha": 0.8, "zorder": 1}
    axes.add_collection(LineCollection(lines, colors=[colour], **looks))


def _draw_target(axes: Axes, target: Array, radius: float) -> None:
    """Draw a target as the circle that counts as reached."""
    from matplotlib.patches import Circle

    centre, colour = (target[0], target[1]), style.GREEN
    axes.add_patch(Circle(centre, radius, facecolor=colour, alpha=0.25, linewidth=0, zorder=0))
    axes.plot(*target, "*", color=colour, markersize=7, linestyle="", label="target", zorder=5)


def _draw_displacement(axes: Axes, trajectory: Trajectory) -> None:
    """Draw the displacement of the mean centre over time."""
    net = (trajectory.path - trajectory.path[0]) / trajectory.scene.beam.length
    style.mark_zero(axes)
    for values, name, colour in zip(net.T, "xy", (style.BLUE, style.ORANGE), strict=True):
        look: dict[str, Any] = {"color": colour, "linewidth": style.LINE}
        axes.plot(trajectory.time, values, label=f"along {name}", **look)
    style.add_legend(axes)
    style.style_axes(axes, "time (s)", "body lengths", "displacement of the mean centre")


def _draw_heading(axes: Axes, trajectory: Trajectory) -> None:
    """Draw by how much the body has turned: in short pieces of time the mean and the extent."""
    angles = np.degrees(trajectory.angles.mean(axis=1))
    turned = angles - angles[0]
    size = _piece(trajectory)
    count = len(turned) // size
    pieces = turned[: count * size].reshape(count, size)
    times = trajectory.time[: count * size].reshape(count, size)
    middles = times.mean(axis=1)
    style.mark_zero(axes)
    low, high = pieces.min(axis=1), pieces.max(axis=1)
    axes.fill_between(middles, low, high, color=style.BLUE, alpha=0.25, linewidth=0)
    axes.plot(middles, pieces.mean(axis=1), color=style.BLUE, linewidth=style.LINE)
    bottom, top = axes.get_ylim()
    # So that a turn of a thousandth of a degree does not look like a curve.
    axes.set_ylim(min(bottom, -1.0), max(top, 1.0))
    title = "turn of the body, left positive (band: its swing)"
    style.style_axes(axes, "time (s)", "mean element angle (\u00b0)", title)


def _piece(trajectory: Trajectory) -> int:
    """Return the steps of a piece of time: whole waves of the body, a part of one turns to and fro.

    A run without waves, which has no peak in the spectrum of its bends, has pieces of equal length.
    """
    steps = trajectory.steps
    bends = np.diff(trajectory.angles, axis=1)[: max(1, steps)]
    power = (np.abs(np.fft.rfft(bends - bends.mean(axis=0), axis=0)) ** 2).sum(axis=1)
    waves = int(power.argmax())
    if waves < _FEWEST:
        return max(1, round(steps / _PIECES))
    wave = steps / waves
    return max(1, round(math.ceil(steps / _PIECES / wave) * wave))
