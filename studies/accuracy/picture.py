"""The work-precision picture: error against cost, a panel for every scene."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from studies.accuracy.front import pareto
from studies.accuracy.runs import Run
from swim_env.accuracy.reference import Reference
from swim_env.accuracy.settings import PAPER_SETTINGS, Settings
from swim_env.errors import SwimError
from swim_env.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Colours tell the fluid models apart, shapes the schemes.
_COLOURS = {
    "strip": style.SILVER,
    "frozen": style.BLUE,
    "expansion": style.GREEN,
    "panels": style.ORANGE,
    "centreline": style.PINK,
}
_MARKS = {"paper": "o", "composed": "^"}
#: SciPy's solvers have one colour and an edge.
_SOLVER_MARKS = {"RK45": "v", "DOP853": "P", "Radau": "s", "BDF": "X", "LSODA": "D"}
_COLUMNS = 3


def draw_study(runs: Sequence[Run], references: Mapping[str, Reference]) -> Figure:
    """Draw every run as a point, the front as a line and the paper's settings as a star.

    The front is that of the kernels; the points of SciPy's solvers have an edge. Runs are those of
    `Study.chosen_runs`, without which there is a SwimError, and references are by scene: below
    their error bars differences mean nothing.
    """
    style.require_matplotlib()
    scenes = list(dict.fromkeys(run["scene"] for run in runs))
    if not scenes:
        raise SwimError("there is nothing to draw: no run of the study came to its end")
    columns = min(_COLUMNS, len(scenes))
    rows = math.ceil(len(scenes) / columns)
    figure = style.new_figure(2.9 * columns, 2.5 * rows + 0.7)
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for i, place in enumerate(axes.ravel()):
        if i >= len(scenes):
            place.set_axis_off()
            continue
        some = [run for run in runs if run["scene"] == scenes[i]]
        _draw_scene(place, some, references[scenes[i]])
        cost = "cost (paper's settings on paper_i = 1)" if i + columns >= len(scenes) else ""
        style.style_axes(place, cost, "" if i % columns else "relative error of displacement")
        place.set_title(scenes[i], fontsize=style.SMALL + 1)
    _draw_legend(figure, runs)
    return figure


def _draw_legend(figure: Figure, runs: Sequence[Run]) -> None:
    from matplotlib.lines import Line2D

    def entry(label: str, **look: Any) -> Line2D:
        return Line2D([], [], label=label, **look)

    models = {run["fluid_model"] for run in runs}
    schemes = {run["scheme"] for run in runs}
    dot: dict[str, Any] = {"linestyle": "", "markersize": 4}
    handles = [
        *(entry(m, color=c, marker="o", **dot) for m, c in _COLOURS.items() if m in models),
        *(entry(f"SciPy's {s}", **_of_solver(s)) for s in _SOLVER_MARKS if s in schemes),
        *(entry(f"{s} scheme", color=style.GREY, marker=m, **dot) for s, m in _MARKS.items()),
        entry("front", color=style.FRONT, linewidth=style.LINE),
        entry("paper's settings", color=style.BLACK, marker="*", linestyle="", markersize=9),
        entry("within the reference's error bar", color=style.SHADE, linewidth=6),
    ]
    look: dict[str, Any] = {"ncols": 5, "fontsize": style.SMALL, "frameon": False}
    figure.legend(handles=handles, loc="outside lower center", **look)


def _of_solver(name: str) -> dict[str, Any]:
    """Return how the runs of one of SciPy's solvers look."""
    edge = {"markeredgecolor": style.BLACK, "markeredgewidth": 0.6}
    dot = {"marker": _SOLVER_MARKS[name], "linestyle": "", "markersize": 5}
    return {**dot, "color": style.AMBER, **edge}


def _draw_scene(axes: Axes, runs: Sequence[Run], reference: Reference) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    bar = max(reference.uncertainty, 1e-6)
    axes.axhspan(1e-6, bar, color=style.SHADE, linewidth=0, zorder=0)
    for run in runs:
        point = (run["cost"], run["error"])
        if run["scheme"] in _SOLVER_MARKS:
            axes.plot(*point, **_of_solver(run["scheme"]), zorder=3)
            continue
        colour, mark = _COLOURS.get(run["fluid_model"], style.GREY), _MARKS[run["scheme"]]
        axes.plot(*point, color=colour, marker=mark, markersize=3, linestyle="", alpha=0.7)
    front = pareto(runs)
    costs, errors = ([run[key] for run in front] for key in ("cost", "error"))
    axes.step(costs, errors, where="post", color=style.FRONT, linewidth=style.LINE)
    for run in runs:
        if Settings.from_dict(run) == PAPER_SETTINGS:
            axes.plot(run["cost"], run["error"], marker="*", color=style.BLACK, markersize=10)
    axes.set_ylim(5e-5, 5.0)
