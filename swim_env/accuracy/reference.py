r"""A converged reference for one scene, with an error bar, put together from single refinements.

Refining everything at once is out of reach: an outline of 27 elements with 48 panels each takes
minutes for a second. But the errors of elements, panels, time step and fluid model are small and
add up, so each is removed where it is cheap to compute,

.. math::
    X = X_{N \to \infty} + \delta_{panels} + \delta_{dt} + \delta_{model},

with the frozen added mass, whose panels are free, for all but the last: what the panels' added mass
changes is taken from a coarser body. Every part is extrapolated with its order: 2 in 1/N (1 for the
energy, whose sum over joints is a quadrature without its ends), 2 in the step of the composed
scheme, and in the panels what three counts show: corners leave no whole one (the added mass
converges like M^-0.3 to M^-0.6). Its error bar is half of what its last extrapolation added, or how
far two of them are apart.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from swim_env.accuracy.outcome import SAMPLES, Outcome, play, relative_error
from swim_env.accuracy.settings import Settings, even, pace_of
from swim_env.errors import SwimError
from swim_env.scene import Scene, require_planar

__all__ = ["FINE", "PILOT", "Reference", "Refinements", "plan_for", "reference_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Refinements:
    """How far a reference goes."""

    #: Three increasing numbers of elements N, and the panels along the body at each of them. N is
    #: odd, so that what changes in the middle of the body does so between two joints.
    elements: tuple[int, int, int]
    panels: int
    #: At which panels, time step and model are refined.
    coarse_elements: int
    #: In s of the front, see `pace_of`; it is halved once.
    time_step: float
    #: Panels per element, one or two of them, with which the models are compared.
    model_panels: tuple[int, ...]


#: For the study, and for choosing settings.
FINE = Refinements((17, 27, 37), 432, 9, 0.0025, (4, 8))
PILOT = Refinements((9, 17, 27), 216, 9, 0.005, (4,))
#: Where the model cannot be frozen, every step solves the panels.
_WITH_PANELS = Refinements((3, 5, 15), 30, 5, 0.01, (4,))

#: A frozen added mass that is further off than this share cannot carry the other parts.
_TOO_BENT = 0.2
#: Differences of successive panel counts, each twice the one before, shrink by a factor in between.
_SLOWEST, _FASTEST = 0.85, 0.3
#: Share of what a fluid model changes that stays uncertain: one comparison on a coarse body is
#: about right, no more.
_OF_ONE_MODEL = 0.15
#: Place of the energy in `Outcome.values`.
_ENERGY = 2


@dataclass(frozen=True, eq=False)
class Reference:
    """What a scene's run converges to.

    Attributes
    ----------
    displacement, path, energy, length
        As in `Outcome`, and the body's length (m).
    uncertainty, path_uncertainty, energy_uncertainty : float
        Error bars, relative as `error` is: of the displacement, of the path to its extent, and of
        the energy.
    parts : dict of str to float
        Parts of the displacement's error bar: elements, time_step, panels, model.
    """

    displacement: Array
    path: Array
    energy: float
    length: float
    uncertainty: float
    path_uncertainty: float
    energy_uncertainty: float
    parts: dict[str, float]

    def error(self, outcome: Outcome) -> float:
        """Return the relative error of a run's displacement; infinite if it ended early."""
        if outcome.termination_reason:
            return np.inf
        return relative_error(outcome.displacement, self.displacement, self.length)


def plan_for(scene: Scene, refinements: Refinements) -> Refinements:
    """Return the refinements that a scene really gets: fewer if its model cannot be frozen."""
    return _WITH_PANELS if scene.has_fluid and scene.axial_added_mass is not None else refinements


def reference_of(
    scene: Scene,
    duration: float,
    refinements: Refinements = FINE,
    keep_elements: bool = False,
    progress: Callable[[int], object] | None = None,
) -> Reference:
    """Find what a scene's displacement, path and energy converge to.

    Parameters
    ----------
    scene, duration, refinements
        The scene, whose own settings do not matter, its simulated time (s), and how far to go.
    keep_elements : bool
        Whether the number of elements belongs to the scene: then the reference has as many.
    progress : callable, optional
        Called with 1 after every run; there are at most 11.

    Raises
    ------
    SwimError
        If one of the fine runs ends early, or the body bends too far for a frozen added mass.
    """
    require_planar(scene, "a reference")
    plan = plan_for(scene, refinements)
    plan = replace(plan, time_step=pace_of(scene) * plan.time_step)
    runs = _Runs(scene, duration, progress or (lambda _: None))
    model = "frozen" if scene.has_fluid and scene.axial_added_mass is None else "panels"
    coarse = scene.beam.elements if keep_elements else plan.coarse_elements
    parts: dict[str, Array] = {}
    if keep_elements:
        total = runs(model, coarse, plan.panels, plan.time_step)
    else:
        total, parts["elements"] = _elements(runs, model, plan)
    step = [runs(model, coarse, plan.panels, plan.time_step / n) for n in (1, 2)]
    change = (step[1] - step[0]) * 4.0 / 3.0
    total, parts["time_step"] = total + change, 0.5 * change
    if scene.has_fluid:
        change, parts["panels"] = _panels(runs, model, coarse, plan)
        total = total + change
    if model == "frozen":
        change, parts["model"] = _model(runs, coarse, plan)
        total = total + change
    displacement, path, energy = total[:2], total[3:].reshape(SAMPLES + 1, 2), float(total[_ENERGY])
    length = scene.beam.length
    extent = max(_largest(path), 0.01 * length)
    shares = {
        name: relative_error(displacement + part[:2], displacement, length)
        for name, part in parts.items()
    }
    of_path = [_largest(part[3:].reshape(-1, 2)) / extent for part in parts.values()]
    of_energy = [abs(float(part[_ENERGY])) / max(abs(energy), 1e-300) for part in parts.values()]
    every = (list(shares.values()), of_path, of_energy)
    bar, path_bar, energy_bar = (float(np.linalg.norm(some)) for some in every)
    return Reference(displacement, path, energy, length, bar, path_bar, energy_bar, shares)


@dataclass
class _Runs:
    """The runs of one reference, each of which is made once."""

    scene: Scene
    duration: float
    progress: Callable[[int], object]
    known: dict[Settings, Array] = field(default_factory=dict)

    def __call__(self, model: str, elements: int, panels: int, time_step: float) -> Array:
        """Return `Outcome.values` with so many panels along the body."""
        per_element = even(panels / elements)
        settings = Settings(model, elements, per_element, "proportional", time_step, "composed")
        if settings not in self.known:
            outcome = play(settings.apply(self.scene), self.duration)
            if outcome.termination_reason:
                raise SwimError(
                    f"scene {self.scene.name} has no converged reference: the run with "
                    f"{settings.label} ended with {outcome.termination_reason}; damping, a smaller "
                    "drive or a shorter run may help"
                )
            self.known[settings] = outcome.values
            self.progress(1)
        return self.known[settings]


def _elements(runs: _Runs, model: str, plan: Refinements) -> tuple[Array, Array]:
    """Extrapolate to infinitely many elements, twice; return the limit and its error bar."""
    counts = plan.elements
    found = [runs(model, n, plan.panels, plan.time_step) for n in counts]

    def limit(i: int) -> Array:
        few, many = counts[i], counts[i + 1]
        change = found[i + 1] - found[i]
        value: Array = found[i + 1] + change * few**2 / (many**2 - few**2)
        value[_ENERGY] = found[i + 1][_ENERGY] + change[_ENERGY] * few / (many - few)
        return value

    return limit(1), limit(1) - limit(0)


def _panels(runs: _Runs, model: str, elements: int, plan: Refinements) -> tuple[Array, Array]:
    """Extrapolate to infinitely many panels from three counts, each twice the one before."""
    # Twice the panels on every element, whatever their number is rounded to.
    each = even(plan.panels / elements)
    found = [runs(model, elements, n * each * elements, plan.time_step) for n in (1, 2, 4)]
    first, second = found[1] - found[0], found[2] - found[1]
    # How differences shrink, from the displacement; all else follows the same added mass.
    length = float(first[:2] @ first[:2])
    ratio = float(first[:2] @ second[:2]) / length if length > 0.0 else _FASTEST
    ratio = min(max(ratio, _FASTEST), _SLOWEST)
    rest = second * ratio / (1.0 - ratio)
    return found[2] + rest - found[0], 0.5 * rest


def _model(runs: _Runs, elements: int, plan: Refinements) -> tuple[Array, Array]:
    """Return what the panels' added mass changes, and its error bar."""
    changes = []
    for panels in plan.model_panels:
        usual = (elements, panels * elements, 2.0 * plan.time_step)
        full, frozen = runs("panels", *usual), runs("frozen", *usual)
        changes.append(full - frozen)
        size = relative_error(frozen[:2], full[:2], runs.scene.beam.length)
        if size > _TOO_BENT:
            raise SwimError(
                f"scene {runs.scene.name} bends too far for a converged reference: the "
                f"straight body's added mass is {size:.0%} off in displacement"
            )
    spread = changes[-1] - changes[0] if len(changes) > 1 else 0.0 * changes[0]
    return changes[-1], np.abs(spread) + _OF_ONE_MODEL * np.abs(changes[-1])


def _largest(path: Array) -> float:
    """Return the largest distance (m) of a path (T, 2) from the origin."""
    return float(np.hypot(*path.T).max(initial=0.0))
