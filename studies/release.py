"""Which stored studies were made with other code than the present one, and what renews them."""

from __future__ import annotations

import io
import json
import subprocess
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from studies.accuracy.grid import full_grid, study_scenes
from studies.accuracy.study import Study, case_digest
from studies.fingerprint import ROOT, kernel_digest
from studies.paper.suite import all_units
from studies.paper.units import done_units, unit_store
from swim_env.accuracy.settings import Settings

__all__ = ["STORED", "Stored", "kernels_at"]


class Stored(NamedTuple):
    """Results of a study that are kept under docs."""

    #: The file or folder below docs.
    place: str
    #: What computes them again, and roughly how long that takes on two cores.
    command: str
    duration: str
    #: Why they are stale, empty where they are not; a function of their path.
    problem: Callable[[Path], str]


def kernels_at(commit: str) -> str | None:
    """Return the kernels' fingerprint at a commit.

    Parameters
    ----------
    commit : str
        Its hash; a ``+`` behind it, for a checkout with changes, does not count.

    Returns
    -------
    str or None
        None where the repository does not have the commit, or its kernels were in other files.
    """
    command = ["git", "-C", str(ROOT), "archive", "--format=zip", commit.rstrip("+"), "swim_env"]
    try:
        done = subprocess.run(command, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    with tempfile.TemporaryDirectory() as folder:
        with zipfile.ZipFile(io.BytesIO(done.stdout)) as archive:
            archive.extractall(folder)
        try:
            return kernel_digest(Path(folder))
        except FileNotFoundError:
            return None


def _read(file: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return found


def _by_commit(file: Path) -> str:
    commit = _read(file)["commit"]
    same = commit is not None and kernels_at(commit) == kernel_digest()
    return "" if same else f"kernels changed since {str(commit)[:7]}"


def _by_kernels(file: Path) -> str:
    return "" if _read(file)["kernels"] == kernel_digest() else "kernels changed"


def _by_keys(folder: Path) -> str:
    units = all_units()
    stale = len(units) - len(done_units(units, unit_store(folder)))
    return f"{stale} of {len(units)} units changed" if stale else ""


def _by_runs(folder: Path) -> str:
    study = Study(folder, study_scenes(), full_grid())
    done = {(run["case"], Settings.from_dict(run)) for run in study.store.records}
    wanted = [(case_digest(case), one) for case in study.cases for one in study.grid]
    missing = sum(run not in done for run in wanted)
    if missing:
        return f"{missing} of {len(wanted)} runs changed"
    files = [folder / f"{name}.json" for name in ("references", "study", "sweeps", "held_out")]
    return next(filter(None, map(_by_commit, files)), "")


#: What `scripts/release.py` looks at.
STORED = (
    Stored("stability/stability.json", "make stability", "45 min", _by_kernels),
    Stored("paper", "make paper", "15 min", _by_keys),
    Stored("accuracy", "make accuracy", "25 min", _by_runs),
    Stored(
        "accuracy/effects.json",
        "scripts/benchmark.py --only effects --rounds 201 --json",
        "20 s",
        _by_commit,
    ),
    Stored("benchmark/benchmark.json", "make benchmark", "4 min", _by_commit),
    Stored("gallery/gallery.json", "make gallery", "some min", _by_commit),
    Stored(
        "comparison/comparison.json",
        "scripts/train.py and scripts/compare.py",
        "30 min",
        _by_commit,
    ),
)
