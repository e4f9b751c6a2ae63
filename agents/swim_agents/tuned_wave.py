"""The stored results of searches for the best travelling wave, each beside its scene."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

from swim_env.errors import OptionError, SwimError
from swim_env.scene import Actuation, Scene

__all__ = [
    "SUFFIX",
    "TUNED_WAVE_FILE",
    "WAVE_FIELDS",
    "find_tuned_wave",
    "load_tuned_wave",
    "wave_file",
    "wave_on",
]

#: How names of records end that lie beside a scene's file.
SUFFIX = ".tuned_wave.json"

#: The record of scene swimmer, which ships; see `swim_agents.tuning`.
TUNED_WAVE_FILE = Path(__file__).with_name("tuned_wave.json")

#: The fields of an `Actuation` that define a wave.
WAVE_FIELDS = ("amplitude", "frequency", "wave_number", "phase")


def wave_file(scene: str | os.PathLike[str]) -> Path:
    """Return where the tuned wave of a scene's file is kept: beside it."""
    return Path(scene).with_suffix(SUFFIX)


def load_tuned_wave(path: str | os.PathLike[str] | None = None) -> dict[str, Any]:
    """Return a stored record, that of scene swimmer unless a file is given.

    Its ``wave`` holds WAVE_FIELDS in the units of an `Actuation`, ``scene_fields`` the `Scene` that
    it was tuned on. A file that is no such record is a SwimError.
    """
    return _load(Path(TUNED_WAVE_FILE if path is None else path))


def find_tuned_wave(scene: Scene) -> dict[str, Any]:
    """Return the record that lies beside a scene's file, or if none does, that of scene swimmer.

    The latter's wave plays no other body: `WavePolicy.check` refuses it.
    """
    beside = None if scene.source is None else wave_file(scene.source)
    return load_tuned_wave(beside if beside is not None and beside.is_file() else None)


def _load(path: Path) -> dict[str, Any]:
    found_none = False
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        found_none = data["wave"] is None
        wave = {name: float(data["wave"][name]) for name in WAVE_FIELDS}
        scene = Scene.from_dict(data["scene_fields"])
    except (OSError, ValueError, TypeError, KeyError) as error:
        if found_none:
            raise OptionError(f"the search found no wave that swims ({path.name})") from None
        raise SwimError(
            f"cannot read the tuned wave ({path.name}): {error!r}; `swim-env tune` makes it again"
        ) from None
    return {**data, "wave": wave, "scene_fields": scene}


def wave_on(
    scene: Scene, amplitude: float, frequency: float, wave_number: float, phase: float
) -> Actuation:
    """Return a wave that never ends, on the joints that the scene drives and with its limit.

    Units are N m, rad/s, rad per body length and rad.
    """
    return replace(
        scene.actuation or Actuation(amplitude=0.0),
        amplitude=amplitude,
        frequency=frequency,
        wave_number=wave_number,
        phase=phase,
        end_time=None,
    )
