"""Recordings of runs for rerun: body, fluid and figures on one time line of simulated seconds."""

from swim_env.recording.browser import WEB_PORT, WebViewer, check_web, show, web_viewer
from swim_env.recording.reader import ReadRecording, RecordingError, read_recording
from swim_env.recording.schema import SCHEMA_VERSION
from swim_env.recording.swimmer import Swimmer
from swim_env.recording.viewer import check_picture, open_viewer, take_picture, typed_command
from swim_env.recording.wrappers import RecordEpisodes, RecordVectorEpisodes
from swim_env.recording.writer import (
    AUTO,
    COLOURS,
    WrittenRecording,
    has_flow,
    recording_file,
    require_rerun,
    write_recording,
)

__all__ = [
    "AUTO",
    "COLOURS",
    "SCHEMA_VERSION",
    "WEB_PORT",
    "WebViewer",
    "ReadRecording",
    "RecordEpisodes",
    "RecordVectorEpisodes",
    "RecordingError",
    "Swimmer",
    "WrittenRecording",
    "check_picture",
    "check_web",
    "has_flow",
    "open_viewer",
    "read_recording",
    "recording_file",
    "require_rerun",
    "show",
    "take_picture",
    "typed_command",
    "web_viewer",
    "write_recording",
]
