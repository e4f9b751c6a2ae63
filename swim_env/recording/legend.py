"""What the colours and arrows of a recording mean, in a view of its own."""

from __future__ import annotations

from typing import Any

import numpy as np
import rerun as rr

from swim_env.recording.chunks import still
from swim_env.recording.layout import Layout
from swim_env.recording.palette import ARROWS, pressure_palette, shades_of_speed, shades_of_torque
from swim_env.recording.schema import LEGEND

__all__ = ["LEGEND_HEIGHT", "LEGEND_WIDTH", "legend_of"]

#: Size of the view (its own units); in it length and thickness of a bar, and way to the next.
LEGEND_WIDTH, LEGEND_HEIGHT = 120.0, 6.0
_BAR, _THICK, _NEXT = 30.0, 1.4, 42.0
#: Words are dark: on the water's colour the plates that rerun puts them on are grey, or light grey.
_WORDS = (15, 22, 32)


def legend_of(layout: Layout) -> list[Any]:
    """Return the chunks of colour bars with the ends of their scales, and of the arrow's."""
    what = "joint torque" if layout.colour == "torque" else "bending moment"
    if layout.scene.dimension == 3:
        what = f"{layout.colour}, + shortens this side"
    scale = np.linspace(-1.0, 1.0, 64)
    bars = [(what, -layout.limit, layout.limit, "N m", shades_of_torque(scale))]
    if layout.pressure is not None:
        ends = -layout.pressure, layout.pressure
        bars.append(("pressure", *ends, "Pa", pressure_palette()[1::4]))
    if layout.speed is not None and layout.scene.dimension == 3:
        bars.append(("speed", 0.0, layout.speed, "m/s", shades_of_speed(0.5 + 0.5 * scale)))
    chunks = []
    for number, (name, low, high, unit, shades) in enumerate(bars):
        left = 5.0 + number * _NEXT
        edges = np.linspace(left, left + _BAR, len(shades) + 1)
        places = np.stack([edges, np.full(len(edges), 1.2)], axis=-1)
        strips = np.stack([places[:-1], places[1:]], axis=1)
        bar = rr.LineStrips2D(strips, colors=shades, radii=0.5 * _THICK, draw_order=1.0)
        place = f"{LEGEND}/{name.partition(',')[0].replace(' ', '_')}"
        chunks.append(still(f"{place}/bar", bar))
        texts = {0.0: f"{low:.3g} {unit}", 0.5: name, 1.0: f"{high:+.3g} {unit}"}
        at = {left + share * _BAR: text for share, text in texts.items()}
        chunks.append(still(f"{place}/scale", _words(at)))
    if layout.arrow_seconds is not None:
        cell = 0.1 * layout.scene.beam.length
        # A bit further: its words are longer than the ends of a bar.
        left = 10.0 + len(bars) * _NEXT
        arrow = rr.Arrows2D(
            origins=[(left, 1.2)],
            vectors=[(20.0, 0.0)],
            colors=[ARROWS],
            radii=rr.Radius.ui_points(1.2),
        )
        chunks.append(still(f"{LEGEND}/velocity", arrow))
        text = f"velocity, {cell:g} m long: {cell / layout.arrow_seconds:.2g} m/s"
        chunks.append(still(f"{LEGEND}/velocity/scale", _words({left + 10.0: text})))
    return chunks


def _words(texts: dict[float, str]) -> Any:
    """Return texts by their place across, in the line below the bars."""
    return rr.Points2D(
        [(left, 2.2) for left in texts],
        labels=list(texts.values()),
        show_labels=True,
        colors=[_WORDS] * len(texts),
        radii=rr.Radius.ui_points(0.0),
    )
