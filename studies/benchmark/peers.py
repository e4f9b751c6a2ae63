"""The peers, prepared for timing beside the environments.

Speeds of peers are no comparison of equals: none of them computes the fluid that a swimming body
sets in motion. `studies.benchmark.mujoco_chain` and `studies.benchmark.elastica_peer` say what
each does compute.
"""

from __future__ import annotations

from collections.abc import Callable

from studies.benchmark.elastica_peer import SOFTENINGS, rod_workloads
from studies.benchmark.environments import BATCH_MEMBERS, Workload
from studies.benchmark.mujoco_chain import CHAIN_VARIANTS, ChainVariant, Way
from studies.benchmark.mujoco_peers import chain_workloads, swimmer_workloads
from studies.benchmark.peer_tools import PeerMissingError
from studies.benchmark.timing import Progress
from swim_env.scene import Scene, load_scene

__all__ = ["peer_workloads"]


def peer_workloads(
    scene: Scene | str = "paper_i",
    *,
    variants: tuple[ChainVariant, ...] = CHAIN_VARIANTS,
    softenings: tuple[float, ...] = SOFTENINGS,
    ways: tuple[Way, ...] = ("held",),
    members: int = BATCH_MEMBERS,
    single_steps: int = 200,
    batch_steps: int = 10,
    progress: Progress = lambda done: None,
) -> tuple[dict[str, Workload], dict[str, str]]:
    """Prepare all peers whose packages are installed: what to time, and why others are missing.

    Finding the stable steps takes about half a minute, and PyElastica's first use as long again.

    Parameters
    ----------
    scene : Scene or str
        The beam that chain and rod have, and the wave that drives them.
    variants, ways, softenings, members, single_steps, batch_steps
        Of the functions that prepare chain, rod and Swimmer-v5, which name the workloads too.
    progress : callable, optional
        Called with the number of preparations made: one, and one for each variant and softening.
    """
    scene = load_scene(scene)
    workloads: dict[str, Workload] = {}
    skipped: dict[str, str] = {}

    def swimmer() -> dict[str, Workload]:
        prepared = swimmer_workloads(members, single_steps=single_steps, batch_steps=batch_steps)
        progress(1)
        return prepared

    preparations: dict[str, tuple[int, Callable[[], dict[str, Workload]]]] = {
        "swimmer_v5": (1, swimmer),
        "mujoco_chain": (
            len(variants),
            lambda: chain_workloads(scene, variants, ways=ways, progress=progress),
        ),
        "elastica_rod": (
            len(softenings),
            lambda: rod_workloads(scene, softenings, progress=progress),
        ),
    }
    for name, (parts, prepare) in preparations.items():
        try:
            workloads |= prepare()
        except PeerMissingError as error:
            skipped[name] = str(error)
            progress(parts)
    return workloads, skipped
