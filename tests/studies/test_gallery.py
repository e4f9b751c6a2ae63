"""The gallery's command: the page, its pictures, their numbers, bad input."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from swim_agents.replay import replay_episode

from studies.gallery import page as gallery
from studies.gallery.page import GALLERY_FILES
from studies.gallery.runs import FORWARD, QUICK, play_all, stored_curves
from tests.support import assert_is_a_picture, call_script, run_script

PICTURES = [name for name in GALLERY_FILES if name.endswith(".png")]

Made = tuple[dict[str, Any], Path]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """One run of the command, quick."""
    place = tmp_path_factory.mktemp("gallery")
    arguments = ("--quick", "--json", "--output", "docs/gallery", "--seed", "7")
    return run_script("gallery", *arguments, cwd=place).figures(), place / "docs"


def test_the_folder_holds_pictures_and_figures(made):
    record, place = made
    assert sorted(path.name for path in place.iterdir()) == ["gallery", "gallery.md"]
    assert sorted(path.name for path in (place / "gallery").iterdir()) == sorted(GALLERY_FILES)
    assert json.loads((place / "gallery" / "gallery.json").read_text(encoding="utf-8")) == record
    assert (record["seed"], record["duration"]) == (7, QUICK.duration)
    assert record["policies"].keys() == set(FORWARD)
    for rows in record["policies"].values():
        assert [row["strength"] for row in rows] == list(QUICK.strengths)
        assert all(np.isfinite(row["net_displacement"]) for row in rows)


@pytest.mark.parametrize("name", PICTURES)
def test_pictures_fit_a_page(made, name):
    record, place = made
    path = place / "gallery" / name
    assert path.stat().st_size == record["pictures"][name] < 200_000
    assert_is_a_picture(path)
    with Image.open(path) as picture:
        assert picture.width == 1200 and 400 < picture.height < 1500


def test_the_page_shows_every_picture_and_says_what_it_was_made_of(made):
    record, place = made
    text = (place / "gallery.md").read_text(encoding="utf-8")
    for name in PICTURES:
        assert text.count(f"](gallery/{name})") == 1
    assert "python scripts/gallery.py --quick --seed 7 --output docs/gallery" in text
    assert "These runs are short" in text and "`swimmer`, 1.2 s" in text
    assert str(record["date"]) in text and str(record["commit"] or "unknown")[:10] in text
    for name, rows in record["policies"].items():
        assert f"| `{name}` | {rows[-1]['positive_work']:.3g} J |" in text
    assert "{" not in text


def test_figures_are_those_of_an_episode(made):
    """The run at full strength is the one that replay plays with the same seed."""
    record, _ = made
    for name in ("tuned_wave", "ppo_forward"):
        _, _, summary = replay_episode(QUICK.scene(), name, seed=7)
        row = record["policies"][name][-1]
        assert row["net_displacement"] == pytest.approx(summary["net_displacement"], abs=1e-9)
        assert row["positive_work"] == pytest.approx(summary["positive_work"], rel=1e-9)


def test_progress_comes_to_what_was_announced():
    shares: list[float] = []
    plan = replace(QUICK, duration=0.1, paper_duration=0.1, strengths=(1.0,))
    runs = play_all(plan, shares.append)
    assert sum(shares) == pytest.approx(1.0)
    assert runs.forward["paper_wave"].trajectory.duration == pytest.approx(0.1)


def test_curves_of_all_training_seeds_are_there():
    forward, target = stored_curves()
    counts = {name: len(curves) for name, curves in (forward | target).items()}
    assert counts == {"ppo_forward": 3, "sac_forward": 3, "ppo_target": 1}


@pytest.mark.parametrize(
    ("prepare", "part"),
    [
        (lambda place: (place / "out").write_text("mine"), "this is a file"),
        (lambda place: (place / "out" / "mine.txt").mkdir(parents=True), "holds other files"),
        (lambda place: (place / "out.md").mkdir(), "this is a folder"),
        (lambda place: None, "the seed must be a whole number of at least 0, got -1"),
    ],
    ids=["a file", "others' folder", "a folder for the page", "a negative seed"],
)
def test_bad_input_is_refused_at_once(tmp_path, capsys, monkeypatch, prepare, part):
    monkeypatch.setattr(gallery, "play_all", lambda *_: pytest.fail("was played"))
    prepare(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    seed = ("--seed", "-1") if "seed" in part else ()
    done = call_script(capsys, "gallery", "--quick", "--output", tmp_path / "out", *seed)
    done.assert_refused(part)
    assert sorted(tmp_path.rglob("*")) == before
