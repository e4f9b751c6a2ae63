"""The work-precision picture: error against cost, a panel for every scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from swim_env.accuracy.front import pareto
from swim_env.accuracy.reference import Reference
from swim_env.accuracy.settings import PAPER_SETTINGS, Settings
from swim_env.errors import SwimError
from swim_env.plots.style import (
    AMBER,
    BLACK,
    BLUE,
    FRONT,
    GREEN,
    GREY,
    LINE,
    ORANGE,
    PINK,
    SHADE,
    SILVER,
    SMALL,
    new_figure,
    require_matplotlib,
    style_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_study"]

Run = Mapping[str, Any]

#: Shapes tell the schemes apart.
_COLOURS = {
    "strip": SILVER,
    "frozen": BLUE,
    "expansion": GREEN,
    "panels": ORANGE,
    "centreline": PINK,
}
_MARKS = {"paper": "o", "composed": "^"}
#: SciPy's solvers, all of one colour.
_SOLVER_MARKS = {"RK45": "v", "DOP853": "P", "Radau": "s", "BDF": "X", "LSODA": "D"}
_SOLVER_COLOUR = AMBER
_COLUMNS = 3


def draw_study(runs: Sequence[Run], references: Mapping[str, Reference]) -> Figure:
    """Draw every run as a point, the front as a line and the paper's settings as a star.

    The front is that of the kernels; the points of SciPy's solvers have an edge.

    Parameters
    ----------
    runs : sequence of mapping
        Those of `Study.chosen_runs`.
    references : mapping of str to Reference
        By scene; below a reference's error bar differences mean nothing.

    Raises
    ------
    SwimError
        If matplotlib is not installed, or there are no runs.
    """
    require_matplotlib()
    from matplotlib.lines import Line2D

    scenes = list(dict.fromkeys(run["scene"] for run in runs))
    if not scenes:
        raise SwimError("there is nothing to draw: no run of the study came to its end")
    columns = min(_COLUMNS, len(scenes))
    rows = -(-len(scenes) // columns)
    figure = new_figure(2.9 * columns, 2.5 * rows + 0.7)
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for i, place in enumerate(axes.ravel()):
        if i >= len(scenes):
            place.set_axis_off()
            continue
        some = [run for run in runs if run["scene"] == scenes[i]]
        _draw_scene(place, some, references[scenes[i]])
        last_row = i + columns >= len(scenes)
        style_axes(
            place,
            "cost (paper's settings on paper_i = 1)" if last_row else "",
            "relative error of displacement" if i % columns == 0 else "",
        )
        place.set_title(scenes[i], fontsize=SMALL + 1)
    handles = [
        Line2D([], [], color=colour, marker="o", linestyle="", markersize=4, label=name)
        for name, colour in _COLOURS.items()
        if any(run["fluid_model"] == name for run in runs)
    ]
    solvers = {run["scheme"] for run in runs}
    handles += [
        Line2D([], [], **_of_solver(name), linestyle="", label=f"SciPy's {name}")
        for name in _SOLVER_MARKS
        if name in solvers
    ]
    handles += [
        Line2D([], [], color=GREY, marker=mark, linestyle="", markersize=4, label=f"{name} scheme")
        for name, mark in _MARKS.items()
    ]
    handles += [
        Line2D([], [], color=FRONT, linewidth=LINE, label="front"),
        Line2D(
            [], [], color=BLACK, marker="*", linestyle="", markersize=9, label="paper's settings"
        ),
        Line2D([], [], color=SHADE, linewidth=6, label="within the reference's error bar"),
    ]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=5, fontsize=SMALL, frameon=False
    )
    return figure


def _of_solver(name: str) -> dict[str, Any]:
    """Return how the runs of one of SciPy's solvers look."""
    return {
        "marker": _SOLVER_MARKS[name],
        "color": _SOLVER_COLOUR,
        "markersize": 5,
        "markeredgecolor": BLACK,
        "markeredgewidth": 0.6,
    }


def _draw_scene(axes: Axes, runs: Sequence[Run], reference: Reference) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.axhspan(1e-6, max(reference.uncertainty, 1e-6), color=SHADE, linewidth=0, zorder=0)
    for run in runs:
        if run["scheme"] in _SOLVER_MARKS:
            look = _of_solver(run["scheme"])
            axes.plot(run["cost"], run["error"], **look, linestyle="", zorder=3)
            continue
        axes.plot(
            run["cost"],
            run["error"],
            marker=_MARKS[run["scheme"]],
            color=_COLOURS.get(run["fluid_model"], GREY),
            markersize=3,
            linestyle="",
            alpha=0.7,
        )
    front = pareto(runs)
    axes.step(
        [run["cost"] for run in front],
        [run["error"] for run in front],
        where="post",
        color=FRONT,
        linewidth=LINE,
    )
    for run in runs:
        if Settings.from_dict(run) == PAPER_SETTINGS:
            axes.plot(run["cost"], run["error"], marker="*", color=BLACK, markersize=10)
    axes.set_ylim(5e-5, 5.0)
