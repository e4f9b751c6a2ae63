"""The stored results of the hard cases belong to the kernels that are here."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from studies.fingerprint import kernel_digest
from studies.stability.cases import CASES, hard_runs
from studies.stability.report import failures_of, stability_tables

FOLDER = Path(__file__).parents[2] / "docs" / "stability"


def _stored() -> dict[str, Any]:
    found: dict[str, Any] = json.loads((FOLDER / "stability.json").read_text(encoding="utf-8"))
    return found


def test_the_kernels_have_not_changed_since_the_last_full_run() -> None:
    assert _stored()["kernels"] == kernel_digest(), (
        "the kernels, or swim_env/sim/batch.py, have changed since docs/stability was measured: "
        "run make stability and keep its results"
    )


def test_the_stored_run_was_a_full_one_in_which_all_was_right() -> None:
    stored = _stored()
    assert failures_of(stored) == []
    labels = [(run.case, run.label) for run in hard_runs()]
    assert [(run["case"], run["label"]) for run in stored["runs"]] == labels
    assert set(CASES) == {run["case"] for run in stored["runs"]}
    assert stored["drawn"]["count"] >= 100_000
    assert len(stored["onsets"]) == 12
    assert stored["date"] and stored["commit"] and not stored["commit"].endswith("+")


def test_the_tables_are_made_of_the_stored_run() -> None:
    assert (FOLDER / "tables.md").read_text(encoding="utf-8") == stability_tables(_stored())
