"""The work-precision study: every setting on every scene, errors beside costs, resumable.

Every run is one line in ``runs.jsonl``. A study that is started again in the same folder continues
behind the last whole line, and repeats what belongs to a scene that has changed. The speed of a
shared machine drifts, so next to every run the paper's settings are timed on scene paper_i, and
costs are ratios to that.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Hashable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from studies.accuracy.grid import Case
from studies.accuracy.mass_error import mass_errors
from studies.accuracy.runs import Run, Yardstick, scene_with, timed_run
from studies.fingerprint import text_digest
from studies.store import Record, Store
from swim_env.accuracy.outcome import Outcome
from swim_env.accuracy.reference import Reference, reference_of
from swim_env.accuracy.settings import Settings
from swim_env.errors import SimulationEndedError, SwimError
from swim_env.files.atomic import write_atomically
from swim_env.files.provenance import where_and_when
from swim_env.scene.yaml import dump_yaml

#: Those of a reference.
_ARRAYS = ("displacement", "path")


class Study:
    """A study in a folder, where ``runs.jsonl`` and ``references.json`` go.

    It is a SwimError if a file there that has such a name is not one of a study.
    """

    def __init__(
        self, folder: str | os.PathLike[str], cases: list[Case], grid: list[Settings]
    ) -> None:
        self.folder = Path(folder)
        self.cases = cases
        self.grid = grid
        self.folder.mkdir(parents=True, exist_ok=True)
        self.store = Store(self.folder / "runs.jsonl", _name)
        self._references_file = self.folder / "references.json"
        self._reference_cases: dict[str, str] = {}
        self.references = self._read_references()

    @property
    def work(self) -> int:
        """Number of runs and references, done or not."""
        return len(self.cases) * (len(self.grid) + 1)

    def run(self, progress: Callable[[int], object] = lambda _: None) -> None:
        """Do what has not been done; `progress` is called with 1 after each part of `work`."""
        yardstick = Yardstick()
        done = {_name(run) for run in self.store.records}
        for case in self.cases:
            name, digest = case.scene.name, case_digest(case)
            if self._reference_cases.get(name) != digest:
                self.references[name] = reference_of(case.scene, case.duration)
                self._reference_cases[name] = digest
                self._write_references()
                # Runs that were compared with another reference are repeated.
                done = {key for key in done if key[0] != digest}
            progress(1)
            for settings in self.grid:
                if (digest, settings) not in done:
                    self.store.add(self._measure(case, settings, yardstick))
                progress(1)

    def chosen_runs(self) -> list[Run]:
        """Return this study's runs, by its scenes and settings, that came to their end."""
        digests = {case_digest(case) for case in self.cases}
        return [
            run
            for run in self.store.records
            if run["case"] in digests
            and Settings.from_dict(run) in self.grid
            and not run["reason"]
            and run.get("error") is not None
        ]

    def _measure(self, case: Case, settings: Settings, yardstick: Yardstick) -> Record:
        line = {"scene": case.scene.name, "case": case_digest(case), "reason": ""}
        line |= settings.to_dict()
        reference = self.references[case.scene.name]
        try:
            outcome, seconds, cost = timed_run(settings, *case, yardstick)
        except SimulationEndedError as error:
            return {**line, "reason": error.reason}
        except SwimError as error:
            return {**line, "reason": str(error)}
        straight, bent = mass_errors(scene_with(settings, case.scene))
        figures = {
            "error": reference.error(outcome),
            "path_error": path_error(reference, outcome),
            "energy_error": energy_error(reference, outcome),
            "added_mass_error": straight,
            "bent_added_mass_error": bent,
            "displacement": outcome.displacement.tolist(),
            "largest_bend": outcome.largest_bend,
            "cut_steps": outcome.cut_steps,
            "evaluations": outcome.evaluations,
            "corrections": outcome.corrections,
            "seconds_per_second": seconds,
            "cost": cost,
        }
        for key, value in figures.items():
            if isinstance(value, float) and not np.isfinite(value):
                figures[key] = None
        return {**line, "reason": outcome.termination_reason, **figures}

    def _read_references(self) -> dict[str, Reference]:
        if not self._references_file.exists():
            return {}
        try:
            data = json.loads(self._references_file.read_text(encoding="utf-8"))
            self._reference_cases = dict(data["cases"])
            return {
                name: Reference(**{**one, **{key: np.array(one[key]) for key in _ARRAYS}})
                for name, one in data["references"].items()
            }
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise SwimError(
                f"not the references of a study: {error!r} ({self._references_file})"
            ) from None

    def _write_references(self) -> None:
        plain = {
            name: {**vars(one), **{key: getattr(one, key).tolist() for key in _ARRAYS}}
            for name, one in self.references.items()
        }
        data = {**where_and_when(), "cases": self._reference_cases, "references": plain}
        text = json.dumps(data, indent=1) + "\n"
        write_atomically(self._references_file, lambda file: file.write(text.encode()))


def _name(run: Mapping[str, Any]) -> tuple[Hashable, Settings]:
    return run["case"], Settings.from_dict(run)


def case_digest(case: Case) -> str:
    """Return the fingerprint of a scene and its duration.

    Fields that only decide what is said of a run whose energy is off do not count.
    """
    data = case.scene.to_dict()
    integrator = data["integrator"]
    data["integrator"] = {k: integrator[k] for k in integrator if not k.startswith("energy_")}
    return text_digest(f"{case.duration!r}\n{dump_yaml(data)}")[:12]


def path_error(reference: Reference, outcome: Outcome) -> float:
    """Return the largest distance between the paths, relative to the reference's extent.

    It is infinite if the run ended early.
    """
    if outcome.termination_reason:
        return np.inf
    off, extent = (
        float(np.hypot(*path.T).max(initial=0.0))
        for path in (outcome.path - reference.path, reference.path)
    )
    return off / max(extent, 0.01 * reference.length)


def energy_error(reference: Reference, outcome: Outcome) -> float:
    """Return the relative error of the mean energy; infinite if the run ended early."""
    if outcome.termination_reason:
        return np.inf
    return abs(outcome.energy - reference.energy) / (abs(reference.energy) or 1.0)
