"""Choosing how to compute a scene: the cheapest settings of the measured front that suffice.

The study says which settings are worth a try and in which order of cost. How far off they are hangs
on the scene: so a reference is found for it, and the candidates are played one by one, the cheap
ones first, until one is as close as was asked for. That takes a few seconds.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from swim_env.accuracy.front import Measured, load_front
from swim_env.accuracy.grid import duration_for
from swim_env.accuracy.outcome import play
from swim_env.accuracy.reference import FINE, PILOT, plan_for, reference_of
from swim_env.accuracy.settings import Settings, lists_values
from swim_env.errors import SceneError, SwimError
from swim_env.scene import Scene

__all__ = ["Choice", "choose", "with_chosen_settings"]

#: Share of the tolerance that a candidate may use up; the rest is for what the reference is off.
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
        The scene with its new settings.
    settings : Settings
        The settings.
    tolerance : float
        What was asked for.
    error : float
        What was found: relative error of the displacement.
    uncertainty : float
        How far the reference itself may be off.
    cost : float
        Measured cost in units of the paper's settings on scene paper_i.
    tried : int
        Number of candidates that were played.
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
        Simulated time on which it is judged (s), the scene's own unless given; 20 s at most, as
        the error of a steady gait does not grow.
    progress : callable, optional
        Called with 1 after every run.

    Returns
    -------
    Choice
        The scene with these settings, and why.

    Raises
    ------
    SwimError
        If the scene has no converged reference, or no settings of the front are good enough.
    """
    if isinstance(tolerance, bool) or not isinstance(tolerance, (int, float)):
        raise SwimError(f"the tolerance must be a number, got {tolerance!r}")
    if not _SMALLEST <= tolerance <= _LARGEST:
        raise SwimError(
            f"the tolerance must be {_SMALLEST:g} to {_LARGEST:g}, got {tolerance!r}: smaller ones "
            "are beyond the reference, larger ones say nothing"
        )
    if not keep_elements and lists_values(scene):
        raise SwimError(
            f"scene {scene.name} lists values for every joint or element, so their number cannot "
            "be chosen; keep it (keep_elements), or give a law in s/l"
        )
    duration = duration_for(scene.episode.duration if duration is None else duration)
    candidates = _candidates(scene, keep_elements)
    if not candidates:
        raise SwimError(
            f"no settings of the measured front fit scene {scene.name}: none of their time steps "
            f"divides episode.control_interval, {scene.episode.control_interval:g} s"
        )
    reference = reference_of(scene, duration, PILOT, keep_elements, progress)
    # Where both plans are one, a second reference would be the first.
    finer = plan_for(scene, FINE) != plan_for(scene, PILOT)
    if finer and reference.uncertainty > (1.0 - _SHARE) * tolerance:
        reference = reference_of(scene, duration, FINE, keep_elements, progress)
    if reference.uncertainty > 0.5 * tolerance:
        raise SwimError(
            f"scene {scene.name} has no reference that is good enough for {tolerance:g}: what it "
            f"converges to is known to {reference.uncertainty:.1e} only"
        )
    best = math.inf
    tried = 0
    for candidate in candidates:
        try:
            outcome = play(candidate.settings.apply(scene), duration)
        except SwimError:
            continue
        tried += 1
        if progress is not None:
            progress(1)
        error = reference.error(outcome)
        best = min(best, error)
        if error <= _SHARE * tolerance:
            return _choice(
                scene,
                candidate,
                tolerance,
                error,
                reference.uncertainty,
                tried,
                duration,
                keep_elements,
            )
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


def _candidates(scene: Scene, keep_elements: bool) -> list[Measured]:
    """Return what may be tried on a scene, by cost; the steps fit the control interval."""
    seen: set[Settings] = set()
    found: list[Measured] = []
    for one in load_front():
        settings, cost = one.settings, one.cost
        if settings.solver is not None:
            continue
        if keep_elements:
            # As many panels along the body as were measured; the cost grows a little faster than
            # the number of elements.
            n = scene.beam.elements
            along = settings.elements * settings.panels_per_element
            panels = max(2, 2 * round(0.5 * along / n))
            cost *= (n / settings.elements) ** _GROWTH
            settings = replace(settings, elements=n, panels_per_element=panels)
        if scene.fluid is None or not scene.fluid.present:
            # Settings that differ in the fluid alone are the same here.
            settings = replace(settings, fluid_model="none", panels_per_element=4, cap_panels=1)
        if settings in seen:
            continue
        seen.add(settings)
        try:
            settings.apply(scene).steps_per_action  # noqa: B018
        except SceneError:
            continue
        found.append(Measured(settings, cost, one.errors))
    return sorted(found, key=lambda one: one.cost)


def _choice(
    scene: Scene,
    chosen: Measured,
    tolerance: float,
    error: float,
    uncertainty: float,
    tried: int,
    duration: float,
    keep_elements: bool,
) -> Choice:
    settings = chosen.settings
    panels = (
        ""
        if settings.fluid_model in ("none", "strip")
        else f", {settings.panels_per_element} panels an element, {settings.cap_panels} an end"
    )
    kept = " (kept)" if keep_elements else ""
    reason = (
        f"for {tolerance:g} of the displacement: fluid model {settings.fluid_model}{panels}, "
        f"{settings.elements} elements{kept}, steps of {1e3 * settings.time_step:g} ms of the "
        f"{settings.scheme} scheme; off by {error:.1e} after {duration:g} s from a reference good "
        f"to {uncertainty:.1e}, about {chosen.cost:.2g} times the cost of the paper's settings; "
        f"the {tried - 1} cheaper ones tried were further off"
    )
    return Choice(
        settings.apply(scene), settings, tolerance, error, uncertainty, chosen.cost, tried, reason
    )
