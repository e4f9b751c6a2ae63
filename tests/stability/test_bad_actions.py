"""Bad actions in the middle of episodes: refused by name, and then it is as if they never were."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from swim_env import ActionError, SimulationEndedError, SwimEnv, SwimVectorEnv

Array = NDArray[np.float64]

FORWARD = "swim_env/KirchhoffSwimmer-v0"
TARGET = "swim_env/KirchhoffSwimmerTarget-v0"
each_task = pytest.mark.parametrize("task", [FORWARD, TARGET], ids=("forward", "target"))
recorded_or_not = pytest.mark.parametrize("recording", [False, True], ids=("plain", "recording"))

#: Random actions bend this body beyond what can be computed within a second or so.
LIVELY: dict[str, object] = {
    "beam.elements": 4,
    "beam.bending_stiffness": 1.0,
    "fluid.panels_per_element": 2,
    "damping.retardation_time": 0.005,
    "integrator.time_step": 0.01,
    "actuation.torque_limit": 2.0,
}
#: Joints of scene swimmer.
JOINTS = 8
LONG = np.finfo(np.longdouble)


def make(task: str, recording: bool = False, **arguments: Any) -> SwimEnv:
    """Make an environment without wrappers."""
    overrides = {"recording": True, "internal_forces": True} if recording else {}
    env = gymnasium.make(task, overrides=overrides, effort_weight=0.3, **arguments).unwrapped
    assert isinstance(env, SwimEnv)
    return env


def make_many(
    task: str, members: int, lively: bool = False, recording: bool = False, **arguments: Any
) -> SwimVectorEnv:
    overrides = dict(LIVELY) if lively else {}
    if recording:
        overrides["recording"] = True
    envs = gymnasium.make_vec(
        task, members, overrides=overrides, heading_weight=0.2, max_episode_steps=40, **arguments
    )
    assert isinstance(envs, SwimVectorEnv)
    return envs


def bits(value: Any) -> Any:
    """Return something nested with every array as its type, shape and bytes."""
    if isinstance(value, np.ndarray) and value.dtype == object:
        return ("objects", value.shape, [bits(item) for item in value.ravel()])
    if isinstance(value, (np.ndarray, np.generic)):
        return (value.dtype.str, value.shape, value.tobytes())
    if isinstance(value, dict):
        return {key: bits(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [bits(item) for item in value]
    return value.hex() if isinstance(value, float) else value


def everything(env: SwimEnv | SwimVectorEnv) -> dict[str, Any]:
    """Return all that there is of an environment: state, counters, random numbers, recording."""
    snapshot = env.snapshot()
    recorder = env.episodes.bodies.recorder
    return bits(
        {
            "arrays": snapshot.episodes.arrays,
            "random numbers": snapshot.episodes.randoms,
            "is reset": snapshot.is_reset,
            "someone ended": env.episodes.someone_ended,
            "recording": None if recorder is None else recorder.snapshot(),
        }
    )


def assert_same(left: Any, right: Any, where: str) -> None:
    assert bits(left) == bits(right), f"{where}: not what it is without the bad action"


def refused(env: SwimEnv | SwimVectorEnv, action: Any, kind: str, *parts: str) -> None:
    """Let an environment refuse an action: one line that says this much, and nothing else."""
    before, given = everything(env), copy.deepcopy(action) if kind != "generator" else None
    with pytest.raises(ActionError) as caught:
        env.step(action)
    message = str(caught.value)
    assert message.strip() and "\n" not in message, f"{kind}: {message!r}"
    for part in parts:
        assert part in message, f"{kind}: {part!r} is not in {message!r}"
    after = everything(env)
    for name, value in before.items():
        assert after[name] == value, f"{kind}: the refused action changed the {name}"
    if isinstance(action, np.ndarray) and action.dtype != object:
        assert bits(action) == bits(given), f"{kind}: the caller's array was written to"


def with_one(shape: tuple[int, ...], at: tuple[int, ...], value: float, dtype: Any = float) -> Any:
    """Return good actions with one bad number in them."""
    actions = np.linspace(-1.0, 1.0, int(np.prod(shape))).reshape(shape).astype(dtype)
    actions[at] = value
    return actions


def read_only(action: Any) -> Any:
    action.flags.writeable = False
    return action


#: What is no action, whatever the shape; made for a shape, with what the message says beside it.
NOT_NUMBERS: dict[str, Callable[[tuple[int, ...]], Any]] = {
    "none": lambda shape: None,
    "text": lambda shape: "0.5",
    "texts": lambda shape: np.full(shape, "0.5"),
    "bytes": lambda shape: np.full(shape, b"0.5"),
    "bools": lambda shape: np.ones(shape, dtype=np.bool_),
    "complex": lambda shape: np.ones(shape, dtype=np.complex128),
    "objects": lambda shape: np.full(shape, 0.5, dtype=object),
    "an object among numbers": lambda shape: with_one(shape, (0,) * len(shape), None, object),
    "dates": lambda shape: np.zeros(shape, dtype="datetime64[s]"),
    "spans of time": lambda shape: np.zeros(shape, dtype="timedelta64[s]"),
    "records": lambda shape: np.zeros(shape, dtype=[("torque", float)]),
    "whole numbers beyond all types": lambda shape: np.full(shape, 10**30, dtype=object).tolist(),
    "mapping": lambda shape: {"torque": 0.0},
    "set": lambda shape: {0.0, 1.0},
    "generator": lambda shape: (0.0 for _ in range(JOINTS)),
    "function": lambda shape: len,
    "ragged": lambda shape: [[0.0], [0.0, 1.0]],
    "ragged at the end": lambda shape: [0.0] * (shape[0] - 1) + [[0.0, 0.0]],
}


def wrong_shapes(shape: tuple[int, ...]) -> list[tuple[int, ...]]:
    longer = (*shape[:-1], shape[-1] + 1)
    return [(), (0,), (1,), longer, (*shape[:-1], shape[-1] - 1), (1, *shape), (*shape, 1)]


def refuse_all(env: SwimEnv | SwimVectorEnv, shape: tuple[int, ...], what: str) -> int:
    """Let an environment refuse everything that is no array of numbers of the right shape."""
    for kind, made in NOT_NUMBERS.items():
        refused(env, made(shape), kind, f"{what} must be numbers of shape {shape}")
    for other in wrong_shapes(shape):
        part = f"{what} must have shape {shape}, got {other}"
        refused(env, np.zeros(other), f"shape {other}", part)
    return len(NOT_NUMBERS) + len(wrong_shapes(shape))


@each_task
@recorded_or_not
def test_an_episode_full_of_refused_actions_is_the_one_without_them(
    task: str, recording: bool
) -> None:
    """Between any two actions of an episode come all kinds of bad ones, and nobody can tell."""
    env, twin = make(task, recording), make(task, recording)
    rng = np.random.default_rng(1)
    assert_same(env.reset(seed=3), twin.reset(seed=3), "reset")
    for step in range(12):
        joint, value = int(rng.integers(JOINTS)), float(rng.choice([np.nan, np.inf, -np.inf]))
        bad = with_one((JOINTS,), (joint,), value, rng.choice([np.float16, np.float32, float]))
        part = f"an action must be finite, got {value} at joint {joint}"
        refused(env, bad, "not finite", part)
        refused(env, bad.tolist(), "not finite, a list", part)
        if step in (4, 9):
            assert refuse_all(env, (JOINTS,), "an action") > 20
        action = rng.uniform(-1.0, 1.0, JOINTS)
        assert_same(env.step(action), twin.step(action), f"step {step}")
    assert everything(env) == everything(twin), "the states differ at the end"
    assert env.coordinates.tobytes() == twin.coordinates.tobytes()
    if recording:
        one, other = env.recorded(), twin.recorded()
        assert one.steps == other.steps == env.steps == 48, "refused actions were recorded"
        for name in ("time", "centres", "torques", "energy", "momentum", "internal_forces"):
            assert_same(getattr(one, name), getattr(other, name), f"recorded {name}")
    assert_same(env.reset(), twin.reset(), "the next episode")


@each_task
def test_every_joint_and_value_is_named(task: str) -> None:
    """The first bad number of an action is named by its joint, whatever its type."""
    env = make(task)
    env.reset(seed=0)
    env.step(np.linspace(-1.0, 1.0, JOINTS))
    for joint in range(JOINTS):
        for value in (np.nan, np.inf, -np.inf):
            for dtype in (np.float16, np.float32, np.float64, np.longdouble):
                bad = with_one((JOINTS,), (joint,), value, dtype)
                bad[joint + 1 :] = np.nan  # the ones behind it do not matter
                where = f"got {value} at joint {joint}"
                refused(env, read_only(bad), f"{value} of {dtype.__name__}", where)


@each_task
def test_what_overflows_is_refused_and_what_is_huge_counts_as_one(task: str) -> None:
    """Numbers of any size are clipped, those that their type made infinite are refused."""
    env, twin = make(task), make(task)
    for each in (env, twin):
        each.reset(seed=5)
    sign = np.where(np.arange(JOINTS) % 3 == 0, -1.0, 1.0)
    with np.errstate(over="ignore"):
        half = (1e6 * sign).astype(np.float16)
    refused(env, half, "overflow of half precision", "finite, got -inf at joint 0")
    if LONG.maxexp > 1024:
        huge = np.full(JOINTS, np.longdouble("1e4000"))
        refused(env, huge, "beyond double precision", "finite, got inf at joint 0")
    largest: list[Any] = [
        sign * np.finfo(np.float64).max,
        (sign * np.finfo(np.float32).max).astype(np.float32),
        (sign * 65504.0).astype(np.float16),
        sign.astype(np.longdouble) * np.longdouble(1e300),
        (sign * 1e300).astype(">f8"),
        np.where(sign < 0.0, np.iinfo(np.int64).min, np.iinfo(np.int64).max),
        np.where(sign < 0.0, -128, 127).astype(np.int8),
        (1.0000000001 * sign).tolist(),
        (1e30 * sign).tolist(),
    ]
    for action in largest:
        kept = bits(np.asarray(action))
        assert_same(env.step(action), twin.step(sign), f"{np.asarray(action).dtype}")
        assert bits(np.asarray(action)) == kept, "the caller's array was clipped in place"
    ones = np.ones(JOINTS)
    most = np.full(JOINTS, np.iinfo(np.uint64).max, dtype=np.uint64)
    assert_same(env.step(most), twin.step(ones), "uint64")


def test_long_double_actions_count_as_double_ones() -> None:
    """What is finer than double precision is rounded to it, and what is smaller is nothing."""
    env, twin = make(FORWARD), make(FORWARD)
    for each in (env, twin):
        each.reset(seed=5)
    fine = np.linspace(-1.0, 1.0, JOINTS).astype(np.longdouble) / 3
    assert_same(env.step(fine), twin.step(fine.astype(np.float64)), "thirds")
    tiny = np.full(JOINTS, LONG.tiny) * np.linspace(-1.0, 1.0, JOINTS)
    assert_same(env.step(tiny), twin.step(tiny.astype(np.float64)), "tiny numbers")


@each_task
def test_what_the_caller_does_with_its_array_afterwards_does_not_matter(task: str) -> None:
    """Torques and recording are the environment's own, and a mended array is as good as any."""
    env, twin = make(task, recording=True), make(task, recording=True)
    good = np.random.default_rng(2).uniform(-1.0, 1.0, (8, JOINTS))
    for each in (env, twin):
        each.reset(seed=1)
    action = np.empty(JOINTS)
    for step, row in enumerate(good):
        action[:] = row
        action[step] = np.nan
        refused(env, action, "not finite", f"at joint {step}")
        action[step] = row[step]
        assert_same(env.step(action), twin.step(row.copy()), f"step {step}")
        action[:] = np.inf
        assert_same(env.torques, twin.torques, f"torques after step {step}")
    assert_same(env.recorded().torques, twin.recorded().torques, "recorded torques")
    assert np.isfinite(env.recorded().torques).all()


@each_task
def test_refused_actions_do_not_count_for_the_wrappers(task: str) -> None:
    """An episode cut to six actions has six good ones, and its statistics are theirs."""
    results = []
    for bad in (False, True):
        made = gymnasium.make(task, max_episode_steps=6)
        env = gymnasium.wrappers.RecordEpisodeStatistics(made)
        env.reset(seed=0)
        ends, total, last = [], 0.0, {}
        for step in range(6):
            if bad and step:
                for action in (np.full(JOINTS, np.nan), np.zeros(3), None):
                    with pytest.raises(ActionError):
                        env.step(action)
            _, reward, terminated, truncated, last = env.step(np.full(JOINTS, 0.1 * step))
            ends.append((terminated, truncated))
            total += float(reward)
        assert ends == [(False, False)] * 5 + [(False, True)], f"with bad actions: {bad}"
        results.append((total, float(last["episode"]["r"]), int(last["episode"]["l"])))
    assert results[0] == results[1]


@each_task
def test_without_an_episode_bad_actions_are_not_looked_at(task: str) -> None:
    """Before the first reset and after an end the error is about that, and nothing changes."""
    env = gymnasium.make(task, overrides=LIVELY).unwrapped
    assert isinstance(env, SwimEnv)
    for action in (np.full(3, np.nan), None, np.zeros(9)):
        with pytest.raises(gymnasium.error.ResetNeeded):
            env.step(action)
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(1000):
        if env.step(rng.uniform(-1.0, 1.0, 3).round())[2]:
            break
    before = everything(env)
    for action in (np.full(3, np.nan), None, np.zeros(9), np.zeros(3)):
        with pytest.raises(SimulationEndedError, match="call reset"):
            env.step(action)
        assert everything(env) == before, "a step after the end changed something"


# ---- batches -----------------------------------------------------------------------------------


@each_task
@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("mode", list(AutoresetMode), ids=lambda mode: mode.name)
def test_one_bad_member_among_many_changes_nothing_of_anybody(
    task: str, threads: int, mode: AutoresetMode
) -> None:
    """Members end and start anew at all times; in between come bad actions of one, or of some."""
    members, joints = 7, 3
    arguments: dict[str, Any] = {"lively": True, "num_threads": threads, "autoreset_mode": mode}
    envs, twin = (make_many(task, members, **arguments) for _ in range(2))
    shape = (members, joints)
    rng = np.random.default_rng(threads)
    assert_same(envs.reset(seed=11), twin.reset(seed=11), "reset")
    ended = np.zeros(members, dtype=np.bool_)
    ignored = waited = 0
    for step in range(90):
        good = rng.uniform(-1.0, 1.0, shape).round()
        value = float(rng.choice([np.nan, np.inf, -np.inf]))
        if mode is AutoresetMode.DISABLED and ended.any():
            before = everything(envs)
            for bad in (np.full(shape, value), None, good):
                with pytest.raises(gymnasium.error.ResetNeeded, match="have ended"):
                    envs.step(bad)
                assert everything(envs) == before, "a refused step started members"
            options = {"reset_mask": ended}
            one, other = envs.reset(options=options), twin.reset(options=options)
            assert_same(one, other, f"reset {step}")
        waiting = mode is AutoresetMode.NEXT_STEP and ended.any()
        playing = np.flatnonzero(~ended) if waiting else np.arange(members)
        waited += waiting
        if len(playing):
            some = np.sort(rng.choice(playing, rng.integers(1, len(playing) + 1), replace=False))
            joint = int(rng.integers(joints))
            bad = good.copy()
            bad[some, joint] = value
            if waiting:
                bad[ended] = np.nan
            where = f"actions must be finite, got {value} at joint {joint} of member {some[0]}"
            refused(envs, bad, f"{value}, step {step}", where)
        if step % 30 == 17 or (waiting and waited == 1):
            assert refuse_all(envs, shape, "actions") > 20
        given = good.copy()
        if waiting:
            # Nobody looks at the actions of those that start anew.
            given[ended] = value
            ignored += int(ended.sum())
        one, other = envs.step(given), twin.step(good)
        assert_same(one, other, f"step {step}")
        ended = one[2] | one[3]
    assert everything(envs) == everything(twin)
    assert mode is not AutoresetMode.NEXT_STEP or ignored > members, "nobody has ever waited"


@pytest.mark.parametrize("threads", [1, 4])
def test_a_bad_member_is_found_among_many(threads: int) -> None:
    """Every member in turn is the bad one of 24; bodies move only by the good actions."""
    members = 24
    envs, twin = (make_many(FORWARD, members, num_threads=threads) for _ in range(2))
    rng = np.random.default_rng(0)
    for each in (envs, twin):
        each.reset(seed=2)
    for member in range(members):
        joint = int(rng.integers(JOINTS))
        bad = rng.uniform(-1.0, 1.0, (members, JOINTS)).astype(np.float32)
        bad[member, joint] = np.nan
        part = f"got nan at joint {joint} of member {member}"
        refused(envs, bad, f"member {member}", part)
        rows = list(bad)
        refused(envs, rows, f"member {member}, a list of arrays", part)
        rows[member] = bad[member, :-1]
        refused(envs, rows, "a short member", f"numbers of shape ({members}, {JOINTS})")
        rows[member] = None
        refused(envs, rows, "a member without", f"numbers of shape ({members}, {JOINTS})")
        if member % 6 == 0:
            good = rng.uniform(-1.0, 1.0, (members, JOINTS))
            assert_same(envs.step(good), twin.step(good), f"after member {member}")


@each_task
def test_a_batch_records_nothing_of_refused_actions(task: str) -> None:
    """Every member's recording has the steps that it took, those with others' bad ones not."""
    members, joints = 4, 3
    arguments: dict[str, Any] = {"lively": True, "recording": True, "autoreset_mode": "NextStep"}
    envs, twin = (make_many(task, members, num_threads=2, **arguments) for _ in range(2))
    rng = np.random.default_rng(4)
    for each in (envs, twin):
        each.reset(seed=8)
    ended = np.zeros(members, dtype=np.bool_)
    lengths = set()
    for step in range(60):
        good = rng.uniform(-1.0, 1.0, (members, joints)).round()
        if not ended.all():
            bad = good.copy()
            bad[np.flatnonzero(~ended)[-1]] = np.inf
            refused(envs, bad, f"step {step}", "finite, got inf at joint 0 of member")
        given = good.copy()
        one, other = envs.step(given), twin.step(good)
        given[:] = np.nan
        assert_same(one, other, f"step {step}")
        ended = one[2] | one[3]
        if step % 10 == 9:
            for member in range(members):
                left, right = envs.recorded(member), twin.recorded(member)
                for name in ("time", "centres", "torques", "energy", "momentum"):
                    where = f"{name} of member {member} after step {step}"
                    assert_same(getattr(left, name), getattr(right, name), where)
                assert np.isfinite(left.torques).all()
                lengths.add(left.steps)
    assert len(lengths) > 3, f"all members did the same: {lengths}"


@each_task
def test_a_batch_does_not_keep_the_callers_array(task: str) -> None:
    """One buffer for all steps, spoilt in between, gives what fresh arrays give."""
    envs, twin = (make_many(task, 3, num_threads=2) for _ in range(2))
    good = np.random.default_rng(6).uniform(-2.0, 2.0, (10, 3, JOINTS))
    for each in (envs, twin):
        each.reset(seed=1)
    for order in ("C", "F"):
        buffer = np.empty((3, JOINTS), order=order)  # type: ignore[call-overload]
        for step, rows in enumerate(good):
            buffer[:] = rows
            buffer[1, step % JOINTS] = -np.inf
            refused(envs, buffer, "not finite", f"got -inf at joint {step % JOINTS} of member 1")
            buffer[1, step % JOINTS] = rows[1, step % JOINTS]
            assert_same(envs.step(buffer), twin.step(rows.copy()), f"step {step}, {order}")
            assert bits(buffer.copy("C")) == bits(rows), "the caller's array was written to"
            buffer[:] = np.nan
            assert_same(envs.episodes.torques, twin.episodes.torques, f"torques, step {step}")


def test_a_batch_takes_over_what_a_refused_action_left() -> None:
    """A snapshot taken after a refusal is one taken before it, for members alone as well."""
    envs = make_many(FORWARD, 3)
    envs.reset(seed=4)
    rng = np.random.default_rng(0)
    for actions in rng.uniform(-1.0, 1.0, (5, 3, JOINTS)):
        envs.step(actions)
    refused(envs, with_one((3, JOINTS), (2, 7), np.nan), "not finite", "joint 7 of member 2")
    snapshot = envs.snapshot()
    actions = rng.uniform(-1.0, 1.0, (4, 3, JOINTS))
    played = [envs.step(one) for one in actions]
    envs.restore(snapshot)
    refused(envs, np.zeros((3, 7)), "shape", "got (3, 7)")
    assert_same([envs.step(one) for one in actions], played, "from the snapshot on")
