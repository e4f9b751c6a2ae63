"""How far for how much work: runs of policies at several strengths, and the front among them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SwimError
from swim_env.plots.style import (
    FRONT,
    GREY,
    LINE,
    SMALL,
    SMALLER,
    THIN,
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

__all__ = ["draw_pareto", "pareto_front"]

Array = NDArray[np.float64]

_MARKS = ("o", "s", "^", "D", "v", "P", "X")


def pareto_front(costs: Sequence[float], gains: Sequence[float]) -> list[int]:
    """Return who is beaten by nobody: nothing costs as little and gains more.

    Returns
    -------
    list of int
        Their numbers, by rising cost.
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
        the scene's heading; runs that got nowhere or backwards, or took no work, are left out.
    trusted : mapping of str to sequence of bool, optional
        Whether each run passed a check; those that did not are hollow and not on the front.

    Raises
    ------
    SwimError
        If nothing is left to draw.
    """
    looks = policy_looks(trajectories)
    figure = new_figure(WIDTH, 4.6)
    axes = figure.add_subplot()
    works: list[float] = []
    reached: list[float] = []
    doubtful = False
    for number, (name, runs) in enumerate(trajectories.items()):
        passed = [True] * len(runs) if trusted is None else trusted[name]
        points = [
            (*point, good)
            for point, good in zip(map(_point, runs), passed, strict=True)
            if min(point) > 0.0
        ]
        if not points:
            continue
        colour, mark = looks[name]["color"], _MARKS[number % len(_MARKS)]
        good = [point[:2] for point in points if point[2]]
        bad = [point[:2] for point in points if not point[2]]
        axes.plot(*zip(*(point[:2] for point in points), strict=True), color=colour, linewidth=LINE)
        axes.plot([], [], color=colour, marker=mark, markersize=5, linewidth=LINE, label=name)
        for some, fill in ((good, colour), (bad, "white")):
            axes.plot(
                *np.array(some).reshape(-1, 2).T,
                linestyle="",
                color=colour,
                marker=mark,
                markerfacecolor=fill,
                markersize=5,
                zorder=4,
            )
        works += [work for work, _ in good]
        reached += [displacement for _, displacement in good]
        doubtful = doubtful or bool(bad)
    if not works:
        raise SwimError("there is nothing to draw: no run got anywhere along the scene's heading")
    if doubtful:
        axes.plot(
            [],
            [],
            "o",
            color=GREY,
            markerfacecolor="white",
            markersize=5,
            label="hollow: a finer computation disagrees",
        )
    front = pareto_front(works, reached)
    axes.step(
        [works[i] for i in front],
        [reached[i] for i in front],
        where="post",
        color=FRONT,
        linewidth=THIN,
        label="front: no run goes as far for less",
        zorder=2,
    )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.margins(0.08)
    _draw_equal_costs(axes)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.legend(fontsize=SMALL, frameon=False, loc="upper left")
    scene, seconds = _what(trajectories)
    name_panel(axes, f"{scene}, {seconds:g} s: each policy's torques at rising strength")
    style_axes(axes, "positive work of the torques (J)", "net displacement (body lengths)")
    return figure


def _point(run: Trajectory) -> tuple[float, float]:
    """Return positive work (J) and displacement along the scene's heading (BL)."""
    ahead = float(run.displacement @ run.scene.episode.heading) / run.scene.beam.length
    return float(run.positive_work.sum()), ahead


def _what(trajectories: Mapping[str, Sequence[Trajectory]]) -> tuple[str, float]:
    first = next(run for runs in trajectories.values() for run in runs)
    return first.scene.name, first.duration


def _draw_equal_costs(axes: Axes) -> None:
    """Draw lines of equal work per displacement, a name at the lower end of each."""
    left, right = axes.get_xlim()
    low, high = axes.get_ylim()
    decades = range(math.floor(math.log10(left / high)), math.ceil(math.log10(right / low)) + 1)
    for cost in (10.0**decade for decade in decades):
        axes.plot([cost * low, cost * high], [low, high], color=GREY, linewidth=THIN, linestyle=":")
        # Under the line where it comes in, if there is room.
        if left < cost * low < right * (right / left) ** -0.15:
            axes.annotate(
                f"{cost:,.0f} J/BL" if cost >= 1.0 else f"{cost:g} J/BL",
                (cost * low, low),
                xytext=(17, 2),
                textcoords="offset points",
                fontsize=SMALLER,
                color=GREY,
            )
    axes.set_xlim(left, right)
    axes.set_ylim(low, high)
