"""Pictures of what the paper has no figure of: onset, variants, what is kept, forces."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from studies.paper.bars import bar_of
from studies.paper.constants import RESOLVED
from studies.paper.figures import LINES
from studies.paper.measures import heading_turn, way_ahead
from studies.paper.onset import PAPER_TIMES, implied_rate
from studies.paper.runs import NUMERALS
from studies.paper.variants import VARIANTS
from studies.paper.verdicts import onset_of
from swim_env.plots.style import (
    BLUE,
    GREY,
    ORANGE,
    SMALL,
    TIME_COLOURS,
    diverging_map,
    new_figure,
    style_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "draw_constants",
    "draw_internal",
    "draw_onset",
    "draw_variants",
]

Data = Mapping[str, Any]
Arrays = Mapping[str, NDArray[Any]]

STARTS = {
    "epsilon": "2.2e-16 m/s",
    "small": "1e-4 m/s",
    "sloped": "(3.5 - x/dl) 1e-5 m/s",
}
_MARKS = {"epsilon": "o", "small": "s", "sloped": "^"}
#: How far apart the rows of energy are, in thousandths of the largest.
_ROW = 4.0
#: The smallest drift of momentum that is drawn (kg m/s, kg m²/s).
_FLOOR = 1e-18
#: What is drawn along the beam, and as what.
_MOMENTS = {"torque": "drive", "elastic": "spring", "total": "sum"}
_FORCES = {"shear": "across", "axial": "along"}
_LOOKS = ("o-", "s--", "^:")
_VARIANT_MARKS = ("s", "x", "o", "^", "v", "D")


def draw_onset(data: Data) -> Figure:
    """Draw times of the first deviation and growth rates, ours beside the paper's."""
    figure = new_figure(8.6, 3.5)
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    bodies = [
        (n, panels)
        for n in (3, 9, 27)
        for panels in (4, 12)
        if onset_of(data, n, panels, "small") is not None
    ]
    for colour, (kind, name) in zip(LINES, STARTS.items(), strict=False):
        for x, (n, panels) in enumerate(bodies):
            ours = onset_of(data, n, panels, kind)
            if ours is not None and ours["time"] is not None:
                left.plot(x - 0.1, ours["time"], _MARKS[kind], color=colour, markersize=6)
            if ours is not None and ours["expected"] is not None:
                left.plot(x - 0.1, ours["expected"], "_", color="black", markersize=12)
            paper = PAPER_TIMES.get((n, panels, kind))
            if paper is not None:
                left.plot(
                    x + 0.18, paper, _MARKS[kind], color=colour, markersize=6, fillstyle="none"
                )
        left.plot([], [], _MARKS[kind], color=colour, label=name)
    left.plot([], [], "o", color=GREY, fillstyle="none", label="hollow: the paper")
    left.plot([], [], "_", color="black", markersize=12, label="Kirchhoff's equations")
    left.set_yscale("log")
    left.set_ylim(1.0, 400.0)
    left.set_xticks(range(len(bodies)), [f"N = {n}\n{panels} panels" for n, panels in bodies])
    figure.legend(
        *left.get_legend_handles_labels(),
        loc="outside lower left",
        ncols=5,
        fontsize=SMALL - 1,
        frameon=False,
    )
    left.set_title("an end is 1 % of the length off its line", fontsize=SMALL, loc="left")
    style_axes(left, "", "time (s)")
    _draw_rates(right, data)
    return figure


def _draw_rates(axes: Axes, data: Data) -> None:
    shown = [one for one in data["onset"] if one["rate"] is not None and one["step"] == 0.01]
    bodies = sorted({(one["elements"], one["panels"]) for one in shown})
    for one in shown:
        axes.plot(
            bodies.index((one["elements"], one["panels"])),
            one["rate"],
            _MARKS[one["perturbation"]],
            color=BLUE,
            markersize=4,
            alpha=0.6,
        )
    for x, (n, panels) in enumerate(bodies):
        # Of the body's own masses, which hang on elements and panels and on nothing else.
        rate = next(
            one["kirchhoff"] for one in shown if (one["elements"], one["panels"]) == (n, panels)
        )
        axes.plot([x - 0.35, x + 0.35], [rate, rate], color="black", linewidth=1.2)
        times = [PAPER_TIMES.get((n, panels, kind)) for kind in ("epsilon", "small")]
        if times[0] is not None and times[1] is not None:
            axes.plot(
                x,
                implied_rate(times[0], times[1]),
                "D",
                color=ORANGE,
                fillstyle="none",
                markersize=6,
            )
    axes.plot([], [], "o", color=BLUE, label="fitted to our runs")
    axes.plot([], [], color="black", label="Kirchhoff's equations")
    axes.plot([], [], "D", color=ORANGE, fillstyle="none", label="needed by the paper's pairs")
    axes.set_ylim(0.0, 1.0)
    axes.set_xlim(-0.5, len(bodies) - 0.5)
    axes.set_xticks(range(len(bodies)), [f"{n}, {panels}" for n, panels in bodies])
    axes.legend(fontsize=SMALL - 1, frameon=False, loc="upper right")
    axes.set_title("growth rate at 0.1 m/s", fontsize=SMALL, loc="left")
    style_axes(axes, "N, panels", "rate (1/s)")


def draw_variants(data: Data) -> Figure:
    """Draw direction and speed of every driven scene, and how it turns, for every variant."""
    figure = new_figure(8.6, 4.6)
    top, bottom = figure.subplots(2, 1, sharex=True)
    scenes = [name for name in NUMERALS[:9] if name in data["runs"]]
    rows: list[tuple[str, str, Mapping[str, Any]]] = [
        ("closed outline (ours)", "*", {name: data["runs"][name] for name in scenes})
    ]
    for mark, (variant, words) in zip(_VARIANT_MARKS, VARIANTS.items(), strict=True):
        if variant in data["variants"]:
            rows.append((words, mark, {k: v["base"] for k, v in data["variants"][variant].items()}))
    spread = np.linspace(-0.3, 0.3, len(rows))
    colours = ("#000000", *LINES[:6])
    for i, (words, mark, of_scene) in enumerate(rows):
        known = [
            x for x, name in enumerate(scenes) if name in of_scene and not of_scene[name]["end"]
        ]
        ahead, turn = [], []
        for x in known:
            run = of_scene[scenes[x]]
            ahead.append(way_ahead(run))
            turn.append(heading_turn(run))
        look = {"marker": mark, "color": colours[i], "linestyle": "", "markersize": 6}
        top.plot(np.array(known) + spread[i], ahead, label=words, **look)
        bottom.plot(np.array(known) + spread[i], turn, **look)
    for axes in (top, bottom):
        axes.axhline(0.0, color=GREY, linewidth=0.6)
        for x in range(len(scenes) - 1):
            axes.axvline(x + 0.5, color="#DDDDDD", linewidth=0.6)
    top.set_yscale("symlog", linthresh=0.03)
    top.set_ylim(-6.0, 6.0)
    top.set_yticks([-1.0, -0.1, 0.0, 0.1, 1.0], ["-1", "-0.1", "0", "0.1", "1"])
    top.set_xticks(range(len(scenes)), scenes)
    duration = data["runs"][scenes[0]]["duration"] if scenes else 0.0
    top.set_title(f"runs of {duration:g} s", fontsize=SMALL, loc="left")
    style_axes(top, "", "head first (body lengths)")
    style_axes(bottom, "scene", "turn (°), left positive")
    figure.legend(loc="outside lower center", ncols=2, fontsize=SMALL - 1, frameon=False)
    return figure


def draw_constants(data: Data, arrays: Mapping[str, Arrays]) -> Figure:
    """Draw what energy and momentum do over time in the twelve runs.

    Parameters
    ----------
    data : mapping
        Of `studies.paper.suite.collect`.
    arrays : mapping
        Of each scene, those of `studies.paper.runs.play_run`.
    """
    from matplotlib import colormaps

    figure = new_figure(8.6, 4.2)
    left, right = figure.subplots(1, 2)
    names = [name for name in NUMERALS if name in arrays]
    colours = colormaps[TIME_COLOURS](np.linspace(0.0, 0.92, max(1, len(names))))
    for i, name in enumerate(names):
        found, energy = arrays[name], data["runs"][name]["energy"]
        look = {"color": colours[i], "linewidth": 0.8, "linestyle": ("-", "--", ":")[i % 3]}
        scale = energy["largest"] or 1.0
        left.axhline(-_ROW * i, color="#DDDDDD", linewidth=0.5)
        share = 1e3 * found["unexplained"] / scale
        left.plot(found["series_time"], share - _ROW * i, color=colours[i], linewidth=0.7)
        # Round-off goes up and down by decades: the largest so far says what is kept.
        drift = np.maximum.accumulate(np.maximum(found["drift"], _FLOOR))
        right.plot(found["series_time"], drift, label=name, **look)
    bound = max((data["runs"][name]["momentum"]["bound"] for name in names), default=1e-9)
    right.axhline(1e-9, color="black", linewidth=1.0)
    right.annotate(
        "the paper's 1e-9", (0.02, 1.3e-9), xycoords=("axes fraction", "data"), fontsize=SMALL - 1
    )
    right.set_yscale("log")
    right.set_ylim(_FLOOR, 10.0 * max(bound, 1e-9))
    left.set_yticks([-_ROW * i for i in range(len(names))], names)
    left.set_title(
        f"energy that the work does not explain: rows are {_ROW:g}/1000\nof the largest "
        "energy apart",
        fontsize=SMALL,
        loc="left",
    )
    right.set_title(
        "momentum: largest |J - J(0)| so far (kg m/s, kg m²/s)", fontsize=SMALL, loc="left"
    )
    style_axes(left, "time (s)", "scene")
    style_axes(right, "time (s)", "drift")
    figure.legend(loc="outside right center", fontsize=SMALL - 1, frameon=False)
    return figure


def draw_internal(data: Data, arrays: Mapping[str, Arrays]) -> Figure:
    """Draw moments and forces along the beam in scenes i and v, as far as steps resolve them.

    Parameters
    ----------
    data : mapping
        Of `studies.paper.suite.collect`; root mean squares of the whole run are drawn with their
        error bars.
    arrays : mapping
        Of each scene; those with ``total``.
    """
    names = [name for name in ("i", "v") if "total" in arrays.get(name, {})]
    figure = new_figure(8.6, 2.7 * max(1, len(names)))
    grid = figure.subplots(max(1, len(names)), 3, squeeze=False)
    for row, name in enumerate(names):
        found = arrays[name]
        joints = found["total"].shape[1]
        place = np.arange(1, joints + 1) / (joints + 1)
        for axes, keys in zip(grid[row], (_MOMENTS, _FORCES), strict=False):
            for colour, look, (key, words) in zip(LINES, _LOOKS, keys.items(), strict=False):
                values, bars = _along(data, name, key)
                axes.errorbar(
                    place,
                    values,
                    bars,
                    fmt=look,
                    color=colour,
                    markersize=4,
                    capsize=2.5,
                    label=words,
                )
        largest = float(np.abs(found["total"]).max()) or 1.0
        image = grid[row, 2].pcolormesh(
            place,
            np.arange(len(found["total"])) / len(found["total"]),
            found["total"],
            cmap=diverging_map(),
            vmin=-largest,
            vmax=largest,
            shading="nearest",
        )
        bar = figure.colorbar(image, ax=grid[row, 2])
        bar.set_label("sum (N m)", fontsize=SMALL)
        bar.ax.tick_params(labelsize=SMALL - 1)
        for axes in grid[row, :2]:
            axes.set_ylim(bottom=0.0)
            if row == 0:
                axes.legend(fontsize=SMALL - 1, frameon=False)
        grid[row, 0].set_title(
            f"{name}) moments at joints, below {RESOLVED:g} Hz", fontsize=SMALL, loc="left"
        )
        grid[row, 1].set_title("forces at joints", fontsize=SMALL, loc="left")
        grid[row, 2].set_title("sum, last second but one", fontsize=SMALL, loc="left")
        style_axes(grid[row, 0], "place s/l", "root mean square (N m)")
        style_axes(grid[row, 1], "place s/l", "root mean square (N)")
        style_axes(grid[row, 2], "place s/l", "time (s)")
    return figure


def _along(data: Data, name: str, key: str) -> tuple[list[float], list[float]]:
    """Return a figure of every joint and its error bar, zero where finer runs are missing."""
    runs = [data["runs"].get(f"{name}{level}", {}) for level in ("", "_half", "_fine")]
    values = [run.get("internal", {}).get(key) for run in runs]
    finer = [one or [None] * len(values[0]) for one in values[1:]]
    bars = [bar_of(*three) or 0.0 for three in zip(values[0], *finer, strict=True)]
    return values[0], bars
