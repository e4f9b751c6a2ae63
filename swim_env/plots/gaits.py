"""Pictures that put gaits side by side: scores, paths with shapes, torques and bending."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swim_env.plots.heat_maps import draw_map
from swim_env.plots.style import (
    BLACK,
    GREY,
    LINE,
    SMALLER,
    THICK,
    THIN,
    TIME_COLOURS,
    WIDTH,
    name_panel,
    new_figure,
    policy_looks,
    style_axes,
)
from swim_env.sim.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_gaits", "draw_paths", "draw_scores"]


def draw_scores(record: Mapping[str, Any]) -> Figure:
    """Draw the net displacement of every start, and its check, for each policy.

    Parameters
    ----------
    record : mapping
        Of `swim_agents.comparison.contest.Contest`.
    """
    policies = record["policies"]
    looks = policy_looks(policies)
    figure = new_figure(WIDTH, 1.3 + 0.42 * len(policies))
    axes = figure.add_subplot()
    for row, (name, one) in enumerate(policies.items()):
        colour = looks[name]["color"]
        reached = np.array(one["net_displacement"])
        fine = np.array(one["fine_displacement"])
        trusted = np.array(one["verified"], dtype=bool)
        axes.barh(row, one["median"]["net_displacement"], height=0.6, color=colour, alpha=0.35)
        spread = np.linspace(-0.2, 0.2, len(reached)) if len(reached) > 1 else np.zeros(1)
        axes.plot(reached, row + spread, "o", color=colour, markersize=3)
        axes.plot(fine[trusted], (row + spread)[trusted], "|", color=BLACK, markersize=6)
        axes.plot(fine[~trusted], (row + spread)[~trusted], "x", color=BLACK, markersize=5)
        ratio = one["ratio_to_tuned_wave"]
        if ratio is not None:
            axes.annotate(
                f"{one['median']['net_displacement']:.2f} BL, {ratio:.2f} of the tuned wave",
                (max(float(reached.max()), float(fine.max()), 0.0), row),
                xytext=(8, 0),
                textcoords="offset points",
                va="center",
                fontsize=SMALLER,
            )
    axes.axvline(0.0, color=GREY, linewidth=THIN)
    axes.set_yticks(range(len(policies)), list(policies))
    axes.invert_yaxis()
    axes.margins(x=0.02)
    right = axes.get_xlim()[1]
    axes.set_xlim(right=right * 1.45 if right > 0 else None)
    style_axes(axes, f"net displacement in {record['duration']:g} s (body lengths)", "")
    axes.grid(visible=False, axis="y")
    name_panel(
        axes,
        f"{record['scene']}: bar median, dots starts, | the same torques computed finer, "
        "x where the two disagree",
    )
    return figure


def draw_paths(
    trajectories: Mapping[str, Trajectory], goals: Mapping[str, Any] | None = None
) -> Figure:
    """Draw where policies went, in one plane, and the shapes they took in one period.

    Parameters
    ----------
    trajectories : mapping of str to Trajectory
        One of each policy, from the same start.
    goals : mapping of str to (2,) array, optional
        Targets (m).
    """
    from matplotlib import colormaps

    names = list(trajectories)
    looks = policy_looks(names)
    box = _box(trajectories, goals or {})
    width, height = np.ptp(box, axis=0)
    high = float(np.clip(7.1 * height / width, 1.2, 4.0))
    figure = new_figure(WIDTH, high + 1.3 + 0.75 * len(names))
    rows = figure.add_gridspec(2, 1, height_ratios=(high + 0.3, 0.75 * len(names)))
    plane = figure.add_subplot(rows[0])
    for name in names:
        run, colour = trajectories[name], looks[name]["color"]
        length = run.scene.beam.length
        path = (run.path - run.path[0]) / length
        plane.plot(*path.T, **looks[name], linewidth=LINE, label=name)
        shape = (run.nodes[-1] - run.path[0]) / length
        plane.plot(*shape.T, color=colour, linewidth=THICK, alpha=0.6, solid_capstyle="round")
        plane.plot(*shape[0], "o", color=colour, markersize=4)
        if goals and name in goals:
            spot = (np.asarray(goals[name]) - run.path[0]) / length
            plane.plot(*spot, "*", color=BLACK, markersize=9, zorder=5)
    plane.update_datalim(box)
    plane.margins(0.0)
    plane.autoscale_view()
    plane.set_aspect("equal", adjustable="datalim")
    figure.legend(
        *plane.get_legend_handles_labels(),
        fontsize=SMALLER,
        frameon=False,
        ncols=min(4, len(names)),
        loc="outside upper center",
    )
    name_panel(plane, "path of the mean centre from the same start, body at the end (dot: head)")
    style_axes(plane, "x (body lengths)", "y (body lengths)")

    colours = colormaps[TIME_COLOURS](np.linspace(0.0, 0.88, 8))
    strip = rows[1].subgridspec(len(names), 1, hspace=0.1)
    for row, name in enumerate(names):
        axes = figure.add_subplot(strip[row])
        _draw_shapes(axes, trajectories[name], name, colours, last=row == len(names) - 1)
        if row == 0:
            name_panel(
                axes,
                "shapes over 0.2 s near the end, in the body's own frame, bending twice enlarged"
                " (dark to light: time)",
            )
    # The limits of equal scales are known only now, and with them the widths of their numbers.
    figure.draw_without_rendering()
    return figure


def _box(trajectories: Mapping[str, Trajectory], goals: Mapping[str, Any]) -> NDArray[np.float64]:
    """Return the corners of paths, last shapes and goals (BL) with a margin around them."""
    points = []
    for name, run in trajectories.items():
        places = [run.path, run.nodes[-1]]
        if name in goals:
            places.append(np.asarray(goals[name], dtype=np.float64)[None])
        points += [(some - run.path[0]) / run.scene.beam.length for some in places]
    every = np.concatenate(points)
    return np.array([every.min(axis=0) - 0.12, every.max(axis=0) + 0.12])


def _draw_shapes(axes: Axes, run: Trajectory, name: str, colours: Any, last: bool) -> None:
    """Draw shapes at intervals of a short time, turned and moved on top of each other."""
    length, step = run.scene.beam.length, run.scene.integrator.time_step
    instants = (run.steps - np.linspace(0.2 / step, 0.0, len(colours))).round().astype(int)
    for colour, n in zip(colours, np.unique(instants.clip(0)), strict=False):
        heading = float(run.angles[n].mean())
        turn = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
        shape = (run.nodes[n] - run.path[n]) @ turn.T / length
        axes.plot(shape[:, 0], 2.0 * shape[:, 1], color=colour, linewidth=LINE)
    axes.set_ylim(-0.4, 0.4)
    axes.set_xlim(-0.56, 0.56)
    style_axes(axes, "along the body (body lengths, head left)" if last else "", "")
    axes.set_ylabel(name, fontsize=SMALLER, rotation=0, ha="right", va="center")
    axes.set_yticks([])
    if not last:
        axes.set_xticklabels([])


def draw_gaits(
    trajectories: Mapping[str, Trajectory], gaits: Mapping[str, Any], seconds: float = 1.0
) -> Figure:
    """Draw torques and bending along the body over a second, and the phase along the body.

    Parameters
    ----------
    trajectories : mapping of str to Trajectory
        One of each policy.
    gaits : mapping of str to dict or None
        `Gait.to_dict` of each.
    seconds : float
        Time that is shown, the last of each run (s).
    """
    names = list(trajectories)
    figure = new_figure(WIDTH, 0.9 + 1.05 * len(names))
    looks = policy_looks(names)
    grid = figure.add_gridspec(len(names), 3, width_ratios=(1.25, 1.25, 0.8))
    bends: Sequence[NDArray[np.float64]] = [
        _tail(np.diff(trajectories[name].angles, axis=1), trajectories[name], seconds)
        for name in names
    ]
    for row, name in enumerate(names):
        run = trajectories[name]
        torques = _tail(run.torques, run, seconds)
        last = row == len(names) - 1
        for column, values in enumerate((torques, bends[row])):
            axes = figure.add_subplot(grid[row, column])
            limit = run.scene.torque_limit if column == 0 else float(np.abs(values).max()) or 1.0
            image = draw_map(axes, run, values, limit)
            bar = figure.colorbar(image, ax=axes, fraction=0.06, pad=0.02)
            bar.ax.tick_params(labelsize=SMALLER)
            label = "joint" if column == 0 else ""
            style_axes(axes, "time (s)" if last else "", label, grid=False)
            axes.tick_params(labelsize=SMALLER)
            if not last:
                axes.set_xticklabels([])
            if column == 1:
                axes.set_yticklabels([])
            if row == 0:
                title = "torque (N m)" if column == 0 else "joint angle (rad)"
                name_panel(axes, title)
            if column == 0:
                axes.annotate(
                    name,
                    (-0.36, 0.5),
                    xycoords="axes fraction",
                    rotation=90,
                    va="center",
                    ha="center",
                    fontsize=SMALLER,
                )
        phase, colour = figure.add_subplot(grid[row, 2]), looks[name]["color"]
        _draw_phase(phase, run, gaits.get(name), colour, row == 0, last)
    return figure


def _tail(values: NDArray[np.float64], run: Trajectory, seconds: float) -> NDArray[np.float64]:
    count = max(2, round(seconds / run.scene.integrator.time_step))
    return values[: run.steps][-count:]


def _draw_phase(
    axes: Axes, run: Trajectory, gait: Any, colour: str, first: bool, last: bool
) -> None:
    """Draw by how much the bending lags behind the first joint."""
    if gait is not None:
        places = run.scene.beam.joint_fractions
        axes.plot(places, gait["phase_lags"], "o-", color=colour, markersize=2.5, linewidth=LINE)
        axes.annotate(
            f"{gait['frequency']:.2f} Hz\ntravelling share {gait['travelling_share']:.2f}",
            (0.04, 0.96),
            xycoords="axes fraction",
            va="top",
            fontsize=SMALLER,
        )
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, -1.0), max(high, 1.0) + 0.45 * max(high - low, 2.0))
    axes.axhline(0.0, color=GREY, linewidth=THIN)
    style_axes(axes, "place of the joint, s/l" if last else "", "")
    axes.tick_params(labelsize=SMALLER)
    axes.set_xlim(0.0, 1.0)
    if not last:
        axes.set_xticklabels([])
    if first:
        name_panel(axes, "bending: lag (rad)")
