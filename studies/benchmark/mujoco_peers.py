"""The peers that run in MuJoCo, prepared for timing: the chain of links and Swimmer-v5."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

import gymnasium
from gymnasium.vector import SyncVectorEnv

from studies.benchmark.environments import (
    BATCH_MEMBERS,
    Workload,
    batch_loop,
    random_actions,
    single_loop,
)
from studies.benchmark.mujoco_chain import CHAIN_VARIANTS, WAYS, ChainVariant, MuJoCoChain
from studies.benchmark.peer_tools import StableStep, largest_stable_step, load_peer
from swim_env.errors import OptionError
from swim_env.scene import Scene

__all__ = [
    "CHAIN_VARIANTS",
    "WAYS",
    "ChainVariant",
    "chain_step",
    "chain_workloads",
    "swimmer_workloads",
]

SWIMMER_ID = "Swimmer-v5"


def chain_step(scene: Scene, variant: ChainVariant, duration: float = 10.0) -> StableStep | None:
    """Find the chain's largest stable step.

    Parameters
    ----------
    scene : Scene
        The beam, its wave and the control interval, of which the step is a whole part.
    variant : ChainVariant
        How to build and run it.
    duration : float
        How long the wave drives it (s).

    Returns
    -------
    StableStep or None
        See `largest_stable_step`; None where steps of 1/800 of a control interval are unstable.
    """
    interval = scene.episode.control_interval
    count = max(1, round(duration / interval))
    return largest_stable_step(
        lambda substeps: MuJoCoChain(scene, variant, substeps).swim(count), interval, most=800
    )


def chain_workloads(
    scene: Scene,
    variants: tuple[ChainVariant, ...] = CHAIN_VARIANTS,
    *,
    ways: tuple[str, ...] = ("held",),
    seconds: float = 1.0,
    duration: float = 10.0,
    progress: Callable[[int], object] | None = None,
) -> dict[str, Workload]:
    """Prepare the chain at its largest stable steps; every call starts it anew.

    Parameters
    ----------
    scene : Scene
        The beam, its wave and the control interval.
    variants : tuple of ChainVariant
        What to run. Integrators that the installed MuJoCo does not have, and variants without a
        stable step, are left out.
    ways : tuple of str
        How to call it, of `WAYS`.
    seconds : float
        Simulated time of one call (s).
    duration : float
        Simulated time of the runs in the search for the stable step (s).
    progress : callable, optional
        Called with 1 after every variant.

    Returns
    -------
    dict of str to Workload
        Keyed ``mujoco_chain/integrator/fluid/links/way``; environment steps are control intervals.
        Facts: `integrator`, `fluid`, `links`, `way`, `version` (of MuJoCo), `search_duration` (s)
        and the fields of `StableStep`.

    Raises
    ------
    PeerMissingError
        If MuJoCo is not installed.
    OptionError
        If a way or a variant is unknown, or a variant needs a fluid that the scene does not have.
    """
    unknown = set(ways) - set(WAYS)
    if unknown:
        raise OptionError(f"ways must be of {WAYS}, got {sorted(unknown)}")
    mujoco: Any = load_peer("mujoco", "MuJoCo")
    interval = scene.episode.control_interval
    count = max(1, round(seconds / interval))
    workloads = {}
    for variant in variants:
        found = None
        if _has_integrator(mujoco, variant.integrator):
            found = chain_step(scene, variant, duration)
        if found is not None:
            calls = MuJoCoChain(scene, variant, found.substeps).calls(count)
            for way in ways:
                workloads[f"mujoco_chain/{variant.name}/{way}"] = Workload(
                    f"MuJoCo chain, {variant.description}, {way}",
                    calls[way],
                    count,
                    count * interval,
                    count * found.substeps,
                    {
                        **variant._asdict(),
                        "way": way,
                        "version": str(mujoco.__version__),
                        "search_duration": duration,
                        **found.as_dict(),
                    },
                )
        if progress is not None:
            progress(1)
    return workloads


def _has_integrator(mujoco: ModuleType, name: str) -> bool:
    return f"mjINT_{name.upper()}" in mujoco.mjtIntegrator.__members__


def swimmer_workloads(
    members: int = BATCH_MEMBERS, *, single_steps: int = 200, batch_steps: int = 10
) -> dict[str, Workload]:
    """Prepare Gymnasium's Swimmer-v5, alone and in a synchronous vector environment.

    Actions are random and drawn beforehand. Episodes go on from call to call and start anew after
    1000 steps, within the calls.

    Parameters
    ----------
    members : int
        Members of the vector environment.
    single_steps, batch_steps : int
        Steps of one call, alone and of the vector environment.

    Returns
    -------
    dict of str to Workload
        `swimmer_v5`, as `gymnasium.make` makes it, and `swimmer_v5_sync_vector`, whose members go
        without the checks that it wraps around them, as they do in batches of this package. Facts:
        `members`, `integrator`, `time_step` (s, of the physics), `version` (of MuJoCo).

    Raises
    ------
    PeerMissingError
        If MuJoCo is not installed.
    """
    mujoco: Any = load_peer("mujoco", "MuJoCo")

    def member() -> gymnasium.Env[Any, Any]:
        return gymnasium.make(SWIMMER_ID, disable_env_checker=True)

    env: gymnasium.Env[Any, Any] = gymnasium.make(SWIMMER_ID)
    batch = SyncVectorEnv([member] * members)
    inside: Any = env.unwrapped
    interval, skip = float(inside.dt), int(inside.frame_skip)
    options = inside.model.opt
    facts = {
        "integrator": mujoco.mjtIntegrator(options.integrator).name.removeprefix("mjINT_"),
        "time_step": float(options.timestep),
        "version": str(mujoco.__version__),
    }
    total = members * batch_steps
    return {
        "swimmer_v5": Workload(
            SWIMMER_ID,
            single_loop(env, random_actions(env.action_space, 1000), single_steps),
            single_steps,
            single_steps * interval,
            single_steps * skip,
            {"members": 1, **facts},
        ),
        "swimmer_v5_sync_vector": Workload(
            f"{SWIMMER_ID}, {members} members, SyncVectorEnv",
            batch_loop(batch, random_actions(batch.action_space, 100), batch_steps),
            total,
            total * interval,
            total * skip,
            {"members": members, **facts},
        ),
    }
