"""The benchmark's sections: which measurements are made of what, and what they are compared to."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from studies.benchmark.elastica_peer import SOFTENINGS
from studies.benchmark.environments import Workload, speed_ratio, throughput
from studies.benchmark.mujoco_chain import CHAIN_VARIANTS, ChainVariant
from studies.benchmark.parts import measure_parts
from studies.benchmark.timing import time_in_turn
from swim_env.physics import FLUID_MODELS
from swim_env.scene import Scene, load_scene
from swim_env.scene.fluid import MOST_ELEMENTS_OF_EXPANSION

__all__ = [
    "FULL",
    "QUICK",
    "RATIOS",
    "SECTIONS",
    "Extent",
    "Ratio",
    "kernel_scenes",
    "measure_kernel",
    "measure_speeds",
]

#: What can be measured by itself.
SECTIONS = ("kernel", "effects", "environments", "startup", "training", "peers")

#: Models that cut no outline into panels at a step, whose cost does not depend on their number.
_WITHOUT_PANELS = ("none", "strip", "frozen", "expansion")
#: The model that is there for comparison with the paper's equations only.
_NOT_FOR_USE = "centreline"
_USUAL_PANELS = 4
#: Where the steps are long and their medians steady, fewer rounds do.
_LARGE = 250


class Extent(NamedTuple):
    """How much is measured.

    Attributes
    ----------
    elements, panels : tuple of int
        Beams and panels per element that the parts of a step are measured for.
    rounds : int
        How often each thing is timed.
    single_steps, batch_steps : int
        Environment steps in a timed call.
    memory_members : tuple of int
        Sizes of the batches whose memory is measured.
    starts : int
        Number of starts with a filled cache.
    cold_start : bool
        Whether a start with an empty cache is measured.
    training_seconds : float
        Length of each training run.
    training : dict of str to dict
        Changes to the shipped training configurations, by name.
    chain_variants, chain_ways, softenings : tuple
        What of the peers is prepared, see `studies.benchmark.peers.peer_workloads`.
    """

    elements: tuple[int, ...]
    panels: tuple[int, ...]
    rounds: int
    single_steps: int
    batch_steps: int
    memory_members: tuple[int, ...]
    starts: int
    cold_start: bool
    training_seconds: float
    training: dict[str, dict[str, Any]]
    chain_variants: tuple[ChainVariant, ...]
    chain_ways: tuple[str, ...]
    softenings: tuple[float, ...]


FULL = Extent(
    elements=(3, 5, 9, 18, 27, 54, 81),
    panels=(2, 4, 8, 12),
    rounds=15,
    single_steps=200,
    batch_steps=10,
    memory_members=(1, 64, 256),
    starts=5,
    cold_start=True,
    training_seconds=20.0,
    training={},
    chain_variants=CHAIN_VARIANTS,
    chain_ways=("held", "single"),
    softenings=SOFTENINGS,
)

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
    training={
        "ppo_forward": {"ppo.rollout": 32},
        "sac_forward": {"sac.learning_starts": 256},
    },
    chain_variants=(ChainVariant("implicitfast", "ellipsoid", "rod"),),
    chain_ways=("held",),
    softenings=(),  # PyElastica compiles for half a minute
)


class Ratio(NamedTuple):
    """A comparison of two workloads' speeds.

    Attributes
    ----------
    label : str
        What is compared, for tables.
    above, below : str
        Names of the workloads.
    aim : float or None
        What the ratio should be at least.
    """

    label: str
    above: str
    below: str
    aim: float | None


#: Comparisons in environment steps per second, made where both workloads were timed.
RATIOS: dict[str, Ratio] = {
    "swimmer_to_swimmer_v5": Ratio(
        "swimmer (4 physics steps each) to Swimmer-v5", "swimmer", "swimmer_v5", 0.35
    ),
    "paper_i_to_swimmer_v5": Ratio(
        "paper_i (2 physics steps each), random torques, to Swimmer-v5",
        "paper_i",
        "swimmer_v5",
        0.6,
    ),
    "paper_i_wave_to_swimmer_v5": Ratio(
        "paper_i (2 physics steps each), the paper's wave, to Swimmer-v5",
        "paper_i_wave",
        "swimmer_v5",
        0.6,
    ),
    "batch_all_cores_to_1_thread": Ratio(
        "batch on all cores to the same batch in one thread",
        "batch_all_cores",
        "batch_1_thread",
        1.6,
    ),
    "batch_to_swimmer_v5_sync_vector": Ratio(
        "batch on all cores to as many Swimmer-v5 in a synchronous vector environment",
        "batch_all_cores",
        "swimmer_v5_sync_vector",
        1.0,
    ),
}


def kernel_scenes(elements: Iterable[int], panels: Iterable[int]) -> list[Scene]:
    """Return `paper_i` with every fluid model, number of elements and of panels per element.

    Without the model for comparison, and beams that are too large for a model.
    """
    elements, panels = list(elements), list(panels)
    scenes = []
    for model in FLUID_MODELS:
        if model == _NOT_FOR_USE:
            continue
        of_model = load_scene("paper_i").replace("fluid.model", model)
        for count in [_USUAL_PANELS] if model in _WITHOUT_PANELS else panels:
            with_panels = of_model.replace("fluid.panels_per_element", count)
            most = MOST_ELEMENTS_OF_EXPANSION if model == "expansion" else max(elements)
            scenes += [
                with_panels.replace("beam.elements", number)
                for number in elements
                if number <= most
            ]
    return scenes


def measure_kernel(
    scenes: Iterable[Scene],
    rounds: int,
    progress: Callable[[int], object] | None = None,
) -> list[dict[str, Any]]:
    """Measure the physics step of scenes by part.

    Parameters
    ----------
    scenes : iterable of Scene
        The scenes.
    rounds : int
        How often each part is timed; a third of it, at least 3, for large beams.
    progress : callable, optional
        Called with 1 after every scene.

    Returns
    -------
    list of dict
        Of every scene what `studies.benchmark.parts.measure_parts` returns.
    """
    cells: list[dict[str, Any]] = []
    for scene in scenes:
        panels = scene.fluid.panels_per_element if scene.fluid else 0
        large = scene.beam.elements * panels > _LARGE
        cells.append(measure_parts(scene, min(rounds, max(3, rounds // 3)) if large else rounds))
        if progress is not None:
            progress(1)
    return cells


def measure_speeds(
    workloads: Mapping[str, Workload],
    rounds: int,
    progress: Callable[[int], object] | None = None,
) -> tuple[dict[str, dict[str, Any]], dict[str, dict[str, Any]]]:
    """Time workloads in turn and compare them.

    Parameters
    ----------
    workloads : mapping of str to Workload
        What is timed, by name.
    rounds : int
        How often each is timed.
    progress : callable, optional
        Called with 1 after every round.

    Returns
    -------
    speeds : dict of str to dict
        By workload what `studies.benchmark.environments.throughput` returns.
    ratios : dict of str to dict
        By name of RATIOS: ``label``, the spread ``ratio`` over the rounds, ``aim``, and ``met``:
        whether the median reaches it; both None without an aim.
    """
    times = time_in_turn(
        {name: workload.call for name, workload in workloads.items()},
        rounds=rounds,
        after_round=progress,
    )
    speeds = {name: throughput(workload, times[name]) for name, workload in workloads.items()}
    return speeds, _ratios(workloads, times)


def _ratios(
    workloads: Mapping[str, Workload], times: Mapping[str, NDArray[np.float64]]
) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    for name, (label, above, below, aim) in RATIOS.items():
        if above in workloads and below in workloads:
            spread = speed_ratio(workloads[above], times[above], workloads[below], times[below])
            met = None if aim is None else spread.median >= aim
            found[name] = {"label": label, "ratio": spread.as_dict(), "aim": aim, "met": met}
    return found
