"""Contests of bodies in space: figures of all seeds, the command, its tables and pictures."""

import csv
import json
import math
from typing import Any

import numpy as np
import pytest
from swim_agents.comparison.contest import _spatial_medians, entries_of, hold_contest
from swim_agents.comparison.report import SPATIAL_CONTEST_FILES, as_markdown, as_text

from swim_env import load_scene
from tests.support import assert_is_a_picture, call_script

#: A body whose finer computation, with panels on every shape, is quick.
QUICK = (
    "beam.elements=5",
    "fluid.model=frozen",
    "fluid.around=8",
    "fluid.rows=1",
    "actuation.wave=helical_right",
)


@pytest.fixture(scope="module")
def record() -> dict[str, Any]:
    scene = load_scene("eel_3d", [*QUICK, "episode.duration=1.0"])
    contest = hold_contest(scene, entries_of(["zero", "random"], scene), [3, 4])
    found: dict[str, Any] = json.loads(json.dumps(contest.record, allow_nan=False))
    return found


def test_medians_are_those_of_the_starts(record):
    wave = record["policies"]["paper_wave"]
    gaits, median = wave["gait"], wave["median"]["gait"]
    for name in ("frequency", "yaw_rms", "handedness", "roll_rate", "torsion", "forward_speed"):
        assert median[name] == pytest.approx(np.median([one[name] for one in gaits]))
    for axis in ("pitch", "yaw"):
        shares = [one[axis]["travelling_share"] for one in gaits]
        assert median[axis]["travelling_share"] == pytest.approx(np.median(shares))
        assert wave["median"]["wave"][axis]["amplitude"] == pytest.approx(3.0, rel=1e-3)
    assert wave["median"]["wave"]["roll"] is None or gaits[0]["roll"] is not None
    assert median["body"]["whirl"] == pytest.approx(
        np.median([one["body"]["whirl"] for one in gaits])
    )
    # A right-handed wave, which turns the body about +d3.
    assert min(median["body"]["whirl"], median["handedness"]) > 0.5 and median["roll_rate"] > 0.5


def test_the_fluids_model_is_a_source_of_error(record):
    wave = record["policies"]["paper_wave"]
    assert wave["largest_change"]["model"] == max(wave["model_change"], key=abs) != 0.0
    assert wave["panels_change"] == wave["ends_change"] == [None, None]
    assert wave["largest_change"]["panels"] is None
    mass = load_scene("eel_3d", QUICK).mass
    for work, net, cost in zip(
        wave["positive_work"], wave["net_displacement"], wave["cost_of_transport"], strict=True
    ):
        assert cost == pytest.approx(work / (mass * net)) if net > 0.0 else cost is None


def test_planes_at_the_edge_have_a_median_there():
    plain = dict.fromkeys(("major", "minor", "ratio", "whirl"), 0.0)
    names = ("frequency", "pitch_rms", "yaw_rms", "roll_rms", "handedness", "torsion")
    rest = dict.fromkeys((*names, "roll_rate", "roll_swing", "forward_speed"), 0.0)
    rest |= dict.fromkeys(("pitch", "yaw", "roll"))
    for angles, median in (
        ((1.5, -1.5, 1.56), 1.56),
        ((0.1, -0.2, 0.3), 0.1),
        ((1.55, -1.55), 0.5 * math.pi),
    ):
        gaits = [{**rest, "body": {**plain, "angle": angle}} for angle in angles]
        found = _spatial_medians(gaits)["body"]["angle"]
        assert math.sin(found - median) == pytest.approx(0.0, abs=1e-9)
    nothing = _spatial_medians([])
    assert nothing["frequency"] is nothing["body"]["angle"] is nothing["yaw"]["wave_number"] is None


def test_tables_have_the_figures_of_space(record):
    text = as_text(record)
    lines = {line.split("  ")[0]: line.split() for line in text.splitlines()}
    for name in ("handedness", "roll rate (rad/s)", "yaw: lag (rad/BL)", "pitch: explained"):
        assert name in lines
    whirl = record["policies"]["paper_wave"]["median"]["gait"]["body"]["whirl"]
    assert lines["whirl"][1] == f"{whirl:+.2f}"
    assert "by finer panels" not in text and "by panels on every shape" in lines
    page = as_markdown(record)
    assert "the *handedness* is 1 for right-handed" in page and "](bending.png)" in page
    assert "panels on sides and ends" not in page
    for name in record["policies"]:
        assert page.count(f"| {name} |") == 4  # scores, changes, gaits and axes


@pytest.mark.slow
def test_the_command_writes_its_folder_and_records_targets(tmp_path, capsys):
    folder, file = tmp_path / "out", tmp_path / "x.rrd"
    brief = ("--scene", "eel_3d", "--set", *QUICK, "--policies", "zero", "--seeds", "3")
    brief += ("--task", "target", "--duration", "0.5", "--output", folder, "--record", file)
    done = call_script(capsys, "compare", *brief, "--json")
    figures = done.figures()
    assert {one.name for one in folder.iterdir()} == set(SPATIAL_CONTEST_FILES)
    assert json.loads((folder / "comparison.json").read_text(encoding="utf-8")) == figures
    for name in SPATIAL_CONTEST_FILES:
        if name.endswith(".png"):
            assert_is_a_picture(folder / name)
    with open(folder / "comparison.csv", newline="", encoding="utf-8") as table:
        rows = list(csv.DictReader(table))
    change = figures["policies"]["paper_wave"]["model_change"][0]
    assert float(rows[0]["model_change"]) == change
    assert figures["policies"]["paper_wave"]["success"] == [False]
    assert file.stat().st_size > 10_000
