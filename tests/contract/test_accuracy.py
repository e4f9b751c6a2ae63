"""Choosing settings for an accuracy, the study behind it, its command, and what effects cost."""

from __future__ import annotations

import argparse
import functools
import json
import math
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from swim_agents.commands.command_line import BAD_INPUT, FAILED, add_scene_arguments, run, scene_of

from scripts.accuracy_cost import main
from studies.accuracy.held_out import DIRECT, direct_run, judge
from studies.accuracy.picture import draw_study
from studies.accuracy.study import Study, Yardstick, timed_play
from studies.benchmark.effects import effect_pairs, measure_effects
from swim_env import EFFECT_NAMES, Scene, SimulationEndedError, SwimError, load_scene
from swim_env.accuracy import Choice, Settings, choose, play
from swim_env.accuracy import study as study_module
from swim_env.accuracy import sweeps as sweeps_module
from swim_env.accuracy.front import Measured, front_to_json, load_front, make_front
from swim_env.accuracy.grid import Case, full_grid, study_scenes
from swim_env.accuracy.outcome import Outcome, relative_error, solve
from swim_env.accuracy.reference import FINE, PILOT, Reference, Refinements, reference_of
from swim_env.accuracy.settings import PAPER_SETTINGS, settings_of

ROOT = Path(__file__).parents[2]


def short(changes: dict[str, object] | None = None) -> Scene:
    """Return the learning scene, three seconds of it."""
    return load_scene("swimmer", {"episode.duration": 3.0, **(changes or {})})


#: An undamped body at its first resonance, which collapses (PHYSICS section 4).
VIOLENT: dict[str, object] = {
    "damping": None,
    "actuation.amplitude": 2.0,
    "actuation.frequency": 5.2 * 2.0 * math.pi,
}


# ---- the shipped front -------------------------------------------------------------------------


def test_the_shipped_front_is_sorted_and_whole() -> None:
    front = load_front()
    assert len(front) > 3
    assert len({one.settings for one in front}) == len(front)
    costs = [one.cost for one in front]
    assert costs == sorted(costs)
    assert costs[0] > 0.0
    names = {case.scene.name for case in study_scenes()}
    for one in front:
        assert one.errors
        assert one.errors.keys() <= names
        assert all(0.0 < error < math.inf for error in one.errors.values())


def test_every_setting_of_the_shipped_front_fits_the_scene_for_learning() -> None:
    scene = load_scene("swimmer")
    for one in load_front():
        applied = one.settings.apply(scene)
        assert settings_of(applied) == one.settings
        assert applied.steps_per_action >= 1


def test_the_shipped_front_is_that_of_the_shipped_runs() -> None:
    """Whoever changes what a front is, or the runs, makes it anew with --refresh-front."""
    text = (ROOT / "docs" / "accuracy" / "runs.jsonl").read_text(encoding="utf-8")
    grid = set(full_grid())
    runs = [json.loads(line) for line in text.splitlines()]
    done = [one for one in runs if not one["reason"] and Settings.from_dict(one) in grid]
    assert make_front(done) == load_front()


# ---- choosing ----------------------------------------------------------------------------------

#: Scenes unlike each other: the second loses momentum and bends more.
SCENES: dict[str, dict[str, object]] = {
    "swimmer": {},
    "dragged": {"cross_flow_drag.coefficient": 2.0, "actuation.amplitude": 2.0},
}
each_scene = pytest.mark.parametrize("name", SCENES)


@functools.cache
def fine_displacement(name: str) -> np.ndarray:
    """Return what panels, twice the elements and the better scheme give."""
    fine = Settings("panels", 18, 4, "proportional", 0.01, "composed")
    outcome = play(fine.apply(short(SCENES[name])), 3.0)
    assert not outcome.termination_reason
    return outcome.displacement


def judged(name: str, scene: Scene) -> float:
    """Return the error of a scene's own settings."""
    outcome = play(scene, 3.0)
    assert not outcome.termination_reason
    return relative_error(outcome.displacement, fine_displacement(name), 1.0)


def without_settings(scene: Scene) -> dict[str, Any]:
    """Return what is no matter of settings."""
    data = scene.to_dict()
    del data["beam"]["elements"], data["integrator"], data["description"]
    for field in ("model", "panels_per_element", "cap_panels"):
        data["fluid"].pop(field)
    return data


@pytest.mark.parametrize("tolerance", [0.1, 0.03])
@each_scene
def test_the_chosen_settings_are_good_enough(name: str, tolerance: float) -> None:
    scene = short({**SCENES[name], "description": "Mine."})
    found = scene.for_accuracy(tolerance)
    assert judged(name, found) <= tolerance
    assert without_settings(found) == without_settings(scene)
    assert found.effects == scene.effects
    # It says what was chosen, for what, and on which grounds.
    chosen = settings_of(found)
    assert found.description.startswith(f"Mine. Settings chosen for {tolerance:g} of the displ")
    for part in (
        f"fluid model {chosen.fluid_model}",
        f"{chosen.elements} elements,",
        f"steps of {1e3 * chosen.time_step:g} ms of the {chosen.scheme} scheme",
        "off by",
        "times the cost",
        "cheaper ones tried were further off",
    ):
        assert part in found.description
    assert "\n" not in found.description


def test_a_choice_is_the_cheapest_that_is_good_enough() -> None:
    """Those before it on the front are tried and found wanting, those behind it are not tried."""
    scene = short()
    counted: list[int] = []
    choice = choose(scene, 0.02, progress=counted.append)
    assert isinstance(choice, Choice)
    assert choice.tolerance == 0.02
    assert choice.reason in scene.for_accuracy(0.02).description
    assert choice.scene == choice.settings.apply(scene)
    assert choice.error <= 0.02
    assert choice.uncertainty < 0.01
    assert sum(counted) >= choice.tried + 4
    reference = reference_of(scene, 3.0, PILOT)
    front = load_front()
    place = next(i for i, one in enumerate(front) if one.settings == choice.settings)
    assert choice.cost == front[place].cost
    assert choice.tried <= place + 1
    # As cheap and as good at a time is no better than the choice.
    for one in front[:place]:
        assert reference.error(play(one.settings.apply(scene), 3.0)) > 0.7 * 0.02


def test_more_accuracy_never_costs_less() -> None:
    costs = [choose(short(), tolerance).cost for tolerance in (0.3, 0.03, 0.01)]
    assert costs == sorted(costs)
    assert costs[0] < costs[-1]


def test_a_choice_is_the_same_every_time_and_of_any_settings() -> None:
    """How the scene was computed before does not matter, nor that it was chosen for already."""
    scene = short()
    one = scene.for_accuracy(0.03)
    other = OTHER.apply(scene).for_accuracy(0.03)
    assert other.replace("integrator", one.to_dict()["integrator"]) == one
    assert settings_of(one.for_accuracy(0.03)) == settings_of(one)


OTHER = Settings("expansion", 5, 8, 2, 0.02, "composed", "mean_angles", 1e-6)


@pytest.mark.parametrize("elements", [9, 6])
def test_elements_can_be_kept(elements: int) -> None:
    """For an agent with so many joints: the error is that of this body."""
    scene = short({"beam.elements": elements})
    found = scene.for_accuracy(0.03, keep_elements=True)
    assert found.beam == scene.beam
    assert f"{elements} elements (kept)" in found.description
    fine = Settings("panels", elements, 12, "proportional", 0.005, "composed")
    wanted = play(fine.apply(scene), 3.0).displacement
    assert relative_error(play(found, 3.0).displacement, wanted, 1.0) <= 0.03


def test_what_is_listed_for_every_element_can_be_kept_only() -> None:
    scene = short({"beam.bending_stiffness": [5.0] * 8})
    with pytest.raises(SwimError, match="lists values for every joint or element"):
        scene.for_accuracy(0.1)
    assert scene.for_accuracy(0.1, keep_elements=True).beam == scene.beam


# ---- fronts of one's own -----------------------------------------------------------------------


def use_front(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, *settings: Settings, text: str | None = None
) -> Path:
    """Let choices be made from these settings, the first the cheapest, or from a text."""
    path = tmp_path / "front.json"
    front = [Measured(one, 0.1 * (i + 1), {"swimmer": 0.1}) for i, one in enumerate(settings)]
    path.write_text(front_to_json(front, {}) if text is None else text, encoding="utf-8")
    monkeypatch.setattr("swim_env.accuracy.choice.load_front", functools.partial(load_front, path))
    return path


FROZEN = Settings("frozen", 9, 8, "proportional", 0.01, "composed")
STRIP = Settings("strip", 9, 4, 1, 0.01, "composed")
PANELS = Settings("panels", 9, 4, 1, 0.01, "composed")
LSODA = Settings("frozen", 5, 4, 1, 0.01, "LSODA", tolerance=1e-4)


def test_steps_that_do_not_fit_the_control_interval_are_passed_over(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    use_front(monkeypatch, tmp_path, FROZEN, replace(FROZEN, time_step=0.005))
    found = short({"episode.control_interval": 0.015}).for_accuracy(0.1)
    assert found.integrator.time_step == 0.005
    assert found.steps_per_action == 3
    assert short().for_accuracy(0.1).integrator.time_step == 0.01


def test_too_coarse_settings_are_passed_over(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Strips miss what a swimmer pushes off from by more than its displacement."""
    use_front(monkeypatch, tmp_path, STRIP, FROZEN)
    choice = choose(short(), 0.1)
    assert (choice.settings, choice.tried) == (FROZEN, 2)
    assert "the 1 cheaper ones tried were further off" in choice.reason


def test_solvers_are_no_candidates(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A scene cannot be set to one, so what it would be played with is something else."""
    use_front(monkeypatch, tmp_path, LSODA, FROZEN)
    choice = choose(short(), 0.1)
    assert (choice.settings, choice.tried) == (FROZEN, 1)
    use_front(monkeypatch, tmp_path, LSODA)
    assert refused(short(), 0.1).startswith("no settings of the measured front fit")


def test_settings_that_end_early_are_passed_over(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """On the way or at the start, whatever the displacement was until then."""
    at_once, soon = (replace(FROZEN, time_step=step) for step in (0.02, 0.0125))
    use_front(monkeypatch, tmp_path, at_once, soon, FROZEN)

    def breaking(scene: Scene, duration: float) -> Outcome:
        if settings_of(scene) == at_once:
            raise SimulationEndedError("mass_not_positive", 0.0, "made up")
        reason = "turn_too_large" if settings_of(scene) == soon else ""
        return replace(play(scene, duration), termination_reason=reason)

    monkeypatch.setattr("swim_env.accuracy.choice.play", breaking)
    assert choose(short({"episode.control_interval": 0.1}), 0.3).settings == FROZEN


def test_an_effect_that_needs_panels_gets_panels(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    use_front(monkeypatch, tmp_path, STRIP, FROZEN, PANELS)
    scene = load_scene("swimmer", {"episode.duration": 1.0, "axial_added_mass": True})
    choice = choose(scene, 0.1)
    assert (choice.settings, choice.tried) == (PANELS, 1)
    assert choice.scene.effects == scene.effects


def test_without_a_fluid_settings_that_differ_in_it_alone_are_one(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    # Four settings, of nine elements and of twelve.
    use_front(monkeypatch, tmp_path, STRIP, FROZEN, PANELS, replace(STRIP, elements=12))
    scene = short({"fluid": None, "beam.rotary_inertia": 1e-3, "initial.velocity": (0.1, 0.0)})
    choice = choose(scene, 0.03)
    # It drifts as it started, whatever it is computed with.
    assert choice.tried == 1
    assert choice.scene.fluid is None
    assert choice.settings.fluid_model == "none"
    assert play(choice.scene, 3.0).displacement == pytest.approx([0.25, 0.0], rel=1e-9)
    assert "fluid model none, 9 elements" in choice.reason

    monkeypatch.setattr(
        "swim_env.accuracy.choice.play",
        lambda *given: replace(play(*given), termination_reason="turn_too_large"),
    )
    with pytest.raises(SwimError, match=r"the best of 2 is off by inf"):
        choose(scene, 0.03)


def test_a_body_at_rest_without_a_drive_is_computed_in_the_cheapest_way(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    use_front(monkeypatch, tmp_path, STRIP, FROZEN)
    choice = choose(short({"actuation": None}), 1e-3)
    assert (choice.settings, choice.error, choice.uncertainty) == (STRIP, 0.0, 0.0)
    # A drifting one moves in a straight line as far as its added mass lets it, in all ways.
    drifting = short({"actuation": None, "initial.velocity": (0.1, 0.0)})
    moved = play(choose(drifting, 1e-3).scene, 3.0).displacement
    assert moved == pytest.approx([0.3, 0.0], abs=1e-12)


def test_where_nothing_is_good_enough_it_says_how_near_the_best_comes(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    use_front(monkeypatch, tmp_path, STRIP, replace(STRIP, elements=5))
    with pytest.raises(SwimError, match=r"swimmer to within 0\.1: the best of 2 is off by \d"):
        short().for_accuracy(0.1)


# ---- refusals ----------------------------------------------------------------------------------


def refused(scene: Scene, tolerance: float) -> str:
    """Return the one line with which a choice is refused."""
    with pytest.raises(SwimError) as caught:
        scene.for_accuracy(tolerance)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("tolerance", [0.0, -0.01, 5e-4, 0.31, 1.0, math.nan, math.inf])
def test_a_tolerance_beyond_reach_or_sense_is_refused(tolerance: float) -> None:
    said = refused(short(), tolerance)
    assert f"the tolerance must be 0.001 to 0.3, got {tolerance!r}" in said


def test_a_violent_scene_has_no_reference() -> None:
    said = refused(short(VIOLENT), 0.1)
    # A fine run ends early, or where it comes to rest differs from one to the next.
    assert re.match("scene swimmer (has no (converged )?reference|bends too far)", said)


@pytest.mark.parametrize(
    ("tolerance", "plans"),
    [(0.3, [PILOT]), (0.1, [PILOT, FINE]), (0.07, [PILOT, FINE])],
    ids=["plainly", "barely", "not"],
)
def test_a_reference_has_to_be_good_enough(
    tolerance: float, plans: list[Refinements], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Known to 4 %: past 0.3 of the tolerance a finer one is made, past half of it none is used."""
    asked: list[Refinements] = []

    def vague(scene: Scene, duration: float, plan: Refinements, *others: Any) -> Reference:
        asked.append(plan)
        return replace(reference_of(scene, duration, PILOT), uncertainty=0.04)

    monkeypatch.setattr("swim_env.accuracy.choice.reference_of", vague)
    if tolerance > 0.08:
        assert choose(short(), tolerance).uncertainty == 0.04
    else:
        said = refused(short(), tolerance)
        assert "no reference that is good enough for 0.07" in said
        assert "known to 4.0e-02 only" in said
    assert asked == plans


def test_a_reference_that_would_be_the_same_is_not_made_twice(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where every step weighs the panels, both plans are one."""
    made: list[Refinements] = []

    def vague(scene: Scene, duration: float, plan: Refinements, *others: Any) -> Reference:
        made.append(plan)
        return Reference(np.ones(2), np.ones((41, 2)), 1.0, 1.0, 0.04, 0.0, 0.0, {})

    monkeypatch.setattr("swim_env.accuracy.choice.reference_of", vague)
    for changes, plans in (({"axial_added_mass": True}, [PILOT]), ({}, [PILOT, FINE])):
        made.clear()
        assert "known to 4.0e-02 only" in refused(short(changes), 0.07)
        assert made == plans


def test_a_start_that_cannot_be_simulated_is_refused() -> None:
    """Nine elements that turn by 2 rad each lie on one another."""
    said = refused(short({"initial.joint_angles": 2.0, "axial_added_mass": True}), 0.1)
    assert "under_resolved_gap" in said


def test_a_missing_front_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    use_front(monkeypatch, tmp_path).unlink()
    said = refused(short(), 0.1)
    assert said.startswith("cannot read the measured front: No such file")
    assert said.endswith("front.json)")


@pytest.mark.parametrize("text", ["", "{}", '{"front": [{"cost": 1.0, "errors": {}}]}'])
def test_a_broken_front_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, text: str
) -> None:
    use_front(monkeypatch, tmp_path, text=text)
    assert refused(short(), 0.1).startswith("not a measured front: ")


def test_an_empty_front_has_nothing_good_enough(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    use_front(monkeypatch, tmp_path)
    assert refused(short(), 0.1).startswith("no settings of the measured front")


# ---- on the command line -----------------------------------------------------------------------


def test_replay_chooses_and_says_so() -> None:
    done = subprocess.run(
        [
            *(sys.executable, str(ROOT / "scripts" / "replay.py"), "--scene", "swimmer"),
            *("--duration", "2", "--accuracy", "0.1", "--json"),
        ],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        timeout=250,
    )
    assert done.returncode == 0, done.stderr
    figures = json.loads(done.stdout.splitlines()[-1])
    assert figures["scene"] == "swimmer"
    assert figures["duration"] == pytest.approx(2.0)
    assert len(done.stdout.splitlines()) == 1
    said = [line for line in done.stderr.splitlines() if "chosen for 0.1 of the displ" in line]
    assert len(said) == 1, done.stderr
    # What it said is what it did.
    step = float(said[0].partition("steps of ")[2].split()[0]) / 1e3
    assert figures["steps"] == round(2.0 / step)


def arguments(*given: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_scene_arguments(parser)
    return parser.parse_args(["--scene", "swimmer", *given])


def test_agents_keep_their_elements() -> None:
    choice = choose(short({"beam.elements": 6}), 0.1, keep_elements=True)
    assert choice.scene.beam.elements == 6
    assert "6 elements (kept)" in choice.reason


def test_without_an_accuracy_a_scene_stays_as_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert scene_of(arguments()) == load_scene("swimmer")
    assert capsys.readouterr() == ("", "")


# ---- the study ---------------------------------------------------------------------------------

TINY = [
    Settings("strip", 5, 4, 1, 0.02, "composed"),
    Settings("frozen", 5, 4, 1, 0.02, "composed"),
    Settings("frozen", 9, 8, "proportional", 0.01, "composed"),
    PAPER_SETTINGS,
]
ORIGIN = {"commit", "machine", "versions", "date"}
KEYS = {
    "scene",
    "case",
    "reason",
    "error",
    "path_error",
    "energy_error",
    "added_mass_error",
    "bent_added_mass_error",
    "displacement",
    "largest_bend",
    "cut_steps",
    "evaluations",
    "corrections",
    "seconds_per_second",
    "cost",
    *PAPER_SETTINGS.to_dict(),
}


@pytest.fixture
def cheap(monkeypatch: pytest.MonkeyPatch) -> list[Settings]:
    """References of a choice and a short yardstick; returns the settings that are played."""
    pilot = functools.partial(reference_of, refinements=PILOT)
    monkeypatch.setattr(study_module, "reference_of", pilot)
    monkeypatch.setattr(study_module, "Yardstick", functools.partial(Yardstick, 5))
    played: list[Settings] = []

    def counted(scene: Scene, *given: Any) -> Any:
        played.append(settings_of(scene))
        return timed_play(scene, *given)

    monkeypatch.setattr(study_module, "timed_play", counted)
    return played


def tiny_study(folder: Path, grid: list[Settings] | None = None) -> Study:
    return Study(folder, [Case(load_scene("swimmer"), 1.0)], TINY if grid is None else grid)


def interrupt_after(count: int) -> Callable[[int], None]:
    """Return a progress that is interrupted when something is done for the count-th time."""
    left = [count]

    def progress(steps: int) -> None:
        left[0] -= steps
        if left[0] <= 0:
            raise KeyboardInterrupt

    return progress


def lines_of(folder: Path) -> list[dict[str, Any]]:
    text = (folder / "runs.jsonl").read_text(encoding="utf-8")
    assert text.endswith("\n")
    return [json.loads(line) for line in text.splitlines()]


def test_every_run_is_a_line_with_the_same_keys(tmp_path: Path, cheap: list[Settings]) -> None:
    study = tiny_study(tmp_path / "above" / "study")
    counted: list[int] = []
    study.run(counted.append)
    assert counted == [1] * study.work == [1] * (1 + len(TINY))
    lines = lines_of(study.folder)
    assert [Settings.from_dict(line) for line in lines] == cheap == TINY
    for line in lines:
        assert line.keys() == KEYS
        assert line["reason"] == ""
        assert line["scene"] == "swimmer"
        for name in ("error", "path_error", "energy_error", "cost", "seconds_per_second"):
            assert 0.0 < line[name] < math.inf, name
    assert lines == study.runs == list(study.chosen_runs())
    by_model = {line["fluid_model"]: line for line in lines}
    assert by_model["strip"]["error"] > 10.0 * by_model["frozen"]["error"]
    stored = json.loads((study.folder / "references.json").read_text(encoding="utf-8"))
    assert stored.keys() == {*ORIGIN, "references", "cases"}
    reference = Reference.from_dict(stored["references"]["swimmer"])
    outcome = play(TINY[2].apply(load_scene("swimmer")), 1.0)
    assert reference.error(outcome) == lines[2]["error"]
    assert reference.path_error(outcome) == lines[2]["path_error"]


def test_solvers_are_played_in_continuous_time(tmp_path: Path, cheap: list[Settings]) -> None:
    """Their line has the same keys, their error is that of their own solution."""
    study = tiny_study(tmp_path, [LSODA, replace(LSODA, tolerance=1e-6), FROZEN])
    study.run()
    loose, tight, _ = lines = lines_of(tmp_path)
    assert [Settings.from_dict(line) for line in lines] == study.grid
    assert {frozenset(line) for line in lines} == {frozenset(KEYS)}
    outcome = solve(LSODA.apply(load_scene("swimmer")), 1.0, "LSODA", 1e-4)
    assert loose["displacement"] == outcome.displacement.tolist()
    assert loose["error"] == study.references["swimmer"].error(outcome)
    assert loose["evaluations"] == outcome.evaluations < tight["evaluations"]
    assert 0.0 < loose["seconds_per_second"] < loose["cost"]
    # Both are nearly exact in time: what they are off by is the chain's.
    assert loose["error"] == pytest.approx(tight["error"], rel=0.2)
    assert {one.settings for one in make_front(study.chosen_runs())} == {FROZEN}
    # What was done with one tolerance is not done again, and is not another's.
    cheap.clear()
    tiny_study(tmp_path, [LSODA, replace(LSODA, tolerance=1e-5)]).run()
    assert len(cheap) == 1
    assert lines_of(tmp_path)[-1]["tolerance"] == 1e-5


@pytest.mark.parametrize(
    ("raised", "reason"),
    [
        (SimulationEndedError("outline_degenerate", 0.3, "made up"), "outline_degenerate"),
        (SwimError("LSODA gave up at t = 0.3 s: made up"), "LSODA gave up at t = 0.3 s: made up"),
    ],
)
@pytest.mark.usefixtures("cheap")
def test_a_solver_that_does_not_get_there_is_kept_with_its_reason(
    raised: SwimError, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*given: Any, **named: Any) -> Outcome:
        raise raised

    monkeypatch.setattr(study_module, "solve", failing)
    study = tiny_study(tmp_path, [LSODA, STRIP])
    study.run()
    assert [line["reason"] for line in lines_of(tmp_path)] == [reason, ""]
    assert [Settings.from_dict(one) for one in study.chosen_runs()] == [STRIP]


def test_an_interrupted_study_goes_on_where_it_stopped(
    tmp_path: Path, cheap: list[Settings], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(KeyboardInterrupt):
        tiny_study(tmp_path).run(interrupt_after(3))
    before = lines_of(tmp_path)
    assert len(before) == 2
    # The reference is not made again, which takes minutes on a whole study.
    monkeypatch.setattr(study_module, "reference_of", None)
    references = (tmp_path / "references.json").read_bytes()
    cheap.clear()
    again = tiny_study(tmp_path)
    counted: list[int] = []
    again.run(counted.append)
    assert cheap == TINY[2:]
    assert sum(counted) == again.work
    assert lines_of(tmp_path)[:2] == before
    assert len(lines_of(tmp_path)) == 4
    assert (tmp_path / "references.json").read_bytes() == references
    cheap.clear()
    tiny_study(tmp_path).run()
    assert cheap == []


@pytest.mark.parametrize("left", [1, 40, -1], ids=["a character", "some", "all but the end"])
def test_a_half_written_line_is_done_again(
    tmp_path: Path, cheap: list[Settings], left: int
) -> None:
    tiny_study(tmp_path, TINY[:2]).run()
    whole = lines_of(tmp_path)
    path = tmp_path / "runs.jsonl"
    first, second, _ = path.read_text(encoding="utf-8").split("\n")
    path.write_text(f"{first}\n{second[:left]}", encoding="utf-8")
    cheap.clear()
    study = tiny_study(tmp_path, TINY[:2])
    assert study.runs == whole[:1]
    study.run()
    assert cheap == TINY[1:2]
    assert [line["error"] for line in lines_of(tmp_path)] == [line["error"] for line in whole]


def test_a_half_written_first_line_is_done_again(tmp_path: Path, cheap: list[Settings]) -> None:
    (tmp_path / "runs.jsonl").write_text('{"scene": "swim', encoding="utf-8")
    study = tiny_study(tmp_path, TINY[:1])
    assert study.runs == []
    study.run()
    assert len(tiny_study(tmp_path, TINY[:1]).runs) == 1


def test_a_grid_that_grows_keeps_what_was_done(tmp_path: Path, cheap: list[Settings]) -> None:
    tiny_study(tmp_path, TINY[:1]).run()
    cheap.clear()
    study = tiny_study(tmp_path, TINY[:2])
    study.run()
    assert cheap == TINY[1:2]
    # What another grid left there is not this one's.
    smaller = tiny_study(tmp_path, TINY[1:2])
    assert len(smaller.runs) == 2
    assert [Settings.from_dict(one) for one in smaller.chosen_runs()] == TINY[1:2]


def test_a_run_that_ends_early_is_kept_with_its_reason(
    tmp_path: Path, cheap: list[Settings], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It has no error, is on no front, and is not tried again."""
    any_reference = Reference(np.ones(2), np.ones((41, 2)), 1.0, 1.0, 0.0, 0.0, 0.0, {})
    monkeypatch.setattr(study_module, "reference_of", lambda *_: any_reference)
    # Half a wave of ten times what this body can take rolls it up; only panels see that.
    soft = {"beam.bending_stiffness": 0.2, "actuation.wave_number": math.pi}
    rolled = {"damping.retardation_time": 0.05, "actuation.amplitude": 3.0, **soft}
    case = Case(load_scene("swimmer", rolled), 1.0)
    study = Study(tmp_path, [case], [PANELS, STRIP])
    study.run()
    line = lines_of(tmp_path)[0]
    assert line["reason"] in ("under_resolved_gap", "outline_degenerate")
    assert line.keys() == KEYS
    assert line["error"] is None
    assert "Infinity" not in (tmp_path / "runs.jsonl").read_text(encoding="utf-8")
    assert [Settings.from_dict(one) for one in study.chosen_runs()] == [STRIP]
    cheap.clear()
    Study(tmp_path, [case], [PANELS]).run()
    assert cheap == []


@pytest.mark.parametrize(
    ("name", "text", "part"),
    [
        ("runs.jsonl", "dear diary\n", "not the runs of a study"),
        ("runs.jsonl", '{"scene": "swimmer"\n{}\n', "not the runs of a study"),
        ("references.json", "", "not the references of a study"),
        ("references.json", "[]", "not the references of a study"),
        (
            "references.json",
            '{"references": {"a": {"energy": 1}}}',
            "not the references of a study",
        ),
    ],
)
def test_files_that_are_none_of_a_study_are_refused(
    tmp_path: Path, name: str, text: str, part: str
) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(SwimError, match=f"{part}: .*{name}") as caught:
        tiny_study(tmp_path)
    assert "\n" not in str(caught.value)
    assert (tmp_path / name).read_text(encoding="utf-8") == text


def test_costs_are_in_units_of_the_papers_settings() -> None:
    """Playing the yardstick's own scene costs one, give or take what the machine does meanwhile."""
    scene = PAPER_SETTINGS.apply(load_scene("paper_i"))
    costs = [timed_play(scene, 1.0, Yardstick(100)) for _ in range(3)]
    assert 0.4 < float(np.median([cost for *_, cost in costs])) < 2.0
    outcome, seconds, _ = costs[0]
    assert outcome.steps == 100
    assert seconds > 0.0


# ---- the command -------------------------------------------------------------------------------

FILES = {
    "runs.jsonl",
    "references.json",
    "front.json",
    "tables.md",
    "study.json",
    "work_precision.png",
}


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch, cheap: list[Settings]) -> list[Settings]:
    """A command with a tiny grid and one second of three scenes."""
    few = [Case(load_scene("swimmer", {"name": name}), 1.0) for name in ("one", "swimmer", "two")]
    for grid in ("quick_grid", "full_grid"):
        monkeypatch.setattr(f"scripts.accuracy_cost.{grid}", lambda: TINY)
    monkeypatch.setattr("scripts.accuracy_cost.study_scenes", lambda: few)
    return cheap


def assert_is_a_picture(path: Path) -> None:
    with Image.open(path) as picture:
        assert picture.format == "PNG"
        pixels = np.asarray(picture.convert("RGB"))
    assert 200 < min(pixels.shape[:2])
    assert max(pixels.shape[:2]) < 4000
    # More than a frame and a title: neither nearly white nor nearly full.
    inked = float((pixels.min(axis=2) < 250).mean())
    assert 0.01 < inked < 0.9, f"{path.name}: {inked:.1%} drawn on"


def test_the_command_writes_a_whole_study(
    tmp_path: Path, tiny: list[Settings], capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["--quick", "--scenes", "swimmer", "--output", str(tmp_path / "out")]
    assert run(main, [*given, "--json"]) == 0
    out, err = capsys.readouterr()
    printed = json.loads(out.splitlines()[-1])
    assert err.splitlines()[-1] == f"results are in {tmp_path / 'out'}"
    folder = tmp_path / "out"
    assert {path.name for path in folder.iterdir()} == FILES
    assert json.loads((folder / "study.json").read_text(encoding="utf-8")) == printed
    assert printed["runs"] == len(TINY)
    assert printed["scenes"].keys() == {"swimmer"}
    figures = printed["scenes"]["swimmer"]
    # As far as the grid has the runs for it.
    assert figures["paper_settings"].keys() == {"all"}
    errors = [point["error"] for point in figures["front"]]
    assert errors == sorted(errors, reverse=True)
    costs = [point["cost"] for point in figures["front"]]
    assert costs == sorted(costs)
    front = load_front(folder / "front.json")
    assert {one.settings for one in front} <= set(TINY)
    # What is off by more than 30 % may be on a scene's front, but is no candidate.
    useful = {one["settings"] for one in figures["front"] if one["error"] < 0.3}
    assert {one.settings.label for one in front} >= useful > set()
    assert json.loads((folder / "front.json").read_text(encoding="utf-8"))["machine"]
    assert_is_a_picture(folder / "work_precision.png")
    text = (folder / "tables.md").read_text(encoding="utf-8")
    for table in text.split("\n\n"):
        rows = [line.count("|") for line in table.splitlines() if line.startswith("|")]
        assert len(set(rows)) <= 1, table
    for part in ("## References", "## Front of swimmer", "panels 9x4/1 10 ms paper (the paper's)"):
        assert part in text
    # A second start has nothing to do, and says the same in words.
    tiny.clear()
    assert run(main, given) == 0
    assert tiny == []
    out = capsys.readouterr().out
    assert out.startswith("swimmer: known to ")
    assert len(out.splitlines()) == 1 + len(figures["front"])


@pytest.fixture
def unseen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures that are drawn elsewhere are not drawn again."""
    monkeypatch.setattr("scripts.accuracy_cost.draw_study", lambda *_: None)
    monkeypatch.setattr("scripts.accuracy_cost.save_figure", lambda *_: None)
    monkeypatch.setattr("scripts.accuracy_cost.quick_grid", lambda: TINY[:2])
    monkeypatch.setattr("scripts.accuracy_cost.full_grid", lambda: TINY[1:3])


@pytest.mark.usefixtures("tiny", "unseen")
def test_quick_takes_the_first_two_scenes(tmp_path: Path) -> None:
    assert run(main, ["--quick", "--output", str(tmp_path)]) == 0
    assert [line["scene"] for line in lines_of(tmp_path)] == ["one"] * 2 + ["swimmer"] * 2


@pytest.mark.usefixtures("tiny", "unseen")
def test_a_study_takes_any_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One of its own, a shipped one and a file, each for as long as its episode is."""
    mine = tmp_path / "mine.yaml"
    mine.write_text("episode:\n  duration: 1.0\n", encoding="utf-8")
    cases: list[Case] = []

    def recorded(folder: Path, given: list[Case], grid: list[Settings]) -> Study:
        cases.extend(given)
        # A second of each is enough.
        return Study(folder, [Case(case.scene, 1.0) for case in given], grid)

    monkeypatch.setattr("scripts.accuracy_cost.Study", recorded)
    out = tmp_path / "out"
    given = ["two", "paper_v", str(mine), "two"]
    assert run(main, ["--quick", "--scenes", *given, "--output", str(out)]) == 0
    assert [(case.scene.name, case.duration) for case in cases] == [
        ("two", 1.0),
        ("paper_v", 20.0),
        ("mine", 1.0),
    ]
    assert cases[1].scene == load_scene("paper_v")
    assert [line["scene"] for line in lines_of(out)] == ["two"] * 2 + ["paper_v"] * 2 + ["mine"] * 2
    assert "## Front of mine" in (out / "tables.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("files", "part"),
    [
        ({"a": "name: x", "b": "name: x"}, "--scenes has two scenes of the name x, rename one"),
        ({"a": "beam:\n  bending_stiffness: [5, 5, 5, 5, 5, 5, 5, 5]"}, "a lists values for every"),
        ({"a": "beam:\n  elements: 0"}, "beam.elements"),
    ],
    ids=["two of a name", "listed", "not valid"],
)
def test_scenes_that_no_study_can_take_are_refused(
    files: dict[str, str], part: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = []
    for name, text in files.items():
        paths.append(tmp_path / f"{name}.yaml")
        paths[-1].write_text(text + "\n", encoding="utf-8")
    given = ["--scenes", *map(str, paths), "--output", str(tmp_path / "out")]
    assert run(main, given) == BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()
    assert part in line
    assert not (tmp_path / "out").exists()


def test_the_picture_tells_solvers_apart(tmp_path: Path, cheap: list[Settings]) -> None:
    """With an entry of the legend for those that were run, and marks unlike the schemes'."""
    study = tiny_study(tmp_path, [LSODA, replace(LSODA, scheme="Radau"), FROZEN])
    study.run()
    assert len(cheap) == 3
    figure = draw_study(list(study.chosen_runs()), study.references)
    (legend,) = figure.legends
    said = [text.get_text() for text in legend.get_texts()]
    assert [one for one in said if "SciPy" in one] == ["SciPy's Radau", "SciPy's LSODA"]
    marks = {line.get_marker() for line in figure.axes[0].get_lines()} - {"None"}
    assert len(marks) == 3
    runs = [run for run in study.chosen_runs() if run["scheme"] == "composed"]
    names = [text.get_text() for text in draw_study(runs, study.references).legends[0].get_texts()]
    assert not [one for one in names if "SciPy" in one]


@pytest.mark.usefixtures("tiny", "unseen")
@pytest.mark.parametrize("other", [["--scenes", "two"], ["--quick"], ["--held-out"], ["--sweeps"]])
def test_only_a_full_study_makes_the_shipped_front(
    other: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(main, [*other, "--refresh-front"]) == 2
    assert "--refresh-front needs the full study" in capsys.readouterr().err


def test_sweeps_write_a_table_and_a_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sweeps_module, "_AMPLITUDES", (0.05, 0.2, 3.0))
    monkeypatch.setattr(sweeps_module, "_FREQUENCIES", (3.0, 5.0))
    monkeypatch.setattr(sweeps_module, "_BENT_SECONDS", 1.0)
    monkeypatch.setattr(sweeps_module, "_RESONANT_SECONDS", 1.0)
    assert run(main, ["--sweeps", "--json", "--output", str(tmp_path)]) == 0
    printed = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert {path.name for path in tmp_path.iterdir()} == {"sweeps.json", "sweeps.md", "sweeps.png"}
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


def test_held_out_scenes_are_judged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cases = [
        Case(short({"name": "fine", "episode.duration": 1.0}), 1.0),
        Case(short({"name": "other", "episode.duration": 1.0}), 1.0),
    ]
    monkeypatch.setattr("scripts.accuracy_cost.held_out_scenes", lambda: cases)
    monkeypatch.setattr("scripts.accuracy_cost.full_grid", lambda: TINY)
    given = ["--held-out", "--quick", "--scenes", "fine", "--json", "--output", str(tmp_path)]
    assert run(main, given) == 0
    printed = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (printed["choices"], printed["met"], printed["met_direct"]) == (1, 1, 1)
    assert {path.name for path in tmp_path.iterdir()} == {"held_out.json", "held_out.md"}
    (one,) = json.loads((tmp_path / "held_out.json").read_text(encoding="utf-8"))["judged"]
    assert (one["scene"], one["tolerance"], one["met"]) == ("fine", 0.03, True)
    assert one["error"] <= 0.03
    assert one["best_error"] <= 0.03
    assert one["cost_ratio"] > 0.0
    assert printed["timed"] == int(one["timed"])
    assert printed["largest_cost_ratio"] == (one["cost_ratio"] if one["timed"] else None)
    assert printed["largest_reference_gap"] == one["reference_gap"] < 0.02
    assert one["chosen"] in (tmp_path / "held_out.md").read_text(encoding="utf-8")


def test_choices_are_judged_by_a_direct_run_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Against it, not against the reference; and costs count where something else was timed."""
    rough = Settings("panels", 9, 4, "proportional", 0.01, "composed")
    monkeypatch.setattr("studies.accuracy.held_out.DIRECT", rough)
    pilot = functools.partial(reference_of, refinements=PILOT)
    monkeypatch.setattr(
        "studies.accuracy.held_out.reference_of", lambda scene, duration, _: pilot(scene, duration)
    )
    scene = short({"episode.duration": 1.0})
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

    # A search by hand that finds something is timed against it.
    other = replace(FROZEN, elements=5)
    monkeypatch.setattr("studies.accuracy.held_out._best_by_hand", lambda *_: (other, 0.02))
    (one,) = judge([case], [0.03], [other])
    assert (one["timed"], one["best"]) == (True, other.label)
    assert one["cost_ratio"] != 1.0

    # Without a direct run there is nothing to say.
    monkeypatch.setattr("studies.accuracy.held_out.direct_run", lambda _: None)
    (one,) = judge([case], [0.03], [other])
    assert (one["direct_error"], one["met_direct"], one["reference_gap"]) == (None, False, None)


def test_a_direct_run_that_ends_early_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case(short(), 1.0)
    played: list[Scene] = []

    def ending(scene: Scene, duration: float) -> Outcome:
        played.append(scene)
        return replace(play(FROZEN.apply(scene), duration), termination_reason="turn_too_large")

    monkeypatch.setattr("studies.accuracy.held_out.play", ending)
    assert direct_run(case) is None
    assert [settings_of(scene) for scene in played] == [DIRECT]

    def refusing(scene: Scene, duration: float) -> Outcome:
        raise SimulationEndedError("outline_degenerate", 0.0, "made up")

    monkeypatch.setattr("studies.accuracy.held_out.play", refusing)
    assert direct_run(case) is None


@pytest.mark.parametrize(
    ("given", "part"),
    [
        (["--scenes", "swimer"], "--scenes takes paper_i, swimmer, resonant, "),
        (["--scenes", "swimmer", "no_such"], "a scene file: unknown scene 'no_such'"),
        (["--held-out", "--scenes", "swimmer"], "must be among held_out_1, "),
        (["--held-out", "--scenes", "held_out_1", "paper_i"], "got paper_i"),
        (["--held-out", "--sweeps"], "--held-out and --sweeps are two things, name one"),
    ],
)
def test_bad_input_is_one_line_and_code_2(
    given: list[str], part: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(main, [*given, "--quick", "--output", str(tmp_path / "out")]) == BAD_INPUT == 2
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    assert line.startswith("error: ")
    assert part in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("tiny")
def test_a_folder_that_is_a_file_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").write_text("mine")
    assert run(main, ["--quick", "--output", str(tmp_path / "out")]) == FAILED
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: File exists")
    assert (tmp_path / "out").read_text() == "mine"


# ---- what effects cost -------------------------------------------------------------------------


@pytest.mark.parametrize("name", EFFECT_NAMES)
def test_a_pair_differs_in_its_effect_alone(name: str) -> None:
    present, absent = effect_pairs()[name]
    assert set(present.effects) ^ set(absent.effects) == {name}
    assert name in present.effects
    if name == "bending_stiffness":
        assert present.replace("beam.bending_stiffness", None) == absent
    else:
        assert present.replace(name, None) == absent


def test_every_effect_is_measured() -> None:
    counted: list[int] = []
    measured = measure_effects(1, counted.append)
    assert {one["effect"] for one in measured} == set(EFFECT_NAMES)
    assert counted == [1] * len(EFFECT_NAMES)
    for one in measured:
        assert one.keys() == {"effect", "with", "without", "added", "removed"}
        for name in ("with", "without"):
            assert one[name]["rounds"] == 1
            # A step takes some ten microseconds; a hundredth of a second would be no step.
            assert 1.0 < one[name]["median"] < 1e4
        difference = one["with"]["median"] - one["without"]["median"]
        assert one["added"]["median"] == pytest.approx(difference)
        share = one["without"]["median"] / one["with"]["median"]
        assert one["removed"]["median"] == pytest.approx(share)
