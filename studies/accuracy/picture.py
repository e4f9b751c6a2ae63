"""The work-precision picture: error against cost, a panel for every scene."""

from __future__ import annotations

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

__all__ = ["draw_study"]

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
    style.require_matplotlib()
    scenes = list(dict.fromkeys(run["scene"] for run in runs))
    if not scenes:
        raise SwimError("there is nothing to draw: no run of the study came to its end")
    columns = min(_COLUMNS, len(scenes))
    rows = -(-len(scenes) // columns)
    figure = style.new_figure(2.9 * columns, 2.5 * rows + 0.7)
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for i, place in enumerate(axes.ravel()):
        if i >= len(scenes):
            place.set_axis_off()
            continue
        some = [run for run in runs if run["scene"] == scenes[i]]
        _draw_scene(place, some, references[scenes[i]])
        last_row = i + columns >= len(scenes)
        style.style_axes(
            place,
            "cost (paper's settings on paper_i = 1)" if last_row else "",
            "relative error of displacement" if i % columns == 0 else "",
        )
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
    return {
        "marker": _SOLVER_MARKS[name],
        "linestyle": "",
        "color": style.AMBER,
        "markersize": 5,
        "markeredgecolor": style.BLACK,
        "markeredgewidth": 0.6,
    }


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
