r"""A converged reference for one scene, with an error bar, put together from single refinements.

Refining everything at once is out of reach: an outline of 27 elements with 48 panels each takes
minutes a second. But the errors of elements, panels, time step and fluid model are small and add
up, so each is removed where it is cheap to compute,

.. math::
    X = X_{N \to \infty} + \delta_{panels} + \delta_{dt} + \delta_{model},

with the frozen added mass, whose panels are free, for all but the last: what the panels' added mass
changes is taken from a coarser body. Every part is extrapolated with its order: 2 in 1/N (1 for the
energy, whose sum over joints is a quadrature without its ends), 2 in the step of the composed
scheme, and in the panels what three counts show, as the outline's corners leave no whole one (the
added mass converges like M^-0.3 to M^-0.6). Every part leaves an error bar, half of what its last
extrapolation added or how far two of them are apart.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.accuracy.outcome import SAMPLES, Outcome, play, relative_error
from swim_env.accuracy.settings import Settings
from swim_env.errors import SwimError
from swim_env.scene import Scene

__all__ = ["FINE", "PILOT", "Reference", "Refinements", "plan_for", "reference_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Refinements:
    """How far a reference goes.

    Attributes
    ----------
    elements : tuple of int
        Three numbers N, increasing.
    panels : int
        Panels along the body at every N, N times the panels per element.
    coarse_elements : int
        N at which panels, time step and model are refined; odd like the others, so that what
        changes in the middle of the body does so between two joints.
    time_step : float
        The time step (s); it is halved once.
    model_panels : tuple of int
        Panels per element with which the models are compared, one or two.
    """

    elements: tuple[int, int, int]
    panels: int
    coarse_elements: int
    time_step: float
    model_panels: tuple[int, ...]


#: For the study, and for choosing settings.
FINE = Refinements((17, 27, 37), 432, 9, 0.0025, (4, 8))
PILOT = Refinements((9, 17, 27), 216, 9, 0.005, (4,))
#: Where the model cannot be frozen, every step weighs the panels.
_WITH_PANELS = Refinements((3, 5, 15), 30, 5, 0.01, (4,))

#: A frozen added mass that is further off than this share cannot carry the other parts.
_TOO_BENT = 0.2
#: Differences of successive panel counts, each twice the one before, shrink by a factor in between.
_SLOWEST, _FASTEST = 0.85, 0.3
#: What a fluid model changes hangs on how finely the body is divided; one comparison says no more
#: than that it is about right.
_OF_ONE_MODEL = 0.15
#: Where the energy stands in `Outcome.values`.
_ENERGY = 2


@dataclass(frozen=True, eq=False)
class Reference:
    """What a scene's run converges to.

    Attributes
    ----------
    displacement : (2,) array
        As in `Outcome` (m).
    path : (SAMPLES + 1, 2) array
        As in `Outcome` (m).
    energy : float
        As in `Outcome` (J).
    length : float
        Body length (m).
    uncertainty, path_uncertainty, energy_uncertainty : float
        How far displacement, path and energy may be off, on the scales of `error`, `path_error`
        and `energy_error`.
    parts : dict of str to float
        The parts of the displacement's: elements, panels, time step, model.
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
        """Return the relative error of a run's displacement; infinite where it ended early."""
        if outcome.termination_reason:
            return np.inf
        return relative_error(outcome.displacement, self.displacement, self.length)

    def path_error(self, outcome: Outcome) -> float:
        """Return the largest distance between the paths, relative to the reference's extent."""
        if outcome.termination_reason:
            return np.inf
        return _largest(outcome.path - self.path) / max(_largest(self.path), 0.01 * self.length)

    def energy_error(self, outcome: Outcome) -> float:
        """Return the relative error of the mean energy."""
        if outcome.termination_reason or self.energy == 0.0:
            return np.inf if outcome.termination_reason else abs(outcome.energy)
        return abs(outcome.energy - self.energy) / abs(self.energy)

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and lists, for JSON."""
        return {
            "displacement": self.displacement.tolist(),
            "path": self.path.tolist(),
            "energy": self.energy,
            "length": self.length,
            "uncertainty": self.uncertainty,
            "path_uncertainty": self.path_uncertainty,
            "energy_uncertainty": self.energy_uncertainty,
            "parts": self.parts,
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Reference:
        """Return what `to_dict` was made of."""
        return cls(
            np.array(data["displacement"]),
            np.array(data["path"]),
            data["energy"],
            data["length"],
            data["uncertainty"],
            data["path_uncertainty"],
            data["energy_uncertainty"],
            data["parts"],
        )


def plan_for(scene: Scene, refinements: Refinements) -> Refinements:
    """Return the refinements that a scene really gets: fewer where its model cannot be frozen."""
    with_fluid = scene.fluid is not None and scene.fluid.present
    return _WITH_PANELS if with_fluid and scene.axial_added_mass is not None else refinements


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
    scene : Scene
        The scene; how it is computed does not matter.
    duration : float
        Simulated time (s).
    refinements : Refinements
        How far to go.
    keep_elements : bool
        Whether the number of elements belongs to the scene: then the reference has as many.
    progress : callable, optional
        Called with 1 after every run; there are at most 11.

    Raises
    ------
    SwimError
        If one of the fine runs ends early.
    """
    return _Refiner(scene, duration, refinements, keep_elements, progress).reference()


class _Refiner:
    """The runs of one reference."""

    def __init__(
        self,
        scene: Scene,
        duration: float,
        refinements: Refinements,
        keep_elements: bool,
        progress: Callable[[int], object] | None,
    ) -> None:
        self._scene = scene
        self._duration = duration
        self._progress = progress
        self._keep = keep_elements
        with_fluid = scene.fluid is not None and scene.fluid.present
        self._can_freeze = with_fluid and scene.axial_added_mass is None
        self._with_fluid = with_fluid
        self._plan = plan_for(scene, refinements)
        self._known: dict[Settings, Array] = {}

    def reference(self) -> Reference:
        """Make all runs and add them up."""
        model = "frozen" if self._can_freeze else "panels"
        plan = self._plan
        coarse = self._scene.beam.elements if self._keep else plan.coarse_elements
        parts: dict[str, Array] = {}
        if self._keep:
            total = self._run(model, coarse, plan.panels, plan.time_step)
        else:
            total, parts["elements"] = self._elements(model)
        step = [self._run(model, coarse, plan.panels, plan.time_step / n) for n in (1, 2)]
        change = (step[1] - step[0]) * 4.0 / 3.0
        total, parts["time_step"] = total + change, 0.5 * change
        if self._with_fluid:
            change, parts["panels"] = self._panels(model, coarse)
            total = total + change
        if self._can_freeze:
            change, parts["model"] = self._model(coarse)
            total = total + change
        displacement, energy = total[:2], float(total[_ENERGY])
        path = total[3:].reshape(SAMPLES + 1, 2)
        length = self._scene.beam.length
        shares = {
            name: relative_error(displacement + part[:2], displacement, length)
            for name, part in parts.items()
        }
        extent = max(_largest(path), 0.01 * length)
        of_path = [_largest(part[3:].reshape(-1, 2)) / extent for part in parts.values()]
        of_energy = [
            abs(float(part[_ENERGY])) / max(abs(energy), 1e-300) for part in parts.values()
        ]
        return Reference(
            displacement,
            path,
            energy,
            length,
            float(np.linalg.norm(list(shares.values()))),
            float(np.linalg.norm(of_path)),
            float(np.linalg.norm(of_energy)),
            shares,
        )

    def _elements(self, model: str) -> tuple[Array, Array]:
        """Extrapolate to infinitely many elements, twice."""
        counts = self._plan.elements
        runs = [self._run(model, n, self._plan.panels, self._plan.time_step) for n in counts]

        def limit(i: int) -> Array:
            few, many = counts[i], counts[i + 1]
            change = runs[i + 1] - runs[i]
            value: Array = runs[i + 1] + change * few**2 / (many**2 - few**2)
            value[_ENERGY] = runs[i + 1][_ENERGY] + change[_ENERGY] * few / (many - few)
            return value

        return limit(1), limit(1) - limit(0)

    def _panels(self, model: str, elements: int) -> tuple[Array, Array]:
        """Extrapolate to infinitely many panels from three counts, each twice the one before."""
        plan = self._plan
        # Twice the panels on every element, whatever their number is rounded to.
        each = _even(plan.panels / elements)
        runs = [self._run(model, elements, n * each * elements, plan.time_step) for n in (1, 2, 4)]
        first, second = runs[1] - runs[0], runs[2] - runs[1]
        # How differences shrink, from the displacement; all else follows the same added mass.
        length = float(first[:2] @ first[:2])
        ratio = float(first[:2] @ second[:2]) / length if length > 0.0 else _FASTEST
        ratio = min(max(ratio, _FASTEST), _SLOWEST)
        rest = second * ratio / (1.0 - ratio)
        return runs[2] + rest - runs[0], 0.5 * rest

    def _model(self, elements: int) -> tuple[Array, Array]:
        """Return what the panels' added mass changes, and how sure that is."""
        changes = []
        for panels in self._plan.model_panels:
            along = panels * elements
            pair = [
                self._run(model, elements, along, 2.0 * self._plan.time_step)
                for model in ("panels", "frozen")
            ]
            changes.append(pair[0] - pair[1])
            size = relative_error(pair[1][:2], pair[0][:2], self._scene.beam.length)
            if size > _TOO_BENT:
                raise SwimError(
                    f"scene {self._scene.name} bends too far for a converged reference: the "
                    f"straight body's added mass is {size:.0%} off in displacement"
                )
        spread = changes[-1] - changes[0] if len(changes) > 1 else 0.0 * changes[0]
        return changes[-1], np.abs(spread) + _OF_ONE_MODEL * np.abs(changes[-1])

    def _run(self, model: str, elements: int, panels: int, time_step: float) -> Array:
        each = _even(panels / elements)
        settings = Settings(model, elements, each, "proportional", time_step, "composed")
        if settings not in self._known:
            outcome = play(settings.apply(self._scene), self._duration)
            if outcome.termination_reason:
                raise SwimError(
                    f"scene {self._scene.name} has no converged reference: the run with "
                    f"{settings.label} ended with {outcome.termination_reason}; damping, a smaller "
                    "drive or a shorter run may help"
                )
            self._known[settings] = outcome.values
            if self._progress is not None:
                self._progress(1)
        return self._known[settings]


def _even(panels: float) -> int:
    """Return the nearest even number of panels, at least 2."""
    return max(2, 2 * round(0.5 * panels))


def _largest(path: Array) -> float:
    """Return the largest distance (m) of a path (T, 2) from the origin."""
    return float(np.hypot(*path.T).max(initial=0.0))
