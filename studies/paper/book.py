"""From the data files to the pictures, the page and the summary."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from studies.paper.charts import (
    draw_constants,
    draw_internal,
    draw_onset,
    draw_variants,
)
from studies.paper.figures import PAPER_FIGURES, draw_configurations, draw_torques
from studies.paper.map_charts import draw_maps
from studies.paper.page import make_page
from studies.paper.runs import NUMERALS
from studies.paper.statements import find_all
from studies.paper.suite import collect
from studies.paper.units import Arrays, Store, Unit
from swim_env.files.atomic import write_atomically
from swim_env.files.folders import page_of
from swim_env.plots import save_figure

__all__ = ["draw_all", "verdicts_of", "write_book"]


def write_book(
    folder: Path, units: list[Unit], store: Store, command: str, written: str | None = None
) -> dict[str, Any]:
    """Draw the pictures and write the page and the verdicts, from the files alone.

    Parameters
    ----------
    folder : Path
        Where pictures and ``verdicts.json`` go; the page stands beside it.
    units : list of Unit
        What was to be done.
    store : Store
        What has been done.
    command : str
        What to call the command on the page.
    written : str, optional
        The commit of the code that writes the page.

    Returns
    -------
    dict
        ``verdicts`` by statement with ``measured``, ``verdict``, ``criterion`` and ``why``,
        ``counts`` of the verdicts, ``commits`` and ``dates`` of the figures, ``written``,
        ``units`` and ``done``.
    """
    data = collect(units, store)
    names = draw_all(folder, units, store, data)
    # Where the folder is a link, the page stands beside what it points to.
    place = page_of(folder)
    pictures = {name: f"{place.stem}/{name}.png" for name in names}
    page = make_page(data, pictures, command, written)
    verdicts = verdicts_of(data)
    counts: dict[str, int] = {}
    for one in verdicts.values():
        counts[one["verdict"]] = counts.get(one["verdict"], 0) + 1
    summary = {
        "counts": counts,
        **{key: data[key] for key in ("commits", "dates", "units", "done")},
        "written": written,
        "verdicts": verdicts,
    }
    text = json.dumps(summary, indent=1, allow_nan=False) + "\n"
    write_atomically(folder / "verdicts.json", lambda file: file.write(text.encode()))
    write_atomically(place, lambda file: file.write(page.encode()))
    return summary


def verdicts_of(data: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return what ``verdicts.json`` says of every statement, from what `collect` found."""
    return {
        statement.key: {
            "says": statement.says,
            "where": statement.where,
            "measured": finding.measured,
            "verdict": finding.verdict,
            "criterion": statement.criterion,
            "why": finding.why,
        }
        for statement, finding in find_all(data)
    }


def draw_all(folder: Path, units: list[Unit], store: Store, data: Mapping[str, Any]) -> list[str]:
    """Draw every picture that there are data for; returns their names."""
    os.makedirs(folder, exist_ok=True)
    arrays: dict[str, Arrays] = {}
    for unit in units:
        numeral = unit.name.removeprefix("run_")
        if unit.kind == "run" and numeral in NUMERALS and store.figures(unit) is not None:
            arrays[numeral] = store.arrays(unit)
    made = {}
    if "torque" in arrays.get("i", {}):
        made["fig3"] = draw_torques(arrays["i"])
    for name, (scenes, _) in PAPER_FIGURES.items():
        some = {scene: (data["runs"][scene], arrays[scene]) for scene in scenes if scene in arrays}
        if some:
            made[name] = draw_configurations(name, some)
    if data["onset"]:
        made["onset"] = draw_onset(data)
    if data["variants"] and data["runs"]:
        made["variants"] = draw_variants(data)
    if arrays:
        made["constants"] = draw_constants(data, arrays)
    if any("total" in one for one in arrays.values()):
        made["internal"] = draw_internal(data, arrays)
    if data["maps"]:
        made["maps"] = draw_maps(data)
    for name, figure in made.items():
        save_figure(figure, folder / f"{name}.png")
    return list(made)
