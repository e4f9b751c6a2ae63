"""Units of work: what each one is, the file that keeps it, and many of them side by side.

Every unit leaves one JSON file, and one of arrays beside it where pictures need them. Its key is a
digest of the scene, the settings, the code of the kernels and the code that makes its figures: a
second start takes what is there and does anew only what has changed, is damaged or is missing.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import zipfile
import zlib
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from studies.fingerprint import kernel_digest
from studies.fresh_processes import in_fresh_processes
from studies.paper.code import code_digest
from swim_env.errors import SwimError
from swim_env.files.atomic import write_atomically
from swim_env.files.provenance import where_and_when
from swim_env.physics.loading import load_kernels
from swim_env.scene import Scene

__all__ = ["Store", "Unit", "do_units"]

Arrays = dict[str, NDArray[Any]]
Figures = dict[str, Any]
#: What does a unit: figures for JSON, and arrays or none.
Worker = Callable[["Unit"], tuple[Figures, Arrays]]


@dataclass(frozen=True)
class Unit:
    """One piece of work.

    Attributes
    ----------
    name : str
        Its name, which is also that of its file.
    kind : str
        What is to be done, a key of `studies.paper.suite.WORKERS`.
    scene : Scene
        The scene that it is about.
    options : mapping
        Numbers, texts and lists for JSON that the work hangs on besides.
    cost : float
        A guess of how long it takes (s); long ones are begun first.
    """

    name: str
    kind: str
    scene: Scene
    options: Mapping[str, Any] = field(default_factory=dict)
    cost: float = 1.0

    @property
    def key(self) -> str:
        """Digest of all that decides what comes of it: 16 hexadecimal digits."""
        text = json.dumps(
            [
                _kernels(),
                code_digest(self.kind),
                self.kind,
                self.scene.to_dict(),
                dict(self.options),
            ],
            sort_keys=True,
        )
        return hashlib.sha256(text.encode()).hexdigest()[:16]


@functools.cache
def _kernels() -> str:
    return kernel_digest()


class Store:
    """The folder that keeps what has been done.

    Parameters
    ----------
    folder : path
        Made when the first unit is written.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)

    def figures(self, unit: Unit) -> Figures | None:
        """Return what a unit found, None where that is missing, damaged or of another key."""
        try:
            kept = json.loads(self._json(unit).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        if not isinstance(kept, dict) or kept.get("key") != unit.key:
            return None
        if kept.get("arrays") and not self._is_whole(unit):
            return None
        return kept

    def _is_whole(self, unit: Unit) -> bool:
        """Tell whether the arrays of a unit can be read, to the last one."""
        try:
            self.arrays(unit)
        except SwimError:
            return False
        return True

    def arrays(self, unit: Unit) -> Arrays:
        """Return the arrays of a unit that is done.

        Raises
        ------
        SwimError
            If their file cannot be read.
        """
        try:
            # Opened here: NumPy leaves a file open that it finds to be no archive.
            with open(self._npz(unit), "rb") as file, np.load(file, allow_pickle=False) as found:
                return {name: found[name] for name in found.files}
        # Bytes that were changed inside a member end in zlib's error or in a short read.
        except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
            raise SwimError(f"cannot read {self._npz(unit)}: {error}; delete it") from None

    def write(
        self, unit: Unit, figures: Figures, arrays: Arrays, origin: Mapping[str, Any]
    ) -> None:
        """Keep what a unit found; the JSON file comes last and says that all is there.

        Parameters
        ----------
        unit : Unit
            The unit.
        figures, arrays : dict
            What it found.
        origin : mapping
            `swim_env.files.provenance.where_and_when` of the code that found it.
        """
        self.folder.mkdir(parents=True, exist_ok=True)

        def save(file: IO[bytes]) -> None:
            np.savez_compressed(file, allow_pickle=False, **arrays)

        if arrays:
            write_atomically(self._npz(unit), save)
        kept = {
            "name": unit.name,
            "key": unit.key,
            "kind": unit.kind,
            "commit": origin["commit"],
            "date": origin["date"],
            "arrays": bool(arrays),
            "figures": figures,
        }
        text = json.dumps(kept, allow_nan=False) + "\n"
        write_atomically(self._json(unit), lambda file: file.write(text.encode()))

    def _json(self, unit: Unit) -> Path:
        return self.folder / f"{unit.name}.json"

    def _npz(self, unit: Unit) -> Path:
        return self.folder / f"{unit.name}.npz"


def do_units(
    units: Sequence[Unit],
    store: Store,
    work: Worker,
    workers: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> int:
    """Do what has not been done, side by side, and keep every unit as soon as it is done.

    Parameters
    ----------
    units : sequence of Unit
        All of them.
    store : Store
        Where they are kept.
    work : callable
        Does a unit in a process of its own; a function of a module.
    workers : int, optional
        Processes side by side, as many as there are processors unless given.
    progress : callable, optional
        Called with 1 after every unit, with their number for those that were there.

    Returns
    -------
    int
        How many units were done now.

    Raises
    ------
    SwimError
        If a unit cannot be done or kept; those that were done by then are kept.
    """
    missing = [unit for unit in units if store.figures(unit) is None]
    if progress is not None and len(missing) < len(units):
        progress(len(units) - len(missing))
    if not missing:
        return 0
    # Of the code that is loaded now, whatever becomes of the checkout meanwhile.
    origin = where_and_when()
    load_kernels()
    with closing(_results(missing, work, workers or os.cpu_count() or 1)) as results:
        for unit, (figures, arrays) in results:
            store.write(unit, figures, arrays, origin)
            if progress is not None:
                progress(1)
    return len(missing)


def _results(
    units: Iterable[Unit], work: Worker, workers: int
) -> Generator[tuple[Unit, tuple[Figures, Arrays]], None, None]:
    order = sorted(units, key=lambda unit: -unit.cost)
    if workers == 1:
        for unit in order:
            yield unit, work(unit)
        return
    calls = [(work, (unit,)) for unit in order]
    kept = "what was done is kept, start again to go on"
    with closing(in_fresh_processes(calls, workers, load_kernels, kept)) as results:
        for index, found in results:
            yield order[index], found
