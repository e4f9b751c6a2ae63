"""The benchmark's sections: what is measured, how much of it, and what it is compared to."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from swim_agents.commands.command_line import progress_bar
from swim_agents.learning.config import load_config

from studies.benchmark.effects import effect_pairs, measure_effects
from studies.benchmark.elastica_peer import SOFTENINGS
from studies.benchmark.environments import Workload, swim_workloads, throughput
from studies.benchmark.growth import growth_of
from studies.benchmark.memory import measure_memory
from studies.benchmark.mujoco_chain import CHAIN_VARIANTS, ChainVariant, Way
from studies.benchmark.parts import measure_parts
from studies.benchmark.peers import peer_workloads
from studies.benchmark.startup import measure_cold_start, measure_warm_start
from studies.benchmark.timing import Progress, no_progress, ratio, time_in_turn
from swim_env.envs.assessment import load_assessment
from swim_env.errors import SwimError
from swim_env.physics import FLUID_MODELS
from swim_env.physics.runtime.threads import usable_threads
from swim_env.scene import Scene, load_scene
from swim_env.scene.fluid import FLUID_TABLE

#: What can be measured by itself.
SECTIONS = ("kernel", "effects", "environments", "startup", "training", "peers")

#: Models that cut no outline into panels at a step, whose cost does not depend on their number.
_WITHOUT_PANELS = ("none", "strip", "frozen", "expansion")
#: The model that is there for comparison with the paper's equations only.
_NOT_FOR_USE = "centreline"
_USUAL_PANELS = 4
#: Elements times panels above which steps are long and their medians steady: a third of the rounds
#: do, at least 3.
_LARGE = 250
#: Growth is fitted over all beams, and over those from here on, where the panels dominate.
_LARGE_BEAMS = 18


class Extent(NamedTuple):
    """How much is measured."""

    #: Beams and panels per element that the parts of a step are measured for.
    elements: tuple[int, ...] = (3, 5, 9, 18, 27, 54, 81)
    panels: tuple[int, ...] = (2, 4, 8, 12)
    #: How often each thing is timed.
    rounds: int = 15
    #: Environment steps in a timed call.
    single_steps: int = 200
    batch_steps: int = 10
    #: Sizes of the batches whose memory is measured.
    memory_members: tuple[int, ...] = (1, 64, 256)
    #: Starts with a filled cache, and whether one with an empty cache is measured.
    starts: int = 5
    cold_start: bool = True
    #: Length of each training run (s), and changes to the shipped training configurations by name.
    training_seconds: float = 20.0
    training: Mapping[str, dict[str, Any]] = MappingProxyType({})
    #: What of the peers is prepared, see `studies.benchmark.peers.peer_workloads`.
    chain_variants: tuple[ChainVariant, ...] = CHAIN_VARIANTS
    chain_ways: tuple[Way, ...] = ("held", "single")
    softenings: tuple[float, ...] = SOFTENINGS


FULL = Extent()

QUICK = Extent(
    elements=(3, 9, 27),
    panels=(4,),
    rounds=3,
    single_steps=100,
    batch_steps=4,
    memory_members=(1, 16, 64),
    starts=2,
    cold_start=False,
    training_seconds=2.0,
    training={"ppo_forward": {"ppo.rollout": 32}, "sac_forward": {"sac.learning_starts": 256}},
    chain_variants=(ChainVariant("implicitfast", "ellipsoid", "rod"),),
    chain_ways=("held",),
    softenings=(),  # PyElastica compiles for half a minute
)

#: Comparisons in environment steps per second, made where both workloads were timed: the label in
#: tables, the workloads above and below, and what their ratio should be at least.
_RATIOS: dict[str, tuple[str, str, str, float]] = {
    "agent_to_swimmer_v5": (
        "swimmer (4 physics steps each), an agent's episode, to Swimmer-v5",
        "agent", "swimmer_v5", 0.45,
    ),
    "random_to_swimmer_v5": (
        "swimmer, random torques, to Swimmer-v5", "random", "swimmer_v5", 0.45
    ),
    "paper_i_wave_to_swimmer_v5": (
        "paper_i (2 physics steps each), the paper's wave, to Swimmer-v5",
        "paper_i_wave", "swimmer_v5", 0.6,
    ),
    "batch_all_cores_to_1_thread": (
        "batch on all cores to the same batch in one thread",
        "batch_all_cores", "batch_1_thread", 1.6,
    ),
    "batch_to_swimmer_v5_sync_vector": (
        "batch on all cores to as many Swimmer-v5 in a synchronous vector environment",
        "batch_all_cores", "swimmer_v5_sync_vector", 1.0,
    ),
}  # fmt: skip


def measure(sections: Iterable[str], extent: Extent, optional: bool) -> dict[str, Any]:
    """Measure sections, with progress bars; peers come with the environments beside them.

    Returns of ``kernel``, ``growth``, ``effects``, ``speeds``, ``ratios``, ``memory``, ``startup``
    and ``training`` what the sections give; ``skipped``: why others are missing, by name. With
    `optional`, sections whose packages are not installed are left out; else a section of which
    nothing can be measured is a SwimError or an ImportError.
    """
    load_assessment()
    record: dict[str, Any] = {}
    skipped: dict[str, str] = {}
    peers: dict[str, Workload] = {}
    sections = set(sections)
    if "kernel" in sections:
        record |= _measure_kernel(extent)
    if "effects" in sections:
        with progress_bar(len(effect_pairs()), "effect", "effects") as progress:
            record["effects"] = measure_effects(extent.rounds, progress)
    if "peers" in sections:
        total = 1 + len(extent.chain_variants) + len(extent.softenings)
        with progress_bar(total, "peer", "preparing the peers") as progress:
            peers, skipped = peer_workloads(
                variants=extent.chain_variants,
                softenings=extent.softenings,
                ways=extent.chain_ways,
                single_steps=extent.single_steps,
                batch_steps=extent.batch_steps,
                progress=progress,
            )
        if not peers and not optional:
            raise SwimError("; ".join(skipped.values()))
    if sections & {"environments", "peers"}:
        ours = swim_workloads(
            usable_threads(), single_steps=extent.single_steps, batch_steps=extent.batch_steps
        )
        with progress_bar(extent.rounds, "round", "environments") as progress:
            speeds, ratios = measure_speeds({**ours, **peers}, extent.rounds, progress)
        for name, speed in speeds.items():
            speed["peer"] = name in peers
        record |= {"speeds": speeds, "ratios": ratios}
    if "environments" in sections:
        record["memory"] = measure_memory(members=extent.memory_members)
    if "startup" in sections:
        with progress_bar(extent.starts + extent.cold_start, "start", "start-up") as progress:
            record["startup"] = {"warm": measure_warm_start(extent.starts, progress)}
            record["startup"]["cold"] = measure_cold_start() if extent.cold_start else None
    if "training" in sections:
        try:
            record["training"] = _measure_training(extent)
        except ImportError as error:
            if not optional:
                raise
            skipped["training"] = str(error)
    return {**record, "skipped": skipped}


def kernel_scenes(elements: Sequence[int], panels: Sequence[int]) -> list[Scene]:
    """Return `paper_i` with every fluid model, number of elements and of panels per element.

    Without the model for comparison, and beams that are too large for a model.
    """
    changes = [
        {"fluid.model": model, "fluid.panels_per_element": count, "beam.elements": number}
        for model in FLUID_MODELS
        if model != _NOT_FOR_USE
        for count in ([_USUAL_PANELS] if model in _WITHOUT_PANELS else panels)
        for number in elements
        if number <= FLUID_TABLE[model].most_elements
    ]
    return [load_scene("paper_i", change) for change in changes]


def _measure_kernel(extent: Extent) -> dict[str, Any]:
    """Measure the physics step of scenes by part, and how it grows with the number of elements."""
    scenes = kernel_scenes(extent.elements, extent.panels)
    cells = []
    with progress_bar(len(scenes), "scene", "physics step") as progress:
        for scene in scenes:
            panels = scene.fluid.panels_per_element if scene.fluid else 0
            large = scene.beam.elements * panels > _LARGE
            rounds = min(extent.rounds, max(3, extent.rounds // 3)) if large else extent.rounds
            cells.append(measure_parts(scene, rounds))
            progress(1)
    return {"kernel": cells, "growth": growth_of(cells) + growth_of(cells, _LARGE_BEAMS)}


def measure_speeds(
    workloads: Mapping[str, Workload], rounds: int, progress: Progress = no_progress
) -> tuple[dict[str, dict[str, Any]], dict[str, dict[str, Any]]]:
    """Time workloads in turn and compare them; `progress` is called after every round.

    Returns by workload what `studies.benchmark.environments.throughput` returns, and by comparison
    ``label``, the spread ``ratio`` over the rounds, ``aim``, and ``met``: whether the median
    reaches it.
    """
    calls = {name: workload.call for name, workload in workloads.items()}
    times = time_in_turn(calls, rounds=rounds, after_round=progress)
    speeds = {name: throughput(workload, times[name]) for name, workload in workloads.items()}
    ratios = {}
    for name, (label, above, below, aim) in _RATIOS.items():
        if above in workloads and below in workloads:
            spread = ratio(*(workloads[one].steps / times[one] for one in (above, below)))
            met = spread.median >= aim
            ratios[name] = {"label": label, "ratio": spread.as_dict(), "aim": aim, "met": met}
    return speeds, ratios


def _measure_training(extent: Extent) -> dict[str, Any]:
    # It needs PyTorch and stable-baselines3.
    from studies.benchmark.training_cost import CONFIGS, measure_training

    runs = {}
    for name in CONFIGS:
        config = load_config(name, extent.training.get(name))
        with progress_bar(int(extent.training_seconds), "s", f"training, {name}") as progress:
            runs[config.algorithm] = measure_training(
                config, seconds=extent.training_seconds, progress=progress
            )
    return runs
