"""The study of accuracy and cost: its grids, runs, front, tables and command, and the sweeps."""

import functools
import itertools
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from studies.accuracy import study as study_module
from studies.accuracy import sweeps as sweeps_module
from studies.accuracy.front import make_front, pareto
from studies.accuracy.grid import (
    FINE_STEPS,
    SOLVED,
    Case,
    case_of,
    full_grid,
    held_out_scenes,
    quick_grid,
    study_scenes,
)
from studies.accuracy.held_out import judge
from studies.accuracy.mass_error import BEND, mass_errors, rigid_added_mass
from studies.accuracy.picture import draw_study
from studies.accuracy.report import budget_of, held_out_table, study_tables, what_time_buys
from studies.accuracy.runs import Yardstick, label_of, scene_with, solve, solver_of, timed_run
from studies.accuracy.study import Study, case_digest, energy_error, path_error
from studies.accuracy.sweeps import sweep_tables
from studies.benchmark.effects import effect_pairs, measure_effects
from swim_env import EFFECT_NAMES, Scene, SimulationEndedError, SwimError, load_scene
from swim_env.accuracy import Outcome, Reference, Settings, choose, play, reference_of
from swim_env.accuracy.front import load_front
from swim_env.accuracy.outcome import SAMPLES, relative_error
from swim_env.accuracy.reference import PILOT
from swim_env.accuracy.settings import PAPER_SETTINGS
from swim_env.analysis.continuous import integrate
from swim_env.physics import added_mass_of_polygon
from tests.analytic.conformal import rectangle_mass
from tests.contract.test_for_accuracy import FROZEN, PANELS, ROLLED, STRIP, settings_of
from tests.support import ROOT, assert_is_a_picture, call_script, files_of, refuses

Array = NDArray[np.float64]

LSODA = Settings("frozen", 5, 4, 1, 0.01, "LSODA", tolerance=1e-4)
#: A reference two metres to the left, on a body of length 1.
THERE = Reference(np.array([-2.0, 0.0]), np.zeros((SAMPLES + 1, 2)), 1.0, 1.0, 0.0, 0.0, 0.0, {})


def numbered(cost: float, error: float | None, scene: str = "a", **changes: Any) -> dict[str, Any]:
    """Return a made-up run whose settings differ from those of other costs."""
    settings = replace(PAPER_SETTINGS, **{"time_step": round(1e-4 * (1.0 + cost), 9), **changes})
    return {**settings.to_dict(), "scene": scene, "cost": cost, "error": error}


# ---- grids -------------------------------------------------------------------------------------


@pytest.mark.parametrize("grid", [full_grid, quick_grid])
def test_every_setting_of_a_grid_fits_every_scene_once(grid):
    settings = grid()
    assert len(set(settings)) == len({label_of(one) for one in settings}) == len(settings)
    assert PAPER_SETTINGS in settings
    for case, one in itertools.product(study_scenes(), settings):
        wanted, own = one, case.scene.integrator
        if solver_of(one) is not None:
            wanted = replace(one, scheme=own.scheme, tolerance=own.tolerance)
        assert settings_of(scene_with(one, case.scene)) == wanted


def test_the_grids_have_all_that_tables_compare():
    """Newton's tolerance, SciPy's solvers beside the same chain in steps, the error budget."""
    grid = set(full_grid())
    for one in FINE_STEPS:
        assert {replace(one, tolerance=each) for each in (1e-4, 1e-6, 1e-8, 1e-10)} <= grid
    assert {one.fluid_model for one in FINE_STEPS} == {"frozen", "panels"}
    solved = [one for one in grid if solver_of(one) is not None]
    assert len({one.scheme for one in solved}) == 2
    assert {replace(one, scheme="composed", tolerance=1e-10) for one in solved} == {SOLVED} <= grid
    assert sum(solver_of(one) is not None for one in quick_grid()) == 1
    runs = [{**one.to_dict(), "displacement": [-1.0, 0.0]} for one in full_grid()]
    wanted = {"elements", "panels", "time_step", "model", "tolerance", "all"}
    assert budget_of(runs, THERE).keys() == wanted


def test_held_out_scenes_are_others():
    """No body and drive of theirs is in the study, and no name is there twice."""
    seen, unseen = study_scenes(), held_out_scenes()
    assert len({case.scene.name for case in (*seen, *unseen)}) == len(seen) + len(unseen)
    for one, other in itertools.product(seen, unseen):
        assert (one.scene.beam, one.scene.actuation) != (other.scene.beam, other.scene.actuation)


# ---- SciPy's solvers ---------------------------------------------------------------------------


def soft(**changes: object) -> Scene:
    gentle = {"beam.bending_stiffness": 0.5, "actuation.amplitude": 0.2}
    swing = Settings("frozen", 3, 4, 1, 0.01, "composed")
    return swing.apply(load_scene("swimmer", {**gentle, **changes}))


def test_a_solvers_run_is_what_small_steps_converge_to():
    """In all that is compared, averaged over the last period in the same way."""
    scene = soft(**{"stream.velocity": (0.3, 0.0)})
    found = solve(scene, 2.0, "DOP853", 1e-8)
    wanted = integrate(scene, 2.0, "DOP853", 1e-8, 1e-10)
    assert found.evaluations == wanted.evaluations > 10 and found.corrections == 0
    errors = []
    for step in (0.01, 0.005):
        steps = play(scene.replace("integrator.time_step", step), 2.0)
        errors.append(float(np.abs(steps.values - found.values).max()))
        assert steps.largest_bend == pytest.approx(found.largest_bend, rel=0.01)
    assert errors[1] < 0.3 * errors[0] < 1e-3
    assert (found.steps, found.cut_steps, found.termination_reason) == (200, 0, "")
    assert found.seconds > 0.0


# ---- the front ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "others", "kept"),
    [
        # A little costlier than one that beats it: their order may differ elsewhere.
        ("frozen", [(1.9, 0.11), (2.1, 0.11)], [1.0, 1.9]),
        # Costlier models have a front of their own: scenes that bend too far need them.
        ("panels", [(5.0, 0.2), (9.0, 0.1), (9.5, 0.15)], [1.0, 5.0, 9.0]),
        ("expansion", [(5.0, 0.2), (9.0, 0.1), (9.5, 0.15)], [1.0, 5.0, 9.0]),
        ("strip", [(5.0, 0.2), (9.0, 0.1), (9.5, 0.15)], [1.0]),
        # Cheapest, but useless; and not quite.
        ("strip", [(0.1, 2.0)], [1.0]),
        ("strip", [(0.1, 0.3)], [0.1, 1.0]),
        ("LSODA", [(0.1, 0.001)], [1.0]),
    ],
)
def test_what_is_near_the_front_stays_a_candidate(model, others, kept):
    change = {"scheme" if model == "LSODA" else "fluid_model": model}
    runs = [numbered(1.0, 0.1, fluid_model="frozen"), *(numbered(*one, **change) for one in others)]
    runs[0]["error"] = 0.1 if model == "frozen" else 0.01
    assert [one.cost for one in make_front(runs)] == kept


def test_the_front_is_what_nothing_beats():
    runs = [numbered(*one) for one in ((3.0, 0.1), (1.0, 0.5), (2.0, 0.6), (4.0, 0.1), (5.0, 0.01))]
    others = [numbered(1.0, 0.5), numbered(0.1, None), numbered(0.1, 0.001, scheme="LSODA")]
    for some in (runs + others, others[::-1] + runs[::-1]):
        found = [(run["cost"], run["error"]) for run in pareto(some)]
        assert found == [(1.0, 0.5), (3.0, 0.1), (5.0, 0.01)]
    # What is on one scene's front is kept with its figures on all.
    fast, fine, bad = ({"elements": n, "time_step": 0.01} for n in (5, 18, 27))
    figures = {"a": ((1.0, 0.3), (4.0, 0.1), (4.0, 0.5)), "b": ((3.0, 0.4), (2.0, 0.1), (9.0, 0.2))}
    runs = [
        numbered(cost, error, scene, fluid_model="frozen", **which)
        for scene, given in figures.items()
        for (cost, error), which in zip(given, (fast, fine, bad), strict=True)
    ]
    front = make_front(runs)
    assert [(one.settings.elements, one.cost) for one in front] == [(5, 2.0), (18, 3.0)]
    assert [one.errors for one in front] == [{"a": 0.3, "b": 0.4}, {"a": 0.1, "b": 0.1}]


# ---- tables ------------------------------------------------------------------------------------


def at(settings: Settings, x: float, cost: float, y: float = 0.0, **more: Any) -> dict[str, Any]:
    """Return a made-up run that ends at a place."""
    figures = {"displacement": [x, y], "error": abs(x + 2.0) / 2.0, "seconds_per_second": 0.1}
    return {**settings.to_dict(), "scene": "a", "cost": cost, **figures, **more}


def rows_of(table: str) -> list[list[str]]:
    """Return the cells below a table's header."""
    rows = [line for line in table.splitlines() if line.startswith("|")]
    assert len({row.count("|") for row in rows}) == 1
    return [[cell.strip() for cell in row[1:-1].split("|")] for row in rows[2:]]


def test_tables_of_tolerances_and_solvers_compare_what_is_comparable():
    usual, other = FINE_STEPS
    runs = [
        at(usual, -2.2, 4.0),
        at(replace(usual, tolerance=1e-4), -2.202, 3.0),
        at(replace(usual, tolerance=1e-8), -2.2, 4.0),
        at(replace(other, tolerance=1e-4), -2.2, 9.0),  # nothing to compare it with
        at(replace(SOLVED, scheme="LSODA", tolerance=1e-5), -2.02, 9.0, evaluations=12_000),
        at(
            replace(SOLVED, scheme="Radau", tolerance=0.01),
            -2.04,
            2.0,
            evaluations=9,
            corrections=0,
        ),
        at(replace(SOLVED, time_step=0.005), -2.024, 0.5, evaluations=1, corrections=9_000),
        # Other panels, and another strain.
        at(replace(SOLVED, panels_per_element=8), -2.5, 0.1),
        at(replace(SOLVED, strain="mean_angles"), -2.5, 0.1),
    ]
    origin = {"machine": {"processor": "any", "cores": 1}, "commit": None, "date": "today"}
    parts = study_tables(runs, {"a": THERE}, origin).split("## ")[1:]
    tables = {part.splitlines()[0]: rows_of(part) for part in parts}
    _, row, empty = tables["Newton's tolerance"]
    assert row == ["a", usual.label, "1.0e-03", "0.75", "", "", "0.0e+00", "1.00"]
    assert empty[2:] == [""] * 6
    assert tables["SciPy's solvers"] == [
        ["a", "5 ms composed", "1", "9,000", "1.2e-02", "2.0e-03", "0.5"],
        ["a", "Radau, rtol 0.01", "9", "0", "2.0e-02", "1.0e-02", "2"],
        ["a", "LSODA, rtol 1e-05", "12,000", "", "1.0e-02", "", "9"],
    ]


def test_the_budget_is_of_differences_in_one_thing():
    """Runs are put where only one thing moves them, by its own amount."""
    paper = PAPER_SETTINGS
    fine = Settings("frozen", 9, 24, "proportional", 0.0025, "composed")
    runs = [
        at(fine, -2.02, 1.0),  # 1 % for the elements
        at(replace(fine, panels_per_element=4, cap_panels=1), -2.02, 1.0, 0.06),  # 3 %, panels
        at(replace(fine, time_step=0.01, scheme="paper"), -2.10, 1.0),  # 4 % for the step
        at(paper, -2.2, 1.0),  # 10 % in all
        at(replace(paper, fluid_model="frozen"), -2.3, 1.0),  # 5 % for the model
        at(replace(paper, tolerance=1e-6), -2.2, 1.0, 0.002),  # 0.1 % for the tolerance
    ]
    parts = {"elements": 0.01, "panels": 0.03, "time_step": 0.04, "all": 0.1, "model": 0.05}
    assert budget_of(runs, THERE) == pytest.approx({**parts, "tolerance": 0.001})
    # What was not run is left out, and so is what is compared with it.
    assert budget_of(runs[1:3], THERE) == {}
    assert budget_of(runs[3:5], THERE).keys() == {"model", "all"}


def test_what_time_buys_is_the_best_at_the_price():
    given = ((0.1, 0.5), (0.2, 0.4), (0.3, 0.01), (20.0, 1e-3), (21.0, 0.0))
    runs = [numbered(*one) for one in given] + [numbered(0.1, 0.0, scheme="LSODA")]
    bought = what_time_buys([at(PAPER_SETTINGS, -2.2, 2.0), *runs], (0.01, 0.1, 1.0, 10.0))
    assert bought.pop(0.01) is None
    assert [one and one["error"] for one in bought.values()] == [0.4, 0.01, 1e-3]
    # Without the paper's settings there is no unit to count in.
    assert what_time_buys(runs, (0.1, 1.0)) == {0.1: None, 1.0: None}


def test_the_table_of_held_out_scenes_says_why_where_there_is_no_choice():
    chosen = {
        **{"scene": "one", "tolerance": 0.01, "chosen": "here", "error": 0.005, "met": True},
        **{"direct_error": 0.011, "met_direct": False, "reference_gap": 0.006},
        **{"best": "there", "best_error": 0.009, "cost_ratio": 1.25, "timed": True},
    }
    fastest = {**chosen, "best": "here", "timed": False, "direct_error": None}
    none = {"scene": "two", "tolerance": 0.03, "chosen": None, "reason": "too violent"}
    rows = rows_of(held_out_table([chosen, fastest, {**none, "reference_gap": None}]))
    start = ["one", "0.01", "here", "5.0e-03", "yes"]
    assert rows[0] == [*start, "1.1e-02", "no", "6.0e-03", "there", "9.0e-03", "1.25"]
    # What was not timed has no ratio.
    assert rows[1] == [*start, "", "no", "6.0e-03", "none", "", ""]
    assert rows[2] == ["two", "0.03", "none: too violent", "", "no", "", "no", *[""] * 4]


# ---- added mass of rigid motions ---------------------------------------------------------------

DENSITY = 10.0


def body(elements: int = 9, panels: int = 4, caps: int | str = 1, **changes: object) -> Scene:
    shape = {"beam.elements": elements, "fluid.panels_per_element": panels}
    return load_scene("swimmer", {**shape, "fluid.cap_panels": caps, **changes})


def ribbon(panels: int) -> Array:
    """Return the outline of an arc of length 1 and half thickness 0.01, its mean at the origin."""
    radius, caps = 1.0 / BEND, panels // 50
    angles = BEND * np.linspace(-0.5, 0.5, panels + 1)
    around = np.stack([np.sin(angles), -np.cos(angles)], axis=1)
    outer, inner = (radius + 0.01) * around, (radius - 0.01) * around
    across = np.arange(1, caps)[:, None] / caps
    mean = radius * np.array([0.0, -math.sin(0.5 * BEND) / (0.5 * BEND)])
    ends = (outer[-1] + across * (inner[-1] - outer[-1]), inner[0] + across * (outer[0] - inner[0]))
    return np.concatenate([outer, ends[0], inner[::-1], ends[1]]) - mean


def test_what_errors_are_measured_by_is_the_smooth_ribbon_to_a_thousandth():
    """Fine bodies tend to it with half the error for twice the panels, as the ribbon's own do."""
    # The ribbon's polygons converge at first order: what two of them leave out is 2e-4.
    coarse, fine = (added_mass_of_polygon(ribbon(n), DENSITY) for n in (400, 800))
    exact = 2.0 * fine - coarse
    for panels, wanted in ((12, 8.3e-3), (24, 4.5e-3)):
        arc = body(36, panels, "proportional", axial_added_mass=True)
        mass = rigid_added_mass(arc, BEND)
        error = float(np.linalg.norm(mass - exact) / np.linalg.norm(exact))
        assert mass_errors(arc)[1] == pytest.approx(error, abs=1e-3)
        assert mass_errors(arc)[1] == pytest.approx(wanted, abs=5e-4)


def test_coarser_bodies_have_larger_errors():
    bodies = ((9, 4, 1), (18, 8, "proportional"), (27, 16, "proportional"))
    straight, bent = zip(*(mass_errors(body(n, p, caps)) for n, p, caps in bodies), strict=True)
    assert straight[0] > 5.0 * straight[1] > 0.0 and straight[1] > straight[2] > 0.0
    # Bent, elements count as well.
    assert bent[0] > 1.5 * bent[1] > 0.0 and bent[1] > 1.5 * bent[2] > 0.0
    # One cap panel leaves the straight body 1.5 % too heavy.
    mass = rigid_added_mass(body(), 0.0)
    exact = np.diag([0.0, *(DENSITY * rectangle_mass(1.0, 0.02)[1:])])
    error = float(np.linalg.norm(mass - exact) / np.linalg.norm(exact))
    assert straight[0] == pytest.approx(error, abs=5e-4) and 0.01 < straight[0] < 0.02
    # In units of the body's length: three times the density on four times the area.
    twice = {"beam.length": 2.0, "beam.half_thickness": 0.02, "fluid.density": 30.0}
    expected = 12.0 * rigid_added_mass(body(), BEND)
    assert rigid_added_mass(body(**twice), BEND) == pytest.approx(expected, rel=1e-12)


def test_models_share_the_straight_body_and_differ_bent():
    models = ("panels", "frozen", "strip", "none")
    # Nothing counts but the body.
    others = {"damping": None, "beam.bending_stiffness": [3.0] * 8, "actuation": None}
    assert mass_errors(body(**others, **{"stream.velocity": (1.0, 0.0)})) == mass_errors(body())
    panels, frozen, strip, none = (mass_errors(body(**{"fluid.model": one})) for one in models)
    assert frozen[0] == pytest.approx(panels[0], rel=1e-9)
    assert frozen[1] != pytest.approx(panels[1], rel=0.1)
    # Strips have the plate's mass in all and 4.4 % too little for the thickness.
    assert strip[0] is not None and strip[0] > 0.04
    assert none == mass_errors(load_scene("swimmer", {"fluid": None})) == (None, None)


# ---- the study ---------------------------------------------------------------------------------

TINY = [
    Settings("strip", 5, 4, 1, 0.02, "composed"),
    Settings("frozen", 5, 4, 1, 0.02, "composed"),
    FROZEN,
    PAPER_SETTINGS,
]
KEYS = {
    *("scene", "case", "reason", "error", "path_error", "energy_error", "added_mass_error"),
    *("bent_added_mass_error", "displacement", "largest_bend", "cut_steps", "evaluations"),
    *("corrections", "seconds_per_second", "cost", *PAPER_SETTINGS.to_dict()),
}


@pytest.fixture
def cheap(monkeypatch: pytest.MonkeyPatch) -> list[Settings]:
    """References of a choice and a short yardstick; returns the settings that are played."""
    pilot = functools.partial(reference_of, refinements=PILOT)
    monkeypatch.setattr(study_module, "reference_of", pilot)
    monkeypatch.setattr(study_module, "Yardstick", functools.partial(Yardstick, 5))
    played: list[Settings] = []

    def counted(settings: Settings, *given: Any) -> Any:
        played.append(settings)
        return timed_run(settings, *given)

    monkeypatch.setattr(study_module, "timed_run", counted)
    return played


def tiny_study(folder: Path, grid: list[Settings] = TINY) -> Study:
    return Study(folder, [Case(load_scene("swimmer"), 1.0)], grid)


def lines_of(folder: Path) -> list[dict[str, Any]]:
    text = (folder / "runs.jsonl").read_text(encoding="utf-8")
    assert text.endswith("\n")
    return [json.loads(line) for line in text.splitlines()]


def settings_in(runs: list[Any]) -> list[Settings]:
    return [Settings.from_dict(run) for run in runs]


def test_solvers_are_played_in_continuous_time(tmp_path, cheap):
    """Their line has the same keys, their error is that of their own solution."""
    study = tiny_study(tmp_path, [LSODA, replace(LSODA, tolerance=1e-6), FROZEN])
    study.run()
    loose, tight, _ = lines = lines_of(tmp_path)
    assert settings_in(lines) == study.grid
    assert {frozenset(line) for line in lines} == {frozenset(KEYS)}
    outcome = solve(scene_with(LSODA, load_scene("swimmer")), 1.0, "LSODA", 1e-4)
    assert loose["displacement"] == outcome.displacement.tolist()
    assert loose["error"] == study.references["swimmer"].error(outcome)
    assert loose["evaluations"] == outcome.evaluations < tight["evaluations"]
    assert 0.0 < loose["seconds_per_second"] < loose["cost"]
    # Both are nearly exact in time: what they are off by is the chain's.
    assert loose["error"] == pytest.approx(tight["error"], rel=0.2)
    # What was done with one tolerance is not done again, and is not another's.
    cheap.clear()
    other = tiny_study(tmp_path, [LSODA, replace(LSODA, tolerance=1e-5)])
    other.run()
    assert cheap == other.grid[1:]
    # The picture names the solvers that were run.
    runs = study.chosen_runs()
    for some, names in ((runs, ["SciPy's LSODA"]), (runs[2:], [])):
        (legend,) = draw_study(some, study.references).legends
        said = [text.get_text() for text in legend.get_texts()]
        assert [one for one in said if "SciPy" in one] == names


@pytest.mark.parametrize(
    ("raised", "reason"),
    [
        (SimulationEndedError("outline_degenerate", 0.3, "made up"), "outline_degenerate"),
        (SwimError("LSODA gave up at t = 0.3 s: made up"), "LSODA gave up at t = 0.3 s: made up"),
    ],
)
def test_a_run_that_does_not_get_there_is_kept_with_its_reason(
    raised, reason, tmp_path, cheap, monkeypatch
):
    """A solver's, and one in steps that curls up: no error, on no front, not tried again."""

    def failing(*given: Any, **named: Any) -> Outcome:
        raise raised

    monkeypatch.setattr("studies.accuracy.runs.solve", failing)
    monkeypatch.setattr(study_module, "reference_of", lambda *_: THERE)
    case = Case(load_scene("swimmer", ROLLED), 1.0)
    study = Study(tmp_path, [case], [LSODA, PANELS, STRIP])
    study.run()
    solver, curled, last = lines_of(tmp_path)
    assert (solver["reason"], last["reason"]) == (reason, "")
    assert curled["reason"] in ("under_resolved_gap", "outline_degenerate")
    assert curled.keys() == KEYS and solver.keys() < KEYS
    assert curled["error"] is solver.get("error") is None
    assert settings_in(study.chosen_runs()) == [STRIP]
    cheap.clear()
    Study(tmp_path, [case], [LSODA, PANELS]).run()
    assert cheap == []


def test_an_interrupted_study_continues_where_it_stopped(tmp_path, cheap, monkeypatch):
    left = [3]

    def interrupt(steps: int) -> None:
        left[0] -= steps
        if left[0] <= 0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tiny_study(tmp_path).run(interrupt)
    before = files_of(tmp_path)
    assert settings_in(lines_of(tmp_path)) == TINY[:2]
    # The reference is not made again, which takes minutes on a whole study.
    monkeypatch.setattr(study_module, "reference_of", None)
    cheap.clear()
    again = tiny_study(tmp_path)
    counted: list[int] = []
    again.run(counted.append)
    assert cheap == TINY[2:]
    assert sum(counted) == again.work
    after = files_of(tmp_path)
    assert after["runs.jsonl"].startswith(before["runs.jsonl"])
    assert after["references.json"] == before["references.json"]
    # Another grid keeps what was done, and chooses its own.
    cheap.clear()
    smaller = tiny_study(tmp_path, TINY[1:2])
    smaller.run()
    assert cheap == [] and len(smaller.store.records) == 4
    assert settings_in(smaller.chosen_runs()) == TINY[1:2]


@pytest.mark.parametrize("text", ["", "[]", '{"references": {"a": {"energy": 1}}}'])
def test_references_of_something_else_are_refused(tmp_path, text):
    (tmp_path / "references.json").write_text(text, encoding="utf-8")
    with refuses(SwimError, "not the references of a study: ", "references.json"):
        tiny_study(tmp_path)
    assert (tmp_path / "references.json").read_text(encoding="utf-8") == text


@pytest.mark.release
def test_costs_are_in_units_of_the_papers_settings():
    """Playing the yardstick's own scene costs one, give or take what the machine does meanwhile."""
    scene = load_scene("paper_i")
    costs = [timed_run(PAPER_SETTINGS, scene, 1.0, Yardstick(100)) for _ in range(3)]
    assert 0.4 < float(np.median([cost for *_, cost in costs])) < 2.0
    assert costs[0][0].steps == 100
    assert costs[0][1] > 0.0


@pytest.mark.release
def test_the_stored_study_makes_the_shipped_front_and_the_stored_tables():
    """Whoever changes a scene, the runs or what a front is makes it anew with --refresh-front."""
    folder = ROOT / "docs" / "accuracy"
    stored = Study(folder, study_scenes(), full_grid())
    runs = stored.chosen_runs()
    kept, held_out, sweeps = (
        json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
        for name in ("study", "held_out", "sweeps")
    )
    assert {run["scene"] for run in runs} == {case.scene.name for case in stored.cases}
    assert make_front(runs) == load_front()
    for name, text in {
        "tables": study_tables(runs, stored.references, kept),
        "held_out": held_out_table(held_out["judged"]),
        "sweeps": sweep_tables(sweeps["bends"], sweeps["resonance"]),
    }.items():
        assert text.split() == (folder / f"{name}.md").read_text(encoding="utf-8").split(), name
    for name, figures in kept["scenes"].items():
        some = [run for run in runs if run["scene"] == name]
        budget = budget_of(some, stored.references[name])
        assert budget == pytest.approx(figures["paper_settings"])
        assert [run["error"] for run in pareto(some)] == [one["error"] for one in figures["front"]]


def test_a_case_is_another_where_its_results_are():
    for case in study_scenes():
        warned = case._replace(scene=case.scene.replace("integrator.energy_tolerance", 0.5))
        assert case_digest(warned) == case_digest(case)
        other = case._replace(scene=case.scene.replace("integrator.time_step", 0.001))
        assert case_digest(other) != case_digest(case)


# ---- the command -------------------------------------------------------------------------------


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch, cheap: list[Settings]) -> list[Settings]:
    """A command with a tiny grid and one second of three scenes."""
    few = [Case(load_scene("swimmer", {"name": name}), 1.0) for name in ("one", "swimmer", "two")]
    for grid in ("quick_grid", "full_grid"):
        monkeypatch.setattr(f"scripts.accuracy_cost.{grid}", lambda: TINY)
    monkeypatch.setattr("scripts.accuracy_cost.study_scenes", lambda: few)
    return cheap


def test_the_command_writes_a_whole_study(tmp_path, tiny, capsys):
    folder = tmp_path / "out"
    given = ["accuracy_cost", "--quick", "--scenes", "swimmer", "--output", folder]
    done = call_script(capsys, *given, "--json")
    printed = done.figures()
    assert done.err.splitlines()[-1] == f"results are in {folder}"
    pages = {"front.json", "tables.md", "study.json", "work_precision.png"}
    assert set(files_of(folder)) == {"runs.jsonl", "references.json", *pages}
    assert json.loads((folder / "study.json").read_text(encoding="utf-8")) == printed
    assert printed["runs"] == len(TINY)
    assert printed["scenes"].keys() == {"swimmer"}
    # Every run is a line with the same keys.
    lines = lines_of(folder)
    assert settings_in(lines) == tiny == TINY
    for line in lines:
        assert line.keys() == KEYS
        assert (line["reason"], line["scene"]) == ("", "swimmer")
        for name in ("error", "path_error", "energy_error", "cost", "seconds_per_second"):
            assert 0.0 < line[name] < math.inf, name
    assert lines[0]["error"] > 10.0 * lines[1]["error"]
    stored = json.loads((folder / "references.json").read_text(encoding="utf-8"))
    assert stored.keys() == {"commit", "machine", "versions", "date", "references", "cases"}
    (reference,) = tiny_study(folder).references.values()
    outcome = play(TINY[2].apply(load_scene("swimmer")), 1.0)
    for error in (Reference.error, path_error, energy_error):
        assert error(reference, outcome) == lines[2][error.__name__]
    figures = printed["scenes"]["swimmer"]
    # As far as the grid has the runs for it.
    assert figures["paper_settings"].keys() == {"all"}
    errors, costs = ([point[key] for point in figures["front"]] for key in ("error", "cost"))
    assert errors == sorted(errors, reverse=True)
    assert costs == sorted(costs)
    front = load_front(folder / "front.json")
    assert front == make_front(lines)
    # What is off by more than 30 % may be on a scene's front, but is no candidate.
    useful = {one["settings"] for one in figures["front"] if one["error"] < 0.3}
    assert {one.settings.label for one in front} >= useful > set()
    assert json.loads((folder / "front.json").read_text(encoding="utf-8"))["machine"]
    assert_is_a_picture(folder / "work_precision.png", 200)
    text = (folder / "tables.md").read_text(encoding="utf-8")
    for part in ("## References", "## Front of swimmer", "panels 9x4/1 10 ms paper (the paper's)"):
        assert part in text
    # A second start has nothing to do, and says the same in words.
    tiny.clear()
    again = call_script(capsys, *given)
    assert (again.code, tiny) == (0, [])
    assert again.out.startswith("swimmer: known to ")
    assert len(again.out.splitlines()) == 1 + len(figures["front"])


@pytest.fixture
def unseen(monkeypatch: pytest.MonkeyPatch, tiny: list[Settings]) -> None:
    """Pictures that are drawn elsewhere are not drawn again."""
    monkeypatch.setattr("scripts.accuracy_cost.draw_study", lambda *_: None)
    monkeypatch.setattr("scripts.accuracy_cost.save_figure", lambda *_: None)
    monkeypatch.setattr("scripts.accuracy_cost.quick_grid", lambda: TINY[:2])


@pytest.mark.usefixtures("unseen")
def test_a_study_takes_any_scene(tmp_path, monkeypatch, capsys):
    """One of its own, a shipped one and a file, each for as long as its episode is."""
    mine = tmp_path / "mine.yaml"
    text = "episode: {duration: 1.0}\nintegrator: {time_step: 0.01}\n"
    mine.write_text(text, encoding="utf-8")
    cases: list[Case] = []

    def recorded(folder: Path, given: list[Case], grid: list[Settings]) -> Study:
        cases.extend(given)
        # A second of each is enough.
        return Study(folder, [Case(case.scene, 1.0) for case in given], grid)

    monkeypatch.setattr("scripts.accuracy_cost.Study", recorded)
    out = tmp_path / "out"
    given = ("--quick", "--scenes", "two", "paper_v", mine, "two", "--output", out)
    assert call_script(capsys, "accuracy_cost", *given).code == 0
    # The first two of its own unless scenes are named.
    few = tmp_path / "few"
    assert call_script(capsys, "accuracy_cost", "--quick", "--output", few).code == 0
    assert [line["scene"] for line in lines_of(few)] == ["one"] * 2 + ["swimmer"] * 2
    named = [(case.scene.name, case.duration) for case in cases[:3]]
    assert named == [("two", 1.0), ("paper_v", 20.0), ("mine", 1.0)]
    assert cases[1].scene == load_scene("paper_v")
    assert case_of(cases[1].scene.replace("episode.duration", 3.13)).duration == 3.12
    assert [line["scene"] for line in lines_of(out)] == ["two"] * 2 + ["paper_v"] * 2 + ["mine"] * 2


@pytest.mark.parametrize(
    ("given", "part"),
    [
        (["--scenes", "swimer"], "--scenes takes paper_i, swimmer, resonant, "),
        (["--scenes", "swimmer", "no_such"], "a scene file: unknown scene 'no_such'"),
        (["--scenes", "x.yaml", "other/x.yaml"], "--scenes has two scenes of the name x, rename "),
        (["--scenes", "listed.yaml"], "scene listed lists values for every"),
        (["--held-out", "--scenes", "swimmer"], "must be among held_out_1, "),
        (["--held-out", "--scenes", "held_out_1", "paper_i"], "got paper_i"),
        (["--held-out", "--sweeps"], "--held-out and --sweeps are two things, name one"),
        (["--sweeps", "--quick"], "--sweeps has scenes and settings of its own"),
        *(
            (["--refresh-front", *other], "--refresh-front needs the full study")
            for other in (["--scenes", "two"], ["--quick"], ["--held-out"], ["--sweeps"])
        ),
    ],
)
def test_bad_input_is_one_line_and_code_2(given, part, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("other").mkdir()
    for name in ("x.yaml", "other/x.yaml"):
        Path(name).write_text("name: x\n", encoding="utf-8")
    Path("listed.yaml").write_text(f"beam: {{bending_stiffness: {[5] * 8}}}\n", encoding="utf-8")
    done = call_script(capsys, "accuracy_cost", *given, "--output", "out")
    done.assert_refused(part)
    assert done.out == "" and not Path("out").exists()


def test_sweeps_write_a_table_and_a_picture(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sweeps_module, "_AMPLITUDES", (0.05, 0.2, 3.0))
    monkeypatch.setattr(sweeps_module, "_FREQUENCIES", (3.0, 5.0))
    monkeypatch.setattr(sweeps_module, "_BENT_SECONDS", 1.0)
    monkeypatch.setattr(sweeps_module, "_RESONANT_SECONDS", 1.0)
    done = call_script(capsys, "accuracy_cost", "--sweeps", "--json", "--output", tmp_path)
    printed = done.figures()
    assert set(files_of(tmp_path)) == {"sweeps.json", "sweeps.md", "sweeps.png"}
    assert json.loads((tmp_path / "sweeps.json").read_text(encoding="utf-8")) == printed
    assert_is_a_picture(tmp_path / "sweeps.png")
    little, more, much = printed["bends"]
    # The more it bends, the less a model that is expanded about the straight body will do.
    assert 0.0 < little["largest_bend"] < more["largest_bend"]
    assert little["errors"]["frozen"] < more["errors"]["frozen"]
    assert more["errors"]["expansion"] < more["errors"]["frozen"] < more["errors"]["strip"]
    # Where panels cannot go on, there is nothing to compare with.
    assert much["largest_bend"] is None
    assert set(much["errors"].values()) == {None}
    assert len(much["reasons"]) == 3
    for sweep in printed["resonance"].values():
        assert [one["frequency"] for one in sweep] == [3.0, 5.0]
        assert all(math.isfinite(x) for one in sweep for x in one["displacement"].values())
    text = (tmp_path / "sweeps.md").read_text(encoding="utf-8")
    assert much["reasons"]["frozen"] in text
    assert text.count("## Across the first resonance") == 2


# ---- held-out scenes ---------------------------------------------------------------------------


def test_held_out_scenes_are_judged(tmp_path, monkeypatch, capsys):
    second = {"episode.duration": 1.0}
    cases = [Case(load_scene("swimmer", {"name": n, **second}), 1.0) for n in ("fine", "other")]
    monkeypatch.setattr("scripts.accuracy_cost.held_out_scenes", lambda: cases)
    monkeypatch.setattr("scripts.accuracy_cost.full_grid", lambda: TINY)
    given = ("--held-out", "--quick", "--scenes", "fine", "--json", "--output", tmp_path)
    printed = call_script(capsys, "accuracy_cost", *given).figures()
    assert (printed["choices"], printed["met"], printed["met_direct"]) == (1, 1, 1)
    assert set(files_of(tmp_path)) == {"held_out.json", "held_out.md"}
    (one,) = json.loads((tmp_path / "held_out.json").read_text(encoding="utf-8"))["judged"]
    assert (one["scene"], one["tolerance"], one["met"]) == ("fine", 0.03, True)
    assert one["error"] <= 0.03
    assert one["best_error"] <= 0.03
    assert one["cost_ratio"] > 0.0
    assert printed["timed"] == int(one["timed"])
    assert printed["largest_cost_ratio"] == (one["cost_ratio"] if one["timed"] else None)
    assert printed["largest_reference_gap"] == one["reference_gap"] < 0.02
    assert one["chosen"] in (tmp_path / "held_out.md").read_text(encoding="utf-8")


def test_choices_are_judged_by_a_direct_run_too(monkeypatch):
    """Against it, not against the reference; and costs count where something else was timed."""
    rough = Settings("panels", 9, 4, "proportional", 0.01, "composed")
    monkeypatch.setattr("studies.accuracy.held_out.DIRECT", rough)
    pilot = functools.partial(reference_of, refinements=PILOT)
    monkeypatch.setattr(
        "studies.accuracy.held_out.reference_of", lambda scene, duration, _: pilot(scene, duration)
    )
    scene = load_scene("swimmer", {"episode.duration": 1.0})
    case = Case(scene, 1.0)
    choice = choose(scene, 0.03)
    counted: list[int] = []
    # Nothing but the choice's own settings is there to be faster.
    (one,) = judge([case], [0.03], [choice.settings], counted.append)
    assert counted == [1, 1]
    direct, found = play(rough.apply(scene), 1.0), play(choice.scene, 1.0)
    assert one["direct_error"] == relative_error(found.displacement, direct.displacement, 1.0)
    assert one["met_direct"] is (one["direct_error"] <= 0.03)
    assert one["reference_gap"] == pilot(scene, 1.0).error(direct) > 0.0
    assert one["direct_error"] != one["error"]
    assert (one["timed"], one["cost_ratio"], one["best"]) == (False, 1.0, one["chosen"])

    # Without a direct run, as one that ends early is none, there is nothing to say.
    def ending(scene: Scene, duration: float) -> Outcome:
        reason = "turn_too_large" if settings_of(scene) == rough else ""
        return replace(play(scene, duration), termination_reason=reason)

    monkeypatch.setattr("studies.accuracy.held_out.play", ending)
    (one,) = judge([case], [0.03], [choice.settings])
    assert (one["direct_error"], one["met_direct"], one["reference_gap"]) == (None, False, None)


# ---- what effects cost -------------------------------------------------------------------------


@pytest.mark.parametrize("name", EFFECT_NAMES)
def test_a_pair_differs_in_its_effect_alone(name):
    present, absent = effect_pairs()[name]
    assert set(present.effects) ^ set(absent.effects) == {name}
    assert name in present.effects
    block = "beam.bending_stiffness" if name == "bending_stiffness" else name
    assert present.replace(block, None) == absent


def test_every_effect_is_measured():
    counted: list[int] = []
    measured = measure_effects(1, counted.append)
    assert {one["effect"] for one in measured} == set(EFFECT_NAMES)
    assert counted == [1] * len(EFFECT_NAMES)
    for one in measured:
        assert one.keys() == {"effect", "with", "without", "added", "removed"}
        for name in ("with", "without"):
            assert one[name]["rounds"] == 1
            assert one[name]["median"] > 0.0
        difference = one["with"]["median"] - one["without"]["median"]
        assert one["added"]["median"] == pytest.approx(difference)
        share = one["without"]["median"] / one["with"]["median"]
        assert one["removed"]["median"] == pytest.approx(share)
