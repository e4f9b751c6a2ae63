"""The table of a sweep: a row for each run, as CSV or Parquet."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

from swim_agents.files import as_csv, writing
from swim_agents.sweep.config import Run
from swim_agents.sweep.runs import AGAIN
from swim_env.errors import SwimError, require_packages
from swim_env.files.atomic import write_atomically

FORMATS = ("csv", "parquet")
#: The status of a run that was not done yet.
WAITING = "waiting"


def rows_of(runs: Sequence[Run], records: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return a row for each run, in their order.

    Parameters
    ----------
    runs : sequence of Run
        All of a sweep.
    records : mapping
        What is known of them, by name.

    Returns
    -------
    list of dict
        ``run``; what differs, by field; ``status``, ``reason`` and ``seconds``; then all figures
        that are numbers or text, those inside others as ``last.steps`` or ``displacement.0``. A
        column that a run has not is missing there.
    """
    rows = []
    for run in runs:
        record = records.get(run.name, {"status": WAITING})
        about = {name: record.get(name) for name in ("status", "reason", "seconds")}
        values = dict(_flat(run.values))
        row = {"run": run.name, **values, **about}
        rows.append(row | {k: v for k, v in _flat(record.get("figures", {})) if k not in row})
    return rows


def _flat(value: object, name: str = "") -> Iterable[tuple[str, Any]]:
    """Yield the numbers and texts inside a value with their names."""
    inner: Iterable[tuple[object, object]] = ()
    if isinstance(value, Mapping):
        inner = value.items()
    elif isinstance(value, list):
        inner = enumerate(value)
    elif value is None or isinstance(value, (bool, int, float, str)):
        yield name, value
    for key, part in inner:
        yield from _flat(part, f"{name}.{key}" if name else str(key))


def columns_of(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the names of all columns, in the order in which they first appear."""
    return list(dict.fromkeys(name for row in rows for name in row))


def write_table(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write a table whole or not at all, in the format that its name ends with.

    Raises
    ------
    SwimError
        If it cannot be written, or is to be Parquet without PyArrow.
    """
    columns = columns_of(rows)
    if path.suffix == ".parquet":
        require_packages("tables in Parquet need", {"pyarrow": "PyArrow"}, "view")
        import pyarrow
        import pyarrow.parquet

        table = pyarrow.table({name: _column([row.get(name) for row in rows]) for name in columns})

        def write(file: IO[bytes]) -> object:
            return pyarrow.parquet.write_table(table, file)
    else:
        text = as_csv([columns, *([row.get(name) for name in columns] for row in rows)])

        def write(file: IO[bytes]) -> object:
            return file.write(text.encode("utf-8"))

    with writing("the table", path, AGAIN):
        write_atomically(path, write)


def _column(values: list[Any]) -> list[Any]:
    """Return values of one type: numbers as they are, others as text where they are mixed."""
    kinds = {type(value) for value in values if value is not None}
    if len(kinds) < 2 or kinds == {int, float}:
        return values
    return [None if value is None else str(value) for value in values]


def numbers_of(
    rows: Iterable[Mapping[str, Any]], columns: Sequence[str]
) -> list[tuple[float, ...]]:
    """Return the values of columns in all rows that have a number in each.

    It is a SwimError if a column is in no row.
    """
    known = columns_of(rows)
    for name in columns:
        if name not in known:
            raise SwimError(f"no such column: {name}; the table has {', '.join(known)}")
    found = [tuple(row.get(name) for name in columns) for row in rows]
    return [
        tuple(float(value) for value in each if value is not None)
        for each in found
        if all(isinstance(value, (int, float)) for value in each)
    ]
