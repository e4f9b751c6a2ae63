#!/usr/bin/env python
"""Measure what accuracy costs in time: errors against costs of many settings on several scenes.

Writes runs.jsonl, references.json, front.json, tables.md, study.json and work_precision.png. A
study that was interrupted continues where it stopped when it is started again with the same
--output.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # studies are not installed

from swim_agents.commands.command_line import STUDY_INTERRUPTED, print_result, progress_bar, run
from swim_agents.files import check_file

from studies.accuracy.front import front_to_json, make_front, pareto
from studies.accuracy.grid import (
    CHOSEN_TOLERANCES,
    Case,
    case_of,
    full_grid,
    held_out_scenes,
    quick_grid,
    study_scenes,
)
from studies.accuracy.held_out import judge
from studies.accuracy.picture import draw_study
from studies.accuracy.report import budget_of, held_out_table, study_tables
from studies.accuracy.study import Study
from studies.accuracy.sweeps import draw_sweeps, sweep_bends, sweep_frequencies, sweep_tables
from swim_env.accuracy.front import FRONT_FILE
from swim_env.accuracy.settings import Settings
from swim_env.errors import SwimError
from swim_env.files.atomic import write_atomically
from swim_env.files.provenance import where_and_when
from swim_env.physics.loading import load_kernels
from swim_env.plots import require_matplotlib, save_figure
from swim_env.scene import load_scene

#: What each kind of run writes.
_FILES = {
    "study": (
        *("runs.jsonl", "references.json", "front.json"),
        *("tables.md", "study.json", "work_precision.png"),
    ),
    "held_out": ("held_out.json", "held_out.md"),
    "sweeps": ("sweeps.json", "sweeps.md", "sweeps.png"),
}
#: Options without a value.
_FLAGS = {
    "--quick": "few settings on the first two scenes, in less than three minutes",
    "--held-out": "instead, judge the choices of Scene.for_accuracy on scenes that the study does "
    "not use; writes held_out.json and held_out.md",
    "--sweeps": "instead, compare fluid models over the bend, and integrators across the first "
    "resonance; writes sweeps.json, sweeps.md and sweeps.png",
    "--refresh-front": "replace the front that Scene.for_accuracy reads by the measured one",
    "--json": "end with the figures as one JSON line",
}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--output",
        metavar="FOLDER",
        help="where everything goes; results/accuracy unless given, results/accuracy_quick with "
        "--quick",
    )
    parser.add_argument(
        "--scenes",
        nargs="+",
        metavar="NAME",
        help="only these scenes: of the study, or any shipped scene or scene file, for as long as "
        "its episode is, 20 s at most; with --held-out some of those scenes",
    )
    for name, words in _FLAGS.items():
        parser.add_argument(name, action="store_true", help=words)
    return parser


def _check(options: argparse.Namespace) -> None:
    """Refuse options that do not go together."""
    if options.held_out and options.sweeps:
        raise SwimError("--held-out and --sweeps are two things, name one")
    if options.sweeps and (options.scenes is not None or options.quick):
        raise SwimError("--sweeps has scenes and settings of its own: no --scenes, no --quick")
    if options.refresh_front and (
        options.held_out or options.sweeps or options.quick or options.scenes is not None
    ):
        raise SwimError("--refresh-front needs the full study: no other option but --output")


def _study_cases(options: argparse.Namespace) -> list[Case]:
    """Return the scenes of the study, or those that were named, of the study or not."""
    of_study = {case.scene.name: case for case in study_scenes()}
    if options.scenes is None:
        return list(of_study.values())[: 2 if options.quick else None]
    found: dict[str, Case] = {}
    for name in dict.fromkeys(options.scenes):
        try:
            case = of_study[name] if name in of_study else case_of(load_scene(name))
        except SwimError as error:
            raise SwimError(
                f"--scenes takes {', '.join(of_study)}, a shipped scene or the path of a scene "
                f"file: {error}"
            ) from None
        # Runs, references and tables tell scenes apart by their names.
        if case.scene.name in found:
            raise SwimError(f"--scenes has two scenes of the name {case.scene.name}, rename one")
        found[case.scene.name] = case
    return list(found.values())


def _held_out_cases(options: argparse.Namespace) -> list[Case]:
    cases = {case.scene.name: case for case in held_out_scenes()}
    wanted = cases if options.scenes is None else options.scenes
    for name in wanted:
        if name not in cases:
            raise SwimError(
                f"--scenes with --held-out must be among {', '.join(cases)}, got {name}"
            )
    return [case for name, case in cases.items() if name in wanted]


def _write(path: Path, content: str | dict[str, Any]) -> None:
    """Write a text, or figures as JSON."""
    text = content if isinstance(content, str) else json.dumps(content, indent=1) + "\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, lambda file: file.write(text.encode()))


def _judge(options: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Judge the held-out scenes."""
    cases = _held_out_cases(options)
    tolerances = CHOSEN_TOLERANCES[:1] if options.quick else CHOSEN_TOLERANCES
    # A direct run and so many choices for each.
    work = len(cases) * (1 + len(tolerances))
    with progress_bar(work, "part", "held-out scenes") as progress:
        judged = judge(cases, tolerances, full_grid(), progress)
    ratios = [one["cost_ratio"] for one in judged if one["timed"]]
    gaps = [one["reference_gap"] for one in judged if one["reference_gap"] is not None]
    summary = {
        **where_and_when(),
        "choices": len(judged),
        "met": sum(1 for one in judged if one["met"]),
        "met_direct": sum(1 for one in judged if one["met_direct"]),
        "largest_reference_gap": max(gaps, default=None),
        "timed": len(ratios),
        "median_cost_ratio": float(np.median(ratios)) if ratios else None,
        "largest_cost_ratio": max(ratios, default=None),
        "judged": judged,
    }
    _write(folder / "held_out.json", summary)
    _write(folder / "held_out.md", held_out_table(judged))
    print(held_out_table(judged), file=sys.stderr)
    return {key: value for key, value in summary.items() if key != "judged"}


def _sweep(options: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Make both sweeps."""
    scenes = {
        "undamped (paper_i)": load_scene("paper_i"),
        "1 ms damping (swimmer)": load_scene("swimmer"),
    }
    with progress_bar(52, "point", "sweeps") as progress:
        bends = sweep_bends(progress)
        resonance = {name: sweep_frequencies(scene, progress) for name, scene in scenes.items()}
    summary = {**where_and_when(), "bends": bends, "resonance": resonance}
    _write(folder / "sweeps.json", summary)
    _write(folder / "sweeps.md", sweep_tables(bends, resonance))
    save_figure(draw_sweeps(bends, resonance), folder / "sweeps.png")
    print(sweep_tables(bends, resonance), file=sys.stderr)
    return summary


def _study(options: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Run the study, or what is missing of it, and write its results."""
    grid = quick_grid() if options.quick else full_grid()
    study = Study(folder, _study_cases(options), grid)
    with progress_bar(study.work, "run", "accuracy and cost") as progress:
        study.run(progress)
    origin = where_and_when()
    runs, references = study.chosen_runs(), study.references
    text = front_to_json(make_front(runs), origin)
    _write(folder / "front.json", text)
    if options.refresh_front:
        _write(FRONT_FILE, text)
    _write(folder / "tables.md", study_tables(runs, references, origin))
    save_figure(draw_study(runs, references), folder / "work_precision.png")
    by_scene: dict[str, Any] = {}
    for case in study.cases:
        name = case.scene.name
        some, reference = [one for one in runs if one["scene"] == name], references[name]
        by_scene[name] = {
            "reference": reference.displacement.tolist(),
            "uncertainty": reference.uncertainty,
            "paper_settings": budget_of(some, reference),
            "front": [
                {"settings": Settings.from_dict(x).label, "cost": x["cost"], "error": x["error"]}
                for x in pareto(some)
            ],
        }
    summary = {**origin, "runs": len(runs), "scenes": by_scene}
    _write(folder / "study.json", summary)
    return summary


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    options = _parser().parse_args(arguments)
    _check(options)
    require_matplotlib()
    usual = "results/accuracy_quick" if options.quick else "results/accuracy"
    folder = Path(options.output or usual)
    if not options.sweeps:
        _held_out_cases(options) if options.held_out else _study_cases(options)
    # A folder or file that cannot be written is an error now, not when all is done.
    folder.mkdir(parents=True, exist_ok=True)
    kind = "sweeps" if options.sweeps else "held_out" if options.held_out else "study"
    for name in _FILES[kind]:
        check_file(folder / name)
    load_kernels()
    make = {"sweeps": _sweep, "held_out": _judge, "study": _study}[kind]
    summary = make(options, folder)
    print(f"results are in {folder}", file=sys.stderr)
    print_result(summary, options.json, lambda: _text(summary))
    return 0


def _text(summary: dict[str, Any]) -> str:
    """Return a study's fronts, or how many choices met their tolerance."""
    if "met" in summary:
        return (
            f"{summary['met']} of {summary['choices']} choices met their tolerance against the "
            f"reference, {summary['met_direct']} against a direct run"
        )
    lines = []
    for name, one in summary.get("scenes", {}).items():
        lines.append(f"{name}: known to {one['uncertainty']:.1e}; front of cost and error:")
        for point in one["front"]:
            lines.append(f"  {point['cost']:8.3f}  {point['error']:.1e}  {point['settings']}")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(run(main, interrupted=STUDY_INTERRUPTED))
