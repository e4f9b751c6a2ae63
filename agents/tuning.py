"""The tuned wave: the travelling wave of torque that swims farthest, by global search.

The search runs in the environment itself, with torques held over the control interval and no
start noise. A grid over frequency and wave number, wide enough for the first two bending
resonances and both directions of travel, shows where the good waves are; differential evolution
goes on from there in amplitude, frequency, wave number and phase. What it finds counts only if the
trust check of `agents.verification` confirms it, so candidates are checked from the best one down.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SwimError
from swim_env.scene import Actuation, Scene
from swim_env.vector_env import SwimVectorEnv

__all__ = ["TUNED_WAVE_FILE", "load_tuned_wave", "net_displacements", "search_wave"]

Array = NDArray[np.float64]

#: Where the result and the record of the search are kept.
TUNED_WAVE_FILE = Path(__file__).with_name("tuned_wave.json")

#: Bounds of the search: share of the torque limit, Hz, rad per body length, rad.
BOUNDS = {
    "amplitude": (0.1, 1.0),
    "frequency_hz": (0.25, 20.0),
    "wave_number": (-4.0 * math.pi, 4.0 * math.pi),
    "phase": (0.0, 2.0 * math.pi),
}
_BATCH = 32


@cache
def load_tuned_wave() -> dict[str, Any]:
    """Return the stored result of the search; ``wave`` holds the fields of an `Actuation`.

    Raises
    ------
    SwimError
        If the file is missing or damaged.
    """
    try:
        data = json.loads(TUNED_WAVE_FILE.read_text(encoding="utf-8"))
        wave = {name: float(data["wave"][name]) for name in _FIELDS}
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise SwimError(
            f"cannot read the tuned wave ({TUNED_WAVE_FILE.name}): {error!r}; "
            "scripts/tune_wave.py makes it anew"
        ) from None
    return {**data, "wave": wave}


_FIELDS = ("amplitude", "frequency", "wave_number", "phase")


def net_displacements(
    scene: Scene,
    waves: Sequence[Actuation],
    progress: Callable[[int], object] | None = None,
) -> Array:
    """Play waves in the batched environment, without start noise.

    Parameters
    ----------
    scene : Scene
        What swims.
    waves : sequence of Actuation
        What drives it.
    progress : callable, optional
        Called with the number of waves played since the last call.

    Returns
    -------
    (len(waves),) array
        Net displacement along the scene's heading over an episode (BL); NaN where the episode
        ended before its time.
    """
    reached = np.full(len(waves), np.nan)
    times = np.arange(scene.actions_per_episode) * scene.episode.control_interval
    for first in range(0, len(waves), _BATCH):
        some = waves[first : first + _BATCH]
        env = SwimVectorEnv(len(some), scene)
        env.reset(options={"noise": 0.0})
        torques = np.stack([wave.torques(times, scene.beam) for wave in some])
        ended = np.zeros(len(some), dtype=np.bool_)
        for n in range(len(times)):
            *_, terminated, truncated, infos = env.step(torques[:, n] / scene.torque_limit)
            done = truncated & ~terminated & ~ended
            reached[first : first + len(some)][done] = infos["progress"][done]
            ended |= terminated
        if progress is not None:
            progress(len(some))
    return reached


def _wave(scene: Scene, numbers: Sequence[float]) -> Actuation:
    share, hertz, wave_number, phase = (float(x) for x in numbers)
    return replace(
        scene.actuation or Actuation(amplitude=1.0),
        amplitude=share * scene.torque_limit,
        frequency=2.0 * math.pi * hertz,
        wave_number=wave_number,
        phase=phase,
        end_time=None,
    )


def search_wave(
    scene: Scene,
    frequencies: int = 40,
    wave_numbers: int = 17,
    generations: int = 20,
    population: int = 32,
    seed: int = 0,
    progress: Callable[[int], object] | None = None,
) -> dict[str, Any]:
    """Search for the wave with the largest net displacement.

    Parameters
    ----------
    scene : Scene
        What swims.
    frequencies, wave_numbers : int
        Size of the grid.
    generations, population : int
        Of the differential evolution (Storn & Price 1997), whose first population is the best of
        the grid, spread over amplitudes and phases.
    seed : int
        Of the differential evolution.
    progress : callable, optional
        Called with the number of waves played since the last call.

    Returns
    -------
    dict
        ``bounds``, ``grid`` (axes and net displacements in BL), ``evolution`` (settings, the best
        of every generation) and ``candidates``: distinct waves, the best first, each with its
        ``share`` of the torque limit, ``frequency_hz``, ``wave_number``, ``phase`` and
        ``net_displacement``.
    """
    from scipy.optimize import differential_evolution

    low, high = np.array(list(BOUNDS.values())).T
    hertz = np.linspace(high[1] / frequencies, high[1], frequencies)
    kappa = np.linspace(low[2], high[2], wave_numbers)
    grid: list[tuple[float, ...]] = [(1.0, float(f), float(k), 0.0) for f in hertz for k in kappa]
    seen = dict(zip(grid, _values(scene, grid, progress), strict=True))
    landscape = np.array(list(seen.values())).reshape(frequencies, wave_numbers)

    random = np.random.default_rng(seed)
    best = sorted(seen, key=lambda point: -seen[point])[: population // 2]
    first = random.uniform(low, high, (population, 4))
    first[: len(best)] = best
    history: list[float] = []

    def objective(points: Array) -> Array:
        asked = [tuple(float(x) for x in point) for point in np.atleast_2d(points.T)]
        values = _values(scene, asked, progress)
        seen.update(zip(asked, values, strict=True))
        history.append(max(seen.values()))
        return -np.array(values)

    differential_evolution(
        objective,
        list(zip(low, high, strict=True)),
        init=first,
        maxiter=generations,
        tol=0.0,
        mutation=(0.4, 0.9),
        recombination=0.8,
        polish=False,
        updating="deferred",
        vectorized=True,
        rng=random,
    )
    ranked = sorted(seen, key=lambda point: -seen[point])
    return {
        "bounds": {name: list(bounds) for name, bounds in BOUNDS.items()},
        "grid": {
            "frequency_hz": hertz.tolist(),
            "wave_number": kappa.tolist(),
            "net_displacement": [[round(x, 6) for x in row] for row in landscape.tolist()],
        },
        "evolution": {
            "seed": seed,
            "population": population,
            "generations": generations,
            "best_of_generation": history,
        },
        "evaluations": len(seen),
        "candidates": [
            {
                **dict(zip(("share", "frequency_hz", "wave_number", "phase"), point, strict=True)),
                "net_displacement": seen[point],
            }
            for point in ranked[:20]
        ],
    }


def _values(
    scene: Scene, points: Sequence[tuple[float, ...]], progress: Callable[[int], object] | None
) -> list[float]:
    """Return net displacements; an episode that ended early counts as less than standing still."""
    waves = [_wave(scene, point) for point in points]
    reached = net_displacements(scene, waves, progress)
    return [-1.0 if math.isnan(value) else float(value) for value in reached]


def wave_fields(scene: Scene, candidate: dict[str, float]) -> dict[str, float]:
    """Return a candidate as the fields of an `Actuation`, in SI units."""
    names = ("share", "frequency_hz", "wave_number", "phase")
    wave = _wave(scene, [candidate[name] for name in names])
    return {name: float(getattr(wave, name)) for name in _FIELDS}
