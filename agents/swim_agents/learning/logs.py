"""A run's logs: two CSV files and TensorBoard, which continue seamlessly after a resume."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from swim_agents.files import INTACT, as_csv, writing
from swim_env.errors import SwimError
from swim_env.files.atomic import write_atomically

__all__ = ["CsvLog", "TensorBoardLog", "read_log"]


def read_log(path: str | os.PathLike[str]) -> dict[str, list[float]]:
    """Return the columns of a CSV log; empty cells are NaN. SwimError if it cannot be read."""
    try:
        with open(path, newline="", encoding="utf-8") as file:
            header, *rows = csv.reader(file)
        return {name: [float(row[i] or "nan") for row in rows] for i, name in enumerate(header)}
    except (OSError, ValueError, IndexError) as error:
        raise SwimError(f"cannot read the log: {error} ({os.fspath(path)})") from None


class CsvLog:
    """A CSV file that grows by a line at a time, its first column the environment steps.

    Where a run continues at a number of steps, lines beyond it, and half a line at the end, are
    removed; at 0 the file is emptied. What cannot be written is a SwimError.
    """

    def __init__(
        self, path: str | os.PathLike[str], columns: Sequence[str], steps: int = 0
    ) -> None:
        self.path = Path(path)
        self.columns = tuple(columns)
        kept = [row for row in self._rows() if steps and float(row[0]) <= steps]
        text = as_csv([self.columns, *kept]).encode("utf-8")
        with writing("the log", self.path, advice=INTACT):
            write_atomically(self.path, lambda file: file.write(text))

    def _rows(self) -> list[list[str]]:
        """Return the whole lines of a file of the same columns."""
        try:
            text = self.path.read_text(encoding="utf-8")
        except (OSError, ValueError):
            return []
        whole = text[: text.rfind("\n") + 1]
        rows = list(csv.reader(io.StringIO(whole)))
        if not rows or tuple(rows[0]) != self.columns:
            return []
        return [row for row in rows[1:] if len(row) == len(self.columns)]

    def add(self, values: Mapping[str, float]) -> None:
        """Add a line; columns without a value stay empty."""
        row = ["" if values.get(name) is None else repr(values[name]) for name in self.columns]
        with (
            writing("the log", self.path, advice=INTACT),
            open(self.path, "a", encoding="utf-8", newline="") as file,
        ):
            file.write(as_csv([row]))


class TensorBoardLog:
    """Scalars for TensorBoard.

    Where a run continues at a number of steps, what was logged beyond it is marked as superseded.
    """

    def __init__(self, folder: str | os.PathLike[str], steps: int = 0) -> None:
        from torch.utils.tensorboard import SummaryWriter

        self._writer = SummaryWriter(os.fspath(folder), purge_step=steps + 1 if steps else None)

    def add(self, group: str, values: Mapping[str, float], steps: int) -> None:
        """Log a group of values by name at a number of steps."""
        for name, value in values.items():
            self._writer.add_scalar(f"{group}/{name}", value, steps)
        self._writer.flush()

    def close(self) -> None:
        """Close the event file."""
        self._writer.close()
