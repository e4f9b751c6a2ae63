"""Global search for the travelling torque wave that swims farthest.

The search runs in the environment itself, with torques held over the control interval and no
start noise. A grid over frequency and wave number, wide enough for the first two bending
resonances of scene swimmer and both directions of travel, shows where the good waves are; from
there differential evolution varies amplitude, frequency, wave number and phase. A wave counts only
if verification of `swim_agents.verification` confirms it, so candidates are checked from the best
one down.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_agents.baselines import WavePolicy, paper_wave
from swim_agents.rollout import play_episode
from swim_agents.tuned_wave import WAVE_FIELDS, wave_on
from swim_agents.verification import fine_scene, verify_rollout
from swim_env import SwimEnv, __version__
from swim_env.envs.vector import SwimVectorEnv
from swim_env.files.provenance import where_and_when
from swim_env.scene import Actuation, Scene

__all__ = ["bounds_on", "check_candidates", "net_displacements", "search_wave"]

Array = NDArray[np.float64]

#: Periods of the search in a control interval: 0.25 to 20 Hz at 0.02 s.
_PERIODS_IN_ACTION = (0.005, 0.4)
_CANDIDATE = ("share", "frequency_hz", "wave_number", "phase")
_BATCH = 32


def bounds_on(scene: Scene) -> dict[str, tuple[float, float]]:
    """Return the bounds of the search: share of the torque limit, Hz, rad per body length, rad."""
    interval = scene.episode.control_interval
    low, high = (periods / interval for periods in _PERIODS_IN_ACTION)
    return {
        "amplitude": (0.1, 1.0),
        "frequency_hz": (low, high),
        "wave_number": (-4.0 * math.pi, 4.0 * math.pi),
        "phase": (0.0, 2.0 * math.pi),
    }


def net_displacements(
    scene: Scene, waves: Sequence[Actuation], progress: Callable[[int], object] | None = None
) -> Array:
    """Play waves in the batched environment, without start noise.

    Returns the net displacements along the scene's heading over an episode, (len(waves),) (BL); NaN
    where the episode ended early.
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
    share, hertz, wave_number, phase = numbers
    return wave_on(scene, share * scene.torque_limit, 2.0 * math.pi * hertz, wave_number, phase)


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
    frequencies, wave_numbers : int
        Size of the grid.
    generations, population, seed : int
        Of the differential evolution (Storn & Price 1997). Half of its first population is the best
        of the grid, at full amplitude and phase 0; the other half is drawn within the bounds.
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

    bounds = bounds_on(scene)
    low, high = np.array(list(bounds.values())).T
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
        "bounds": {name: list(pair) for name, pair in bounds.items()},
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
            {**dict(zip(_CANDIDATE, point, strict=True)), "net_displacement": seen[point]}
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


def check_candidates(
    scene: Scene, found: dict[str, Any], progress: Callable[[float], object] | None = None
) -> dict[str, Any]:
    """Check the result of `search_wave`, from the best wave down, until one can be trusted.

    Progress counts seconds as that of `verify_rollout`.

    Returns
    -------
    dict
        The record: ``wave`` (WAVE_FIELDS; None where no candidate can be trusted), its
        ``net_displacement`` and ``fine_displacement`` (BL), the ``ratio`` to the scene's prescribed
        wave, all that was ``checked``, the ``search``, the scene, version, machine and commit.
    """
    env, fine = SwimEnv(scene), SwimEnv(fine_scene(scene))
    quiet = {"noise": 0.0}
    paper = play_episode(env, paper_wave(scene), options=quiet).net_displacement
    checked: list[dict[str, Any]] = []
    for candidate in found["candidates"]:
        wave = _wave(scene, [candidate[name] for name in _CANDIDATE])
        policy = WavePolicy(scene, wave)
        rollout, closed_loop = (play_episode(one, policy, options=quiet) for one in (env, fine))
        verification = verify_rollout(rollout, closed_loop, progress=progress)
        fields = {name: float(getattr(wave, name)) for name in WAVE_FIELDS}
        checked.append({"wave": fields, **verification.to_dict()})
        if verification.verified:
            break
    best = checked[-1] if checked[-1]["verified"] else None
    return {
        "wave": best and best["wave"],
        "scene": scene.name,
        "objective": "net displacement along the scene's heading over one episode (BL), torques "
        "held over the control interval, no start noise",
        "net_displacement": best and best["net_displacement"],
        "fine_displacement": best and best["fine_displacement"],
        "paper_wave": paper,
        "ratio": best["net_displacement"] / paper if best and paper else None,
        "checked": checked,
        "version": __version__,
        **where_and_when(),
        "search": {name: value for name, value in found.items() if name != "candidates"},
        "scene_fields": scene.to_dict(),
    }
