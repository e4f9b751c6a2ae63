"""Do many runs of one command that differ in settings, and gather their figures in a table.

The file says which command, and what differs: a grid, or random draws. Each run has a folder with a
record; started again, a sweep does what is missing and what has failed. A run whose process is lost
is begun again once, and a training continues from its checkpoint.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from swim_agents.commands import INTERRUPTED
from swim_agents.commands import command_line as cli
from swim_agents.files import check_file, writing
from swim_agents.sweep.backends import on_ray, on_this_machine
from swim_agents.sweep.config import Sweep, load_sweep
from swim_agents.sweep.kinds import KINDS
from swim_agents.sweep.runs import AGAIN, ENDED, FAILED, FINISHED, read_record, write_record
from swim_agents.sweep.table import FORMATS, WAITING, numbers_of, rows_of, write_table
from swim_agents.tables import text_table
from swim_env.envs.geometry import geometry_of
from swim_env.errors import SwimError
from swim_env.physics.runtime.threads import usable_threads
from swim_env.plots import draw_sweep, require_matplotlib, save_figure

#: Seconds between two writings of the table while runs are done.
_TABLE_EVERY = 2.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument(
        "sweep",
        metavar="SWEEP.yaml",
        help=f"which runs: run (one of {', '.join(KINDS)}), options and set, whose values may be "
        "{grid: [...]}, {choice: [...]}, {uniform: [a, b]}, {log_uniform: [a, b]} or "
        "{integers: [a, b]}, samples and seed of what is drawn",
    )
    parser.add_argument(
        "--on",
        choices=("local", "ray"),
        default="local",
        help="processes of this machine, unless given, or Ray",
    )
    parser.add_argument(
        "--address", help="of a cluster of Ray that runs already: auto, or HOST:PORT"
    )
    parser.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="runs at a time; one for each core unless given. A cluster decides by itself",
    )
    parser.add_argument(
        "--threads", type=int, default=1, metavar="N", help="kernel threads of each, 1 unless given"
    )
    parser.add_argument(
        "--output", metavar="FOLDER", help="results/sweep/NAME unless given; of one sweep alone"
    )
    parser.add_argument(
        "--table", choices=FORMATS, default="csv", help="format of FOLDER/table, csv unless given"
    )
    parser.add_argument(
        "--gather", action="store_true", help="do no runs: write the table from their records"
    )
    parser.add_argument(
        "--plot",
        nargs="+",
        metavar=("X", "Y"),
        help="columns of the table: one or two fields and, last, a figure to draw over them into "
        "FOLDER/plot.png, for example beam.length beam.bending_stiffness mean_speed",
    )
    cli.add_options(parser, "json")


def main(options: argparse.Namespace) -> int:
    """Do what is missing; 1 if runs have failed."""
    workers = options.workers
    if workers is None:
        workers = max(1, usable_threads() // max(1, options.threads))
    for name, value in (("workers", workers), ("threads", options.threads)):
        if value < 1:
            raise SwimError(f"--{name} must be at least 1, got {value}")
    if options.address is not None and options.on != "ray":
        raise SwimError("--address needs --on ray")
    if options.plot is not None:
        require_matplotlib()
        if len(options.plot) not in (2, 3):
            raise SwimError("--plot needs one or two fields and a figure")
    sweep = load_sweep(options.sweep)
    folder = Path(options.output or f"results/sweep/{sweep.name}").absolute()
    table = folder / f"table.{options.table}"
    with writing("the sweep's folder", folder, verb="make"):
        (folder / "runs").mkdir(parents=True, exist_ok=True)
    check_file(table)
    code = 0
    if options.gather:
        records = _records(sweep, folder)
    else:
        lock = FileLock(folder / ".lock")
        try:
            lock.acquire(blocking=False)
        except Timeout:
            raise SwimError(f"another process does this sweep ({folder})") from None
        with lock:
            records = _records(sweep, folder)
            try:
                _do(sweep, folder, records, table, workers, options)
            except KeyboardInterrupt:
                print("interrupted; start again to continue", file=sys.stderr)
                code = INTERRUPTED
                records = _records(sweep, folder)  # runs may have ended after the last was seen
    rows = rows_of(sweep.runs, records)
    write_table(table, rows)
    if options.plot is not None:
        save_figure(draw_sweep(options.plot, numbers_of(rows, options.plot)), folder / "plot.png")
    counts = Counter(row["status"] for row in rows)
    result = {
        "name": sweep.name,
        "table": str(table),
        **{status: counts[status] for status in (FINISHED, ENDED, FAILED, WAITING)},
        "reasons": {row["run"]: row["reason"] for row in rows if row["reason"]},
    }
    cli.print_result(result, options.json, lambda: _text(result))
    return code or (cli.FAILED if counts[FAILED] else 0)


def _records(sweep: Sweep, folder: Path) -> dict[str, dict[str, Any]]:
    """Return the records of the runs that have one, by name."""
    found = {run.name: read_record(folder / "runs" / run.name) for run in sweep.runs}
    return {name: record for name, record in found.items() if record is not None}


def _do(
    sweep: Sweep,
    folder: Path,
    records: dict[str, dict[str, Any]],
    table: Path,
    workers: int,
    options: argparse.Namespace,
) -> None:
    """Do the runs that are missing or have failed; add their records, keep the table up to date."""
    done = {name for name, record in records.items() if record["status"] != FAILED}
    todo = [run for run in sweep.runs if run.name not in done]
    if not todo:
        return
    place = folder / "runs"
    if options.address is None:
        geometry_of(sweep.scene).load()  # once, before so many processes want it
    if options.on == "ray":
        outcomes = on_ray(todo, place, workers, options.threads, options.address)
    else:
        outcomes = on_this_machine(todo, place, workers, options.threads)
    failed, written = 0, time.monotonic()
    with (
        cli.progress_bar(len(todo), "run", sweep.name) as progress,
        contextlib.closing(outcomes),
    ):
        for run, lost in outcomes:
            if lost:
                with writing("the record of a run", place / run.name, AGAIN):
                    write_record(place / run.name, FAILED, lost)
            records[run.name] = read_record(place / run.name) or {
                "status": FAILED,
                "reason": "its record is missing or damaged",
            }
            failed += records[run.name]["status"] == FAILED
            progress(1, f"{failed} failed" if failed else "")
            if time.monotonic() - written > _TABLE_EVERY:
                write_table(table, rows_of(sweep.runs, records))
                written = time.monotonic()


def _text(result: dict[str, Any]) -> str:
    """Return how many runs came to what, and every reason."""
    counts = [f"{result[status]} {status}" for status in (FINISHED, ENDED, FAILED, WAITING)]
    shown = ", ".join(text for text in counts if not text.startswith("0 "))
    reasons = [text_table(result["reasons"].items(), left=True)] if result["reasons"] else []
    more = "--plot FIELD FIGURE draws it"
    return "\n".join([f"{result['name']}: {shown}; table in {result['table']}; {more}", *reasons])
