"""Baselines, episodes played by them, and their verification."""

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
from swim_agents import (
    POLICY_NAMES,
    Rollout,
    WavePolicy,
    baselines,
    load_policy,
    play_episode,
    play_episodes,
    tuned_wave,
    tuning,
    verify_rollout,
)
from swim_agents.commands import INTERRUPTED
from swim_agents.commands.main import main as call_main
from swim_agents.comparison.contest import references_on
from swim_agents.comparison.performance import measure_performance
from swim_agents.replay import replay_episode
from swim_agents.rollout import score
from swim_agents.tuned_wave import load_tuned_wave
from swim_agents.tuning import (
    Point,
    actions_to_play,
    check_candidates,
    net_displacements,
    record_of,
    search_wave,
)
from swim_agents.verification import fine_scene, finer_scenes

from swim_env import (
    OptionError,
    Scene,
    Simulator,
    SwimEnv,
    SwimError,
    SwimTargetEnv,
    SwimVectorEnv,
    Trajectory,
    characterise,
    load_scene,
    natural_frequencies,
)
from swim_env.scene import Actuation
from tests.support import refuses, run_script

SHORT = ["episode.duration=1.0"]
QUIET = {"noise": 0.0}


@pytest.fixture
def env() -> SwimEnv:
    return SwimEnv("swimmer", SHORT)


# ---- the call of a trained model ---------------------------------------------------------------


@pytest.mark.parametrize("name", POLICY_NAMES)
def test_a_policy_acts_within_the_space_for_one_observation_and_for_a_batch(name, env):
    policy = load_policy(name, env.scene, seed=3)
    observation, _ = env.reset(seed=0)
    action, _ = policy.predict(observation, deterministic=True)
    assert action.shape == env.action_space.shape
    assert (np.abs(action) <= 1.0).all()
    actions, _ = policy.predict(np.stack([observation] * 3), deterministic=True)
    assert actions.shape == (3, 8)
    if name != "random":
        assert (actions == action).all()


def test_the_wave_keeps_its_clock_in_the_state():
    scene = load_scene("swimmer")
    assert scene.actuation is not None
    policy = load_policy("paper_wave", scene)
    observations = np.zeros((2, 21), dtype=np.float32)
    state: Any = None
    for n in range(5):
        before = None if state is None else state.copy()
        given = state
        actions, state = policy.predict(observations, given, np.array([n == 0, n in (0, 3)]))
        assert given is None or (given == before).all(), "the state was changed in place"
        times = np.array([n, n if n < 3 else n - 3]) * scene.episode.control_interval
        assert (actions == scene.actuation.torques(times, scene.beam)).all()
    # The policy itself remembers nothing, and its clock does not drift.
    assert (policy.predict(observations)[0] == scene.actuation.torques([0.0], scene.beam)).all()
    late = np.array([10_000_000, 0])
    actions, _ = policy.predict(observations, late)
    assert (actions == scene.actuation.torques(late * 0.02, scene.beam)).all()


def test_random_actions_follow_their_seed(env):
    def numbers(seed: int) -> np.ndarray:
        policy, state, played = load_policy("random", seed=seed), None, []
        for _ in range(5):
            actions, state = policy.predict(np.zeros((3, 21)), state)
            played.append(actions)
        return np.array(played)

    first, second, other = numbers(1), numbers(1), numbers(2)
    assert (first == second).all()
    assert (first != other).all()
    # No number comes twice, neither in time nor among members.
    assert len(set(first.ravel().tolist())) == first.size
    # Nor are they the numbers of the start's noise with the same seed.
    played = play_episode(env, load_policy("random", env.scene, seed=3), seed=3)
    bend = played.coordinates[3:] / env.scene.episode.bend_noise
    assert np.abs(played.torques[0] - bend).max() > 0.1


def test_bad_calls_get_one_clear_error():
    policy = load_policy("paper_wave")
    with refuses(OptionError, "seed must be"):
        load_policy("random", seed=-1)
    for shape in ((), (2, 2, 21)):
        with refuses(OptionError, "observation must have shape"):
            policy.predict(np.zeros(shape))
    with refuses(OptionError, "state must be whole numbers of shape (2,)"):
        policy.predict(np.zeros((2, 21)), np.zeros(1, dtype=np.int64))
    with refuses(OptionError, "needs a SwimEnv, got CartPoleEnv"):
        play_episode(gymnasium.make("CartPole-v1"), policy)


def test_torques_are_a_share_of_the_scenes_limit_and_cut_off_beyond_it():
    scene = load_scene("swimmer", ["actuation.torque_limit=4.0"])
    action, _ = load_policy("paper_wave", scene).predict(np.zeros(21))
    assert action[0] == pytest.approx(np.cos(-2.0 * np.pi / 9.0) / 4.0, rel=1e-15)
    policy = load_policy("paper_wave", scene.replace("actuation.torque_limit", 0.5))
    actions, _ = policy.predict(np.zeros((3, 21)), np.array([0, 10, 20]))
    assert np.abs(actions).max() == 1.0
    assert (np.abs(actions) < 1.0).any()


# ---- episodes ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["paper_i", "paper_x"])  # paper_x prescribes no torque
def test_an_episode_is_the_simulators_replay_bit_for_bit_without_noise_and_hold(name):
    scene = load_scene(name, ["episode.control_interval=0.01", "episode.duration=3.0"])
    rollout = play_episode(SwimEnv(scene), load_policy("paper_wave", scene), options=QUIET)
    simulator = Simulator(scene)
    trajectory = simulator.rollout(simulator.prescribed_torques(300))
    assert (rollout.torques == trajectory.torques).all()
    assert rollout.torques.any() == (name == "paper_i")
    assert (rollout.path[-1] == simulator.coordinates[:2]).all()
    assert rollout.rewards.sum() == pytest.approx(-trajectory.displacement[0], abs=1e-13)


def test_a_broken_episode_is_played_again_to_its_end_and_never_verified():
    # A soft beam folds under the torque.
    scene = load_scene("swimmer", ["beam.bending_stiffness=0.05", "episode.duration=2.0"])
    rollout = play_episode(SwimEnv(scene), load_policy("paper_wave", scene), options=QUIET)
    assert rollout.terminated
    assert rollout.steps < scene.steps_per_action * len(rollout.torques)
    again = rollout.simulate()
    assert again.steps == rollout.steps
    assert np.abs(again.path[-1] - rollout.path[-1]).max() < 1e-14
    checked = verify_rollout(rollout)
    assert not checked.verified
    assert checked.termination_reason == rollout.info["termination_reason"]


@pytest.mark.parametrize("name", POLICY_NAMES)
def test_a_rollout_played_again_is_the_same_motion(name, env):
    rollout = play_episode(env, load_policy(name, env.scene, seed=5), seed=7)
    simulator = Simulator(env.scene)
    simulator.reset_to(rollout.coordinates, rollout.velocity)
    simulator.rollout(np.repeat(rollout.torques, env.scene.steps_per_action, axis=0))
    assert (simulator.coordinates == env.coordinates).all()
    assert rollout.truncated
    assert not rollout.terminated
    assert rollout.rewards.sum() == pytest.approx(rollout.net_displacement, abs=1e-13)
    assert rollout.info["progress"] == pytest.approx(rollout.net_displacement, abs=1e-13)


# ---- verification ------------------------------------------------------------------------------


def _play(scene_overrides: list[str], wave: Actuation) -> Rollout:
    scene = load_scene("swimmer", scene_overrides)
    return play_episode(SwimEnv(scene), WavePolicy(scene, wave), options=QUIET)


def test_a_resolved_score_is_verified():
    rollout = _play(["episode.duration=2.0"], Actuation(amplitude=1.0))
    checked = verify_rollout(rollout)
    assert checked.verified
    assert checked.changes.keys() == {"time_step", "panels", "ends", "together"}
    assert 0.0 < max(map(abs, checked.changes.values())) < 0.05
    assert checked.closed_displacement is None
    assert checked.time_step == rollout.scene.integrator.time_step / 4
    assert checked.panels_per_element == 12
    assert checked.net_displacement == rollout.net_displacement
    assert checked.fine_displacement != checked.net_displacement
    json.dumps(checked.to_dict(), allow_nan=False)
    # No motion agrees with no motion.
    checked = verify_rollout(_play(SHORT, Actuation(amplitude=0.0)))
    assert checked.verified
    assert set(checked.changes.values()) == {0.0}


@pytest.mark.parametrize(
    ("changes", "finer"),
    [
        ({}, {"fluid.panels_per_element": 12, "fluid.cap_panels": 6}),
        (
            {"fluid.panels_per_element": 8, "fluid.cap_panels": 3, "integrator.tolerance": 1e-5},
            {
                **{"fluid.panels_per_element": 16, "fluid.cap_panels": 6},
                "integrator.tolerance": 1e-5 / 100,
            },
        ),
        (
            {"fluid.cap_panels": "proportional"},
            {"fluid.panels_per_element": 12, "fluid.cap_panels": 3},
        ),
        # Ends of one panel are refined too where a third of a side's panel is as long as they.
        (
            {"fluid.cap_panels": "proportional", "beam.half_thickness": 0.002},
            {"fluid.panels_per_element": 12, "fluid.cap_panels": 3},
        ),
        (
            {"fluid.model": "centreline"},
            {"fluid.panels_per_element": 12},
        ),
        *(
            (
                {"fluid.model": model},
                {"fluid.panels_per_element": 12, "fluid.cap_panels": 6},
            )
            for model in ("frozen", "expansion")
        ),
        ({"fluid.model": "strip"}, {}),
        ({"fluid": None}, {}),
    ],
)
def test_the_finer_scene_refines_all_that_is_discrete_but_the_elements(changes, finer):
    scene = load_scene("swimmer", changes)
    step = scene.integrator.time_step / 4
    whole = {"integrator.time_step": step, "integrator.tolerance": 1e-6, **finer}
    assert fine_scene(scene) == scene.replace(whole)
    # And each source of error by itself, the ends' panels whatever the sides have.
    fluid = scene.fluid
    ends = {"fluid.cap_panels": fluid.panels_per_end(scene.beam)} if fluid else {}
    alone = {
        "time_step": ("integrator.time_step", "integrator.tolerance"),
        "panels": ("fluid.panels_per_element",),
        "ends": ("fluid.cap_panels",),
    }
    found = finer_scenes(scene)
    for source, fields in alone.items():
        change = {field: whole[field] for field in fields if field in whole}
        if not change:
            assert source not in found
            continue
        if source == "panels" and "fluid.cap_panels" in whole:
            change |= ends
        assert found.pop(source) == scene.replace(change)
    assert found == ({"together": fine_scene(scene)} if finer else {})


def test_a_scene_that_cannot_be_refined_is_refused_by_name():
    fine = load_scene("swimmer", ["beam.elements=500", "fluid.cap_panels=proportional"])
    with refuses(SwimError, "scene swimmer is too fine to be verified", "at most 5000 panels"):
        fine_scene(fine)


def test_a_score_whose_energy_does_not_add_up_is_not_verified():
    still = ["episode.duration=0.2", "integrator.energy_tolerance=1e-6"]
    checked = verify_rollout(_play(still, Actuation(amplitude=1.0)))
    assert max(map(abs, checked.changes.values())) < 0.05 and not checked.termination_reason
    assert max(checked.energy_drift, checked.fine_energy_drift) > 1e-6
    assert not checked.verified


def _pretend(monkeypatch: pytest.MonkeyPatch, rollout: Rollout, **changes: float) -> None:
    """Let finer computations of an episode's torques change its score by such shares."""
    scenes = finer_scenes(rollout.scene)
    way = rollout.path[-1] - rollout.path[0]
    sign = np.sign(rollout.net_displacement)

    def simulate(self: Rollout, scene: Scene, progress: object) -> SimpleNamespace:
        name = next(name for name, one in scenes.items() if one == scene)
        path = rollout.path[0] + np.outer([0.0, 1.0 + sign * changes.get(name, 0.0)], way)
        return SimpleNamespace(path=path, energy_drift=0.0, termination_reason="")

    monkeypatch.setattr(Rollout, "simulate", simulate)


@pytest.mark.parametrize(
    ("changes", "verified"),
    [
        ({}, True),
        ({"time_step": 0.04, "panels": -0.04}, True),
        # Together they cancel.
        ({"time_step": 0.08, "panels": -0.08}, False),
        ({"panels": 0.08, "ends": -0.08}, False),
        ({"time_step": -0.06}, False),
        ({"ends": 0.06}, False),
        # And together they may be too much.
        ({"time_step": 0.04, "panels": 0.04, "ends": 0.04, "together": 0.12}, False),
        ({"time_step": 0.04, "panels": 0.04, "together": 0.08}, True),
    ],
)
def test_errors_that_cancel_do_not_verify_a_score(env, monkeypatch, changes, verified):
    rollout = play_episode(env, load_policy("tuned_wave", env.scene), seed=0)
    _pretend(monkeypatch, rollout, **changes)
    checked = verify_rollout(rollout)
    expected = {name: changes.get(name, 0.0) for name in ("time_step", "panels", "ends")}
    expected["together"] = changes.get("together", 0.0)
    assert checked.changes == pytest.approx(expected, abs=1e-12)
    assert checked.verified == verified
    json.dumps(checked.to_dict(), allow_nan=False)


class _Steered:
    """Torques that follow the bending, as an agent's follow what it observes."""

    def predict(self, observation: Any, *_: Any, **__: Any) -> tuple[Any, None]:
        seen = np.asarray(observation)
        return np.clip(0.2 * np.roll(seen[..., :8], 1, axis=-1) + 0.3, -1.0, 1.0), None


def test_a_policy_with_feedback_plays_in_the_finer_scene_itself(env):
    rollout = play_episode(env, _Steered(), seed=3)
    fine = SwimEnv(fine_scene(env.scene))
    closed_loop = play_episode(fine, _Steered(), seed=3)
    checked = verify_rollout(rollout, closed_loop)
    # Once more by hand, action by action.
    start, other = env.reset(seed=3)[0], fine.reset(seed=3)[0]
    # What is observed depends neither on the time step nor on the panels.
    assert (start == other).all() and env.observation_space == fine.observation_space
    for _ in range(env.scene.actions_per_episode):
        other, *_, info = fine.step(_Steered().predict(other)[0])
    assert checked.closed_displacement == pytest.approx(info["progress"], abs=1e-13)
    assert checked.closed_energy_drift == info["energy_drift"] > 0.0
    assert (checked.closed_termination_reason, checked.closed_success) == ("", None)
    # It is not what its torques do there.
    again = rollout.simulate(fine.scene)
    assert checked.fine_displacement == score(rollout, again.path[-1])
    assert abs(checked.closed_displacement - checked.fine_displacement) > 1e-6
    own = rollout.net_displacement
    share = (checked.closed_displacement - own) / abs(own)
    assert checked.changes["closed_loop"] == pytest.approx(share, rel=1e-12)


@pytest.mark.parametrize("name", ["paper_wave", "tuned_wave", "random"])
def test_the_closed_loop_of_a_wave_is_its_torques_played_again(env, name):
    policy = load_policy(name, env.scene, seed=5)
    rollout = play_episode(env, policy, seed=1)
    fine = fine_scene(env.scene)
    closed_loop = play_episode(SwimEnv(fine), policy, seed=1)
    again = rollout.simulate(fine)
    shares: list[float] = []
    checked = verify_rollout(rollout, closed_loop, progress=shares.append)
    assert checked.closed_displacement == checked.fine_displacement
    assert checked.fine_displacement == pytest.approx(score(rollout, again.path[-1]), abs=1e-13)
    assert checked.closed_energy_drift == pytest.approx(again.energy_drift, rel=1e-9)
    assert checked.changes["closed_loop"] == checked.changes["together"]
    assert max(shares) == shares[-1] > 0.5, "the finest computation, which was played before"
    assert sum(shares) == pytest.approx(1.0)
    alone = verify_rollout(rollout)
    assert alone.changes == pytest.approx({name: checked.changes[name] for name in alone.changes})
    assert alone.fine_energy_drift == pytest.approx(checked.fine_energy_drift, rel=1e-9)


@pytest.mark.parametrize("task", ["path", "turn", "target", "station"])
def test_what_is_verified_of_a_task_is_its_score_and_whether_it_succeeds(task):
    scene = load_scene("swimmer", [*SHORT, "stream.velocity=[0.06, 0.0]"])
    rollout = play_episode(SwimEnv(scene, task=task), load_policy("paper_wave", scene), seed=0)
    finer = {"scene": fine_scene(scene), "torques": 0.0 * rollout.torques}

    def verified(change: float, **info: Any) -> bool:
        return verify_rollout(
            rollout,
            replace(
                rollout,
                **finer,
                rewards=(1.0 + change) * rollout.rewards,
                path=rollout.path[0] + (1.0 + change) * (rollout.path - rollout.path[0]),
                info={**rollout.info, **info},
            ),
        ).verified

    assert verified(0.0) and verified(0.08) and verified(-0.08)
    # Of a target it counts whether it is reached.
    assert verified(0.15) == verified(-0.15) == (task == "target")
    if task != "station":
        assert not verified(0.0, success=True)


def test_a_closed_loop_that_does_otherwise_verifies_nothing(env, monkeypatch):
    rollout = play_episode(env, load_policy("tuned_wave", env.scene), seed=0)
    closed_loop = replace(rollout, scene=fine_scene(env.scene), torques=0.0 * rollout.torques)
    _pretend(monkeypatch, rollout)
    assert verify_rollout(rollout, closed_loop).verified
    way = rollout.path - rollout.path[0]
    assert rollout.net_displacement < 0.0  # one second does not suffice
    for change, verified in ((-0.05, True), (0.08, True), (-0.15, False), (0.15, False)):
        moved = replace(closed_loop, path=rollout.path[0] + (1.0 - change) * way)
        checked = verify_rollout(rollout, moved)
        assert checked.changes["closed_loop"] == pytest.approx(change)
        assert checked.verified == verified
    for bad in ({"energy_drift": 0.2}, {"termination_reason": "state_not_finite"}):
        broken = replace(closed_loop, info={**rollout.info, **bad})
        assert not verify_rollout(rollout, broken).verified


def test_a_target_is_verified_by_the_closed_loop_alone(monkeypatch):
    env = SwimTargetEnv("swimmer", ["episode.duration=2.0", "episode.velocity_noise=0.0"])
    options: dict[str, Any] = {"noise": 0.0, "velocity": [-0.5, 0.0], "target": [0.2, 0.0]}
    zero = load_policy("zero", env.scene)
    rollout = play_episode(env, zero, seed=0, options=options)
    fine = SwimTargetEnv(fine_scene(env.scene))
    closed_loop = play_episode(fine, zero, seed=0, options=options)
    checked = verify_rollout(rollout, closed_loop)
    assert checked.verified and checked.closed_success is True
    assert checked.closed_termination_reason == "target_reached"
    assert checked.closed_distance == pytest.approx(closed_loop.info["distance"], rel=1e-9)
    missed = {**rollout.info, "success": False, "termination_reason": ""}
    assert not verify_rollout(rollout, replace(closed_loop, info=missed)).verified
    assert not verify_rollout(replace(rollout, info=missed), closed_loop).verified
    # Whatever becomes of the torques without feedback, or of the way to the target.
    _pretend(monkeypatch, rollout, time_step=0.5, together=-0.9)
    other = replace(rollout, torques=rollout.torques + 0.1)  # equal ones are not played again
    checked = verify_rollout(other, closed_loop)
    assert checked.verified and checked.changes["together"] < -0.5
    assert not verify_rollout(rollout).verified


def test_another_episode_is_not_taken_for_the_closed_loop(env):
    policy = load_policy("zero", env.scene)
    rollout = play_episode(env, policy, seed=0)
    other = play_episode(SwimEnv(fine_scene(env.scene)), policy, seed=1)
    for closed_loop, differs in ((rollout, "scene"), (other, "coordinates")):
        with refuses(OptionError, "fine_scene of scene swimmer", f"{differs} differs"):
            verify_rollout(rollout, closed_loop)


@pytest.mark.slow
def test_unexplained_energy_and_advice_are_alarms_for_displacements_that_are_off():
    # Energy alone is not: a step too long for the first mode may settle into another motion, whose
    # books are in order.
    scene = load_scene("swimmer")
    for name in ("ppo_forward", "tuned_wave"):
        rollout = play_episode(SwimEnv(scene), load_policy(name, scene), seed=2000000)

        def played(scheme: str, step: float, rollout: Rollout = rollout) -> Trajectory:
            changes = {"scheme": scheme, "time_step": step, "tolerance": 1e-10}
            integrator = replace(rollout.scene.integrator, **changes)
            return rollout.simulate(replace(rollout.scene, integrator=integrator))

        wanted = played("composed", 0.0003125).displacement
        for scheme in ("paper", "composed"):
            for step in (0.02, 0.01, 0.005, 0.0025):
                run = played(scheme, step)
                error = np.hypot(*(run.displacement - wanted)) / np.hypot(*wanted)
                print(f"{name} {scheme} {1e3 * step:g} ms: {run.energy_drift:.2%} / {error:.2%}")
                if run.warnings():
                    assert error > 0.025
                elif not characterise(run.scene).advice:
                    assert error < (0.15 if scheme == "paper" else 0.06)


# ---- the tuned wave ----------------------------------------------------------------------------


def test_the_tuned_wave_beats_the_papers_by_fifteen_and_is_what_its_record_says():
    scene = load_scene("swimmer")
    record = load_tuned_wave()
    paper, tuned = (
        play_episode(SwimEnv(scene), load_policy(name, scene), options=QUIET)
        for name in ("paper_wave", "tuned_wave")
    )
    assert tuned.net_displacement >= 15.0 * paper.net_displacement > 0.0
    # The last digits of a resonant motion depend on the processor's instructions.
    assert tuned.net_displacement == pytest.approx(record["net_displacement"], rel=1e-3)
    assert record["paper_wave"] == pytest.approx(paper.net_displacement, rel=1e-3)
    assert record["wave"]["amplitude"] <= scene.torque_limit
    assert record["checked"][-1]["verified"]
    assert all(not entry["verified"] for entry in record["checked"][:-1])


@pytest.mark.slow
def test_the_tuned_wave_is_verified():
    scene = load_scene("swimmer")
    policy = load_policy("tuned_wave", scene)
    rollout, closed_loop = (
        play_episode(SwimEnv(one), policy, options=QUIET) for one in (scene, fine_scene(scene))
    )
    checked = verify_rollout(rollout, closed_loop)
    assert checked.verified
    assert checked.fine_displacement == pytest.approx(
        load_tuned_wave()["fine_displacement"], rel=1e-3
    )


def test_waves_score_in_a_batch_what_they_score_alone(env):
    scene = env.scene
    waves = [Actuation(amplitude=1.0, frequency=f, wave_number=-4.0) for f in (10.0, 20.0, 30.0)]
    alone = [
        play_episode(env, WavePolicy(scene, wave), options=QUIET).info["progress"] for wave in waves
    ]
    assert net_displacements(scene, waves).tolist() == alone
    # An episode that ends early has no score: a soft beam folds under the torque.
    soft = scene.replace("beam.bending_stiffness", 0.05)
    first, second = net_displacements(soft, [Actuation(amplitude=1.0), Actuation(amplitude=0.0)])
    assert np.isnan(first)
    assert second == 0.0


def test_the_search_finds_the_best_of_what_it_tried():
    scene = load_scene("swimmer", ["episode.duration=10"])
    seen: list[float] = []
    sizes = {"frequencies": 4, "wave_numbers": 3, "generations": 2, "population": 8}
    log: dict[Point, float] = {}
    record = search_wave(scene, **sizes, progress=seen.append, keep=log.update)
    assert sum(seen) == actions_to_play(scene, *sizes.values())
    best = record["candidates"][0]
    whole = {wave: value for wave, value in log.items() if wave[4] == 500}
    assert len(whole) == 8
    assert best["net_displacement"] == max(whole.values())
    short = [value for wave, value in log.items() if wave[4] < 500]
    assert len(short) == 4 * 3 + 2 * 8
    assert np.max(record["grid"]["net_displacement"]) <= max(short) + 1e-6
    # What was played is not played again, and the result is the same.
    again = search_wave(scene, **sizes, known=log, keep=lambda _: pytest.fail("was played"))
    assert again == record
    checked = check_candidates(scene, record)
    kept = record_of(scene, record, checked)
    wave = Actuation(**kept["wave"])
    assert kept["net_displacement"] in [one["net_displacement"] for one in record["candidates"]]
    assert net_displacements(scene, [wave])[0] == kept["net_displacement"]
    assert kept["checked"][-1]["verified"]
    assert kept["versions"]["numpy"] == np.__version__


def test_the_grid_is_what_can_be_commanded_and_the_record_says_how_long_waves_swam():
    slow = load_scene("swimmer", ["episode.control_interval=0.2", "episode.duration=4.0"])
    hertz, kappa = tuning._grid(slow, None, None)
    assert max(hertz) == 0.4 / 0.2 and len(set(hertz)) == len(hertz)
    first = natural_frequencies(slow, 1)[0]
    assert first > max(hertz)
    sizes: dict[str, Any] = {"frequencies": 1, "wave_numbers": 1, "generations": 0}
    found = search_wave(slow, **sizes)
    assert found["periods_in_episode"] == pytest.approx(4.0 * first, abs=0.01)
    swimmer = load_scene("swimmer")
    periods = tuning._short_actions(swimmer) * 0.02 * natural_frequencies(swimmer, 1)[0]
    assert 40.0 <= periods < 40.2
    # A prescribed wave that gets nowhere is nothing to compare with.
    weak = slow.replace("actuation.amplitude", 1e-3)
    record = record_of(weak, found)
    assert abs(record["paper_wave"]) < 1e-3 and record["ratio"] is None


def test_waves_whose_energy_does_not_add_up_do_not_count():
    scene = load_scene("swimmer", ["episode.duration=10"])
    wave = Actuation(amplitude=1.0, frequency=31.7, wave_number=-4.7)
    (counts,) = net_displacements(scene, [wave])
    assert counts > 1.0
    strict = scene.replace("integrator.energy_tolerance", 1e-9)
    assert np.isnan(net_displacements(strict, [wave])).all()


def test_a_scene_of_ones_own_has_its_own_tuned_wave(tmp_path, capsys):
    file = tmp_path / "eel.yaml"
    file.write_text(
        "beam: {length: 0.5, elements: 5, half_thickness: 0.005, line_density: 0.156,"
        " bending_stiffness: 0.156}\nfluid: {density: 10.0}\ndamping: {retardation_time: auto}\n"
    )
    command = ["tune", "--scene", str(file), "--generations", "1", "--population", "8", "--json"]
    assert call_main(command) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["net_displacement"] > 0.5
    assert not list(tmp_path.glob("*.part"))
    kept = tmp_path / "eel.tuned_wave.json"
    scene = load_scene(file)
    for name in ("tuned_wave", kept):
        policy = load_policy(name, scene)
        played = play_episode(SwimEnv(scene), policy, options=QUIET)
        assert played.net_displacement == pytest.approx(told["net_displacement"], rel=1e-12)
    # A search that found none leaves the scene without one.
    record = json.loads(kept.read_text())
    kept.write_text(json.dumps({**record, "wave": None}))
    with pytest.raises(OptionError, match="found no wave that swims"):
        load_policy("tuned_wave", scene)
    assert references_on(scene) == []
    kept.write_text(json.dumps(record))
    # Of the body as it was tuned.
    with pytest.raises(OptionError, match=r"beam.length is 0.6, it was 0.5 in tuning"):
        load_policy("tuned_wave", scene.replace("beam.length", 0.6))
    assert call_main(["tune", "--scene", "swimmer"]) == 2
    assert "name the record's file with --output" in capsys.readouterr().err


def test_a_search_that_was_interrupted_goes_on(tmp_path, capsys, monkeypatch):
    file = tmp_path / "record.json"
    command = ["tune", "--scene", "swimmer", "--generations", "1", "--output", str(file)]
    command += ["--population", "8"]
    sizes = ["--frequencies", "3", "--wave-numbers", "2", "--set", "episode.duration=2"]
    played: list[int] = []

    def stop(scene, waves, *rest):
        if played:
            raise KeyboardInterrupt
        played.append(len(waves))
        return net_displacements(scene, waves, *rest)

    monkeypatch.setattr(tuning, "net_displacements", stop)
    assert call_main([*command, *sizes]) == INTERRUPTED
    assert played == [6] and not file.exists()
    log = tmp_path / "record.json.part"
    assert len(log.read_text().splitlines()) == 1 + 6
    with log.open("a") as file_of_log:
        file_of_log.write("[1.0, 5.0, -4")  # a line that a kill has cut short
    played.clear()
    monkeypatch.setattr(
        tuning,
        "net_displacements",
        lambda *given: played.append(len(given[1])) or net_displacements(*given),
    )
    assert call_main([*command, *sizes]) == 0
    assert played == [8], "the finalists are among them, as all episodes are as short"
    assert file.exists() and not log.exists()


def test_a_damaged_record_is_refused(tmp_path, monkeypatch):
    damaged = tmp_path / "tuned_wave.json"
    damaged.write_text('{"wave": {"amplitude": 1.0}}')
    monkeypatch.setattr(tuned_wave, "TUNED_WAVE_FILE", damaged)
    with pytest.raises(SwimError, match="cannot read the tuned wave"):
        load_policy("tuned_wave")


# ---- replay --env ------------------------------------------------------------------------------


def test_replaying_an_episode_gives_rewards_and_the_figures_of_a_replay():
    scene = load_scene("swimmer", SHORT)
    rollout, trajectory, summary = replay_episode(scene, "tuned_wave", seed=4)
    hold = scene.steps_per_action
    assert summary["steps"] == 50 * hold
    assert summary["actions"] == len(rollout.rewards) == 50
    assert summary["return"] == pytest.approx(-summary["displacement"][0], abs=1e-12)
    assert summary["net_displacement"] == pytest.approx(summary["return"], abs=1e-12)
    # Centres of elements are made from the minimal coordinates, with rounding of their own.
    assert np.abs(trajectory.path[::hold] - rollout.path).max() < 1e-14
    json.dumps(summary, allow_nan=False)


def test_the_command_plays_an_episode_the_same_in_every_process():
    brief = ("--scene", "swimmer", "--env", "--policy", "random", "--seed", "3", "--duration", "1")
    first, second = (run_script("replay", *brief, "--json").figures() for _ in range(2))
    for summary in (first, second):
        del summary["wall_seconds"]
    assert first == second
    assert first["policy"] == "random" and first["truncated"] and first["duration"] == 1.0


OTHERS = {
    "torque_limit": {"actuation.torque_limit": 5.0},
    "episode.control_interval": {"episode.control_interval": 0.04},
    "beam.elements": {"beam.elements": 8},
}


@pytest.mark.parametrize("field", OTHERS)
@pytest.mark.parametrize("name", ["tuned_wave", "paper_wave", "zero", "random"])
def test_a_policy_of_another_scene_is_refused_where_it_plays(name: str, field: str) -> None:
    duration = {"episode.duration": 0.08}
    policy = load_policy(name, load_scene("swimmer", duration))
    other = load_scene("swimmer", {**duration, **OTHERS[field]})
    if "wave" in name or field == "beam.elements":
        for play in (
            lambda: play_episode(SwimEnv(other), policy),
            lambda: play_episodes(SwimVectorEnv(2, other), policy, [0, 1]),
        ):
            with pytest.raises(OptionError, match=f"cannot play scene swimmer: {field} is"):
                play()
    if field != "beam.elements":
        rollout = play_episode(SwimEnv(other), policy, any_scene=True)
        assert len(rollout.torques) == round(0.08 / other.episode.control_interval)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"beam.bending_stiffness": 2.0}, "beam.bending_stiffness is 2.0, it was 5.0 in tuning;"),
        ({"beam.line_density": 1.0}, "beam.line_density is 1.0"),
        ({"fluid.density": 20.0}, "fluid.density is 20.0"),
        ({"fluid.model": "strip"}, "fluid.model is strip"),
        ({"fluid": None}, "fluid.model is None, it was panels in tuning (and 1 more)"),
        ({"damping.retardation_time": 0.1}, "damping is {'retardation_time': 0.1}"),
        ({"cross_flow_drag.coefficient": 1.0}, "cross_flow_drag is"),
        ({"stream.velocity": [0.1, 0.0]}, "stream is"),
    ],
)
def test_the_tuned_wave_is_refused_where_it_was_not_tuned_and_other_waves_play(changes, complaint):
    other = load_scene("swimmer", {"episode.duration": 0.04, **changes})
    tuned = baselines.tuned_wave(other)
    policies: list[Any] = [load_policy("paper_wave", other), WavePolicy(other, tuned.wave)]
    for play in (
        lambda: load_policy("tuned_wave", other),
        lambda: play_episode(SwimEnv(other), tuned),
        lambda: play_episode(SwimEnv(other), load_policy("tuned_wave")),
        lambda: play_episodes(SwimVectorEnv(1, other), tuned, [0]),
    ):
        with refuses(OptionError, "the wave was tuned on scene swimmer and cannot play", complaint):
            play()
    for policy in policies:
        play_episode(SwimEnv(other), policy)
    trusted = play_episode(SwimEnv(other), tuned, seed=0, any_scene=True)
    by_hand = play_episode(SwimEnv(other), policies[1], seed=0)
    assert trusted.torques.any() and (trusted.torques == by_hand.torques).all()


def test_the_tuned_wave_plays_its_body_with_another_step_panels_and_start():
    finer = {"integrator.time_step": 0.0025, "fluid.panels_per_element": 6}
    changes = {**finer, "episode.duration": 0.04, "initial.heading": 1.0, "name": "other"}
    scene = load_scene("swimmer", changes)
    assert play_episode(SwimEnv(scene), load_policy("tuned_wave", scene)).torques.any()


@pytest.mark.parametrize(
    ("other", "field"),
    [
        ({"beam.elements": 8}, "beam"),
        ({"beam.bending_stiffness": 0.02}, "beam"),
        ({"episode.control_interval": 0.04}, "episode.control_interval"),
    ],
)
def test_an_episode_is_not_played_again_by_another_body_or_clock(env, other, field):
    rollout = play_episode(env, load_policy("random", env.scene, 0), seed=0)
    changed = env.scene.replace(other)
    with refuses(OptionError, "cannot be played again in scene swimmer", f"{field} differs"):
        rollout.simulate(changed)
    foreign = Simulator(changed).rollout(np.zeros((rollout.steps, changed.beam.elements - 1)))
    shorter = Simulator(env.scene).rollout(rollout.torques[:3])
    for trajectory in (foreign, shorter):
        for use in (
            lambda: rollout.swimmer("x", trajectory),  # noqa: B023
            lambda: measure_performance(rollout, trajectory, verify_rollout(rollout)),  # noqa: B023
        ):
            with refuses(OptionError, "is not that of an episode"):
                use()


def test_batches_and_single_environments_are_not_taken_for_each_other(env):
    policy = load_policy("zero", env.scene)
    with refuses(OptionError, "play_episodes needs a SwimVectorEnv, got SwimEnv"):
        play_episodes(env, policy, [0])
    batch = SwimVectorEnv(2, env.scene)
    with refuses(OptionError, "play_episode needs a SwimEnv, got SwimVectorEnv"):
        play_episode(batch, policy)
    batch.reset(seed=0)
    for member in (-1, 2, 0.5, True):
        with refuses(OptionError, "member must be 0 to 1"):
            batch.snapshot().member(member)
    simulator = Simulator(env.scene)
    for snapshot in (batch.snapshot(), batch.snapshot().member(0), None):
        with refuses(SwimError, "restore needs what a simulator's snapshot returned"):
            simulator.restore(snapshot)
    with refuses(SwimError, "restore needs what snapshot returned, got Snapshot"):
        batch.restore(simulator.snapshot())
