"""What the sections of the page share: blocks, tables by column, pictures, figures with bars."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TypeVar

from studies.paper.bars import bar_of, with_bar
from studies.paper.measures import Run
from studies.paper.verdicts import LEVELS, Data
from swim_env.files.tables import markdown_table

__all__ = ["blocks", "commits", "picture", "run_with_bar", "seconds", "short_commit", "table"]

Row = TypeVar("Row")


def blocks(*parts: str) -> str:
    """Return paragraphs, tables and pictures below each other, without the empty ones."""
    return "\n\n".join(part for part in parts if part)


def table(columns: Mapping[str, Callable[[Row], object]], rows: Iterable[Row]) -> str:
    """Return a table as Markdown: by the head of each column, from a row to the cell."""
    cells = [[cell(row) for cell in columns.values()] for row in rows]
    return markdown_table(list(columns), cells)


def picture(pictures: Mapping[str, str], name: str, caption: str) -> str:
    """Return a picture with its caption as Markdown, nothing where it was not drawn."""
    return f"![{caption}]({pictures[name]})\n\n*{caption}*" if name in pictures else ""


def short_commit(commit: str | None) -> str:
    """Return a commit as it is shown, with the ``+`` of a checkout that was changed."""
    return commit[:10] + ("+" if commit.endswith("+") else "") if commit else "unknown"


def commits(data: Data) -> str:
    """Return the commits that figures were computed at."""
    return ", ".join(short_commit(one) for one in data["commits"]) or "none"


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
