"""Figures of one run as statements, page and pictures give them, and as text in tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

from swim_agents.tables import markdown_table

from studies.paper.bars import bar_of, with_bar
from studies.paper.verdicts import LEVELS, Data

#: The figures of `studies.paper.runs.run_figures`.
Run = Mapping[str, Any]
#: What a section is filled with, by name.
Fields = dict[str, Any]
Row = TypeVar("Row")


def net_speed(run: Run) -> float:
    """Return the net speed in body lengths a second."""
    return float(run["speed"]) / float(run["length"])


def way_ahead(run: Run) -> float:
    """Return the displacement head first, to the left (body lengths)."""
    return -float(run["displacement"][0]) / float(run["length"])


def heading_turn(run: Run) -> float:
    """Return the turn of the heading (degrees), to the swimmer's left where it is positive."""
    return math.degrees(run["turn"])


def turn_per_way(run: Run) -> float:
    """Return the turn per way (degrees a metre), to the swimmer's left where it is positive."""
    return math.degrees(run["curvature"])


def largest_bend(run: Run) -> float:
    """Return the largest joint angle of the run (rad)."""
    return float(max(run["bends"]))


def mean_power(run: Run) -> float | None:
    """Return the mean positive power on the resolved motion (W), None where it was not measured."""
    internal = run.get("internal")
    return None if internal is None else float(internal["power"])


def transport_cost(run: Run) -> float | None:
    """Return what the torques spend on the resolved motion per way (J/m)."""
    power, speed = mean_power(run), float(run["speed"])
    return None if power is None or speed == 0.0 else power / speed


def table(columns: Mapping[str, Callable[[Row], object]], rows: Iterable[Row]) -> str:
    """Return a table as Markdown: by the head of each column, from a row to the cell."""
    cells = [[cell(row) for cell in columns.values()] for row in rows]
    return markdown_table(list(columns), cells)


def run_with_bar(data: Data, name: str, pick: Callable[[Run], float | None], sign: str = "") -> str:
    """Return a figure of a run with its bar as text; an empty one where there is no run."""
    runs = [data["runs"].get(f"{name}{level}") for level in LEVELS]
    values = [None if run is None or run["end"] else pick(run) for run in runs]
    if values[0] is None:
        return "ended early" if runs[0] is not None and runs[0]["end"] else ""
    return with_bar(values[0], bar_of(*values), sign)


def seconds(value: float | None) -> str:
    """Return a time to a hundredth, or that there is none."""
    return "none" if value is None else f"{value:.2f}"
