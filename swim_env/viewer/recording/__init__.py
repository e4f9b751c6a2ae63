"""Recordings of runs for rerun: body, fluid and figures on one time line of simulated seconds."""

from swim_env.viewer.recording.schema import SCHEMA_VERSION
from swim_env.viewer.recording.swimmer import Swimmer
from swim_env.viewer.recording.writer import (
    FLOW_RATE,
    FRAME_RATE,
    WrittenRecording,
    check_file,
    require_rerun,
    write_recording,
)

__all__ = [
    "FLOW_RATE",
    "FRAME_RATE",
    "SCHEMA_VERSION",
    "Swimmer",
    "WrittenRecording",
    "check_file",
    "require_rerun",
    "write_recording",
]
