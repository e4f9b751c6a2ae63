"""Playing a scene's prescribed torque, and the folder that keeps what came of it."""

from __future__ import annotations

import json
import math
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from swim_env.errors import SwimError
from swim_env.scene import Scene
from swim_env.simulator import Simulator
from swim_env.trajectory import Trajectory

__all__ = ["RESULT_FILES", "replay", "steps_of", "write_results"]

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
        If the duration is not a positive number, or shorter than half a step.
    """
    wanted = scene.episode.duration if duration is None else duration
    if not (math.isfinite(wanted) and wanted > 0.0):
        raise SwimError(f"the duration must be a positive number of seconds, got {wanted!r}")
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
    from swim_env.viewer import draw_path, save_figure

    target = Path(folder)
    check_result_folder(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}."))
    except OSError as error:
        raise SwimError(
            f"cannot write results: {error.strerror or error} ({os.fspath(folder)})"
        ) from None
    try:
        text = json.dumps(summary, indent=2, allow_nan=False)
        (scratch / "summary.json").write_text(text + "\n", encoding="utf-8")
        trajectory.save(scratch / "trajectory.npz")
        trajectory.scene.save(scratch / "scene.yaml")
        save_figure(draw_path(trajectory), scratch / "path.png")
        scratch.chmod(0o755)
        old = scratch / "old"
        if target.exists():
            target.rename(old)
        scratch_ready = scratch.with_name(scratch.name + ".new")
        scratch_ready.mkdir()
        for name in RESULT_FILES:
            (scratch / name).rename(scratch_ready / name)
        scratch_ready.rename(target)
    except OSError as error:
        raise SwimError(
            f"cannot write results: {error.strerror or error} ({os.fspath(folder)})"
        ) from None
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def check_result_folder(folder: str | os.PathLike[str]) -> None:
    """Refuse a result folder that exists and holds anything but earlier results.

    Raises
    ------
    SwimError
        If it does, or if the path is a file.
    """
    target = Path(folder)
    if not target.exists():
        return
    if not target.is_dir():
        raise SwimError(f"results go into a folder, this is a file ({os.fspath(folder)})")
    others = sorted(entry.name for entry in target.iterdir() if entry.name not in RESULT_FILES)
    if others:
        raise SwimError(
            f"the folder holds other files than earlier results, for example {others[0]}; name "
            f"an empty or a new one ({os.fspath(folder)})"
        )
