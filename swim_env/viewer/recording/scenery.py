"""What a recording shows in the plane: bodies, paths, goals and the fluid around them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.viewer.recording.palette import (
    ARROW_COLOUR,
    BODY_COLOUR,
    GOAL_COLOUR,
    GRID_COLOUR,
    SERIES_COLOURS,
    TRAIL_COLOURS,
    shades_of_torque,
)
from swim_env.viewer.recording.schema import TIMELINE, place_of
from swim_env.viewer.recording.swimmer import Swimmer
from swim_env.viewer.recording.water import ARROW_EVERY, CELLS_IN_LENGTH, PIXELS, Water, picture_of
from swim_env.viewer.recording.work import side_by_side

__all__ = ["Lane", "lanes_of", "log_swimmer"]

Array = NDArray[np.float64]

#: Distance of the lanes of two swimmers in one plane (BL), and of its grid lines.
_LANE, _GRID = 0.5, 0.5
#: Length of the arrow in front of the head, and of directors (BL, element lengths).
_HEADING, _DIRECTOR = 0.16, 0.35
#: An arrow of the largest speed reaches over so many arrow distances.
_ARROW_REACH = 1.2
#: Layers, from back to front.
_PRESSURE, _LINES, _ARROWS, _TRAIL, _OUTLINE, _BODY, _FRONT = (
    -30.0,
    -20.0,
    -10.0,
    0.0,
    5.0,
    10.0,
    20.0,
)


@dataclass(frozen=True)
class Lane:
    """A swimmer's place in a recording.

    Attributes
    ----------
    swimmer : Swimmer
        Who.
    label : str
        What it is called in entity paths.
    number, count : int
        Which lane of how many.
    instants : (F,) array of int
        Frames.
    offset : (2,) array
        Where its lane's origin is drawn in the plane that all share (m).
    pressure, speed : float or None
        Pressure (Pa) and speed (m/s) that all lanes' scales reach to, None without flow.
    limit : float
        Torque or moment that the colours reach to (N m).
    colour : str
        What the colours show.
    low, high : (2,) arrays
        Corners of what all bodies pass through, in the plane that they share (m).
    """

    swimmer: Swimmer
    label: str
    number: int
    count: int
    instants: NDArray[np.int64]
    offset: Array
    pressure: float | None
    speed: float | None
    limit: float
    colour: str
    low: Array
    high: Array

    @property
    def place(self) -> str:
        """The entity of the swimmer in the plane."""
        return place_of(self.label)

    @property
    def shade(self) -> tuple[int, int, int]:
        """The swimmer's own colour on water."""
        return TRAIL_COLOURS[self.number % len(TRAIL_COLOURS)]

    @property
    def bright(self) -> tuple[int, int, int]:
        """The swimmer's own colour in plots."""
        return SERIES_COLOURS[self.number % len(SERIES_COLOURS)]

    @property
    def arrow_seconds(self) -> float | None:
        """Seconds of its velocity that an arrow is long."""
        if self.speed is None:
            return None
        length = self.swimmer.scene.beam.length
        return _ARROW_REACH * ARROW_EVERY * length / CELLS_IN_LENGTH / self.speed


def lanes_of(
    swimmers: Sequence[Swimmer],
    labels: Sequence[str],
    frames: Sequence[NDArray[np.int64]],
    pressure: float | None,
    speed: float | None,
    colour: str,
) -> list[Lane]:
    """Give every swimmer its lane, one below the other where they start."""
    moments = [np.abs(swimmer.moments).max(initial=0.0) for swimmer in swimmers]
    largest = float(max(moments)) or 1.0
    lanes = []
    for number, (swimmer, label, instants) in enumerate(zip(swimmers, labels, frames, strict=True)):
        length = swimmer.scene.beam.length
        nodes = swimmer.trajectory.nodes[instants].reshape(-1, 2)
        offset = np.array([0.0, -number * _LANE * length])
        low, high = nodes.min(axis=0) + offset, nodes.max(axis=0) + offset
        if swimmer.target_radius is not None:
            reach = swimmer.target_radius * length
            low = np.minimum(low, swimmer.aim + offset - reach)
            high = np.maximum(high, swimmer.aim + offset + reach)
        limit = swimmer.scene.torque_limit if colour == "torque" else largest
        lanes.append(
            Lane(
                swimmer, label, number, len(swimmers), instants, offset, pressure, speed,
                limit, colour, low, high,
            )
        )  # fmt: skip
    low = np.min([lane.low for lane in lanes], axis=0)
    high = np.max([lane.high for lane in lanes], axis=0)
    return [replace(lane, low=low, high=high) for lane in lanes]


def log_swimmer(stream: Any, lane: Lane, water: Water | None) -> None:
    """Log everything of a swimmer that lies in the plane."""
    import rerun as rr

    swimmer, place = lane.swimmer, lane.place
    run, beam = swimmer.trajectory, swimmer.scene.beam
    length = beam.length
    count = len(lane.instants)
    time = [rr.TimeColumn(TIMELINE, duration=run.time[lane.instants])]
    nodes = run.nodes[lane.instants].astype(np.float32)
    centres = run.centres[lane.instants].astype(np.float32)
    path = run.path[lane.instants]
    angles = run.angles[lane.instants]

    stream.log(place, rr.Transform3D(translation=[*lane.offset, 0.0]), static=True)
    # A view whose origin is the inner one of these follows the body; its y points downwards as a
    # screen's. Where it is and how it is turned are two entities: rerun takes no part of a
    # transform from what is there once, and another from a frame.
    stream.log(f"{place}/camera/screen", rr.Transform3D(scale=[1.0, -1.0, 1.0]), static=True)
    stream.send_columns(
        f"{place}/camera",
        time,
        rr.Transform3D.columns(translation=np.column_stack([path, np.zeros(count)])),
    )
    _log_grid(stream, lane)

    # The body: from the middle of one element to that of the next, in the colour of their joint.
    joints = beam.elements - 1
    stream.log(
        f"{place}/body",
        rr.LineStrips2D.from_fields(radii=[_drawn_half_thickness(beam)], draw_order=_BODY),
        static=True,
    )
    if joints:
        bones = np.stack([centres[:, :-1], nodes[:, 1:-1], centres[:, 1:]], axis=2)
        shown = swimmer.held_torques if lane.colour == "torque" else swimmer.moments
        shades = shades_of_torque(shown[lane.instants] / lane.limit)
        stream.send_columns(
            f"{place}/body",
            time,
            rr.LineStrips2D.columns(
                strips=_strips(bones.reshape(-1, 3, 2)), colors=shades.reshape(-1, 3)
            ).partition(np.full(count, joints)),
        )
    stream.log(
        f"{place}/outline",
        rr.LineStrips2D.from_fields(
            radii=[1.35 * _drawn_half_thickness(beam)], colors=[BODY_COLOUR], draw_order=_OUTLINE
        ),
        static=True,
    )
    stream.send_columns(f"{place}/outline", time, rr.LineStrips2D.columns(strips=_strips(nodes)))

    director = _DIRECTOR * beam.element_length
    normals = np.stack([-np.sin(angles), np.cos(angles)], axis=-1).astype(np.float32)
    stream.log(
        f"{place}/directors",
        rr.LineStrips2D.from_fields(
            radii=[rr.Radius.ui_points(0.7)], colors=[BODY_COLOUR], draw_order=_OUTLINE
        ),
        static=True,
    )
    ends = np.stack([centres, centres + np.float32(director) * normals], axis=2)
    stream.send_columns(
        f"{place}/directors",
        time,
        rr.LineStrips2D.columns(strips=_strips(ends.reshape(-1, 2, 2))).partition(
            np.full(count, beam.elements)
        ),
    )

    mean = angles.mean(axis=1)
    ahead = -_HEADING * length * np.stack([np.cos(mean), np.sin(mean)], axis=-1)
    stream.log(
        f"{place}/heading",
        rr.Arrows2D.from_fields(
            radii=[rr.Radius.ui_points(1.8)], colors=[lane.shade], draw_order=_FRONT
        ),
        static=True,
    )
    stream.send_columns(
        f"{place}/heading",
        time,
        rr.Arrows2D.columns(vectors=ahead, origins=nodes[:, 0] + 0.2 * ahead),
    )

    # One piece of the path per frame: the view shows all pieces up to the present.
    stream.log(
        f"{place}/path",
        rr.LineStrips2D.from_fields(
            radii=[rr.Radius.ui_points(1.2)], colors=[lane.shade], draw_order=_TRAIL
        ),
        static=True,
    )
    pieces = np.stack([path[:-1], path[1:]], axis=1).astype(np.float32)
    stream.send_columns(
        f"{place}/path",
        [rr.TimeColumn(TIMELINE, duration=run.time[lane.instants[1:]])],
        rr.LineStrips2D.columns(strips=_strips(pieces)),
    )
    stream.log(
        f"{place}/centre",
        rr.Points2D.from_fields(
            radii=[rr.Radius.ui_points(3.0)], colors=[lane.shade], draw_order=_FRONT
        ),
        static=True,
    )
    stream.send_columns(f"{place}/centre", time, rr.Points2D.columns(positions=path))

    if swimmer.target_radius is not None:
        reach = swimmer.target_radius * length
        stream.log(
            f"{place}/target",
            rr.Ellipses2D(
                centers=[swimmer.aim],
                half_sizes=[[reach, reach]],
                colors=[GOAL_COLOUR],
                line_radii=rr.Radius.ui_points(1.8),
                draw_order=_FRONT,
            ),
            static=True,
        )
    if water is not None:
        _log_water(stream, lane, water)


def _strips(points: NDArray[np.float32]) -> Any:
    """Return lines (n, k, 2) as rerun keeps them; it would take arrays one line after the other."""
    import pyarrow as pa
    import rerun as rr

    count, length = points.shape[:2]
    pairs = pa.FixedSizeListArray.from_arrays(
        np.ascontiguousarray(points, dtype=np.float32).ravel(),
        type=pa.list_(pa.field("item", pa.float32(), nullable=False), 2),
    )
    offsets = pa.array(np.arange(0, (count + 1) * length, length, dtype=np.int32))
    kept = rr.components.LineStrip2DBatch([]).as_arrow_array().type
    return pa.ListArray.from_arrays(offsets, pairs, type=kept)


def _drawn_half_thickness(beam: Any) -> float:
    """Return half the width of the drawn body (m): the true one where that can be seen."""
    return float(max(beam.half_thickness, 0.008 * beam.length))


def _log_grid(stream: Any, lane: Lane) -> None:
    """Log lines that rest in the fluid, by which motion is seen."""
    import rerun as rr

    step = _GRID * lane.swimmer.scene.beam.length
    low = np.floor((lane.low - lane.offset) / step - 2.0)
    high = np.ceil((lane.high - lane.offset) / step + 2.0)
    # A body that went far would take more lines than anyone can see.
    high = np.minimum(high, low + 400.0)
    lines = [
        [(k * step, low[1] * step), (k * step, high[1] * step)]
        for k in np.arange(low[0], high[0] + 1)
    ]
    lines += [
        [(low[0] * step, k * step), (high[0] * step, k * step)]
        for k in np.arange(low[1], high[1] + 1)
    ]
    stream.log(
        f"{lane.place}/grid",
        rr.LineStrips2D(
            lines, radii=rr.Radius.ui_points(0.5), colors=[GRID_COLOUR], draw_order=_LINES
        ),
        static=True,
    )


def _log_water(stream: Any, lane: Lane, water: Water) -> None:
    """Log pressure and velocity: scales and places of arrows once, numbers per frame."""
    import rerun as rr

    assert lane.pressure is not None and lane.arrow_seconds is not None
    time = [rr.TimeColumn(TIMELINE, duration=water.time)]
    corners = np.column_stack([water.corners, np.zeros(len(water.corners))])
    place = f"{lane.place}/flow"
    stream.send_columns(place, time, rr.Transform3D.columns(translation=corners))
    place = f"{lane.place}/flow/pressure"
    pixel = water.cell / PIXELS
    stream.log(place, rr.Transform3D(scale=[pixel, pixel, 1.0]), static=True)
    stream.log(
        place,
        rr.EncodedImage.from_fields(media_type="image/png", draw_order=_PRESSURE),
        static=True,
    )
    largest = lane.pressure
    pictures = side_by_side(lambda frame: picture_of(frame, largest), water.pressures)
    stream.send_columns(place, time, rr.EncodedImage.columns(blob=pictures))
    # Vectors are velocities in m/s; this scale makes metres of them, so origins are divided by it.
    place = f"{lane.place}/flow/velocity"
    seconds = lane.arrow_seconds
    stream.log(place, rr.Transform3D(scale=[seconds, seconds, 1.0]), static=True)
    stream.log(
        place,
        rr.Arrows2D.from_fields(
            origins=water.origins / seconds,
            radii=[rr.Radius.ui_points(1.1)],
            colors=[ARROW_COLOUR],
            draw_order=_ARROWS,
        ),
        static=True,
    )
    arrows = water.velocities.shape[1]
    stream.send_columns(
        place,
        time,
        rr.Arrows2D.columns(vectors=water.velocities.reshape(-1, 2)).partition(
            np.full(len(water.time), arrows)
        ),
    )
