"""Effects seen from outside: recordings, self-contact, streams, internal forces.

What a scene may say of them is in test_scene.py.
"""

import copy
from typing import Any

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from swim_env import (
    TERMINATION_REASONS,
    OptionError,
    Scene,
    SimulationEndedError,
    Simulator,
    SwimEnv,
    SwimError,
    SwimTargetEnv,
    SwimVectorEnv,
    Trajectory,
    load_scene,
)
from tests.support import SMALL, assert_same, rollout, uniform

Array = NDArray[np.float64]

RECORDED = load_scene("swimmer", {"recording": {}})
BASES: dict[str, dict[str, object]] = {
    "plain": {},
    "forces": {"internal_forces": {}, "cross_flow_drag": {}},
    "paper": {"integrator.scheme": "paper"},
    "no fluid": {"fluid": None},
}


def recorded(name: str) -> Scene:
    return RECORDED.replace(BASES[name]) if BASES[name] else RECORDED


# ---- recordings of a simulator -----------------------------------------------------------------


@pytest.mark.parametrize("name", BASES)
def test_what_is_recorded_is_the_rollout(name):
    """Recording changes nothing, nor does watching it, nor stepping in pieces."""
    scene = recorded(name)
    torques = uniform(250, 8, seed=1)
    simulator = Simulator(scene)
    whole = simulator.rollout(torques)
    assert_same(simulator.recorded(), whole)
    assert_same(rollout(scene.replace("recording", None), torques), whole, leave_out=("scene",))
    simulator.reset()
    simulator.rollout(torques[:100], progress=lambda steps: simulator.recorded())
    simulator.rollout(torques[100:240])
    for count, row in enumerate(torques[240:], start=241):
        simulator.step(row)
        assert simulator.recorded().steps == count
    assert_same(simulator.recorded(), whole)


def test_a_long_recording_is_the_steps_in_their_order():
    """Of several thousand steps, taken in pieces of any size: tables have grown more than once."""
    scene = load_scene("swimmer", {**SMALL, "fluid.model": "frozen", "recording": {}})
    torques = uniform(2500, 2, size=0.3)
    whole, pieces = Simulator(scene).rollout(torques), Simulator(scene)
    while pieces.steps < 2500:
        count = 1 + (37 * pieces.steps) % 89
        pieces.rollout(torques[pieces.steps : pieces.steps + count])
    assert_same(pieces.recorded(), whole)


def test_a_recording_begins_with_a_reset():
    scene = RECORDED.replace("internal_forces", {})
    simulator = Simulator(scene)
    simulator.rollout(uniform(10, 8))
    simulator.reset(RECORDED.replace("initial.position", (1.0, 2.0)).initial)
    empty = simulator.recorded()
    assert empty.steps == 0 and empty.time.tolist() == [0.0]
    assert np.array_equal(empty.centres[0], simulator.centres)
    assert empty.summary()["mean_speed"] == 0.0
    assert empty.internal_forces is not None and empty.internal_forces.shape == (0, 8, 2)
    assert empty.torques.shape == (0, 8) and empty.impulse.shape == (0, 3)
    assert empty.momentum.shape == (1, 3)
    assert_same(simulator.rollout(uniform(5, 8)), simulator.recorded())
    # A start that is refused leaves the recording as it was.
    with pytest.raises(SimulationEndedError):
        simulator.reset_to([0.0] * 3 + [2.9] * 8, np.zeros(11))
    assert simulator.recorded().steps == 5
    simulator.step(np.zeros(8))
    assert simulator.recorded().steps == 6


def test_after_a_restore_the_recording_begins_there():
    torques = uniform(20, 8)
    simulator = Simulator(RECORDED)
    simulator.rollout(torques[:10])
    kept = simulator.snapshot()
    first = simulator.rollout(torques[10:])
    simulator.restore(kept)
    assert simulator.recorded().steps == 0
    assert simulator.recorded().time[0] == 10 * simulator.time_step == simulator.time
    simulator.rollout(torques[10:])
    assert_same(simulator.recorded(), first)


def test_a_recording_tells_why_a_run_ended():
    simulator = Simulator(RECORDED)
    whole = simulator.rollout(np.full((500, 8), 40.0))
    assert 0 < whole.steps < 500 and whole.termination_reason
    assert_same(simulator.recorded(), whole)
    with pytest.raises(SimulationEndedError):
        simulator.step(np.zeros(8))
    assert simulator.recorded().steps == whole.steps


def test_a_copy_records_for_itself():
    first = Simulator(RECORDED)
    first.rollout(uniform(5, 8))
    second = copy.deepcopy(first)
    second.rollout(uniform(7, 8))
    assert (first.recorded().steps, second.recorded().steps) == (5, 12)


@pytest.mark.parametrize("make", [Simulator, SwimEnv, lambda scene: SwimVectorEnv(2, scene)])
def test_without_the_effect_nothing_is_recorded(make):
    one = make(load_scene("swimmer"))
    with pytest.raises(OptionError, match=r"^nothing was recorded: .* the block recording \(.*\)$"):
        one.recorded(0) if isinstance(one, SwimVectorEnv) else one.recorded()


# ---- recordings of environments ----------------------------------------------------------------

Env = SwimEnv | SwimVectorEnv
MAKERS: dict[str, Any] = {
    "single": SwimEnv,
    "target": SwimTargetEnv,
    "one thread": lambda scene: SwimVectorEnv(3, scene, num_threads=1),
    "two threads": lambda scene: SwimVectorEnv(3, scene, num_threads=2),
}


def pair(scene: Scene, **arguments: Any) -> SwimVectorEnv:
    return SwimVectorEnv(2, scene, num_threads=1, **arguments)


def recordings(env: Env) -> list[Trajectory]:
    """Return every member's recording; a single environment has one member."""
    if isinstance(env, SwimEnv):
        return [env.recorded()]
    return [env.recorded(member) for member in range(env.num_envs)]


def assert_recorded(env: Env, start: dict[int, tuple[Array, Array]], actions: Array) -> None:
    """Check members' recordings against a simulator that plays the actions from their starts."""
    scene = env.episodes.task.scene
    assert scene.actuation is not None
    rows = scene.actuation.torque_limit * actions.reshape(len(actions), -1, 8)
    for member, state in start.items():
        simulator = Simulator(scene)
        simulator.reset_to(*state)
        again = simulator.rollout(np.repeat(rows[:, member], scene.steps_per_action, axis=0))
        assert_same(recordings(env)[member], again, f"member {member}")


def starts(env: Env) -> dict[int, tuple[Array, Array]]:
    """Return the present coordinates and velocities of all members."""
    bodies = env.episodes.bodies
    return {
        member: (bodies.coordinates[member].copy(), bodies.velocities[member].copy())
        for member in range(len(bodies.coordinates))
    }


@pytest.mark.parametrize("maker", MAKERS)
@pytest.mark.parametrize("name", BASES)
def test_every_step_of_every_members_episode_is_recorded(name, maker):
    env = MAKERS[maker](recorded(name))
    for seed in (1, 2):
        env.reset(seed=seed)
        assert all(one.steps == 0 for one in recordings(env))
        start = starts(env)
        actions = uniform(6, *env.action_space.shape, seed=seed)
        for action in actions:
            env.step(action)
        assert_recorded(env, start, actions)


@pytest.mark.parametrize("maker", MAKERS)
def test_an_environments_recording_begins_at_a_restored_snapshot(maker):
    env = MAKERS[maker](RECORDED)
    env.reset(seed=3)
    first, second = uniform(2, *env.action_space.shape)
    env.step(first)
    kept = env.snapshot()
    env.step(second)
    whole = recordings(env)
    env.restore(kept)
    hold = RECORDED.steps_per_action
    for one, other in zip(recordings(env), whole, strict=True):
        assert one.steps == 0 and one.time[0] == other.time[hold]
    env.step(second)
    for one, other in zip(recordings(env), whole, strict=True):
        assert np.array_equal(one.centres, other.centres[hold:])
        assert np.array_equal(one.energy, other.energy[hold:])


def test_members_that_are_reset_begin_anew_alone():
    env = pair(RECORDED, autoreset_mode="Disabled")
    env.reset(seed=5)
    actions = uniform(2, 2, 8)
    env.step(actions[0])
    env.reset(options={"reset_mask": np.array([False, True])})
    assert [one.steps for one in recordings(env)] == [RECORDED.steps_per_action, 0]
    start = {1: starts(env)[1]}
    env.step(actions[1])
    assert_recorded(env, start, actions[1:])
    assert env.recorded(0).steps == 2 * RECORDED.steps_per_action


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_the_next_recording_begins_with_the_next_episode(mode):
    env = pair(RECORDED, max_episode_steps=3, autoreset_mode=mode)
    env.reset(seed=6)
    actions = uniform(5, 2, 8)
    start = starts(env)
    for row in actions[:2]:
        env.step(row)
    assert_recorded(env, start, actions[:2])
    *_, truncated, _ = env.step(actions[2])
    assert truncated.all()
    if mode == "NextStep":  # until then, the last one is there
        assert_recorded(env, start, actions[:3])
        env.step(actions[3])
    assert [one.steps for one in recordings(env)] == [0, 0]
    start = starts(env)
    env.step(actions[4])
    assert_recorded(env, start, actions[4:])


def test_members_and_recordings_that_are_not_there_are_refused():
    env = pair(RECORDED)
    with pytest.raises((SwimError, ResetNeeded)):
        env.recorded(1)
    env.reset(seed=1)
    for member in (-1, 2, 100):
        with pytest.raises(OptionError, match=f"member must be 0 to 1, got {member}"):
            env.recorded(member)


def test_a_reset_that_fails_leaves_the_recordings():
    # So fast across itself that its energy overflows, unless noise has turned a member along.
    env, twin = pair(RECORDED), pair(RECORDED)
    actions = uniform(2, 2, 8)
    failed = 0
    for seed in range(20):
        for each in (env, twin):
            each.reset(seed=1)
            each.step(actions[0])
        try:
            with np.errstate(all="ignore"):
                env.reset(seed=seed, options={"velocity": (0.0, 1.1e154), "noise": 30.0})
        except SimulationEndedError:
            failed += 1
            for each in (env, twin):
                each.step(actions[1])
            assert_same(recordings(env), recordings(twin), f"seed {seed}")
    assert failed


# ---- self-contact ------------------------------------------------------------------------------

#: Without panels, whose gap may be under-resolved before it closes.
CURL = load_scene(
    "swimmer",
    {
        "fluid.model": "strip",
        "beam.bending_stiffness": 0.5,
        "damping.retardation_time": 0.02,
        "actuation.torque_limit": 8.0,
        "self_contact": {},
        "recording": {},
    },
)


def test_an_episode_ends_where_the_body_touches_itself():
    assert "touches itself" in TERMINATION_REASONS["self_contact"]
    env = SwimEnv(CURL)
    env.reset(seed=1, options={"noise": 0.0})
    start = starts(env)
    terminated, count = False, 0
    while not terminated and count < 50:
        _, _, terminated, truncated, info = env.step(np.ones(8))
        count += 1
        assert info["termination_reason"] == ("self_contact" if terminated else "")
    assert terminated and not truncated
    # It may end in the middle of an action: only the steps that were taken count.
    run = env.recorded()
    assert run.termination_reason == "self_contact"
    hold = CURL.steps_per_action
    assert hold * (count - 1) <= run.steps < hold * count
    assert_recorded(env, start, np.ones((count, 8)))
    assert run.time[-1] == pytest.approx(info["time"], abs=1e-15)
    assert np.allclose(run.path[-1], info["position"], atol=1e-15)
    with pytest.raises(SimulationEndedError, match="self_contact"):
        env.step(np.ones(8))
    env.reset(seed=1)
    assert env.recorded().termination_reason == ""


def test_a_member_ends_where_it_touches_itself():
    env = SwimVectorEnv(2, CURL, autoreset_mode="Disabled", num_threads=2)
    env.reset(seed=1, options={"noise": 0.0})
    terminated, count = np.zeros(2, dtype=bool), 0
    while not terminated.any() and count < 50:
        _, _, terminated, _, info = env.step(np.stack([np.ones(8), np.zeros(8)]))
        count += 1
    assert terminated.tolist() == [True, False]
    assert info["termination_reason"].tolist() == ["self_contact", ""]
    assert [one.termination_reason for one in recordings(env)] == ["self_contact", ""]
    assert env.recorded(0).steps < env.recorded(1).steps == CURL.steps_per_action * count


# ---- streams -----------------------------------------------------------------------------------

STREAM = np.array([0.25, -0.5])


@pytest.fixture
def beside() -> tuple[SwimEnv, SwimEnv]:
    """A swimmer at rest in still water, and one at rest in a stream."""
    changes = {"cross_flow_drag": {}, "stream.velocity": tuple(STREAM)}
    drifting = load_scene("swimmer", {**changes, "initial.velocity": tuple(STREAM)})
    return SwimEnv(drifting.replace({"stream": None, "initial": {}})), SwimEnv(drifting)


def test_what_is_observed_is_the_velocity_over_ground(beside):
    resting, drifting = beside
    seen, info = resting.reset(seed=1, options={"noise": 0.0})
    carried, _ = drifting.reset(seed=1, options={"noise": 0.0})
    # The head looks along -x: what drifts along +x, -y goes backwards, and to its left.
    wanted = np.zeros(21)
    wanted[18:20] = -2.5, 5.0
    assert np.allclose(carried - seen, wanted, atol=1e-6)
    for action in uniform(5, 8):
        seen, *_, info = resting.step(action)
        carried, *_, there = drifting.step(action)
        assert np.array_equal(drifting.coordinates[2:], resting.coordinates[2:])
        shift = there["position"] - info["position"] - there["time"] * STREAM
        assert np.abs(shift).max() < 1e-14
        gap = drifting.velocity - resting.velocity
        assert np.allclose(gap, np.concatenate([STREAM, np.zeros(9)]), atol=1e-14)
        ahead = -np.array([np.cos(a := resting.coordinates[2:].cumsum().mean()), np.sin(a)])
        wanted[18:20] = STREAM @ ahead, STREAM @ [-ahead[1], ahead[0]]
        wanted[18:20] /= 0.1
        assert np.allclose(carried - seen, wanted, atol=1e-5)
        # Progress is made over ground as well, towards -x.
        gain = there["progress"] - info["progress"]
        assert gain == pytest.approx(-STREAM[0] * there["time"], abs=1e-12)


def test_noise_of_a_start_in_a_stream_is_that_at_rest(beside):
    resting, drifting = beside
    resting.reset(seed=1)
    drifting.reset(seed=1)
    gap = drifting.velocity[:2] - resting.velocity[:2] - STREAM
    assert np.abs(gap).max() < 1e-12, f"relative to the stream it starts {gap} m/s faster"


# ---- internal forces ---------------------------------------------------------------------------


def test_internal_forces_are_there_where_asked_for_and_change_nothing():
    plain, torques = load_scene("swimmer"), uniform(10, 8)
    without = rollout(plain, torques)
    found = rollout(plain.replace("internal_forces", {}), torques)
    assert without.internal_forces is None
    assert found.internal_forces is not None and found.internal_forces.shape == (10, 8, 2)
    assert_same(found, without, leave_out=("scene", "internal_forces"))
    assert found.summary() == without.summary()
    none = rollout(plain.replace("internal_forces", {}), np.zeros((0, 8)))
    assert none.internal_forces is not None and none.internal_forces.shape == (0, 8, 2)
