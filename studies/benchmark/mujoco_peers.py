"""The peers that run in MuJoCo, prepared for timing: the chain of links and Swimmer-v5."""

from __future__ import annotations

from typing import Any

import gymnasium
from gymnasium.vector import SyncVectorEnv

from studies.benchmark.environments import BATCH_MEMBERS, Workload, random_actions, step_loop
from studies.benchmark.mujoco_chain import CHAIN_VARIANTS, ChainVariant, MuJoCoChain, Way
from studies.benchmark.peer_tools import StableStep, intervals_in, largest_stable_step, load_peer
from studies.benchmark.timing import Progress, no_progress
from swim_env.scene import Scene

_SWIMMER_ID = "Swimmer-v5"


def chain_step(scene: Scene, variant: ChainVariant, duration: float = 10.0) -> StableStep | None:
    """Find the chain's largest stable step, driven by its scene's wave for some seconds.

    It is None where steps of 1/800 of a control interval are unstable.
    """
    count = intervals_in(duration, scene)
    return largest_stable_step(
        lambda substeps: MuJoCoChain(scene, variant, substeps).swim(count),
        scene.episode.control_interval,
        most=800,
    )


def chain_workloads(
    scene: Scene,
    variants: tuple[ChainVariant, ...] = CHAIN_VARIANTS,
    *,
    ways: tuple[Way, ...] = ("held",),
    seconds: float = 1.0,
    duration: float = 10.0,
    progress: Progress = no_progress,
) -> dict[str, Workload]:
    """Prepare the chain at its largest stable steps; every call starts it anew.

    Integrators that the installed MuJoCo does not have, and variants without a stable step, are
    left out. A call is `seconds` of simulated time, the search for the step runs for `duration`
    seconds of it; `progress` is called after every variant.

    Returns
    -------
    dict of str to Workload
        Keyed ``mujoco_chain/integrator/fluid/links/way``; environment steps are control intervals.
        Facts: `integrator`, `fluid`, `links`, `way`, `version` (of MuJoCo), `search_duration` (s)
        and the fields of `StableStep`.
    """
    mujoco: Any = load_peer("mujoco", "MuJoCo")
    about = {"version": str(mujoco.__version__), "search_duration": duration}
    count = intervals_in(seconds, scene)
    workloads = {}
    for variant in variants:
        known = f"mjINT_{variant.integrator.upper()}" in mujoco.mjtIntegrator.__members__
        found = chain_step(scene, variant, duration) if known else None
        if found is not None:
            calls = MuJoCoChain(scene, variant, found.substeps).calls(count)
            for way in ways:
                facts = {**variant._asdict(), "way": way, **about}
                label = f"MuJoCo chain, {variant.description}, {way}"
                name = f"mujoco_chain/{variant.name}/{way}"
                workloads[name] = found.workload(label, calls[way], count, facts)
        progress(1)
    return workloads


def swimmer_workloads(
    members: int = BATCH_MEMBERS,
    *,
    single_steps: int = 200,
    batch_steps: int = 10,
    progress: Progress = no_progress,
) -> dict[str, Workload]:
    """Prepare Gymnasium's Swimmer-v5, alone and in a synchronous vector environment.

    Actions are random and drawn beforehand. Episodes continue from call to call and start anew
    after 1000 steps, within the calls. `swimmer_v5` is as `gymnasium.make` makes it; the members of
    `swimmer_v5_sync_vector` have no environment checker around them, like those in batches of this
    package. Facts: `members`, `integrator`, `time_step` (s, of the physics), `version`.
    """
    mujoco: Any = load_peer("mujoco", "MuJoCo")

    def member() -> gymnasium.Env[Any, Any]:
        return gymnasium.make(_SWIMMER_ID, disable_env_checker=True)

    env: gymnasium.Env[Any, Any] = gymnasium.make(_SWIMMER_ID)
    batch = SyncVectorEnv([member] * members)
    inside: Any = env.unwrapped
    options = inside.model.opt
    facts = {
        "integrator": mujoco.mjtIntegrator(options.integrator).name.removeprefix("mjINT_"),
        "time_step": float(options.timestep),
        "version": str(mujoco.__version__),
    }

    def workload(label: str, play: Any, steps: int, count: int) -> Workload:
        seconds, physics = steps * float(inside.dt), steps * int(inside.frame_skip)
        return Workload(label, play, steps, seconds, physics, {"members": count, **facts})

    alone = step_loop(env, random_actions(env.action_space, 1000), single_steps)
    together = step_loop(batch, random_actions(batch.action_space, 100), batch_steps)
    label = f"{_SWIMMER_ID}, {members} members, SyncVectorEnv"
    progress(1)
    return {
        "swimmer_v5": workload(_SWIMMER_ID, alone, single_steps, 1),
        "swimmer_v5_sync_vector": workload(label, together, members * batch_steps, members),
    }
