"""Tables as text: Markdown for pages, aligned columns for terminals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def markdown_table(
    heads: Sequence[object], rows: Iterable[Iterable[object]], padded: bool = False
) -> str:
    """Return a table in Markdown.

    Parameters
    ----------
    heads : sequence
        Names of the columns.
    rows : iterable of iterables
        Cells, as many in each row as there are heads; shown as `str` does, None as an empty cell.
    padded : bool
        Whether to fill cells with spaces, so that the source reads well too: the first column to
        the left, the others to the right.

    Returns
    -------
    str
        Without a newline at its end.

    Raises
    ------
    ValueError
        If a row has more or fewer cells than there are heads.
    """
    # A bar in a cell would end it.
    lines = [[cell.replace("|", "\\|") for cell in line] for line in _cells([heads, *rows])]
    if not padded:
        texts = [f"| {' | '.join(line)} |" for line in lines]
        return "\n".join([texts[0], "|" + "---|" * len(lines[0]), *texts[1:]])
    widths = [max(3, width) for width in _widths(lines)]
    rule = ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])]
    lines.insert(1, rule)
    return "\n".join(f"| {' | '.join(_aligned(line, widths))} |" for line in lines)


def text_table(rows: Iterable[Iterable[object]], left: bool = False) -> str:
    """Return rows in columns for a terminal: the first to the left, the others to the right.

    Parameters
    ----------
    rows : iterable of iterables
        Cells, equally many in each row; shown as `str` does, None as an empty cell.
    left : bool
        Whether all columns are to the left.

    Returns
    -------
    str
        Without a newline at its end.

    Raises
    ------
    ValueError
        If the rows differ in length.
    """
    lines = _cells(rows)
    widths = _widths(lines)
    return "\n".join("  ".join(_aligned(line, widths, left)).rstrip() for line in lines)


def _cells(rows: Iterable[Iterable[object]]) -> list[list[str]]:
    lines = [["" if cell is None else str(cell) for cell in row] for row in rows]
    for line in lines:
        if len(line) != len(lines[0]):
            raise ValueError(f"a row of {len(line)} cells in a table of {len(lines[0])}: {line}")
    return lines


def _widths(lines: Sequence[Sequence[str]]) -> list[int]:
    return [max(map(len, column)) for column in zip(*lines, strict=True)]


def _aligned(line: Sequence[str], widths: Sequence[int], left: bool = False) -> list[str]:
    pairs = enumerate(zip(line, widths, strict=True))
    return [
        cell.rjust(width) if i and not left else cell.ljust(width) for i, (cell, width) in pairs
    ]
