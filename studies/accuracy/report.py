"""The study in tables: fronts, the budget of errors, what time buys, and the held-out scenes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from swim_agents.tables import markdown_table

from studies.accuracy.front import pareto, stepped
from studies.accuracy.grid import FINE_STEPS, SOLVED
from studies.accuracy.runs import Run, label_of, solver_of
from studies.store import short_commit
from swim_env.accuracy.outcome import relative_error
from swim_env.accuracy.reference import Reference
from swim_env.accuracy.settings import PAPER_SETTINGS, Settings

Rows = Iterable[Sequence[object]]


@dataclass(frozen=True)
class _Scene:
    """One scene's runs by their settings, and its reference."""

    name: str
    at: dict[Settings, Run]
    reference: Reference

    def apart(self, one: Run, other: Run) -> float:
        """Return how far the displacements of two runs are apart, on the scale of errors."""
        difference = np.array(one["displacement"]) - np.array(other["displacement"])
        scale = self.reference.displacement
        return relative_error(scale + difference, scale, self.reference.length)


def study_tables(
    runs: Sequence[Run], references: Mapping[str, Reference], origin: Mapping[str, Any]
) -> str:
    """Return the study as Markdown.

    It is made of the runs of `Study.chosen_runs`, the references by scene, and
    `swim_env.files.provenance.where_and_when`.
    """
    scenes: dict[str, _Scene] = {}
    for run in runs:
        name = run["scene"]
        scene = scenes.setdefault(name, _Scene(name, {}, references[name]))
        scene.at[Settings.from_dict(run)] = run
    fields = {}
    for name, (columns, rows_of) in _TABLES.items():
        rows = chain.from_iterable(map(rows_of, scenes.values()))
        fields[name] = markdown_table(columns.split(" | "), rows)
    words = Path(__file__).with_name("tables.md").read_text(encoding="utf-8")
    commit = short_commit(origin["commit"])
    parts = [words.format_map({**origin, **origin["machine"], **fields, "commit": commit})]
    for scene in scenes.values():
        table = markdown_table(_FRONT_COLUMNS.split(" | "), _front_rows(scene))
        parts.append(f"## Front of {scene.name}\n\n{table}\n")
    return "\n".join(parts)


def budget_of(runs: Iterable[Run], reference: Reference) -> dict[str, float]:
    """Return how much each of the paper's settings puts the displacement of one scene off.

    Every part is the difference between two runs that differ in it alone, or to the reference:
    ``elements``, ``panels``, ``time_step``, ``model``, ``tolerance`` and ``all``, as far as the
    runs are there.
    """
    at = {Settings.from_dict(run): np.array(run["displacement"]) for run in runs}
    paper = PAPER_SETTINGS
    fine = Settings("frozen", paper.elements, 24, "proportional", 0.0025, "composed")
    pairs: dict[str, tuple[Settings, Settings | None]] = {
        "elements": (fine, None),
        "panels": (replace(fine, panels_per_element=4, cap_panels=1), fine),
        "time_step": (replace(fine, time_step=0.01, scheme="paper"), fine),
        "model": (replace(paper, fluid_model="frozen"), paper),
        "tolerance": (replace(paper, tolerance=1e-6), paper),
        "all": (paper, None),
    }
    found = {}
    scale = reference.displacement
    for name, (one, other) in pairs.items():
        if one in at and (other is None or other in at):
            base = scale if other is None else at[other]
            found[name] = relative_error(scale + at[one] - base, scale, reference.length)
    return found


def what_time_buys(runs: Iterable[Run], factors: Sequence[float]) -> dict[float, Run | None]:
    """Return the most accurate run that costs at most each factor of the paper's settings."""
    usable = stepped(runs)
    unit = [run["cost"] for run in usable if Settings.from_dict(run) == PAPER_SETTINGS]
    found: dict[float, Run | None] = dict.fromkeys(factors)
    for factor in factors if unit else ():
        some = [run for run in usable if run["cost"] <= factor * unit[0]]
        found[factor] = min(some, key=lambda run: run["error"], default=None)
    return found


def held_out_table(judged: Sequence[Run]) -> str:
    """Return the judgement of the held-out scenes as Markdown.

    Where nothing faster was found by hand there is no cost ratio, as none was timed.
    """
    columns = (
        "scene | tolerance | chosen | error | met | against a direct run | met | "
        "reference to direct run | faster by hand | its error | cost ratio"
    )
    rows = []
    for one in judged:
        head, gap = (one["scene"], f"{one['tolerance']:g}"), _number(one["reference_gap"])
        if one["chosen"] is None:
            rows.append([*head, f"none: {one['reason']}", "", "no", "", "no", gap, "", "", ""])
            continue
        faster = ["none", "", ""]
        if one["timed"]:
            faster = [one["best"], _number(one["best_error"]), f"{one['cost_ratio']:.2f}"]
        met, met_direct = ("yes" if one[key] else "no" for key in ("met", "met_direct"))
        figures = [_number(one["error"]), met, _number(one["direct_error"]), met_direct, gap]
        rows.append([*head, one["chosen"], *figures, *faster])
    return markdown_table(columns.split(" | "), rows) + "\n"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.1e}"


def _reference_rows(scene: _Scene) -> Rows:
    x, y = scene.reference.displacement
    names = ("elements", "time_step", "panels", "model")
    parts = map(scene.reference.parts.get, names)
    bars = map(_number, (scene.reference.uncertainty, *parts))
    return [[scene.name, f"{x:+.5f}, {y:+.5f}", *bars]]


def _budget_rows(scene: _Scene) -> Rows:
    budget = budget_of(scene.at.values(), scene.reference)
    names = ("elements", "panels", "time_step", "model", "tolerance", "all")
    return [[scene.name, *(_number(budget.get(name)) for name in names)]]


def _tolerance_rows(scene: _Scene) -> Rows:
    for settings in (PAPER_SETTINGS, *FINE_STEPS):
        cells = []
        for tolerance in _TOLERANCES:
            one, usual = map(scene.at.get, (replace(settings, tolerance=tolerance), settings))
            if one is None or usual is None:
                cells += ["", ""]
            else:
                ratio = one["cost"] / usual["cost"]
                cells += [_number(scene.apart(one, usual)), f"{ratio:.2f}"]
        yield [scene.name, settings.label, *cells]


def _solver_rows(scene: _Scene) -> Rows:
    same = {
        one: run
        for one, run in scene.at.items()
        if replace(one, scheme=SOLVED.scheme, time_step=0.01, tolerance=1e-10) == SOLVED
    }
    lsoda = [one for one in same if solver_of(one) == "LSODA"]
    tightest = min(lsoda, key=lambda one: one.tolerance, default=None)
    for one, run in sorted(same.items(), key=lambda pair: pair[1]["cost"]):
        in_time = None
        if tightest is not None and one != tightest:
            in_time = scene.apart(run, same[tightest])
        name = f"{one.scheme}, rtol {one.tolerance:g}"
        if solver_of(one) is None:
            name = f"{1e3 * one.time_step:g} ms {one.scheme}"
        counts = (run.get(key) for key in ("evaluations", "corrections"))
        counted = ("" if count is None else f"{count:,}" for count in counts)
        errors = (_number(run["error"]), _number(in_time))
        yield [scene.name, name, *counted, *errors, f"{run['cost']:.3g}"]


def _time_rows(scene: _Scene) -> Rows:
    paper = scene.at.get(PAPER_SETTINGS)
    cells = [_number(paper["error"]) if paper else ""]
    for best in what_time_buys(scene.at.values(), (0.1, 1.0, 10.0)).values():
        label = "" if best is None else label_of(Settings.from_dict(best))
        cells += ["" if best is None else _number(best["error"]), label]
    return [[scene.name, *cells]]


def _front_rows(scene: _Scene) -> Rows:
    paper = scene.at.get(PAPER_SETTINGS)
    kinds = ("error", "path_error", "energy_error", "added_mass_error", "bent_added_mass_error")
    for run in [*pareto(scene.at.values()), *([paper] if paper else [])]:
        mark = " (the paper's)" if run is paper else ""
        yield [
            f"{label_of(Settings.from_dict(run))}{mark}",
            f"{run['cost']:.3g}",
            f"{1.0 / run['seconds_per_second']:.0f}",
            *(_number(run.get(kind)) for kind in kinds),
        ]


_TOLERANCES = (1e-4, 1e-6, 1e-8)
_FRONT_COLUMNS = (
    "settings | cost | times real time | displacement | path | energy | added mass | bent"
)
#: Fields of ``tables.md``: columns, and the rows of one scene.
_TABLES: dict[str, tuple[str, Callable[[_Scene], Rows]]] = {
    "references": (
        "scene | displacement (m) | error bar | of which elements | time step | panels | model",
        _reference_rows,
    ),
    "budget": (
        "scene | 9 elements | 4/1 panels | 10 ms | frozen | tolerance 1e-6 | all together",
        _budget_rows,
    ),
    "tolerances": (
        "scene | settings | " + " |  | ".join(f"{one:g}" for one in _TOLERANCES) + " | ",
        _tolerance_rows,
    ),
    "solvers": (
        "scene | scheme | evaluations | corrections | error | in time | cost",
        _solver_rows,
    ),
    "time": ("scene | paper's | a tenth |  | as much |  | ten times | ", _time_rows),
}
