"""What the colours and arrows of a recording mean, in a view of its own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from swim_env.viewer.recording.palette import (
    ARROW_COLOUR,
    BODY_COLOUR,
    pressure_palette,
    shades_of_torque,
)
from swim_env.viewer.recording.scenery import Lane

__all__ = ["LEGEND", "LEGEND_HEIGHT", "LEGEND_WIDTH", "log_legend"]

LEGEND = "legend"
#: Size of the view (its own units).
LEGEND_WIDTH, LEGEND_HEIGHT = 100.0, 9.0
_BAR, _THICK = 24.0, 2.0


def log_legend(stream: Any, lanes: Sequence[Lane]) -> None:
    """Log colour bars with the ends of their scales, and the arrow's."""
    import rerun as rr

    lane = lanes[0]
    what = "joint torque" if lane.colour == "torque" else "bending moment"
    bars = [(what, lane.limit, "N m", shades_of_torque(np.linspace(-1.0, 1.0, 64)))]
    if lane.pressure is not None:
        bars.append(("pressure", lane.pressure, "Pa", pressure_palette()[1::4]))
    for number, (name, limit, unit, shades) in enumerate(bars):
        left = 3.0 + number * 36.0
        edges = np.linspace(left, left + _BAR, len(shades) + 1)
        strips = np.stack(
            [
                np.stack([edges[:-1], np.full(len(shades), 2.0)], axis=-1),
                np.stack([edges[1:], np.full(len(shades), 2.0)], axis=-1),
            ],
            axis=1,
        )
        place = f"{LEGEND}/{name.replace(' ', '_')}"
        stream.log(
            f"{place}/bar",
            rr.LineStrips2D(strips, colors=shades, radii=0.5 * _THICK, draw_order=1.0),
            static=True,
        )
        text = (f"-{limit:.3g} {unit}", name, f"+{limit:.3g} {unit}")
        stream.log(
            f"{place}/scale",
            rr.Points2D(
                [(left, 3.6), (left + 0.5 * _BAR, 3.6), (left + _BAR, 3.6)],
                labels=text,
                show_labels=True,
                colors=[BODY_COLOUR] * 3,
                radii=rr.Radius.ui_points(0.0),
            ),
            static=True,
        )
    if lane.speed is not None:
        left = 3.0 + len(bars) * 36.0
        stream.log(
            f"{LEGEND}/velocity",
            rr.Arrows2D(
                origins=[(left, 2.0)],
                vectors=[(9.0, 0.0)],
                colors=[ARROW_COLOUR],
                radii=rr.Radius.ui_points(1.2),
            ),
            static=True,
        )
        stream.log(
            f"{LEGEND}/velocity/scale",
            rr.Points2D(
                [(left + 5.0, 3.6)],
                labels=["velocity of the water"],
                show_labels=True,
                colors=[BODY_COLOUR],
                radii=rr.Radius.ui_points(0.0),
            ),
            static=True,
        )
