"""The gallery's own pictures: how far for how much work, and how agents learned over seeds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SwimError
from swim_env.plots import style
from swim_env.sim.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Curve = Mapping[str, Sequence[float]]

_MARKS = ("o", "s", "^", "D", "v", "P", "X")


def pareto_front(costs: Sequence[float], gains: Sequence[float]) -> list[int]:
    """Return the numbers of those that none beats, costing as little and gaining more.

    They are in the order of rising cost.
    """
    order = sorted(range(len(costs)), key=lambda i: (costs[i], -gains[i]))
    front: list[int] = []
    for i in order:
        if not front or gains[i] > gains[front[-1]]:
            front.append(i)
    return front


def draw_pareto(
    trajectories: Mapping[str, Sequence[Trajectory]],
    trusted: Mapping[str, Sequence[bool]] | None = None,
) -> Figure:
    """Draw the net displacement over the positive work of runs, and the front.

    Parameters
    ----------
    trajectories : mapping of str to sequence of Trajectory
        Of each policy its runs at rising strength; a line joins them. Displacement is that along
        the scene's heading; runs that got nowhere or backwards, or took no work, are left out; if
        no other is there, it is a SwimError.
    trusted : mapping of str to sequence of bool, optional
        Whether each run passed a check; those that did not are hollow and not on the front.
    """
    from matplotlib.ticker import LogFormatter

    looks = style.policy_looks(trajectories)
    figure = style.new_figure(style.WIDTH, 4.6)
    axes = figure.add_subplot()
    trusted_points: list[tuple[float, float]] = []
    doubtful = False
    for number, (name, runs) in enumerate(trajectories.items()):
        points = np.array([_point(run) for run in runs])
        passed = np.array([True] * len(runs) if trusted is None else trusted[name])
        ahead = points.min(axis=1) > 0.0
        if not ahead.any():
            continue
        colour, mark = looks[name]["color"], _MARKS[number % len(_MARKS)]
        line: dict[str, Any] = {"color": colour, "linewidth": style.LINE}
        marks: dict[str, Any] = {"color": colour, "marker": mark, "markersize": 5}
        axes.plot(*points[ahead].T, **line)
        axes.plot([], [], **(marks | line), label=name)
        for some, fill in ((ahead & passed, colour), (ahead & ~passed, "white")):
            axes.plot(*points[some].T, **marks, linestyle="", markerfacecolor=fill, zorder=4)
        trusted_points += [(work, gain) for work, gain in points[ahead & passed].tolist()]
        doubtful = doubtful or bool((ahead & ~passed).any())
    if not trusted_points:
        raise SwimError("there is nothing to draw: no run got anywhere along the scene's heading")
    if doubtful:
        label = "hollow: a finer computation disagrees"
        axes.plot([], [], "o", color=style.GREY, markerfacecolor="white", markersize=5, label=label)
    works, reached = zip(*trusted_points, strict=True)
    front = np.array(trusted_points)[pareto_front(works, reached)].T
    label = "front: no run goes as far for less"
    line = {"color": style.FRONT, "linewidth": style.THIN, "zorder": 2}
    axes.step(*front, where="post", label=label, **line)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.margins(0.08)
    _draw_equal_costs(axes)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_major_formatter("{x:g}")
    for axis in (axes.xaxis, axes.yaxis):  # where the range is less than a decade
        axis.set_minor_formatter(LogFormatter(minor_thresholds=(1.0, 0.4)))
    style.add_legend(axes, fontsize=style.SMALL, loc="upper left")
    first = next(run for runs in trajectories.values() for run in runs)
    title = f"{first.scene.name}, {first.duration:g} s"
    if max(map(len, trajectories.values())) > 1:
        title += ": each policy's torques at rising strength"
    work, reach = "positive work of the torques (J)", "net displacement (body lengths)"
    style.style_axes(axes, work, reach, title)
    return figure


def _point(run: Trajectory) -> tuple[float, float]:
    """Return positive work (J) and displacement along the scene's heading (BL)."""
    ahead = float(run.displacement @ run.scene.episode.heading) / run.scene.beam.length
    return float(run.positive_work.sum()), ahead


def _draw_equal_costs(axes: Axes) -> None:
    """Draw lines of equal work per displacement, a name at the lower end of each."""
    left, right = axes.get_xlim()
    low, high = axes.get_ylim()
    decades = range(math.floor(math.log10(left / high)), math.ceil(math.log10(right / low)) + 1)
    for cost in (10.0**decade for decade in decades):
        line: dict[str, Any] = {"color": style.GREY, "linewidth": style.THIN, "linestyle": ":"}
        axes.plot([cost * low, cost * high], [low, high], **line)
        # Under the line where it comes in, if there is room.
        if left < cost * low < right * (right / left) ** -0.15:
            text = f"{cost:,.0f} J/BL" if cost >= 1.0 else f"{cost:g} J/BL"
            look: dict[str, Any] = {"fontsize": style.SMALLER, "color": style.GREY}
            place: dict[str, Any] = {"xytext": (17, 2), "textcoords": "offset points"}
            axes.annotate(text, (cost * low, low), **place, **look)
    axes.set_xlim(left, right)
    axes.set_ylim(low, high)


def draw_learning(
    forward: Mapping[str, Sequence[Curve]],
    target: Mapping[str, Sequence[Curve]],
    reference: tuple[str, float] | None = None,
) -> Figure:
    """Draw how agents learned, with the spread over training seeds.

    Left, how far they swim; right, how many targets they reach; both in the periodic evaluations,
    without exploration. The line is the median over seeds, the band goes from the least to the
    largest of them, and thin lines are the seeds; an agent of one seed has its line alone.

    Parameters
    ----------
    forward, target : mapping of str to sequence of mapping
        For each agent the columns of its runs' ``evaluations.csv``, a run for each training seed.
    reference : (str, float), optional
        A policy and its net displacement (body lengths), as a line across.
    """
    figure = style.new_figure(style.WIDTH, 3.2)
    left, right = figure.subplots(1, 2)
    looks = style.policy_looks([*forward, *target])
    for axes, curves, column, scale in (
        (left, forward, "net_displacement_median", 1.0),
        (right, target, "success_rate", 100.0),
    ):
        for name, runs in curves.items():
            _draw_spread(axes, name, runs, column, scale, looks[name]["color"])
    if reference is not None:
        name, value = reference
        colour = style.policy_looks([name])[name]["color"]
        left.axhline(value, color=colour, linewidth=style.LINE, linestyle="--", label=name)
    for axes in (left, right):
        axes.set_xlim(left=0.0)
        style.add_legend(axes, loc="lower right")
    right.set_ylim(-3.0, 103.0)
    steps = "environment steps (millions)"
    title = "swimming forward: line median, band all training seeds"
    style.style_axes(left, steps, "net displacement (body lengths)", title)
    style.style_axes(right, steps, "targets reached (%)", "swimming to a target")
    return figure


def _draw_spread(
    axes: Axes, name: str, runs: Sequence[Curve], column: str, scale: float, colour: str
) -> None:
    """Draw the median and the extent of runs, where all of them have been."""
    steps = [1e-6 * np.array(run["steps"]) for run in runs]
    values = [scale * np.array(run[column]) for run in runs]
    at: NDArray[np.float64] = steps[0][steps[0] <= min(one[-1] for one in steps)]
    table = np.stack([np.interp(at, x, y) for x, y in zip(steps, values, strict=True)])
    count = f"{len(runs)} seeds" if len(runs) > 1 else "1 seed"
    label, median = f"{name}, {count}", np.median(table, axis=0)
    axes.plot(at, median, color=colour, linewidth=style.THICK, label=label)
    if len(runs) > 1:
        low, high = table.min(axis=0), table.max(axis=0)
        axes.fill_between(at, low, high, color=colour, alpha=0.2, linewidth=0)
        for x, y in zip(steps, values, strict=True):
            axes.plot(x, y, color=colour, linewidth=style.THIN, alpha=0.8)
