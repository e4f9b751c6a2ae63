"""Displacement and what it takes: policies beside gaits that were optimised."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from swim_env.errors import SwimError
from swim_env.plots.style import BLACK, BLUE, LINE, SMALL, WIDTH, new_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_front(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw displacements against positive work, and the front: nothing swims farther for less.

    Parameters
    ----------
    rows : sequence of mappings
        Each with ``policy``, ``displacement`` (BL) and ``positive_work`` (J).

    Raises
    ------
    SwimError
        If none of them swims.
    """
    swims = [row for row in rows if row["displacement"] > 0.0 and row["positive_work"] > 0.0]
    if not swims:
        raise SwimError("none of the policies swims, so there is no front to draw")
    figure = new_figure(WIDTH, 4.2)
    axes = figure.add_subplot()
    best, reached = [], -1.0
    for row in sorted(swims, key=lambda row: row["positive_work"]):
        if row["displacement"] > reached:
            reached = row["displacement"]
            best.append(row)
    axes.plot(
        [row["positive_work"] for row in best],
        [row["displacement"] for row in best],
        color=BLACK,
        linewidth=LINE,
        zorder=1,
    )
    for row in swims:
        place = (row["positive_work"], row["displacement"])
        optimal = row["policy"].startswith("optimal") or row in best
        axes.plot(*place, "o", color=BLACK if optimal else BLUE, markersize=5, zorder=2)
        axes.annotate(
            row["policy"], place, (5, -3), textcoords="offset points", fontsize=SMALL, va="top"
        )
    axes.set_xscale("log")
    style_axes(axes, "positive work in the episode (J)", "displacement (BL)")
    axes.margins(x=0.25, y=0.1)
    return figure
