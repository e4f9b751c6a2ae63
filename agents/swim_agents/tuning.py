"""Search for the travelling torque wave that swims farthest on a scene.

The search runs in the environment itself, with torques held over the control interval and no start
noise. Short episodes on a grid around the first two bending resonances and below them, for both
directions of travel, show where the good waves are; from the best of them a random search with
shrinking spread (the cross-entropy method, Rubinstein 1999) varies amplitude, frequency, wave
number and phase; and the best waves of all play whole episodes. A wave whose energy does not add up
does not count.

In space the resonances are those about the axes that the wave drives, and its amplitude is the same
share of the torque limit of each.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_agents.baselines import WavePolicy, paper_wave
from swim_agents.rollout import Rollout, play_episode, ratio
from swim_agents.tuned_wave import LATERAL, WAVE_FIELDS, check_wave, wave_of_share, wave_on
from swim_agents.verification import Progress, check_rollout, part_of
from swim_env import SwimEnv, __version__, natural_frequencies
from swim_env.envs.vector import SwimVectorEnv
from swim_env.errors import SceneError
from swim_env.files.provenance import where_and_when
from swim_env.scene import Actuation, Scene, SpatialActuation

__all__ = ["Point", "check_candidates", "net_displacements", "record_of", "search_wave"]

Array = NDArray[np.float64]
#: Share of the torque limits, frequency (Hz), wave number (rad per body length), phase (rad), and
#: the actions in the episode.
Point = tuple[float, float, float, float, int]

_CANDIDATE = ("share", "frequency_hz", "wave_number", "phase")
_BATCH = 64
#: The grid: frequencies as multiples of the first two natural ones, wave numbers by pi.
_FIRST, _SECOND = (0.25, 0.5, 0.85, 0.91, 0.97, 1.03, 1.09), (0.92, 1.0)
_WAVE_NUMBERS = (-2.0, -1.5, -1.0, 1.0, 1.5, 2.0, 3.0)
#: Periods of the first mode in an episode of the search.
_SHORT = 40
#: The best of so many waves, from which the search starts and which are played to the end.
_STARTS, _FINALISTS = 4, 8
#: Spreads of the search at its start: the frequency's as a share of itself. The wave whose share is
#: 1 is at the bound, so half of all draws are as strong as they can be.
_SPREAD = np.array([0.15, 0.03, 0.8, 0.8])
_LEAST_SHARE, _LARGEST_WAVE_NUMBER = 0.1, 4.0 * math.pi


def net_displacements(scene: Scene, waves: Sequence[Actuation]) -> Array:
    """Play waves in one batch, without start noise.

    Returns the net displacements along the scene's heading over an episode, (len(waves),) (BL); NaN
    where the episode ended early, or more of its energy is unexplained than the scene allows.
    """
    reached = np.full(len(waves), np.nan)
    ended = np.zeros(len(waves), dtype=np.bool_)
    times = np.arange(scene.actions_per_episode) * scene.episode.control_interval
    env = SwimVectorEnv(len(waves), scene)
    env.reset(options={"noise": 0.0})
    torques = np.stack([wave.torques(times, scene.beam) for wave in waves])
    for n in range(len(times)):
        *_, terminated, truncated, infos = env.step(scene.actions_of(torques[:, n]))
        done = truncated & ~terminated & ~ended
        done &= infos["energy_drift"] <= scene.integrator.energy_tolerance
        reached[done] = infos["progress"][done]
        ended |= terminated
    return reached


def _wave(scene: Scene, wave: str, numbers: Sequence[float]) -> Actuation:
    share, hertz, wave_number, phase = numbers
    fields = {"frequency": 2.0 * math.pi * hertz, "wave_number": wave_number, "phase": phase}
    return wave_on(scene, **fields, **wave_of_share(scene, wave, share))


def _frequencies(scene: Scene, wave: str) -> list[float]:
    """Return the first two natural frequencies (Hz) about the axes that a wave drives."""
    axes = check_wave(scene, wave)
    if not scene.has_period:
        raise SceneError(
            f"scene {scene.name} has joints without stiffness, and so no natural frequencies to "
            "search around"
        )
    return natural_frequencies(scene, 2, axes)


class _Search:
    """The waves that were played so far, each once."""

    def __init__(
        self,
        scene: Scene,
        wave: str,
        known: dict[Point, float],
        keep: Callable[[dict[Point, float]], object] | None,
        progress: Callable[[float], object] | None,
    ) -> None:
        self.scene, self.wave, self.known = scene, wave, known
        self._keep, self._progress = keep, progress

    def play(self, waves: Iterable[Sequence[float]], actions: int) -> list[float]:
        """Return how far waves swim in so many actions (BL), -1 for one that does not count."""
        points: list[Point] = [(*map(float, wave), actions) for wave in waves]  # type: ignore[misc]
        scene = self.scene.replace(
            "episode.duration", actions * self.scene.episode.control_interval
        )
        new = [point for point in dict.fromkeys(points) if point not in self.known]
        for first in range(0, len(new), _BATCH):
            some = new[first : first + _BATCH]
            reached = net_displacements(
                scene, [_wave(scene, self.wave, point[:4]) for point in some]
            )
            values = [-1.0 if math.isnan(value) else float(value) for value in reached]
            found = dict(zip(some, values, strict=True))
            self.known.update(found)
            if self._keep is not None:
                self._keep(found)
            if self._progress is not None:
                self._progress(len(some) * actions)
        if self._progress is not None:
            self._progress((len(points) - len(new)) * actions)
        return [self.known[point] for point in points]


def actions_to_play(
    scene: Scene,
    frequencies: int | None,
    wave_numbers: int | None,
    generations: int,
    population: int,
    wave: str = LATERAL,
) -> int:
    """Return the actions that `search_wave` plays, of all waves together."""
    grid = [len(axis) for axis in _grid(scene, frequencies, wave_numbers, wave)]
    short = (math.prod(grid) + generations * population) * _short_actions(scene, wave)
    return short + _FINALISTS * scene.actions_per_episode


def _short_actions(scene: Scene, wave: str = LATERAL) -> int:
    """Return the number of actions in an episode of the search."""
    seconds = _SHORT / _frequencies(scene, wave)[0]
    return min(scene.actions_per_episode, math.ceil(seconds / scene.episode.control_interval))


def _grid(
    scene: Scene, frequencies: int | None, wave_numbers: int | None, wave: str = LATERAL
) -> tuple[list[float], list[float]]:
    """Return the axes of the grid: Hz, and rad per body length."""
    first, *rest = _frequencies(scene, wave)
    hertz = [factor * first for factor in _FIRST] + [f * factor for f in rest for factor in _SECOND]
    kappa = [math.pi * factor for factor in _WAVE_NUMBERS]
    high = _highest(scene)
    hertz = list(dict.fromkeys(min(one, high) for one in hertz))
    if frequencies is not None:
        hertz = np.linspace(high / frequencies, high, frequencies).tolist()
    if wave_numbers is not None:
        kappa = np.linspace(-_LARGEST_WAVE_NUMBER, _LARGEST_WAVE_NUMBER, wave_numbers).tolist()
    return hertz, kappa


def _highest(scene: Scene) -> float:
    """Return the highest frequency (Hz) that is tried: four tenths of the actions' rate."""
    return 0.4 / scene.episode.control_interval


def search_wave(
    scene: Scene,
    frequencies: int | None = None,
    wave_numbers: int | None = None,
    generations: int = 5,
    population: int = 24,
    seed: int = 0,
    progress: Callable[[float], object] | None = None,
    known: dict[Point, float] | None = None,
    keep: Callable[[dict[Point, float]], object] | None = None,
    wave: str = LATERAL,
) -> dict[str, Any]:
    """Search for the wave with the largest net displacement.

    Parameters
    ----------
    frequencies, wave_numbers : int, optional
        Size of an even grid over all frequencies and wave numbers, for a picture of them; by
        default the grid lies around the body's first two natural frequencies.
    generations, population, seed : int
        Of the random search.
    progress : callable, optional
        Called with the number of actions played since the last call, of all waves together.
    known : dict, optional
        What waves have reached in a search that was interrupted (BL); they are not played again.
    keep : callable, optional
        Called with what waves have reached, batch by batch.
    wave : str
        In space, ``lateral``, ``dorsoventral``, ``helical_right`` or ``helical_left``.

    Returns
    -------
    dict
        ``wave``, ``grid`` (axes and net displacements in BL), ``generations`` (the best of each)
        and ``candidates``: distinct waves, the best first, each with its ``share`` of the torque
        limit, ``frequency_hz``, ``wave_number``, ``phase`` and ``net_displacement`` in a whole
        episode.

    Raises
    ------
    SceneError
        If joints have no stiffness, so that the body has no frequencies.
    OptionError
        If the scene has no such wave.
    """
    search = _Search(scene, wave, dict(known or {}), keep, progress)
    short = _short_actions(scene, wave)
    hertz, kappa = _grid(scene, frequencies, wave_numbers, wave)
    grid = [(1.0, f, k, 0.0) for f in hertz for k in kappa]
    reached = dict(zip(grid, search.play(grid, short), strict=True))
    landscape = np.array(list(reached.values())).reshape(len(hertz), len(kappa))

    random = np.random.default_rng(seed)
    best = np.array(sorted(reached, key=lambda wave: -reached[wave])[:_STARTS])
    centres, spread = best, _SPREAD
    history = []
    for _ in range(generations):
        drawn = centres[np.arange(population) % len(centres)]
        noise = random.standard_normal(drawn.shape) * spread
        noise[:, 1] *= drawn[:, 1]
        waves = [tuple(wave) for wave in _bounded(scene, drawn + noise).tolist()]
        reached.update(zip(waves, search.play(waves, short), strict=True))
        elite = np.array(sorted(reached, key=lambda wave: -reached[wave])[: population // 4])
        # Half of what the best ones vary by, and half of what was tried: it shrinks steadily.
        centres, spread = (
            elite[:1],
            0.5 * spread
            + 0.5 * np.minimum(spread, elite.std(axis=0) / np.array([1.0, elite[0, 1], 1.0, 1.0])),
        )
        history.append(max(reached.values()))
    periods = short * scene.episode.control_interval * _frequencies(scene, wave)[0]
    finalists = sorted(reached, key=lambda wave: -reached[wave])[:_FINALISTS]
    values = search.play(finalists, scene.actions_per_episode)
    ranked = sorted(zip(values, finalists, strict=True), reverse=True)
    return {
        "wave": wave,
        "grid": {
            "frequency_hz": hertz,
            "wave_number": kappa,
            "net_displacement": [[round(x, 6) for x in row] for row in landscape.tolist()],
        },
        "seed": seed,
        "population": population,
        "generations": history,
        "periods_in_episode": round(periods, 2),
        "evaluations": len(search.known),
        "candidates": [
            {**dict(zip(_CANDIDATE, wave, strict=True)), "net_displacement": value}
            for value, wave in ranked
        ],
    }


def _bounded(scene: Scene, waves: Array) -> Array:
    """Return waves within the bounds of the search, phases within a turn."""
    share, hertz, kappa, phase = waves.T
    high = _highest(scene)
    bounded: Array = np.stack(
        (
            np.clip(share, _LEAST_SHARE, 1.0),
            np.clip(hertz, 0.01 * high, high),
            np.clip(kappa, -_LARGEST_WAVE_NUMBER, _LARGEST_WAVE_NUMBER),
            np.mod(phase, 2.0 * math.pi),
        ),
        axis=1,
    )
    return bounded


def record_of(
    scene: Scene, found: dict[str, Any], checked: Sequence[dict[str, Any]] = ()
) -> dict[str, Any]:
    """Return what is kept of a search: the wave and how it was found.

    Parameters
    ----------
    scene : Scene
        The scene.
    found : dict
        The result of `search_wave`.
    checked : sequence of dict, optional
        The result of `check_candidates`; then the wave is the one that is verified.

    Returns
    -------
    dict
        The record: ``wave`` (what `wave_on` takes; None where no candidate can be trusted), its
        ``net_displacement`` and, where checked, ``fine_displacement`` (BL), the ``ratio`` to the
        scene's prescribed wave (None where that gets nowhere), all that was ``checked``, the
        ``search``, the scene, version, machine and commit.
    """
    best: dict[str, Any] | None = found["candidates"][0]
    if checked:
        best = checked[-1] if checked[-1]["verified"] else None
    elif best is not None:
        wave = _wave(scene, found["wave"], [best[name] for name in _CANDIDATE])
        best = {"wave": _fields(wave), "net_displacement": best["net_displacement"]}
        if best["net_displacement"] <= 0.0:
            best = None
    quiet = {"noise": 0.0}
    paper = play_episode(SwimEnv(scene), paper_wave(scene), options=quiet).net_displacement
    return {
        "wave": best and best["wave"],
        "scene": scene.name,
        "objective": "net displacement along the scene's heading over one episode (BL), torques "
        "held over the control interval, no start noise",
        "net_displacement": best and best["net_displacement"],
        "fine_displacement": best and best.get("fine_displacement"),
        "paper_wave": paper,
        "ratio": ratio(best["net_displacement"], paper) if best else None,
        "checked": list(checked),
        "version": __version__,
        **where_and_when(),
        "search": {name: value for name, value in found.items() if name != "candidates"},
        "scene_fields": scene.to_dict(),
    }


def _fields(wave: Actuation) -> dict[str, Any]:
    """Return what defines a wave."""
    found: dict[str, Any] = {name: float(getattr(wave, name)) for name in WAVE_FIELDS}
    if isinstance(wave, SpatialActuation):
        found |= {"wave": wave.wave, "pitch_amplitude": wave.pitch_amplitude}
    return found


def _play(policy: WavePolicy, scene: Scene, progress: Progress | None = None) -> Rollout:
    """Play an episode from the scene's own start."""
    return play_episode(SwimEnv(scene), policy, options={"noise": 0.0}, progress=progress)


def check_candidates(
    scene: Scene, found: dict[str, Any], progress: Callable[[float], object] | None = None
) -> list[dict[str, Any]]:
    """Verify the result of `search_wave`, from the best wave down, until one is verified.

    In space, where that takes minutes, it is the best wave alone. Returns the ``wave`` and the
    `Verification` of each. Progress counts shares of the work if all had to be checked.
    """
    candidates = found["candidates"][: 1 if scene.dimension == 3 else None]
    part = part_of(progress, 1.0 / max(1, len(candidates)))
    checked: list[dict[str, Any]] = []
    for candidate in candidates:
        wave = _wave(scene, found["wave"], [candidate[name] for name in _CANDIDATE])
        play = functools.partial(_play, WavePolicy(scene, wave))
        verification = check_rollout(play(scene), play, part)
        checked.append({"wave": _fields(wave), **verification.to_dict()})
        if verification.verified:
            if part is not None:
                part(len(candidates) - len(checked))
            break
    return checked
