"""The list of stored studies, and which of them are stale."""

from __future__ import annotations

import json

import pytest

from studies import release
from tests.support import ROOT, call_script

DOCS = ROOT / "docs"


def test_studies_are_stale_where_their_code_is_not_the_present_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem_of = {one.place: one.problem for one in release.STORED}
    kept = json.loads((DOCS / "stability" / "stability.json").read_text(encoding="utf-8"))
    monkeypatch.setattr(release, "kernels_at", lambda commit: "as at all commits")
    for digest, stale in ((kept["kernels"], (0, 1, 1)), ("as at all commits", (1, 0, 0))):
        monkeypatch.setattr(release, "kernel_digest", lambda digest=digest: digest)
        for place, is_stale in zip(
            ("stability/stability.json", "benchmark/benchmark.json", "accuracy"), stale, strict=True
        ):
            assert bool(problem_of[place](DOCS / place)) == is_stale, place


def test_the_command_lists_all_of_them(capsys: pytest.CaptureFixture[str]) -> None:
    found = call_script(capsys, "release", "--json").figures()["studies"]
    assert [row["study"] for row in found] == [f"docs/{one.place}" for one in release.STORED]
    assert all(row["state"] and row["command"] and row["duration"] for row in found)


def test_a_commit_that_is_not_there_counts_as_another() -> None:
    assert release.kernels_at("0" * 40) is None
