"""Throughput of the environments: workloads to be timed in turn, and what their times mean.

A `Workload` plays the same number of environment steps in every call. All of them, those of the
peers included, are timed round after round by `studies.benchmark.timing.time_in_turn`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from studies.benchmark.timing import spread_of
from swim_env.envs.registration import FORWARD_ID
from swim_env.scene import Scene, load_scene
from swim_env.sim.simulator import Simulator

#: Members of the batches.
BATCH_MEMBERS = 64


class Workload(NamedTuple):
    """A number of environment steps to be timed, the same in every call.

    `label` is its name in tables; `call` plays the steps, and episodes continue from call to call.
    `steps`, `seconds` (simulated) and `physics_steps` are those of a call, of all members together;
    `facts` is what else is known, in plain values for JSON.
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


def step_loop(
    env: gymnasium.Env[Any, Any] | VectorEnv[Any, Any, Any],
    actions: NDArray[Any],
    steps: int,
    seed: int = 0,
) -> Callable[[], None]:
    """Return a function that plays `steps` steps of any environment or batch.

    Actions, (K, ...), are played one after another, over and over. A single environment is reset
    where its episode ends; a batch must do that by itself.
    """
    env.reset(seed=seed)
    rows = itertools.cycle(actions)
    restarts_itself = isinstance(env, VectorEnv)

    def play() -> None:
        for action in itertools.islice(rows, steps):
            _, _, terminated, truncated, _ = env.step(action)
            if not restarts_itself and (terminated or truncated):
                env.reset()

    return play


def environment_workload(
    label: str,
    scene: Scene | str,
    steps: int,
    *,
    batch: tuple[int, int] | None = None,
    wave: bool = False,
) -> Workload:
    """Return an environment of a scene that plays `steps` steps in a call.

    It is a single one from `gymnasium.make`, under random torques or the scene's prescribed wave,
    or a `batch` from `gymnasium.make_vec`, given by its members and largest number of threads.
    """
    scene = load_scene(scene)
    members, threads = batch or (1, 1)
    env: gymnasium.Env[Any, Any] | VectorEnv[Any, Any, Any]
    if batch is None:
        env = gymnasium.make(FORWARD_ID, scene=scene)
    else:
        env = gymnasium.make_vec(FORWARD_ID, num_envs=members, scene=scene, num_threads=threads)
    count = max(steps, 1000 if batch is None else 100)
    actions = wave_actions(scene, count) if wave else random_actions(env.action_space, count)
    play, total = step_loop(env, actions, steps), steps * members
    seconds = total * scene.episode.control_interval
    return Workload(label, play, total, seconds, total * scene.steps_per_action)


def rollout_workload(label: str, scene: Scene | str, steps: int) -> Workload:
    """Return the simulator playing a scene's torque from the start, `steps` control intervals."""
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
    """Return the workloads of this package, with a batch on several cores where there are some.

    ``swimmer`` and ``paper_i`` are under random torques; ``paper_i_wave`` is `paper_i` as the paper
    drives it: without damping, random torques feed its fast modes until an episode ends, and a step
    then costs several times what it costs in the paper's motion. ``paper_i_rollout`` is the same
    motion in the simulator, all steps in one kernel call, which is what chains and rods of other
    packages compare with. ``batch_1_thread`` and ``batch_all_cores`` are batches of `swimmer`.
    """
    wave = "paper_i, the paper's wave"
    workloads = {
        "swimmer": environment_workload("swimmer, random torques", "swimmer", single_steps),
        "paper_i": environment_workload("paper_i, random torques", "paper_i", single_steps),
        "paper_i_wave": environment_workload(wave, "paper_i", single_steps, wave=True),
        "paper_i_rollout": rollout_workload(f"{wave}, physics alone", "paper_i", single_steps),
    }
    for threads in sorted({1, cores}):
        name = "batch_1_thread" if threads == 1 else "batch_all_cores"
        label = f"swimmer, {members} members, {threads} thread{'s' if threads > 1 else ''}"
        batch = (members, threads)
        workloads[name] = environment_workload(label, "swimmer", batch_steps, batch=batch)
    return workloads


def throughput(workload: Workload, times: NDArray[np.float64]) -> dict[str, Any]:
    """Return what the times (s) of a workload's calls mean.

    That is its ``label`` and facts; ``steps`` of a call and ``physics_steps_per_step``; the spreads
    ``steps_per_second``, ``microseconds_per_step`` and ``simulated_seconds_per_second``.
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
