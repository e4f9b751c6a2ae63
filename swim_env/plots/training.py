"""A picture of how agents learned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from swim_env.plots import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw_training"]

Curve = Mapping[str, Sequence[float]]


def draw_training(curves: Mapping[str, Sequence[Curve]], task: str = "forward") -> Figure:
    """Draw periodic evaluations over steps and over time, a line for each training seed.

    The curves are for each agent the columns of its runs' ``evaluations.csv``, see
    `swim_agents.learning.logs.read_log`. With task ``forward`` they show the net displacement, with
    ``target`` the share of targets reached.
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
                label = None if number else style.literal(name)
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
