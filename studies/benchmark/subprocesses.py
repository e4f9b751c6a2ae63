"""Runs Python in subprocesses and timestamps their output."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from swim_env.errors import SwimError

#: The checkout.
_ROOT = Path(__file__).parents[2]


class Finished(NamedTuple):
    """A process that ended well: its standard output, timed lines on standard error, wall time.

    Times are in seconds from the start of the process, Python's own start included.
    """

    output: str
    messages: list[tuple[float, str]]
    seconds: float


def run_python(code: str, *arguments: str, variables: Mapping[str, str] | None = None) -> Finished:
    """Run Python code with this interpreter and this package, and some environment variables set.

    Arguments become its ``sys.argv[1:]``. A process that fails is a SwimError.
    """
    paths = [str(_ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, **(variables or {}), "PYTHONPATH": os.pathsep.join(paths)}
    with tempfile.TemporaryFile("w+", encoding="utf-8") as output:
        start = time.perf_counter()
        with subprocess.Popen(
            [sys.executable, "-c", code, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
        ) as process:
            assert process.stderr is not None
            messages = [(time.perf_counter() - start, line.rstrip("\n")) for line in process.stderr]
        seconds = time.perf_counter() - start
        output.seek(0)
        text = output.read()
    if process.returncode:
        last = messages[-1][1] if messages else f"exit code {process.returncode}"
        raise SwimError(f"a process that was to be measured failed after {seconds:.0f} s: {last}")
    return Finished(text, messages, seconds)
