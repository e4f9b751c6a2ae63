"""The comparison command: its line of figures, its folder, bad input."""

from __future__ import annotations

import csv
import io
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from swim_agents.commands.command_line import BAD_INPUT, run
from swim_agents.comparison.contest import REFERENCES
from swim_agents.comparison.files import CONTEST_FILES, check_contest_folder
from swim_agents.comparison.report import as_csv

from scripts.compare import main
from swim_env import SwimError

ROOT = Path(__file__).parents[2]
#: Enough for a gait, and for little else.
BRIEF = ("--policies", "zero", "--seeds", "3", "1", "--duration", "0.5")
PLAYERS = [*REFERENCES, "zero"]


def command(*arguments: str, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(ROOT / "scripts" / "compare.py"), *arguments],
        capture_output=True,
        text=True,
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        timeout=250,
    )


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def assert_is_a_picture(path: Path) -> None:
    with Image.open(path) as picture:
        assert picture.format == "PNG"
        width, height = picture.size
        pixels = np.asarray(picture.convert("RGB"))
    assert min(width, height) > 300, f"{path.name}: {width} by {height}"
    assert max(width, height) < 4000
    colours = np.unique(pixels.reshape(-1, 3), axis=0)
    assert len(colours) > 20, f"{path.name} has {len(colours)} colours"
    # More than a frame and a title: neither nearly white nor nearly full.
    inked = float((pixels.min(axis=2) < 250).mean())
    assert 0.01 < inked < 0.9, f"{path.name}: {inked:.1%} drawn on"


@pytest.fixture(scope="module")
def finished(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[subprocess.CompletedProcess[str], Path]:
    """One run of the command from a folder of its own."""
    place = tmp_path_factory.mktemp("comparison")
    done = command(*BRIEF, "--json", "--output", "out/here", cwd=place)
    return done, place / "out" / "here"


Finished = tuple[subprocess.CompletedProcess[str], Path]


# ---- the figures -------------------------------------------------------------------------------


def test_the_last_line_is_one_object_with_the_figures(finished: Finished) -> None:
    done, _ = finished
    assert done.returncode == 0, done.stderr
    record = json.loads(done.stdout.splitlines()[-1])
    assert record.keys() >= {"scene", "seeds", "policies", "net_displacement", "ratios"}
    assert record["scene"] == "swimmer"
    assert record["seeds"] == [3, 1]
    assert record["duration"] == 0.5
    assert list(record["policies"]) == list(record["net_displacement"]) == PLAYERS
    for name in PLAYERS:
        scores = record["net_displacement"][name]
        assert record["policies"][name]["net_displacement"] == scores
        assert len(scores) == 2
        assert all(isinstance(score, float) and np.isfinite(score) for score in scores)
        assert record["ratios"][name].keys() == set(REFERENCES)
        for reference in REFERENCES:
            base = np.median(record["net_displacement"][reference])
            ratio = record["ratios"][name][reference]
            if base <= 0.0:
                assert ratio is None
            else:
                assert ratio == pytest.approx(np.median(scores) / base, rel=1e-9)
    assert "results are in out/here" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_folder_holds_the_files_and_the_same_figures(finished: Finished) -> None:
    done, folder = finished
    assert sorted(path.name for path in folder.iterdir()) == sorted(CONTEST_FILES)
    assert [path.name for path in folder.parent.iterdir()] == ["here"]
    printed = json.loads(done.stdout.splitlines()[-1])
    assert json.loads((folder / "comparison.json").read_text(encoding="utf-8")) == printed
    assert (folder / "comparison.csv").read_text(encoding="utf-8") == as_csv(printed)


def test_the_table_has_a_row_for_each_policy_and_seed(finished: Finished) -> None:
    done, folder = finished
    record = json.loads(done.stdout.splitlines()[-1])
    text = (folder / "comparison.csv").read_text(encoding="utf-8")
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [(row["policy"], int(row["seed"])) for row in rows] == [
        (name, seed) for name in PLAYERS for seed in (3, 1)
    ]
    for row in rows:
        at = record["seeds"].index(int(row["seed"]))
        one = record["policies"][row["policy"]]
        for figure in ("net_displacement", "fine_displacement", "positive_work", "speed"):
            assert float(row[figure]) == one[figure][at]
        assert row["verified"] == str(one["verified"][at])


def test_the_page_names_every_policy_and_shows_every_picture(finished: Finished) -> None:
    _, folder = finished
    page = (folder / "comparison.md").read_text(encoding="utf-8")
    for name in PLAYERS:
        assert page.count(f"| {name} |") == 2  # scores and gaits
    for name in CONTEST_FILES:
        assert (f"]({name})" in page) == name.endswith(".png")
    assert "seeds 3, 1" in page


@pytest.mark.parametrize("name", [name for name in CONTEST_FILES if name.endswith(".png")])
def test_a_picture_shows_something(finished: Finished, name: str) -> None:
    assert_is_a_picture(finished[1] / name)


def test_the_tables_are_text_without_json(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(main, ["--policies", "zero", "--seeds", "2", "--duration", "0.1"]) == 0
    text = capsys.readouterr().out
    assert "Scene swimmer, task forward, 0.1 s, medians over 1 start (seeds 2)" in text
    lines = text.splitlines()
    head = next(line for line in lines if line.startswith("policy"))
    assert head.split() == ["policy", *PLAYERS]
    verified = next(line for line in lines if line.startswith("verified"))
    assert verified.count(" of 1") == 3
    assert max(map(len, lines)) <= 120
    assert list(tmp_path.iterdir()) == []


# ---- the folder --------------------------------------------------------------------------------


def test_a_second_run_replaces_the_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "out"
    first = ["--policies", "zero", "--seeds", "5", "--duration", "0.1", "--output", str(folder)]
    assert run(main, [*first, "--task", "target"]) == 0
    before = content(folder)
    assert json.loads(before["comparison.json"])["task"] == "target"
    for name in CONTEST_FILES:
        if name.endswith(".png"):
            assert_is_a_picture(folder / name)
    capsys.readouterr()
    assert run(main, [*first[:3], "6", "7", *first[4:], "--noise", "0.5", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out.splitlines()[-1])
    after = content(folder)
    assert after.keys() == before.keys() == set(CONTEST_FILES)
    assert json.loads(after["comparison.json"]) == printed
    assert printed["seeds"] == [6, 7]
    assert printed["noise"] == 0.5
    assert printed["task"] == "forward"
    for name in CONTEST_FILES:
        assert after[name] != before[name], name
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_body_at_rest_can_be_drawn(tmp_path: Path) -> None:
    # The shortest episode, an action, in which nothing moves but the references.
    folder = tmp_path / "out"
    short = ["--policies", "zero", "--seeds", "0", "--duration", "0.02", "--noise", "0"]
    assert run(main, [*short, "--output", str(folder)]) == 0
    record = json.loads((folder / "comparison.json").read_text(encoding="utf-8"))
    assert record["net_displacement"]["zero"] == [0.0]
    assert record["policies"]["tuned_wave"]["gait"] == [None]
    for name in CONTEST_FILES:
        if name.endswith(".png"):
            assert_is_a_picture(folder / name)


def test_a_folder_with_other_files_is_refused_and_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "comparison.json").write_text("{}")
    (tmp_path / "thesis.tex").write_text("dear")
    before = content(tmp_path)
    assert run(main, [*BRIEF, "--output", str(tmp_path)]) == BAD_INPUT
    assert_is_one_error(capsys, "holds other files than earlier results, for example thesis.tex")
    assert content(tmp_path) == before
    assert run(main, [*BRIEF, "--output", str(tmp_path / "thesis.tex")]) == BAD_INPUT
    assert_is_one_error(capsys, "this is a file")
    assert content(tmp_path) == before
    with pytest.raises(SwimError, match="thesis.tex"):
        check_contest_folder(tmp_path)


# ---- bad input ---------------------------------------------------------------------------------


def assert_is_one_error(capsys: pytest.CaptureFixture[str], part: str) -> None:
    out, err = capsys.readouterr()
    assert out == ""
    lines = err.splitlines()
    assert len(lines) == 1, err
    assert lines[0].startswith("error: ")
    assert part in lines[0]


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["--policies", "tuned_wav"], "unknown policy 'tuned_wav'"),
        (["--policies", "tuned_wav"], "(nearest: tuned_wave)"),
        (["--policies", "zero", "no/such/folder"], "unknown policy 'no/such/folder'"),
        (["--policies", "no/such.zip"], "no such model file: no/such.zip"),
        (["--policies", "zero", "--task", "tagret"], "unknown task 'tagret'"),
        (["--policies", "zero", "--seeds", "1", "2", "1"], "seeds must be different"),
        (["--policies", "zero", "--seeds", "1", "-2"], "at least 0"),
        (["--policies", "zero", "--scene", "paper_one"], "unknown scene 'paper_one'"),
        (["--policies", "zero", "--set", "beam.elemnts=3"], "beam.elemnts"),
        (["--policies", "zero", "--duration", "0"], "episode.duration must be above 0"),
        (["--policies", "zero", "--duration", "-1"], "episode.duration must be above 0"),
        (["--policies", "zero", "--duration", "nan"], "episode.duration must be"),
        (["--policies", "zero", "--duration", "1e300"], "episode.duration must be at most"),
        (["--policies", "zero", "--noise", "-1"], "noise must be"),
        (["--policies", "zero", "--noise", "nan"], "noise must be"),
    ],
)
def test_bad_input_is_one_line_and_code_2_and_writes_nothing(
    arguments: Sequence[str], part: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    brief = [] if "--duration" in arguments else ["--duration", "0.1"]
    code = run(main, [*arguments, *brief, "--json", "--output", str(tmp_path / "out")])
    assert code == BAD_INPUT == 2
    assert_is_one_error(capsys, part)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("arguments", [["--seeds", "one"], ["--seeds"], ["--duration", "long"]])
def test_arguments_of_another_kind_are_refused_with_the_usage(
    arguments: Sequence[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["--policies", "zero", *arguments])
    assert caught.value.code == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("usage: ")
    assert "error: argument" in err.splitlines()[-1]


def test_help_tells_the_options(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["--help"])
    assert caught.value.code == 0
    text = capsys.readouterr().out
    for word in ("--policies", "--scene", "--task", "--seeds", "--output", "--json", "tuned_wave"):
        assert word in text
