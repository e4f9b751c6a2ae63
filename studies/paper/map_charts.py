"""The picture of the maps: net speed over drive and body."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from studies.paper.maps import is_verified
from studies.paper.verdicts import Data
from swim_env.plots.style import SMALL, diverging_map, new_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_maps"]


def draw_maps(data: Data) -> Figure:
    """Draw net speed over frequency and wave number, and over stiffness and length.

    Grey points are not verified; lines are the natural frequencies of the straight body.
    """
    from matplotlib.patheffects import withStroke

    figure = new_figure(9.0, 4.6)
    left, right = figure.subplots(1, 2)
    drive = sorted(data["maps"].get("drive", []), key=lambda row: row["frequency"])
    body = sorted(data["maps"].get("body", []), key=lambda row: row["stiffness"])
    if drive:
        frequencies = [row["frequency"] for row in drive]
        across = np.array(drive[0]["columns"]) / math.pi
        _draw_map(figure, left, across, np.array(frequencies), drive)
        for frequency in drive[0]["resonances"][0]:
            if frequency <= frequencies[-1]:
                left.axhline(frequency, color="black", linewidth=0.9, linestyle="--")
                left.annotate(
                    f"{frequency:.1f} Hz",
                    (across[0], frequency),
                    xytext=(2, 2),
                    textcoords="offset points",
                    fontsize=SMALL - 1,
                    path_effects=[withStroke(linewidth=2.5, foreground="white")],
                )
        left.plot(2.0, 1.0, "*", color="black", markerfacecolor="white", markersize=9)
    left.set_title("drive: scene swimmer, 1 N m (star: the paper's)", fontsize=SMALL, loc="left")
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
        first = np.array([[modes[0] for modes in row["resonances"]] for row in body])
        second = np.array([[modes[1] for modes in row["resonances"]] for row in body])
        if min(first.shape) > 1:
            for values, style in ((first, "--"), (second, ":")):
                if values.min() < 1.0 < values.max():
                    right.contour(
                        lengths, stiffness, values, [1.0], colors="black", linestyles=style
                    )
        for length, name in ((1.0, "iii"), (2.0, "v")):
            right.plot(length, 5.0, "*", color="black", markerfacecolor="white", markersize=9)
            right.annotate(
                name,
                (length, 5.0),
                xytext=(6, 4),
                textcoords="offset points",
                fontsize=SMALL,
                path_effects=[withStroke(linewidth=2.5, foreground="white")],
            )
    right.set_title(
        "body: the paper's wave, 0.5 N m (-- first, ··· second mode at 1 Hz)",
        fontsize=SMALL,
        loc="left",
    )
    style_axes(right, "length (m)", "stiffness EI (N m²)")
    return figure


def _draw_map(
    figure: Figure, axes: Axes, x: NDArray[Any], y: NDArray[Any], rows: Sequence[Data]
) -> None:
    """Draw a row of points after another, in colour where they are verified and grey elsewhere."""
    from matplotlib.colors import SymLogNorm

    good = np.array([[is_verified(point) for point in row["points"]] for row in rows])
    speed = np.array(
        [[np.nan if p["speed"] is None else p["speed"] for p in row["points"]] for row in rows]
    )
    known = np.abs(speed[good & np.isfinite(speed)])
    largest = float(known.max()) if known.size else 1.0
    axes.set_facecolor("#BBBBBB")
    image = axes.pcolormesh(
        x,
        y,
        np.ma.masked_where(~good, speed),
        cmap=diverging_map(),
        norm=SymLogNorm(max(1e-3, 1e-2 * largest), vmin=-largest, vmax=largest),
        shading="nearest",
    )
    bar = figure.colorbar(image, ax=axes, location="bottom", shrink=0.9, aspect=35)
    bar.set_label(
        "net speed (body lengths a second): orange head first, blue tail first;\n"
        "grey: not verified",
        fontsize=SMALL,
    )
    bar.ax.tick_params(labelsize=SMALL - 2)
