"""Chooses how to compute a scene: the cheapest settings that meet a tolerance.

Errors depend on the scene: a reference is computed for it, and the settings of the front are played
in order of cost until one is within the tolerance. That takes a few seconds.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from swim_env.accuracy.front import load_front
from swim_env.accuracy.outcome import play
from swim_env.accuracy.reference import FINE, PILOT, plan_for, reference_of
from swim_env.accuracy.settings import (
    Settings,
    duration_for,
    even,
    pace_of,
    paces_of,
    refuse_lists,
)
from swim_env.errors import SceneError, SwimError
from swim_env.scene import Scene, require_planar
from swim_env.scene.checks import checked_option, is_number, real
from swim_env.scene.fluid import FLUID_TABLE, NO_FLUID
from swim_env.sim.replay import steps_of

__all__ = ["Choice", "choose", "with_chosen_settings"]

#: Share of the tolerance that a candidate may use up; the rest is for the reference's own error.
_SHARE = 0.7
_SMALLEST, _LARGEST = 1e-3, 0.3
#: How the cost grows with the number of elements where the fluid's inertia is constant.
_GROWTH = 1.4


@dataclass(frozen=True)
class Choice:
    """Settings for a scene, and why.

    Attributes
    ----------
    scene : Scene
        The scene with its new `settings`.
    tolerance, error, uncertainty : float
        What was asked for, the relative error of the displacement that was found, and the error bar
        of the reference.
    cost, tried
        Cost in units of the paper's settings on scene paper_i; candidates that were played.
    reason : str
        All of it in words.
    """

    scene: Scene
    settings: Settings
    tolerance: float
    error: float
    uncertainty: float
    cost: float
    tried: int
    reason: str


def choose(
    scene: Scene,
    tolerance: float,
    keep_elements: bool = False,
    duration: float | None = None,
    progress: Callable[[int], object] | None = None,
) -> Choice:
    """Choose the cheapest settings whose displacement is within a tolerance.

    Parameters
    ----------
    scene : Scene
        The scene; it is played with its prescribed torque.
    tolerance : float
        Largest |dX - dX_ref| / max(|dX_ref|, 0.01 l), with dX the displacement of the mean centre
        averaged over the last period; 0.001 to 0.3.
    keep_elements : bool
        Keep the number of elements, as an agent for so many joints needs it; the error is then that
        of a body of so many elements.
    duration : float, optional
        Simulated time on which settings are judged (s), the scene's own unless given; at most 20
        periods of the drive, as the error of a steady gait does not grow, and at most 1000 control
        intervals where there is no drive or a fiftieth of its period is longer than one.
    progress : callable, optional
        Called with 1 after every run.

    Raises
    ------
    SwimError
        If tolerance or duration cannot be used, the scene has no converged reference, or no
        settings of the front are good enough.
    """
    require_planar(scene, "a choice of settings")
    if not is_number(tolerance) or not _SMALLEST <= tolerance <= _LARGEST:
        raise SwimError(
            f"the tolerance must be {_SMALLEST:g} to {_LARGEST:g}, got {tolerance!r}: smaller ones "
            "are beyond the reference, larger ones say nothing"
        )
    tolerance = float(tolerance)
    wanted = scene.episode.duration if duration is None else duration
    wanted = checked_option(real("s", above=0.0), wanted, "the duration")
    steps_of(scene, wanted)
    if not keep_elements:
        refuse_lists(scene, "be chosen; keep it (keep_elements), or give a law in s/l")
    duration = duration_for(scene, wanted)
    candidates, problem = _candidates(scene, keep_elements)
    if not candidates:
        raise SwimError(f"no settings of the measured front fit scene {scene.name}: {problem}")
    reference = reference_of(scene, duration, PILOT, keep_elements, progress)
    # Where both plans are one, a second reference would be the first.
    finer = plan_for(scene, FINE) != plan_for(scene, PILOT)
    if finer and reference.uncertainty > (1.0 - _SHARE) * tolerance:
        reference = reference_of(scene, duration, FINE, keep_elements, progress)
    if (sure := reference.uncertainty) > 0.5 * tolerance:
        raise SwimError(
            f"scene {scene.name} has no reference that is good enough for {tolerance:g}: what it "
            f"converges to is known to {sure:.1e} only"
        )
    best, tried = math.inf, 0
    for settings, cost in candidates:
        chosen = settings.apply(scene)
        try:
            outcome = play(chosen, duration)
        except SwimError:
            continue
        tried += 1
        if progress is not None:
            progress(1)
        error = reference.error(outcome)
        best = min(best, error)
        if error <= _SHARE * tolerance:
            reason = (
                f"for {tolerance:g} of the displacement: {_words(settings, keep_elements)}; off by "
                f"{error:.1e} after {duration:g} s from a reference good to {sure:.1e}, about "
                f"{cost:.2g} times the cost of the paper's settings; the {tried - 1} cheaper ones "
                "tried were further off"
            )
            return Choice(chosen, settings, tolerance, error, sure, cost, tried, reason)
    raise SwimError(
        f"no settings of the measured front compute scene {scene.name} to within {tolerance:g}: "
        f"the best of {tried} is off by {best:.1e}"
    )


def with_chosen_settings(
    scene: Scene, tolerance: float, keep_elements: bool = False, duration: float | None = None
) -> Scene:
    """Return the scene of `choose`, what was chosen and why in its description."""
    choice = choose(scene, tolerance, keep_elements, duration)
    said = f"{scene.description} Settings chosen {choice.reason}.".strip()
    return choice.scene.replace("description", said)


def _candidates(scene: Scene, keep_elements: bool) -> tuple[list[tuple[Settings, float]], str]:
    """Return the settings that may be tried on a scene and their costs, the cheapest first.

    And why the last one that may not cannot be used.
    """
    problem = "it has none"
    found: dict[Settings, float] = {}
    pace = pace_of(scene)
    for one, slower in itertools.product(load_front(), paces_of(scene)):
        settings, cost = one.settings, one.cost * pace / slower
        settings = replace(settings, time_step=slower * settings.time_step)
        if keep_elements:
            # As many panels along the body as were measured; the cost grows a little faster than
            # the number of elements.
            n = scene.beam.elements
            panels = even(settings.elements * settings.panels_per_element / n)
            cost *= (n / settings.elements) ** _GROWTH
            settings = replace(settings, elements=n, panels_per_element=panels)
        if not scene.has_fluid:
            # Settings that differ in the fluid alone are the same here.
            settings = replace(settings, fluid_model=NO_FLUID, panels_per_element=4, cap_panels=1)
        try:
            settings.apply(scene).steps_per_action  # noqa: B018
        except SceneError as error:
            # Another model than an effect needs, or too many steps in a control interval.
            problem = error.problem
            continue
        found.setdefault(settings, cost)
    return sorted(found.items(), key=lambda pair: pair[1]), problem


def _words(settings: Settings, kept: bool) -> str:
    panels = ""
    if FLUID_TABLE[settings.fluid_model].panels:
        panels = f", {settings.panels_per_element} panels an element, {settings.cap_panels} an end"
    return (
        f"fluid model {settings.fluid_model}{panels}, {settings.elements} elements"
        f"{' (kept)' if kept else ''}, steps of {1e3 * settings.time_step:g} ms of the "
        f"{settings.scheme} scheme"
    )
