#!/usr/bin/env python
"""Play the hard cases and write the verdicts: stability.json and tables.md."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # studies are not installed

from swim_agents.commands.command_line import add_options, print_result, progress_bar, run
from swim_agents.files import check_file

from studies.stability.cases import CASES
from studies.stability.report import failures_of, stability_tables
from studies.stability.suite import measure_stability, work_of
from swim_env.errors import SwimError
from swim_env.files.atomic import write_atomically

#: Cases, random runs, and the folder of results.
_FULL = (None, 100_000, "results/stability")
_QUICK = (("violent torques", "thickness", "curling"), 1000, "results/stability_quick")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--output",
        metavar="FOLDER",
        help="where results go; results/stability unless given, results/stability_quick with "
        "--quick",
    )
    parser.add_argument("--quick", action="store_true", help="a few cases, in a minute")
    parser.add_argument(
        "--cases", nargs="+", metavar="NAME", help=f"only some of: {', '.join(CASES)}"
    )
    parser.add_argument(
        "--draws", type=int, metavar="NUMBER", help="random runs; 100,000 unless given"
    )
    parser.add_argument("--workers", type=int, metavar="NUMBER", help="processes side by side")
    add_options(parser, "json")
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run the command; exit code 1 where something was not right."""
    options = _parser().parse_args(arguments)
    for name, least in (("draws", 0), ("workers", 1)):
        value = getattr(options, name)
        if value is not None and value < least:
            raise SwimError(f"--{name} must be at least {least}, got {value}")
    unknown = [name for name in options.cases or () if name not in CASES]
    if unknown:
        raise SwimError(f"--cases must be among {', '.join(CASES)}, got {unknown[0]}")
    cases, draws, place = _QUICK if options.quick else _FULL
    names = tuple(options.cases or ()) or cases
    draws = draws if options.draws is None else options.draws
    folder = Path(options.output or place)
    # A folder that cannot be made is found at once, not after half an hour.
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("stability.json", "tables.md"):
        check_file(folder / name)
    with progress_bar(work_of(names, draws), "run", "hard cases") as progress:
        results = measure_stability(names, draws, options.workers, progress)
    data = json.dumps(results, indent=1, allow_nan=False) + "\n"
    tables = stability_tables(results)
    write_atomically(folder / "stability.json", lambda file: file.write(data.encode()))
    write_atomically(folder / "tables.md", lambda file: file.write(tables.encode()))
    failures = failures_of(results)
    for text in failures[:20]:
        print(f"not right: {text}", file=sys.stderr)
    print(f"results are in {folder}", file=sys.stderr)
    print_result(results, options.json, lambda: tables.split("## Runs")[0].rstrip())
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(run(main))
