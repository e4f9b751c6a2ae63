"""All of it: the list of the work, and the data that the page is made of."""

from __future__ import annotations

from typing import Any

from studies.paper.maps import map_units, measure_row
from studies.paper.modes import measure_modes
from studies.paper.onset import measure_onset, onset_units
from studies.paper.runs import NUMERALS, play_run, scene_units
from studies.paper.units import Arrays, Figures, Store, Unit
from studies.paper.variants import measure_variant, variant_units
from swim_env.scene import Scene, load_scene

__all__ = ["PARTS", "all_units", "collect", "work"]

#: Parts of the work by name, and how long the runs of the quick one last (s).
PARTS = ("runs", "onset", "variants", "modes", "maps")
DURATION, QUICK = 100.0, 12.0


def all_units(quick: bool = False, only: tuple[str, ...] = PARTS) -> list[Unit]:
    """Return every unit of work.

    Parameters
    ----------
    quick : bool
        Short runs and few points, for a minute or two.
    only : tuple of str
        Which of `PARTS`.
    """
    duration = QUICK if quick else DURATION
    units: list[Unit] = []
    if "runs" in only:
        units += scene_units(duration, finest=not quick)
    if "onset" in only:
        units += onset_units(quick)
    if "variants" in only:
        units += variant_units(duration, quick)
    if "modes" in only:
        units += [
            Unit(
                f"modes_{numeral}",
                "modes",
                load_scene(f"paper_{numeral}"),
                {"orders": numeral == "i"},
                cost=0.1,
            )
            for numeral in NUMERALS
        ]
    if "maps" in only:
        units += map_units(quick)
    return units


def work(unit: Unit) -> tuple[Figures, Arrays]:
    """Do a unit of any kind."""
    return WORKERS[unit.kind](unit)


WORKERS = {
    "run": play_run,
    "onset": measure_onset,
    "variant": measure_variant,
    "modes": measure_modes,
    "map": measure_row,
}


def _settings(scene: Scene) -> dict[str, Any]:
    """Return what a scene is computed with."""
    fluid = scene.fluid
    return {
        "elements": scene.beam.elements,
        "panels": None if fluid is None else fluid.panels_per_element,
        "caps": None if fluid is None else fluid.panels_per_end(scene.beam),
        "time_step": scene.integrator.time_step,
        "tolerance": scene.integrator.tolerance,
    }


def collect(units: list[Unit], store: Store) -> dict[str, Any]:
    """Return what has been found, by kind, from the files alone.

    Returns
    -------
    dict
        ``runs`` by name behind ``run_``, ``onset`` a list, ``variants`` by variant and scene,
        ``modes`` by scene, ``maps`` by map a list of rows; ``settings`` of the runs by name, which
        are those of the files, as their keys are; ``commits``, ``dates``: where and when
        the files were made; ``units`` and ``done``: how many there are and were found.
    """
    data: dict[str, Any] = {"runs": {}, "onset": [], "variants": {}, "modes": {}, "maps": {}}
    data["settings"] = {}
    commits: set[str] = set()
    dates: set[str] = set()
    done = 0
    for unit in units:
        kept = store.figures(unit)
        if kept is None:
            continue
        done += 1
        commits.add(str(kept["commit"]))
        dates.add(str(kept["date"]))
        figures = kept["figures"]
        if unit.kind == "run":
            data["settings"][unit.name.removeprefix("run_")] = _settings(unit.scene)
            data["runs"][unit.name.removeprefix("run_")] = figures
        elif unit.kind == "onset":
            data["onset"].append(figures)
        elif unit.kind == "modes":
            data["modes"][unit.name.removeprefix("modes_")] = figures
        elif unit.kind == "map":
            data["maps"].setdefault(figures["map"], []).append(figures)
        elif unit.name == "variant_mirrored":
            data["variants"]["mirrored"] = figures
        else:
            data["variants"].setdefault(figures["variant"], {})[figures["scene"]] = figures
    return {
        **data,
        "commits": sorted(commits),
        "dates": sorted(dates),
        "units": len(units),
        "done": done,
    }
