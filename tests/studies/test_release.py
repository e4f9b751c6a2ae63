"""The list of stored studies, which of them are stale, and what a release checks of them."""

import json
from pathlib import Path

import pytest

from studies import release
from studies.stability.cases import hard_runs
from studies.stability.report import failures_of, stability_tables
from swim_env.accuracy.settings import PAPER_SETTINGS
from tests.support import ROOT, call_script

DOCS = ROOT / "docs"
PROBLEM_OF = {one.place: one.problem for one in release.STORED}


def test_studies_are_stale_where_their_code_is_not_the_present_one(tmp_path, monkeypatch):
    kept = {"kernels": "stored", "commit": "0123456", "cases": {}, "references": {}}
    for name in ("stability", "benchmark", "references", "study", "sweeps", "held_out"):
        (tmp_path / f"{name}.json").write_text(json.dumps(kept), encoding="utf-8")
    problem_of = {Path(place).name: problem for place, problem in PROBLEM_OF.items()}
    monkeypatch.setattr(release, "kernels_at", lambda commit: f"as at {commit}")
    for kernels, grid, stale in (
        ("stored", [], [False, True, True]),
        ("as at 0123456", [], [True, False, False]),
        ("as at 0123456", [PAPER_SETTINGS], [True, False, True]),
    ):
        monkeypatch.setattr(release, "kernel_digest", lambda kernels=kernels: kernels)
        monkeypatch.setattr(release, "full_grid", lambda grid=grid: grid)
        places = {name: tmp_path / name for name in ("stability.json", "benchmark.json")}
        places["accuracy"] = tmp_path
        assert [bool(problem_of[name](place)) for name, place in places.items()] == stale


def test_the_command_lists_all_of_them(capsys):
    found = call_script(capsys, "release", "--json").figures()["studies"]
    assert [row["study"] for row in found] == [f"docs/{one.place}" for one in release.STORED]
    assert all(row["state"] and row["command"] and row["duration"] for row in found)


def test_a_commit_that_is_not_there_counts_as_another():
    assert release.kernels_at("0" * 40) is None


@pytest.mark.release
@pytest.mark.parametrize("place", ["stability/stability.json", "paper"])
def test_stored_results_belong_to_the_present_code(place):
    assert not PROBLEM_OF[place](DOCS / place)


@pytest.mark.release
def test_the_stored_hard_cases_are_a_full_run_in_which_all_was_right():
    stored = json.loads((DOCS / "stability" / "stability.json").read_text(encoding="utf-8"))
    assert failures_of(stored) == []
    labels = [(run.case, run.label) for run in hard_runs()]
    assert [(run["case"], run["label"]) for run in stored["runs"]] == labels
    assert stored["drawn"]["count"] >= 100_000 and len(stored["onsets"]) == 12
    assert stored["date"] and stored["commit"] and not stored["commit"].endswith("+")
    tables = (DOCS / "stability" / "tables.md").read_text(encoding="utf-8")
    assert tables == stability_tables(stored)
