"""Units of work: what each one is, which are done, and how to do many side by side.

A unit's results are one record of a `studies.store.Store`, with arrays beside it where pictures
need them. Its key is a digest of the scene, the options, the code of the kernels and the code that
computes its figures: a second start does only what is missing, is damaged or has changed.
"""

from __future__ import annotations

import functools
import json
import os
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from studies.fingerprint import ROOT, files_digest, kernel_digest, text_digest, with_imports
from studies.fresh_processes import in_fresh_processes
from studies.store import Arrays, Record, Store
from swim_env.files.provenance import where_and_when
from swim_env.physics.loading import load_kernels
from swim_env.scene import Scene

__all__ = ["Arrays", "Figures", "Unit", "code_digest", "do_units", "done_units", "unit_store"]

#: What a unit finds, for JSON.
Figures = dict[str, Any]


@dataclass(frozen=True)
class Unit:
    """One piece of work."""

    #: Its kind, ``_`` and a label, for example ``run_i_half``.
    name: str
    #: Computes its figures, and arrays or none; a function of a module.
    work: Callable[[Unit], tuple[Figures, Arrays]]
    #: The scene that it is about, and what else the work depends on, for JSON.
    scene: Scene
    options: Mapping[str, Any] = field(default_factory=dict)
    #: A guess of how long it takes (s); long ones are begun first.
    cost: float = 1.0

    @property
    def kind(self) -> str:
        """What is done: ``run``, ``onset``, ``variant``, ``modes`` or ``map``."""
        return self.name.partition("_")[0]

    @property
    def label(self) -> str:
        """The name behind the kind."""
        return self.name.partition("_")[2]

    @property
    def key(self) -> str:
        """Digest of all that decides the results: 16 hexadecimal digits."""
        code = [kernel_digest(), code_digest(self.work.__module__)]
        what = [self.kind, self.scene.to_dict(), dict(self.options)]
        return text_digest(json.dumps([*code, *what], sort_keys=True))


@functools.cache
def code_digest(module: str, root: Path = ROOT) -> str:
    """Return the fingerprint of a module and of what it imports from the study and the analysis.

    The kernels have their own, `studies.fingerprint.kernel_digest`; what starts and keeps the work
    has no part in the figures.
    """
    follow = ("studies.paper", "studies.kirchhoff", "swim_env.analysis")
    return files_digest(with_imports(module, follow, ("studies.paper.units",), root), root)


def unit_store(folder: str | os.PathLike[str]) -> Store:
    """Return the store of units in a folder of results."""
    return Store(Path(folder) / "units" / "units.jsonl", lambda record: record["name"])


def done_units(units: Sequence[Unit], store: Store) -> dict[str, Record]:
    """Return the records of those units that are there and up to date, by name."""
    found = {}
    for unit in units:
        record = store.get(unit.name)
        if record is not None and record.get("key") == unit.key:
            found[unit.name] = record
    return found


def do_units(
    units: Sequence[Unit],
    store: Store,
    workers: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> int:
    """Do what has not been done, side by side, and keep each result as soon as it is there.

    There are as many ``workers`` as processors unless given. ``progress`` is called with 1 after
    every unit, and with the number of those that were there. Returns how many units were done now;
    a SwimError if one cannot be done or kept: those that were done by then are kept.
    """
    done = done_units(units, store)
    missing = sorted((u for u in units if u.name not in done), key=lambda unit: -unit.cost)
    if progress is not None and done:
        progress(len(done))
    if not missing:
        return 0
    # The code that is loaded now counts, even if the checkout changes in the meantime.
    origin = where_and_when()
    load_kernels()
    with closing(_results(missing, workers or os.cpu_count() or 1)) as results:
        for unit, (figures, arrays) in results:
            record = {
                "name": unit.name,
                "key": unit.key,
                "kind": unit.kind,
                "commit": origin["commit"],
                "date": origin["date"],
                "arrays": bool(arrays),
                "figures": figures,
            }
            store.add(record, arrays)
            if progress is not None:
                progress(1)
    store.tidy()
    return len(missing)


def _results(
    units: Sequence[Unit], workers: int
) -> Generator[tuple[Unit, tuple[Figures, Arrays]], None, None]:
    if workers == 1:
        for unit in units:
            yield unit, unit.work(unit)
        return
    calls = [(unit.work, (unit,)) for unit in units]
    advice = "what was done is kept, start again to continue"
    with closing(in_fresh_processes(calls, workers, load_kernels, advice)) as results:
        for index, found in results:
            yield units[index], found
