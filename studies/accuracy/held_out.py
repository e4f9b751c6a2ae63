"""The judgement of a choice: on scenes that the study has not seen, against finer runs.

One judge is the study's reference, put together from single refinements; the other is one run with
everything fine at once, without any splitting and extrapolation, which is less exact.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from studies.benchmark.timing import ratio, time_in_turn
from swim_env.accuracy.choice import choose
from swim_env.accuracy.grid import Case
from swim_env.accuracy.outcome import Outcome, play, relative_error
from swim_env.accuracy.reference import FINE, Reference, reference_of
from swim_env.accuracy.settings import Settings
from swim_env.errors import SwimError
from swim_env.scene import Scene
from swim_env.sim.simulator import Simulator

__all__ = ["DIRECT", "direct_run", "judge", "judge_case"]

#: The direct run: panels weighed at every step; half a minute for 20 s.
DIRECT = Settings("panels", 27, 8, "proportional", 0.005, "composed")

_ROUNDS = 7
#: A timed run takes about this long (s).
_TIMED = 0.05


def judge(
    cases: Iterable[Case],
    tolerances: Iterable[float],
    grid: list[Settings],
    progress: Callable[[int], object] | None = None,
) -> list[dict[str, Any]]:
    """Judge choices on several scenes and tolerances.

    Parameters
    ----------
    cases : iterable of Case
        The scenes.
    tolerances : iterable of float
        What is asked for.
    grid : list of Settings
        Among which the best one is looked for by hand.
    progress : callable, optional
        Called with 1 after the direct run and after every tolerance of every scene.

    Returns
    -------
    list of dict
        See `judge_case`.
    """
    wanted = tuple(tolerances)
    found = []
    for case in cases:
        reference = reference_of(case.scene, case.duration, FINE)
        direct = direct_run(case)
        _advance(progress)
        for tolerance in wanted:
            found.append(judge_case(case, tolerance, reference, direct, grid))
            _advance(progress)
    return found


def direct_run(case: Case) -> Outcome | None:
    """Return the run of a scene with `DIRECT` settings, None where it does not come to its end."""
    try:
        outcome = play(DIRECT.apply(case.scene), case.duration)
    except SwimError:
        return None
    return None if outcome.termination_reason else outcome


def judge_case(
    case: Case,
    tolerance: float,
    reference: Reference,
    direct: Outcome | None,
    grid: list[Settings],
) -> dict[str, Any]:
    """Judge the choice for one scene and tolerance.

    Parameters
    ----------
    case : Case
        The scene.
    tolerance : float
        What is asked for.
    reference : Reference
        The fine reference of the scene.
    direct : Outcome or None
        Its direct run; None where there is none.
    grid : list of Settings
        Among which the best one is looked for by hand.

    Returns
    -------
    dict
        ``scene``, ``tolerance``; ``chosen`` and ``best`` settings as texts, best being the fastest
        of the grid that meets the tolerance; ``error`` of the choice against the fine reference,
        its ``uncertainty``, whether it is ``met``; ``direct_error`` against the direct run, whether
        that is within the tolerance, ``met_direct``, and the ``reference_gap`` between the two
        judges; ``cost_ratio`` of the choice to the best, ``timed`` in turn where that is another
        one and 1 by definition where not; and ``reason`` in words. What there is not is None.
    """
    line: dict[str, Any] = {
        "scene": case.scene.name,
        "tolerance": tolerance,
        "uncertainty": reference.uncertainty,
        "chosen": None,
        "error": None,
        "met": False,
        "direct_error": None,
        "met_direct": False,
        "reference_gap": None if direct is None else reference.error(direct),
        "best": None,
        "best_error": None,
        "cost_ratio": None,
        "timed": False,
    }
    try:
        choice = choose(case.scene, tolerance)
    except SwimError as error:
        return {**line, "reason": str(error)}
    outcome = play(choice.scene, case.duration)
    found = reference.error(outcome)
    line |= {
        "chosen": choice.settings.label,
        "error": found,
        "met": found <= tolerance,
        "reason": choice.reason,
    }
    if direct is not None:
        apart = relative_error(outcome.displacement, direct.displacement, case.scene.beam.length)
        line |= {"direct_error": apart, "met_direct": apart <= tolerance}
    speed = outcome.seconds / case.duration
    others = [one for one in grid if one != choice.settings]
    best = _best_by_hand(case, tolerance, reference, others, speed)
    if best is None:
        return {**line, "best": line["chosen"], "best_error": found, "cost_ratio": 1.0}
    settings, best_error = best
    seconds = time_in_turn(
        {
            "chosen": _timed(choice.scene, speed),
            "best": _timed(settings.apply(case.scene), speed),
        },
        rounds=_ROUNDS,
    )
    return {
        **line,
        "best": settings.label,
        "best_error": best_error,
        "cost_ratio": ratio(seconds["chosen"], seconds["best"]).median,
        "timed": True,
    }


def _best_by_hand(
    case: Case, tolerance: float, reference: Reference, grid: list[Settings], at_most: float
) -> tuple[Settings, float] | None:
    """Return the fastest settings that meet the tolerance, if any is faster than the choice."""
    best: tuple[float, Settings, float] | None = None
    # A cheap time step is tried first, so that later ones need not be played to the end.
    stepped = [one for one in grid if one.solver is None]
    for settings in sorted(stepped, key=lambda one: (one.fluid_model == "panels", -one.time_step)):
        limit = at_most if best is None else best[0]
        scene = settings.apply(case.scene)
        try:
            if play(scene, 0.05 * case.duration).seconds / (0.05 * case.duration) > 1.3 * limit:
                continue
            outcome = play(scene, case.duration)
        except SwimError:
            continue
        speed = outcome.seconds / case.duration
        error = reference.error(outcome)
        if error <= tolerance and speed < limit:
            best = (speed, settings, error)
    return None if best is None else best[1:]


def _advance(progress: Callable[[int], object] | None) -> None:
    if progress is not None:
        progress(1)


def _timed(scene: Scene, speed: float) -> Callable[[], object]:
    """Return a call that plays the same simulated time of any scene."""
    simulated = float(np.clip(_TIMED / speed, 1.0, 20.0))
    simulator = Simulator(scene)
    torques = simulator.prescribed_torques(max(1, round(simulated / scene.integrator.time_step)))

    def call() -> None:
        simulator.reset()
        simulator.rollout(torques)

    return call
