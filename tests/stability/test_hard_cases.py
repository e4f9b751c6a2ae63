"""The hard cases: slices of them in every run of the tests, all of them among the slow ones."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from studies.stability import runs as runs_module
from studies.stability.cases import CASES
from studies.stability.drawn import draw_run
from studies.stability.instability import measure_onset
from studies.stability.report import failures_of, stability_tables
from studies.stability.runs import LONGEST_STEP, HardRun, Verdict, _Watch, play
from studies.stability.suite import ONSETS, drawn_runs, measure_stability, work_of
from studies.stability.torques import Ramp, SquareWave, WhiteNoise
from swim_env import TERMINATION_REASONS, SimulationEndedError, Simulator, load_scene
from swim_env.physics.solve.state import RECORD_NAMES
from swim_env.scene import Scene
from swim_env.sim.batch import Bodies

#: Steps of a run in a slice, and runs of every case in it.
SLICE_STEPS, SLICE_RUNS = 60, 6


def _slice(case: str) -> list[HardRun]:
    """Return some runs of a case, spread over it, cut short."""
    every = [run for run in CASES[case]() if run.scene.beam.elements <= 27]
    chosen = [every[round(i)] for i in np.linspace(0, len(every) - 1, SLICE_RUNS)]
    return [
        dataclasses.replace(
            run,
            duration=min(run.duration, SLICE_STEPS * run.scene.integrator.time_step),
            compared=False,
        )
        for run in chosen
    ]


@pytest.mark.parametrize("case", CASES)
def test_a_slice_of_every_case_is_right_or_ends_by_name(case: str) -> None:
    for run in _slice(case):
        verdict = play(run)
        assert not verdict.failures, f"{run.label}: {verdict.failures}"
        assert verdict.steps == verdict.wanted or verdict.reason in TERMINATION_REASONS


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("case", CASES)
def test_every_case_is_right_or_ends_by_name(case: str) -> None:
    runs = CASES[case]()
    wrong = [f"{run.label}: {text}" for run in runs for text in play(run).failures]
    assert not wrong, wrong


def test_what_the_cases_cover() -> None:
    def runs(case: str) -> list[HardRun]:
        return list(CASES[case]())

    for case in ("resonance", "stiff", "body mass", "thickness", "long"):
        for run in runs(case):
            assert run.must_last == (run.scene.damping is not None), run.label
    assert all(run.must_last for run in runs("resolution"))
    frequencies = {run.scene.actuation.frequency / (2.0 * math.pi) for run in runs("resonance")}
    assert np.allclose(sorted(frequencies), np.arange(3.0, 8.01, 0.25))
    assert {run.scene.integrator.time_step for run in runs("resonance")} == {0.01, 0.005}
    assert all(run.duration == 60.0 for run in runs("resonance"))
    stiffness = [np.ravel(run.scene.beam.bending_stiffness) for run in runs("stiff")]
    assert min(one.min() for one in stiffness) == 1e-3
    assert max(one.max() for one in stiffness) == 1e8
    assert any(np.isclose(one[1] / one[0], 1e6) for one in stiffness if len(one) > 1)
    steps = {run.scene.integrator.time_step for run in runs("time step")}
    assert min(steps) == 1e-4 and max(steps) == 0.2
    thin = [run.scene.beam.half_thickness * 9.0 for run in runs("thickness")]
    assert np.isclose(min(thin), 1e-6) and np.isclose(max(thin), 0.2)
    sizes = {(r.scene.beam.elements, r.scene.fluid.panels_per_element) for r in runs("resolution")}
    assert {n for n, _ in sizes} >= {2, 3, 81, 161}
    assert {panels for _, panels in sizes} >= {2, 24}
    for run in runs("long"):
        assert round(run.duration / run.scene.integrator.time_step) == 1_000_000


#: Why bodies of panels end that curl, from the shape that is given up first.
CURLED = {
    "head to tail": "under_resolved_gap",
    "head to tail, watched": "under_resolved_gap",
    "one joint": "outline_degenerate",
    "folding rule": "mass_not_positive",
    "held beyond 90 degrees": "outline_degenerate",
}


@pytest.mark.parametrize("strain", ["averaged_directors", "mean_angles", "joint_angle"])
def test_how_curling_ends(strain: str) -> None:
    runs = [run for run in CASES["curling"]() if run.label.endswith(f", {strain}")]
    assert len(runs) == 3 * len(CURLED)
    for run in runs:
        shape, model, _ = run.label.rsplit(", ", 2)
        verdict = play(run)
        assert not verdict.failures, f"{run.label}: {verdict.failures}"
        holds = strain == "joint_angle"
        if model == "panels":
            # A strain that does not soften holds the joint where the others snap over.
            lasts = holds and shape == "held beyond 90 degrees"
            assert verdict.reason == ("" if lasts else CURLED[shape]), run.label
        else:
            # Without an outline only the watch for contact ends a run ...
            watched = shape.endswith("watched")
            assert verdict.reason == ("self_contact" if watched else ""), run.label
            # ... and a joint that snapped over is told of by its energy.
            assert verdict.trusted == (holds or watched), run.label


# ---- random scenes -----------------------------------------------------------------------------


def test_random_scenes_of_fixed_seeds() -> None:
    found = drawn_runs(0, 150)
    assert not found["failures"], found["failures"]
    assert sum(found["ends"].values()) == found["count"] == 150
    assert set(found["ends"]) <= {"", *TERMINATION_REASONS}
    # Neither a way out nor so tame that nothing ends.
    assert 0.3 < found["ends"][""] / 150 < 0.8, found["ends"]
    assert len(found["ends"]) >= 6, found["ends"]


@settings(
    max_examples=100, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck)
)
@given(seed=st.integers(10**6, 2**63 - 1))
def test_random_scenes_that_hypothesis_looks_for(seed: int) -> None:
    assert not play(draw_run(seed)).failures


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("first", range(0, 100_000, 5000))
def test_a_hundred_thousand_random_scenes(first: int) -> None:
    found = drawn_runs(first, first + 5000)
    assert found["count"] == 5000 and not found["failures"], found["failures"]
    assert found["slowest"] <= LONGEST_STEP


@pytest.mark.slow
@pytest.mark.timeout(3600)
@settings(max_examples=5000, deadline=None, suppress_health_check=list(HealthCheck))
@given(seed=st.integers(10**6, 2**63 - 1))
def test_thousands_of_random_scenes_that_no_run_has_seen(seed: int) -> None:
    assert not play(draw_run(seed)).failures


def test_a_seed_draws_the_same_run_again() -> None:
    one, other = draw_run(7), draw_run(7)
    assert one.scene == other.scene and one.duration == other.duration
    assert draw_run(8).scene != one.scene
    first, second = play(one), play(other)
    assert first.displacement == second.displacement


# ---- the verdict can fail ----------------------------------------------------------------------


def _watched(scene: Scene, spoil: str) -> Verdict:
    """Return the verdict on a good run of which one thing was spoilt."""
    bodies = Bodies(scene)
    simulator = Simulator(scene)
    n = bodies.unknowns
    bodies.start(0, simulator.coordinates, np.zeros(n))
    verdict = Verdict("case", spoil, wanted=10, energy_tolerance=0.05)
    watch = _Watch(bodies, verdict)
    torques = simulator.prescribed_torques(10)
    record, trace = bodies.new_record(10), np.empty((1, 10, bodies.trace_columns))
    bodies.advance(torques[None], 1, record, trace=trace)
    states = trace[0, :, : 2 * n]
    column = dict(zip(RECORD_NAMES, record[0].T, strict=True))
    if spoil == "not a number":
        states[4, 3] = np.nan
    elif spoil == "residual":
        column["residual"][5] = 1e-9
    elif spoil == "round-off":
        column["residual"][5], column["at_round_off"][5] = 1e-5, 1.0
    elif spoil == "budget":
        column["work"][5] += 1e-3
    elif spoil == "momentum":
        states[6, n] += 1e-6 * np.abs(states[:, n:]).max()
    elif spoil == "wrong root":
        states[5:, 5] += 0.6
    elif spoil == "energy":
        column["energy"][3:] *= 1.2
    watch.look(states, record[0], torques)
    watch.close()
    return verdict


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        ("not a number", "not finite"),
        ("residual", "residual"),
        ("round-off", "taken for round-off"),
        ("budget", "the budget was kept"),
        ("momentum", "momentum off"),
        ("wrong root", "turned by"),
    ],
)
def test_what_is_wrong_is_found(spoil: str, words: str) -> None:
    verdict = _watched(load_scene("swimmer"), spoil)
    assert any(words in text for text in verdict.failures), verdict.failures


def small_swimmer() -> Scene:
    """Return a thousandth of the length in a fluid as dense: the same motion, scaled.

    With unit depth, EI ~ l^5 and torques ~ l^4 at the same times.
    """
    small, scene = 1e-3, load_scene("swimmer")
    powers = {
        "beam.length": 1,
        "beam.half_thickness": 1,
        "beam.line_density": 1,
        "beam.rotary_inertia": 3,
        "beam.bending_stiffness": 5,
        "actuation.amplitude": 4,
        "actuation.torque_limit": 4,
    }
    data = scene.to_dict()
    changes = {}
    for name, power in powers.items():
        block, field = name.split(".")
        changes[name] = small**power * data[block][field]
    return scene.replace(changes)


def test_the_momentum_of_a_small_body_counts_by_its_size() -> None:
    assert _watched(small_swimmer(), "nothing").failures == []
    assert any("momentum off" in text for text in _watched(small_swimmer(), "momentum").failures)


def test_a_run_that_must_last_has_its_energy_explained() -> None:
    scene = load_scene("paper_i", {"actuation.frequency": 10.0 * math.pi})
    run = HardRun("resonant", scene, 2.0, must_last=True)
    assert any("energy off" in text for text in play(run).failures)
    known = play(dataclasses.replace(run, flagged=True))
    assert not any("energy off" in text for text in known.failures)
    fed = dataclasses.replace(run, must_last=False, steady=True)
    assert any("mean energy changes" in text for text in play(fed).failures)


def test_a_good_run_is_right_and_energy_is_flagged() -> None:
    good = _watched(load_scene("swimmer"), "nothing")
    assert good.failures == [] and good.trusted
    spoilt = _watched(load_scene("swimmer"), "energy")
    assert not spoilt.trusted and spoilt.energy_drift > 0.05
    assert all("budget" in text for text in spoilt.failures), spoilt.failures


def test_a_step_that_takes_too_long_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs_module, "LONGEST_STEP", 0.0)
    verdict = play(HardRun("slow", load_scene("swimmer"), 0.02))
    assert any("a step took" in text for text in verdict.failures), verdict.failures


def test_an_early_end_where_a_solution_exists_is_found() -> None:
    run = HardRun("folds", load_scene("swimmer"), 2.0, Ramp(45.0), must_last=True)
    verdict = play(run)
    assert verdict.reason and any("a solution exists" in text for text in verdict.failures)


def test_half_the_step_tells_what_may_be_claimed() -> None:
    scene = load_scene("swimmer")
    calm = play(HardRun("calm", scene, 2.0, compared=True))
    assert calm.agreement is not None and calm.agreement < 1e-3 and calm.claimed
    coarse = scene.replace(
        {"integrator.time_step": 0.2, "episode.control_interval": 0.2, "actuation.frequency": 31.0}
    )
    wild = play(HardRun("wild", coarse, 10.0, compared=True))
    assert wild.agreement is not None and not wild.claimed, wild.agreement


# ---- torques -----------------------------------------------------------------------------------


def test_torques_are_functions_of_time() -> None:
    scene = load_scene("swimmer")
    coarse, fine = np.arange(8) * 0.02, np.arange(16) * 0.01
    for drive in (WhiteNoise(3.0, 1), SquareWave(2.0), Ramp(5.0), Ramp(5.0, 3, 0.5)):
        np.testing.assert_array_equal(drive(scene, coarse), drive(scene, fine)[::2])
    noise = WhiteNoise(3.0, 1)(scene, np.arange(400) * 0.02)
    assert np.abs(noise).max() <= 3.0 and np.abs(noise.mean()) < 0.2 and noise.std() > 1.5
    square = SquareWave(2.0, 0.4)(scene, np.array([0.0, 0.19, 0.2, 0.39, 0.4]))[:, 0]
    np.testing.assert_array_equal(square, [2.0, 2.0, -2.0, -2.0, 2.0])
    ramp = Ramp(5.0, 3, 0.5)(scene, np.array([0.05, 1.0]))
    np.testing.assert_allclose(ramp[:, 3], [0.25, 0.5])
    assert (np.delete(ramp, 3, axis=1) == 0.0).all()


# ---- what the solver does about it -------------------------------------------------------------


def test_a_joint_is_held_beyond_ninety_degrees_by_the_strain_that_does_not_soften() -> None:
    # 27 N m against EI/dl = 15 N m a radian.
    torques = Ramp(30.0, 0, 27.0)
    changes: dict[str, object] = {
        "beam.elements": 3,
        "damping.retardation_time": 0.02,
        "integrator.strain": "joint_angle",
    }
    for model in ("panels", "frozen", "none"):
        simulator = Simulator(load_scene("swimmer", {**changes, "fluid.model": model}))
        times = np.arange(2000) * simulator.time_step
        run = simulator.rollout(torques(simulator.scene, times))
        assert run.termination_reason == ""
        held = np.diff(run.angles[-1])
        np.testing.assert_allclose(held, [27.0 / 15.0, 0.0], atol=1e-3)
    # Softening strain bears no more than half of EI/dl, at 45 degrees.
    soft = {**changes, "integrator.strain": "mean_angles", "fluid.model": "none"}
    simulator = Simulator(load_scene("swimmer", soft))
    run = simulator.rollout(torques(simulator.scene, np.arange(2000) * simulator.time_step))
    assert np.abs(np.diff(run.angles[-1])).max() > 10.0


def test_energy_that_nothing_explains_ends_a_run_where_the_scene_says_so() -> None:
    changes = {
        "actuation.frequency": 10.0 * math.pi,
        "integrator.time_step": 0.01,
        "episode.control_interval": 0.02,
    }
    scene = load_scene("paper_i", changes)
    warned = Simulator(scene).rollout(Simulator(scene).prescribed_torques(500))
    summary = warned.summary()
    assert summary["energy_drift"] > 0.05 and not summary["trusted"]
    assert "energy budget" in summary["warnings"][0] and "0.05" in summary["warnings"][0]
    strict = Simulator(scene.replace("integrator.energy_excess", "end"))
    run = strict.rollout(strict.prescribed_torques(500))
    assert run.termination_reason == "energy_unexplained"
    assert run.energy_drift > 0.05, "the step that went beyond it is part of the run"
    assert np.array_equal(run.angles, warned.angles[: run.steps + 1]), "nothing else changes"
    before = run.energy[:-1], run.work[:-1], run.dissipated[:-1]
    balance = np.abs(before[0] - before[0][0] - np.concatenate([[0.0], np.cumsum(before[1])]))
    assert balance.max() <= 0.05 * before[0].max(), "it could have ended sooner"
    with pytest.raises(SimulationEndedError, match="energy_unexplained"):
        strict.step(np.zeros(8))


def test_the_running_budget_is_the_trajectorys() -> None:
    for changes in ({}, {"integrator.scheme": "composed"}):
        simulator = Simulator(load_scene("swimmer", changes))
        rng = np.random.default_rng(3)
        run = simulator.rollout(np.repeat(rng.uniform(-1.0, 1.0, (50, 8)), 4, axis=0))
        assert run.energy_drift > 0.0
        assert simulator.energy_drift() == pytest.approx(run.energy_drift, rel=1e-9)
        kept = simulator.snapshot()
        simulator.reset()
        assert simulator.energy_drift() == 0.0
        simulator.restore(kept)
        assert simulator.energy_drift() == pytest.approx(run.energy_drift, rel=1e-9)
        assert run.summary()["trusted"] and run.warnings() == []


def test_bodies_too_thin_for_panels_are_refused() -> None:
    conditions = []
    for share in (0.1, 1e-3, 1e-6):
        scene = load_scene("swimmer", {"beam.half_thickness": share / 9.0})
        conditions.append(Simulator(scene).panel_condition())
    # It grows as the body gets thinner, in proportion.
    assert 10.0 < conditions[0] < 200.0
    np.testing.assert_allclose(np.diff(np.log10(conditions)), [2.2, 3.2], atol=0.3)
    for share in (1e-10, 1e-13, 1e-16):
        with pytest.raises(SimulationEndedError) as caught:
            Simulator(load_scene("swimmer", {"beam.half_thickness": share / 9.0}))
        assert caught.value.reason == "influence_singular", share
        assert "too thin" in str(caught.value)
    frozen = load_scene("swimmer", {"fluid.model": "frozen"})
    assert Simulator(frozen).panel_condition() == 0.0


def test_the_panels_condition_belongs_to_the_present_shape() -> None:
    simulator = Simulator(load_scene("paper_i", {"initial.joint_angles": 0.3}))
    straight = Simulator("paper_i").panel_condition()
    # Of a bent body, then of where it has swum to.
    bent = simulator.panel_condition()
    assert bent > 1.1 * straight
    simulator.rollout(simulator.prescribed_torques(50))
    there = Simulator("paper_i")
    there.reset_to(simulator.coordinates, np.zeros(11))
    assert simulator.panel_condition() == pytest.approx(there.panel_condition(), rel=1e-6)


def test_small_bodies_are_resolved_as_large_ones_are() -> None:
    runs = []
    for scene in (load_scene("swimmer"), small_swimmer()):
        simulator = Simulator(scene)
        runs.append(simulator.rollout(simulator.prescribed_torques(400)))
    large, tiny = runs
    assert tiny.residual.max() <= 1e-10
    np.testing.assert_allclose(tiny.angles, large.angles, atol=1e-7)
    np.testing.assert_allclose(1e3 * tiny.path, large.path, atol=1e-8)


# ---- onset, suite, report ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("elements", "stiffness"),
    [
        pytest.param(*key, marks=[] if key == (3, 1e4) else pytest.mark.slow, id=f"{key}")
        for key in ONSETS
    ],
)
def test_the_straight_body_leaves_its_line_as_kirchhoff_says(
    elements: int, stiffness: float
) -> None:
    onset = measure_onset(elements, stiffness)
    assert abs(onset["rate"] - 1.0) < 0.01
    assert 0.09 < onset["kirchhoff"] < 0.11
    # The exact relative equilibrium, and a perturbation that grows as Kirchhoff says: m22/m11 times
    # 1e-16/0.1 times cosh(60 lambda) is 6e-12.
    assert onset["alone"] == 0.0
    assert 3e-12 < onset["tiny"] < 1.2e-11


def test_the_suite_and_its_tables(tmp_path: Path) -> None:
    steps: list[int] = []
    results = measure_stability(("curling",), draws=20, workers=1, progress=steps.append)
    assert sum(steps) == work_of(("curling",), 20)
    assert failures_of(results) == []
    assert results["drawn"]["count"] == 20
    kept = json.loads(json.dumps(results, allow_nan=False))
    text = stability_tables(kept)
    assert f"| curling | {len(results['runs'])} |" in text
    assert "Not right" not in text and str(results["kernels"]) in text
    onset = {"elements": 3, "stiffness": 5.0, "kirchhoff": 0.1, "rate": 1.0, "alone": 0.0}
    for change, words in (
        ({"rate": 1.03}, "of Kirchhoff's"),
        ({"alone": 1e-11}, "left alone"),
        ({"tiny": 1e-8}, "aside turned it"),
    ):
        kept["onsets"] = [{**onset, "tiny": 5e-12, **change}]
        (text,) = failures_of(kept)
        assert words in text, text
    kept["onsets"] = []
    kept["runs"][0]["failures"] = ["momentum off by 3 times its bound"]
    assert "Not right" in stability_tables(kept)
    assert failures_of(kept) == [
        f"curling, {kept['runs'][0]['label']}: momentum off by 3 times its bound"
    ]
