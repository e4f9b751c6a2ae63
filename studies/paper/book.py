"""Turns the records into pictures, page and summary."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from studies.paper.charts import draw_constants, draw_internal, draw_maps, draw_onset, draw_variants
from studies.paper.figures import PAPER_FIGURES, draw_configurations, draw_torques
from studies.paper.page import make_page
from studies.paper.runs import NUMERALS
from studies.paper.statements import find_all
from studies.paper.suite import collect
from studies.paper.units import Unit
from studies.paper.verdicts import Data
from studies.store import Arrays, Record, Store, page_of
from swim_env.files.atomic import write_atomically
from swim_env.plots import save_figure


def write_book(
    folder: Path,
    units: Sequence[Unit],
    store: Store,
    records: Mapping[str, Record],
    command: str,
    written: str | None = None,
) -> dict[str, Any]:
    """Draw the pictures and write ``verdicts.json`` into a folder, and the page beside it.

    All is made of the ``records`` of those units that are done, and of their arrays in the store;
    ``command`` and ``written`` are those of `make_page`. Returns the content of ``verdicts.json``:
    what `verdicts_of` gives, the ``counts`` of the verdicts, ``commits`` and ``dates`` of the
    figures, ``written``, ``units`` and ``done``.
    """
    data = collect(units, records)
    names = draw_all(folder, store, data)
    # Where the folder is a link, the page is beside what it points to.
    place = page_of(folder)
    page = make_page(data, {name: f"{place.stem}/{name}.png" for name in names}, command, written)
    verdicts = verdicts_of(data)
    summary = {
        "counts": dict(Counter(one["verdict"] for one in verdicts.values())),
        **{key: data[key] for key in ("commits", "dates", "units", "done")},
        "written": written,
        "verdicts": verdicts,
    }
    text = json.dumps(summary, indent=1, allow_nan=False) + "\n"
    write_atomically(folder / "verdicts.json", lambda file: file.write(text.encode()))
    write_atomically(place, lambda file: file.write(page.encode()))
    return summary


def verdicts_of(data: Data) -> dict[str, dict[str, Any]]:
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


def draw_all(folder: Path, store: Store, data: Data) -> list[str]:
    """Draw every picture that there are data for; returns their names."""
    folder.mkdir(parents=True, exist_ok=True)
    runs = data["runs"]
    arrays: dict[str, Arrays] = {
        name: store.arrays(f"run_{name}") for name in NUMERALS if name in runs
    }
    made = {}
    if "torque" in arrays.get("i", {}):
        made["fig3"] = draw_torques(arrays["i"])
    for name, (numerals, _) in PAPER_FIGURES.items():
        some = {one: (runs[one], arrays[one]) for one in numerals if one in arrays}
        if some:
            made[name] = draw_configurations(name, some)
    if data["onset"]:
        made["onset"] = draw_onset(data)
    if data["variants"] and runs:
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
