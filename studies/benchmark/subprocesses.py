"""Python processes of their own, with what they say and when they said it."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from swim_env.errors import SwimError

__all__ = ["Finished", "run_python"]


class Finished(NamedTuple):
    """A process that ended well.

    Attributes
    ----------
    output : str
        What it wrote to standard output.
    messages : list of (float, str)
        Lines on standard error, each with the seconds from the start of the process to it.
    seconds : float
        Wall time of the whole process, Python's own start included (s).
    """

    output: str
    messages: list[tuple[float, str]]
    seconds: float


def run_python(
    code: str,
    *arguments: str,
    environment: Mapping[str, str] | None = None,
    time_limit: float = 600.0,
) -> Finished:
    """Run Python code with this interpreter and this package.

    Parameters
    ----------
    code : str
        What to run.
    *arguments : str
        Its ``sys.argv[1:]``.
    environment : mapping, optional
        Variables to set beside those of this process.
    time_limit : float
        Seconds after which the process is ended.

    Raises
    ------
    SwimError
        If it fails or takes longer.
    """
    root = str(Path(__file__).parents[2])
    paths = [root, *filter(None, [os.environ.get("PYTHONPATH")])]
    variables = {**os.environ, **(environment or {}), "PYTHONPATH": os.pathsep.join(paths)}
    messages: list[tuple[float, str]] = []
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
            limit = threading.Timer(time_limit, process.kill)
            limit.start()
            try:
                assert process.stderr is not None
                for line in process.stderr:
                    messages.append((time.perf_counter() - start, line.rstrip("\n")))
                process.wait()
            except BaseException:
                process.kill()
                raise
            finally:
                limit.cancel()
        seconds = time.perf_counter() - start
        output.seek(0)
        text = output.read()
    if process.returncode:
        last = messages[-1][1] if messages else f"exit code {process.returncode}"
        raise SwimError(f"a process that was to be measured failed after {seconds:.0f} s: {last}")
    return Finished(text, messages, seconds)
