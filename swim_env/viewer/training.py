"""Pictures of how agents learned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from swim_env.viewer.gaits import COLOURS
from swim_env.viewer.stills import SMALL, new_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw_training"]

Curve = Mapping[str, Sequence[float]]


def draw_training(
    curves: Mapping[str, Sequence[Curve]],
    task: str = "forward",
) -> Figure:
    """Draw periodic evaluations over steps and over time, a line for each training seed.

    Parameters
    ----------
    curves : mapping of str to sequence of mapping
        For each agent the columns of its runs' ``evaluations.csv``, from
        `agents.learning.logs.read_log`.
    task : str
        ``forward`` draws the net displacement, ``target`` the share of targets reached.
    """
    figure = new_figure(7.2, 2.9)
    target = task == "target"
    column = "success_rate" if target else "net_displacement_median"
    for place, (x, label, scale) in enumerate(
        (
            ("steps", "environment steps (millions)", 1e-6),
            ("seconds", "wall time (minutes)", 1 / 60),
        )
    ):
        axes = figure.add_subplot(1, 2, place + 1)
        for row, (name, runs) in enumerate(curves.items()):
            colour = COLOURS[(row + 1) % len(COLOURS)]
            for number, run in enumerate(runs):
                at = np.array(run[x]) * scale
                axes.plot(
                    at, run[column], color=colour, linewidth=1.2, label=None if number else name
                )
                if not target:
                    low, high = run["net_displacement_min"], run["net_displacement_max"]
                    axes.fill_between(at, low, high, color=colour, alpha=0.2, linewidth=0)
        what = "share of targets reached" if target else "net displacement (body lengths)"
        style_axes(axes, label, what if place == 0 else "")
        if place == 0:
            axes.legend(fontsize=SMALL - 1, frameon=False)
    shown = "" if target else ", band: least to most far of the starts"
    figure.suptitle(
        f"evaluation without exploration on fixed starts, a line a run{shown}", fontsize=SMALL
    )
    return figure
