"""Pictures of a sweep: a figure over one field or two."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from swim_env.errors import SwimError
from swim_env.plots import style
from swim_env.plots.heat_maps import add_bar

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw_sweep"]

#: Fields whose largest value is so many times the least are drawn on a logarithmic axis.
_WIDE = 30.0


def draw_sweep(names: Sequence[str], values: Sequence[Sequence[float]]) -> Figure:
    """Draw a figure over one field, or in colours over two.

    Where several runs agree in these fields (seeds, for example), over one field each is a dot and
    their medians are joined; over two the colour is that of their median.

    Parameters
    ----------
    names : sequence of str
        The fields, and last the figure.
    values : sequence of sequence of float, (runs, len(names))
        Of every run.

    Raises
    ------
    SwimError
        If there are no runs to draw.
    """
    if not len(values):
        raise SwimError(f"there is nothing to draw: no run has numbers for {', '.join(names)}")
    table = np.array(values, dtype=float)
    places, members = np.unique(table[:, :-1], axis=0, return_inverse=True)
    members = members.reshape(-1)
    medians = [float(np.median(table[members == i, -1])) for i in range(len(places))]
    figure = style.new_figure(0.8 * style.WIDTH, 4.2)
    axes = figure.add_subplot()
    shown = [style.literal(name) for name in names]
    if len(names) == 2:
        axes.plot(table[:, 0], table[:, 1], "o", color=style.SKY, markersize=4, label="runs")
        axes.plot(
            places[:, 0], medians, "-", color=style.BLUE, linewidth=style.LINE, label="median"
        )
        style.add_legend(axes)
    else:
        points = axes.scatter(
            places[:, 0], places[:, 1], c=medians, s=60, cmap=style.TIME_COLOURS,
            edgecolors=style.GREY, linewidths=style.THIN,
        )  # fmt: skip
        add_bar(figure, axes, points, shown[2])
    for axis, column in zip("xy", places.T, strict=False):
        if column.min() > 0.0 and column.max() > _WIDE * column.min():
            getattr(axes, f"set_{axis}scale")("log")
    runs = f"{len(table)} runs" if len(table) > 1 else "1 run"
    style.style_axes(axes, shown[0], shown[1], f"{shown[-1]}, {runs}")
    return figure
