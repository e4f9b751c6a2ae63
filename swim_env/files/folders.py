"""Result folders: files that belong together, written all of them or none."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Collection
from pathlib import Path

from swim_env.errors import SwimError


def write_folder(
    folder: str | os.PathLike[str], names: Collection[str], write: Callable[[Path], object]
) -> None:
    """Write the files of a folder, all of them or none.

    The files are made in a hidden folder beside it, which then takes its place. A folder of
    earlier results is replaced; one that holds anything else is left alone.

    Parameters
    ----------
    folder : str or os.PathLike
        The folder; it and those above it are made where they are missing.
    names : collection of str
        The files that a folder of earlier results may hold.
    write : callable
        Called with an empty folder to write the files into.

    Raises
    ------
    SwimError
        If the folder holds other files, or cannot be written.
    """
    # A link to a folder keeps pointing there.
    target = Path(os.path.realpath(folder))
    check_folder(target, names)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(
            dir=target.parent, prefix=f".{target.name[:100]}.", ignore_cleanup_errors=True
        ) as scratch:
            ready = Path(scratch) / "new"
            ready.mkdir()
            _fill(ready, write)
            _exchange(ready, target, Path(scratch) / "old")
    except OSError as error:
        raise SwimError(
            f"cannot write results: {error.strerror or error} ({os.fspath(folder)})"
        ) from None


def check_folder(folder: str | os.PathLike[str], names: Collection[str]) -> None:
    """Refuse a result folder that cannot be written, or holds anything but earlier results.

    Raises
    ------
    SwimError
        If it holds other files than `names`, if the path is a file, or if the folder above cannot
        be written or made.
    """
    name = os.fspath(folder)
    target = Path(os.path.realpath(folder))
    others: list[str] = []
    try:
        if target.exists():
            if not target.is_dir():
                raise SwimError(f"results go into a folder, this is a file ({name})")
            others = sorted(entry.name for entry in target.iterdir() if entry.name not in names)
        above = next(one for one in target.parents if one.exists())
        with tempfile.TemporaryDirectory(dir=above, prefix=f".{target.name[:50]}."):
            pass
    except OSError as error:
        raise SwimError(f"cannot use the folder: {error.strerror or error} ({name})") from None
    if others:
        raise SwimError(
            f"the folder holds other files than earlier results, for example {others[0]}; name "
            f"an empty or a new one ({name})"
        )


def _fill(ready: Path, write: Callable[[Path], object]) -> None:
    """Write into a temporary folder; errors of the system are raised bare, without its name."""
    try:
        write(ready)
    except SwimError as error:
        if isinstance(error.__context__, OSError):
            raise error.__context__ from None
        raise


def _exchange(ready: Path, target: Path, old: Path) -> None:
    """Put a finished folder in the place of another, or leave the other where it is."""
    if not target.exists():
        ready.rename(target)
        return
    target.rename(old)
    try:
        ready.rename(target)
    except BaseException:
        old.rename(target)
        raise
