"""The stored result of the search for the best travelling wave."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from swim_env.errors import SwimError
from swim_env.scene import Actuation, Scene

__all__ = ["TUNED_WAVE_FILE", "WAVE_FIELDS", "load_tuned_wave", "wave_on"]

#: Where the result and the record of the search are kept; see `swim_agents.tuning`.
TUNED_WAVE_FILE = Path(__file__).with_name("tuned_wave.json")

#: The fields of an `Actuation` that define a wave.
WAVE_FIELDS = ("amplitude", "frequency", "wave_number", "phase")


@cache
def load_tuned_wave() -> dict[str, Any]:
    """Return the stored record.

    Its ``wave`` holds WAVE_FIELDS in the units of an `Actuation`, ``scene_fields`` the `Scene` that
    it was tuned on.
    """
    try:
        data = json.loads(TUNED_WAVE_FILE.read_text(encoding="utf-8"))
        wave = {name: float(data["wave"][name]) for name in WAVE_FIELDS}
        scene = Scene.from_dict(data["scene_fields"])
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise SwimError(
            f"cannot read the tuned wave ({TUNED_WAVE_FILE.name}): {error!r}; "
            "`swim-env tune` makes it again"
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
