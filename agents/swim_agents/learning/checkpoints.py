"""Checkpoints: one file with all that decides how a run goes on, written whole or not at all.

The file is PyTorch's own format and holds tensors and plain values only, so that reading it runs no
code from it (``weights_only``).
"""

from __future__ import annotations

import errno
import os
import pickle
import zipfile
from collections import OrderedDict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from swim_env.errors import SwimError
from swim_env.files.atomic import write_atomically

__all__ = ["CheckpointError", "load_checkpoint", "save_checkpoint"]

#: Version of the format; a reader refuses others. Episodes of version 1 kept no energy budget.
FORMAT_VERSION = 2
_ARRAY = "numpy array"


class CheckpointError(SwimError):
    """A checkpoint cannot be written, or cannot be read."""


def save_checkpoint(path: str | os.PathLike[str], state: Mapping[str, Any]) -> None:
    """Write a checkpoint; the one before stays until the new one is complete.

    Parameters
    ----------
    path : str or os.PathLike
        The file.
    state : mapping
        Nested mappings, lists and tuples of numbers, texts, arrays and tensors.

    Raises
    ------
    CheckpointError
        If it cannot be written, as on a full disk. The one before is untouched.
    """
    content = {"format_version": FORMAT_VERSION, **_packed(state)}
    try:
        write_atomically(path, lambda file: torch.save(content, file))
    except (OSError, RuntimeError) as error:
        # PyTorch's writer wraps what the system said.
        cause = error.__cause__ or error.__context__ or error
        reason = getattr(cause, "strerror", None) or str(error).splitlines()[0]
        raise CheckpointError(
            f"cannot write the checkpoint: {reason} ({os.fspath(path)}); the one before is intact, "
            "go on with --resume"
        ) from None


def load_checkpoint(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read a checkpoint.

    Raises
    ------
    CheckpointError
        If it is missing, damaged, no checkpoint, or of another version.
    """
    name = os.fspath(path)
    try:
        content = torch.load(Path(path), map_location="cpu", weights_only=True)
    except FileNotFoundError:
        raise CheckpointError(f"no such checkpoint: {name}") from None
    except OSError as error:
        if error.errno == errno.EINVAL:  # what PyTorch makes of some files that are cut short
            raise CheckpointError(
                f"the checkpoint is damaged or cut short, or no checkpoint at all ({name})"
            ) from None
        raise CheckpointError(f"cannot read the checkpoint: {error.strerror} ({name})") from None
    except (
        RuntimeError,
        EOFError,
        ValueError,
        KeyError,
        AttributeError,
        TypeError,
        pickle.UnpicklingError,
        zipfile.BadZipFile,
    ):
        raise CheckpointError(
            f"the checkpoint is damaged or cut short, or no checkpoint at all ({name})"
        ) from None
    version = content.get("format_version") if isinstance(content, dict) else None
    if version != FORMAT_VERSION:
        raise CheckpointError(
            f"the checkpoint must be of format version {FORMAT_VERSION}, got {version} ({name})"
        )
    del content["format_version"]
    unpacked: dict[str, Any] = _unpacked(content)
    return unpacked


def _packed(value: Any) -> Any:
    """Return a copy in which arrays and numpy's scalars are what PyTorch's safe reader accepts."""
    if isinstance(value, np.ndarray):
        return {_ARRAY: torch.from_numpy(np.array(value))}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, OrderedDict):
        return OrderedDict((key, _packed(item)) for key, item in value.items())
    if isinstance(value, Mapping):
        return {key: _packed(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return type(value)(_packed(item) for item in value)
    return value


def _unpacked(value: Any) -> Any:
    if isinstance(value, OrderedDict):
        return OrderedDict((key, _unpacked(item)) for key, item in value.items())
    if isinstance(value, dict):
        if value.keys() == {_ARRAY}:
            return value[_ARRAY].numpy()
        return {key: _unpacked(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return type(value)(_unpacked(item) for item in value)
    return value
