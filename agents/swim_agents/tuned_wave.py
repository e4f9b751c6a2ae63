"""The stored results of searches for the best travelling wave, each beside its scene."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from swim_env.errors import OptionError, SwimError
from swim_env.scene import WAVE_AXES, Actuation, Scene, SpatialActuation, scene_names

__all__ = [
    "LATERAL",
    "SPATIAL_WAVES",
    "SUFFIX",
    "TUNED_WAVE_FILE",
    "WAVE_FIELDS",
    "actuation_of",
    "check_wave",
    "find_tuned_wave",
    "load_tuned_wave",
    "wave_file",
    "wave_of_share",
    "wave_on",
]

#: How names of records end that lie beside a scene's file.
SUFFIX = ".tuned_wave.json"

#: The record of scene swimmer, which ships; see `swim_agents.tuning`. Those of scenes in space that
#: ship lie beside it under the names that `wave_file` would give them.
TUNED_WAVE_FILE = Path(__file__).with_name("tuned_wave.json")

#: The fields of an `Actuation` that define a wave; in space there are its `wave` and, of a helical
#: one, its `pitch_amplitude` as well.
WAVE_FIELDS = ("amplitude", "frequency", "wave_number", "phase")

#: Waves in space: what an actuation calls them, by what they do.
SPATIAL_WAVES = {
    "lateral": "planar",
    "dorsoventral": "dorsoventral",
    "helical_right": "helical_right",
    "helical_left": "helical_left",
}
#: The wave of a planar scene, and of one in space unless another one is named.
LATERAL = "lateral"


def check_wave(scene: Scene, wave: str) -> tuple[str, ...]:
    """Return the axes that one of SPATIAL_WAVES drives, if a scene has it (else OptionError)."""
    if wave not in SPATIAL_WAVES:
        raise OptionError(f"the wave must be one of {', '.join(SPATIAL_WAVES)}, got {wave!r}")
    axes = WAVE_AXES[SPATIAL_WAVES[wave]]
    if scene.dimension == 2 and wave != LATERAL:
        raise OptionError(
            f"a {wave} wave needs a scene of dimension 3, got {scene.name} of dimension 2"
        )
    _require_axes(scene, SPATIAL_WAVES[wave])
    return axes


def _require_axes(scene: Scene, wave: str) -> None:
    """Refuse one of `swim_env.scene.WAVE_NAMES` where a scene does not actuate its axes."""
    axes = WAVE_AXES[wave]
    if not set(axes) <= set(scene.axes):
        raise OptionError(
            f"a {wave} wave needs {' and '.join(axes)} among actuation.axes, scene {scene.name} "
            f"has {', '.join(scene.axes)}"
        )


def wave_file(scene: str | os.PathLike[str], wave: str = LATERAL) -> Path:
    """Return where a tuned wave of a scene's file is kept: beside it."""
    return Path(scene).with_suffix(SUFFIX if wave == LATERAL else f".{wave}{SUFFIX}")


def load_tuned_wave(path: str | os.PathLike[str] | None = None) -> dict[str, Any]:
    """Return a stored record, that of scene swimmer unless a file is given.

    Its ``wave`` holds WAVE_FIELDS in the units of an `Actuation`, ``scene_fields`` the `Scene` that
    it was tuned on. A file that is no such record is a SwimError.
    """
    return _load(Path(TUNED_WAVE_FILE if path is None else path))


def find_tuned_wave(scene: Scene, wave: str = LATERAL) -> dict[str, Any]:
    """Return the record that lies beside a scene's file, or if none does, one that ships.

    That is the scene's by its name, or that of scene swimmer. Its wave plays no other body:
    `WavePolicy.check` refuses it. It is an OptionError if a scene in space has none, or no such
    wave.
    """
    check_wave(scene, wave)
    places = [] if scene.source is None else [wave_file(scene.source, wave)]
    if scene.dimension == 3 and scene.name in scene_names():
        places.append(wave_file(TUNED_WAVE_FILE.with_name(f"{scene.name}.yaml"), wave))
    for place in places:
        if place.is_file():
            return load_tuned_wave(place)
    if scene.dimension == 3:
        raise OptionError(
            f"scene {scene.name} has no tuned {wave} wave; `swim-env tune --wave {wave}` finds it"
        )
    return load_tuned_wave()


def _load(path: Path) -> dict[str, Any]:
    found_none = False
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        found_none = data["wave"] is None
        wave: dict[str, Any] = {name: float(data["wave"][name]) for name in WAVE_FIELDS}
        scene = Scene.from_dict(data["scene_fields"])
        if scene.dimension == 3:
            wave |= {name: data["wave"][name] for name in ("wave", "pitch_amplitude")}
        wave_on(scene, **wave)
    except (OSError, ValueError, TypeError, KeyError) as error:
        if found_none:
            raise OptionError(f"the search found no wave that swims ({path.name})") from None
        raise SwimError(
            f"cannot read the tuned wave ({path.name}): {error!r}; `swim-env tune` makes it again"
        ) from None
    return {**data, "wave": wave, "scene_fields": scene}


def wave_on(scene: Scene, **wave: Any) -> Actuation:
    """Return a wave that never ends, on the joints that the scene drives and with its limit.

    Its fields are WAVE_FIELDS in N m, rad/s, rad per body length and rad, and in space those that
    `wave_of_share` returns; the plane takes none of these.
    """
    if scene.dimension == 2:
        wave = {name: wave[name] for name in WAVE_FIELDS}
    else:
        _require_axes(scene, wave.setdefault("wave", SPATIAL_WAVES[LATERAL]))
    found: Actuation = replace(actuation_of(scene), **wave, end_time=None)
    return found


def actuation_of(scene: Scene) -> Any:
    """Return the actuation of a scene, one without any torque where it has none."""
    if scene.actuation is not None:
        return scene.actuation
    return Actuation(amplitude=0.0) if scene.dimension == 2 else SpatialActuation(amplitude=0.0)


def wave_of_share(scene: Scene, wave: str, share: float) -> dict[str, Any]:
    """Return the fields of a wave whose amplitude is a share of the limit of each axis it drives.

    So the pitch of a helical wave is as much stronger than its yaw as the body's limit is.
    """
    axes = check_wave(scene, wave)
    if scene.dimension == 2:
        return {"amplitude": share * scene.torque_limit}
    limits = dict(zip(scene.axes, np.atleast_1d(scene.torque_limit).tolist(), strict=True))
    first, *beside = (share * limits[axis] for axis in axes)
    return {
        "amplitude": first,
        "wave": SPATIAL_WAVES[wave],
        "pitch_amplitude": beside[0] if beside else None,
    }
