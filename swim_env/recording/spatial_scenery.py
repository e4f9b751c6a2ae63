"""What a recording shows in space: bodies as shaded surfaces, trails, and the fluid around them."""

from __future__ import annotations

from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from swim_env.analysis.body_surface import BodySurface
from swim_env.colours import BODY, GOAL
from swim_env.recording.chunks import column, lines, still
from swim_env.recording.layout import Lane, Layout
from swim_env.recording.palette import (
    ARROWS,
    DIRECTORS,
    GRID,
    shades_of_speed,
    shades_of_torque,
)
from swim_env.recording.planes import PLANES, WaterPlanes
from swim_env.recording.scenery import grid_lines
from swim_env.recording.schema import TIMELINE
from swim_env.recording.spatial_swimmer import SpatialSwimmer
from swim_env.scene.spatial.scene import SpatialScene
from swim_env.sim.spatial.trajectory import SpatialTrajectory

__all__ = ["log_spatial_swimmer", "spatial_scenery_of"]

Array = NDArray[np.float64]

#: How far the grid is below the bodies (BL).
_BELOW = 0.35
#: By how much directors stand out of the body (element lengths).
_DIRECTOR = 0.45
#: Radius of the mark at the head (BL).
_HEAD = 0.012

_points = rr.Radius.ui_points


def _surface_of(scene: Any) -> BodySurface:
    assert isinstance(scene, SpatialScene)
    return BodySurface(scene)


def spatial_scenery_of(lane: Layout) -> list[Any]:
    """Return a swimmer's chunks that do not change: its marks' looks, the floor and its lane."""
    beam = lane.scene.beam
    arrow = {"radii": [_points(1.2)], "colors": np.tile(DIRECTORS, (beam.elements, 1))}
    strips, shade = rr.LineStrips3D, [lane.shade]
    below = lane.low[2] - _BELOW * beam.length
    floor = [[(*point, below) for point in line] for line in grid_lines(lane)]
    marks = {
        "body": rr.Mesh3D.from_fields(triangle_indices=_surface_of(lane.scene).triangles),
        "centre_line": strips.from_fields(radii=[_points(1.5)], colors=[BODY]),
        "directors": rr.Arrows3D.from_fields(**arrow),
        "path": strips.from_fields(radii=[_points(1.6)], colors=shade),
        "head_path": strips.from_fields(radii=[_points(0.8)], colors=[BODY]),
        "centre": rr.Points3D.from_fields(radii=[_points(3.5)], colors=shade),
        "head": rr.Points3D.from_fields(radii=[_HEAD * beam.length], colors=[BODY]),
        "grid": strips(floor, radii=_points(0.6), colors=[GRID]),
    }
    moved = still(lane.place, rr.Transform3D(translation=[*lane.offset]))
    return [moved, *[still(f"{lane.place}/{mark}", shown) for mark, shown in marks.items()]]


def log_spatial_swimmer(stream: Any, lane: Lane, water: WaterPlanes | None) -> None:
    """Log everything of a swimmer that moves in space."""
    swimmer, place, shapes = lane.swimmer, lane.layout.place, lane.shapes
    assert isinstance(shapes, SpatialTrajectory) and isinstance(swimmer, SpatialSwimmer)
    beam, path, nodes = swimmer.scene.beam, shapes.path, lane.nodes
    strips = rr.LineStrips3D.descriptor_strips()
    positions = rr.Points3D.descriptor_positions()

    def send(mark: str, *columns: tuple[Any, Any], time: Array = shapes.time) -> None:
        at = [rr.TimeColumn(TIMELINE, duration=time)]
        stream.send_columns(f"{place}/{mark}", at, [column(*one, len(time)) for one in columns])

    middle = rr.components.Translation3DBatch(path)
    send("camera", (rr.Transform3D.descriptor_translation(), middle))

    surface = _surface_of(swimmer.scene)
    vertices = surface.vertices(shapes.centres, shapes.directors)
    shown = swimmer.held_torques if lane.layout.colour == "torque" else swimmer.moments
    shares = surface.on_surface(shown[lane.instants]) / lane.layout.limit
    normals = surface.normals(vertices)
    send(
        "body",
        (
            rr.Mesh3D.descriptor_vertex_positions(),
            rr.components.Position3DBatch(vertices.reshape(-1, 3)),
        ),
        (
            rr.Mesh3D.descriptor_vertex_normals(),
            rr.components.Vector3DBatch(normals.reshape(-1, 3)),
        ),
        (
            rr.Mesh3D.descriptor_vertex_colors(),
            rr.components.ColorBatch(shades_of_torque(shares).reshape(-1, 3)),
        ),
    )
    send("centre_line", (strips, lines(nodes)))

    # Each director reaches out of the section it stands in; d3 lies inside of the body.
    s = (np.arange(beam.elements) + 0.5) * beam.element_length
    out = np.zeros((beam.elements, 3))
    out[:, 0], out[:, 1] = beam.half_width_at(s), beam.half_height_at(s)
    reach = out + _DIRECTOR * beam.element_length
    arrows = np.swapaxes(shapes.directors, -1, -2) * reach[..., None]
    begins = np.broadcast_to(shapes.centres[:, :, None], arrows.shape)
    send(
        "directors",
        (rr.Arrows3D.descriptor_vectors(), rr.components.Vector3DBatch(arrows.reshape(-1, 3))),
        (rr.Arrows3D.descriptor_origins(), rr.components.Position3DBatch(begins.reshape(-1, 3))),
    )

    # One piece of a trail per frame: the view shows all pieces up to the present.
    for mark, points in (("path", path), ("head_path", nodes[:, 0])):
        pieces = np.stack([points[:-1], points[1:]], axis=1)
        send(mark, (strips, lines(pieces)), time=shapes.time[1:])
    send("centre", (positions, rr.components.Position3DBatch(path)))
    send("head", (positions, rr.components.Position3DBatch(nodes[:, 0])))

    if swimmer.target_radius is not None:
        reach_of_target = swimmer.target_radius * beam.length
        ball = rr.Ellipsoids3D(
            centers=[swimmer.aim], half_sizes=[[reach_of_target] * 3], colors=[GOAL]
        )
        stream.log(f"{place}/target", ball, static=True)
    if water is not None:
        _log_planes(stream, lane.layout, water)


def _log_planes(stream: Any, lane: Layout, water: WaterPlanes) -> None:
    """Log speed and velocity in each plane: grids and places of arrows once, numbers per frame."""
    assert lane.speed is not None and lane.arrow_seconds is not None
    time = [rr.TimeColumn(TIMELINE, duration=water.time)]
    for name in PLANES:
        place = f"{lane.place}/flow/{name}"
        moved = rr.Transform3D.columns(translation=water.places[name])
        stream.send_columns(place, time, moved)
        rows, columns = water.grids[name].shape[:2]
        corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
        triangles = np.array([[0, 1, columns + 1], [0, columns + 1, columns]])
        mesh = rr.Mesh3D.from_fields(
            vertex_positions=water.grids[name].reshape(-1, 3),
            triangle_indices=(corner[:, None, None] + triangles).reshape(-1, 3),
        )
        # Vectors are velocities in m/s; their scale makes metres of them, so origins are divided.
        seconds = lane.arrow_seconds
        arrows = rr.Arrows3D.from_fields(
            origins=water.origins[name] / seconds, radii=[_points(0.8)], colors=[ARROWS]
        )
        stream.log(f"{place}/speed", mesh, static=True)
        stream.log(f"{place}/velocity", rr.Transform3D(scale=[seconds] * 3), static=True)
        stream.log(f"{place}/velocity", arrows, static=True)
        shades = shades_of_speed(water.speeds[name] / lane.speed).reshape(-1, 3)
        coloured = column(
            rr.Mesh3D.descriptor_vertex_colors(), rr.components.ColorBatch(shades), len(water.time)
        )
        stream.send_columns(f"{place}/speed", time, [coloured])
        vectors = rr.components.Vector3DBatch(water.velocities[name].reshape(-1, 3))
        moving = column(rr.Arrows3D.descriptor_vectors(), vectors, len(water.time))
        stream.send_columns(f"{place}/velocity", time, [moving])
