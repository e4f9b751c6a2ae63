"""The hard cases: slices of them in every run of the tests, all of them among the slow ones."""

import dataclasses
import json
import math

import numpy as np
import pytest

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
from tests.support import PAPERS_STEPS

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
def test_a_slice_of_every_case_is_right_or_ends_by_name(case):
    for run in _slice(case):
        verdict = play(run)
        assert not verdict.failures, f"{run.label}: {verdict.failures}"
        assert verdict.steps == verdict.wanted or verdict.reason in TERMINATION_REASONS


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("case", CASES)
def test_every_case_is_right_or_ends_by_name(case):
    runs = CASES[case]()
    wrong = [f"{run.label}: {text}" for run in runs for text in play(run).failures]
    assert not wrong, wrong


def test_runs_of_the_damped_beam_must_last():
    """What cases there are is compared with the stored run in tests/studies/test_release.py."""
    for case in ("resonance", "stiff", "body mass", "thickness", "long"):
        for run in CASES[case]():
            assert run.must_last == (run.scene.damping is not None), run.label
    assert all(run.must_last for run in CASES["resolution"]())
    for run in CASES["long"]():
        assert round(run.duration / run.scene.integrator.time_step) == 1_000_000
    for run in CASES["resonance"]():
        hertz = run.scene.actuation.frequency / (2.0 * math.pi)
        step = 1e3 * run.scene.integrator.time_step
        assert run.label.startswith(f"{hertz:.2f} Hz, {step:g} ms"), run.label


#: Why bodies of panels end that curl, from the shape that is given up first.
CURLED = {
    "head to tail": "under_resolved_gap",
    "head to tail, watched": "under_resolved_gap",
    "one joint": "outline_degenerate",
    "folding rule": "step_not_solved",
    "held beyond 90 degrees": "outline_degenerate",
}


@pytest.mark.parametrize("strain", ["averaged_directors", "mean_angles", "joint_angle"])
def test_how_curling_ends(strain):
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
            wanted = "" if lasts else CURLED[shape]
            if holds and shape == "folding rule":
                # Within its last step the body comes to a shape whose mass is not positive.
                wanted = "mass_not_positive"
            assert verdict.reason == wanted, run.label
        else:
            # Without an outline only the watch for contact ends a run ...
            watched = shape.endswith("watched")
            assert verdict.reason == ("self_contact" if watched else ""), run.label
            # ... and the energy shows joints that snapped over: 0.6 to 7 % of it are unexplained,
            # and at most 0.5 % elsewhere. A light body that is rolled up turns over and over, and
            # more goes through it than is unexplained.
            snapped = shape in ("one joint", "head to tail", "folding rule")
            shown = snapped and not holds and (shape, model) != ("head to tail", "none")
            assert (verdict.energy_drift > 0.005) == shown, run.label


# ---- random scenes -----------------------------------------------------------------------------


def test_random_scenes_of_fixed_seeds():
    found = drawn_runs(0, 250)
    assert not found["failures"], found["failures"]
    assert sum(found["ends"].values()) == found["count"] == 250
    assert set(found["ends"]) <= {"", *TERMINATION_REASONS}
    # Neither a way out nor so tame that nothing ends.
    assert 0.3 < found["ends"][""] / 250 < 0.8, found["ends"]
    assert len(found["ends"]) >= 6, found["ends"]
    # A seed draws the same run again.
    assert draw_run(7) == draw_run(7) and draw_run(8).scene != draw_run(7).scene


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("first", [*range(0, 100_000, 5000), None])
def test_a_hundred_thousand_random_scenes_and_some_that_no_run_has_seen(first):
    """Messages name the seeds."""
    if first is None:
        first = int(np.random.default_rng().integers(10**6, 2**62))
    found = drawn_runs(first, first + 5000)
    assert found["count"] == 5000 and not found["failures"], found["failures"]
    assert found["slowest"] <= LONGEST_STEP


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
def test_what_is_wrong_is_found(spoil, words):
    verdict = _watched(load_scene("swimmer", PAPERS_STEPS), spoil)
    assert any(words in text for text in verdict.failures), verdict.failures


def small_swimmer() -> Scene:
    """Return a thousandth of the length in a fluid as dense: the same motion, scaled.

    With unit depth, EI ~ l^5 and torques ~ l^4 at the same times.
    """
    scene = load_scene("swimmer", PAPERS_STEPS)
    powers = {"length": 1, "half_thickness": 1, "line_density": 1, "rotary_inertia": 3}
    names = {f"beam.{name}": power for name, power in powers.items()}
    names |= {"beam.bending_stiffness": 5, "actuation.amplitude": 4, "actuation.torque_limit": 4}
    data = {name: scene.to_dict()[name.split(".")[0]][name.split(".")[1]] for name in names}
    return scene.replace({name: 1e-3**power * data[name] for name, power in names.items()})


def test_a_run_that_must_last_has_its_energy_explained():
    scene = load_scene("paper_i", {"actuation.frequency": 10.0 * math.pi})
    run = HardRun("resonant", scene, 2.0, must_last=True)
    assert any("energy off" in text for text in play(run).failures)
    known = play(dataclasses.replace(run, flagged=True))
    assert not any("energy off" in text for text in known.failures)
    fed = dataclasses.replace(run, must_last=False, steady=True)
    assert any("mean energy changes" in text for text in play(fed).failures)


def test_a_good_run_is_right_whatever_its_size_and_energy_is_flagged():
    good = _watched(load_scene("swimmer"), "nothing")
    assert good.failures == [] and good.trusted
    assert _watched(small_swimmer(), "nothing").failures == []
    assert any("momentum off" in text for text in _watched(small_swimmer(), "momentum").failures)
    spoilt = _watched(load_scene("swimmer"), "energy")
    assert not spoilt.trusted and spoilt.energy_drift > 0.05
    assert all("budget" in text for text in spoilt.failures), spoilt.failures


def test_a_slow_step_and_an_early_end_where_a_solution_exists_are_found(monkeypatch):
    verdict = play(HardRun("folds", load_scene("swimmer"), 2.0, Ramp(45.0), must_last=True))
    assert verdict.reason and any("a solution exists" in text for text in verdict.failures)
    monkeypatch.setattr(runs_module, "LONGEST_STEP", 0.0)
    verdict = play(HardRun("slow", load_scene("swimmer"), 0.02))
    assert any("a step took" in text for text in verdict.failures), verdict.failures


def test_half_the_step_tells_what_may_be_claimed():
    scene = load_scene("swimmer")
    calm = play(HardRun("calm", scene, 2.0, compared=True))
    assert calm.agreement is not None and calm.agreement < 1e-3 and calm.claimed
    coarse = scene.replace(
        {"integrator.time_step": 0.2, "episode.control_interval": 0.2, "actuation.frequency": 31.0}
    )
    wild = play(HardRun("wild", coarse, 10.0, compared=True))
    assert wild.agreement is not None and not wild.claimed, wild.agreement


# ---- torques -----------------------------------------------------------------------------------


def test_torques_are_functions_of_time():
    scene = load_scene("swimmer")
    coarse, fine = np.arange(8) * 0.02, np.arange(16) * 0.01
    for drive in (WhiteNoise(3.0, 1), SquareWave(2.0), Ramp(5.0), Ramp(5.0, 3, 0.5)):
        np.testing.assert_array_equal(drive(scene, coarse), drive(scene, fine)[::2])


# ---- what the solver does about it -------------------------------------------------------------


def test_a_joint_is_held_beyond_ninety_degrees_by_the_strain_that_does_not_soften():
    # 27 N m against EI/dl = 15 N m a radian.
    changes = {"beam.elements": 3, "damping.retardation_time": 0.02}
    for strain, model in (
        ("joint_angle", "panels"),
        ("joint_angle", "none"),
        ("mean_angles", "none"),
    ):
        how = {"integrator.strain": strain, "fluid.model": model}
        simulator = Simulator(load_scene("swimmer", {**changes, **how}))
        times = np.arange(2000) * simulator.time_step
        run = simulator.rollout(Ramp(30.0, 0, 27.0)(simulator.scene, times))
        bends = np.diff(run.angles[-1])
        if strain == "joint_angle":
            assert run.termination_reason == ""
            np.testing.assert_allclose(bends, [27.0 / 15.0, 0.0], atol=1e-3)
        else:  # it bears no more than half of EI/dl, at 45 degrees
            assert np.abs(bends).max() > 10.0


def test_energy_that_nothing_explains_ends_a_run_where_the_scene_says_so():
    changes = {"actuation.frequency": 10.0 * math.pi, "episode.control_interval": 0.02}
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
    balance = run.energy[:-1] - run.energy[0] - np.cumsum([0.0, *run.work[:-1]])
    assert np.abs(balance).max() <= 0.05 * run.energy[:-1].max(), "it could have ended sooner"
    with pytest.raises(SimulationEndedError, match="energy_unexplained"):
        strict.step(np.zeros(8))


def test_the_running_budget_is_the_trajectorys():
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


def test_the_panels_condition_grows_as_the_body_gets_thinner_and_bends():
    def thin(share: float) -> Simulator:
        return Simulator(load_scene("swimmer", {"beam.half_thickness": share / 9.0}))

    conditions = [thin(share).panel_condition() for share in (0.1, 1e-3, 1e-6)]
    assert 10.0 < conditions[0] < 200.0
    np.testing.assert_allclose(np.diff(np.log10(conditions)), [2.2, 3.2], atol=0.3)
    for share in (1e-10, 1e-13, 1e-16):
        with pytest.raises(SimulationEndedError, match="too thin") as caught:
            thin(share)
        assert caught.value.reason == "influence_singular", share
    assert Simulator(load_scene("swimmer", {"fluid.model": "frozen"})).panel_condition() == 0.0
    # Of a bent body, then of where it has swum to.
    simulator = Simulator(load_scene("paper_i", {"initial.joint_angles": 0.3}))
    there = Simulator("paper_i")
    assert simulator.panel_condition() > 1.1 * there.panel_condition()
    simulator.rollout(simulator.prescribed_torques(50))
    there.reset_to(simulator.coordinates, np.zeros(11))
    assert simulator.panel_condition() == pytest.approx(there.panel_condition(), rel=1e-6)


def test_small_bodies_are_resolved_as_large_ones_are():
    runs = []
    for scene in (load_scene("swimmer", PAPERS_STEPS), small_swimmer()):
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
def test_the_straight_body_leaves_its_line_as_kirchhoff_says(elements, stiffness):
    onset = measure_onset(elements, stiffness)
    assert abs(onset["rate"] - 1.0) < 0.01
    assert 0.09 < onset["kirchhoff"] < 0.11
    # The exact relative equilibrium, and a perturbation that grows as Kirchhoff says: m22/m11 times
    # 1e-16/0.1 times cosh(60 lambda) is 6e-12.
    assert onset["alone"] == 0.0
    assert 3e-12 < onset["tiny"] < 1.2e-11


def test_the_suite_and_its_tables(tmp_path):
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
