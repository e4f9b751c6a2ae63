"""Throughput of the environments: work to be timed in turn, and what its times mean.

A `Workload` plays the same number of environment steps in every call. All of them, those of the
peers too, are timed round after round by `studies.benchmark.timing.time_in_turn`, and compared by
the ratios of the times of one round.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from studies.benchmark.timing import Spread, ratio, spread_of
from swim_env.envs.registration import FORWARD_ID
from swim_env.scene import Scene, load_scene
from swim_env.sim.simulator import Simulator

__all__ = [
    "BATCH_MEMBERS",
    "Workload",
    "batch_loop",
    "batched_workload",
    "random_actions",
    "rollout_workload",
    "single_loop",
    "single_workload",
    "speed_ratio",
    "swim_workloads",
    "throughput",
    "wave_actions",
]

Times = NDArray[np.float64]

#: Members of the batches.
BATCH_MEMBERS = 64


class Workload(NamedTuple):
    """What is timed: a number of environment steps, the same in every call.

    Attributes
    ----------
    label : str
        What it is, for tables and pictures.
    call : callable
        Plays the steps; the episodes go on from call to call and start anew where they end.
    steps : int
        Environment steps in a call, those of all members together.
    seconds : float
        Simulated time in a call, that of all members together (s).
    physics_steps : int
        Physics steps in a call, those of all members together.
    facts : mapping
        What else is known of it, in plain values for JSON.
    """

    label: str
    call: Callable[[], object]
    steps: int
    seconds: float
    physics_steps: int
    facts: Mapping[str, Any] = MappingProxyType({})


def random_actions(
    space: gymnasium.Space[Any], count: int, seed: int = 0
) -> NDArray[np.floating[Any]]:
    """Draw uniform actions from a bounded box, (count, *space.shape), of the space's type."""
    assert isinstance(space, gymnasium.spaces.Box)
    random = np.random.default_rng(seed)
    drawn = random.uniform(space.low, space.high, (count, *space.shape))
    return drawn.astype(space.dtype)


def wave_actions(scene: Scene, count: int) -> NDArray[np.float32]:
    """Return a scene's prescribed torque as actions, (count, N - 1), zero where it has none."""
    if scene.actuation is None:
        return np.zeros((count, scene.beam.elements - 1), dtype=np.float32)
    times = np.arange(count) * scene.episode.control_interval
    torques = scene.actuation.torques(times, scene.beam)
    return (torques / scene.torque_limit).astype(np.float32)


def single_loop(
    env: gymnasium.Env[Any, Any], actions: NDArray[Any], steps: int, seed: int = 0
) -> Callable[[], None]:
    """Return a function that plays `steps` steps of one environment, starting it anew at ends.

    Parameters
    ----------
    env : gymnasium.Env
        Any environment of Gymnasium.
    actions : (K, ...) array
        Played one after another, over and over.
    steps : int
        Steps in a call.
    seed : int
        Of the first episode.
    """
    env.reset(seed=seed)
    rows = list(actions)
    played = 0

    def play() -> None:
        nonlocal played
        for _ in range(steps):
            _, _, terminated, truncated, _ = env.step(rows[played])
            played = (played + 1) % len(rows)
            if terminated or truncated:
                env.reset()

    return play


def batch_loop(
    envs: gymnasium.vector.VectorEnv[Any, Any, Any],
    actions: NDArray[Any],
    steps: int,
    seed: int = 0,
) -> Callable[[], None]:
    """Return a function that plays `steps` steps of a batch that starts its members by itself.

    Parameters
    ----------
    envs : gymnasium.vector.VectorEnv
        Any batch that does not need to be reset.
    actions : (K, M, ...) array
        Played one after another, over and over.
    steps : int
        Batched steps in a call.
    seed : int
        Of the first episodes.
    """
    envs.reset(seed=seed)
    rows = list(actions)
    played = 0

    def play() -> None:
        nonlocal played
        for _ in range(steps):
            envs.step(rows[played])
            played = (played + 1) % len(rows)

    return play


def single_workload(label: str, scene: Scene | str, steps: int, wave: bool = False) -> Workload:
    """Return the single environment, from `gymnasium.make`, under random torques or a wave.

    Parameters
    ----------
    label : str
        What it is called.
    scene : Scene or str
        What swims.
    steps : int
        Environment steps in a call.
    wave : bool
        Whether it is driven by the scene's prescribed wave instead of random torques.
    """
    scene = load_scene(scene)
    env: gymnasium.Env[Any, Any] = gymnasium.make(FORWARD_ID, scene=scene)
    count = max(steps, 1000)
    drive = wave_actions(scene, count) if wave else random_actions(env.action_space, count)
    return Workload(
        label,
        single_loop(env, drive, steps),
        steps,
        steps * scene.episode.control_interval,
        steps * scene.steps_per_action,
    )


def batched_workload(
    label: str, scene: Scene | str, members: int, threads: int, steps: int
) -> Workload:
    """Return the batched environment, from `gymnasium.make_vec`, under random torques.

    Parameters
    ----------
    label : str
        What it is called.
    scene : Scene or str
        What swims.
    members, threads : int
        Size of the batch and largest number of threads.
    steps : int
        Batched steps in a call.
    """
    scene = load_scene(scene)
    envs = gymnasium.make_vec(FORWARD_ID, num_envs=members, scene=scene, num_threads=threads)
    actions = random_actions(envs.action_space, max(steps, 100))
    return Workload(
        label,
        batch_loop(envs, actions, steps),
        steps * members,
        steps * members * scene.episode.control_interval,
        steps * members * scene.steps_per_action,
    )


def rollout_workload(label: str, scene: Scene | str, steps: int) -> Workload:
    """Return the prescribed torque of a scene played by the simulator, from the start in each call.

    Parameters
    ----------
    label : str
        What it is, for tables.
    scene : Scene or str
        What swims.
    steps : int
        Control intervals in a call.
    """
    simulator = Simulator(scene)
    physics = steps * simulator.scene.steps_per_action
    torques = simulator.prescribed_torques(physics)

    def play() -> None:
        simulator.reset()
        simulator.rollout(torques)

    return Workload(label, play, steps, physics * simulator.time_step, physics)


def swim_workloads(
    cores: int, members: int = BATCH_MEMBERS, single_steps: int = 200, batch_steps: int = 10
) -> dict[str, Workload]:
    """Return what is timed of this package.

    Parameters
    ----------
    cores : int
        Number of usable cores; with one there is no batch on several.
    members : int
        Size of the batches.
    single_steps, batch_steps : int
        Steps in a call.

    Returns
    -------
    dict of str to Workload
        ``swimmer`` and ``paper_i`` under random torques; ``paper_i_wave``, which is `paper_i` as
        the paper drives it: without damping, random torques feed its fast modes until an episode
        ends, and a step then costs several times what it costs in the paper's motion;
        ``paper_i_rollout``, the same motion in the simulator, all steps in one kernel call, which
        is what chains and rods of other packages compare with; ``batch_1_thread`` and
        ``batch_all_cores`` of `swimmer`.
    """
    workloads = {
        "swimmer": single_workload("swimmer, random torques", "swimmer", single_steps),
        "paper_i": single_workload("paper_i, random torques", "paper_i", single_steps),
        "paper_i_wave": single_workload(
            "paper_i, the paper's wave", "paper_i", single_steps, wave=True
        ),
        "paper_i_rollout": rollout_workload(
            "paper_i, the paper's wave, physics alone", "paper_i", single_steps
        ),
    }
    batches = {"batch_1_thread": 1}
    if cores > 1:
        batches["batch_all_cores"] = cores
    for name, threads in batches.items():
        label = f"swimmer, {members} members, {threads} thread{'s' if threads > 1 else ''}"
        workloads[name] = batched_workload(label, "swimmer", members, threads, batch_steps)
    return workloads


def throughput(workload: Workload, times: Times) -> dict[str, Any]:
    """Return what the times of a workload's calls mean.

    Parameters
    ----------
    workload : Workload
        What was timed.
    times : (rounds,) array
        Seconds of every call.

    Returns
    -------
    dict
        ``label`` and the workload's facts; ``steps`` in a call and ``physics_steps_per_step``; the
        spreads ``steps_per_second``, ``microseconds_per_step`` and
        ``simulated_seconds_per_second``.
    """
    return {
        "label": workload.label,
        **workload.facts,
        "steps": workload.steps,
        "physics_steps_per_step": workload.physics_steps / workload.steps,
        "steps_per_second": spread_of(workload.steps / times).as_dict(),
        "microseconds_per_step": spread_of(1e6 * times / workload.steps).as_dict(),
        "simulated_seconds_per_second": spread_of(workload.seconds / times).as_dict(),
    }


def speed_ratio(above: Workload, above_times: Times, below: Workload, below_times: Times) -> Spread:
    """Return how many steps one workload takes while another takes one, round by round."""
    return ratio(above.steps / above_times, below.steps / below_times)
