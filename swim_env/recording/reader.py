"""Reading recordings back, with rerun's own reader."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SwimError
from swim_env.recording.schema import (
    APPLICATION,
    PROPERTY,
    SCHEMA_VERSION,
    TIMELINE,
    group_path,
    groups_of,
    place_of,
)
from swim_env.recording.writer import require_rerun
from swim_env.scene import Scene
from swim_env.scene.yaml import parse_yaml

__all__ = ["Column", "ReadRecording", "RecordingError", "RecordedSwimmer", "read_recording"]

Array = NDArray[np.float64]


class RecordingError(SwimError, ValueError):
    """A recording cannot be read."""


@dataclass(frozen=True, eq=False)
class Column:
    """One component of one entity over time."""

    #: Instants, (F,) (s); empty for what does not change.
    time: Array
    #: F values, or one: arrays and bytes.
    values: list[Any]


@dataclass(frozen=True, eq=False)
class RecordedSwimmer:
    """A swimmer of a recording."""

    #: Its name in entity paths, and the one that it was given.
    label: str
    name: str
    #: What was run.
    scene: Scene
    #: Why its run ended early, empty where it did not.
    termination_reason: str
    #: Instants of nodes, path and series (s), (F,).
    time: Array
    #: Nodes of the centre line from head to tail (m), in single precision, (F, N + 1, 2 or 3).
    nodes: Array
    #: Mean element centre (m), in single precision, (F, 2 or 3).
    path: Array
    #: By group, see `swim_env.recording.schema.groups_of`; energy and rewards at their own times.
    series: dict[str, Array]
    #: Names of the groups' columns, with their units.
    names: dict[str, list[str]]
    #: Instants of the energy (s), (E,).
    energy_time: Array
    #: Ends of the actions (s), empty without rewards, (A,).
    reward_time: Array
    #: Instants of the flow (s), empty without one, (W,). In space its numbers are in
    #: `ReadRecording.columns`.
    flow_time: Array = field(default_factory=lambda: np.zeros(0))
    #: Pressure on the grid (Pa), rows upwards, in steps of the scale's 127th part; not a number
    #: inside of the body, (W, R, C).
    pressures: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))
    #: Velocities (m/s), (W, A, 2).
    velocities: Array = field(default_factory=lambda: np.zeros((0, 0, 2)))
    #: Left lower corner of the grid (m), (W, 2).
    grid: Array = field(default_factory=lambda: np.zeros((0, 2)))
    #: Size of the grid's cells (m); 0 without flow.
    cell: float = 0.0


@dataclass(frozen=True, eq=False)
class ReadRecording:
    """A recording that was read."""

    #: Version of its layout.
    schema: int
    #: By label, in their order.
    swimmers: dict[str, RecordedSwimmer]
    #: Where and when it was made.
    about: dict[str, Any]
    #: All that is in it, by entity path and component.
    columns: Mapping[tuple[str, str], Column]


def read_recording(path: str | os.PathLike[str]) -> ReadRecording:
    """Read the recording in a file that `write_recording` made, of this version or an older one.

    It is a RecordingError if it cannot be read, is no recording of this package, or is of a later
    version.
    """
    require_rerun()
    name = os.fspath(path)
    columns = _columns(name)
    own = {
        component: column.values[0]
        for (entity, component), column in columns.items()
        if entity == f"/__properties/{PROPERTY}"
    }
    if "schema" not in own:
        raise RecordingError(f"not a recording of {APPLICATION}, it says no schema ({name})")
    schema = int(own["schema"][0])
    if schema > SCHEMA_VERSION:
        raise RecordingError(
            f"the recording has schema {schema}, this version of swim_env reads up to "
            f"{SCHEMA_VERSION}; a later version reads it ({name})"
        )
    try:
        swimmers = {}
        for place, label in enumerate(map(str, own["swimmers"])):
            fields: Any = parse_yaml(str(own["scenes"][place]), name)
            swimmers[label] = _swimmer(
                columns,
                scale=float(own["pressure_scale"][0]),
                label=label,
                name=str(own["names"][place]),
                scene=Scene.from_dict(fields, name),
                termination_reason=str(own["termination_reasons"][place]),
            )
        about = json.loads(str(own["about"][0]))
    except (KeyError, IndexError, ValueError) as error:
        why = f"it lacks {error}" if isinstance(error, KeyError) else str(error)
        raise RecordingError(f"the recording is not whole: {why} ({name})") from None
    return ReadRecording(schema, swimmers, about, columns)


def _columns(name: str) -> dict[tuple[str, str], Column]:
    """Read every component of every entity of the first recording in a file."""
    found: dict[tuple[str, str], list[tuple[Array, list[Any]]]] = {}
    try:
        open(name, "rb").close()
        for chunk in _opened(name).stream():
            batch = chunk.to_record_batch()
            times = np.zeros(0)
            if not chunk.is_static:
                if TIMELINE not in batch.schema.names:
                    continue
                nanoseconds = batch.column(TIMELINE).cast("int64").to_numpy()
                times = nanoseconds.astype(np.float64) * 1e-9
            for part in batch.schema:
                if part.name == TIMELINE or part.name.startswith("rerun.controls"):
                    continue
                values = [_plain(value) for value in batch.column(part.name)]
                found.setdefault((chunk.entity_path, part.name), []).append((times, values))
    except RecordingError:
        raise
    except OSError as error:
        raise RecordingError(
            f"cannot read the recording: {error.strerror or error} ({name})"
        ) from None
    except Exception as error:  # what the reader raises for a damaged file is not documented
        why = " ".join(str(error).split()) or type(error).__name__
        raise RecordingError(f"not a recording, or a damaged one: {why} ({name})") from None
    columns = {}
    for key, parts in found.items():
        times = np.concatenate([part[0] for part in parts])
        values = [value for part in parts for value in part[1]]
        if len(times):
            order = np.argsort(times, kind="stable")
            times, values = times[order], [values[i] for i in order]
        columns[key] = Column(times, values)
    return columns


def _opened(name: str) -> Any:
    """Return rerun's reader of a file; it only warns of one without an end."""
    import rerun as rr

    with warnings.catch_warnings():
        warnings.filterwarnings("error", message="RRD file has no footer")
        try:
            return rr.chunk.RrdReader(name)
        except Warning:
            raise RecordingError(f"the recording was cut off: it has no end ({name})") from None


def _plain(value: Any) -> Any:
    """Return one cell of Arrow: numbers as an array, the rest as Python's objects."""
    import pyarrow as pa

    if not value.is_valid:
        return None
    inner = value.values
    depth = 0
    while pa.types.is_list(inner.type) or pa.types.is_fixed_size_list(inner.type):
        if pa.types.is_list(inner.type) and pa.types.is_uint8(inner.type.value_type):
            return [bytes(memoryview(one.values.to_numpy())) for one in inner]
        lengths = np.diff(inner.offsets.to_numpy()) if pa.types.is_list(inner.type) else None
        if lengths is not None and len(set(lengths.tolist())) > 1:
            return inner.to_pylist()
        depth += 1
        inner = inner.flatten()
    if pa.types.is_floating(inner.type) or pa.types.is_integer(inner.type):
        return np.asarray(value.as_py()) if depth else inner.to_numpy()
    return inner.to_pylist()


def _swimmer(
    columns: Mapping[tuple[str, str], Column], scale: float, **known: Any
) -> RecordedSwimmer:
    """Return a swimmer of which name and scene are known already."""
    label = known["label"]
    place = f"/{place_of(label)}"
    dimension = known["scene"].dimension
    line = "outline" if dimension == 2 else "centre_line"
    outline = columns[(f"{place}/{line}", f"LineStrips{dimension}D:strips")]
    centre = columns[(f"{place}/centre", f"Points{dimension}D:positions")]
    series, names, times = {}, {}, {}
    groups, details = groups_of(dimension)
    for group in (*groups, *details):
        entity = f"/{group_path(label, group)}"
        column = columns.get((entity, "Scalars:scalars"))
        if column is not None:
            series[group], times[group] = np.stack(column.values), column.time
            texts = columns[(entity, "SeriesLines:names")].values[0]
            names[group] = [str(text) for text in texts]
    return RecordedSwimmer(
        **known,
        time=outline.time,
        nodes=np.stack(outline.values)[:, 0],
        path=np.stack(centre.values)[:, 0],
        series=series,
        names=names,
        energy_time=times.get("energy", outline.time),
        reward_time=times.get("reward", np.zeros(0)),
        **_flow(columns, f"{place}/flow", scale),
    )


def _flow(columns: Mapping[tuple[str, str], Column], place: str, scale: float) -> dict[str, Any]:
    """Return the fields of a swimmer that are about its flow."""
    arrows = columns.get((f"{place}/horizontal/velocity", "Arrows3D:vectors"))
    if arrows is not None:
        return {"flow_time": arrows.time}
    pictures = columns.get((f"{place}/pressure", "EncodedImage:blob"))
    if pictures is None:
        return {}
    from swim_env.recording.water import PIXELS, pressure_of

    moved = columns[(place, "Transform3D:translation")]
    scaled = columns[(f"{place}/pressure", "Transform3D:scale")]
    return {
        "flow_time": pictures.time,
        "pressures": np.stack([pressure_of(one[0], scale) for one in pictures.values]),
        "velocities": np.stack(columns[(f"{place}/velocity", "Arrows2D:vectors")].values),
        "grid": np.stack(moved.values)[:, 0, :2],
        "cell": PIXELS * float(np.ravel(scaled.values[0])[0]),
    }
