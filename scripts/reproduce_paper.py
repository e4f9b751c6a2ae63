#!/usr/bin/env python
"""Run everything that the paper reports and put its statements, our figures and verdicts on a page.

FOLDER gets units/ with a record of every piece of work, the pictures and verdicts.json; the page is
FOLDER.md beside it. Started again with the same --output it does only what is missing or has
changed.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # studies are not installed

from swim_agents.commands.command_line import STUDY_INTERRUPTED, print_result, progress_bar, run
from swim_agents.files import check_file

from studies.paper.book import write_book
from studies.paper.suite import PARTS, all_units
from studies.paper.units import do_units, done_units, unit_store
from studies.store import page_of
from swim_env.errors import SwimError
from swim_env.files.provenance import where_and_when
from swim_env.plots import require_matplotlib


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--output",
        metavar="FOLDER",
        help="where results go; results/paper unless given, results/paper_quick with --quick",
    )
    words = "short runs and few points, in a minute or two"
    parser.add_argument("--quick", action="store_true", help=words)
    parser.add_argument(
        "--only",
        nargs="+",
        metavar="PART",
        help=f"do only some of: {', '.join(PARTS)}; the page has what is there of the others",
    )
    parser.add_argument("--workers", type=int, metavar="NUMBER", help="processes side by side")
    words = "end with the verdicts as one JSON line"
    parser.add_argument("--json", action="store_true", help=words)
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    options = _parser().parse_args(arguments)
    if options.workers is not None and options.workers < 1:
        raise SwimError(f"--workers must be at least 1, got {options.workers}")
    unknown = [name for name in options.only or () if name not in PARTS]
    if unknown:
        raise SwimError(f"--only must be among {', '.join(PARTS)}, got {unknown[0]}")
    require_matplotlib()
    usual = "results/paper_quick" if options.quick else "results/paper"
    folder = Path(options.output or usual)
    # A folder that cannot be made is an error now, not when all is done.
    (folder / "units").mkdir(parents=True, exist_ok=True)
    check_file(folder / "verdicts.json")
    check_file(page_of(folder))
    store = unit_store(folder)
    everything = all_units(options.quick)
    chosen = all_units(options.quick, tuple(options.only)) if options.only else everything
    # Of the code that is loaded now: the results themselves may be in the same checkout.
    written = where_and_when()["commit"]
    begin = time.perf_counter()
    with progress_bar(len(chosen), "unit", "the paper") as progress:
        done = do_units(chosen, store, options.workers, progress)
    seconds = time.perf_counter() - begin
    command = "scripts/reproduce_paper.py" + (" --quick" if options.quick else "")
    records = done_units(everything, store)
    summary = write_book(folder, everything, store, records, command, written)
    words = f"{done} of {len(chosen)} units in {seconds:.0f} s; the page is {page_of(folder)}"
    print(words, file=sys.stderr)
    lines = [f"{x['verdict']:13s} {key}: {x['measured']}" for key, x in summary["verdicts"].items()]
    print_result(summary, options.json, lambda: "\n".join(lines))
    return 0


if __name__ == "__main__":
    sys.exit(run(main, interrupted=STUDY_INTERRUPTED))
