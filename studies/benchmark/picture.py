"""The benchmark's picture: what a physics step costs, of what it consists, and the peers."""

from __future__ import annotations

import itertools
import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from swim_env.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.gridspec import SubplotSpec

Record = Mapping[str, Any]

#: Neighbours differ in lightness as well.
_COLOURS = (
    *(style.BLUE, style.SKY, style.GREEN, style.YELLOW),
    *(style.AMBER, style.ORANGE, style.PINK, style.SILVER),
)
#: What the picture shows of the fluid models and panels, where it was measured.
_SHOWN = ("panels", 4)
#: Colours and marks of what was measured.
_KINDS = {
    "this package, fluid of panels": (style.BLUE, "o"),
    "peers with a drag for the fluid": (style.ORANGE, "s"),
    "peers without fluid": (style.GREY, "D"),
}
#: What is written outside the axes.
_NOTE: dict[str, Any] = {"fontsize": style.SMALL, "color": style.GREY}


def draw_benchmark(record: Record) -> Figure:
    """Draw what `scripts/benchmark.py` ends with; what was not measured stays empty and says so.

    Left above, the time of a step over the number of elements with the floor and the fitted growth;
    left below, its parts. Right, simulated seconds per second of wall time of this package and of
    the peers, each peer in the fastest of the ways to run it. It needs matplotlib.
    """
    figure = style.new_figure(style.WIDTH, 6.0)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.25, 1.0), height_ratios=(1.0, 1.15))
    cells, speeds = _shown_cells(record.get("kernel", [])), _shown_speeds(record.get("speeds", {}))
    fits = [fit for fit in record.get("growth", []) if cells and _kind(fit) == _kind(cells[0])]
    panels: tuple[tuple[SubplotSpec, str, Callable[..., None], tuple[Any, ...]], ...] = (
        (grid[0, 0], "the physics step", _draw_growth, (cells, fits)),
        (grid[1, 0], "the parts of a step", _draw_parts, (cells,)),
        (grid[:, 1], "the environments and peers", _draw_speeds, (speeds,)),
    )
    for place, what, draw, shown in panels:
        axes = figure.add_subplot(place)
        if shown[0]:
            draw(axes, *shown)
        else:
            axes.set_axis_off()
            where: dict[str, Any] = {"ha": "center", "va": "center", "transform": axes.transAxes}
            axes.text(0.5, 0.5, f"{what}: not measured", **_NOTE, **where)
    machine = record.get("machine")
    if machine:
        figure.suptitle(
            f"{machine['processor']}, {machine['cores']} cores, commit "
            f"{(record.get('commit') or 'unknown')[:10]}, {record.get('date')}",
            **_NOTE,
        )
    return figure


def _kind(measured: Record) -> tuple[str, int]:
    return measured["fluid_model"], measured["panels_per_element"]


def _shown_cells(cells: Sequence[Record]) -> list[Record]:
    """Return the cells of one fluid model and number of panels, the usual one if it is there."""
    kinds = [_kind(cell) for cell in cells]
    shown = _SHOWN if _SHOWN in kinds else kinds[0] if kinds else None
    some = [cell for cell in cells if _kind(cell) == shown]
    return sorted(some, key=lambda cell: int(cell["elements"]))


def _shown_speeds(speeds: Mapping[str, Record]) -> list[Record]:
    """Return all of this package, and of the ways to run the same peer the fastest."""
    shown: dict[tuple[str, object], Record] = {}
    for name, speed in speeds.items():
        key = (name.partition("/")[0] if speed.get("peer") else name, speed.get("fluid"))
        if key not in shown or _rate(speed) > _rate(shown[key]):
            shown[key] = speed
    return list(shown.values())


def _rate(speed: Record) -> float:
    return float(speed["simulated_seconds_per_second"]["median"])


def _kind_of(speed: Record) -> str:
    """Return which of _KINDS was measured: MuJoCo's drag counts as a fluid, damping does not."""
    ours, drag, none = _KINDS
    if not speed.get("peer"):
        return ours
    has_drag = speed["fluid"] != "none" if "fluid" in speed else "Swimmer" in speed["label"]
    return drag if has_drag else none


def _bars(spreads: Sequence[Record]) -> list[list[float]]:
    """Return how far the quartiles are below and above the medians."""
    below = [spread["median"] - spread["low"] for spread in spreads]
    return [below, [spread["high"] - spread["median"] for spread in spreads]]


def _draw_growth(axes: Axes, cells: Sequence[Record], fits: Sequence[Record]) -> None:
    """Draw the time of a step with its quartiles, the floor's markers, and the longest fit."""
    elements = [cell["elements"] for cell in cells]
    steps = [cell["step"] for cell in cells]
    medians = [step["median"] for step in steps]
    line: dict[str, Any] = {"color": style.BLUE, "linewidth": style.LINE, "markersize": 4}
    label = "step (median, quartiles)"
    axes.errorbar(elements, medians, _bars(steps), fmt="o-", capsize=2, label=label, **line)
    floor = [(cell["elements"], cell["floor"]["median"]) for cell in cells if cell.get("floor")]
    _mark_floor(axes, floor, style.ORANGE, 4)
    if fits:
        fit = max(fits, key=lambda one: int(one["points"]))
        ends = [fit["elements_from"], fit["elements_to"]]
        values = [fit["microseconds_of_one"] * n ** fit["exponent"] for n in ends]
        line = {"color": style.GREY, "linewidth": style.LINE, "zorder": 1}
        axes.plot(ends, values, ":", label=f"fit, N to the power {fit['exponent']:.2f}", **line)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(elements, [str(n) for n in elements])
    axes.minorticks_off()
    # Room for the legend.
    axes.set_ylim(top=6.0 * max(medians))
    style.add_legend(axes, loc="upper left")
    model, panels = _kind(cells[0])
    style.name_panel(axes, f"a physics step ({model}, {panels} panels per element)")
    style.style_axes(axes, "elements N", "time of a step (\u00b5s)")


def _mark_floor(axes: Axes, points: Sequence[tuple[int, float]], colour: str, size: int) -> None:
    if points:
        x, y = zip(*points, strict=True)
        axes.plot(x, y, "D", color=colour, markersize=size, markerfacecolor="white", label="floor")


def _draw_parts(axes: Axes, cells: Sequence[Record]) -> None:
    """Draw the shares of the parts in a step, with the step's time above and the floor's share."""
    names = list(dict.fromkeys(part for cell in cells for part in cell["parts"]))
    places = range(len(cells))
    # A rest below zero is noise of the other parts, which are then shared out among themselves.
    totals = [sum(max(0.0, part["median"]) for part in cell["parts"].values()) for cell in cells]
    bottom = np.zeros(len(cells))
    look: dict[str, Any] = {"width": 0.75, "edgecolor": "white", "linewidth": 0.5}
    for name, colour in zip(names, itertools.cycle(_COLOURS), strict=False):
        medians = [cell["parts"].get(name, {"median": 0.0})["median"] for cell in cells]
        heights = 100.0 * np.maximum(0.0, medians) / totals
        label = name.replace("_", " ")
        axes.bar(places, heights, bottom=bottom, color=colour, label=label, **look)
        bottom += heights
    floor = []
    for place, cell in enumerate(cells):
        step = cell["step"]["median"]
        axes.text(place, 101.5, _time(step), ha="center", va="bottom", fontsize=style.SMALLER)
        if cell.get("floor"):
            floor.append((place, 100.0 * cell["floor"]["median"] / step))
    _mark_floor(axes, floor, style.BLACK, 5)
    axes.set_xticks(places, [str(cell["elements"]) for cell in cells])
    # A floor may lie above a step that is faster than it: keep it in sight.
    axes.set_ylim(0.0, max([112.0, *(1.06 * share for _, share in floor)]))
    axes.set_yticks(range(0, 101, 25))
    _legend_below(axes, (0.45, -0.22), ncols=3, columnspacing=1.0)
    style.style_axes(axes, "elements N", "share of a step (%)")


def _legend_below(axes: Axes, place: tuple[float, float], **how: Any) -> None:
    style.add_legend(axes, loc="upper center", bbox_to_anchor=place, handlelength=1.0, **how)


def _time(microseconds: float) -> str:
    """Return a time with its unit, two digits at least."""
    milli = microseconds >= 1000.0
    value, unit = (1e-3 * microseconds, "ms") if milli else (microseconds, "\u00b5s")
    return f"{value:.0f} {unit}" if value >= 10.0 else f"{value:.1f} {unit}"


def _draw_speeds(axes: Axes, speeds: Sequence[Record]) -> None:
    """Draw simulated seconds per second, the first at the top, with quartiles."""
    from matplotlib.ticker import NullFormatter

    places = range(len(speeds))
    rates = [speed["simulated_seconds_per_second"] for speed in speeds]
    medians = [rate["median"] for rate in rates]
    kinds = [_kind_of(speed) for speed in speeds]
    for kind, (colour, mark) in _KINDS.items():
        some = [place for place in places if kinds[place] == kind]
        if some:
            bars = _bars([rates[place] for place in some])
            look: dict[str, Any] = {"fmt": mark, "color": colour, "markersize": 6}
            look |= {"capsize": 2, "linewidth": 1}
            axes.errorbar([medians[place] for place in some], some, xerr=bars, label=kind, **look)
    axes.set_xscale("log")
    # Whole decades, so that there are labels at both ends.
    decades = (math.floor(math.log10(0.7 * min(medians))), math.ceil(math.log10(2 * max(medians))))
    axes.set_xlim(10.0 ** decades[0], 10.0 ** decades[1])
    axes.xaxis.set_minor_formatter(NullFormatter())
    for place, rate in enumerate(rates):
        number = f"{rate['median']:,.0f}" if rate["median"] >= 100.0 else f"{rate['median']:.3g}"
        where: dict[str, Any] = {"xytext": (7, 0), "textcoords": "offset points"}
        axes.annotate(number, (rate["high"], place), va="center", fontsize=style.SMALLER, **where)
    axes.set_yticks(places, [textwrap.fill(speed["label"], 24) for speed in speeds])
    axes.invert_yaxis()
    axes.grid(axis="y", color=style.GRID, linewidth=style.THIN)
    _legend_below(axes, (0.3, -0.09), ncols=1)
    style.name_panel(axes, "speed (batches: all members)")
    style.style_axes(axes, "simulated time per wall time (s/s)", "")
    axes.tick_params(axis="y", labelsize=style.SMALLER)
