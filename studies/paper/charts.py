"""Pictures of what the paper has no figure of: onset, variants, what is kept, forces, maps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from studies.paper.bars import bar_of
from studies.paper.constants import RESOLVED
from studies.paper.figures import LINES
from studies.paper.maps import is_verified
from studies.paper.measures import heading_turn, way_ahead
from studies.paper.onset import LATERAL, PAPER_TIMES, implied_rate
from studies.paper.runs import NUMERALS
from studies.paper.variants import VARIANTS
from studies.paper.verdicts import LEVELS, Data, onset_of
from swim_env.plots.style import (
    BLUE,
    GREY,
    ORANGE,
    SMALL,
    diverging_map,
    mark_ends,
    name_panel,
    new_figure,
    style_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Arrays = Mapping[str, NDArray[Any]]

#: The starts of the straight body, as they are called on the page.
STARTS = dict(zip(LATERAL, ("2.2e-16 m/s", "1e-4 m/s", "(3.5 - x/dl) 1e-5 m/s"), strict=True))
_MARKS = dict(zip(LATERAL, "os^", strict=True))
#: How far apart the rows of energy are, in thousandths of the largest.
_ROW = 4.0
#: The smallest drift of momentum that is drawn (kg m/s, kg m²/s).
_FLOOR = 1e-18
#: What is drawn along the beam, and as what.
_MOMENTS = {"torque": "drive", "elastic": "spring", "total": "sum"}
_FORCES = {"shear": "across", "axial": "along"}
_LOOKS = ("o-", "s--", "^:")
_VARIANT_MARKS = ("s", "x", "o", "^", "v", "D")
_LEGEND: dict[str, Any] = {"fontsize": SMALL - 1, "frameon": False}
_SPLIT = "#DDDDDD"


# ---- the straight body's instability -----------------------------------------------------------


def draw_onset(data: Data) -> Figure:
    """Draw times of the first deviation and growth rates, ours beside the paper's."""
    figure = new_figure(8.6, 3.5)
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    bodies = [x for x in product((3, 9, 27), (4, 12)) if onset_of(data, *x, "small") is not None]
    for colour, (kind, name) in zip(LINES, STARTS.items(), strict=False):
        mark = {"marker": _MARKS[kind], "color": colour, "markersize": 6}
        for x, (n, panels) in enumerate(bodies):
            ours = onset_of(data, n, panels, kind)
            if ours is not None and ours["time"] is not None:
                left.plot(x - 0.1, ours["time"], **mark)
            if ours is not None and ours["expected"] is not None:
                left.plot(x - 0.1, ours["expected"], "_", color="black", markersize=12)
            paper = PAPER_TIMES.get((n, panels, kind))
            if paper is not None:
                left.plot(x + 0.18, paper, fillstyle="none", **mark)
        left.plot([], [], _MARKS[kind], color=colour, label=name)
    left.plot([], [], "o", color=GREY, fillstyle="none", label="hollow: the paper")
    left.plot([], [], "_", color="black", markersize=12, label="Kirchhoff's equations")
    left.set_yscale("log")
    left.set_ylim(1.0, 400.0)
    left.set_xticks(range(len(bodies)), [f"N = {n}\n{panels} panels" for n, panels in bodies])
    lines, names = left.get_legend_handles_labels()
    figure.legend(lines, names, loc="outside lower left", ncols=5, **_LEGEND)
    name_panel(left, "an end is 1 % of the length off its line")
    style_axes(left, "", "time (s)")
    _draw_rates(right, data)
    return figure


def _draw_rates(axes: Axes, data: Data) -> None:
    shown = [one for one in data["onset"] if one["rate"] is not None and one["step"] == 0.01]
    # Kirchhoff's rate is that of the body's own masses, which depend on these two alone.
    rates = {(one["elements"], one["panels"]): one["kirchhoff"] for one in reversed(shown)}
    bodies = sorted(rates)
    for one in shown:
        x = bodies.index((one["elements"], one["panels"]))
        mark = _MARKS[one["perturbation"]]
        axes.plot(x, one["rate"], mark, color=BLUE, markersize=4, alpha=0.6)
    for x, body in enumerate(bodies):
        axes.plot([x - 0.35, x + 0.35], [rates[body]] * 2, color="black", linewidth=1.2)
        if (*body, "small") in PAPER_TIMES:
            rate = implied_rate(*(PAPER_TIMES[*body, kind] for kind in ("epsilon", "small")))
            axes.plot(x, rate, "D", color=ORANGE, fillstyle="none", markersize=6)
    axes.plot([], [], "o", color=BLUE, label="fitted to our runs")
    axes.plot([], [], color="black", label="Kirchhoff's equations")
    axes.plot([], [], "D", color=ORANGE, fillstyle="none", label="needed by the paper's pairs")
    axes.set_ylim(0.0, 1.0)
    axes.set_xlim(-0.5, len(bodies) - 0.5)
    axes.set_xticks(range(len(bodies)), [f"{n}, {panels}" for n, panels in bodies])
    axes.legend(loc="upper right", **_LEGEND)
    name_panel(axes, "growth rate at 0.1 m/s")
    style_axes(axes, "N, panels", "rate (1/s)")


# ---- readings of the print ---------------------------------------------------------------------


def draw_variants(data: Data) -> Figure:
    """Draw direction and speed of every driven scene, and how it turns, for every variant."""
    figure = new_figure(8.6, 4.6)
    top, bottom = figure.subplots(2, 1, sharex=True)
    scenes = [name for name in NUMERALS[:9] if name in data["runs"]]
    rows: list[tuple[str, str, Mapping[str, Any]]] = [("closed outline (ours)", "*", data["runs"])]
    for mark, (variant, words) in zip(_VARIANT_MARKS, VARIANTS.items(), strict=True):
        if variant in data["variants"]:
            rows.append((words, mark, {k: v["base"] for k, v in data["variants"][variant].items()}))
    spread = np.linspace(-0.3, 0.3, len(rows))
    for i, (words, mark, of_scene) in enumerate(rows):
        found = [(x, of_scene[name]) for x, name in enumerate(scenes) if name in of_scene]
        known = [(x + spread[i], run) for x, run in found if not run["end"]]
        colour = ("#000000", *LINES)[i]
        look = {"marker": mark, "color": colour, "linestyle": "", "markersize": 6}
        places, ways = [x for x, _ in known], [way_ahead(run) for _, run in known]
        top.plot(places, ways, label=words, **look)
        bottom.plot(places, [heading_turn(run) for _, run in known], **look)
    for axes in (top, bottom):
        axes.axhline(0.0, color=GREY, linewidth=0.6)
        for x in range(len(scenes) - 1):
            axes.axvline(x + 0.5, color=_SPLIT, linewidth=0.6)
    top.set_yscale("symlog", linthresh=0.03)
    top.set_ylim(-6.0, 6.0)
    top.set_yticks([-1.0, -0.1, 0.0, 0.1, 1.0], ["-1", "-0.1", "0", "0.1", "1"])
    top.set_xticks(range(len(scenes)), scenes)
    duration = data["runs"][scenes[0]]["duration"] if scenes else 0.0
    name_panel(top, f"runs of {duration:g} s")
    style_axes(top, "", "head first (body lengths)")
    style_axes(bottom, "scene", "turn (°), left positive")
    figure.legend(loc="outside lower center", ncols=2, **_LEGEND)
    return figure


# ---- what is kept ------------------------------------------------------------------------------


def draw_constants(data: Data, arrays: Mapping[str, Arrays]) -> Figure:
    """Draw the energy over time and how well momentum is kept in the twelve runs."""
    figure = new_figure(8.6, 4.2)
    left, right = figure.subplots(1, 2, width_ratios=(1.6, 1.0))
    names = [name for name in NUMERALS if name in arrays]
    for i, name in enumerate(names):
        found, energy = arrays[name], data["runs"][name]["energy"]
        scale = energy["largest"] or 1.0
        left.axhline(-_ROW * i, color=_SPLIT, linewidth=0.5)
        share = 1e3 * found["unexplained"] / scale
        left.plot(found["series_time"], share - _ROW * i, color=BLUE, linewidth=0.7)
        drift = max(float(found["drift"].max()), _FLOOR)
        right.plot(drift, i, "o", color=BLUE, markersize=5)
        right.annotate(
            f"{drift:.0e}", (drift, i), xytext=(6, 0), textcoords="offset points", va="center",
            fontsize=SMALL - 1,
        )  # fmt: skip
    right.axvline(1e-9, color=ORANGE, linewidth=1.4)
    right.annotate(
        "the paper's 1e-9", (1e-9, 0.5 * len(names)), xytext=(-4, 0), textcoords="offset points",
        ha="right", va="center", fontsize=SMALL - 1, color=ORANGE,
    )  # fmt: skip
    right.set_xscale("log")
    right.set_xlim(_FLOOR, 1e-8)
    right.set_yticks(range(len(names)), names)
    right.set_ylim(len(names) - 0.5, -0.5)
    left.set_yticks([-_ROW * i for i in range(len(names))], names)
    left.set_ylim(-_ROW * (len(names) - 0.5), 0.5 * _ROW)
    rows = f"rows are {_ROW:g}/1000\nof the largest energy apart"
    name_panel(left, f"energy that the work does not explain: {rows}")
    name_panel(right, "momentum: largest |J - J(0)|")
    style_axes(left, "time (s)", "scene")
    style_axes(right, "drift (kg m/s, kg m²/s)", "")
    return figure


# ---- forces along the beam ---------------------------------------------------------------------


def draw_internal(data: Data, arrays: Mapping[str, Arrays]) -> Figure:
    """Draw moments and forces along the beam in scenes i and v, as far as steps resolve them.

    Root mean squares of the whole run have error bars; over time there are arrays, ``total``.
    """
    names = [name for name in ("i", "v") if "total" in arrays.get(name, {})]
    figure = new_figure(8.6, 2.7 * max(1, len(names)))
    grid = figure.subplots(max(1, len(names)), 3, squeeze=False)
    for name, (moments, forces, over_time) in zip(names, grid, strict=True):
        total = arrays[name]["total"]
        joints = total.shape[1]
        place = np.arange(1, joints + 1) / (joints + 1)
        for axes, keys in ((moments, _MOMENTS), (forces, _FORCES)):
            for colour, mark, (key, words) in zip(LINES, _LOOKS, keys.items(), strict=False):
                style = {"color": colour, "markersize": 4, "capsize": 2.5, "label": words}
                axes.errorbar(place, *_along(data, name, key), fmt=mark, **style)
            axes.set_ylim(bottom=0.0)
            if name == names[0]:
                axes.legend(**_LEGEND)
        largest = float(np.abs(total).max()) or 1.0
        look = {"cmap": diverging_map(), "vmin": -largest, "vmax": largest, "shading": "nearest"}
        image = over_time.pcolormesh(place, np.arange(len(total)) / len(total), total, **look)
        bar = figure.colorbar(image, ax=over_time)
        mark_ends(bar)
        bar.set_label("sum (N m)", fontsize=SMALL)
        bar.ax.tick_params(labelsize=SMALL - 1)
        name_panel(moments, f"{name}) moments at joints, below {RESOLVED:g} Hz")
        name_panel(forces, "forces at joints")
        name_panel(over_time, "sum, last second but one")
        style_axes(moments, "place s/l", "root mean square (N m)")
        style_axes(forces, "place s/l", "root mean square (N)")
        style_axes(over_time, "place s/l", "time (s)")
    return figure


def _along(data: Data, name: str, key: str) -> tuple[list[float], list[float]]:
    """Return a figure of every joint and its error bar, zero where finer runs are missing."""
    runs = [data["runs"].get(f"{name}{level}", {}) for level in LEVELS]
    values = [run.get("internal", {}).get(key) for run in runs]
    finer = [one or [None] * len(values[0]) for one in values[1:]]
    bars = [bar_of(*three) or 0.0 for three in zip(values[0], *finer, strict=True)]
    return values[0], bars


# ---- maps --------------------------------------------------------------------------------------


def draw_maps(data: Data) -> Figure:
    """Draw net speed over frequency and wave number, and over stiffness and length.

    Grey points are not verified; lines are the natural frequencies of the straight body.
    """
    figure = new_figure(9.0, 4.6)
    left, right = figure.subplots(1, 2)
    drive = sorted(data["maps"].get("drive", []), key=lambda row: row["frequency"])
    body = sorted(data["maps"].get("body", []), key=lambda row: row["stiffness"])
    star: dict[str, Any] = {"color": "black", "markerfacecolor": "white", "markersize": 9}
    if drive:
        frequencies = np.array([row["frequency"] for row in drive])
        across = np.array(drive[0]["columns"]) / math.pi
        _draw_map(figure, left, across, frequencies, drive)
        for frequency in drive[0]["resonances"][0]:
            if frequency <= frequencies[-1]:
                left.axhline(frequency, color="black", linewidth=0.9, linestyle="--")
                place = (across[0], frequency)
                _write_over(left, f"{frequency:.1f} Hz", place, (2, 2), SMALL - 1)
        left.plot(2.0, 1.0, "*", **star)
    name_panel(left, "drive: scene swimmer, 1 N m (star: the paper's)")
    style_axes(left, "wave number κ (π rad per body length)", "frequency (Hz)")
    if body:
        stiffness = np.array([row["stiffness"] for row in body])
        lengths = np.array(body[0]["columns"])
        _draw_map(figure, right, lengths, stiffness, body)
        right.set_yscale("log")
        usual = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
        ticks = [one for one in usual if stiffness[0] <= one <= stiffness[-1]]
        right.set_yticks(ticks, [f"{one:g}" for one in ticks])
        right.set_yticks([], minor=True)
        modes = np.array([row["resonances"] for row in body])[..., :2]
        if min(modes.shape[:2]) > 1:
            for values, style in zip(np.moveaxis(modes, 2, 0), ("--", ":"), strict=True):
                if values.min() < 1.0 < values.max():
                    look = {"colors": "black", "linestyles": style}
                    right.contour(lengths, stiffness, values, [1.0], **look)
        for length, name in ((1.0, "iii"), (2.0, "v")):
            right.plot(length, 5.0, "*", **star)
            _write_over(right, name, (length, 5.0), (6, 4), SMALL)
    name_panel(right, "body: the paper's wave, 0.5 N m (-- first, ··· second mode at 1 Hz)")
    style_axes(right, "length (m)", "stiffness EI (N m²)")
    return figure


def _write_over(
    axes: Axes, text: str, place: tuple[float, float], away: tuple[int, int], size: int
) -> None:
    """Write beside a place, with a white edge that keeps it readable over a map."""
    from matplotlib.patheffects import withStroke

    edge = withStroke(linewidth=2.5, foreground="white")
    look: dict[str, Any] = {"fontsize": size, "path_effects": [edge]}
    axes.annotate(text, place, xytext=away, textcoords="offset points", **look)


def _draw_map(
    figure: Figure, axes: Axes, x: NDArray[Any], y: NDArray[Any], rows: Sequence[Data]
) -> None:
    """Draw a row of points after another, in colour where they are verified and grey elsewhere."""
    from matplotlib.colors import SymLogNorm

    good = np.array([[is_verified(point) for point in row["points"]] for row in rows])
    # None, where a run ended early, becomes NaN.
    speed = np.array([[point["speed"] for point in row["points"]] for row in rows], dtype=float)
    known = np.abs(speed[good & np.isfinite(speed)])
    largest = float(known.max()) if known.size else 1.0
    axes.set_facecolor("#BBBBBB")
    norm = SymLogNorm(max(1e-3, 1e-2 * largest), vmin=-largest, vmax=largest)
    look: dict[str, Any] = {"cmap": diverging_map(), "norm": norm, "shading": "nearest"}
    image = axes.pcolormesh(x, y, np.ma.masked_where(~good, speed), **look)
    bar = figure.colorbar(image, ax=axes, location="bottom", shrink=0.9, aspect=35)
    decades = [0.01 * largest, 0.1 * largest, largest]
    places = [*(-one for one in decades[::-1]), 0.0, *decades]
    bar.set_ticks(places, labels=[f"{one:.2g}" for one in places])
    bar.ax.minorticks_off()
    words = "net speed (body lengths a second): orange head first, blue tail first;\n"
    bar.set_label(f"{words}grey: not verified", fontsize=SMALL)
    bar.ax.tick_params(labelsize=SMALL - 2)
