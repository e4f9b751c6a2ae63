"""Runs a scene under its prescribed torque and returns the trajectory."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from swim_env.errors import SceneError, SwimError
from swim_env.scene import Scene
from swim_env.scene.checks import got, real
from swim_env.sim.simulator import Simulator
from swim_env.sim.trajectory import Trajectory

#: Longest replay, whose trajectory is kept in memory.
MOST_STEPS = 2_000_000


def steps_of(scene: Scene, duration: float | None = None) -> int:
    """Return how many physics steps come closest to a duration.

    Parameters
    ----------
    scene : Scene
        The scene.
    duration : float, optional
        Simulated time (s); by default that of the scene's episode.

    Raises
    ------
    SwimError
        If the duration is not a positive number, shorter than half a step, or longer than
        MOST_STEPS steps.
    """
    given = scene.episode.duration if duration is None else duration
    try:
        wanted = real("s", above=0.0)(given, "the duration")
    except SceneError:
        raise SwimError(
            f"the duration must be a positive number of seconds, got {got(given)}"
        ) from None
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
    scene: Scene, duration: float | None = None, progress: Callable[[int], object] | None = None
) -> tuple[Trajectory, dict[str, Any]]:
    """Play the scene's prescribed torque from its start.

    Parameters
    ----------
    scene : Scene
        The scene.
    duration : float, optional
        Simulated time (s), rounded to whole steps; by default that of the scene's episode.
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
    return trajectory, {**trajectory.summary(), "wall_seconds": time.perf_counter() - start}
