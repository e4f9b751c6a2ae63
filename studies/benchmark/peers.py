"""The peers, prepared for timing beside the environments.

Speeds of peers are no comparison of equals: none of them computes the fluid that a swimming body
sets in motion. `studies.benchmark.mujoco_chain` and `studies.benchmark.elastica_peer` say what
each does compute.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from studies.benchmark.elastica_peer import SOFTENINGS, rod_workloads
from studies.benchmark.environments import Workload
from studies.benchmark.mujoco_chain import CHAIN_VARIANTS, ChainVariant, Way
from studies.benchmark.mujoco_peers import chain_workloads, swimmer_workloads
from studies.benchmark.peer_tools import PeerMissingError
from studies.benchmark.timing import Progress, no_progress
from swim_env.scene import load_scene


def peer_workloads(
    *,
    variants: tuple[ChainVariant, ...] = CHAIN_VARIANTS,
    softenings: tuple[float, ...] = SOFTENINGS,
    ways: tuple[Way, ...] = ("held",),
    single_steps: int = 200,
    batch_steps: int = 10,
    progress: Progress = no_progress,
) -> tuple[dict[str, Workload], dict[str, str]]:
    """Prepare all peers whose packages are installed: what to time, and why others are missing.

    Chain and rod have the beam of scene `paper_i`, and the wave that drives it. Finding their
    stable steps takes about half a minute, and PyElastica's first use as long again. `progress` is
    called with the number of preparations made: one, and one for each variant and softening.
    """
    scene = load_scene("paper_i")
    swimmer = partial(swimmer_workloads, single_steps=single_steps, batch_steps=batch_steps)
    preparations: tuple[tuple[str, int, Callable[..., dict[str, Workload]]], ...] = (
        ("swimmer_v5", 1, swimmer),
        ("mujoco_chain", len(variants), partial(chain_workloads, scene, variants, ways=ways)),
        ("elastica_rod", len(softenings), partial(rod_workloads, scene, softenings)),
    )
    workloads: dict[str, Workload] = {}
    skipped: dict[str, str] = {}
    for name, parts, prepare in preparations:
        try:
            workloads |= prepare(progress=progress)
        except PeerMissingError as error:
            skipped[name] = str(error)
            progress(parts)
    return workloads, skipped
