"""The front of accuracy against cost: what nothing else beats in both."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swim_env.accuracy.settings import PAPER_SETTINGS, Settings
from swim_env.errors import SwimError

__all__ = ["FRONT_FILE", "Measured", "load_front", "make_front", "pareto", "stepped"]

Run = Mapping[str, Any]

#: The measured front that ships with the package.
FRONT_FILE = Path(__file__).parent / "front.json"
#: Runs that are up to this factor costlier than the front stay candidates: where scenes differ, the
#: order of neighbours does too.
_NEAR = 2.0
#: What is further off than this on every scene is no candidate.
_USELESS = 0.3
#: Models that have a front of their own: scenes may bend too far for cheaper ones, or refuse them.
_ON_THEIR_OWN = ("expansion", "panels")


@dataclass(frozen=True)
class Measured:
    """Settings and what the study found of them.

    Attributes
    ----------
    settings : Settings
        The settings.
    cost : float
        Wall time in units of the paper's settings on scene paper_i, median over the scenes.
    errors : dict of str to float
        Error in displacement by scene.
    """

    settings: Settings
    cost: float
    errors: dict[str, float]


def stepped(runs: Iterable[Run]) -> list[Run]:
    """Return the runs of the kernels, without those of SciPy's solvers."""
    return [run for run in runs if Settings.from_dict(run).solver is None]


def pareto(runs: Iterable[Run], figure: str = "error") -> list[Run]:
    """Return the runs that no other one beats in cost and error, from the cheap to the exact.

    Of the kernels alone: runs of SciPy's solvers are passed over, as no scene can be set to one.
    """
    front: list[Run] = []
    usable = [run for run in stepped(runs) if run.get(figure) is not None]
    for run in sorted(usable, key=lambda run: (run["cost"], run[figure])):
        if not front or run[figure] < front[-1][figure]:
            front.append(run)
    return front


def make_front(runs: Iterable[Run]) -> list[Measured]:
    """Return the settings that are on the front of any scene, or near it, by cost.

    Of the costlier fluid models also those that no others of the same model beat.
    """
    by_settings: dict[Settings, dict[str, Run]] = {}
    by_scene: dict[str, list[Run]] = {}
    for run in stepped(runs):
        by_settings.setdefault(Settings.from_dict(run), {})[run["scene"]] = run
        by_scene.setdefault(run["scene"], []).append(run)
    wanted: set[Settings] = set()
    for some in by_scene.values():
        for model in _ON_THEIR_OWN:
            own = pareto(run for run in some if run["fluid_model"] == model)
            wanted |= {Settings.from_dict(run) for run in own}
        front = pareto(some)
        for run in some:
            beaten = any(
                other["cost"] * _NEAR < run["cost"] and other["error"] < run["error"]
                for other in front
            )
            if not beaten:
                wanted.add(Settings.from_dict(run))
    found = []
    for settings in wanted:
        of_scene = by_settings[settings]
        if (
            settings.strain != PAPER_SETTINGS.strain
            or settings.tolerance != PAPER_SETTINGS.tolerance
        ):
            # Their place is a matter of chance: both change less than the noise of a timing.
            continue
        if min(run["error"] for run in of_scene.values()) > _USELESS:
            continue
        found.append(
            Measured(
                settings,
                float(np.median([run["cost"] for run in of_scene.values()])),
                {name: float(run["error"]) for name, run in sorted(of_scene.items())},
            )
        )
    return sorted(found, key=lambda one: one.cost)


def front_to_json(front: list[Measured], origin: Mapping[str, Any]) -> str:
    """Return a front as JSON text, with what it was measured on."""
    entries = [{"cost": one.cost, "errors": one.errors, **one.settings.to_dict()} for one in front]
    return json.dumps({**origin, "front": entries}, indent=1) + "\n"


def load_front(path: Path = FRONT_FILE) -> list[Measured]:
    """Read a measured front.

    Raises
    ------
    SwimError
        If there is none, or not a valid one.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        return [
            Measured(Settings.from_dict(entry), entry["cost"], dict(entry["errors"]))
            for entry in data["front"]
        ]
    except OSError as error:
        raise SwimError(
            f"cannot read the measured front: {error.strerror or error} ({path})"
        ) from None
    except (ValueError, KeyError, TypeError) as error:
        raise SwimError(f"not a measured front: {error} ({path})") from None
