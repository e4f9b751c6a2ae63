"""The plots of a recording: how its series look, and their numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import rerun as rr

from swim_env.colours import ENERGY
from swim_env.recording.chunks import column, still
from swim_env.recording.layout import Lane, Layout
from swim_env.recording.palette import SERIES, joint_colours
from swim_env.recording.schema import (
    HELD,
    REWARDS,
    TIMELINE,
    group_path,
    groups_of,
    names_of,
)

__all__ = ["log_series", "looks_of_series"]


def looks_of_series(layout: Layout) -> list[Any]:
    """Return the chunks of names and colours of all series of a swimmer."""
    joints = layout.scene.beam.elements - 1
    groups, details = groups_of(layout.scene.dimension)
    chunks = []
    for group in (*groups, *details):
        names = list(names_of(group, joints, layout.split, layout.scene.dimension))
        if not names or (group in REWARDS and not layout.rewarded):
            continue
        if group in details:
            colours = joint_colours(joints)
        elif len(names) == 1 and layout.count > 1:
            # These of all swimmers share a plot.
            names = [f"{layout.label}, {name}" for name in names]
            colours = np.array([layout.bright], dtype=np.uint8)
        elif group in ("energy", "work"):
            parts = [ENERGY[name.partition(" (")[0]] for name in names]
            colours = np.array(parts, dtype=np.uint8)
        else:
            colours = np.array(SERIES[: len(names)], dtype=np.uint8)
        lines = rr.SeriesLines(
            names=names,
            colors=colours,
            widths=[1.6] * len(names),
            interpolation_mode=HELD.get(group, "Linear"),
        )
        chunks.append(still(group_path(layout.label, group), lines))
    return chunks


def log_series(stream: Any, lane: Lane) -> None:
    """Log all series of a swimmer."""
    swimmer = lane.swimmer
    time = swimmer.trajectory.time
    groups, details = groups_of(swimmer.scene.dimension)
    for group in (*groups, *details):
        instants = lane.energy_instants if group == "energy" else lane.instants
        values = swimmer.series(group, instants)
        if values.size:
            at = swimmer.reward_times if group in REWARDS else time[instants]
            scalars = rr.components.ScalarBatch(values.ravel())
            stream.send_columns(
                group_path(lane.layout.label, group),
                [rr.TimeColumn(TIMELINE, duration=at)],
                [column(rr.Scalars.descriptor_scalars(), scalars, len(values))],
            )
