"""Parts of the study of accuracy and cost, on made-up runs whose answer is known."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from studies.accuracy.held_out import DIRECT
from studies.accuracy.mass_error import BEND, mass_errors, rigid_added_mass
from studies.accuracy.report import budget_of, held_out_table, study_tables, what_time_buys
from studies.accuracy.study import _digest
from swim_env import Scene, SceneError, SwimError, Trajectory, load_scene
from swim_env.accuracy.front import (
    Measured,
    front_to_json,
    load_front,
    make_front,
    pareto,
)
from swim_env.accuracy.grid import (
    FINE_STEPS,
    SOLVED,
    case_of,
    full_grid,
    held_out_scenes,
    quick_grid,
    study_scenes,
)
from swim_env.accuracy.outcome import SAMPLES, Outcome, outcome_of, play, relative_error, solve
from swim_env.accuracy.reference import (
    FINE,
    PILOT,
    Reference,
    Refinements,
    plan_for,
    reference_of,
)
from swim_env.accuracy.settings import PAPER_SETTINGS, Settings, settings_of
from swim_env.analysis.continuous import METHODS, integrate
from swim_env.physics import added_mass_of_polygon
from tests.analytic.conformal import rectangle_mass

Array = NDArray[np.float64]


# ---- outcomes ----------------------------------------------------------------------------------


def _trajectory(
    times: Array, path: Array, energy: Array | None = None, **changes: object
) -> Trajectory:
    """Return a run of straight bodies along a path."""
    scene = load_scene("swimmer", {"beam.elements": 3, **changes})
    steps = len(times) - 1
    zeros = np.zeros(steps)
    return Trajectory(
        scene=scene,
        termination_reason="",
        time=times,
        centres=np.repeat(path[:, None, :], 3, axis=1),
        angles=np.zeros((steps + 1, 3)),
        torques=np.zeros((steps, 2)),
        momentum=np.zeros((steps + 1, 3)),
        energy=np.zeros(steps + 1) if energy is None else energy,
        **dict.fromkeys(
            (
                "work",
                "positive_work",
                "dissipated",
                "residual",
                "iterations",
                "evaluations",
                "at_round_off",
            ),
            zeros,
        ),
        parts=np.ones(steps),
        impulse=np.zeros((steps, 3)),
    )


def _driven(period: float) -> dict[str, object]:
    return {"actuation.frequency": 2.0 * math.pi / period}


#: Whole numbers of steps of 0.01 s, and none.
PERIODS = (1.0, 0.25, 0.337, 1.0 / math.e, 0.0042)


@pytest.mark.parametrize("period", PERIODS)
def test_the_mean_of_a_straight_line_is_its_middle(period: float) -> None:
    times = 0.01 * np.arange(301)
    path = np.stack([0.7 - 0.3 * times, 0.2 * times], axis=1)
    found = outcome_of(_trajectory(times, path, 5.0 + times, **_driven(period)), 3.0, 1.0)
    middle = 3.0 - 0.5 * period
    # The start is taken off, so that it does not matter where a body begins.
    assert found.displacement == pytest.approx([-0.3 * middle, 0.2 * middle], abs=1e-12)
    assert found.energy == pytest.approx(5.0 + middle, abs=1e-11)


@pytest.mark.parametrize("period", PERIODS)
def test_the_mean_of_any_broken_line_is_exact(period: float) -> None:
    """Trapezoids over all corners, and over the instant at which the last period begins."""
    rng = np.random.default_rng(3)
    times = np.sort(rng.uniform(0.0, 2.0, 40))
    path = rng.normal(size=(40, 2))
    found = outcome_of(_trajectory(times, path, **_driven(period)), 2.0, 1.0)
    begin = times[-1] - period
    corners = np.concatenate([[begin], times[times > begin]])
    for i in range(2):
        values = np.interp(corners, times, path[:, i] - path[0, i])
        wanted = np.trapezoid(values, corners) / period
        assert found.displacement[i] == pytest.approx(wanted, abs=1e-10)


@pytest.mark.parametrize("period", PERIODS[:4])
def test_an_oscillation_at_the_drives_period_averages_out(period: float) -> None:
    times = 0.01 * np.arange(301)
    swing = 2.0 * math.pi / period
    path = np.stack([-0.3 * times + 0.1 * np.sin(swing * times + 0.4), 0.0 * times], axis=1)
    found = outcome_of(_trajectory(times, path, **_driven(period)), 3.0, 1.0)
    wanted = -0.3 * (3.0 - 0.5 * period) - 0.1 * math.sin(0.4)
    # Chords cut the sine off by at most h^2/8 times its second derivative.
    bound = 0.1 * (swing * 0.01) ** 2 / 8.0
    assert abs(found.displacement[0] - wanted) < bound


@pytest.mark.parametrize(
    ("changes", "window"),
    [
        ({"actuation.frequency": -4.0 * math.pi}, 0.5),
        ({"actuation.frequency": 0.1}, 3.0),
        ({"actuation.frequency": 0.0}, 3.0),
        ({"actuation": None}, 0.0),
    ],
    ids=["backwards", "slower than the run", "constant", "none"],
)
def test_what_counts_as_the_last_period(changes: dict[str, object], window: float) -> None:
    times = 0.01 * np.arange(301)
    path = np.stack([times, -2.0 * times], axis=1)
    found = outcome_of(_trajectory(times, path, **changes), 3.0, 1.0)
    middle = 3.0 - 0.5 * window
    assert found.displacement == pytest.approx([middle, -2.0 * middle], abs=1e-12)


def test_the_path_is_sampled_at_equal_times_of_any_step() -> None:
    """Straight lines are met whatever the step; a run that ended early stays where it was."""
    found = []
    for step in (0.01, 0.013, 0.3):
        times = step * np.arange(round(3.0 / step) + 2)
        path = np.stack([0.2 * times + 1.0, -times], axis=1)
        found.append(outcome_of(_trajectory(times, path), 3.0, 1.0).path)
    wanted = np.linspace(0.0, 3.0, SAMPLES + 1)
    for path in found:
        assert path == pytest.approx(np.stack([0.2 * wanted, -wanted], axis=1), abs=1e-12)
    times = 0.01 * np.arange(151)
    early = outcome_of(_trajectory(times, np.stack([times, times], axis=1)), 3.0, 1.0)
    assert early.path[-1] == pytest.approx([1.5, 1.5])
    assert early.path[SAMPLES // 2] == pytest.approx([1.5, 1.5])


def test_the_largest_bend_and_cut_steps_are_counted() -> None:
    times = 0.01 * np.arange(4)
    run = _trajectory(times, np.zeros((4, 2)))
    run.angles[2] = [0.1, -0.3, 0.2]
    run.parts[1:] = [2.0, 4.0]
    found = outcome_of(run, 0.03, 7.0)
    assert found.largest_bend == pytest.approx(0.5)
    assert (found.steps, found.cut_steps, found.seconds) == (3, 2, 7.0)
    assert len(found.values) == 2 + 1 + 2 * (SAMPLES + 1)


@pytest.mark.parametrize(
    ("found", "wanted", "length", "error"),
    [
        ([1.0, 0.0], [1.0, 0.0], 1.0, 0.0),
        ([1.1, 0.0], [1.0, 0.0], 1.0, 0.1),
        ([0.0, 1.0], [1.0, 0.0], 1.0, math.sqrt(2.0)),
        ([3.3, 4.4], [3.0, 4.0], 1.0, 0.1),
        # Below a hundredth of the length it is an error in hundredths of the length.
        ([0.001, 0.0], [0.0, 0.0], 1.0, 0.1),
        ([0.002, 0.0], [0.001, 0.0], 2.0, 0.05),
        ([math.nan, 0.0], [1.0, 0.0], 1.0, math.inf),
        ([math.inf, 0.0], [1.0, 0.0], 1.0, math.inf),
    ],
)
def test_the_scale_of_errors(
    found: list[float], wanted: list[float], length: float, error: float
) -> None:
    measured = relative_error(np.array(found), np.array(wanted), length)
    assert measured == pytest.approx(error, abs=1e-15)


def _outcome(values: Array, reason: str = "") -> Outcome:
    """Return a run with these displacement, energy and path."""
    path = values[3:].reshape(SAMPLES + 1, 2)
    return Outcome(values[:2], path, float(values[2]), 0.1, 10, 0.1, 0, reason)


def test_errors_of_path_and_energy() -> None:
    along = np.linspace(0.0, 2.0, SAMPLES + 1)
    path = np.stack([along, 0.0 * along], axis=1)
    reference = Reference(path[-1], path, 4.0, 1.0, 0.0, 0.0, 0.0, {})
    off = path.copy()
    off[7] += [0.3, -0.4]
    run = replace(_outcome(np.zeros(85)), displacement=path[-1] + [0.0, 0.2], path=off, energy=3.0)
    # The largest distance of 0.5 on a path of extent 2, and a quarter of the energy.
    assert reference.path_error(run) == pytest.approx(0.25)
    assert reference.energy_error(run) == pytest.approx(0.25)
    assert reference.error(run) == pytest.approx(0.1)
    early = replace(run, termination_reason="turn_too_large")
    for error in (reference.error, reference.path_error, reference.energy_error):
        assert error(early) == math.inf


def test_errors_of_a_body_that_stays_put_are_finite() -> None:
    still = Reference(np.zeros(2), np.zeros((SAMPLES + 1, 2)), 0.0, 2.0, 0.0, 0.0, 0.0, {})
    values = np.zeros(85)
    assert still.error(_outcome(values)) == 0.0
    assert still.path_error(_outcome(values)) == 0.0
    assert still.energy_error(_outcome(values)) == 0.0
    values[2:4] = [0.5, 0.01]
    assert still.energy_error(_outcome(values)) == 0.5
    assert still.path_error(_outcome(values)) == pytest.approx(0.5)


# ---- SciPy's solvers ---------------------------------------------------------------------------

SWING = Settings("frozen", 3, 4, 1, 0.01, "composed")
TIGHT = replace(SWING, scheme="DOP853", tolerance=1e-8)


def _soft(**changes: object) -> Scene:
    gentle = {"beam.bending_stiffness": 0.5, "actuation.amplitude": 0.2}
    return load_scene("swimmer", {**gentle, **changes})


def test_a_solvers_run_is_what_small_steps_converge_to() -> None:
    """In all that is compared, averaged over the last period in the same way."""
    scene = SWING.apply(_soft(**{"stream.velocity": (0.3, 0.0)}))
    found = solve(scene, 2.0, "DOP853", 1e-8)
    errors = []
    for step in (0.01, 0.005):
        steps = play(replace(SWING, time_step=step).apply(scene), 2.0)
        errors.append(float(np.abs(steps.values - found.values).max()))
        assert steps.largest_bend == pytest.approx(found.largest_bend, rel=0.01)
        assert steps.corrections > steps.steps == round(2.0 / step)
    assert errors[1] < 0.3 * errors[0] < 1e-3
    assert (found.steps, found.cut_steps, found.termination_reason) == (200, 0, "")
    assert found.seconds > 0.0


def test_a_solvers_absolute_tolerance_is_a_hundredth_of_the_relative_one() -> None:
    scene = SWING.apply(_soft())
    found, wanted = solve(scene, 0.5, "LSODA", 1e-4), integrate(scene, 0.5, "LSODA", 1e-4, 1e-6)
    assert found.path[-1] == pytest.approx(wanted.path[-1] - wanted.path[0], rel=1e-12)
    assert found.evaluations == wanted.evaluations > 10
    assert found.corrections == 0
    # A tighter one takes more evaluations.
    assert solve(scene, 0.5, "LSODA", 1e-7).evaluations > 1.3 * found.evaluations


def test_evaluations_of_the_kernels_are_counted() -> None:
    """With panels two or three for a step, where the fluid is constant hardly any."""
    for model, least, most in (("panels", 1.0, 4.0), ("frozen", 0.0, 0.5)):
        found = play(replace(SWING, fluid_model=model, scheme="paper").apply(_soft()), 1.0)
        assert least < found.evaluations / found.steps < most, model
        assert found.corrections >= found.steps


@pytest.mark.parametrize("method", METHODS)
def test_settings_name_a_solver_and_leave_the_scenes_integrator_alone(method: str) -> None:
    scene = load_scene("swimmer", {"integrator.tolerance": 1e-7, "integrator.scheme": "composed"})
    settings = replace(OTHERS, scheme=method, tolerance=1e-3)
    assert settings.solver == method
    assert settings.label == f"frozen 7x8/p {method} rtol 0.001"
    assert Settings.from_dict(json.loads(json.dumps(settings.to_dict()))) == settings
    applied = settings.apply(scene)
    assert (applied.integrator.scheme, applied.integrator.tolerance) == ("composed", 1e-7)
    assert settings_of(applied) == replace(OTHERS, scheme="composed", tolerance=1e-7)
    assert OTHERS.solver is None


# ---- settings ----------------------------------------------------------------------------------

MODELS = ("strip", "frozen", "expansion", "panels", "centreline")
OTHERS = Settings("frozen", 7, 8, "proportional", 0.004, "composed", "mean_angles", 1e-8)


@pytest.mark.parametrize("settings", [PAPER_SETTINGS, OTHERS, replace(OTHERS, cap_panels=3)])
def test_settings_survive_json_and_a_scene(settings: Settings) -> None:
    text = json.dumps({**settings.to_dict(), "cost": 1.0, "scene": "any"})
    assert Settings.from_dict(json.loads(text)) == settings
    assert settings_of(settings.apply(load_scene("swimmer"))) == settings


@pytest.mark.parametrize("model", MODELS)
def test_every_model_can_be_set_and_taken_back(model: str) -> None:
    scene = load_scene("swimmer")
    other = replace(PAPER_SETTINGS, fluid_model=model).apply(scene)
    assert settings_of(other).fluid_model == model
    assert settings_of(scene).apply(other) == scene


def test_settings_change_nothing_else() -> None:
    """Body, drive, effects, start and episode stay, whatever is computed how."""
    scene = load_scene(
        "swimmer",
        {
            "name": "mine",
            "description": "words",
            "beam.length": 1.3,
            "beam.bending_stiffness": {"linear": {"head": 9.0, "tail": 2.0}},
            "cross_flow_drag.coefficient": 1.5,
            "stream.velocity": (0.1, 0.0),
            "self_contact": True,
            "initial.velocity": (0.1, 0.0),
            "episode.duration": 3.0,
            "actuation.end_time": 2.0,
        },
    )
    changed, before = OTHERS.apply(scene).to_dict(), scene.to_dict()
    assert changed["beam"].pop("elements") == 7 != before["beam"].pop("elements")
    for name in ("model", "panels_per_element", "cap_panels"):
        assert changed["fluid"].pop(name) != before["fluid"].pop(name)
    for name in ("time_step", "scheme", "strain", "tolerance"):
        assert changed["integrator"].pop(name) != before["integrator"].pop(name)
    assert changed == before


def test_what_belongs_to_another_model_goes_and_comes_not_back() -> None:
    strip = load_scene("swimmer", {"fluid.model": "strip", "fluid.added_mass_per_length": 7.0})
    assert OTHERS.apply(strip).fluid.added_mass_per_length is None
    same = replace(OTHERS, fluid_model="strip").apply(strip)
    assert same.fluid.added_mass_per_length == 7.0


def test_settings_of_a_beam_alone_leave_it_alone() -> None:
    alone = load_scene("swimmer", {"fluid": None})
    assert OTHERS.apply(alone).fluid is None
    assert settings_of(alone).fluid_model == "none"
    assert settings_of(alone).apply(alone) == alone


@pytest.mark.parametrize(
    "changes",
    [
        {"beam.bending_stiffness": [5.0] * 8},
        {"initial.joint_angles": [0.1] * 8},
        {"axial_added_mass": {}},
    ],
    ids=["stiffness of each joint", "angle of each joint", "axial"],
)
def test_settings_that_do_not_fit_are_refused(changes: dict[str, object]) -> None:
    scene = load_scene("swimmer", changes)
    with pytest.raises(SceneError):
        OTHERS.apply(scene)
    fitting = replace(OTHERS, elements=9, fluid_model="panels")
    assert settings_of(fitting.apply(scene)) == fitting


def test_labels_tell_settings_apart() -> None:
    assert PAPER_SETTINGS.label == "panels 9x4/1 10 ms paper"
    assert OTHERS.label == "frozen 7x8/p 4 ms composed mean_angles tol 1e-08"
    grid = full_grid()
    assert len({settings.label for settings in grid}) == len(grid)


# ---- grids -------------------------------------------------------------------------------------


@pytest.mark.parametrize("grid", [full_grid, quick_grid])
def test_every_setting_of_a_grid_fits_every_scene_once(grid: Callable[[], list[Settings]]) -> None:
    settings = grid()
    assert len(set(settings)) == len(settings)
    assert PAPER_SETTINGS in settings
    for case, one in itertools.product(study_scenes(), settings):
        wanted = one
        if one.solver is not None:
            own = case.scene.integrator
            wanted = replace(one, scheme=own.scheme, tolerance=own.tolerance)
        assert settings_of(one.apply(case.scene)) == wanted


def test_the_grids_have_the_axes_of_tolerance() -> None:
    """Newton's with its usual value beside, and SciPy's solvers beside the same chain in steps."""
    grid = set(full_grid())
    for one in FINE_STEPS:
        assert {replace(one, tolerance=each) for each in (1e-4, 1e-6, 1e-8, 1e-10)} <= grid
    assert {one.fluid_model for one in FINE_STEPS} == {"frozen", "panels"}
    solved = [one for one in grid if one.solver is not None]
    assert len({one.solver for one in solved}) == 2
    assert {replace(one, scheme="composed", tolerance=1e-10) for one in solved} == {SOLVED} <= grid
    assert sum(1 for one in quick_grid() if one.solver is not None) == 1


@pytest.mark.parametrize(
    ("own", "played"), [(100.0, 20.0), (20.0, 20.0), (3.13, 3.12), (1e-3, 0.02)]
)
def test_any_scene_is_played_for_its_episode_or_twenty_seconds(own: float, played: float) -> None:
    scene = load_scene("paper_v", {"episode.duration": own})
    case = case_of(scene)
    assert case.scene == scene
    assert case.duration == pytest.approx(played)


def test_a_scene_that_fixes_its_elements_is_no_case() -> None:
    with pytest.raises(SwimError, match="swimmer lists values for every joint or element"):
        case_of(load_scene("swimmer", {"initial.joint_angles": [0.1] * 8}))


def test_held_out_scenes_are_others() -> None:
    """No body and drive of theirs is in the study, and no name is there twice."""
    seen, unseen = study_scenes(), held_out_scenes()
    names = [case.scene.name for case in (*seen, *unseen)]
    assert len(set(names)) == len(names)
    for one, other in itertools.product(seen, unseen):
        assert (one.scene.beam, one.scene.actuation) != (other.scene.beam, other.scene.actuation)


def test_the_budgets_runs_are_in_the_full_grid() -> None:
    """Otherwise a column of the report would stay empty."""
    runs = [{**one.to_dict(), "displacement": [-1.0, 0.0]} for one in full_grid()]
    reference = Reference(
        np.array([-1.0, 0.0]), np.zeros((SAMPLES + 1, 2)), 1.0, 1.0, 0.0, 0.0, 0.0, {}
    )
    wanted = {"elements", "panels", "time_step", "model", "tolerance", "all"}
    assert budget_of(runs, reference).keys() == wanted


# ---- the front ---------------------------------------------------------------------------------


def _run(cost: float, error: float | None, scene: str = "a", **changes: Any) -> dict[str, Any]:
    settings = replace(PAPER_SETTINGS, **{"time_step": round(1e-4 * (1.0 + cost), 9), **changes})
    return {**settings.to_dict(), "scene": scene, "cost": cost, "error": error}


def _points(runs: list[Any]) -> list[tuple[float, float]]:
    return [(run["cost"], run["error"]) for run in runs]


def test_the_front_is_what_nothing_beats() -> None:
    runs = [_run(3.0, 0.1), _run(1.0, 0.5), _run(2.0, 0.6), _run(4.0, 0.1), _run(5.0, 0.01)]
    assert _points(pareto(runs)) == [(1.0, 0.5), (3.0, 0.1), (5.0, 0.01)]


def test_of_equals_one_is_kept_and_unfinished_runs_are_left_out() -> None:
    runs = [_run(1.0, 0.5), _run(1.0, 0.5), _run(1.0, 0.4), _run(0.1, None)]
    assert _points(pareto(runs)) == [(1.0, 0.4)]
    assert pareto([]) == []
    assert _points(pareto([{**_run(2.0, 0.5), "path_error": 0.3}], "path_error")) == [(2.0, 0.5)]
    assert pareto([_run(1.0, 0.5)], "path_error") == []


def test_the_front_does_not_depend_on_the_order_of_runs() -> None:
    rng = np.random.default_rng(1)
    runs = [_run(*pair) for pair in rng.uniform(0.1, 1.0, (40, 2)).round(3).tolist()]
    front = pareto(runs)
    assert _points(pareto(runs[::-1])) == _points(front)
    for run in runs:
        beaten = any(
            other["cost"] <= run["cost"] and other["error"] <= run["error"] and other is not run
            for other in runs
        )
        assert beaten != (run in front)


def test_what_is_on_one_scenes_front_is_kept_with_its_figures_on_all() -> None:
    fast, fine, bad = {"elements": 5}, {"elements": 18}, {"elements": 27}
    same = {"time_step": 0.01, "fluid_model": "frozen"}
    runs = [
        _run(1.0, 0.3, "a", **fast, **same),
        _run(4.0, 0.1, "a", **fine, **same),
        _run(4.0, 0.5, "a", **bad, **same),
        # On scene b the fast one is neither.
        _run(3.0, 0.4, "b", **fast, **same),
        _run(2.0, 0.1, "b", **fine, **same),
        _run(9.0, 0.2, "b", **bad, **same),
    ]
    front = make_front(runs)
    assert [one.settings.elements for one in front] == [5, 18]
    assert [one.cost for one in front] == [2.0, 3.0]
    assert [one.errors for one in front] == [{"a": 0.3, "b": 0.4}, {"a": 0.1, "b": 0.1}]


def test_near_the_front_is_near_enough() -> None:
    """A run a little costlier than one that beats it stays: their order may differ elsewhere."""
    runs = [_run(cost, error, fluid_model="frozen") for cost, error in _NEIGHBOURS]
    assert [one.cost for one in make_front(runs)] == [1.0, 1.9]


_NEIGHBOURS = ((1.0, 0.1), (1.9, 0.11), (2.1, 0.11))


@pytest.mark.parametrize(("model", "kept"), [("panels", 3), ("expansion", 3), ("strip", 1)])
def test_costlier_models_have_a_front_of_their_own(model: str, kept: int) -> None:
    """Scenes that bend too far need them, or allow no others."""
    cheap = _run(1.0, 0.01, fluid_model="frozen")
    own = ((5.0, 0.2), (9.0, 0.1), (9.5, 0.15))
    runs = [cheap, *(_run(cost, error, fluid_model=model) for cost, error in own)]
    assert [one.cost for one in make_front(runs)] == [1.0, 5.0, 9.0][:kept]


def test_what_is_useless_on_every_scene_is_no_candidate() -> None:
    runs = [_run(0.1, 2.0, name, fluid_model="strip") for name in "ab"]
    runs += [_run(1.0, 0.1, name, fluid_model="frozen") for name in "ab"]
    assert [one.cost for one in make_front(runs)] == [1.0]
    runs[1]["error"] = 0.2
    assert [one.cost for one in make_front(runs)] == [0.1, 1.0]


def test_a_front_survives_its_file(tmp_path: Path) -> None:
    front = make_front([_run(1.0, 0.3, "b"), _run(2.0, 0.1, "a", cap_panels="proportional")])
    path = tmp_path / "front.json"
    path.write_text(front_to_json(front, {"commit": "x"}), encoding="utf-8")
    assert load_front(path) == front
    assert json.loads(path.read_text())["commit"] == "x"
    assert [type(one) for one in front] == [Measured, Measured]


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", "3", '{"front": 3}', '{"front": [{}]}', '{"front": [{"cost": 1}]}', "\udcff"],
)
def test_a_broken_front_is_one_clear_error(tmp_path: Path, text: str) -> None:
    path = tmp_path / "front.json"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(SwimError, match="not a measured front: .*front.json") as caught:
        load_front(path)
    assert "\n" not in str(caught.value)


def test_a_missing_front_is_one_clear_error(tmp_path: Path) -> None:
    with pytest.raises(SwimError, match="cannot read the measured front: No such file .*none.json"):
        load_front(tmp_path / "none.json")


def test_solvers_are_on_no_front() -> None:
    """However good they are: no scene can be set to one."""
    solver = {**_run(0.5, 0.001), "scheme": "LSODA", "tolerance": 1e-5}
    others = [_run(1.0, 0.1), _run(2.0, 0.05)]
    assert pareto([solver, *others]) == pareto(others) == others
    assert make_front([solver, *others]) == make_front(others)
    paper = {**PAPER_SETTINGS.to_dict(), "cost": 2.0, "error": 0.2}
    assert what_time_buys([solver, paper, *others], (1.0,)) == {1.0: others[1]}


# ---- the report --------------------------------------------------------------------------------


def _tables(runs: list[dict[str, Any]]) -> dict[str, list[list[str]]]:
    """Return the cells of every table of the report, below its header, by heading."""
    reference = Reference(
        np.array([-2.0, 0.0]), np.zeros((SAMPLES + 1, 2)), 1.0, 1.0, 0.0, 0.0, 0.0, {}
    )
    origin = {"machine": {"processor": "any", "cores": 1}, "commit": None, "date": "today"}
    found = {}
    for part in study_tables(runs, {"a": reference}, origin).split("## ")[1:]:
        rows = [line for line in part.splitlines() if line.startswith("|")]
        assert len({row.count("|") for row in rows}) == 1, part
        found[part.splitlines()[0]] = [
            [cell.strip() for cell in row.strip("|").split("|")] for row in rows[2:]
        ]
    return found


def _at(settings: Settings, x: float, cost: float, **more: Any) -> dict[str, Any]:
    error = abs(x + 2.0) / 2.0
    figures = {"displacement": [x, 0.0], "seconds_per_second": 0.1, **more}
    return {**settings.to_dict(), "scene": "a", "cost": cost, "error": error, **figures}


def test_the_table_of_tolerances_compares_with_the_usual_one() -> None:
    frozen = FINE_STEPS[0]
    runs = [
        _at(frozen, -2.2, 4.0),
        _at(replace(frozen, tolerance=1e-4), -2.202, 3.0),
        _at(replace(frozen, tolerance=1e-8), -2.2, 4.0),
        # Nothing to compare with.
        _at(replace(FINE_STEPS[1], tolerance=1e-4), -2.2, 9.0),
    ]
    _, row, other = _tables(runs)["Newton's tolerance"]
    assert row == ["a", frozen.label, "1.0e-03", "0.75", "", "", "0.0e+00", "1.00"]
    assert other[2:] == [""] * 6


def test_the_table_of_solvers_has_the_same_chain_in_steps_beside() -> None:
    runs = [
        _at(replace(SOLVED, scheme="LSODA", tolerance=1e-5), -2.02, 9.0, evaluations=12_000),
        _at(
            replace(SOLVED, scheme="Radau", tolerance=1e-2),
            -2.04,
            2.0,
            evaluations=1_000,
            corrections=0,
        ),
        _at(replace(SOLVED, time_step=0.005), -2.024, 0.5, evaluations=1, corrections=9_000),
        # Other panels, and another strain.
        _at(replace(SOLVED, panels_per_element=8), -2.5, 0.1),
        _at(replace(SOLVED, strain="mean_angles"), -2.5, 0.1),
    ]
    assert _tables(runs)["SciPy's solvers"] == [
        ["a", "5 ms composed", "1", "9,000", "1.2e-02", "2.0e-03", "0.5"],
        ["a", "Radau, rtol 0.01", "1,000", "0", "2.0e-02", "1.0e-02", "2"],
        ["a", "LSODA, rtol 1e-05", "12,000", "", "1.0e-02", "", "9"],
    ]


def test_the_budget_is_of_differences_in_one_thing() -> None:
    """Runs are put where only one thing moves them, by its own amount."""
    paper = PAPER_SETTINGS
    fine = Settings("frozen", 9, 24, "proportional", 0.0025, "composed")
    coarse = replace(fine, panels_per_element=4, cap_panels=1)
    slow = replace(fine, time_step=0.01, scheme="paper")
    at = {
        fine: (-2.02, 0.0),  # 1 % for the elements
        coarse: (-2.02, 0.06),  # 3 % for the panels
        slow: (-2.10, 0.0),  # 4 % for the step
        paper: (-2.2, 0.0),  # 10 % in all
        replace(paper, fluid_model="frozen"): (-2.3, 0.0),  # 5 % for the model
        replace(paper, tolerance=1e-6): (-2.2, 0.002),  # 0.1 % for the tolerance
    }
    runs = [{**one.to_dict(), "displacement": list(where)} for one, where in at.items()]
    reference = Reference(
        np.array([-2.0, 0.0]), np.zeros((SAMPLES + 1, 2)), 1.0, 1.0, 0.0, 0.0, 0.0, {}
    )
    budget = budget_of(runs, reference)
    wanted = {
        "elements": 0.01,
        "panels": 0.03,
        "time_step": 0.04,
        "all": 0.1,
        "model": 0.05,
        "tolerance": 0.001,
    }
    assert budget == pytest.approx(wanted)
    # What was not run is left out, and so is what leans on it.
    assert budget_of(runs[1:3], reference) == {}
    assert budget_of(runs[3:5], reference).keys() == {"model", "all"}


def test_what_time_buys_is_the_best_at_the_price() -> None:
    paper = {**PAPER_SETTINGS.to_dict(), "cost": 2.0, "error": 0.1}
    runs = [paper, _run(0.1, 0.5), _run(0.2, 0.4), _run(0.3, 0.01), _run(20.0, 1e-3), _run(21, 0.0)]
    bought = what_time_buys(runs, (0.01, 0.1, 1.0, 10.0))
    assert bought[0.01] is None
    assert [bought[factor]["error"] for factor in (0.1, 1.0, 10.0)] == [0.4, 0.01, 1e-3]
    # Without the paper's settings there is no unit to count in.
    assert what_time_buys(runs[1:], (0.1, 1.0)) == {0.1: None, 1.0: None}


def test_the_table_of_held_out_scenes_says_why_where_there_is_no_choice() -> None:
    chosen = {
        "scene": "one",
        "tolerance": 0.01,
        "chosen": "here",
        "error": 0.005,
        "met": True,
        "direct_error": 0.011,
        "met_direct": False,
        "reference_gap": 0.006,
        "best": "there",
        "best_error": 0.009,
        "cost_ratio": 1.25,
        "timed": True,
    }
    fastest = {**chosen, "best": "here", "cost_ratio": 1.0, "timed": False, "direct_error": None}
    none = {
        **{"scene": "two", "tolerance": 0.03, "chosen": None, "reason": "too violent"},
        "reference_gap": None,
    }
    lines = held_out_table([chosen, fastest, none]).splitlines()
    assert [line.count("|") for line in lines] == [12] * 5
    start = "| one | 0.01 | here | 5.0e-03 | yes |"
    assert lines[2] == f"{start} 1.1e-02 | no | 6.0e-03 | there | 9.0e-03 | 1.25 |"
    # What was not timed has no ratio.
    assert [cell.strip() for cell in lines[3].split("|")[6:-1]] == [
        "",
        "no",
        "6.0e-03",
        "none",
        "",
        "",
    ]
    assert "none: too violent" in lines[4]


# ---- added mass of rigid motions ---------------------------------------------------------------

DENSITY = 10.0


def _body(elements: int = 9, panels: int = 4, caps: int | str = 1, **changes: object) -> Scene:
    return load_scene(
        "swimmer",
        {
            "beam.elements": elements,
            "fluid.panels_per_element": panels,
            "fluid.cap_panels": caps,
            **changes,
        },
    )


def test_a_straight_body_weighs_a_few_per_cent_more_than_the_plate() -> None:
    mass = rigid_added_mass(_body(), 0.0)
    plate = DENSITY * math.pi / 4.0
    # PHYSICS section 6: 4 to 7 % at the default settings.
    assert 1.04 < mass[1, 1] / plate < 1.07
    assert mass == pytest.approx(np.diag(np.diag(mass)), abs=1e-12)
    # Without the axial added mass nothing moves along.
    assert mass[0, 0] == 0.0


def test_the_fine_body_is_the_rectangle() -> None:
    """Its axial mass, a thousandth of the lateral one, is all of the ends and the least exact."""
    mass = rigid_added_mass(_body(36, 24, "proportional", axial_added_mass=True), 0.0)
    exact = DENSITY * rectangle_mass(1.0, 0.02)
    assert mass[1:, 1:] == pytest.approx(np.diag(exact[1:]), rel=2e-3, abs=1e-12)
    assert mass[0, 0] == pytest.approx(exact[0], rel=0.05)


@pytest.mark.parametrize("caps", [1, 3])
def test_a_straight_body_weighs_the_same_at_every_number_of_elements(caps: int) -> None:
    """36 panels along it are the same panels, however they are shared out."""
    nine, *others = (rigid_added_mass(_body(n, 36 // n, caps), 0.0) for n in (9, 2, 3, 6, 18))
    for other in others:
        assert other == pytest.approx(nine, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("changes", [{}, {"axial_added_mass": True}], ids=["plain", "axial"])
@pytest.mark.parametrize("elements", [2, 9])
def test_an_arc_bent_the_other_way_is_the_mirror_image(
    elements: int, changes: dict[str, object]
) -> None:
    body = _body(elements, 8, 2, **changes)
    one, other = (rigid_added_mass(body, bend) for bend in (BEND, -BEND))
    sign = np.diag([1.0, -1.0, -1.0])
    assert other == pytest.approx(sign @ one @ sign, abs=1e-12)
    # An arc is its own image end for end: only moving along and turning are coupled.
    assert abs(one[0, 1]) < 1e-12
    assert abs(one[1, 2]) < 1e-12
    assert one[0, 2] < -0.1
    assert one == pytest.approx(one.T, abs=1e-12)
    assert (np.linalg.eigvalsh(one) > 0.0).all()


def test_lengths_are_in_units_of_the_bodys() -> None:
    one = rigid_added_mass(_body(), BEND)
    twice = {"beam.length": 2.0, "beam.half_thickness": 0.02, "fluid.density": 30.0}
    # Three times the density on four times the area.
    assert rigid_added_mass(_body(**twice), BEND) == pytest.approx(12.0 * one, rel=1e-12)


def _ribbon(bend: float, panels: int, caps: int) -> Array:
    """Return the outline of an arc of length 1 and half thickness 0.01, its mean at the origin."""
    radius = 1.0 / bend
    angles = bend * np.linspace(-0.5, 0.5, panels + 1)
    around = np.stack([np.sin(angles), -np.cos(angles)], axis=1)
    outer, inner = (radius + 0.01) * around, (radius - 0.01) * around
    across = np.arange(1, caps)[:, None] / caps
    mean = radius * np.array([0.0, -math.sin(0.5 * bend) / (0.5 * bend)])
    ends = (outer[-1] + across * (inner[-1] - outer[-1]), inner[0] + across * (outer[0] - inner[0]))
    return np.concatenate([outer, ends[0], inner[::-1], ends[1]]) - mean


def test_the_fine_arc_is_the_smooth_ribbon() -> None:
    """Bent, panels converge slower: twice as many along a smooth arc still move it by 0.5 %."""
    mass = rigid_added_mass(_body(36, 24, "proportional", axial_added_mass=True), BEND)
    coarse, fine = (added_mass_of_polygon(_ribbon(BEND, n, n // 50), DENSITY) for n in (150, 300))
    exact = 2.0 * fine - coarse
    scale = float(np.linalg.norm(exact))
    assert float(np.linalg.norm(mass - exact)) < 0.01 * scale
    # One hundredth tells it from the straight body and from the wrong angle by far.
    for bend in (0.0, 0.9 * BEND):
        other = added_mass_of_polygon(_ribbon(max(bend, 1e-6), 150, 3), DENSITY)
        assert float(np.linalg.norm(other - exact)) > 0.02 * scale


def test_what_errors_are_measured_by_is_the_smooth_ribbon_to_a_thousandth() -> None:
    """Fine bodies tend to it with half the error for twice the panels, as the ribbon's own do."""
    # The ribbon's polygons converge at first order: what two of them leave out is 2e-4.
    coarse, fine = (added_mass_of_polygon(_ribbon(BEND, n, n // 50), DENSITY) for n in (400, 800))
    exact = 2.0 * fine - coarse
    for panels, wanted in ((12, 8.3e-3), (24, 4.5e-3)):
        body = _body(36, panels, "proportional", axial_added_mass=True)
        mass = rigid_added_mass(body, BEND)
        error = float(np.linalg.norm(mass - exact) / np.linalg.norm(exact))
        assert mass_errors(body)[1] == pytest.approx(error, abs=1e-3)
        assert mass_errors(body)[1] == pytest.approx(wanted, abs=5e-4)


def test_coarser_bodies_have_larger_errors() -> None:
    straight, bent = zip(
        *(
            mass_errors(_body(n, p, caps))
            for n, p, caps in ((9, 4, 1), (18, 8, "proportional"), (27, 16, "proportional"))
        ),
        strict=True,
    )
    assert straight[0] > 5.0 * straight[1] > 0.0
    assert straight[1] > straight[2] > 0.0
    # Bent, elements count as well.
    assert bent[0] > 1.5 * bent[1] > 0.0
    assert bent[1] > 1.5 * bent[2] > 0.0
    # One cap panel leaves the straight body 1.5 % too heavy.
    mass = rigid_added_mass(_body(), 0.0)
    exact = np.diag([0.0, *(DENSITY * rectangle_mass(1.0, 0.02)[1:])])
    error = float(np.linalg.norm(mass - exact) / np.linalg.norm(exact))
    assert straight[0] == pytest.approx(error, abs=5e-4)
    assert 0.01 < straight[0] < 0.02


def test_what_is_apart_from_the_body_does_not_matter() -> None:
    plain = mass_errors(_body())
    other = _body(
        **{
            "damping": None,
            "beam.bending_stiffness": [3.0] * 8,
            "initial.joint_angles": [0.1] * 8,
            "actuation": None,
            "cross_flow_drag.coefficient": 1.0,
            "stream.velocity": (1.0, 0.0),
            "integrator.time_step": 0.1,
        }
    )
    assert mass_errors(other) == plain


def test_models_share_the_straight_body_and_differ_bent() -> None:
    errors = {
        model: mass_errors(_body(**{"fluid.model": model}))
        for model in ("panels", "frozen", "strip")
    }
    assert errors["frozen"][0] == pytest.approx(errors["panels"][0], rel=1e-9)
    assert errors["frozen"][1] != pytest.approx(errors["panels"][1], rel=0.1)
    # Strips have the plate's mass in all and 4.4 % too little for the thickness.
    assert errors["strip"][0] > 0.04


def test_without_a_fluid_there_is_no_error() -> None:
    assert mass_errors(load_scene("swimmer", {"fluid": None})) == (None, None)
    none = load_scene("swimmer", {"fluid.model": "none"})
    assert mass_errors(none) == (None, None)


# ---- references --------------------------------------------------------------------------------


class Laws:
    """A run that is a sum of laws, in place of `play`.

    Parameters
    ----------
    higher : float
        Size of what the extrapolations leave out, relative to what they take off.
    model : float
        Relative size of what freezing the added mass takes off.
    """

    def __init__(self, higher: float = 0.0, model: float = 0.02, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        n = 3 + 2 * (SAMPLES + 1)
        self.limit = rng.normal(size=n) + np.sign(rng.normal(size=n))
        size = np.hypot(*self.limit[:2])
        self.elements, self.panels, self.step = (size * rng.uniform(-1, 1, n) for _ in range(3))
        self.model = model * size * rng.uniform(0.5, 1.0, n) / math.sqrt(2.0)
        self.higher = higher
        self.played: list[Settings] = []
        self.reason = ""

    def of(self, settings: Settings) -> Array:
        """Return displacement, energy and path."""
        n, p = settings.elements, settings.elements * settings.panels_per_element
        chain = 2.0 * self.elements / n**2
        chain[2] *= n  # the energy's order is 1
        values = self.limit + chain * (1.0 + 10.0 * self.higher / n**2)
        values = values + 3e3 * self.step * settings.time_step**2 * (
            1.0 + 1e4 * self.higher * settings.time_step**2
        )
        if settings.fluid_model != "none":
            values = values + self.panels * self.of_panels(p) * (1.0 + 20.0 * self.higher / p)
        if settings.fluid_model == "panels":
            values = values + self.model * (1.0 + 0.5 * self.higher / settings.panels_per_element)
        return values

    @staticmethod
    def of_panels(along: float) -> float:
        """Return the share that is left with so many panels; corners spoil the order."""
        return 0.1 * along**-0.6

    def __call__(self, scene: Scene, duration: float) -> Outcome:
        assert duration == 3.0
        settings = settings_of(scene)
        self.played.append(settings)
        return _outcome(self.of(settings), self.reason)


def _with(laws: Laws, monkeypatch: pytest.MonkeyPatch) -> Laws:
    monkeypatch.setattr("swim_env.accuracy.reference.play", laws)
    return laws


def _values(reference: Reference) -> Array:
    return np.concatenate([reference.displacement, [reference.energy], reference.path.ravel()])


def test_a_reference_takes_off_all_known_laws(monkeypatch: pytest.MonkeyPatch) -> None:
    # As many panels along the body at every N, to the last one.
    plan = Refinements((5, 9, 15), 90, 9, 0.01, (6, 12))
    laws = _with(Laws(), monkeypatch)
    reference = reference_of(load_scene("swimmer"), 3.0, plan)
    assert _values(reference) == pytest.approx(laws.limit + laws.model, abs=1e-11)
    scale = np.hypot(*reference.displacement)

    def share(values: Array) -> float:
        return float(np.hypot(*values[:2]) / scale)

    # Half of what refining the step twice would change, half of what the panels have left, and a
    # sixth of the model's; two extrapolations of one law do not differ.
    parts = {
        "elements": 0.0,
        "time_step": 0.5 * share(3e3 * laws.step * plan.time_step**2),
        "panels": 0.5 * share(laws.panels * laws.of_panels(4 * plan.panels)),
        "model": 0.15 * share(laws.model),
    }
    assert reference.parts == pytest.approx(parts, abs=1e-11)
    assert reference.uncertainty == pytest.approx(math.hypot(*parts.values()), abs=1e-11)
    assert reference.length == 1.0


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("plan", [FINE, PILOT])
def test_the_error_bar_covers_what_is_left(
    plan: Refinements, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With laws that hold in the limit alone, the error is within the bar, which is not much more
    than what was taken off.
    """
    laws = _with(Laws(higher=1.0, seed=seed), monkeypatch)
    scene = load_scene("swimmer")
    reference = reference_of(scene, 3.0, plan)
    limit = laws.limit + laws.model
    error = relative_error(reference.displacement, limit[:2], 1.0)
    assert 0.0 < error < reference.uncertainty
    steps = Settings("panels", 36, 12, "proportional", plan.time_step, "composed")
    direct = relative_error(laws.of(steps)[:2], limit[:2], 1.0)
    assert reference.uncertainty < 2.0 * direct


def test_the_runs_of_a_reference(monkeypatch: pytest.MonkeyPatch) -> None:
    """None is made twice, all are counted, and nothing of the scene's own settings is in them."""
    laws = _with(Laws(), monkeypatch)
    counted: list[int] = []
    scene = load_scene("swimmer", {"integrator.tolerance": 1e-6, "fluid.cap_panels": 7})
    reference_of(scene, 3.0, FINE, progress=counted.append)
    assert len(laws.played) == len(set(laws.played)) == sum(counted) == 11
    assert {one.scheme for one in laws.played} == {"composed"}
    assert {one.cap_panels for one in laws.played} == {"proportional"}
    assert {one.tolerance for one in laws.played} == {1e-10}
    # Panels are weighed on few elements only, at twice the step.
    dear = [one for one in laws.played if one.fluid_model == "panels"]
    assert {(one.elements, one.time_step) for one in dear} == {(9, 0.005)}


@pytest.mark.parametrize("elements", [9, 7, 4])
def test_elements_that_are_kept_belong_to_the_scene(
    elements: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    laws = _with(Laws(), monkeypatch)
    scene = load_scene("swimmer", {"beam.elements": elements})
    reference = reference_of(scene, 3.0, PILOT, keep_elements=True)
    assert {one.elements for one in laws.played} == {elements}
    assert reference.parts.keys() == {"time_step", "panels", "model"}
    wanted = laws.limit + laws.model + 2.0 * laws.elements / elements**2
    error = relative_error(reference.displacement, wanted[:2], 1.0)
    # 216 panels can be shared out to 9 and to 4 elements, to 7 nearly.
    if elements == 7:
        assert error < 0.3 * reference.parts["panels"]
    else:
        assert error < 1e-12


def test_without_a_fluid_two_laws_are_left(monkeypatch: pytest.MonkeyPatch) -> None:
    laws = _with(Laws(), monkeypatch)
    for changes in ({"fluid": None}, {"fluid.model": "none"}):
        reference = reference_of(load_scene("swimmer", changes), 3.0, PILOT)
        assert reference.parts.keys() == {"elements", "time_step"}
        assert _values(reference) == pytest.approx(laws.limit, abs=1e-11)


def test_what_cannot_be_frozen_is_refined_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    laws = _with(Laws(), monkeypatch)
    reference = reference_of(load_scene("swimmer", {"axial_added_mass": True}), 3.0, FINE)
    assert reference.parts.keys() == {"elements", "time_step", "panels"}
    assert {one.fluid_model for one in laws.played} == {"panels"}
    # Such runs take long, so they are coarser than those of the plan.
    assert max(one.elements * one.panels_per_element for one in laws.played) <= 144
    assert _values(reference) == pytest.approx(laws.limit + laws.model, abs=1e-11)


def test_the_plan_of_a_scene_that_cannot_be_frozen_is_always_the_same() -> None:
    axial, plain = load_scene("swimmer", {"axial_added_mass": True}), load_scene("swimmer")
    assert plan_for(axial, FINE) == plan_for(axial, PILOT) != PILOT
    for plan in (FINE, PILOT):
        assert plan_for(plain, plan) is plan
        assert plan_for(load_scene("swimmer", {"fluid": None}), plan) is plan


def test_the_direct_run_is_finer_than_what_it_judges() -> None:
    """Nothing is left out of it, and it is nobody's part of a reference."""
    assert (DIRECT.fluid_model, DIRECT.scheme, DIRECT.cap_panels) == (
        *("panels", "composed", "proportional"),
    )
    assert DIRECT.elements >= 27
    assert DIRECT.elements * DIRECT.panels_per_element >= 216
    assert DIRECT.time_step <= 0.005


def test_a_body_that_bends_too_far_has_no_reference(monkeypatch: pytest.MonkeyPatch) -> None:
    _with(Laws(model=1.0), monkeypatch)
    with pytest.raises(SwimError, match=r"scene swimmer bends too far .* is \d\d% off"):
        reference_of(load_scene("swimmer"), 3.0)


def test_a_fine_run_that_ends_early_leaves_no_reference(monkeypatch: pytest.MonkeyPatch) -> None:
    laws = _with(Laws(), monkeypatch)
    laws.reason = "turn_too_large"
    with pytest.raises(SwimError, match="no converged reference: .* ended with turn_too_large"):
        reference_of(load_scene("swimmer"), 3.0)
    assert len(laws.played) == 1


def test_a_reference_survives_json(monkeypatch: pytest.MonkeyPatch) -> None:
    _with(Laws(), monkeypatch)
    one = reference_of(load_scene("swimmer"), 3.0)
    other = Reference.from_dict(json.loads(json.dumps(one.to_dict())))
    assert np.array_equal(_values(one), _values(other))
    assert (other.length, other.uncertainty) == (one.length, one.uncertainty)
    assert other.parts == one.parts


def test_the_stored_study_is_of_the_scenes_that_are_there() -> None:
    stored = (Path(__file__).parents[2] / "docs" / "accuracy" / "runs.jsonl").read_text(
        encoding="utf-8"
    )
    digests = {json.loads(line)["case"] for line in stored.splitlines()}
    for case in study_scenes():
        assert _digest(case) in digests, f"{case.scene.name} is not the stored one"
        warned = case._replace(scene=case.scene.replace("integrator.energy_tolerance", 0.5))
        assert _digest(warned) == _digest(case)
        other = case._replace(scene=case.scene.replace("integrator.time_step", 0.001))
        assert _digest(other) != _digest(case)
