"""The list of stored studies, and which of them are stale."""

import json
from pathlib import Path

from studies import release
from swim_env.accuracy.settings import PAPER_SETTINGS
from tests.support import call_script


def test_studies_are_stale_where_their_code_is_not_the_present_one(tmp_path, monkeypatch):
    kept = {"kernels": "stored", "commit": "0123456", "cases": {}, "references": {}}
    for name in ("stability", "benchmark", "references", "study", "sweeps", "held_out"):
        (tmp_path / f"{name}.json").write_text(json.dumps(kept), encoding="utf-8")
    problem_of = {Path(one.place).name: one.problem for one in release.STORED}
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
