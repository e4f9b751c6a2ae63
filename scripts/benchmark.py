#!/usr/bin/env python
"""Measure what everything costs: the physics step, environments, start-up, training, the peers."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # studies are not installed

from swim_agents.commands.command_line import add_options, print_result, run

from studies.benchmark.report import REPORT_FILES, report_tables, write_report
from studies.benchmark.suite import FULL, QUICK, SECTIONS, measure
from swim_env.errors import SwimError
from swim_env.files.folders import check_folder
from swim_env.files.names import shown_name
from swim_env.files.provenance import where_and_when
from swim_env.plots import require_matplotlib

MOST_ROUNDS = 1000


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--only",
        action="append",
        choices=SECTIONS,
        metavar="SECTION",
        help=f"measure this alone, repeatable: {', '.join(SECTIONS)}; peers come with the "
        "environments that they are compared to",
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help="fewer beams, rounds, steps and peers, no start with an empty cache: under a minute",
    )
    parser.add_argument(
        "--rounds",
        type=int,
        metavar="R",
        help=f"how often each thing is timed; {FULL.rounds} unless given, {QUICK.rounds} with "
        "--quick",
    )
    parser.add_argument(
        "--output",
        metavar="FOLDER",
        help="write benchmark.json, benchmark.md and benchmark.png into this folder",
    )
    add_options(parser, "json")
    return parser


def _check(options: argparse.Namespace) -> None:
    """Refuse what would be found wrong only after the measurements."""
    if options.rounds is not None and not 1 <= options.rounds <= MOST_ROUNDS:
        raise SwimError(f"--rounds must be between 1 and {MOST_ROUNDS}, got {options.rounds}")
    if options.output is not None:
        require_matplotlib()
        check_folder(options.output, REPORT_FILES)


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    options = _parser().parse_args(arguments)
    _check(options)
    sections = options.only or list(SECTIONS)
    extent = QUICK if options.quick else FULL
    extent = extent._replace(rounds=options.rounds or extent.rounds)
    given = sys.argv[1:] if arguments is None else arguments
    record: dict[str, Any] = {
        "command": shown_name(shlex.join(["scripts/benchmark.py", *given])),
        **where_and_when(),
        # How busy other programs keep the machine; the spreads show it too.
        "load_average": list(os.getloadavg()) if hasattr(os, "getloadavg") else None,
        "quick": options.quick,
        "rounds": extent.rounds,
        "sections": sections,
    }
    start = time.perf_counter()
    record |= measure(sections, extent, optional=options.only is None)
    record["wall_seconds"] = round(time.perf_counter() - start, 1)
    if options.output is not None:
        write_report(record, options.output)
        print(f"results are in {options.output}", file=sys.stderr)
    print_result(record, options.json, lambda: report_tables(record))
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
