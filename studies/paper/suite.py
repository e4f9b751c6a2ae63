"""The whole study of the paper: its list of work and the data behind the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from studies.paper.maps import map_units
from studies.paper.modes import modes_units
from studies.paper.onset import onset_units
from studies.paper.runs import NUMERALS, scene_units
from studies.paper.units import Unit
from studies.paper.variants import variant_units
from studies.store import Record
from swim_env.scene import Scene

#: How long runs last (s), also those of the quick study.
DURATION, QUICK = 100.0, 12.0
#: Parts of the work: from a run's duration, and whether the study is the quick one, to units.
PARTS: dict[str, Callable[[float, bool], list[Unit]]] = {
    "runs": lambda duration, quick: scene_units(duration, finest=not quick),
    "onset": lambda _, quick: onset_units(quick),
    "variants": variant_units,
    "modes": lambda *_: modes_units(NUMERALS),
    "maps": lambda _, quick: map_units(quick),
}


def all_units(quick: bool = False, only: Sequence[str] = tuple(PARTS)) -> list[Unit]:
    """Return every unit of work, or only some `PARTS`; the quick ones take a minute or two."""
    duration = QUICK if quick else DURATION
    return [unit for name in PARTS if name in only for unit in PARTS[name](duration, quick)]


def collect(units: Sequence[Unit], records: Mapping[str, Record]) -> dict[str, Any]:
    """Return what the records of `studies.paper.units.done_units` say, by kind of unit.

    That is ``runs`` by label, ``onset`` a list, ``variants`` by variant and scene, ``modes`` by
    scene, ``maps`` by map a list of rows; ``settings`` of the runs by label; ``commits``,
    ``dates``: where and when the records were made; ``units`` and ``done``: how many there are and
    were found.
    """
    names = ("runs", "settings", "variants", "modes", "maps")
    data: dict[str, Any] = {"onset": [], **{name: {} for name in names}}
    known = [(unit, records[unit.name]) for unit in units if unit.name in records]
    for unit, record in known:
        figures = record["figures"]
        if unit.kind == "run":
            data["settings"][unit.label] = _settings(unit.scene)
            data["runs"][unit.label] = figures
        elif unit.kind == "onset":
            data["onset"].append(figures)
        elif unit.kind == "map":
            data["maps"].setdefault(figures["map"], []).append(figures)
        elif unit.kind == "modes" or unit.label == "mirrored":
            data["modes" if unit.kind == "modes" else "variants"][unit.label] = figures
        else:
            data["variants"].setdefault(figures["variant"], {})[figures["scene"]] = figures
    return {
        **data,
        "commits": sorted({str(record["commit"]) for _, record in known}),
        "dates": sorted({str(record["date"]) for _, record in known}),
        "units": len(units),
        "done": len(known),
    }


def _settings(scene: Scene) -> dict[str, Any]:
    """Return what a scene is computed with."""
    fluid, integrator = scene.fluid, scene.integrator
    return {
        "elements": scene.beam.elements,
        "panels": fluid and fluid.panels_per_element,
        "caps": fluid and fluid.panels_per_end(scene.beam),
        "step": 1e3 * integrator.time_step,
        "tolerance": integrator.tolerance,
    }
