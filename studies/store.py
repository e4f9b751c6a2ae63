"""A resumable store of results: a file of JSON lines, and arrays in files beside it.

A record is appended as soon as its work is done. Work that is interrupted, or killed in the middle
of a line, continues with the next start behind the last whole line.
"""

from __future__ import annotations

import contextlib
import json
import os
import zipfile
import zlib
from collections.abc import Callable, Hashable, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SwimError
from swim_env.files.atomic import write_atomically

__all__ = ["Arrays", "Record", "Store", "short_commit"]

#: What one piece of work found, as JSON.
Record = dict[str, Any]
#: What belongs to it and is too large for JSON.
Arrays = dict[str, NDArray[Any]]


class Store:
    """Results of a study.

    Parameters
    ----------
    path : path
        The file of JSON lines, made with its folder when the first record is added. Arrays are
        beside it.
    name_of : callable
        From a record to what names its work. Where several records have a name, the last counts.

    Raises
    ------
    SwimError
        If the file cannot be read, or a whole line of it is no record.
    """

    def __init__(self, path: str | os.PathLike[str], name_of: Callable[[Record], Hashable]) -> None:
        self.path = Path(path)
        self._name_of = name_of
        self._records: dict[Hashable, Record] = {}
        try:
            lines = self.path.read_bytes().split(b"\n")
        except FileNotFoundError:
            lines = [b""]
        except OSError as error:
            raise SwimError(
                f"cannot read results: {error.strerror or error} ({self.path})"
            ) from None
        # Behind the last newline: nothing, or a line that was cut off.
        self._is_cut = lines.pop() != b""
        #: Lines of the file, with those that no longer count.
        self._lines = len(lines)
        for number, line in enumerate(lines, start=1):
            try:
                record = json.loads(line)
                self._records[name_of(record)] = record
            except (ValueError, KeyError, TypeError) as error:
                raise SwimError(
                    f"not the results of a study: {error!r} ({self.path}, line {number})"
                ) from None

    @property
    def records(self) -> list[Record]:
        """All records that count, in the order in which their work was first done."""
        return list(self._records.values())

    def get(self, name: Hashable) -> Record | None:
        """Return the record of a name, None where there is none or its arrays are damaged."""
        record = self._records.get(name)
        if record is not None and record.get("arrays"):
            try:
                self.arrays(str(name))
            except SwimError:
                return None
        return record

    def arrays(self, name: str) -> Arrays:
        """Return the arrays of a name; SwimError if their file cannot be read."""
        path = self.path.with_name(f"{name}.npz")
        try:
            # Opened here: NumPy leaves a file open that it finds to be no archive.
            with open(path, "rb") as file, np.load(file, allow_pickle=False) as found:
                return {key: found[key] for key in found.files}
        # Bytes that were changed inside a member end in zlib's error or in a short read.
        except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
            raise SwimError(f"cannot read {path}: {error}; delete it") from None

    def add(self, record: Record, arrays: Mapping[str, NDArray[Any]] | None = None) -> None:
        """Add a record, which takes the place of an earlier one of its name.

        Parameters
        ----------
        record : dict
            For JSON, without NaN and infinities.
        arrays : mapping of str to array, optional
            What goes into a file of its own. The record's name must be a text then, and its item
            ``arrays`` true.

        Raises
        ------
        SwimError
            If the record cannot be written; the file is as before then.
        """
        line = json.dumps(record, allow_nan=False).encode() + b"\n"
        name = self._name_of(record)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            if arrays:

                def save(file: IO[bytes]) -> None:
                    np.savez_compressed(file, allow_pickle=False, **arrays)

                write_atomically(self.path.with_name(f"{name}.npz"), save)
            self._append(line)
        except OSError as error:
            raise SwimError(
                f"cannot write results: {error.strerror or error} ({error.filename or self.path})"
            ) from None
        self._records[name] = record

    def tidy(self) -> None:
        """Rewrite the file without lines that do not count, where it has any."""
        if self._is_cut or self._lines > len(self._records):
            text = "".join(json.dumps(record) + "\n" for record in self._records.values())
            write_atomically(self.path, lambda file: file.write(text.encode()))
            self._is_cut, self._lines = False, len(self._records)

    def _append(self, line: bytes) -> None:
        # Behind half a line, a new one would be lost.
        if self._is_cut:
            self.tidy()
        whole = self.path.stat().st_size if self.path.exists() else 0
        try:
            with open(self.path, "ab") as file:
                file.write(line)
        except BaseException:
            with contextlib.suppress(OSError):
                os.truncate(self.path, whole)
            raise
        self._lines += 1


def short_commit(commit: str | None) -> str:
    """Return a commit as pages show it, with the ``+`` of a checkout that was changed."""
    return commit[:10] + ("+" if commit.endswith("+") else "") if commit else "unknown"


def page_of(folder: str | os.PathLike[str]) -> Path:
    """Return the file of the page on a folder of results: beside it, with its name."""
    place = Path(os.path.realpath(folder))
    return place.with_name(f"{place.name}.md")
