"""One run of the study: made by the kernels or by one of SciPy's solvers, and timed."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from swim_env.accuracy.outcome import Outcome, compared_figures, play
from swim_env.accuracy.settings import PAPER_SETTINGS, Settings
from swim_env.analysis.continuous import METHODS, integrate
from swim_env.scene import Scene, load_scene
from swim_env.sim.simulator import Simulator

#: A line of ``runs.jsonl``: the settings' fields beside what was found with them. Where the scheme
#: is one of SciPy's solvers, the tolerance is the solver's relative one.
Run = Mapping[str, Any]

#: A run that takes less than this (s) is timed this often, the fastest counts.
_SHORT, _REPEATS = 0.3, 3
#: A solver's absolute tolerance in units of its relative one: what moves is of order 0.01 to 1.
_ABSOLUTE = 1e-2


def solver_of(settings: Settings) -> str | None:
    """Return the solver of SciPy that a scheme names; None for a scheme of the kernels."""
    return settings.scheme if settings.scheme in METHODS else None


def label_of(settings: Settings) -> str:
    """Return `Settings.label`, with the tolerance in place of a solver's steps."""
    if solver_of(settings) is None:
        return settings.label
    discretisation = " ".join(settings.label.split()[:2])
    return f"{discretisation} {settings.scheme} rtol {settings.tolerance:g}"


def scene_with(settings: Settings, scene: Scene) -> Scene:
    """Return a scene with settings; with a solver's it keeps its integrator but for the step."""
    if solver_of(settings) is not None:
        own = scene.integrator
        settings = replace(settings, scheme=own.scheme, tolerance=own.tolerance)
    return settings.apply(scene)


def solve(scene: Scene, duration: float, method: str, tolerance: float) -> Outcome:
    """Solve a scene's equations in continuous time for a duration (s); return what is compared.

    The method is one of `swim_env.analysis.continuous.METHODS`, whose errors come through; its
    absolute tolerance is a hundredth of the relative one.
    """
    run = integrate(scene, duration, method, tolerance, _ABSOLUTE * tolerance)
    bends = float(np.abs(run.coordinates[:, 3:]).max(initial=0.0))
    figures = compared_figures(scene, run.time, run.path, run.energy, duration)
    return Outcome(*figures, bends, len(run.time) - 1, run.seconds, 0, "", run.evaluations)


class Yardstick:
    """The paper's settings on scene paper_i, timed whenever something is compared with them."""

    def __init__(self, steps: int = 200) -> None:
        self._simulator = Simulator(PAPER_SETTINGS.apply(load_scene("paper_i")))
        self._torques = self._simulator.prescribed_torques(steps)
        self._duration = steps * self._simulator.time_step
        self.seconds()

    def seconds(self) -> float:
        """Return the wall time of a simulated second (s), the fastest of three."""
        times = []
        for _ in range(3):
            self._simulator.reset()
            start = time.perf_counter()
            self._simulator.rollout(self._torques)
            times.append(time.perf_counter() - start)
        return min(times) / self._duration


def timed_run(
    settings: Settings, scene: Scene, duration: float, yardstick: Yardstick
) -> tuple[Outcome, float, float]:
    """Play a scene with settings, by the kernels or by a solver, and time it.

    Returns what is compared, the wall time of a simulated second (s), and its ratio to the
    yardstick's, the smallest of three for short runs: other programs only ever add to a time.
    """
    solver, scene = solver_of(settings), scene_with(settings, scene)
    found = []
    for _ in range(_REPEATS):
        before = yardstick.seconds()
        if solver is None:
            outcome = play(scene, duration)
        else:
            outcome = solve(scene, duration, solver, settings.tolerance)
        yard = min(before, yardstick.seconds())
        each = outcome.seconds / max(outcome.steps * scene.integrator.time_step, 1e-12)
        found.append((each / yard, each))
        if outcome.seconds > _SHORT:
            break
    cost, each = min(found)
    return outcome, each, cost
