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
from swim_agents.comparison.contest import FIRST_SEED
from swim_agents.learning.saved import AgentPolicy
from swim_agents.policies import load_policy
from swim_agents.rollout import Rollout, play_episodes

from studies.benchmark.timing import spread_of
from swim_env.envs.interface import action_space_of
from swim_env.envs.registration import FORWARD_ID
from swim_env.envs.vector import SwimVectorEnv
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


def violent_actions(space: gymnasium.Space[Any], count: int, seed: int = 0) -> NDArray[Any]:
    """Return the largest torques, (count, *space.shape), with random signs."""
    signs: NDArray[Any] = np.sign(random_actions(space, count, seed))
    return signs


def agent_episode(name: str = "ppo_forward") -> Rollout:
    """Play an agent's first scored episode on its scene."""
    policy = load_policy(name)
    assert isinstance(policy, AgentPolicy)
    env = SwimVectorEnv(1, load_scene(policy.scene.name))
    return play_episodes(env, policy, [FIRST_SEED])[0]


def agent_actions(episode: Rollout, members: int = 1) -> NDArray[np.float32]:
    """Return an episode's actions, (K, N - 1), or those of members at as many times of it.

    Those are (K, members, N - 1).
    """
    limit = episode.scene.torque_limit
    actions: NDArray[np.float32] = (episode.torques / limit).astype(np.float32)
    if members == 1:
        return actions
    count = len(actions)
    times = np.arange(count)[:, None] + np.arange(members) * count // members
    together: NDArray[np.float32] = actions[times % count]
    return together


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
    actions: NDArray[Any] | None = None,
) -> Workload:
    """Return an environment of a scene that plays `steps` steps in a call.

    It is a single one from `gymnasium.make`, or a `batch` from `gymnasium.make_vec`, given by its
    members and largest number of threads. Torques are random unless `actions`, (K, ...), are given.
    """
    scene = load_scene(scene)
    members, threads = batch or (1, 1)
    env: gymnasium.Env[Any, Any] | VectorEnv[Any, Any, Any]
    if batch is None:
        env = gymnasium.make(FORWARD_ID, scene=scene)
    else:
        env = gymnasium.make_vec(FORWARD_ID, num_envs=members, scene=scene, num_threads=threads)
    if actions is None:
        actions = random_actions(env.action_space, max(steps, 1000 if batch is None else 100))
    play, total = step_loop(env, actions, steps), steps * members
    seconds = total * scene.episode.control_interval
    return Workload(label, play, total, seconds, total * scene.steps_per_action)


def rollout_workload(
    label: str, scene: Scene | str, steps: int, torques: NDArray[np.float64] | None = None
) -> Workload:
    """Return the simulator playing torques from the start, `steps` control intervals of them.

    They are the scene's own unless torques of every interval, (K, N - 1), are given.
    """
    simulator = Simulator(scene)
    hold = simulator.scene.steps_per_action
    physics = steps * hold
    if torques is None:
        torques = simulator.prescribed_torques(physics)
    else:
        assert len(torques) >= steps, f"{len(torques)} torques for {steps} intervals"
        torques = np.repeat(torques, hold, axis=0)[:physics]

    def play() -> None:
        simulator.reset()
        simulator.rollout(torques)

    return Workload(label, play, steps, physics * simulator.time_step, physics)


def swim_workloads(
    cores: int, members: int = BATCH_MEMBERS, single_steps: int = 200, batch_steps: int = 10
) -> dict[str, Workload]:
    """Return the workloads of this package, with a batch on several cores where there are some.

    ``agent`` is what users run: an episode of a trained agent on scene `swimmer`, as are
    ``batch_1_thread`` and ``batch_all_cores``, whose members are at different times of it.
    ``random`` and ``violent`` are the same scene under random torques and under the largest ones;
    ``paper_i_wave`` is `paper_i` as the paper drives it. ``agent_rollout`` and ``paper_i_rollout``
    are motions in the simulator, all steps in one kernel call, which is what chains and rods of
    other packages compare with.
    """
    episode = agent_episode()
    played, paper = agent_actions(episode), load_scene("paper_i")
    violent = violent_actions(action_space_of(episode.scene), len(played))
    agent, wave = "swimmer, an agent's episode", "paper_i, the paper's wave"
    workloads = {
        "agent": environment_workload(agent, "swimmer", single_steps, actions=played),
        "random": environment_workload("swimmer, random torques", "swimmer", single_steps),
        "violent": environment_workload(
            "swimmer, largest torques of random signs", "swimmer", single_steps, actions=violent
        ),
        "paper_i_wave": environment_workload(
            wave, paper, single_steps, actions=wave_actions(paper, 1000)
        ),
        "agent_rollout": rollout_workload(
            f"{agent}, physics alone", "swimmer", single_steps, episode.torques
        ),
        "paper_i_rollout": rollout_workload(f"{wave}, physics alone", paper, single_steps),
    }
    together = agent_actions(episode, members)
    for threads in sorted({1, cores}):
        name = "batch_1_thread" if threads == 1 else "batch_all_cores"
        label = f"{agent}, {members} members, {threads} thread{'s' if threads > 1 else ''}"
        workloads[name] = environment_workload(
            label, "swimmer", batch_steps, batch=(members, threads), actions=together
        )
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
