"""What the sections of the page share: tables by column, figures with bars, commits."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

from studies.paper.bars import bar_of, with_bar
from studies.paper.measures import Run
from studies.paper.verdicts import LEVELS, Data
from swim_env.files.tables import markdown_table

__all__ = ["Fields", "run_with_bar", "seconds", "short_commit", "table"]

#: What a section is filled with, by name.
Fields = dict[str, Any]
Row = TypeVar("Row")


def table(columns: Mapping[str, Callable[[Row], object]], rows: Iterable[Row]) -> str:
    """Return a table as Markdown: by the head of each column, from a row to the cell."""
    cells = [[cell(row) for cell in columns.values()] for row in rows]
    return markdown_table(list(columns), cells)


def short_commit(commit: str | None) -> str:
    """Return a commit as it is shown, with the ``+`` of a checkout that was changed."""
    return commit[:10] + ("+" if commit.endswith("+") else "") if commit else "unknown"


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
