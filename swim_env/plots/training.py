"""Pictures of how agents learned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swim_env.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_learning", "draw_training"]

Curve = Mapping[str, Sequence[float]]


def draw_training(curves: Mapping[str, Sequence[Curve]], task: str = "forward") -> Figure:
    """Draw periodic evaluations over steps and over time, a line for each training seed.

    Parameters
    ----------
    curves : mapping of str to sequence of mapping
        For each agent the columns of its runs' ``evaluations.csv``, from
        `swim_agents.learning.logs.read_log`.
    task : str
        ``forward`` draws the net displacement, ``target`` the share of targets reached.
    """
    figure = style.new_figure(style.WIDTH, 3.0)
    target = task == "target"
    column = "success_rate" if target else "net_displacement_median"
    what = "share of targets reached" if target else "net displacement (body lengths)"
    looks = style.policy_looks(curves)
    left, right = figure.subplots(1, 2)
    for axes, x, scale in ((left, "steps", 1e-6), (right, "seconds", 1 / 60)):
        for name, runs in curves.items():
            colour = looks[name]["color"]
            for number, run in enumerate(runs):
                at = np.array(run[x]) * scale
                label = None if number else name
                axes.plot(at, run[column], color=colour, linewidth=style.LINE, label=label)
                if not target:
                    low, high = run["net_displacement_min"], run["net_displacement_max"]
                    axes.fill_between(at, low, high, color=colour, alpha=0.2, linewidth=0)
    style.style_axes(left, "environment steps (millions)", what)
    style.style_axes(right, "wall time (minutes)", "")
    style.add_legend(left)
    shown = "" if target else ", band: least to most far of the starts"
    figure.suptitle(
        f"evaluation without exploration on fixed starts, a line a run{shown}", fontsize=style.SMALL
    )
    return figure


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
    axes.plot(
        at, np.median(table, axis=0), color=colour, linewidth=style.THICK, label=f"{name}, {count}"
    )
    if len(runs) > 1:
        low, high = table.min(axis=0), table.max(axis=0)
        axes.fill_between(at, low, high, color=colour, alpha=0.2, linewidth=0)
        for x, y in zip(steps, values, strict=True):
            axes.plot(x, y, color=colour, linewidth=style.THIN, alpha=0.8)
