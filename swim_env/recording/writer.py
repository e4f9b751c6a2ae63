"""Writing recordings for rerun: whole runs in columns, what does not change once."""

from __future__ import annotations

import functools
import importlib.util
import json
import os
import re
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import OptionError, SwimError
from swim_env.files.atomic import write_atomically
from swim_env.files.provenance import where_and_when
from swim_env.recording.schema import (
    APPLICATION,
    PROPERTY,
    SCHEMA_VERSION,
    WORLD,
    label_of,
)
from swim_env.recording.swimmer import Swimmer, frames_of
from swim_env.scene import Scene

# What needs Pillow is imported where it is used: without it, `require_rerun` says what to do.
if TYPE_CHECKING:
    from swim_env.recording.layout import Layout
    from swim_env.recording.water import Water

__all__ = [
    "COLOURS",
    "FLOW_RATE",
    "FRAME_RATE",
    "WrittenRecording",
    "has_flow",
    "recording_file",
    "require_rerun",
    "write_recording",
]

Array = NDArray[np.float64]

#: Frames in a simulated second: of the body and all series, and of the flow.
FRAME_RATE, FLOW_RATE = 50.0, 25.0

#: Instants of the energy for each frame: it has peaks that last two frames.
ENERGIES_IN_FRAME = 2.0

#: What a body's colours may show, and the property of a swimmer with it (N m).
COLOURS = {"torque": "held_torques", "moment": "moments"}


@dataclass(frozen=True)
class WrittenRecording:
    """What was written.

    Attributes
    ----------
    file : str
        The file.
    size : int
        Its size (bytes).
    frames : int
        Instants of all swimmers.
    flow_frames : int
        Instants with flow.
    logging_seconds : float
        Time to make the recording out of the runs and write it, without the flow.
    flow_seconds : float
        Time to compute the flow.
    schema : int
        Version of the recording's layout.
    """

    file: str
    size: int
    frames: int
    flow_frames: int
    logging_seconds: float
    flow_seconds: float
    schema: int

    def to_dict(self) -> dict[str, Any]:
        """Return the figures, the size under ``bytes``."""
        return {
            "file": self.file,
            "bytes": self.size,
            "frames": self.frames,
            "flow_frames": self.flow_frames,
            "logging_seconds": round(self.logging_seconds, 4),
            "flow_seconds": round(self.flow_seconds, 4),
            "schema": self.schema,
        }


def require_rerun() -> None:
    """Refuse to go on without rerun and Pillow.

    Raises
    ------
    SwimError
        If one of them is not installed; the message says how to get it.
    """
    for module, name in (("rerun", "rerun"), ("PIL", "Pillow")):
        if importlib.util.find_spec(module) is None:
            raise SwimError(
                f"recordings need {name}: install the extra 'view' (pip install 'swim-env[view]')"
            )


def has_flow(scene: Scene) -> bool:
    """Tell whether there is a fluid in a scene, whose flow can be recorded."""
    fluid = scene.fluid
    return fluid is not None and fluid.model != "none" and bool(fluid.density)


def write_recording(
    path: str | os.PathLike[str],
    swimmers: Sequence[Swimmer],
    *,
    flow_rate: float | None = FLOW_RATE,
    frame_rate: float = FRAME_RATE,
    colour: str = "torque",
    about: dict[str, Any] | None = None,
    title: str | None = None,
    progress: Callable[[float], object] | None = None,
) -> WrittenRecording:
    """Write a recording that rerun opens, whole or not at all.

    Parameters
    ----------
    path : str or os.PathLike
        The file, by custom ``.rrd``; its folder must exist.
    swimmers : sequence of Swimmer
        The runs, side by side on one time line; names that are equal get numbers.
    flow_rate : float, optional
        Frames of the flow in a simulated second; None for no flow. Scenes without fluid have none.
    frame_rate : float
        Frames of everything else; of the energy there are twice as many.
    colour : str
        What the bodies' colours show: ``torque`` or ``moment``, the elastic bending moment.
    about : dict, optional
        More to write into the recording's property, in JSON's terms; by default where and when it
        was made.
    title : str, optional
        What rerun calls the recording; the swimmers and the first one's scene unless given.
    progress : callable, optional
        Called with the simulated seconds whose flow was computed since the last call.

    Raises
    ------
    OptionError
        If there is no swimmer, if an argument cannot be used, or if the number of a swimmer's
        rewards does not fit its run.
    SwimError
        If rerun is not installed or the file cannot be written.
    """
    require_rerun()
    from swim_env.recording.water import REACH, REACH_OF_TWO, compute_water

    if not swimmers:
        raise OptionError("a recording takes at least one swimmer")
    if colour not in COLOURS:
        raise OptionError(f"unknown colour {colour!r}; colours: {', '.join(COLOURS)}")
    made = _text_of_about(about)
    for swimmer in swimmers:
        swimmer.check_rewards()
    begin = time.perf_counter()
    frames = [frames_of(swimmer.trajectory, frame_rate) for swimmer in swimmers]
    finer = [frames_of(one.trajectory, ENERGIES_IN_FRAME * frame_rate) for one in swimmers]
    reach = REACH_OF_TWO if len(swimmers) == 2 else REACH
    waters: list[Water | None] = []
    for swimmer in swimmers:
        if flow_rate is None or not has_flow(swimmer.scene) or swimmer.trajectory.steps < 2:
            waters.append(None)
        else:
            waters.append(compute_water(swimmer, flow_rate, reach, progress))
    known = [water for water in waters if water is not None]
    flow_seconds = float(sum([water.seconds for water in known]))
    content = _content(swimmers, frames, finer, waters, colour, made, title)
    try:
        write_atomically(path, lambda file: file.write(content))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SwimError(f"cannot write the recording: {reason} ({os.fspath(path)})") from error
    return WrittenRecording(
        os.fspath(path),
        len(content),
        sum(map(len, frames)),
        sum([len(water.time) for water in known]),
        time.perf_counter() - begin - flow_seconds,
        flow_seconds,
        SCHEMA_VERSION,
    )


def _content(
    swimmers: Sequence[Swimmer],
    frames: Sequence[NDArray[np.int64]],
    energy_frames: Sequence[NDArray[np.int64]],
    waters: Sequence[Water | None],
    colour: str,
    about: str,
    title: str | None,
) -> bytes:
    """Return the bytes of a recording."""
    import rerun as rr

    from swim_env.recording.scenery import lanes_of, log_swimmer
    from swim_env.recording.series import log_series

    labels: list[str] = []
    for swimmer in swimmers:
        labels.append(label_of(swimmer.name, labels))
    known = [water for water in waters if water is not None]
    pressure = max((water.largest_pressure for water in known), default=None)
    speed = max((water.largest_speed for water in known), default=None)
    lanes = lanes_of(swimmers, labels, frames, energy_frames, pressure, speed, colour)
    layouts = tuple([lane.layout for lane in lanes])
    reasons = tuple([swimmer.trajectory.termination_reason for swimmer in swimmers])
    blueprint, standing = _fixed_parts(layouts)
    stream = rr.RecordingStream(APPLICATION)
    kept = stream.binary_stream()
    stream.send_blueprint(blueprint)
    stream.send_chunks(standing)
    stream.send_recording_name(title or ", ".join(labels) + f" on {swimmers[0].scene.name}")
    stream.send_property(PROPERTY, _property(layouts, reasons, about))
    for lane, water in zip(lanes, waters, strict=True):
        log_swimmer(stream, lane, water)
        log_series(stream, lane)
    stream.disconnect()
    content: bytes = kept.read()
    if not content:
        raise SwimError("rerun has given no recording")
    return content


@functools.lru_cache(maxsize=32)
def _fixed_parts(layouts: tuple[Layout, ...]) -> tuple[Any, list[Any]]:
    """Return the blueprint, and chunks of all that stands in a recording.

    Building these takes as long as all the rest of a file, and episodes of one environment mostly
    share them.
    """
    import rerun as rr

    from swim_env.recording.blueprint import blueprint_of
    from swim_env.recording.layout import still
    from swim_env.recording.legend import legend_of
    from swim_env.recording.scenery import scenery_of
    from swim_env.recording.series import looks_of_series

    # The plane's y points upwards, the screen's downwards.
    standing = [still(WORLD, rr.Transform3D(scale=[1.0, -1.0, 1.0])), *legend_of(layouts)]
    for layout in layouts:
        standing += scenery_of(layout)
        standing += looks_of_series(layout)
    return blueprint_of(layouts), standing


@functools.cache
def _where_and_when() -> dict[str, Any]:
    """Return where recordings are made; asking git for every episode would take longer than it."""
    return {**where_and_when(), "rerun-sdk": version("rerun-sdk")}


def _text_of_about(about: dict[str, Any] | None) -> str:
    """Return what a recording says of where it was made, before anything is made of it."""
    try:
        return json.dumps(_where_and_when() if about is None else about, allow_nan=False)
    except (TypeError, ValueError, RecursionError) as error:
        raise OptionError(f"about must be a dict in JSON's terms: {error}") from None


@functools.lru_cache(maxsize=32)
def _property(layouts: tuple[Layout, ...], reasons: tuple[str, ...], about: str) -> Any:
    """Return what a recording says of itself."""
    import rerun as rr

    scale = layouts[0]
    return rr.AnyValues(
        schema=SCHEMA_VERSION,
        swimmers=[layout.label for layout in layouts],
        names=[layout.name for layout in layouts],
        scenes=[layout.scene.to_yaml() for layout in layouts],
        termination_reasons=list(reasons),
        colour=scale.colour,
        torque_limits=[layout.limit for layout in layouts],
        pressure_scale=0.0 if scale.pressure is None else scale.pressure,
        about=about,
    )


def recording_file(place: str | os.PathLike[str], name: str) -> Path:
    """Return where a recording goes, before anything is played for it.

    Parameters
    ----------
    place : str or os.PathLike
        A file, if it ends with ``.rrd``, else a folder. Folders are made where they are missing.
    name : str
        What the file is called in a folder, without its ending.

    Raises
    ------
    SwimError
        If rerun is not installed, if the ending is that of another kind of file, if there is a
        folder of the file's name, or if the folder cannot be made or written to.
    """
    require_rerun()
    given = Path(place)
    # A number behind a dot is part of a folder's name, as in v1.2.
    is_file = given.suffix == ".rrd"
    if not is_file and re.fullmatch(r"\.[A-Za-z]\w*", given.suffix) and not given.is_dir():
        raise SwimError(f"a recording's name ends with .rrd, or is a folder's ({given})")
    file = given if is_file else given / f"{label_of(name)}.rrd"
    if file.is_dir():
        raise SwimError(f"a recording is a file, this is a folder ({file})")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SwimError(
            f"cannot make the folder for the recording: {error.strerror or error} ({file.parent})"
        ) from error
    try:
        with tempfile.TemporaryFile(dir=file.parent):
            pass
    except OSError as error:
        raise SwimError(
            f"cannot write into the folder for the recording: {error.strerror or error} "
            f"({file.parent})"
        ) from error
    return file
