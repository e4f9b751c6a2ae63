"""Playing a scene's prescribed torque, and the folder that keeps what came of it."""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from swim_env.errors import SwimError
from swim_env.folders import check_folder, write_folder
from swim_env.scene import Scene
from swim_env.simulator import Simulator
from swim_env.trajectory import Trajectory
from swim_env.viewer import draw_path, save_figure

__all__ = ["RESULT_FILES", "replay", "steps_of", "write_results"]

#: Longest replay, whose trajectory is kept in memory.
MOST_STEPS = 2_000_000

#: What a result folder holds.
RESULT_FILES = ("summary.json", "trajectory.npz", "scene.yaml", "path.png")


def steps_of(scene: Scene, duration: float | None = None) -> int:
    """Return how many physics steps come closest to a duration.

    Parameters
    ----------
    scene : Scene
        Its episode's duration is taken where none is given.
    duration : float, optional
        Simulated time (s), above 0.

    Raises
    ------
    SwimError
        If the duration is not a positive number, shorter than half a step, or longer than
        MOST_STEPS steps.
    """
    wanted = scene.episode.duration if duration is None else duration
    if not (math.isfinite(wanted) and wanted > 0.0):
        raise SwimError(f"the duration must be a positive number of seconds, got {wanted!r}")
    if wanted / scene.integrator.time_step > MOST_STEPS:
        raise SwimError(
            f"the duration must be at most {MOST_STEPS:,} time steps of "
            f"{scene.integrator.time_step:g} s, got {wanted:g} s"
        )
    steps = round(wanted / scene.integrator.time_step)
    if steps < 1:
        raise SwimError(
            f"the duration must be at least one time step, {scene.integrator.time_step:g} s, "
            f"got {wanted:g} s"
        )
    return steps


def replay(
    scene: Scene,
    duration: float | None = None,
    progress: Callable[[int], object] | None = None,
) -> tuple[Trajectory, dict[str, Any]]:
    """Play the scene's prescribed torque from its start.

    Parameters
    ----------
    scene : Scene
        The scene.
    duration : float, optional
        Simulated time (s), rounded to whole steps; the scene's own unless given.
    progress : callable, optional
        Called with the number of steps taken since the last call.

    Returns
    -------
    trajectory : Trajectory
        The run.
    summary : dict
        `Trajectory.summary` and ``wall_seconds``, the time that the steps took.

    Raises
    ------
    SwimError
        If the duration is not usable or the start cannot be simulated.
    """
    steps = steps_of(scene, duration)
    simulator = Simulator(scene)
    torques = simulator.prescribed_torques(steps)
    start = time.perf_counter()
    trajectory = simulator.rollout(torques, progress=progress)
    return trajectory, {
        **trajectory.summary(),
        "wall_seconds": time.perf_counter() - start,
    }


def write_results(
    trajectory: Trajectory, summary: dict[str, Any], folder: str | os.PathLike[str]
) -> None:
    """Write summary, trajectory, scene and picture into a folder, all of them or none.

    Raises
    ------
    SwimError
        If the folder holds other files, or cannot be written.
    """

    def write(ready: Path) -> None:
        text = json.dumps(summary, indent=2, allow_nan=False)
        (ready / "summary.json").write_text(text + "\n", encoding="utf-8")
        trajectory.save(ready / "trajectory.npz")
        trajectory.scene.save(ready / "scene.yaml")
        save_figure(draw_path(trajectory), ready / "path.png")

    write_folder(folder, RESULT_FILES, write)


def check_result_folder(folder: str | os.PathLike[str]) -> None:
    """Refuse a result folder that exists and holds anything but earlier results.

    Raises
    ------
    SwimError
        If it does, or if the path is a file.
    """
    check_folder(folder, RESULT_FILES)
