"""One run of a sweep: does it, and keeps a record of it in its folder."""

from __future__ import annotations

import contextlib
import functools
import io
import json
import os
import shlex
import time
import traceback
from pathlib import Path
from typing import Any

import numba

from swim_agents.commands import command_line as cli
from swim_agents.commands.main import command
from swim_agents.files import read_json, write_json
from swim_agents.sweep.config import Run
from swim_agents.sweep.kinds import KINDS
from swim_env.errors import SwimError
from swim_env.files.atomic import write_atomically
from swim_env.files.provenance import where_and_when

#: Asked once in a process: it takes as long as a short run.
_origin = functools.cache(where_and_when)

#: What a record may say of a run: it went to its end; the physics ended it early, for a reason
#: with a name; it came to nothing.
FINISHED, ENDED, FAILED = "finished", "ended", "failed"
#: What a user can do where a sweep could not write.
AGAIN = "; what was done is kept, start again to continue"


def limit_threads(threads: int) -> None:
    """Give this process that many threads for kernels, and PyTorch as many if it starts later."""
    os.environ |= {"NUMBA_NUM_THREADS": str(threads), "OMP_NUM_THREADS": str(threads)}
    numba.config.NUMBA_NUM_THREADS = threads


def write_text(path: Path, text: str) -> None:
    """Write a text file, whole or not at all (else OSError)."""
    write_atomically(path, lambda file: file.write(text.encode("utf-8")))


def read_record(folder: Path) -> dict[str, Any] | None:
    """Return the record in a run's folder; None without one, or if it is damaged."""
    try:
        found = read_json(folder / "record.json", "cannot read a record")
    except (FileNotFoundError, SwimError):
        return None
    return dict(found) if isinstance(found, dict) and "status" in found else None


def write_record(folder: Path, status: str, reason: str, **more: Any) -> None:
    """Write a run's record, whole or not at all (else OSError)."""
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "record.json", {"status": status, "reason": reason, **more})


def perform(run: Run, folder: Path, threads: int) -> None:
    """Do a run with that many kernel threads; write ``settings.yaml``, ``log.txt`` and the record.

    What goes wrong in it is in the record; it is an OSError if these cannot be written.
    """
    limit_threads(threads)
    start = time.perf_counter()
    folder.mkdir(parents=True, exist_ok=True)
    kind = KINDS[run.kind]
    arguments = [*run.arguments, *kind.output(folder), "--json"]
    printed, said = io.StringIO(), io.StringIO()
    code, reason = cli.FAILED, ""
    figures: dict[str, Any] = {}
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said):
        try:
            code = cli.run(command(run.kind), arguments)
            if code == 0:
                figures = kind.figures(json.loads(printed.getvalue().splitlines()[-1]))
        except (Exception, SystemExit) as error:
            traceback.print_exc()
            code, reason = cli.FAILED, f"{type(error).__name__}: {error}"
    # Of a progress bar only what it showed last.
    lines = [line.rpartition("\r")[2].rstrip() for line in said.getvalue().splitlines()]
    if code and not reason:
        reason = lines[-1].removeprefix("error: ") if lines else f"exit code {code}"
    status = FAILED if code else FINISHED
    if figures.get("termination_reason"):
        status, reason = ENDED, figures["termination_reason"]
    write_text(folder / "settings.yaml", run.settings)
    write_text(folder / "log.txt", "\n".join(lines) + "\n")
    write_record(
        folder,
        status,
        reason,
        seconds=round(time.perf_counter() - start, 3),
        run=run.name,
        command=shlex.join(["swim-env", run.kind, *arguments]),
        **_origin(),
        figures=figures,
    )
