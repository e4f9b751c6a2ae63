"""The page that compares the paper's statements with ours: verdicts, resuming, the command."""

import copy
import json
import math
import os
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from studies.paper import units as units_module
from studies.paper.bars import bar_of, bar_text, coarse_error, fine_error, number_text, with_bar
from studies.paper.book import verdicts_of, write_book
from studies.paper.onset import LATERAL, PAPER_BODIES, PAPER_TIMES
from studies.paper.page import make_page
from studies.paper.runs import NUMERALS
from studies.paper.statements import STATEMENTS, find_all
from studies.paper.suite import all_units, collect
from studies.paper.units import Arrays, Figures, Unit, code_digest, do_units, done_units, unit_store
from studies.paper.verdicts import (
    AGREE,
    DIFFER,
    NOT_MEASURED,
    UNDECIDED,
    Value,
    all_of,
    at_least_one_of,
)
from swim_env import SwimError, load_scene
from tests.support import ROOT, call_script, interrupt_script, refuses

# ---- a world in which the paper is right -------------------------------------------------------

#: Displacement along x (m), turn (degrees) and length (m) of the paper's swimmers there.
SWIMMERS: dict[str, tuple[float, float, float]] = {
    "i": (-2.0, -10.0, 1.0),
    "ii": (-1.5, -10.0, 1.0),
    "iii": (-1.0, -10.0, 1.0),
    "iv": (-1.0, -180.0, 1.0),
    "v": (-6.0, -90.0, 2.0),
    "vi": (-0.3, 10.0, 1.0),
    "vii": (-0.8, 10.0, 1.0),
    "viii": (-1.0, -30.0, 1.0),
    "ix": (-0.3, 0.1, 1.0),
}


def a_run(dx: float, turn: float, length: float, stops: bool = False) -> dict[str, Any]:
    """Return figures of a run of 100 s that swims and turns steadily, or stops at 50 s."""
    share = np.linspace(0.0, 1.0, 100)
    way = np.minimum(2.0 * share, 1.0) if stops else share
    heading = np.radians(turn) * share
    path = np.stack([dx * way, np.zeros(100)], axis=1)
    return {
        "duration": 100.0,
        "steps": 10000,
        "end": "",
        "length": length,
        "path": path.tolist(),
        "heading": heading.tolist(),
        "displacement": [dx, 0.0],
        "speed": abs(dx) / 99.0,
        "way": abs(dx),
        "turn": math.radians(turn),
        "curvature": math.radians(turn) / max(abs(dx), 1e-9),
        "left": 1.0,
        "angle": np.radians(np.linspace(0.0, turn, 101)).tolist(),
        "bends": [0.02] * 8,
        "halved": 0,
        "momentum": {"drift": 1e-15, "bound": 1e-9, "share": 1e-6},
        "energy": {
            "largest": 0.1,
            "unexplained": 1e-3,
            "first": 0.0,
            "last": 1e-4,
            "work": 0.1,
            "positive_work": 10.0,
            "power": 0.1,
            "trusted": True,
        },
    }


def an_onset(elements: int, panels: int, kind: str, time: float | None, **other: Any) -> Figures:
    """Return figures of a straight body that leaves its line at a time."""
    return {
        "elements": elements,
        "panels": panels,
        "stiffness": 5.0,
        "perturbation": kind,
        "model": "panels",
        "step": 0.01,
        "duration": 300.0,
        "time": time,
        "end": "",
        "rate": 0.3,
        "kirchhoff": 0.3,
        "expected": time,
        "largest_angle": 0.0,
        "largest_offset": 0.0,
        **other,
    }


def the_papers_world() -> dict[str, Any]:
    """Return data in which every statement holds."""
    runs: dict[str, Any] = {}
    for name, swims in SWIMMERS.items():
        runs[name] = a_run(*swims, stops=name == "viii")
    half = np.array(runs["i"]["path"])[:50]
    runs["viii"]["path"] = [*half.tolist(), *[half[-1].tolist()] * 50]
    runs["ii"]["bends"] = [0.01] * 8
    runs["vi"]["bends"] = [0.001] * 4 + [0.02] * 4
    for name, turn in (("x", -180.0), ("xi", -90.0), ("xii", -90.0)):
        runs[name] = a_run(8.0, turn, 1.0)
    runs["x"]["angle"][10] = math.radians(-178.0)
    for name in NUMERALS:
        runs[f"{name}_half"] = copy.deepcopy(runs[name])
        runs[f"{name}_fine"] = copy.deepcopy(runs[name])
    runs["i_alone"] = a_run(0.0, 0.0, 1.0)
    runs["i_mirrored"] = a_run(-2.0, 10.0, 1.0)
    onset = [an_onset(n, panels, kind, time) for (n, panels, kind), time in PAPER_TIMES.items()]
    onset += [an_onset(27, 12, kind, PAPER_TIMES[27, 4, kind] * 0.999) for kind in LATERAL]
    onset += [
        an_onset(n, panels, kind, time, stiffness=1e4)
        for (n, panels, kind), time in PAPER_TIMES.items()
    ]
    onset += [
        an_onset(n, panels, "none", None, duration=100.0, rate=None)
        for n, panels in (PAPER_BODIES["x"], PAPER_BODIES["xi"])
    ]
    onset += [{**one, "step": 0.005} for one in onset if one["stiffness"] == 5.0]
    modes = {"frequencies": [5.0, 15.0, 30.0], "fine": [5.0, 15.0, 30.0], "highest": 260.0}
    orders = {"elements": [9, 18, 36], "errors": [0.04, 0.01, 0.0025], "order": 2.0, "before": 2.0}
    return {
        "runs": runs,
        "onset": onset,
        "variants": {},
        "modes": {"i": {**modes, "orders": orders}, "v": modes},
        "maps": {},
        "settings": {},
        "commits": ["0" * 40],
        "dates": ["2020-01-01"],
        "units": 1,
        "done": 1,
    }


def verdicts(data: dict[str, Any]) -> dict[str, str]:
    return {statement.key: finding.verdict for statement, finding in find_all(data)}


def test_in_the_papers_world_everything_agrees():
    found = verdicts(the_papers_world())
    # That steps are large can be measured here, and the comparison with other schemes cannot.
    assert found.pop("steps") == UNDECIDED
    assert {key: verdict for key, verdict in found.items() if verdict != AGREE} == {}


def _set(name: str, **changes: Any) -> Any:
    """Return a change of a run and its finer ones."""

    def change(data: dict[str, Any]) -> None:
        for level in ("", "_half", "_fine"):
            if f"{name}{level}" in data["runs"]:
                data["runs"][f"{name}{level}"].update(copy.deepcopy(changes))

    return change


def _swims(name: str, dx: float, turn: float | None = None) -> Any:
    _, usual, length = SWIMMERS[name]
    return _set(name, **a_run(dx, usual if turn is None else turn, length))


def _onsets(**changes: Any) -> Any:
    """Return a change of all onsets with some settings, ``where``, by a factor of their time."""
    where, factor = changes.pop("where", {}), changes.pop("factor", 1.0)

    def change(data: dict[str, Any]) -> None:
        for one in data["onset"]:
            if all(one[key] == value for key, value in where.items()):
                one.update(changes)
                if one["time"] is not None:
                    one["time"] *= factor

    return change


#: A change of the paper's world for every statement, after which it does not hold.
WRONG: dict[str, Any] = {
    "order": lambda data: data["modes"]["i"]["orders"].update(order=1.0, before=1.0),
    "momentum": _set("iv", momentum={"drift": 1e-8, "bound": 1e-9, "share": 10.0}),
    "energy": lambda data: data["runs"]["vi"]["energy"].update(last=0.2),
    "steps": lambda data: data["modes"]["i"].update(highest=10.0),
    "i-iii left": _swims("ii", 1.5),
    "i-iii curve": _swims("ii", -1.5, 0.1),
    "i-iii alike": _swims("ii", -1.5, 0.1),
    "nontrivial": lambda data: [_swims(name, -0.5)(data) for name in ("ii", "iii")],
    "i fastest": _swims("ii", -3.0),
    "ii slower": _set("ii", bends=[0.05] * 8),
    "iii slower": _swims("iii", -1.6),
    "iv less stable": _swims("iv", -1.0, 0.2),
    "iv semicircle": _swims("iv", -1.0, -20.0),
    "v quadrant": _swims("v", -6.0, 90.0),
    "v unlike iii": _swims("v", -6.0, -10.0),
    "v faster": _swims("v", -1.5),
    "vi-vii left": _swims("vi", 0.3),
    "vi-vii curve": _swims("vii", -0.8, -10.0),
    "vi bends": _set("vi", bends=[0.02] * 8),
    "vi slow": _swims("vi", -1.9),
    "vii faster": _swims("vii", -0.1),
    "vii bends": _set("vii", bends=[0.001] * 4 + [0.02] * 4),
    "head matters": _set("vii", bends=[0.001] * 4 + [0.02] * 4),
    "viii as i": _swims("viii", -1.0),
    "viii slows": _swims("viii", -2.0),
    "viii tighter": _set("viii", heading=[0.0] * 100),
    "ix slow": _swims("ix", 0.3),
    "ix straight": _swims("ix", -0.3, 5.0),
    "equilibrium": _onsets(where={"perturbation": "none"}, largest_offset=0.5),
    "times 3 12": _onsets(where={"elements": 3}, factor=2.0),
    "times 9 4": _onsets(where={"elements": 9, "perturbation": "small"}, factor=1.2),
    "times 9 12": _onsets(where={"elements": 9, "panels": 12}, time=None),
    "times 27 4": _onsets(where={"elements": 27}, factor=0.5),
    "12 panels": _onsets(where={"elements": 9, "panels": 12}, factor=1.01),
    "27 panels": _onsets(where={"elements": 27, "panels": 12}, factor=1.1),
    "stiffness": _onsets(where={"stiffness": 1e4}, factor=1.1),
    "x turns": _set("x", angle=[0.0] * 101),
    "coarse unstable": _onsets(where={"elements": 3}, factor=3.0),
    "xi as xii": _set("xi", **a_run(8.0, 90.0, 1.0)),
    "delayed": _onsets(where={"elements": 27}, factor=0.5),
    "locomotion": _swims("i", 0.0),
    "alone": lambda data: data["runs"]["i_alone"].update(displacement=[0.1, 0.0]),
}


@pytest.mark.parametrize("key", [statement.key for statement in STATEMENTS])
def test_a_statement_can_be_found_wrong(key):
    data = the_papers_world()
    WRONG[key](data)
    assert verdicts(data)[key] == DIFFER


def test_error_bars_that_overlap_leave_an_order_undecided():
    data = the_papers_world()
    data["runs"]["i_fine"]["speed"] *= 0.5
    found = verdicts(data)
    assert found["i fastest"] == UNDECIDED
    # A ratio knows what both have in common.
    data["runs"]["ii_fine"]["speed"] *= 0.5
    data["runs"]["iii_fine"]["speed"] *= 0.5
    assert verdicts(data)["iii slower"] == AGREE


#: What is exact, or an error itself, or a count: it has no bar that could span a limit.
WITHOUT_BARS = {"momentum", "energy", "steps", "viii as i", "equilibrium", "alone"}


@pytest.mark.parametrize("key", sorted({one.key for one in STATEMENTS} - WITHOUT_BARS))
def test_a_bar_that_spans_the_limit_leaves_every_statement_undecided(key):
    """Half the step makes nonsense of all figures: nothing is known then, and nothing is said."""
    data = the_papers_world()
    for i, name in enumerate(NUMERALS):
        run, factor = data["runs"][f"{name}_half"], (-30.0, 0.1, 900.0)[i % 3]
        for field in ("speed", "turn"):
            run[field] *= factor
        run["displacement"][0] *= factor
        for field in ("path", "angle"):
            run[field] = (np.array(run[field]) * factor).tolist()
        run["heading"] = (np.array(run["heading"]) * (3.0 - factor)).tolist()
        run["bends"] = [30.0 * one for one in run["bends"][:4]] + run["bends"][4:]
    path = np.array(data["runs"]["viii_half"]["path"])
    path[52:, 0] += 20.0 * np.arange(48)
    data["runs"]["viii_half"]["path"] = path.tolist()
    for one in data["onset"]:
        if one["step"] == 0.005 and one["time"] is not None:
            one["time"] *= 30.0
    data["modes"]["i"]["orders"]["before"] = 1.0
    assert verdicts(data)[key] == UNDECIDED


@pytest.mark.parametrize(
    ("bar", "verdict"), [(0.0, AGREE), (0.9, AGREE), (1.1, UNDECIDED), (50.0, UNDECIDED)]
)
def test_one_rule_makes_verdicts(bar, verdict):
    against = {AGREE: DIFFER, UNDECIDED: UNDECIDED}[verdict]
    figure = Value(3.0, bar)
    assert figure.above(2.0) == figure.at_most(4.0) == verdict
    assert figure.above(4.0) == figure.at_most(2.0) == against
    assert figure.within(4.0, 2.0) == verdict
    assert figure.within(7.0, 3.0) == against
    assert figure.larger_than(Value(2.0, 0.0)) == verdict
    assert Value(2.0, 0.0).larger_than(figure) == against
    # A figure that is exactly the limit is not above it.
    assert Value(2.0, 0.0).above(2.0) == DIFFER
    # Parts and alternatives make one verdict.
    assert all_of([AGREE, UNDECIDED, DIFFER]) == DIFFER
    assert all_of([AGREE, UNDECIDED]) == UNDECIDED and all_of([AGREE]) == AGREE
    assert at_least_one_of([DIFFER, UNDECIDED, AGREE]) == AGREE
    assert at_least_one_of([DIFFER, UNDECIDED]) == UNDECIDED and at_least_one_of([DIFFER]) == DIFFER


def test_what_is_missing_short_or_ended_is_said_and_not_judged():
    data = the_papers_world()
    data["runs"]["v"]["end"] = "step_not_solved"
    data["runs"]["vi"]["duration"] = 5.0
    del data["runs"]["x"]
    data["onset"] = []
    findings = {statement.key: finding for statement, finding in find_all(data)}
    for key in ("v quadrant", "v faster", "vi bends", "x turns", "times 3 12", "equilibrium"):
        assert findings[key].verdict == NOT_MEASURED, key
    assert "step_not_solved" in findings["v faster"].measured
    assert "5 s" in findings["vi bends"].measured
    empty: dict[str, Any] = {"runs": {}, "onset": [], "modes": {}, "variants": {}, "maps": {}}
    assert set(verdicts(empty).values()) == {NOT_MEASURED}


# ---- the page ----------------------------------------------------------------------------------


def _page(data: dict[str, Any]) -> str:
    return make_page(data, {}, "a test")


def _kept() -> dict[str, Any]:
    """Return the kept data, whatever the kernels are by now."""
    records = {record["name"]: record for record in unit_store(ROOT / "docs" / "paper").records}
    return collect(all_units(), records)


#: What a table says besides figures of ours: settings, numbers of the paper, words.
STEADY = {
    *("the paper (in other words)", "agrees if", "why", "statement", "added mass", "start across"),
    *("N", "panels", "paper (s)", "at joint", "elements", "step (ms)", "panels an element"),
    *("at each end", "tolerance", "finer: step (ms)", "finer: panels an element, at each end"),
}


def _changed(data: Any, rng: np.random.Generator) -> Any:
    """Return data with every figure changed, each by a factor of its own, and no settings."""
    if isinstance(data, float):
        return (data + 1e-6) * rng.uniform(1.5, 3.5)
    if isinstance(data, list):
        return [_changed(one, rng) for one in data]
    if not isinstance(data, dict):
        return data
    settings = ("step", "stiffness", "duration", "length", "columns", "frequency", "settings")
    return {key: one if key in settings else _changed(one, rng) for key, one in data.items()}


def _columns(page: str) -> list[tuple[str, list[str]]]:
    """Return the columns of all tables, each with its head."""
    found = []
    for table in re.findall(r"(?:^\|.*\n)+", page, re.MULTILINE):
        heads, _, *rows = (line[2:-2].split(" | ") for line in table.splitlines())
        found += [(head, [row[i] for row in rows]) for i, head in enumerate(heads)]
    return found


def test_no_number_of_ours_is_written_by_hand():
    """Where all figures change, every number changes that is not a setting or the paper's."""
    data = _kept()
    before, after = _columns(_page(data)), _columns(_page(_changed(data, np.random.default_rng(1))))
    assert [head for head, _ in before] == [head for head, _ in after]
    assert len(before) > 100
    for (head, ours), (_, others) in zip(before, after, strict=True):
        same = [a for a, b in zip(ours, others, strict=True) if a == b and re.search("[1-9]", a)]
        assert head in STEADY or not same, f"{head}: {same}"


@pytest.mark.parametrize("level", ["_half", "_fine"])
def test_error_bars_count_the_step_and_the_panels(level):
    data, rng = _kept(), np.random.default_rng(1)
    changed = {k: _changed(v, rng) if k.endswith(level) else v for k, v in data["runs"].items()}
    before, after = _columns(_page(data)), _columns(_page({**data, "runs": changed}))
    barred = [
        head
        for (head, ours), (_, others) in zip(before, after, strict=True)
        if any(a.split(" ± ")[1:] != b.split(" ± ")[1:] for a, b in zip(ours, others, strict=True))
    ]
    assert set(barred) >= {
        *("head first (BL)", "to its right, +y (BL)", "net speed (mm/s)", "turn (°), left +"),
        *("turn per way (°/m)", "largest joint angle (rad)", "mean positive power below 8 Hz (W)"),
        *("largest energy (J)", "net work (J)", "positive work (J)", "force across (N)"),
        *("force along (N)", "spring's moment (N m)", "sum of moments (N m)"),
    }


def test_the_page_says_what_differs_counts_it_and_tells_the_commits_apart():
    data = the_papers_world()
    page = make_page(data, {}, "a test", "2" * 40 + "+")
    assert f"{len(STATEMENTS)} statements: {len(STATEMENTS) - 1} agree, 1 undecided." in page
    counted = re.findall(r"[0-9]+ of ([0-9]+) statements hold", page)
    assert sum(map(int, counted)) == len(STATEMENTS)
    assert "figures computed at commit 0000000000 on 2020-01-01, page written by commit" in page
    assert page.count("commit 2222222222+") == 2
    assert "are missing" not in page
    WRONG["vi bends"](data)
    page = _page({**data, "done": 0})
    assert "1 differ, 1 undecided." in page
    assert "* vi bends in its rear half only\n" in page
    assert "**1 of them are missing.**" in page


def test_an_empty_page_has_no_numbers_of_ours(tmp_path):
    summary = write_book(tmp_path / "none", [], unit_store(tmp_path), {}, "a test")
    assert summary["counts"] == {NOT_MEASURED: len(STATEMENTS)}
    page = (tmp_path / "none.md").read_text(encoding="utf-8")
    assert "0 records of figures were there" in page
    assert f"{len(STATEMENTS)} not measured" in page
    rows = [line.split(" | ") for line in page.splitlines() if line.startswith("| section")]
    assert len(rows) == len(STATEMENTS)
    for _, measured, verdict, *_, why in rows:
        # Nothing but the names of what is missing.
        assert measured.startswith("no ") and verdict == f"**{NOT_MEASURED}**" and why == " |"
    # No table but that one, no picture, and no figure with a bar.
    assert sum(line.startswith("|---|") for line in page.splitlines()) == 1
    assert "](" not in page.replace("](theory/plane.md)", "")
    assert re.search(r"[0-9] ± ", page) is None


def test_numbers_have_no_minus_before_a_zero_and_bars_one_digit():
    numbers = [number_text(-1e-9, form) for form in ("+.3f", ".3f")] + [number_text(-0.25, "+.2f")]
    assert numbers == ["+0.000", "0.000", "-0.25"]
    assert [bar_text(bar) for bar in (0.0, 0.0123, 17.0, 1e-9)] == ["0", "0.01", "20", "1e-09"]
    assert with_bar(0.24976, 0.0053) == "0.250 ± 0.005"
    assert with_bar(-0.24976, 0.0, "+") == "-0.2498 ± 0"
    assert with_bar(0.24976, 2e-9, digits=3) == "0.250 ± 2e-09"
    assert with_bar(1119.4, 23.0, "+") == "+1119 ± 20"
    assert with_bar(0.5, None, "+") == "+0.5"


def test_error_bars_are_the_errors_of_figures_of_their_order():
    limit, size, constant = 5.0, 0.1, -0.7
    for order, ratio in ((1.0, 2.0), (1.0, 3.0), (2.0, 2.0), (2.0, 3.0)):
        coarse = limit + constant * size**order
        fine = limit + constant * (size / ratio) ** order
        assert coarse_error(fine - coarse, ratio, order) == pytest.approx(abs(coarse - limit))
        assert fine_error(fine - coarse, ratio, order) == pytest.approx(abs(fine - limit))
    # Half the step: twice the change. A third of the panels' length: one and a half times.
    assert bar_of(1.0, 1.1, 0.7) == pytest.approx(0.2 + 0.45)
    assert bar_of(1.0, None, 0.7) is None


# ---- files and resuming ------------------------------------------------------------------------


class _Worker:
    """Keeps count of what it does, and gives up before one unit."""

    def __init__(self, stops_at: str = "") -> None:
        self.did: list[str] = []
        self.stops_at = stops_at

    def __call__(self, unit: Unit) -> tuple[Figures, Arrays]:
        if unit.name == self.stops_at:
            raise KeyboardInterrupt
        self.did.append(unit.name)
        return {"number": unit.options["number"]}, {"square": np.arange(3.0)}


def _units(work: Any) -> list[Unit]:
    scene = load_scene("paper_x")
    return [Unit(f"run_{i}", work, scene, {"number": i}, cost=float(i)) for i in range(4)]


def test_an_interrupted_run_continues_where_it_stopped(tmp_path):
    first, second = _Worker(stops_at="run_1"), _Worker()
    with pytest.raises(KeyboardInterrupt):
        do_units(_units(first), unit_store(tmp_path), 1)
    # The long ones first.
    assert first.did == ["run_3", "run_2"]
    store, told = unit_store(tmp_path), list[float]()
    assert do_units(_units(second), store, 1, told.append) == 2
    assert second.did == ["run_1", "run_0"]
    assert told == [2, 1, 1]
    assert do_units(_units(_Worker()), store, 1) == 0
    kept = done_units(_units(second), store)["run_3"]
    assert kept["figures"] == {"number": 3}
    assert store.arrays("run_3")["square"].tolist() == [0.0, 1.0, 2.0]


def _dies(unit: Unit) -> tuple[Figures, Arrays]:
    """Do the longest unit, and end the process in any other."""
    return ({"number": 3}, {}) if unit.name == "run_3" else os._exit(9)


def test_a_dead_worker_is_one_clear_line_and_what_was_done_is_kept(tmp_path):
    store = unit_store(tmp_path)
    why = ("a worker process has died", "; what was done is kept, start again to continue")
    with refuses(SwimError, *why):
        do_units(_units(_dies), store, 2)
    done = [record["name"] for record in store.records]
    assert done in ([], ["run_3"])
    assert do_units(_units(_Worker()), store, 1) == 4 - len(done)


def test_what_has_changed_or_is_damaged_is_done_anew(tmp_path, monkeypatch):
    store, again = unit_store(tmp_path), _Worker()
    do_units(_units(_Worker()), store, 1)
    units = _units(again)
    units[0] = Unit("run_0", again, load_scene("paper_x", ["beam.elements=4"]), units[0].options)
    units[1] = Unit("run_1", again, units[1].scene, {"number": 7})
    (tmp_path / "units" / "run_3.npz").unlink()
    assert do_units(units, store, 1) == 3
    assert do_units(units, store, 1) == 0
    # Other kernels make other figures, and so does other code.
    for name in ("kernel_digest", "code_digest"):
        monkeypatch.setattr(units_module, name, lambda *_: "other")
        assert do_units(units, store, 1) == 4
    # Nothing that no longer counts stays in the file.
    assert (tmp_path / "units" / "units.jsonl").read_bytes().count(b"\n") == 4


def test_ctrl_c_leaves_what_is_done_and_the_next_start_continues(tmp_path):
    out = tmp_path / "out"
    file = out / "units" / "units.jsonl"
    options = ("--quick", "--only", "modes", "onset", "--workers", "2", "--output", out)

    def when() -> bool:
        return file.exists() and file.read_bytes().count(b"\n") >= 3

    done = interrupt_script("reproduce_paper", *options, when=when)
    assert done.code == 130, done.err
    assert "interrupted; what was done is kept, start again to continue" in done.err
    assert "Traceback" not in done.err
    chosen = all_units(quick=True, only=("modes", "onset"))
    store = unit_store(out)
    assert 3 <= len(done_units(chosen, store)) == len(store.records) < len(chosen)


def test_keys_know_the_code_that_makes_figures_and_no_other(tmp_path):
    for folder in ("studies/paper", "swim_env/analysis"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    shutil.copy(ROOT / "studies" / "kirchhoff.py", tmp_path / "studies")
    modules = {unit.kind: unit.work.__module__ for unit in all_units()}

    def digests(root: Path = tmp_path) -> dict[str, str]:
        code_digest.cache_clear()
        return {kind: code_digest(module, root) for kind, module in modules.items()}

    before = digests()
    assert before == digests(ROOT)
    for module, kinds in {
        "studies/paper/constants": {"run", "onset", "variant"},
        "studies/paper/variants": {"variant"},
        "studies/paper/modes": {"modes"},
        "studies/kirchhoff": {"onset", "variant", "modes"},
        "swim_env/analysis/modes": {"onset", "variant", "modes", "map"},
        "studies/paper/page": set(),
        "studies/paper/statements/limits": set(),
    }.items():
        file = tmp_path / f"{module}.py"
        source = file.read_text()
        file.write_text(source + "\nADDED = 1\n")
        after = digests()
        assert {kind for kind in before if before[kind] != after[kind]} == kinds, module
        file.write_text(source + "\n# A comment.\n")
        assert digests() == before
    code_digest.cache_clear()


# ---- the command -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--workers", "0"], "--workers must be at least 1, got 0"),
        (["--only", "runs", "figures"], "--only must be among runs, onset, variants, modes, maps"),
    ],
)
def test_bad_options_are_one_clear_error(options, message, tmp_path, capsys):
    out = tmp_path / "out"
    call_script(capsys, "reproduce_paper", *options, "--output", out).assert_refused(message)
    assert not out.exists()


def test_the_command_makes_a_page_of_its_records_and_of_nothing_else(tmp_path, capsys):
    folder, page = tmp_path / "out", tmp_path / "out.md"
    options = ["--quick", "--only", "modes", "--workers", "2", "--output", str(folder), "--json"]
    done = call_script(capsys, "reproduce_paper", *options)
    assert "12 of 12 units" in done.err
    assert done.figures()["verdicts"]["order"]["verdict"] == AGREE
    assert "order 2.01" in page.read_text(encoding="utf-8")
    commit = json.loads((folder / "verdicts.json").read_text(encoding="utf-8"))["written"]
    words = f"page written by commit {commit[:10] if commit else 'unknown'}"
    assert words in page.read_text(encoding="utf-8")
    # A record says something else, and so does the page; nothing is done anew.
    store = unit_store(folder)
    kept = store.get("modes_i")
    assert kept is not None
    kept["figures"]["orders"] |= {"order": 1.23, "before": 1.22}
    store.add(kept)
    done = call_script(capsys, "reproduce_paper", *options)
    assert "0 of 12 units" in done.err
    assert done.figures()["verdicts"]["order"]["verdict"] == DIFFER
    assert "order 1.23" in page.read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_quick_command_from_end_to_end(tmp_path, capsys):
    folder = tmp_path / "quick"
    found = call_script(
        capsys, "reproduce_paper", "--quick", "--output", folder, "--json"
    ).figures()
    assert found["done"] == found["units"] == len(all_units(quick=True))
    assert found["verdicts"]["equilibrium"]["verdict"] == AGREE
    pictures = {path.stem for path in folder.glob("*.png")}
    assert pictures >= {f"fig{n}" for n in range(3, 9)} | {"maps", "onset", "variants", "internal"}
    page = (tmp_path / "quick.md").read_text(encoding="utf-8")
    for name in pictures:
        assert f"(quick/{name}.png)" in page


# ---- what is kept ------------------------------------------------------------------------------


@pytest.mark.release
def test_the_kept_page_is_made_of_the_kept_records():
    folder = ROOT / "docs" / "paper"
    data = _kept()
    assert data["done"] == data["units"]
    pictures = {path.stem: f"paper/{path.name}" for path in folder.glob("*.png")}
    stored = json.loads((folder / "verdicts.json").read_text(encoding="utf-8"))
    page = make_page(data, pictures, "scripts/reproduce_paper.py", stored["written"])
    assert page == (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
    found = verdicts_of(data)
    assert stored["verdicts"] == found
    # Every column of the page's table says what the summary says, row by row.
    rows = [line for line in page.splitlines() if line.startswith("| section")]
    for row, one in zip(rows, found.values(), strict=True):
        for key in ("measured", "verdict", "criterion", "why"):
            assert one[key].replace("|", "\\|") in row
