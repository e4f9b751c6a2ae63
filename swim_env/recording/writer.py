"""Writes recordings for rerun: whole runs in columns, constant data only once."""

from __future__ import annotations

import functools
import json
import os
import re
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swim_env.analysis.spatial_flow import has_panels
from swim_env.errors import OptionError, SwimError, require_packages
from swim_env.files.atomic import write_atomically
from swim_env.files.names import file_name, shown_name
from swim_env.files.provenance import where_and_when
from swim_env.recording.schema import APPLICATION, PROPERTY, SCHEMA_VERSION, WORLD
from swim_env.recording.swimmer import Swimmer, checked_rate, frames_of
from swim_env.scene import Scene
from swim_env.scene.spatial.scene import SpatialScene

# What needs Pillow is imported where it is used: without it, `require_rerun` says what to do.
if TYPE_CHECKING:
    from swim_env.recording.layout import Lane, Layout
    from swim_env.recording.planes import WaterPlanes
    from swim_env.recording.water import Water

#: The rate of the flow's frames that follows the body: one for two of the body's own.
AUTO = "auto"

#: What a body's colours may show: joint torques or elastic bending moments.
COLOURS = ("torque", "moment")


@dataclass(frozen=True)
class WrittenRecording:
    """A recording that was written."""

    #: The file, and its size (bytes).
    file: str
    size: int
    #: Instants of all swimmers, and those with flow.
    frames: int
    flow_frames: int
    #: Time to make the recording out of the runs and write it, without the flow.
    logging_seconds: float
    #: Time to compute the flow.
    flow_seconds: float
    #: Version of the recording's layout.
    schema: int

    def to_dict(self) -> dict[str, Any]:
        """Return the figures, the size under ``bytes``."""
        named = {"bytes" if key == "size" else key: value for key, value in asdict(self).items()}
        return {k: round(v, 4) if isinstance(v, float) else v for k, v in named.items()}


def require_rerun() -> None:
    """Check that rerun and Pillow are installed; else the SwimError says how to get them."""
    packages = {"rerun": "rerun", "PIL": "Pillow", "pyarrow": "pyarrow"}
    require_packages("recordings need", packages, "view")


def has_flow(scene: Scene) -> bool:
    """Return whether a scene has a fluid, in space one of panels, whose flow can be recorded."""
    return has_panels(scene) if isinstance(scene, SpatialScene) else scene.has_fluid


def write_recording(
    path: str | os.PathLike[str],
    swimmers: Sequence[Swimmer],
    *,
    flow_rate: float | str | None = AUTO,
    frame_rate: float | None = None,
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
    flow_rate : float or "auto", optional
        Frames of the flow in a simulated second, half as many as of the body unless given; None for
        no flow. Scenes without fluid have none.
    frame_rate : float, optional
        Frames of everything else, one in each of the scene's `frame_interval` unless given (50 a
        second on the shipped scenes); of the energy there are about twice as many.
    colour : str
        What the bodies' colours show: ``torque`` or ``moment``, the elastic bending moment.
    about : dict, optional
        Written into the recording's property, in JSON's terms; by default where and when it was
        made.
    title : str, optional
        What rerun calls the recording; the swimmers and the first one's scene unless given.
    progress : callable, optional
        Called with the simulated seconds whose flow was computed since the last call.

    Raises
    ------
    OptionError, SwimError
        If there is no swimmer, if an argument cannot be used, if a swimmer's rewards, goal or
        velocity do not fit its run; if rerun is not installed or the file cannot be written.
    """
    require_rerun()
    from swim_env.recording.layout import lanes_of
    from swim_env.recording.planes import compute_planes
    from swim_env.recording.spatial_swimmer import SpatialSwimmer
    from swim_env.recording.water import REACH, REACH_OF_TWO, compute_water

    if not swimmers:
        raise OptionError("a recording takes at least one swimmer")
    if colour not in COLOURS:
        raise OptionError(f"unknown colour {colour!r}; colours: {', '.join(COLOURS)}")
    if len({swimmer.scene.dimension for swimmer in swimmers}) > 1:
        raise OptionError(
            "the swimmers of a recording must all be in scenes of one dimension, got "
            + ", ".join(f"{one.name} of dimension {one.scene.dimension}" for one in swimmers)
        )
    made = _text_of_about(about)
    for swimmer in swimmers:
        swimmer.check()
        frames_of(swimmer.trajectory, frame_rate)
    if flow_rate not in (None, AUTO):
        checked_rate(flow_rate, "flow_rate")
    begin = time.perf_counter()
    reach = REACH_OF_TWO if len(swimmers) == 2 else REACH
    waters: list[Water | WaterPlanes | None] = []
    for swimmer in swimmers:
        if flow_rate is None or not has_flow(swimmer.scene) or swimmer.trajectory.steps < 2:
            waters.append(None)
        else:
            rate = 0.5 / swimmer.scene.frame_interval if flow_rate == AUTO else float(flow_rate)
            if isinstance(swimmer, SpatialSwimmer):
                waters.append(compute_planes(swimmer, rate, progress))
            else:
                waters.append(compute_water(swimmer, rate, reach, progress))
    known = [water for water in waters if water is not None]
    flow_seconds = float(sum([water.seconds for water in known]))
    lanes = lanes_of(swimmers, known, frame_rate, colour)
    content = _content(lanes, waters, made, title)
    try:
        write_atomically(path, lambda file: file.write(content))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SwimError(f"cannot write the recording: {reason} ({os.fspath(path)})") from error
    return WrittenRecording(
        file=os.fspath(path),
        size=len(content),
        frames=sum([len(lane.instants) for lane in lanes]),
        flow_frames=sum([len(water.time) for water in known]),
        logging_seconds=time.perf_counter() - begin - flow_seconds,
        flow_seconds=flow_seconds,
        schema=SCHEMA_VERSION,
    )


def _content(
    lanes: Sequence[Lane],
    waters: Sequence[Water | WaterPlanes | None],
    about: str,
    title: str | None,
) -> bytes:
    """Return the bytes of a recording."""
    import rerun as rr

    from swim_env.recording.scenery import log_swimmer
    from swim_env.recording.series import log_series
    from swim_env.recording.spatial_scenery import log_spatial_swimmer
    from swim_env.recording.torque_map import log_torque_maps

    layouts = tuple([lane.layout for lane in lanes])
    reasons = tuple([lane.swimmer.trajectory.termination_reason for lane in lanes])
    blueprint, standing = _fixed_parts(layouts)
    stream = rr.RecordingStream(APPLICATION)
    kept = stream.binary_stream()
    stream.send_blueprint(blueprint)
    stream.send_chunks(standing)
    names = ", ".join([layout.label for layout in layouts])
    stream.send_recording_name(shown_name(title or f"{names} on {layouts[0].scene.name}"))
    stream.send_property(PROPERTY, _property(layouts, reasons, about))
    for lane, water in zip(lanes, waters, strict=True):
        log: Any = log_swimmer if lane.layout.scene.dimension == 2 else log_spatial_swimmer
        log(stream, lane, water)
        log_series(stream, lane)
        log_torque_maps(stream, lane)
    stream.disconnect()
    content: bytes = kept.read()
    if not content:
        raise SwimError("rerun has returned no recording")
    return content


@functools.lru_cache(maxsize=32)
def _fixed_parts(layouts: tuple[Layout, ...]) -> tuple[Any, list[Any]]:
    """Return the blueprint, and chunks of all that does not change in a recording.

    Building these takes as long as all the rest of a file, and episodes of one environment mostly
    share them.
    """
    import rerun as rr

    from swim_env.recording.blueprint import blueprint_of
    from swim_env.recording.chunks import still
    from swim_env.recording.legend import legend_of
    from swim_env.recording.scenery import scenery_of
    from swim_env.recording.series import looks_of_series
    from swim_env.recording.spatial_scenery import spatial_scenery_of
    from swim_env.recording.torque_map import looks_of_maps

    planar = layouts[0].scene.dimension == 2
    # The plane's y points upwards, the screen's downwards.
    world = rr.Transform3D(scale=[1.0, -1.0, 1.0]) if planar else rr.ViewCoordinates.RIGHT_HAND_Z_UP
    standing = [still(WORLD, world), *legend_of(layouts[0])]
    for layout in layouts:
        standing += scenery_of(layout) if planar else spatial_scenery_of(layout)
        standing += looks_of_series(layout) + looks_of_maps(layout)
    return blueprint_of(layouts), standing


@functools.cache
def _where_and_when() -> dict[str, Any]:
    """Return where recordings are made; asking git for every episode would take longer than it."""
    return {**where_and_when(), "rerun-sdk": version("rerun-sdk")}


def _text_of_about(about: dict[str, Any] | None) -> str:
    """Return what a recording says of where it was made."""
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
    """Return the file that a recording goes to, and make its folder.

    The place is a file, if it ends with ``.rrd``, else a folder, in which the file has the name
    (without its ending). A place that cannot be used is a SwimError.
    """
    require_rerun()
    given = Path(place)
    # A number behind a dot is part of a folder's name, as in v1.2.
    is_file = given.suffix == ".rrd"
    if not is_file and re.fullmatch(r"\.[A-Za-z]\w*", given.suffix) and not given.is_dir():
        raise SwimError(f"a recording's name ends with .rrd, or is a folder's ({given})")
    file = given if is_file else given / f"{file_name(name)}.rrd"
    if file.is_dir():
        raise SwimError(f"a recording is a file, this is a folder ({file})")
    what = "make"
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        what = "write into"
        with tempfile.TemporaryFile(dir=file.parent):
            pass
    except OSError as error:
        raise SwimError(
            f"cannot {what} the folder for the recording: {error.strerror or error} ({file.parent})"
        ) from error
    return file
