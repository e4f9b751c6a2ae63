"""Pictures that put gaits side by side: scores, paths with shapes, torques and bending."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swim_env.plots import style
from swim_env.plots.heat_maps import draw_map, tail
from swim_env.plots.spatial_gaits import draw_spatial_gaits, draw_spatial_paths
from swim_env.sim.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_gaits", "draw_paths", "draw_scores"]

Array = NDArray[np.float64]


def draw_scores(record: Mapping[str, Any]) -> Figure:
    """Draw the score of every start, and its check, for each policy.

    The record is that of a `swim_agents.comparison.contest.Contest`.
    """
    policies = record["policies"]
    looks = style.policy_looks(policies)
    figure = style.new_figure(style.WIDTH, 1.3 + 0.42 * len(policies))
    axes = figure.add_subplot()
    for row, (name, one) in enumerate(policies.items()):
        colour = looks[name]["color"]
        reached = np.array(one["score"])
        fine = np.array(one["closed_score"])
        trusted = np.array(one["verified"], dtype=bool)
        axes.barh(row, one["median"]["score"], height=0.6, color=colour, alpha=0.35)
        spread = np.linspace(-0.2, 0.2, len(reached)) if len(reached) > 1 else np.zeros(1)
        axes.plot(reached, row + spread, "o", color=colour, markersize=3)
        axes.plot(fine[trusted], (row + spread)[trusted], "|", color=style.BLACK, markersize=6)
        axes.plot(fine[~trusted], (row + spread)[~trusted], "x", color=style.BLACK, markersize=5)
        ratio = one["ratio_to_tuned_wave"]
        if ratio is not None:
            axes.annotate(
                f"{one['median']['score']:.2f} BL, {ratio:.2f} of the tuned wave",
                (max(float(reached.max()), float(fine.max()), 0.0), row),
                xytext=(8, 0),
                textcoords="offset points",
                va="center",
                fontsize=style.SMALLER,
            )
    axes.axvline(0.0, color=style.GREY, linewidth=style.THIN)
    axes.set_yticks(range(len(policies)), list(map(style.literal, policies)))
    axes.invert_yaxis()
    axes.margins(x=0.02)
    right = axes.get_xlim()[1]
    axes.set_xlim(right=right * 1.45 if right > 0 else None)
    style.style_axes(
        axes,
        f"{record['score']} in {record['duration']:g} s",
        "",
        f"{record['scene']}: bar median, dots starts, | the same policy computed finer, "
        "x where it is not verified",
    )
    axes.grid(visible=False, axis="y")
    return figure


def draw_paths(
    trajectories: Mapping[str, Trajectory], goals: Mapping[str, Any] | None = None
) -> Figure:
    """Draw where policies went, in one plane, and the shapes they took in one period.

    In space it is three planes, and the shapes from two sides. They have the same start; the goals,
    (D,) each, are targets (m).
    """
    goals = goals or {}
    if style.are_in_space(trajectories):
        return draw_spatial_paths(trajectories, goals)  # type: ignore[arg-type]
    names = list(trajectories)
    looks = style.policy_looks(names)
    seen = [_from_start(run, run.path) for run in trajectories.values()]
    seen += [_from_start(run, run.nodes[-1]) for run in trajectories.values()]
    seen += [_from_start(trajectories[name], [goals[name]]) for name in names if name in goals]
    shown = np.concatenate(seen)
    box = np.array([shown.min(axis=0) - 0.12, shown.max(axis=0) + 0.12])
    width, height = np.ptp(box, axis=0)
    high = float(np.clip(7.1 * height / width, 1.2, 4.0))
    figure = style.new_figure(style.WIDTH, high + 1.3 + 0.75 * len(names))
    rows = figure.add_gridspec(2, 1, height_ratios=(high + 0.3, 0.75 * len(names)))
    plane = figure.add_subplot(rows[0])
    for name in names:
        run, colour = trajectories[name], looks[name]["color"]
        path, shape = (_from_start(run, points) for points in (run.path, run.nodes[-1]))
        plane.plot(*path.T, **looks[name], linewidth=style.LINE, label=style.literal(name))
        beam = run.scene.beam
        style.draw_body(plane, shape, beam.half_thickness / beam.length, colour, layer=3)
        if name in goals:
            goal = _from_start(run, goals[name])
            plane.plot(*goal, "*", color=style.BLACK, markersize=9, zorder=5)
    style.show_plane(plane, box)
    entries = plane.get_legend_handles_labels()
    columns = min(4, len(names))
    style.add_legend(figure, *entries, ncols=columns, loc="outside upper center")
    title = "path of the mean centre from the same start, body at the end"
    style.style_axes(plane, "x (body lengths)", "y (body lengths)", title)

    strip = rows[1].subgridspec(len(names), 1, hspace=0.1)
    for row, name in enumerate(names):
        axes = figure.add_subplot(strip[row])
        _draw_shapes(axes, trajectories[name], name, last=row == len(names) - 1)
        if row == 0:
            style.name_panel(
                axes,
                "shapes over 0.2 s near the end, in the body's own frame, bending twice enlarged"
                " (dark to light: time)",
            )
    # The limits of equal scales are known only now, and with them the widths of their numbers.
    figure.draw_without_rendering()
    return figure


def _from_start(run: Trajectory, points: Any) -> Array:
    """Return points (..., 2) (m) relative to where a run started (BL)."""
    away: Array = (np.asarray(points) - run.path[0]) / run.scene.beam.length
    return away


def _draw_shapes(axes: Axes, run: Trajectory, name: str, last: bool) -> None:
    """Draw shapes at intervals of a short time, turned and moved on top of each other."""
    length, colours = run.scene.beam.length, style.time_colours(8)
    for colour, n in zip(colours, style.last_instants(run, len(colours)), strict=False):
        heading = float(run.angles[n].mean())
        turn = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
        shape = (run.nodes[n] - run.path[n]) @ turn.T / length
        axes.plot(shape[:, 0], 2.0 * shape[:, 1], color=colour, linewidth=style.LINE)
    axes.set_ylim(-0.4, 0.4)
    axes.set_xlim(-0.56, 0.56)
    style.style_axes(axes, "along the body (body lengths, head left)" if last else "", "")
    axes.set_ylabel(
        style.literal(name), fontsize=style.SMALLER, rotation=0, ha="right", va="center"
    )
    axes.set_yticks([])
    if not last:
        axes.set_xticklabels([])


def draw_gaits(
    trajectories: Mapping[str, Trajectory], gaits: Mapping[str, Any], seconds: float | None = None
) -> Figure:
    """Draw torques and bending along the body over time, and the phase along the body.

    In space there is a map for each axis. The gaits are `Gait.to_dict` or `SpatialGait.to_dict` of
    each policy's, or None.
    """
    if style.are_in_space(trajectories):
        return draw_spatial_gaits(trajectories, gaits, seconds)  # type: ignore[arg-type]
    figure = style.new_figure(style.WIDTH, 0.9 + 1.05 * len(trajectories))
    looks = style.policy_looks(trajectories)
    grid = figure.add_gridspec(len(trajectories), 3, width_ratios=(1.25, 1.25, 0.8))
    for row, (name, run) in enumerate(trajectories.items()):
        first, last = row == 0, row == len(trajectories) - 1
        torques, bends, phase = (figure.add_subplot(grid[row, column]) for column in range(3))
        time = "time (s)" if last else ""
        pushes = tail(run.torques, run, seconds)
        joint_angles = tail(np.diff(run.angles, axis=1)[: run.steps], run, seconds)
        largest = float(np.abs(joint_angles).max()) or 1.0
        for axes, values, limit, label, title in (
            (torques, pushes, run.scene.torque_limit, "joint", "torque (N m)"),
            (bends, joint_angles, largest, "", "joint angle (rad)"),
        ):
            image = draw_map(axes, run, values, limit)
            bar = figure.colorbar(image, ax=axes, fraction=0.06, pad=0.02)
            style.mark_ends(bar)
            bar.ax.tick_params(labelsize=style.SMALLER)
            style.style_axes(axes, time, label, title if first else "", grid=False)
        bends.set_yticklabels([])
        torques.annotate(
            style.literal(name),
            (-0.36, 0.5),
            xycoords="axes fraction",
            rotation=90,
            va="center",
            ha="center",
            fontsize=style.SMALLER,
        )
        _draw_phase(phase, run, gaits.get(name), looks[name]["color"])
        title = "bending: lag (rad)" if first else ""
        style.style_axes(phase, "place of the joint, s/l" if last else "", "", title)
        for axes in (torques, bends, phase):
            axes.tick_params(labelsize=style.SMALLER)
            if not last:
                axes.set_xticklabels([])
    return figure


def _draw_phase(axes: Axes, run: Trajectory, gait: Any, colour: str) -> None:
    """Draw by how much the bending lags behind the first joint."""
    if gait is not None:
        places = run.scene.beam.joint_fractions
        axes.plot(
            places, gait["phase_lags"], "o-", color=colour, markersize=2.5, linewidth=style.LINE
        )
        axes.annotate(
            f"{gait['frequency']:.2f} Hz\ntravelling share {gait['travelling_share']:.2f}",
            (0.04, 0.96),
            xycoords="axes fraction",
            va="top",
            fontsize=style.SMALLER,
        )
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, -1.0), max(high, 1.0) + 0.45 * max(high - low, 2.0))
    style.mark_zero(axes)
    axes.set_xlim(0.0, 1.0)
