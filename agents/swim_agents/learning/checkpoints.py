"""Checkpoints: one file with everything a run needs to continue, written whole or not at all.

The file is PyTorch's own format and holds tensors and plain values only, so that reading it runs no
code from it (``weights_only``).
"""

from __future__ import annotations

import errno
import os
from collections import OrderedDict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from swim_agents.files import DAMAGED
from swim_agents.vec_env import TrainingExtraError  # noqa: F401
from swim_env.errors import SwimError
from swim_env.files.atomic import write_atomically

# After swim_agents.vec_env, which says in one line what is missing where this is not installed.
import torch  # isort: skip

__all__ = ["CheckpointError", "load_checkpoint", "save_checkpoint"]

#: Version of the format; a reader refuses others. Episodes of version 1 kept no energy budget.
FORMAT_VERSION = 2
_ARRAY = "numpy array"


class CheckpointError(SwimError):
    """A checkpoint cannot be written, or cannot be read."""


def save_checkpoint(path: str | os.PathLike[str], state: Mapping[str, Any]) -> None:
    """Write a checkpoint; the one before stays until the new one is complete.

    The state is nested mappings, lists and tuples of numbers, texts, arrays and tensors. What
    cannot be written, as on a full disk, is a CheckpointError.
    """
    content = {"format_version": FORMAT_VERSION, **_copied(state, _pack)}
    try:
        write_atomically(path, lambda file: torch.save(content, file))
    except (OSError, RuntimeError) as error:
        # PyTorch's writer wraps the system's error.
        cause = error.__cause__ or error.__context__ or error
        reason = getattr(cause, "strerror", None) or str(error).splitlines()[0]
        raise CheckpointError(
            f"cannot write the checkpoint: {reason} ({os.fspath(path)}); the one before is intact, "
            "continue with --resume"
        ) from None


def load_checkpoint(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read a checkpoint, or raise a CheckpointError that says why it cannot be."""
    name = os.fspath(path)
    damaged = f"the checkpoint is damaged or cut short, or no checkpoint at all ({name})"
    try:
        content = torch.load(Path(path), map_location="cpu", weights_only=True)
    except FileNotFoundError:
        raise CheckpointError(f"no such checkpoint: {name}") from None
    except OSError as error:
        if error.errno == errno.EINVAL:  # PyTorch's answer to some files that are cut short
            raise CheckpointError(damaged) from None
        raise CheckpointError(f"cannot read the checkpoint: {error.strerror} ({name})") from None
    except DAMAGED:
        raise CheckpointError(damaged) from None
    version = content.pop("format_version", None) if isinstance(content, dict) else None
    if version != FORMAT_VERSION:
        raise CheckpointError(
            f"the checkpoint must be of format version {FORMAT_VERSION}, got {version} ({name})"
        )
    return dict(_copied(content, _unpack))


def _copied(value: Any, change: Callable[[Any], Any]) -> Any:
    """Return a copy of a nested value with its items changed."""
    changed = change(value)
    if changed is not value:
        return changed
    if isinstance(value, Mapping):
        kind = OrderedDict if isinstance(value, OrderedDict) else dict
        return kind((key, _copied(item, change)) for key, item in value.items())
    if isinstance(value, (list, tuple)):
        return type(value)(_copied(item, change) for item in value)
    return value


def _pack(value: Any) -> Any:
    """Return arrays and numpy's scalars in a form that PyTorch's safe reader accepts."""
    if isinstance(value, np.ndarray):
        return {_ARRAY: torch.from_numpy(np.array(value))}
    return value.item() if isinstance(value, np.generic) else value


def _unpack(value: Any) -> Any:
    """Return what `_pack` packed."""
    if isinstance(value, dict) and value.keys() == {_ARRAY}:
        return value[_ARRAY].numpy()
    return value
