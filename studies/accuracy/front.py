"""The front of accuracy against cost: the settings that no others beat in both."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from studies.accuracy.runs import Run, solver_of
from swim_env.accuracy.front import Measured
from swim_env.accuracy.settings import PAPER_SETTINGS, Settings

#: Runs that cost up to this factor more than the front stay candidates: on another scene neighbours
#: may change places.
_NEAR = 2.0
#: Settings with larger errors than this on every scene are no candidates.
_USELESS = 0.3
#: Models that have a front of their own: scenes may bend too far for cheaper ones, or refuse them.
_ON_THEIR_OWN = ("expansion", "panels")


def stepped(runs: Iterable[Run]) -> list[Run]:
    """Return the runs of the kernels, without those of SciPy's solvers."""
    return [run for run in runs if solver_of(Settings.from_dict(run)) is None]


def pareto(runs: Iterable[Run]) -> list[Run]:
    """Return the runs that no other one beats in cost and error, from the cheap to the exact.

    Runs of SciPy's solvers are left out, as no scene can be set to one.
    """
    front: list[Run] = []
    usable = [run for run in stepped(runs) if run["error"] is not None]
    for run in sorted(usable, key=lambda run: (run["cost"], run["error"])):
        if not front or run["error"] < front[-1]["error"]:
            front.append(run)
    return front


def make_front(runs: Iterable[Run]) -> list[Measured]:
    """Return the settings that are on the front of any scene, or near it, by cost.

    The costlier fluid models add those that no others of the same model beat.
    """
    by_settings: dict[Settings, dict[str, Run]] = {}
    by_scene: dict[str, list[Run]] = {}
    for run in stepped(runs):
        by_settings.setdefault(Settings.from_dict(run), {})[run["scene"]] = run
        by_scene.setdefault(run["scene"], []).append(run)
    wanted: set[Settings] = set()
    for some in by_scene.values():
        front = pareto(some)
        kept = [
            run
            for run in some
            if not any(
                other["cost"] * _NEAR < run["cost"] and other["error"] < run["error"]
                for other in front
            )
        ]
        for model in _ON_THEIR_OWN:
            kept += pareto(run for run in some if run["fluid_model"] == model)
        wanted |= {Settings.from_dict(run) for run in kept}
    found = []
    for settings in wanted:
        # Others change less than a timing scatters: their place on a front is chance.
        usual = (settings.strain, settings.tolerance)
        figures = sorted(by_settings[settings].items())
        errors = {name: float(run["error"]) for name, run in figures}
        if usual == (PAPER_SETTINGS.strain, PAPER_SETTINGS.tolerance) and (
            min(errors.values()) <= _USELESS
        ):
            cost = float(np.median([run["cost"] for _, run in figures]))
            found.append(Measured(settings, cost, errors))
    return sorted(found, key=lambda one: one.cost)


def front_to_json(front: list[Measured], origin: Mapping[str, Any]) -> str:
    """Return a front as JSON text, with what it was measured on."""
    entries = [{"cost": one.cost, "errors": one.errors, **one.settings.to_dict()} for one in front]
    return json.dumps({**origin, "front": entries}, indent=1) + "\n"
