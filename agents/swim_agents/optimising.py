"""Search for the torques that are best on a scene, with the exact gradient of a whole episode.

Discrete mechanics and optimal control (Junge, Marsden & Ober-Bloebaum 2005): the steps' equations
are those of the integrator, so what is optimal is so for the discrete body, and the bounded
quasi-Newton method L-BFGS-B (Byrd et al. 1995) of SciPy does the rest. Actions are held over the
control interval and limited as an agent's are. Waves around the first two bending modes are
improved in a shorter episode, side by side; the best goes on in a whole one.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from threading import Event

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from swim_agents.optimal_gait import GOALS
from swim_env.errors import OptionError, SceneError, SimulationEndedError, SwimError
from swim_env.gradients import OBJECTIVES, Objective, value_and_gradient
from swim_env.gradients.parameters import field_of
from swim_env.gradients.tape import CutStepError
from swim_env.physics.runtime.threads import usable_threads
from swim_env.scene import Scene
from swim_env.scene.fluid import FLUID_TABLE

__all__ = ["Problem", "Result", "improve", "search_gait", "starts"]

Array = NDArray[np.float64]

#: Residuals of the steps in a search; gradients are then right to about this.
_TOLERANCE = 1e-8
#: Stiffnesses that a design may vary, by the scene's dimension, and by what factor at most.
_DESIGN = {2: ("beam.bending_stiffness",), 3: ("beam.lateral_stiffness",)}
_LARGEST_FACTOR = 4.0
#: Periods of the first mode in the episodes of the first search; twice as many where work counts,
#: of which the start takes more than its share.
_SHORT = 12
#: Guesses: frequencies as shares of the first and the second mode's, wave numbers by pi. A table
#: has some cycles, so that frequencies between whole numbers of actions are there.
_FREQUENCIES = ((0, 0.95), (0, 1.01), (1, 0.95))
_WAVE_NUMBERS = (2.5, 1.5)
_CYCLES = 3
#: By how many more panels an efficient gait has to do as well.
_MORE_PANELS = 1.5
#: Share of the time that goes into the first search.
_FIRST = 0.35
#: Weight of a displacement that is missed, of the squared share: about a per cent is missed.
_PENALTY = 400.0
#: Value of a gait on which a run ends early.
_WORST = 1e6


@dataclass(frozen=True)
class Problem:
    """What is optimised: a table of actions, and the stiffness where that is asked for.

    Attributes
    ----------
    scene : Scene
        The body and its episode.
    goal : str
        One of GOALS.
    period : int
        Actions after which the table begins again.
    actions : int
        Actions of the episode that counts.
    design : bool
        Whether the stiffness of every joint varies as well.
    at_least : float
        Displacement (BL) that an efficient gait aims at; it stays about a per cent away from it.
    finer : int
        Panels per element with which the gait has to do as well, none for 0: what is best with the
        scene's own alone is tuned to a resonance that their number has shifted.
        None without panels, and in space.
    """

    scene: Scene
    goal: str
    period: int
    actions: int
    design: bool = False
    at_least: float = 0.0
    finer: int = 0

    @property
    def fields(self) -> tuple[str, ...]:
        """The scene's fields that vary."""
        return _DESIGN[self.scene.dimension] if self.design else ()

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Least and largest value of every unknown."""
        size = self.period * self.scene.action_places.size
        largest = float(np.log(_LARGEST_FACTOR))
        joints = len(self.fields) * self.scene.joints
        return [(-1.0, 1.0)] * size + [(-largest, largest)] * joints

    def table(self, unknowns: Array) -> Array:
        """Return the actions (P, n) of a vector of unknowns."""
        size = self.period * self.scene.action_places.size
        return unknowns[:size].reshape(self.period, -1)

    def scene_of(self, unknowns: Array) -> Scene:
        """Return the scene with the stiffness of a vector of unknowns."""
        changes = {}
        scale = np.exp(unknowns[self.table(unknowns).size :]).reshape(
            len(self.fields), self.scene.joints
        )
        for name, factors in zip(self.fields, scale, strict=True):
            own = np.broadcast_to(field_of(self.scene, name), factors.shape)
            changes[name] = (own * factors).tolist()
        return self.scene.replace(changes) if changes else self.scene

    def torques(self, unknowns: Array) -> Array:
        """Return the torques (T, ...) of every step of the episode (N m)."""
        scene = self.scene
        rows = self.table(unknowns)[np.arange(self.actions) % self.period]
        flat = np.zeros((self.actions, scene.joints * (1 if scene.dimension == 2 else 3)))
        flat[:, scene.action_places] = rows * scene.action_torques
        held = np.repeat(flat, scene.steps_per_action, axis=0)
        return held if scene.dimension == 2 else held.reshape(len(held), scene.joints, 3)

    def evaluate(self, unknowns: Array, objective: Objective) -> tuple[float, Array]:
        """Return an objective and its gradient by the unknowns, their means if some are finer."""
        scene = self.scene_of(unknowns)
        if not self.finer:
            return self._evaluate(unknowns, objective, scene)
        scenes = (scene, scene.replace("fluid.panels_per_element", self.finer))
        with ThreadPoolExecutor(min(len(scenes), usable_threads())) as pool:
            found = pool.map(partial(self._evaluate, unknowns, objective), scenes)
            values, slopes = zip(*found, strict=True)
        return float(np.mean(values)), np.mean(slopes, axis=0)

    def _evaluate(self, unknowns: Array, objective: Objective, scene: Scene) -> tuple[float, Array]:
        """Return an objective and its gradient by the unknowns on one scene."""
        value, by = value_and_gradient(
            scene,
            self.torques(unknowns),
            objective,
            ("torques", *self.fields),
            tolerance=_TOLERANCE,
        )
        rows = by["torques"].reshape(self.actions, scene.steps_per_action, -1).sum(axis=1)
        found = np.zeros((self.period, scene.action_places.size))
        places = np.arange(self.actions) % self.period
        np.add.at(found, places, rows[:, scene.action_places] * scene.action_torques)
        parts = [found.ravel()]
        for name in self.fields:
            parts.append(by[name] * np.array(field_of(scene, name)))
        return value, np.concatenate(parts)

    def objective(self) -> Objective:
        """Return what is minimised."""
        if self.goal != "efficiency":
            own = OBJECTIVES[self.goal]
            return Objective(own.measures, lambda sums: (-float(sums[0]), [-1.0]))

        def combine(sums: Array) -> tuple[float, list[float]]:
            moved, spent = sums
            # The share of the displacement that is missed or too much, beside a work that counts in
            # shares of itself. More would only cost work; and with finer panels it is to be as far.
            missed = 1.0 - moved / self.at_least
            value = np.log(max(spent, 1e-300)) + 0.5 * _PENALTY * missed**2
            slope = -_PENALTY * missed / self.at_least
            return float(value), [slope, 1.0 / max(spent, 1e-300)]

        return Objective(OBJECTIVES["efficiency"].measures, combine)


@dataclass
class Result:
    """The best unknowns so far, and what was spent on them."""

    unknowns: Array
    value: float = np.inf
    evaluations: int = 0
    done: bool = False


def starts(problem: Problem, frequencies: Sequence[float], seed: int) -> list[tuple[int, Array]]:
    """Return periods (actions) and unknowns of waves around two modes (Hz), best guesses first."""
    scene, random = problem.scene, np.random.default_rng(seed)
    interval = scene.episode.control_interval
    axes = scene.action_places.size // scene.joints
    found = []
    for wave_number in _WAVE_NUMBERS:
        for mode, share in _FREQUENCIES:
            hertz = share * frequencies[min(mode, len(frequencies) - 1)]
            period = max(2, round(_CYCLES / (hertz * interval)))
            phase = 2.0 * np.pi * _CYCLES * np.arange(period)[:, None] / period
            place = np.pi * wave_number * np.repeat(scene.beam.joint_fractions, axes)
            table = 0.9 * np.cos(phase - place)
            # Without the symmetry of a wave, a turn has a slope to follow.
            table += 0.02 * random.standard_normal(table.shape)
            if problem.goal == "turn":
                table += 0.2
            stiffness = np.zeros(len(problem.fields) * scene.joints)
            found.append((period, np.concatenate([np.clip(table, -1, 1).ravel(), stiffness])))
    return found


def improve(
    problem: Problem,
    result: Result,
    seconds: float,
    keep: Callable[[Result], object] | None = None,
    progress: Callable[[float], object] | None = None,
    stop: Event | None = None,
) -> Result:
    """Improve unknowns for so many seconds or until nothing is gained; returns the best.

    A gait on which the run ends early counts as the worst there is. Another thread can end the
    search by setting `stop`.
    """
    objective = problem.objective()
    best = Result(result.unknowns.copy(), evaluations=result.evaluations)
    last = time.perf_counter()
    until = last + seconds

    def cost(unknowns: Array) -> tuple[float, Array]:
        nonlocal last
        if last > until or (stop is not None and stop.is_set()):
            raise _OutOfTime
        best.evaluations += 1
        try:
            value, slope = problem.evaluate(unknowns, objective)
        except (SimulationEndedError, CutStepError):
            # The line search takes a shorter step.
            value, slope = _WORST, np.zeros_like(unknowns)
        now = time.perf_counter()
        if progress is not None:
            progress(now - last)
        last = now
        if value < min(best.value, _WORST):
            best.value, best.unknowns = value, unknowns.copy()
            if keep is not None:
                keep(best)
        return value, slope

    options = {"maxcor": 20, "maxls": 12, "maxiter": 100_000, "maxfun": 100_000}
    with contextlib.suppress(_OutOfTime):
        minimize(
            *(cost, best.unknowns),
            **{"jac": True, "method": "L-BFGS-B", "bounds": problem.bounds, "options": options},
        )
    return best


def _more_panels(scene: Scene) -> int:
    """Return more panels per element than a scene in the plane has, 0 where it has none."""
    fluid = scene.fluid
    if scene.dimension == 3 or fluid is None or not FLUID_TABLE[fluid.model].panels:
        return 0
    return math.ceil(_MORE_PANELS * fluid.panels_per_element)


class _OutOfTime(Exception):
    """The time for a search is over."""


def search_gait(
    scene: Scene,
    goal: str,
    frequencies: Sequence[float],
    *,
    seconds: float,
    design: bool = False,
    free: bool = False,
    at_least: float = 0.0,
    seed: int = 0,
    known: dict[int, tuple[int, Result]] | None = None,
    keep: Callable[[int, int, Result], object] | None = None,
    progress: Callable[[float], object] | None = None,
) -> tuple[Problem, Result]:
    """Return the best gait that was found, and the problem that it solves.

    Parameters
    ----------
    scene : Scene
        What is to swim.
    goal : str
        One of GOALS.
    frequencies : sequence of float
        Its first natural frequencies (Hz), two if it has so many; see `natural_frequencies`.
    seconds : float
        Time to spend, a third of it on guesses side by side.
    design, at_least
        As of `Problem`.
    free : bool
        Whether torques need not repeat: they are then improved further, action by action.
    seed : int
        Of what is random in the guesses.
    known : dict, optional
        What an interrupted search found: periods and results by the number of the guess, -1 for
        the whole episode.
    keep, progress : callable, optional
        Called with a guess's number, its period and its result whenever there is a better one, and
        with seconds that have passed.

    Raises
    ------
    OptionError
        If there is no such goal, or no displacement to reach.
    SwimError
        If no guess swims.
    """
    if goal not in GOALS:
        raise OptionError(f"a gait is optimal for {', '.join(GOALS)}, got {goal!r}")
    if goal == "efficiency" and not at_least > 0.0:
        raise OptionError("an efficient gait needs the displacement that it must reach (BL)")
    if goal == "turn" and scene.dimension == 3:
        raise SceneError("the turn that is optimised is one in the plane")
    for name in _DESIGN[scene.dimension] if design else ():
        if not isinstance(field_of(scene, name), (float, tuple)):
            raise SceneError(f"a design needs numbers, one or one per joint, as {name}")
    whole = scene.actions_per_episode
    periods, finer = _SHORT, 0
    if goal == "efficiency":
        periods, finer = 2 * _SHORT, _more_panels(scene)
    short = min(whole, round(periods / (frequencies[0] * scene.episode.control_interval)))
    found = dict(known or {})
    guesses = starts(Problem(scene, goal, 1, short, design), frequencies, seed)
    # Of a problem with two numbers of panels each guess takes two threads.
    threads = min(max(1, usable_threads() // (2 if finer else 1)), len(guesses))
    each = _FIRST * seconds / -(-len(guesses) // threads)
    stop = Event()

    def first(number: int) -> None:
        period, unknowns = guesses[number]
        if stop.is_set() or (number in found and found[number][1].done):
            return
        given = found[number][1] if number in found else Result(unknowns)
        share = at_least * short / whole
        problem = Problem(scene, goal, period, short, design, share, finer)
        one = improve(
            problem,
            given,
            each,
            None if keep is None else lambda result: keep(number, period, result),
            None if progress is None else lambda passed: progress(passed / threads),
            stop,
        )
        if stop.is_set():
            return
        one.done = True
        found[number] = period, one
        if keep is not None and np.isfinite(one.value):
            keep(number, period, one)

    if -1 not in found:
        with ThreadPoolExecutor(threads) as pool:
            try:
                list(pool.map(first, range(len(guesses))))
            except BaseException:  # Ctrl-C as well: the guesses under way end, none is begun
                stop.set()
                raise
        number = min(range(len(guesses)), key=lambda one: found[one][1].value)
        period, best = found[number]
        if not np.isfinite(best.value):
            raise SwimError(f"none of {len(guesses)} guesses swims on scene {scene.name}")
        found[-1] = period, Result(best.unknowns)
    period, given = found[-1]
    problem = Problem(scene, goal, period, whole, design, at_least, finer)
    rest = (1.0 - _FIRST) * seconds

    def keep_whole(result: Result) -> None:
        if keep is not None:
            keep(-1, problem.period, result)

    if free and period != whole:
        result = improve(problem, given, 0.4 * rest, keep_whole, progress)
        table = problem.table(result.unknowns)
        rows = table[np.arange(whole) % period]
        unknowns = np.concatenate([rows.ravel(), result.unknowns[table.size :]])
        problem = replace(problem, period=whole)
        given = Result(unknowns)
        rest *= 0.6
    result = improve(problem, given, rest, keep_whole, progress)
    if not np.isfinite(result.value):
        raise SwimError(f"the best guess on scene {scene.name} does not last a whole episode")
    return problem, result
