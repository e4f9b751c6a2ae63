"""Pictures that put gaits in space side by side: paths with shapes, axes, planes of bending."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.spatial.invariants import heading_of
from swim_env.plots import style
from swim_env.plots.heat_maps import AXES_SHOWN, add_bar, draw_map, tail
from swim_env.plots.views import VIEWS, Plan
from swim_env.scene.spatial.body import AXIS_NAMES
from swim_env.sim.spatial.trajectory import SpatialTrajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

__all__ = ["draw_bending", "draw_spatial_gaits", "draw_spatial_paths"]

Array = NDArray[np.float64]
Runs = Mapping[str, SpatialTrajectory]

#: Room around what views show (body lengths).
_MARGIN = 0.12
#: Heights for a policy: its shapes, its two rows of maps, its ellipses (inches).
_SHAPES, _MAPS, _ELLIPSES = 0.75, 1.9, 1.15
#: The strokes of the axes.
_STROKES = {"yaw": "-", "pitch": "--", "roll": ":"}
#: What scales of rotations reach to at least (rad): what hardly moves must not look like a wave.
_LEAST = np.radians(1.0)
#: Half of what an ellipse takes of the distance between joints.
_FILLED = 0.46


def draw_spatial_paths(trajectories: Runs, goals: Mapping[str, Any]) -> Figure:
    """Draw where policies went, from three sides, and shapes; see `swim_env.plots.draw_paths`."""
    names = list(trajectories)
    looks = style.policy_looks(names)
    paths = {name: _from_start(run, run.path) for name, run in trajectories.items()}
    bodies = {name: _from_start(run, run.nodes[-1]) for name, run in trajectories.items()}
    targets = {
        name: _from_start(trajectories[name], goals[name]) for name in names if name in goals
    }
    shown = np.concatenate(
        [*paths.values(), *bodies.values(), *(t[None] for t in targets.values())]
    )
    box = np.array([shown.min(axis=0) - _MARGIN, shown.max(axis=0) + _MARGIN])
    plan = Plan.of(box, box[:, 1])
    low = 0.6 + _SHAPES * len(names)
    figure = style.new_figure(style.WIDTH, plan.height + low)
    parts: Any = figure.subfigures(2, 1, height_ratios=(plan.height, low))
    above, below = parts
    views = [above.add_axes((0.0, 0.0, 1.0, 1.0)) for _ in VIEWS]
    for axes, view in zip(views, VIEWS, strict=True):
        for name in names:
            colour, body = looks[name]["color"], view.place(bodies[name])
            line = {**looks[name], "linewidth": style.LINE, "label": style.literal(name)}
            axes.plot(*view.place(paths[name]).T, **line)
            thick = {"linewidth": style.THICK, "alpha": 0.6, "solid_capstyle": "round"}
            axes.plot(*body.T, color=colour, **thick)
            axes.plot(*body[0], "o", color=colour, markersize=4)
            if name in targets:
                star = {"color": style.BLACK, "markersize": 9, "zorder": 5}
                axes.plot(*view.place(targets[name]).T, "*", **star)
        right, up = ("xyz"[axis] for axis in (view.right, view.up))
        style.style_axes(axes, f"{right} (body lengths)", f"{up} (body lengths)", view.title)

    strip = below.add_gridspec(len(names), 2, hspace=0.1)
    for row, name in enumerate(names):
        for column, (view_name, side) in enumerate((("top", 0), ("side", 1))):
            axes = below.add_subplot(strip[row, column])
            _draw_shapes(axes, trajectories[name], side, last=row == len(names) - 1)
            if row == 0:
                time = "dark to light: time" if side else "bending twice enlarged"
                style.name_panel(axes, f"{view_name}: shapes over 0.2 s, {time}")
            if side == 0:
                _name_row(axes, name)
    plan.place(figure, above, views)
    entries = views[0].get_legend_handles_labels()
    style.add_legend(above, *entries, ncols=min(5, len(names)), loc="upper center")
    return figure


def _from_start(run: SpatialTrajectory, points: Any) -> Array:
    """Return points (..., 3) (m) relative to where a run started (BL)."""
    away: Array = (np.asarray(points) - run.path[0]) / run.scene.beam.length
    return away


def _draw_shapes(axes: Axes, run: SpatialTrajectory, side: int, last: bool) -> None:
    """Draw shapes at intervals of a short time in the body's frame, towards d1 (0) or d2 (1)."""
    colours = style.time_colours(8)
    for colour, n in zip(colours, style.last_instants(run, len(colours)), strict=False):
        shape = (run.nodes[n] - run.path[n]) @ heading_of(run.directors[n]) / run.scene.beam.length
        axes.plot(shape[:, 2], 2.0 * shape[:, side], color=colour, linewidth=style.LINE)
    style.style_axes(axes, "along the body (body lengths, head left)" if last else "", "")
    axes.set_ylim(-0.4, 0.4)
    axes.set_xlim(-0.56, 0.56)
    axes.set_yticks([])
    if not last:
        axes.set_xticklabels([])


def draw_spatial_gaits(
    trajectories: Runs, gaits: Mapping[str, Any], seconds: float | None
) -> Figure:
    """Draw torques and rotations about each axis over time; see `swim_env.plots.draw_gaits`."""
    axes_shown = _axes_shown(trajectories, gaits)
    count = len(axes_shown)
    figure = style.new_figure(style.WIDTH, 0.9 + _MAPS * len(trajectories))
    looks = style.policy_looks(trajectories)
    ratios = (0.08, *[1.0] * count, 1.0)
    grid = figure.add_gridspec(2 * len(trajectories), count + 2, width_ratios=ratios)
    for number, (name, run) in enumerate(trajectories.items()):
        first, last = number == 0, number == len(trajectories) - 1
        _note(figure.add_subplot(grid[2 * number : 2 * number + 2, 0]), name, rotation=90)
        limits = dict(zip(run.scene.axes, np.atleast_1d(run.scene.torque_limit), strict=True))
        shares = run.torques / np.array([limits.get(axis, 1.0) for axis in AXIS_NAMES])
        turns = tail(run.joint_rotations[: run.steps], run, seconds)
        largest = max(_LEAST, float(np.abs(turns).max()))
        for below, values, limit, label in (
            (0, tail(shares, run, seconds), 1.0, "torque\n(of limit)"),
            (1, turns, largest, "rotation\n(rad)"),
        ):
            maps = [figure.add_subplot(grid[2 * number + below, 1 + i]) for i in range(count)]
            for axes, axis in zip(maps, axes_shown, strict=True):
                image = draw_map(axes, run, values[..., AXIS_NAMES.index(axis)], limit)
                style.style_axes(axes, "", "", axis if first and not below else "", grid=False)
                axes.tick_params(labelsize=style.SMALLER)
                axes.set_yticks([1, run.scene.joints])
                axes.locator_params(axis="x", nbins=2)
                if last and below:
                    axes.set_xlabel("time (s)", fontsize=style.SMALL)
                else:
                    axes.set_xticklabels([])
                if axes is not maps[0]:
                    axes.set_yticklabels([])
                if not below and axis not in limits:
                    _note(axes, "not actuated", color=style.GREY)
            maps[0].set_ylabel("joint", fontsize=style.SMALL)
            bar = figure.colorbar(image, ax=maps, aspect=8, pad=0.015)
            style.mark_ends(bar)
            bar.set_label(label, fontsize=style.SMALLER)
            bar.ax.tick_params(labelsize=style.SMALLER)
        lags = figure.add_subplot(grid[2 * number : 2 * number + 2, -1])
        _draw_lags(lags, run, gaits.get(name), looks[name]["color"])
        place = "place of the joint, s/l" if last else ""
        style.style_axes(lags, place, "lag (rad)", "Hz, travelling share" if first else "")
        lags.tick_params(labelsize=style.SMALLER)
        if not last:
            lags.set_xticklabels([])
    return figure


def _axes_shown(trajectories: Runs, gaits: Mapping[str, Any]) -> list[str]:
    """Return the axes that are actuated, or about which somebody has a gait."""
    actuated = {axis for run in trajectories.values() for axis in run.scene.axes}
    moving = {axis for gait in gaits.values() if gait for axis in AXIS_NAMES if gait[axis]}
    return [axis for axis in AXES_SHOWN if axis in actuated | moving]


def _note(axes: Axes, text: str, **look: Any) -> None:
    """Write a text into the middle of axes that show nothing."""
    axes.set_axis_off()
    look = {"ha": "center", "va": "center", "fontsize": style.SMALLER, **look}
    axes.text(0.5, 0.5, style.literal(text), transform=axes.transAxes, **look).set_in_layout(False)


def _draw_lags(axes: Axes, run: SpatialTrajectory, gait: Any, colour: str) -> None:
    """Draw by how much the rotations about each axis lag behind those of the first joint."""
    places = run.scene.beam.joint_fractions
    for axis, stroke in _STROKES.items():
        own = None if gait is None else gait[axis]
        if own is not None:
            label = f"{axis} {own['frequency']:.2f} Hz, {own['travelling_share']:.2f}"
            look: dict[str, Any] = {
                "color": colour,
                "markersize": 2.5,
                "linewidth": style.LINE,
                "label": label,
            }
            axes.plot(places, own["phase_lags"], "o", linestyle=stroke, **look)
    if axes.lines:
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, -1.0), max(high, 1.0) + 0.7 * max(high - low, 2.0))
        style.add_legend(axes, loc="upper left", handlelength=2.0, borderaxespad=0.1)
    style.mark_zero(axes)
    axes.set_xlim(0.0, 1.0)


def draw_bending(trajectories: Runs, gaits: Mapping[str, Any]) -> Figure:
    """Draw the ellipses of yaw and pitch at each joint and of the whole body, a row for a policy.

    A line is bending in a plane, a circle bending in all of them; colours are the whirl, which is
    positive where it turns from yaw to pitch, as in the figures anticlockwise. The gaits are
    `SpatialGait.to_dict` of each policy's, or None. Joints have a scale of their own in each row.
    """
    from matplotlib.ticker import MaxNLocator

    figure = style.new_figure(style.WIDTH, 1.0 + _ELLIPSES * len(trajectories))
    title = "ellipses of bending at the joints and of the body: yaw to the right, pitch upwards"
    figure.suptitle(title, fontsize=style.SMALL + 1)
    grid = figure.add_gridspec(len(trajectories), 2, width_ratios=(5.0, 1.0))
    shown = []
    for row, (name, run) in enumerate(trajectories.items()):
        joints, body = (figure.add_subplot(grid[row, column]) for column in range(2))
        gait, last = gaits.get(name), row == len(trajectories) - 1
        spacing = 1.0 / run.scene.beam.elements
        style.style_axes(joints, "place of the joint, s/l" if last else "", "", grid=False)
        style.style_axes(body, "yaw (rad)" if last else "", "pitch (rad)")
        joints.set(xlim=(0.0, 1.0), ylim=(-0.6 * spacing, 0.6 * spacing), yticks=[])
        body.tick_params(labelsize=style.SMALLER)
        for axes in (joints, body):
            axes.set_aspect("equal")
        for axis in (body.xaxis, body.yaxis):
            axis.set_major_locator(MaxNLocator(nbins=2, symmetric=True))
        if not last:
            joints.set_xticklabels([])
        _name_row(joints, name)
        shown += [joints, body]
        ellipses = [] if gait is None else gait["joints"]
        largest = max([0.0, *(one["major"] for one in ellipses)])
        reach = max(_LEAST, largest)
        body.set(xlim=(-reach, reach), ylim=(-reach, reach))
        if gait is None:
            joints.text(0.5, 0.0, "no gait", fontsize=style.SMALLER, ha="center", va="center")
            continue
        for place, one in zip(run.scene.beam.joint_fractions, ellipses, strict=True):
            _draw_ellipse(joints, one, (float(place), 0.0), _FILLED * spacing / reach)
        _draw_ellipse(body, gait["body"], (0.0, 0.0), 1.0)
        figures = {
            "whirl": gait["body"]["whirl"],
            "handedness": gait["handedness"],
            "roll rate (rad/s)": gait["roll_rate"],
        }
        # Without the sign of what rounds to zero.
        words = [f"{what} {round(value, 2) + 0.0:+.2f}" for what, value in figures.items()]
        style.name_panel(joints, f"largest {largest:.2g} rad, " + ", ".join(words))
    add_bar(figure, shown, _whirls(), "whirl", aspect=60, pad=0.015)
    return figure


def _whirls() -> ScalarMappable:
    """Return the colours of the whirl."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    return ScalarMappable(Normalize(-1.0, 1.0), style.diverging_map())


def _draw_ellipse(axes: Axes, one: Any, middle: tuple[float, float], scale: float) -> None:
    """Draw an ellipse of bending (rad) in the colour of its whirl."""
    turn = np.linspace(0.0, 2.0 * np.pi, 73)
    z = np.exp(1j * one["angle"]) * (one["major"] * np.cos(turn) + 1j * one["minor"] * np.sin(turn))
    x, y = middle[0] + scale * z.real, middle[1] + scale * z.imag
    axes.fill(x, y, facecolor=_whirls().to_rgba(one["whirl"]), edgecolor=style.BLACK, linewidth=0.8)


def _name_row(axes: Axes, name: str) -> None:
    """Write a policy's name to the left of its row."""
    look: dict[str, Any] = {"rotation": 0, "ha": "right", "va": "center", "fontsize": style.SMALLER}
    axes.set_ylabel(style.literal(name), **look)
