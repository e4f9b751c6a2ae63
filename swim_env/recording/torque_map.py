"""Torques as a map in a recording: joints from head to tail below each other, time to the right."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import rerun as rr
from PIL import Image

from swim_env.colours import BODY
from swim_env.recording.chunks import column, still
from swim_env.recording.layout import Lane, Layout
from swim_env.recording.palette import shades_of_torque
from swim_env.recording.schema import TIMELINE, groups_of, map_path

__all__ = ["HEIGHT", "groups_of_maps", "log_torque_maps", "looks_of_maps"]

#: Height of a map, in seconds of its width.
HEIGHT = 1.3
#: Most columns of a map: graphics cards take no wider picture.
_COLUMNS = 8000


def groups_of_maps(layout: Layout) -> list[str]:
    """Return the groups of torques that a swimmer has a map of, in the legend's colours."""
    if layout.colour != "torque" or layout.scene.beam.elements < 2:
        return []
    return [group for group in groups_of(layout.scene.dimension)[1] if group.endswith("torques")]


def looks_of_maps(layout: Layout) -> list[Any]:
    """Return the chunks of the line that marks the present in each of a swimmer's maps."""
    line = rr.LineStrips2D(
        [[(0.0, 0.0), (0.0, HEIGHT)]], colors=[BODY], radii=rr.Radius.ui_points(1.0), draw_order=1.0
    )
    groups = groups_of_maps(layout)
    return [still(f"{map_path(layout.label, group)}/now/line", line) for group in groups]


def log_torque_maps(stream: Any, lane: Lane) -> None:
    """Log the maps: a picture of the whole run each, and the present that moves over it."""
    time = lane.swimmer.trajectory.time[lane.instants]
    for group in groups_of_maps(lane.layout):
        # A torque holds from its instant on.
        values = lane.swimmer.series(group, lane.instants)[: max(1, len(time) - 1)]
        values = values[:: -(-len(values) // _COLUMNS)]
        place = map_path(lane.layout.label, group)
        out = io.BytesIO()
        shades = shades_of_torque(values.T / lane.layout.limit)
        Image.fromarray(shades).save(out, "PNG", compress_level=3)
        scale = [float(time[-1] - time[0]) / len(values) or 1.0, HEIGHT / values.shape[1], 1.0]
        picture = rr.EncodedImage(contents=out.getvalue(), media_type="image/png", draw_order=0.0)
        placed = rr.Transform3D(translation=[float(time[0]), 0.0, 0.0], scale=scale)
        stream.log(f"{place}/picture", placed, picture, static=True)
        present = np.column_stack([time, np.zeros((len(time), 2))])
        moved = rr.components.Translation3DBatch(present)
        at = [rr.TimeColumn(TIMELINE, duration=time)]
        moves = column(rr.Transform3D.descriptor_translation(), moved, len(time))
        stream.send_columns(f"{place}/now", at, [moves])
