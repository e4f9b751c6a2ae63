"""What a recording shows in the plane: bodies, paths, goals and the fluid around them."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.recording.layout import Layout, column, still
from swim_env.recording.palette import (
    ARROW_COLOUR,
    BODY_COLOUR,
    GOAL_COLOUR,
    GRID_COLOUR,
    shades_of_torque,
)
from swim_env.recording.schema import TIMELINE
from swim_env.recording.swimmer import Swimmer
from swim_env.recording.water import ARROW_EVERY, CELLS_IN_LENGTH, PIXELS, Water, picture_of
from swim_env.recording.work import side_by_side
from swim_env.sim.trajectory import Trajectory

__all__ = ["Lane", "lanes_of", "log_swimmer", "scenery_of"]

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
    instants, energy_instants : (F,), (E,) arrays of int
        Frames, and those of the energy.
    shapes : Trajectory
        The run's positions at the frames alone; nothing else of it is of use.
    nodes : (F, N + 1, 2) array
        Nodes of the centre line at the frames (m).
    layout : Layout
        How it is shown.
    """

    swimmer: Swimmer
    instants: NDArray[np.int64]
    energy_instants: NDArray[np.int64]
    shapes: Trajectory
    nodes: Array
    layout: Layout


def lanes_of(
    swimmers: Sequence[Swimmer],
    labels: Sequence[str],
    frames: Sequence[NDArray[np.int64]],
    energy_frames: Sequence[NDArray[np.int64]],
    pressure: float | None,
    speed: float | None,
    colour: str,
) -> list[Lane]:
    """Give every swimmer its lane, one below the other where they start."""
    # One legend stands for all lanes, so they share their scales.
    largest = max([swimmer.scene.torque_limit for swimmer in swimmers])
    if colour == "moment":
        moments = [np.abs(swimmer.moments).max(initial=0.0) for swimmer in swimmers]
        largest = float(max(moments)) or 1.0
    longest = max([swimmer.scene.beam.length for swimmer in swimmers])
    shapes = [_shapes(swimmer, at) for swimmer, at in zip(swimmers, frames, strict=True)]
    nodes = [shape.nodes for shape in shapes]
    offsets, corners = [], []
    for number, (swimmer, (x, y)) in enumerate(
        zip(swimmers, [points.T for points in nodes], strict=True)
    ):
        length = swimmer.scene.beam.length
        offset = np.array([0.0, -number * _LANE * length])
        low = np.array([x.min(), y.min()]) + offset
        high = np.array([x.max(), y.max()]) + offset
        if swimmer.target_radius is not None:
            reach = swimmer.target_radius * length
            low = np.minimum(low, swimmer.aim + offset - reach)
            high = np.maximum(high, swimmer.aim + offset + reach)
        offsets.append(offset)
        corners.append((low, high))
    low, high = _rounded(
        np.min([low for low, _ in corners], axis=0),
        np.max([high for _, high in corners], axis=0),
        swimmers[0].scene.beam.length,
    )
    begin = min([float(swimmer.trajectory.time[0]) for swimmer in swimmers])
    end = max([float(swimmer.trajectory.time[-1]) for swimmer in swimmers])
    return [
        Lane(
            swimmer,
            frames[number],
            energy_frames[number],
            shapes[number],
            nodes[number],
            Layout(
                swimmer.name,
                labels[number],
                swimmer.scene,
                number,
                len(swimmers),
                _point(offsets[number]),
                _point(low),
                _point(high),
                begin,
                end,
                swimmer.rewards is not None,
                swimmer.start_velocity is not None,
                colour,
                largest,
                pressure,
                None if speed is None else _arrow_seconds(longest, speed),
            ),
        )
        for number, swimmer in enumerate(swimmers)
    ]


def _point(values: Array) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _rounded(low: Array, high: Array, length: float) -> tuple[Array, Array]:
    """Move corners outwards to steps of about an eighth of the size, which many episodes share."""
    step = 2.0 ** np.floor(np.log2(np.maximum(high - low, length) / 6.0))
    return step * np.floor(low / step), step * np.ceil(high / step)


def _arrow_seconds(length: float, speed: float) -> float:
    return _ARROW_REACH * ARROW_EVERY * length / CELLS_IN_LENGTH / speed


def _shapes(swimmer: Swimmer, instants: NDArray[np.int64]) -> Trajectory:
    """Return the run's positions at some instants."""
    run = swimmer.trajectory
    return replace(
        run,
        time=run.time[instants],
        centres=run.centres[instants],
        angles=run.angles[instants],
    )


def scenery_of(lane: Layout) -> list[Any]:
    """Return the chunks of what stands for a swimmer: its marks' looks, the grid and its lane."""
    import rerun as rr

    place, beam = lane.place, lane.scene.beam

    def look(kind: Any, radius: Any, colour: tuple[int, int, int] | None, layer: float) -> Any:
        colours = {} if colour is None else {"colors": [colour]}
        return kind.from_fields(radii=[radius], draw_order=layer, **colours)

    points = rr.Radius.ui_points
    half = _drawn_half_thickness(beam)
    lines = rr.LineStrips2D
    looks = {
        "body": look(lines, half, None, _BODY),
        "outline": look(lines, 1.35 * half, BODY_COLOUR, _OUTLINE),
        "directors": look(lines, points(0.7), BODY_COLOUR, _OUTLINE),
        "heading": look(rr.Arrows2D, points(1.8), lane.shade, _FRONT),
        "path": look(lines, points(1.2), lane.shade, _TRAIL),
        "centre": look(rr.Points2D, points(3.0), lane.shade, _FRONT),
    }
    return [
        still(place, rr.Transform3D(translation=[*lane.offset, 0.0])),
        # A view whose origin is the inner one of these follows the body; its y points downwards as
        # a screen's. Where it is and how it is turned are two entities: rerun takes no part of a
        # transform from what is there once, and another from a frame.
        still(f"{place}/camera/screen", rr.Transform3D(scale=[1.0, -1.0, 1.0])),
        _grid(lane),
        *[still(f"{place}/{mark}", shown) for mark, shown in looks.items()],
    ]


def log_swimmer(stream: Any, lane: Lane, water: Water | None) -> None:
    """Log everything of a swimmer that moves in the plane."""
    import rerun as rr

    swimmer, place = lane.swimmer, lane.layout.place
    run, beam = swimmer.trajectory, swimmer.scene.beam
    length = beam.length
    count = len(lane.instants)
    time = [rr.TimeColumn(TIMELINE, duration=run.time[lane.instants])]
    nodes = lane.nodes.astype(np.float32)
    centres = lane.shapes.centres.astype(np.float32)
    path = lane.shapes.path
    angles = lane.shapes.angles

    def send(mark: str, *columns: tuple[Any, Any]) -> None:
        stream.send_columns(f"{place}/{mark}", time, [column(*one, count) for one in columns])

    strips = rr.LineStrips2D.descriptor_strips()
    # Rerun keeps translations in three numbers.
    middle = rr.components.Translation3DBatch(np.column_stack([path, np.zeros(count)]))
    send("camera", (rr.Transform3D.descriptor_translation(), middle))
    # The body: from the middle of one element to that of the next, in the colour of their joint.
    joints = beam.elements - 1
    if joints:
        bones = np.stack([centres[:, :-1], nodes[:, 1:-1], centres[:, 1:]], axis=2)
        colour = lane.layout.colour
        shown = swimmer.held_torques if colour == "torque" else swimmer.moments
        shades = shades_of_torque(shown[lane.instants] / lane.layout.limit)
        send(
            "body",
            (strips, _strips(bones.reshape(-1, 3, 2))),
            (
                rr.LineStrips2D.descriptor_colors(),
                rr.components.ColorBatch(shades.reshape(-1, 3)),
            ),
        )
    send("outline", (strips, _strips(nodes)))

    director = _DIRECTOR * beam.element_length
    normals = np.stack([-np.sin(angles), np.cos(angles)], axis=-1).astype(np.float32)
    ends = np.stack([centres, centres + np.float32(director) * normals], axis=2)
    send("directors", (strips, _strips(ends.reshape(-1, 2, 2))))

    mean = angles.mean(axis=1)
    ahead = -_HEADING * length * np.stack([np.cos(mean), np.sin(mean)], axis=-1)
    send(
        "heading",
        (rr.Arrows2D.descriptor_vectors(), rr.components.Vector2DBatch(ahead)),
        (
            rr.Arrows2D.descriptor_origins(),
            rr.components.Position2DBatch(nodes[:, 0] + 0.2 * ahead),
        ),
    )

    # One piece of the path per frame: the view shows all pieces up to the present.
    pieces = np.stack([path[:-1], path[1:]], axis=1).astype(np.float32)
    stream.send_columns(
        f"{place}/path",
        [rr.TimeColumn(TIMELINE, duration=run.time[lane.instants[1:]])],
        [column(strips, _strips(pieces), len(pieces))],
    )
    send("centre", (rr.Points2D.descriptor_positions(), rr.components.Position2DBatch(path)))

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
        _log_water(stream, lane.layout, water)


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
    return rr.components.LineStrip2DBatch(
        pa.ListArray.from_arrays(offsets, pairs, type=_strip_type())
    )


@functools.cache
def _strip_type() -> Any:
    import rerun as rr

    return rr.components.LineStrip2DBatch([]).as_arrow_array().type


def _drawn_half_thickness(beam: Any) -> float:
    """Return half the width of the drawn body (m): the true one where that can be seen."""
    return float(max(beam.half_thickness, 0.008 * beam.length))


def _grid(lane: Layout) -> Any:
    """Return lines that rest in the fluid, by which motion is seen."""
    import rerun as rr

    step = _GRID * lane.scene.beam.length
    offset = np.array(lane.offset)
    low = np.floor((np.array(lane.low) - offset) / step - 2.0)
    high = np.ceil((np.array(lane.high) - offset) / step + 2.0)
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
    return still(
        f"{lane.place}/grid",
        rr.LineStrips2D(
            lines, radii=rr.Radius.ui_points(0.5), colors=[GRID_COLOUR], draw_order=_LINES
        ),
    )


def _log_water(stream: Any, lane: Layout, water: Water) -> None:
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
    vectors = rr.components.Vector2DBatch(water.velocities.reshape(-1, 2))
    arrows = column(rr.Arrows2D.descriptor_vectors(), vectors, len(water.time))
    stream.send_columns(place, time, [arrows])
