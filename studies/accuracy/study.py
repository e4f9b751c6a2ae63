"""The work-precision study: every setting on every scene, errors beside costs, resumable.

Every run is one line in ``runs.jsonl``, written when it is done; a study that is started again in
the same folder goes on behind the last whole line, and does anew what belongs to a scene that has
changed. The speed of a shared machine drifts, so next to every run the paper's settings are timed
on scene paper_i, and costs are ratios to that.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import os
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from studies.accuracy.mass_error import mass_errors
from swim_env.accuracy.grid import Case
from swim_env.accuracy.outcome import Outcome, play, solve
from swim_env.accuracy.reference import Reference, reference_of
from swim_env.accuracy.settings import PAPER_SETTINGS, Settings
from swim_env.errors import SimulationEndedError, SwimError
from swim_env.files.atomic import write_atomically
from swim_env.files.provenance import where_and_when
from swim_env.scene import Scene, load_scene
from swim_env.scene.yaml import dump_yaml
from swim_env.sim.simulator import Simulator

__all__ = ["Study", "Yardstick", "timed_play"]

#: A run that takes less than this (s) is timed this often, the fastest counts.
_SHORT, _REPEATS = 0.3, 3


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


def timed_play(
    scene: Scene,
    duration: float,
    yardstick: Yardstick,
    player: Callable[[Scene, float], Outcome] = play,
) -> tuple[Outcome, float, float]:
    """Play a scene, in the kernels or as the player does it, and time it.

    Returns
    -------
    outcome : Outcome
        What `play` gives.
    seconds, cost : float
        Wall time of a simulated second (s), and its ratio to the yardstick's. The ratio is the
        smallest of three for short runs: other programs only ever add to a time.
    """
    found = []
    for _ in range(_REPEATS):
        before = yardstick.seconds()
        outcome = player(scene, duration)
        yard = min(before, yardstick.seconds())
        each = outcome.seconds / max(outcome.steps * scene.integrator.time_step, 1e-12)
        found.append((each / yard, each))
        if outcome.seconds > _SHORT:
            break
    cost, each = min(found)
    return outcome, each, cost


class Study:
    """A study in a folder.

    Parameters
    ----------
    folder : path
        Where ``runs.jsonl``, ``references.json`` and what is made of them go.
    cases : list of Case
        The scenes.
    grid : list of Settings
        The settings.
    """

    def __init__(
        self, folder: str | os.PathLike[str], cases: list[Case], grid: list[Settings]
    ) -> None:
        self.folder = Path(folder)
        self.cases = cases
        self.grid = grid
        self.folder.mkdir(parents=True, exist_ok=True)
        self._runs_file = self.folder / "runs.jsonl"
        self._references_file = self.folder / "references.json"
        self.runs = self._read_runs()
        self._reference_cases: dict[str, str] = {}
        self.references = self._read_references()

    @property
    def work(self) -> int:
        """Number of runs and references, done or not."""
        return len(self.cases) * (len(self.grid) + 1)

    def run(self, progress: Callable[[int], object] | None = None) -> None:
        """Do what has not been done.

        Parameters
        ----------
        progress : callable, optional
            Called with 1 after each of `work` runs and references.
        """
        yardstick = Yardstick()
        done = {(run["case"], _key(run)) for run in self.runs}
        for case in self.cases:
            name = case.scene.name
            digest = _digest(case)
            if self._reference_cases.get(name) != digest:
                self.references[name] = reference_of(case.scene, case.duration)
                self._reference_cases[name] = digest
                self._write_references()
                # What was measured against another reference is measured anew.
                done = {key for key in done if key[0] != digest}
            _advance(progress)
            for settings in self.grid:
                if (digest, _key(settings.to_dict())) not in done:
                    self._append(self._measure(case, settings, yardstick))
                _advance(progress)

    def _measure(self, case: Case, settings: Settings, yardstick: Yardstick) -> dict[str, Any]:
        reference = self.references[case.scene.name]
        player = play
        if settings.solver is not None:
            player = functools.partial(solve, method=settings.solver, tolerance=settings.tolerance)
        try:
            scene = settings.apply(case.scene)
            outcome, each, cost = timed_play(scene, case.duration, yardstick, player)
        except SimulationEndedError as error:
            return _line(case, settings, error.reason)
        except SwimError as error:
            return _line(case, settings, str(error))
        straight, bent = mass_errors(scene)
        return _line(
            case,
            settings,
            outcome.termination_reason,
            error=reference.error(outcome),
            path_error=reference.path_error(outcome),
            energy_error=reference.energy_error(outcome),
            added_mass_error=straight,
            bent_added_mass_error=bent,
            displacement=outcome.displacement.tolist(),
            largest_bend=outcome.largest_bend,
            cut_steps=outcome.cut_steps,
            evaluations=outcome.evaluations,
            corrections=outcome.corrections,
            seconds_per_second=each,
            cost=cost,
        )

    # ---- files ---------------------------------------------------------------------------------

    def _read_runs(self) -> list[dict[str, Any]]:
        if not self._runs_file.exists():
            return []
        try:
            text = self._runs_file.read_text(encoding="utf-8")
        except UnicodeDecodeError as error:
            raise SwimError(f"not the runs of a study: {error} ({self._runs_file})") from None
        # A line that was cut off by an interrupt is done again.
        whole, _, rest = text.rpartition("\n")
        if rest:
            write_atomically(self._runs_file, lambda file: file.write((whole + "\n").encode()))
        try:
            runs: list[dict[str, Any]] = [json.loads(line) for line in whole.splitlines() if line]
            for run in runs:
                _key(run), run["case"], run["scene"], run["reason"]
        except (ValueError, KeyError, TypeError) as error:
            raise SwimError(f"not the runs of a study: {error!r} ({self._runs_file})") from None
        return runs

    def _append(self, line: dict[str, Any]) -> None:
        whole = self._runs_file.stat().st_size if self._runs_file.exists() else 0
        try:
            with open(self._runs_file, "a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")
        except OSError as error:
            # Half a line would spoil the next one.
            with contextlib.suppress(OSError):
                os.truncate(self._runs_file, whole)
            raise SwimError(
                f"cannot write the run: {error.strerror or error} ({self._runs_file})"
            ) from None
        self.runs.append(line)

    def _read_references(self) -> dict[str, Reference]:
        if not self._references_file.exists():
            return {}
        try:
            data = json.loads(self._references_file.read_text(encoding="utf-8"))
            self._reference_cases = dict(data["cases"])
            return {name: Reference.from_dict(one) for name, one in data["references"].items()}
        except (ValueError, KeyError, TypeError) as error:
            raise SwimError(
                f"not the references of a study: {error!r} ({self._references_file})"
            ) from None

    def _write_references(self) -> None:
        data = {
            **where_and_when(),
            "cases": self._reference_cases,
            "references": {name: one.to_dict() for name, one in self.references.items()},
        }
        text = json.dumps(data, indent=1) + "\n"
        write_atomically(self._references_file, lambda file: file.write(text.encode()))

    def chosen_runs(self) -> Iterable[dict[str, Any]]:
        """Return the last runs of this study's scenes and settings that came to their end."""
        cases = {_digest(case) for case in self.cases}
        keys = {_key(settings.to_dict()) for settings in self.grid}
        last = {(run["case"], _key(run)): run for run in self.runs}
        for (case, key), run in last.items():
            wanted = case in cases and key in keys
            if wanted and not run["reason"] and run.get("error") is not None:
                yield run


def _advance(progress: Callable[[int], object] | None) -> None:
    if progress is not None:
        progress(1)


def _line(case: Case, settings: Settings, reason: str, **figures: Any) -> dict[str, Any]:
    plain = {
        key: None if isinstance(value, float) and not np.isfinite(value) else value
        for key, value in figures.items()
    }
    return {
        "scene": case.scene.name,
        "case": _digest(case),
        "reason": reason,
        **settings.to_dict(),
        **plain,
    }


def _digest(case: Case) -> str:
    """Return what tells a scene and its duration from others.

    What is said of a run when its energy is off changes nothing of it and does not count.
    """
    data = case.scene.to_dict()
    integrator = data["integrator"]
    data["integrator"] = {k: integrator[k] for k in integrator if not k.startswith("energy_")}
    text = f"{case.duration!r}\n{dump_yaml(data)}"
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def _key(data: dict[str, Any]) -> str:
    return json.dumps(Settings.from_dict(data).to_dict(), sort_keys=True)
