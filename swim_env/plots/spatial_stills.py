"""A picture of one run in space: where it went and in which shapes, in three views."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swim_env.analysis.body_surface import BodySurface
from swim_env.analysis.pose import ORIENTATION, orientation_of
from swim_env.plots import style
from swim_env.plots.heat_maps import add_bar, draw_map, tail
from swim_env.plots.views import VIEWS, Plan, draw_body
from swim_env.scene.spatial.body import AXIS_NAMES
from swim_env.scene.spatial.scene import SpatialScene
from swim_env.sim.spatial.trajectory import SpatialTrajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

__all__ = ["draw_spatial_path"]

Array = NDArray[np.float64]

#: Room around what views show, and least distance of shapes that are moved apart (body lengths).
_MARGIN, _APART = 0.05, 0.06
#: Shapes that are closer than this on average hide each other: they are moved apart (body lengths).
_COVERED = 0.2
#: Height of what shapes that are moved apart take, in widths; fewer are shown where they took more.
_TALLEST = 1.1
#: Parts of a run's end that heat maps show, in those of pictures of many runs.
_SHOWN = 3.0
#: Joints' rotations about an axis that reach less than this (degrees), or less than this share of
#: the largest, are not shown.
_NOTHING, _LITTLE = 0.1, 0.05
#: What scales of angles (degrees) and of displacements (body lengths) reach to at least: a turn of
#: a thousandth of a degree must not look like a wave.
_LEAST, _LEAST_PATH = 1.0, 1e-3
#: Heights of a row of charts, and of the title (inches).
_CHART, _TITLE = 1.83, 0.25


def draw_spatial_path(trajectory: SpatialTrajectory, shapes: int = 6, name: str = "") -> Figure:
    """Draw where a run in space went, see `swim_env.plots.draw_path`.

    Above, the body at equal intervals of time from three sides, with its true sections, the head
    marked, and the paths of mean centre and head; shapes of a slow swimmer are moved apart,
    downwards with time. Below, displacement and orientation over time, and the joints' rotations
    of the last seconds.
    """
    steps, scene = trajectory.steps, trajectory.scene
    assert isinstance(scene, SpatialScene)
    length = scene.beam.length
    surface = BodySurface(scene, rings=45, around=32)
    travelled = float(np.ptp(trajectory.path, axis=0).max())
    apart = travelled < _COVERED * (shapes - 1) * length
    while True:
        instants = np.unique(np.linspace(0, steps, shapes).round().astype(int))
        vertices = surface.vertices(trajectory.centres[instants], trajectory.directors[instants])
        down = _down(vertices, length) if apart else np.zeros((len(instants), 3))
        box = _box(trajectory, vertices, down, apart)
        size = box[1] - box[0]
        if not apart or shapes <= 2 or size[1] + size[2] <= _TALLEST * (size[0] + size[1]):
            break
        shapes -= 1
    front = box[:, 1]
    if apart:
        # The front view shows them below each other too.
        front = np.array([vertices[..., 1].min(), vertices[..., 1].max()])
        front = front + _MARGIN * length * np.array([-1.0, 1.0])
    plan = Plan.of(box, front)
    bends = _bends(trajectory)
    charts = _CHART * (2 if bends else 1)
    figure = style.new_figure(style.WIDTH, plan.height + charts + _TITLE)
    parts: Any = figure.subfigures(2, 1, height_ratios=(plan.height, charts))
    above, below = parts
    views = [above.add_axes((0.0, 0.0, 1.0, 1.0)) for _ in range(3)]
    title = style.title_of(trajectory, name) + ("; shapes moved apart" if apart else "")
    figure.suptitle(style.literal(title), fontsize=style.SMALL + 1)
    _draw_charts(below, trajectory, bends)
    colours = style.time_colours(len(instants))
    labels = [f"{time:.3g} s" for time in trajectory.time[instants]]
    for axes, view in zip(views, VIEWS, strict=True):
        for row in range(len(instants)):
            moved = vertices[row] + down[row] * (np.arange(3) == view.up)
            draw_body(axes, view, surface, moved, colours[row], labels[row])
        if not apart:
            for points, label, colour, layer in (
                (trajectory.path, "mean centre", style.BLACK, 3.0 + 2.0 * len(instants)),
                (trajectory.nodes[:, 0], "head", style.SILVER, 1.5),
            ):
                look = {"color": colour, "linewidth": 0.8, "zorder": layer}
                axes.plot(*view.place(points).T, label=label, **look)
        style.style_axes(axes, f"{'xyz'[view.right]} (m)", f"{'xyz'[view.up]} (m)", view.title)
        if apart:
            axes.set_yticks([])
            axes.set_ylabel("")
    plan.place(figure, above, views)
    style.add_legend(
        above,
        *views[0].get_legend_handles_labels(),
        ncols=len(instants) + 2,
        loc="upper left",
        borderaxespad=0.1,
        handlelength=1.2,
        columnspacing=1.2,
    )
    return figure


def _down(vertices: Array, length: float) -> Array:
    """Return by how much each shape is moved down, (n, 3): along y from above, along z else."""
    over = vertices[1:].max(axis=1) - vertices[:-1].min(axis=1)
    steps = np.maximum(1.05 * over.max(axis=0, initial=0.0), _APART * length) * (0.0, 1.0, 1.0)
    down: Array = -np.arange(len(vertices))[:, None] * steps
    return down


def _box(trajectory: SpatialTrajectory, vertices: Array, down: Array, apart: bool) -> Array:
    """Return the corners (2, 3) of what is shown (m)."""
    shown = (vertices + down[:, None]).reshape(-1, 3)
    points = shown if apart else np.concatenate([shown, trajectory.path, trajectory.nodes[:, 0]])
    margin = _MARGIN * trajectory.scene.beam.length
    return np.array([points.min(axis=0) - margin, points.max(axis=0) + margin])


def _bends(trajectory: SpatialTrajectory) -> dict[str, Array]:
    """Return the joints' rotations (T, N - 1) of a run's end (degrees) about axes that turn."""
    rotations = np.degrees(trajectory.joint_rotations[1:])
    shown = tail(rotations, trajectory, _SHOWN * style.shown_seconds(trajectory, None))
    found = {axis: shown[..., AXIS_NAMES.index(axis)] for axis in ("yaw", "pitch", "roll")}
    least = max(_NOTHING, _LITTLE * float(np.abs(shown).max(initial=0.0)))
    return {axis: part for axis, part in found.items() if np.abs(part).max(initial=0.0) > least}


def _draw_charts(figure: SubFigure, trajectory: SpatialTrajectory, bends: dict[str, Array]) -> None:
    """Draw displacement and orientation over time, and below them the joints' rotations."""
    half = max(1, len(bends))
    rows = figure.add_gridspec(2 if bends else 1, 2 * half)
    displacement = (trajectory.path - trajectory.path[0]) / trajectory.scene.beam.length
    _draw_lines(
        figure.add_subplot(rows[0, :half]),
        trajectory.time,
        {f"along {axis}": values for axis, values in zip("xyz", displacement.T, strict=True)},
        ("body lengths", "displacement of the mean centre", _LEAST_PATH),
    )
    turned = np.degrees(orientation_of(trajectory.directors))
    turned -= turned[0]
    _draw_lines(
        figure.add_subplot(rows[0, half:]),
        trajectory.time,
        dict(zip(ORIENTATION, turned.T, strict=True)),
        ("turn (\u00b0)", "turn of the body: roll about its axis, pitch head up, yaw left", _LEAST),
    )
    if not bends:
        return
    limit = max(_LEAST, *[float(np.abs(part).max()) for part in bends.values()])
    maps = []
    for number, (axis, shown) in enumerate(bends.items()):
        place = figure.add_subplot(rows[1, 2 * number : 2 * number + 2])
        image = draw_map(place, trajectory, shown, limit)
        joints = shown.shape[1]
        place.set_yticks(np.unique(np.linspace(1, joints, min(joints, 4)).round().astype(int)))
        what = f"{axis} of the joints, largest {np.abs(shown).max():.2g}\u00b0"
        side = "joint, 1 at the head" if number == 0 else ""
        style.style_axes(place, "time (s)", side, what, grid=False)
        maps.append(place)
    add_bar(figure, maps, image, "rotation (\u00b0)", aspect=14, pad=0.015)


def _draw_lines(
    axes: Axes, time: Array, lines: dict[str, Array], texts: tuple[str, str, float]
) -> None:
    """Draw lines over time; the texts are label and title, then how far zero is seen around."""
    unit, title, least = texts
    style.mark_zero(axes)
    for (label, values), colour in zip(
        lines.items(), (style.BLUE, style.ORANGE, style.GREEN), strict=True
    ):
        axes.plot(time, values, label=label, color=colour, linewidth=style.LINE)
    low, high = axes.get_ylim()
    low, high = min(low, -least), max(high, least)
    axes.set_ylim(low, high + 0.25 * (high - low))
    style.add_legend(axes, ncols=len(lines), loc="upper left", borderaxespad=0.1)
    style.style_axes(axes, "time (s)", unit, title)
