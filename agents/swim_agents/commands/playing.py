"""Playing and recording with a progress bar, which several commands do."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from swim_agents.commands.command_line import progress_bar
from swim_agents.replay import replay_episode
from swim_env.recording import Swimmer, WrittenRecording, write_recording
from swim_env.scene import Scene
from swim_env.sim.replay import replay, steps_of
from swim_env.sim.simulator import Simulator

#: The swimmer's name where the scene's own torque drives it.
PRESCRIBED = "prescribed"


def play_prescribed(scene: Scene, duration: float | None) -> tuple[Swimmer, dict[str, Any]]:
    """Play a scene's prescribed torque; return the swimmer and the run's summary."""
    with progress_bar(steps_of(scene, duration), "step", scene.name) as progress:
        trajectory, summary = replay(scene, duration, progress)
    # With it the energy is split between body and fluid, which is for the plane only.
    start = Simulator(scene).velocity() if scene.dimension == 2 else None
    return Swimmer(PRESCRIBED, trajectory, start_velocity=start), summary


def play_policy(scene: Scene, policy: str, **options: Any) -> tuple[Swimmer, dict[str, Any]]:
    """Play an episode; return the swimmer and the summary of `replay_episode`."""
    with progress_bar(scene.actions_per_episode, "action", policy) as progress:
        rollout, trajectory, summary = replay_episode(scene, policy, progress=progress, **options)
    return rollout.swimmer(Path(policy).name, trajectory), summary


def record(
    file: str | os.PathLike[str], swimmers: Sequence[Swimmer], **options: Any
) -> WrittenRecording:
    """Write a recording; `options` are those of `write_recording`."""
    seconds = sum([swimmer.trajectory.duration for swimmer in swimmers])
    with progress_bar(max(1, round(seconds)), "s", "fluid") as progress:
        return write_recording(file, swimmers, progress=progress, **options)


def report_early_end(swimmer: Swimmer, name: str) -> None:
    """Say on stderr why a run ended early, if it did."""
    trajectory = swimmer.trajectory
    if trajectory.termination_reason:
        print(
            f"{name} ended early at t = {trajectory.time[-1]:g} s: {trajectory.termination_reason}",
            file=sys.stderr,
        )
