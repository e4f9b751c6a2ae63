"""The comparison command: its line of figures, its folder, bad input."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from swim_agents.comparison.contest import REFERENCES
from swim_agents.comparison.report import CONTEST_FILES

from tests.support import Done, assert_is_a_picture, call_script, files_of, run_script

#: Enough for a gait, and for little else.
BRIEF = ("--policies", "zero", "--seeds", "3", "1", "--duration", "0.5")
PLAYERS = [*REFERENCES, "zero"]
PICTURES = [name for name in CONTEST_FILES if name.endswith(".png")]
Finished = tuple[Done, Path]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    """One run of the command from a folder of its own."""
    place = tmp_path_factory.mktemp("comparison")
    done = run_script("compare", *BRIEF, "--json", "--output", "out/here", cwd=place)
    return done, place / "out" / "here"


# ---- the figures -------------------------------------------------------------------------------


def test_the_last_line_is_one_object_with_the_figures(finished):
    done, folder = finished
    record = done.figures()
    assert record.keys() >= {"scene", "seeds", "policies", "net_displacement", "ratios"}
    assert (record["scene"], record["seeds"], record["duration"]) == ("swimmer", [3, 1], 0.5)
    assert list(record["policies"]) == list(record["net_displacement"]) == PLAYERS
    for name in PLAYERS:
        scores = record["net_displacement"][name]
        assert record["policies"][name]["net_displacement"] == scores
        assert len(scores) == 2 and np.isfinite(scores).all()
        assert record["ratios"][name].keys() == set(REFERENCES)
    assert "results are in out/here" in done.err
    assert "Traceback" not in done.err
    assert sorted(path.name for path in folder.iterdir()) == sorted(CONTEST_FILES)
    assert [path.name for path in folder.parent.iterdir()] == ["here"]
    assert json.loads((folder / "comparison.json").read_text(encoding="utf-8")) == record


def test_the_table_has_a_row_for_each_policy_and_seed(finished):
    done, folder = finished
    policies = done.figures()["policies"]
    with open(folder / "comparison.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    starts = [(name, i, seed) for name in PLAYERS for i, seed in enumerate(("3", "1"))]
    for row, (name, i, seed) in zip(rows, starts, strict=True):
        assert (row["policy"], row["seed"]) == (name, seed)
        figures = ("net_displacement", "fine_displacement", "closed_displacement", "ends_change")
        for figure in (*figures, "positive_work", "speed"):
            assert float(row[figure]) == policies[name][figure][i]
        assert row["verified"] == str(policies[name]["verified"][i])


def test_the_page_names_every_policy_and_shows_every_picture(finished):
    _, folder = finished
    page = (folder / "comparison.md").read_text(encoding="utf-8")
    for name in PLAYERS:
        assert page.count(f"| {name} |") == 3  # scores, changes and gaits
    for name in CONTEST_FILES:
        assert (f"]({name})" in page) == (name in PICTURES)
    for name in PICTURES:
        assert_is_a_picture(folder / name)
    assert "seeds 3, 1" in page


def test_the_tables_are_text_without_json(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    brief = ("--policies", "zero", "--seeds", "2", "--duration", "0.1")
    text = call_script(capsys, "compare", *brief).out
    assert "Scene swimmer, task forward, 0.1 s, medians over 1 start (seeds 2)" in text
    lines = text.splitlines()
    head = next(line for line in lines if line.startswith("policy"))
    assert head.split() == ["policy", *PLAYERS]
    verified = next(line for line in lines if line.startswith("verified"))
    assert verified.count(" of 1") == 3
    assert max(map(len, lines)) <= 120
    assert list(tmp_path.iterdir()) == []


# ---- the folder --------------------------------------------------------------------------------


def test_a_second_run_replaces_the_first(tmp_path, capsys):
    folder = tmp_path / "out"
    brief = ("--policies", "zero", "--output", folder, "--json", "--task")
    first = call_script(
        capsys, "compare", *brief, "target", "--seeds", "5", "--duration", "0.1"
    ).figures()
    before = files_of(folder)
    assert json.loads(before["comparison.json"]) == first
    # The shortest episode, one action, in which only the references move.
    rest = ("--seeds", "6", "7", "--duration", "0.02", "--noise", "0")
    second = call_script(capsys, "compare", *brief, "forward", *rest).figures()
    after = files_of(folder)
    assert after.keys() == before.keys() == set(CONTEST_FILES)
    assert json.loads(after["comparison.json"]) == second
    assert (first["seeds"], first["noise"], first["task"]) == ([5], 1.0, "target")
    assert (second["seeds"], second["noise"], second["task"]) == ([6, 7], 0.0, "forward")
    for name in CONTEST_FILES:
        assert after[name] != before[name], name
    for name in PICTURES:
        (tmp_path / name).write_bytes(before[name])
        for path in (tmp_path / name, folder / name):
            assert_is_a_picture(path)


# ---- bad input ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["--policies", "tuned_wav"], "unknown policy 'tuned_wav' (nearest: tuned_wave)"),
        (["--policies", "no/such.zip"], "no such model file: no/such.zip"),
        (["--task", "tagret"], "unknown task 'tagret'"),
        (["--task", "path", "--task-option", "width=0"], "width must be above 0"),
        (["--seeds", "1", "2", "1"], "seeds must be different"),
        (["--scene", "paper_one"], "unknown scene 'paper_one'"),
        (["--set", "beam.elemnts=3"], "beam.elemnts"),
        (["--duration", "0"], "episode.duration must be above 0"),
        (["--duration", "1e300"], "episode.duration must be at most"),
        (["--noise", "-1"], "noise must be"),
        (["--noise", "nan"], "noise must be"),
    ],
)
def test_bad_input_is_one_line_and_code_2_and_writes_nothing(arguments, part, tmp_path, capsys):
    brief = ("--policies", "zero", "--duration", "0.1", "--json", "--output", tmp_path / "out")
    call_script(capsys, "compare", *brief, *arguments).assert_refused(part)
    assert list(tmp_path.iterdir()) == []
