"""What the colours and arrows of a recording mean, in a view of its own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from swim_env.recording.layout import Layout, still
from swim_env.recording.palette import (
    ARROW_COLOUR,
    pressure_palette,
    shades_of_torque,
)

__all__ = ["LEGEND", "LEGEND_HEIGHT", "LEGEND_WIDTH", "legend_of"]

LEGEND = "legend"
#: Size of the view (its own units).
LEGEND_WIDTH, LEGEND_HEIGHT = 120.0, 6.0
_BAR, _THICK, _NEXT = 30.0, 1.4, 42.0
#: Words are dark: on the water's colour the plates that rerun puts them on are grey, or light grey.
_WORDS = (15, 22, 32)


def legend_of(layouts: Sequence[Layout]) -> list[Any]:
    """Return the chunks of colour bars with the ends of their scales, and of the arrow's."""
    import rerun as rr

    lane, chunks = layouts[0], []
    what = "joint torque" if lane.colour == "torque" else "bending moment"
    bars = [(what, lane.limit, "N m", shades_of_torque(np.linspace(-1.0, 1.0, 64)))]
    if lane.pressure is not None:
        bars.append(("pressure", lane.pressure, "Pa", pressure_palette()[1::4]))
    for number, (name, limit, unit, shades) in enumerate(bars):
        left = 5.0 + number * _NEXT
        edges = np.linspace(left, left + _BAR, len(shades) + 1)
        strips = np.stack(
            [
                np.stack([edges[:-1], np.full(len(shades), 1.2)], axis=-1),
                np.stack([edges[1:], np.full(len(shades), 1.2)], axis=-1),
            ],
            axis=1,
        )
        place = f"{LEGEND}/{name.replace(' ', '_')}"
        chunks.append(
            still(
                f"{place}/bar",
                rr.LineStrips2D(strips, colors=shades, radii=0.5 * _THICK, draw_order=1.0),
            )
        )
        text = (f"-{limit:.3g} {unit}", name, f"+{limit:.3g} {unit}")
        chunks.append(
            still(
                f"{place}/scale",
                rr.Points2D(
                    [(left, 2.2), (left + 0.5 * _BAR, 2.2), (left + _BAR, 2.2)],
                    labels=text,
                    show_labels=True,
                    colors=[_WORDS] * 3,
                    radii=rr.Radius.ui_points(0.0),
                ),
            )
        )
    seconds = lane.arrow_seconds
    if seconds is not None:
        cell = 0.1 * lane.scene.beam.length
        # A bit further: its words are longer than the ends of a bar.
        left = 10.0 + len(bars) * _NEXT
        chunks.append(
            still(
                f"{LEGEND}/velocity",
                rr.Arrows2D(
                    origins=[(left, 1.2)],
                    vectors=[(20.0, 0.0)],
                    colors=[ARROW_COLOUR],
                    radii=rr.Radius.ui_points(1.2),
                ),
            )
        )
        chunks.append(
            still(
                f"{LEGEND}/velocity/scale",
                rr.Points2D(
                    [(left + 10.0, 2.2)],
                    labels=[f"velocity, {cell:g} m long: {cell / seconds:.2g} m/s"],
                    show_labels=True,
                    colors=[_WORDS],
                    radii=rr.Radius.ui_points(0.0),
                ),
            )
        )
    return chunks
