"""The gallery's command: the page, its pictures, their numbers, bad input."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from swim_agents.commands.command_line import BAD_INPUT, run

from scripts.gallery import main
from studies.gallery import page as gallery
from studies.gallery.page import GALLERY_FILES
from studies.gallery.runs import FORWARD, FULL, QUICK, play_all, stored_curves
from swim_env import OptionError

ROOT = Path(__file__).parents[2]
PICTURES = [name for name in GALLERY_FILES if name.endswith(".png")]

Made = tuple[dict[str, object], Path]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """One run of the command, quick."""
    place = tmp_path_factory.mktemp("gallery")
    done = subprocess.run(
        [sys.executable, str(ROOT / "scripts" / "gallery.py"), "--quick", "--json"]
        + ["--output", "docs/gallery", "--seed", "7"],
        capture_output=True,
        text=True,
        cwd=place,
        timeout=250,
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    return json.loads(done.stdout.splitlines()[-1]), place / "docs"


def test_the_folder_holds_pictures_and_figures(made: Made) -> None:
    record, place = made
    assert sorted(path.name for path in place.iterdir()) == ["gallery", "gallery.md"]
    assert sorted(path.name for path in (place / "gallery").iterdir()) == sorted(GALLERY_FILES)
    text = (place / "gallery" / "gallery.json").read_text(encoding="utf-8")
    assert json.loads(text) == record
    assert record["seed"] == 7
    assert record["duration"] == QUICK.duration
    assert record["policies"].keys() == set(FORWARD)
    for rows in record["policies"].values():
        assert [row["strength"] for row in rows] == list(QUICK.strengths)
        assert all(np.isfinite(row["net_displacement"]) for row in rows)


@pytest.mark.parametrize("name", PICTURES)
def test_pictures_fit_a_page(made: Made, name: str) -> None:
    record, place = made
    path = place / "gallery" / name
    assert path.stat().st_size == record["pictures"][name] < 200_000
    with Image.open(path) as picture:
        assert picture.format == "PNG"
        width, height = picture.size
        pixels = np.asarray(picture.convert("L"))
    assert width == 1200
    assert 400 < height < 1500
    assert 0.01 < (pixels < 245).mean() < 0.9


def test_the_page_shows_every_picture_and_says_what_it_was_made_of(made: Made) -> None:
    record, place = made
    text = (place / "gallery.md").read_text(encoding="utf-8")
    for name in PICTURES:
        assert text.count(f"](gallery/{name})") == 1
    assert "python scripts/gallery.py --quick --seed 7 --output docs/gallery" in text
    assert "These runs are short" in text
    assert str(record["date"]) in text
    assert str(record["commit"] or "unknown")[:10] in text
    assert "`swimmer`, 1.2 s" in text
    for name, rows in record["policies"].items():
        assert f"| `{name}` | {rows[-1]['net_displacement']:.3f} BL |" in text
    assert "{" not in text


def test_figures_are_those_of_an_episode(made: Made) -> None:
    """The run at full strength is the one that replay plays with the same seed."""
    from swim_agents.replay import replay_episode

    record, _ = made
    scene = QUICK.scene()
    for name in ("tuned_wave", "ppo_forward"):
        _, _, summary = replay_episode(scene, name, seed=7)
        row = record["policies"][name][-1]
        assert row["net_displacement"] == pytest.approx(summary["net_displacement"], abs=1e-9)
        assert row["positive_work"] == pytest.approx(summary["positive_work"], rel=1e-9)


def test_progress_comes_to_what_was_announced() -> None:
    told: list[float] = []
    plan = replace(QUICK, duration=0.1, paper_duration=0.1, strengths=(1.0,))
    runs = play_all(plan, told.append)
    assert sum(told) == pytest.approx(plan.seconds())
    assert runs.forward["paper_wave"].trajectory.duration == pytest.approx(0.1)


def test_curves_of_all_training_seeds_are_there() -> None:
    forward, target = stored_curves()
    assert {name: len(curves) for name, curves in forward.items()} == {
        "ppo_forward": 3,
        "sac_forward": 3,
    }
    assert len(target["ppo_target"]) == 1


# ---- bad input ---------------------------------------------------------------------------------


def _a_file(place: Path) -> None:
    (place / "out").write_text("mine", encoding="utf-8")


def _a_folder_of_others(place: Path) -> None:
    (place / "out").mkdir()
    (place / "out" / "mine.txt").write_text("mine", encoding="utf-8")


def _a_folder_for_the_page(place: Path) -> None:
    (place / "out.md").mkdir()


@pytest.mark.parametrize(
    ("prepare", "told"),
    [
        (_a_file, "this is a file"),
        (_a_folder_of_others, "holds other files"),
        (_a_folder_for_the_page, "this is a folder"),
    ],
)
def test_places_that_cannot_be_used_are_told_at_once(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    prepare: Callable[[Path], None],
    told: str,
) -> None:
    monkeypatch.setattr(gallery, "play_all", lambda *_: pytest.fail("was played"))
    prepare(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    assert run(main, ["--quick", "--output", str(tmp_path / "out")]) == BAD_INPUT
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert told in lines[0]
    assert sorted(tmp_path.rglob("*")) == before


def test_a_negative_seed_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(main, ["--seed", "-1", "--output", str(tmp_path / "out")]) == BAD_INPUT
    assert (
        capsys.readouterr().err == "error: the seed must be a whole number of at least 0, got -1\n"
    )
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(OptionError, match="got -5"):
        replace(FULL, seed=-5)
