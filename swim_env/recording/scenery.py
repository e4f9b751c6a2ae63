"""What a recording shows in the plane: bodies, paths, goals and the fluid around them."""

from __future__ import annotations

from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from swim_env.colours import BODY, GOAL, Colour
from swim_env.recording.chunks import column, lines, still
from swim_env.recording.layout import Lane, Layout
from swim_env.recording.palette import ARROWS, GRID, shades_of_torque
from swim_env.recording.schema import TIMELINE
from swim_env.recording.water import PIXELS, Water, pictures_of

__all__ = ["grid_lines", "log_swimmer", "scenery_of"]

Array = NDArray[np.float64]

#: Distance of grid lines, and length of the arrow in front of the head (BL).
_GRID, _HEADING = 0.5, 0.16
#: Length of directors (element lengths).
_DIRECTOR = 0.35
#: Half the least thickness of a drawn body (BL): one that can be seen.
_LEAST_HALF = 0.008
#: Layers, from back to front.
_PRESSURE, _LINES, _ARROWS, _TRAIL, _OUTLINE, _BODY, _FRONT = -30, -20, -10, 0, 5, 10, 20

_points = rr.Radius.ui_points


def scenery_of(lane: Layout) -> list[Any]:
    """Return a swimmer's chunks that do not change: its marks' looks, the grid and its lane."""
    beam = lane.scene.beam
    half = max(beam.half_thickness, _LEAST_HALF * beam.length)

    def look(kind: Any, radius: Any, colour: Colour | None, layer: float) -> Any:
        colours = {} if colour is None else {"colors": [colour]}
        return kind.from_fields(radii=[radius], draw_order=layer, **colours)

    strips = rr.LineStrips2D
    marks = {
        "body": look(strips, half, None, _BODY),
        "outline": look(strips, 1.35 * half, BODY, _OUTLINE),
        "directors": look(strips, _points(0.7), BODY, _OUTLINE),
        "heading": look(rr.Arrows2D, _points(1.8), lane.shade, _FRONT),
        "path": look(strips, _points(1.2), lane.shade, _TRAIL),
        "centre": look(rr.Points2D, _points(3.0), lane.shade, _FRONT),
        "grid": rr.LineStrips2D(
            grid_lines(lane), radii=_points(0.5), colors=[GRID], draw_order=_LINES
        ),
        # A view whose origin is the inner one of these follows the body; its y points downwards as
        # a screen's. Where it is and how it is turned are two entities: rerun takes no part of a
        # transform from what is there once, and another from a frame.
        "camera/screen": rr.Transform3D(scale=[1.0, -1.0, 1.0]),
    }
    moved = still(lane.place, rr.Transform3D(translation=[*lane.offset, 0.0]))
    return [moved, *[still(f"{lane.place}/{mark}", shown) for mark, shown in marks.items()]]


def grid_lines(lane: Layout) -> list[Any]:
    """Return lines in the x-y plane that rest in the fluid, by which motion is seen."""
    step = _GRID * lane.scene.beam.length
    offset = np.array(lane.offset)
    low = np.floor((np.array(lane.low) - offset)[:2] / step - 2.0)
    high = np.ceil((np.array(lane.high) - offset)[:2] / step + 2.0)
    # A body that went far would take more lines than anyone can see.
    high = np.minimum(high, low + 400.0)
    (left, bottom), (right, top) = step * low, step * high
    across, upwards = (step * np.arange(low[axis], high[axis] + 1) for axis in (0, 1))
    vertical = [[(x, bottom), (x, top)] for x in across]
    return vertical + [[(left, y), (right, y)] for y in upwards]


def log_swimmer(stream: Any, lane: Lane, water: Water | None) -> None:
    """Log everything of a swimmer that moves in the plane."""
    swimmer, place, shapes = lane.swimmer, lane.layout.place, lane.shapes
    beam = swimmer.scene.beam
    nodes = lane.nodes.astype(np.float32)
    centres = shapes.centres.astype(np.float32)
    path, angles = shapes.path, shapes.angles
    strips = rr.LineStrips2D.descriptor_strips()

    def send(mark: str, *columns: tuple[Any, Any], time: Array = shapes.time) -> None:
        at = [rr.TimeColumn(TIMELINE, duration=time)]
        stream.send_columns(f"{place}/{mark}", at, [column(*one, len(time)) for one in columns])

    # Rerun keeps translations in three numbers.
    middle = rr.components.Translation3DBatch(np.column_stack([path, np.zeros(len(path))]))
    send("camera", (rr.Transform3D.descriptor_translation(), middle))
    # The body: from the middle of one element to that of the next, in the colour of their joint.
    if beam.elements > 1:
        bones = np.stack([centres[:, :-1], nodes[:, 1:-1], centres[:, 1:]], axis=2)
        shown = swimmer.held_torques if lane.layout.colour == "torque" else swimmer.moments
        shades = shades_of_torque(shown[lane.instants] / lane.layout.limit)
        send(
            "body",
            (strips, lines(bones.reshape(-1, 3, 2))),
            (
                rr.LineStrips2D.descriptor_colors(),
                rr.components.ColorBatch(shades.reshape(-1, 3)),
            ),
        )
    send("outline", (strips, lines(nodes)))

    director = np.float32(_DIRECTOR * beam.element_length)
    normals = np.stack([-np.sin(angles), np.cos(angles)], axis=-1).astype(np.float32)
    ends = np.stack([centres, centres + director * normals], axis=2)
    send("directors", (strips, lines(ends.reshape(-1, 2, 2))))

    mean = angles.mean(axis=1)
    ahead = -_HEADING * beam.length * np.stack([np.cos(mean), np.sin(mean)], axis=-1)
    arrows = rr.components.Vector2DBatch(ahead)
    begins = rr.components.Position2DBatch(nodes[:, 0] + 0.2 * ahead)
    send(
        "heading",
        (rr.Arrows2D.descriptor_vectors(), arrows),
        (rr.Arrows2D.descriptor_origins(), begins),
    )

    # One piece of the path per frame: the view shows all pieces up to the present.
    pieces = lines(np.stack([path[:-1], path[1:]], axis=1))
    send("path", (strips, pieces), time=shapes.time[1:])
    send("centre", (rr.Points2D.descriptor_positions(), rr.components.Position2DBatch(path)))

    if swimmer.target_radius is not None:
        reach = swimmer.target_radius * beam.length
        circle = rr.Ellipses2D(
            centers=[swimmer.aim],
            half_sizes=[[reach, reach]],
            colors=[GOAL],
            line_radii=_points(1.8),
            draw_order=_FRONT,
        )
        stream.log(f"{place}/target", circle, static=True)
    if water is not None:
        _log_water(stream, lane.layout, water)


def _log_water(stream: Any, lane: Layout, water: Water) -> None:
    """Log pressure and velocity: scales and places of arrows once, numbers per frame."""
    assert lane.pressure is not None and lane.arrow_seconds is not None
    time = [rr.TimeColumn(TIMELINE, duration=water.time)]
    corners = np.column_stack([water.corners, np.zeros(len(water.corners))])
    place = f"{lane.place}/flow"
    stream.send_columns(place, time, rr.Transform3D.columns(translation=corners))
    # Vectors are velocities in m/s; their scale makes metres of them, so origins are divided by it.
    pixel, seconds = water.cell / PIXELS, lane.arrow_seconds
    image = rr.EncodedImage.from_fields(media_type="image/png", draw_order=_PRESSURE)
    arrows = rr.Arrows2D.from_fields(
        origins=water.origins / seconds,
        radii=[_points(1.1)],
        colors=[ARROWS],
        draw_order=_ARROWS,
    )
    for mark, scale, look in (("pressure", pixel, image), ("velocity", seconds, arrows)):
        scaling = rr.Transform3D(scale=[scale, scale, 1.0])
        stream.log(f"{place}/{mark}", scaling, static=True)
        stream.log(f"{place}/{mark}", look, static=True)
    pictures = rr.EncodedImage.columns(blob=pictures_of(water, lane.pressure))
    stream.send_columns(f"{place}/pressure", time, pictures)
    vectors = rr.components.Vector2DBatch(water.velocities.reshape(-1, 2))
    moving = column(rr.Arrows2D.descriptor_vectors(), vectors, len(water.time))
    stream.send_columns(f"{place}/velocity", time, [moving])
