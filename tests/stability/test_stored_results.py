"""The stored results of the hard cases: a full run in which all was right, and its tables."""

import json

import pytest

from studies.fingerprint import kernel_digest
from studies.stability.cases import hard_runs
from studies.stability.report import failures_of, stability_tables
from tests.support import ROOT

FOLDER = ROOT / "docs" / "stability"
pytestmark = pytest.mark.release
STORED = json.loads((FOLDER / "stability.json").read_text(encoding="utf-8"))


def test_the_kernels_have_not_changed_since_the_last_full_run():
    assert STORED["kernels"] == kernel_digest(), (
        "the kernels, or swim_env/sim/batch.py, have changed since docs/stability was measured: "
        "run make stability and keep its results"
    )


def test_the_stored_run_was_a_full_one_in_which_all_was_right():
    assert failures_of(STORED) == []
    labels = [(run.case, run.label) for run in hard_runs()]
    assert [(run["case"], run["label"]) for run in STORED["runs"]] == labels
    assert STORED["drawn"]["count"] >= 100_000 and len(STORED["onsets"]) == 12
    assert STORED["date"] and STORED["commit"] and not STORED["commit"].endswith("+")


def test_the_tables_are_made_of_the_stored_run():
    assert (FOLDER / "tables.md").read_text(encoding="utf-8") == stability_tables(STORED)
