"""Writing files whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable
from pathlib import Path
from typing import IO


def write_atomically(path: str | os.PathLike[str], write: Callable[[IO[bytes]], object]) -> None:
    """Write a file through a temporary one beside it, which then takes its name.

    Parameters
    ----------
    path : str or os.PathLike
        The file; its folder must exist. An older file stays until the new one is complete.
    write : callable
        Called with the open binary file.

    Raises
    ------
    OSError, ValueError
        If the file cannot be written, or its name is not one; what was there before is untouched
        and nothing half-written stays behind. An OSError names the file.
    """
    target = Path(path)
    short = os.fsdecode(os.fsencode(target.name)[:200])  # file systems take 255 bytes
    scratch = target.with_name(f".{short}.{secrets.token_hex(6)}.tmp")
    try:
        with open(scratch, "xb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(scratch, target)
    except OSError as error:
        # The error shall name the file and not the temporary one.
        raise OSError(error.errno, error.strerror or str(error), os.fspath(path)) from error
    finally:
        scratch.unlink(missing_ok=True)
