"""The study in tables: fronts, the budget of errors, what time buys, and the held-out scenes."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from swim_env.accuracy.front import pareto, stepped
from swim_env.accuracy.grid import FINE_STEPS, SOLVED
from swim_env.accuracy.outcome import relative_error
from swim_env.accuracy.reference import Reference
from swim_env.accuracy.settings import PAPER_SETTINGS, Settings

__all__ = ["budget_of", "held_out_table", "study_tables", "what_time_buys"]

Run = Mapping[str, Any]


def study_tables(
    runs: Sequence[Run], references: Mapping[str, Reference], origin: Mapping[str, Any]
) -> str:
    """Return the study as Markdown.

    Parameters
    ----------
    runs : sequence of mapping
        Those of `Study.chosen_runs`.
    references : mapping of str to Reference
        By scene.
    origin : mapping
        `swim_env.files.provenance.where_and_when`.
    """
    scenes = list(dict.fromkeys(run["scene"] for run in runs))
    machine = origin["machine"]
    lines = [
        "# Accuracy and cost: tables",
        "",
        f"Made by `scripts/accuracy_cost.py` on {machine['processor']}, {machine['cores']} cores, "
        f"commit {_short(origin['commit'])}, {origin['date']}. Errors are of the net "
        "displacement, averaged over the last period of the drive, relative to the reference; "
        "costs are wall time in units of the paper's settings on scene paper_i, which were timed "
        "next to every run. Settings read: fluid model, elements x panels per element / panels at "
        "each end (p: in proportion), time step, scheme.",
        "",
        "## References",
        "",
        "| scene | displacement (m) | error bar | of which elements | time step | panels | model |",
        "|---|---|---|---|---|---|---|",
    ]
    for scene in scenes:
        one = references[scene]
        x, y = one.displacement
        parts = " | ".join(
            _number(one.parts.get(name)) for name in ("elements", "time_step", "panels", "model")
        )
        lines.append(f"| {scene} | {x:+.5f}, {y:+.5f} | {one.uncertainty:.1e} | {parts} |")
    lines += ["", *_budget_lines(runs, references, scenes)]
    lines += ["", *_tolerance_lines(runs, references, scenes)]
    lines += ["", *_solver_lines(runs, references, scenes)]
    lines += ["", *_time_lines(runs, scenes)]
    for scene in scenes:
        lines += ["", *_front_lines(scene, [run for run in runs if run["scene"] == scene])]
    return "\n".join(lines) + "\n"


def budget_of(runs: Iterable[Run], reference: Reference) -> dict[str, float]:
    """Return how much each of the paper's settings puts the displacement of one scene off.

    Every part is the difference between two runs that differ in it alone, or to the reference.

    Returns
    -------
    dict of str to float
        ``elements``, ``panels``, ``time_step``, ``model``, ``tolerance`` and ``all``, as far as the
        runs are there.
    """
    at = {Settings.from_dict(run): np.array(run["displacement"]) for run in runs}
    n = PAPER_SETTINGS.elements
    fine = Settings("frozen", n, 24, "proportional", 0.0025, "composed")
    coarse = replace(fine, panels_per_element=4, cap_panels=1)
    frozen = replace(PAPER_SETTINGS, fluid_model="frozen")
    pairs: dict[str, tuple[Settings, Settings | None]] = {
        "elements": (fine, None),
        "panels": (coarse, fine),
        "time_step": (replace(fine, time_step=0.01, scheme="paper"), fine),
        "model": (frozen, PAPER_SETTINGS),
        "tolerance": (replace(PAPER_SETTINGS, tolerance=1e-6), PAPER_SETTINGS),
        "all": (PAPER_SETTINGS, None),
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
    paper = [run for run in usable if Settings.from_dict(run) == PAPER_SETTINGS]
    if not paper:
        return dict.fromkeys(factors)
    found: dict[float, Run | None] = {}
    for factor in factors:
        some = [run for run in usable if run["cost"] <= factor * paper[0]["cost"]]
        found[factor] = min(some, key=lambda run: run["error"], default=None)
    return found


def held_out_table(judged: Sequence[Run]) -> str:
    """Return the judgement of the held-out scenes as Markdown.

    Where nothing faster was found by hand there is no cost ratio, as none was timed.
    """
    lines = [
        "| scene | tolerance | chosen | error | met | against a direct run | met "
        "| reference to direct run | faster by hand | its error | cost ratio |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for one in judged:
        head = f"| {one['scene']} | {one['tolerance']:g} |"
        gap = _number(one["reference_gap"])
        if one["chosen"] is None:
            lines.append(f"{head} none: {one['reason']} | | no | | no | {gap} | | | |")
            continue
        faster = (
            f"{one['best']} | {one['best_error']:.1e} | {one['cost_ratio']:.2f}"
            if one["timed"]
            else "none | | "
        )
        lines.append(
            f"{head} {one['chosen']} | {one['error']:.1e} | {_yes(one['met'])} | "
            f"{_number(one['direct_error'])} | {_yes(one['met_direct'])} | {gap} | {faster} |"
        )
    return "\n".join(lines) + "\n"


def _short(commit: str | None) -> str:
    """Return a commit's first letters, with the + of a changed checkout."""
    return "unknown" if not commit else commit[:10] + ("+" if commit.endswith("+") else "")


def _yes(met: bool) -> str:
    return "yes" if met else "no"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.1e}"


def _count(value: int | None) -> str:
    return "" if value is None else f"{value:,}"


def _budget_lines(
    runs: Sequence[Run], references: Mapping[str, Reference], scenes: Iterable[str]
) -> list[str]:
    names = ("elements", "panels", "time_step", "model", "tolerance", "all")
    lines = [
        "## What the paper's settings are off by",
        "",
        "9 elements, 4 panels on each and 1 at each end, steps of 10 ms, the paper's scheme. "
        "Frozen: what leaving out the bend would change; tolerance: 1e-6 instead of 1e-10.",
        "",
        "| scene | 9 elements | 4/1 panels | 10 ms | frozen | tolerance 1e-6 | all together |",
        "|---|---|---|---|---|---|---|",
    ]
    for scene in scenes:
        budget = budget_of([run for run in runs if run["scene"] == scene], references[scene])
        lines.append(
            f"| {scene} | " + " | ".join(_number(budget.get(name)) for name in names) + " |"
        )
    return lines


def _tolerance_lines(
    runs: Sequence[Run], references: Mapping[str, Reference], scenes: Iterable[str]
) -> list[str]:
    tolerances = (1e-4, 1e-6, 1e-8)
    lines = [
        "## Newton's tolerance",
        "",
        "What a tolerance changes of the displacement that 1e-10 leads to, and its cost in units "
        "of that one's.",
        "",
        "| scene | settings | " + " | | ".join(f"{one:g}" for one in tolerances) + " | |",
        "|---" * (2 + 2 * len(tolerances)) + "|",
    ]
    for scene, settings in itertools.product(scenes, (PAPER_SETTINGS, *FINE_STEPS)):
        at = {Settings.from_dict(run): run for run in runs if run["scene"] == scene}
        cells = []
        for tolerance in tolerances:
            one, usual = at.get(replace(settings, tolerance=tolerance)), at.get(settings)
            if one is None or usual is None:
                cells += ["", ""]
                continue
            change = _difference(one, usual, references[scene])
            cells += [_number(change), f"{one['cost'] / usual['cost']:.2f}"]
        lines.append(f"| {scene} | {settings.label} | " + " | ".join(cells) + " |")
    return lines


def _solver_lines(
    runs: Sequence[Run], references: Mapping[str, Reference], scenes: Iterable[str]
) -> list[str]:
    lines = [
        "## SciPy's solvers",
        "",
        "The same chain, 9 elements with 24 panels on each and a frozen added mass, in continuous "
        "time and in steps. Evaluations are of the equations with the added mass and its gradient, "
        "in 20 s; as that is constant, steps take hardly any, but Newton's corrections, each with "
        "an evaluation of all else. The solvers' come from Python, those of the steps do not, so "
        "that costs say less than numbers. In time: how far the displacement is from that of the "
        "tightest LSODA, which has the same errors of elements and panels.",
        "",
        "| scene | scheme | evaluations | corrections | error | in time | cost |",
        "|---|---|---|---|---|---|---|",
    ]
    for scene in scenes:
        at = {Settings.from_dict(run): run for run in runs if run["scene"] == scene}
        same = {
            one: run
            for one, run in at.items()
            if replace(one, scheme=SOLVED.scheme, time_step=0.01, tolerance=1e-10) == SOLVED
        }
        tightest = min(
            (one for one in same if one.solver == "LSODA"),
            key=lambda one: one.tolerance,
            default=None,
        )
        for one, run in sorted(same.items(), key=lambda pair: pair[1]["cost"]):
            in_time = None
            if tightest is not None and one != tightest:
                in_time = _difference(run, same[tightest], references[scene])
            name = (
                f"{1e3 * one.time_step:g} ms {one.scheme}"
                if one.solver is None
                else f"{one.solver}, rtol {one.tolerance:g}"
            )
            counts = " | ".join(_count(run.get(key)) for key in ("evaluations", "corrections"))
            lines.append(
                f"| {scene} | {name} | {counts} | {_number(run['error'])} | {_number(in_time)} | "
                f"{run['cost']:.3g} |"
            )
    return lines


def _difference(one: Run, other: Run, reference: Reference) -> float:
    """Return how far the displacements of two runs are apart, on the scale of errors."""
    apart = np.array(one["displacement"]) - np.array(other["displacement"])
    scale = reference.displacement
    return relative_error(scale + apart, scale, reference.length)


def _time_lines(runs: Sequence[Run], scenes: Iterable[str]) -> list[str]:
    factors = (0.1, 1.0, 10.0)
    lines = [
        "## What time buys",
        "",
        "The most accurate settings that take at most a tenth of the time of the paper's settings "
        "on the same scene, as much, and ten times as much.",
        "",
        "| scene | paper's | a tenth | | as much | | ten times | |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for scene in scenes:
        some = [run for run in runs if run["scene"] == scene]
        paper = [run for run in some if Settings.from_dict(run) == PAPER_SETTINGS]
        cells = [_number(paper[0]["error"]) if paper else ""]
        for best in what_time_buys(some, factors).values():
            cells += (
                ["", ""]
                if best is None
                else [_number(best["error"]), Settings.from_dict(best).label]
            )
        lines.append(f"| {scene} | " + " | ".join(cells) + " |")
    return lines


def _front_lines(scene: str, runs: Sequence[Run]) -> list[str]:
    lines = [
        f"## Front of {scene}",
        "",
        "| settings | cost | times real time | displacement | path | energy | added mass | bent |",
        "|---|---|---|---|---|---|---|---|",
    ]
    paper = [run for run in runs if Settings.from_dict(run) == PAPER_SETTINGS]
    for run in [*pareto(runs), *paper]:
        name = Settings.from_dict(run).label
        figures = " | ".join(
            _number(run.get(key))
            for key in (
                "error",
                "path_error",
                "energy_error",
                "added_mass_error",
                "bent_added_mass_error",
            )
        )
        mark = " (the paper's)" if run in paper else ""
        lines.append(
            f"| {name}{mark} | {run['cost']:.3g} | {1.0 / run['seconds_per_second']:.0f} | "
            f"{figures} |"
        )
    return lines
