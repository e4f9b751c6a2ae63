"""Playing a scene's prescribed torque, and the folder that keeps what came of it."""

from __future__ import annotations

import json
import math
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from swim_env.errors import SwimError
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

    The files are made in a hidden folder beside it, which then takes its place. A folder of
    earlier results is replaced; one that holds anything else is left alone.

    Raises
    ------
    SwimError
        If the folder holds other files, or cannot be written.
    """
    # A link to a folder keeps pointing there.
    target = Path(os.path.realpath(folder))
    check_result_folder(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(
            dir=target.parent, prefix=f".{target.name[:100]}.", ignore_cleanup_errors=True
        ) as scratch:
            ready = Path(scratch) / "new"
            ready.mkdir()
            text = json.dumps(summary, indent=2, allow_nan=False)
            (ready / "summary.json").write_text(text + "\n", encoding="utf-8")
            trajectory.save(ready / "trajectory.npz")
            trajectory.scene.save(ready / "scene.yaml")
            save_figure(draw_path(trajectory), ready / "path.png")
            _exchange(ready, target, Path(scratch) / "old")
    except OSError as error:
        raise SwimError(
            f"cannot write results: {error.strerror or error} ({os.fspath(folder)})"
        ) from None


def _exchange(ready: Path, target: Path, old: Path) -> None:
    """Put a finished folder in the place of another, or leave the other where it is."""
    if not target.exists():
        ready.rename(target)
        return
    target.rename(old)
    try:
        ready.rename(target)
    except BaseException:
        old.rename(target)
        raise


def check_result_folder(folder: str | os.PathLike[str]) -> None:
    """Refuse a result folder that exists and holds anything but earlier results.

    Raises
    ------
    SwimError
        If it does, or if the path is a file.
    """
    name = os.fspath(folder)
    target = Path(folder)
    try:
        if not target.exists():
            return
        if not target.is_dir():
            raise SwimError(f"results go into a folder, this is a file ({name})")
        others = sorted(entry.name for entry in target.iterdir() if entry.name not in RESULT_FILES)
    except OSError as error:
        raise SwimError(f"cannot use the folder: {error.strerror or error} ({name})") from None
    if others:
        raise SwimError(
            f"the folder holds other files than earlier results, for example {others[0]}; name "
            f"an empty or a new one ({name})"
        )
