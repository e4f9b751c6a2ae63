"""Python processes of their own, with what they print and when."""

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

__all__ = ["Finished", "run_python"]


class Finished(NamedTuple):
    """A process that ended well: its standard output, timed lines on standard error, wall time.

    Times are in seconds from the start of the process, Python's own start included.
    """

    output: str
    messages: list[tuple[float, str]]
    seconds: float


def run_python(
    code: str, *arguments: str, environment: Mapping[str, str] | None = None
) -> Finished:
    """Run Python code with this interpreter and this package, and some environment variables set.

    Arguments become its ``sys.argv[1:]``.

    Raises
    ------
    SwimError
        If it fails.
    """
    paths = [str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
    variables = {**os.environ, **(environment or {}), "PYTHONPATH": os.pathsep.join(paths)}
    with tempfile.TemporaryFile("w+", encoding="utf-8") as output:
        start = time.perf_counter()
        with subprocess.Popen(
            [sys.executable, "-c", code, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.PIPE,
            text=True,
            env=variables,
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
