"""The peers, prepared for timing beside the environments or measured by themselves.

Speeds of peers are no comparison of equals: none of them computes the fluid that a swimming body
sets in motion. `studies.benchmark.mujoco_chain` and `studies.benchmark.elastica_peer` say what
each does compute.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from studies.benchmark.elastica_peer import SOFTENINGS, rod_workloads
from studies.benchmark.environments import BATCH_MEMBERS, Workload, throughput
from studies.benchmark.mujoco_chain import CHAIN_VARIANTS, ChainVariant
from studies.benchmark.mujoco_peers import chain_workloads, swimmer_workloads
from studies.benchmark.peer_tools import PeerMissingError
from studies.benchmark.timing import time_in_turn
from swim_env.scene import Scene, load_scene

__all__ = [
    "PREPARATIONS",
    "measure_elastica_rod",
    "measure_mujoco_chain",
    "measure_swimmer_v5",
    "peer_workloads",
]

Progress = Callable[[int], object] | None

PREPARATIONS = 1 + len(CHAIN_VARIANTS) + len(SOFTENINGS)
"""How often `peer_workloads` calls its `progress`, unless told to prepare fewer."""


def peer_workloads(
    scene: Scene | str = "paper_i",
    *,
    variants: tuple[ChainVariant, ...] = CHAIN_VARIANTS,
    softenings: tuple[float, ...] = SOFTENINGS,
    ways: tuple[str, ...] = ("held",),
    members: int = BATCH_MEMBERS,
    single_steps: int = 200,
    batch_steps: int = 10,
    progress: Progress = None,
) -> tuple[dict[str, Workload], dict[str, str]]:
    """Prepare all peers, of which those whose packages are missing are skipped.

    Finding the stable steps takes about half a minute, and PyElastica's first use as long again.

    Parameters
    ----------
    scene : Scene or str
        The beam that chain and rod have, and the wave that drives them.
    variants, ways
        Of the chain, see `studies.benchmark.mujoco_peers.chain_workloads`.
    softenings
        Of the rod, see `studies.benchmark.elastica_peer.rod_workloads`.
    members, single_steps, batch_steps : int
        Of Swimmer-v5, see `studies.benchmark.mujoco_peers.swimmer_workloads`.
    progress : callable, optional
        Called with 1 after every preparation, see `PREPARATIONS`.

    Returns
    -------
    workloads : dict of str to Workload
        What to time. The keys are those of the functions above.
    skipped : dict of str to str
        Why a peer is missing, keyed ``swimmer_v5``, ``mujoco_chain`` or ``elastica_rod``.
    """
    scene = load_scene(scene)
    count = progress if progress is not None else (lambda done: None)
    workloads: dict[str, Workload] = {}
    skipped: dict[str, str] = {}

    def swimmer() -> dict[str, Workload]:
        prepared = swimmer_workloads(members, single_steps=single_steps, batch_steps=batch_steps)
        count(1)
        return prepared

    preparations: dict[str, tuple[int, Callable[[], dict[str, Workload]]]] = {
        "swimmer_v5": (1, swimmer),
        "mujoco_chain": (
            len(variants),
            lambda: chain_workloads(scene, variants, ways=ways, progress=count),
        ),
        "elastica_rod": (
            len(softenings),
            lambda: rod_workloads(scene, softenings, progress=count),
        ),
    }
    for name, (parts, prepare) in preparations.items():
        try:
            workloads |= prepare()
        except PeerMissingError as error:
            skipped[name] = str(error)
            count(parts)
    return workloads, skipped


def measure_swimmer_v5(*, rounds: int = 5, **options: Any) -> dict[str, Any]:
    """Time Gymnasium's Swimmer-v5; options are those of `swimmer_workloads`.

    Returns
    -------
    dict
        ``speeds``: by workload what `studies.benchmark.environments.throughput` returns (steps and
        simulated seconds per second, of all members together, and the facts), empty when the
        package is missing; ``skipped``: why it is, or None.
    """
    return _measure(lambda: swimmer_workloads(**options), rounds)


def measure_mujoco_chain(
    scene: Scene | str = "paper_i", *, rounds: int = 5, **options: Any
) -> dict[str, Any]:
    """Time the chain in MuJoCo; options are those of `chain_workloads`.

    Returns
    -------
    dict
        See `measure_swimmer_v5`; a step is a control interval of ``physics_steps_per_step`` steps
        of MuJoCo.
    """
    return _measure(lambda: chain_workloads(load_scene(scene), **options), rounds)


def measure_elastica_rod(
    scene: Scene | str = "paper_i", *, rounds: int = 5, **options: Any
) -> dict[str, Any]:
    """Time the rod in PyElastica; options are those of `rod_workloads`.

    Returns
    -------
    dict
        See `measure_swimmer_v5`; a step is a control interval of ``physics_steps_per_step`` steps
        of PyElastica.
    """
    return _measure(lambda: rod_workloads(load_scene(scene), **options), rounds)


def _measure(prepare: Callable[[], dict[str, Workload]], rounds: int) -> dict[str, Any]:
    try:
        workloads = prepare()
    except PeerMissingError as error:
        return {"speeds": {}, "skipped": str(error)}
    times = time_in_turn({name: work.call for name, work in workloads.items()}, rounds=rounds)
    speeds = {name: throughput(work, times[name]) for name, work in workloads.items()}
    return {"speeds": speeds, "skipped": None}
