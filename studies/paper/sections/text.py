"""What the sections of the page share: tables, pictures, figures with bars, commits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from studies.paper.bars import bar_of, with_bar
from studies.paper.verdicts import Data

__all__ = ["commits", "picture", "run_with_bar", "seconds", "short_commit", "table"]


def table(heads: Sequence[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a table as Markdown."""
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    for row in rows:
        # A bar in a cell would end it.
        cells = [str(cell).replace("|", "\\|") for cell in row]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def picture(pictures: Mapping[str, str], name: str, caption: str) -> str:
    """Return a picture with its caption as Markdown, nothing where it was not drawn."""
    return f"![{caption}]({pictures[name]})\n\n*{caption}*\n" if name in pictures else ""


def short_commit(commit: str) -> str:
    """Return a commit as it is shown, with the ``+`` of a checkout that was changed."""
    return commit[:10] + ("+" if commit.endswith("+") else "")


def commits(data: Data) -> str:
    """Return the commits that figures were computed at."""
    return ", ".join(short_commit(one) for one in data["commits"]) or "none"


def run_with_bar(data: Data, numeral: str, pick: Any, sign: str = "", digits: int = 6) -> str:
    """Return a figure of a run with its bar as text; an empty one where there is no run."""
    runs = [data["runs"].get(f"{numeral}{level}") for level in ("", "_half", "_fine")]
    values = [None if run is None or run["end"] else pick(run) for run in runs]
    if values[0] is None:
        return "ended early" if runs[0] is not None and runs[0]["end"] else ""
    return with_bar(values[0], bar_of(*values), sign, digits)


def seconds(value: float | None) -> str:
    """Return a time to a hundredth, or that there is none."""
    return "none" if value is None else f"{value:.2f}"
