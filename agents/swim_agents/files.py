"""Reading and writing the files of runs and agents; what fails is said in one line."""

from __future__ import annotations

import contextlib
import csv
import errno
import io
import json
import os
import pickle
import tempfile
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from swim_env.errors import SwimError
from swim_env.files.atomic import write_atomically

__all__ = [
    "DAMAGED",
    "INTACT",
    "as_csv",
    "as_json",
    "check_file",
    "read_json",
    "write_json",
    "writing",
]

#: What PyTorch, zip files and unpickling raise for a file that is damaged or something else.
DAMAGED = (
    AssertionError,
    AttributeError,
    EOFError,
    ImportError,
    LookupError,
    RuntimeError,
    TypeError,
    ValueError,
    pickle.UnpicklingError,
    zipfile.BadZipFile,
    zlib.error,
)

#: What a user can do where a training run could not write.
INTACT = "; the last checkpoint is intact, continue with --resume"


@contextlib.contextmanager
def writing(
    what: str, path: str | os.PathLike[str], advice: str = "", verb: str = "write"
) -> Iterator[None]:
    """Turn an OSError into one line: ``cannot VERB WHAT: reason (PATH)ADVICE``."""
    try:
        yield
    except OSError as refused:
        reason = refused.strerror or str(refused)
        raise SwimError(f"cannot {verb} {what}: {reason} ({os.fspath(path)}){advice}") from None


def check_file(path: str | os.PathLike[str], what: str = "a file there") -> None:
    """Refuse a path that is a folder, or whose folder is missing or not writable."""
    with writing(what, path):
        if Path(path).is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        with tempfile.TemporaryFile(dir=Path(path).resolve().parent):
            pass


def as_json(content: Any) -> bytes:
    """Return a JSON file's content."""
    return (json.dumps(content, indent=1, allow_nan=False) + "\n").encode()


def write_json(path: str | os.PathLike[str], content: Any) -> None:
    """Write a JSON file, whole or not at all (else OSError)."""
    write_atomically(path, lambda file: file.write(as_json(content)))


def as_csv(rows: Iterable[Iterable[object]]) -> str:
    """Return a CSV file's text."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def read_json(path: Path, complaint: str, error: type[SwimError] = SwimError) -> Any:
    """Read a JSON file.

    A damaged one raises ``COMPLAINT: reason (PATH)``, a missing one FileNotFoundError.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise
    except (OSError, ValueError, RecursionError) as refused:
        raise error(f"{complaint}: {refused} ({path})") from None
