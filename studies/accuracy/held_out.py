"""The judgement of a choice: on scenes that the study has not seen, against finer runs.

One judge is the study's reference, put together from single refinements; the other is one run with
everything fine at once, without any splitting and extrapolation, which is less exact.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from studies.accuracy.grid import Case
from studies.accuracy.runs import solver_of
from studies.benchmark.timing import ratio, time_in_turn
from swim_env.accuracy.choice import choose
from swim_env.accuracy.outcome import Outcome, play, relative_error
from swim_env.accuracy.reference import FINE, Reference, reference_of
from swim_env.accuracy.settings import Settings
from swim_env.errors import SwimError
from swim_env.scene import Scene
from swim_env.sim.simulator import Simulator

#: The direct run, whose panels are solved at every step; half a minute for 20 s.
DIRECT = Settings("panels", 27, 8, "proportional", 0.005, "composed")

_ROUNDS = 7
#: A timed run takes about this long (s).
_TIMED = 0.05


def judge(
    cases: Iterable[Case],
    tolerances: Iterable[float],
    grid: list[Settings],
    progress: Callable[[int], object] = lambda _: None,
) -> list[dict[str, Any]]:
    """Judge choices on several scenes and tolerances as `judge_case` does.

    `progress` is called with 1 after the direct run and after every tolerance of every scene.
    """
    wanted = tuple(tolerances)
    found = []
    for case in cases:
        reference = reference_of(case.scene, case.duration, FINE)
        direct = direct_run(case)
        progress(1)
        for tolerance in wanted:
            found.append(judge_case(case, tolerance, reference, direct, grid))
            progress(1)
    return found


def direct_run(case: Case) -> Outcome | None:
    """Return the run of a scene with `DIRECT` settings, None if it does not come to its end."""
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
    """Judge the choice for one scene and tolerance by its fine reference and its direct run.

    Returns ``scene``, ``tolerance``; ``chosen`` and ``best`` settings as texts, best being the
    fastest of the grid that meets the tolerance; ``error`` of the choice against the fine
    reference, its ``uncertainty``, whether it is ``met``; ``direct_error`` against the direct run,
    whether that is within the tolerance, ``met_direct``, and the ``reference_gap`` between the two
    judges; ``cost_ratio`` of the choice to the best, ``timed`` in turn if that is another one and 1
    by definition if not; and ``reason`` in words. What there is not is None.
    """
    line: dict[str, Any] = {
        **{"scene": case.scene.name, "tolerance": tolerance, "uncertainty": reference.uncertainty},
        **{"chosen": None, "error": None, "met": False, "direct_error": None, "met_direct": False},
        "reference_gap": None if direct is None else reference.error(direct),
        **{"best": None, "best_error": None, "cost_ratio": None, "timed": False},
    }
    try:
        choice = choose(case.scene, tolerance)
    except SwimError as error:
        return {**line, "reason": str(error)}
    outcome = play(choice.scene, case.duration)
    off, chosen = reference.error(outcome), choice.settings.label
    line |= {"chosen": chosen, "error": off, "met": off <= tolerance, "reason": choice.reason}
    if direct is not None:
        apart = relative_error(outcome.displacement, direct.displacement, case.scene.beam.length)
        line |= {"direct_error": apart, "met_direct": apart <= tolerance}
    speed = outcome.seconds / case.duration
    others = [one for one in grid if one != choice.settings]
    best = _best_by_hand(case, tolerance, reference, others, speed)
    if best is None:
        return {**line, "best": chosen, "best_error": off, "cost_ratio": 1.0}
    settings, best_error = best
    scenes = {"chosen": choice.scene, "best": settings.apply(case.scene)}
    calls = {name: _timed(scene, speed) for name, scene in scenes.items()}
    seconds = time_in_turn(calls, rounds=_ROUNDS)
    cost_ratio = ratio(seconds["chosen"], seconds["best"]).median
    found = {"best": settings.label, "best_error": best_error, "cost_ratio": cost_ratio}
    return {**line, **found, "timed": True}


def _best_by_hand(
    case: Case, tolerance: float, reference: Reference, grid: list[Settings], at_most: float
) -> tuple[Settings, float] | None:
    """Return the fastest settings that meet the tolerance, if any is faster than the choice."""
    best = None
    # Cheap time steps are tried first, so that later ones need not be played to the end.
    stepped = [one for one in grid if solver_of(one) is None]
    for settings in sorted(stepped, key=lambda one: (one.fluid_model == "panels", -one.time_step)):
        scene = settings.apply(case.scene)
        try:
            if play(scene, 0.05 * case.duration).seconds / (0.05 * case.duration) > 1.3 * at_most:
                continue
            outcome = play(scene, case.duration)
        except SwimError:
            continue
        speed = outcome.seconds / case.duration
        error = reference.error(outcome)
        if error <= tolerance and speed < at_most:
            at_most, best = speed, (settings, error)
    return best


def _timed(scene: Scene, speed: float) -> Callable[[], object]:
    """Return a call that plays the same simulated time of any scene."""
    simulated = float(np.clip(_TIMED / speed, 1.0, 20.0))
    simulator = Simulator(scene)
    torques = simulator.prescribed_torques(max(1, round(simulated / scene.integrator.time_step)))

    def call() -> None:
        simulator.reset()
        simulator.rollout(torques)

    return call
