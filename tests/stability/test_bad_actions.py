"""Bad actions are refused, and what follows is as if they had never happened.

Single and batched environments, stable-baselines3's and the simulator's torques, side by side.
"""

import copy
from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from swim_env import ActionError, SimulationEndedError, Simulator, TorqueError
from tests.support import (
    FORWARD,
    LIVELY,
    TARGET,
    assert_same,
    each_mode,
    each_task,
    make,
    make_batch,
    refuses,
    state_of,
)

#: Joints of scene swimmer, and members of batches.
JOINTS, MEMBERS = 8, 3
LONG = np.finfo(np.longdouble)


class Player(NamedTuple):
    """Something that plays actions, just reset."""

    step: Callable[[Any], Any]
    state: Callable[[], Any]
    shape: tuple[int, ...]
    error: type[Exception] = ActionError


def single(task: str = FORWARD) -> Player:
    overrides = {"recording": True, "internal_forces": True}
    env = make(task, overrides=overrides, effort_weight=0.3)
    env.reset(seed=3)
    return Player(env.step, lambda: state_of(env), (JOINTS,))


def batch(task: str) -> Player:
    envs = make_batch(task, MEMBERS, overrides={"recording": True}, num_threads=2)
    envs.reset(seed=3)
    return Player(envs.step, lambda: state_of(envs), (MEMBERS, JOINTS))


def simulator() -> Player:
    body = Simulator("swimmer")
    return Player(body.step, body.snapshot, (JOINTS,), TorqueError)


def vec_env() -> Player:
    pytest.importorskip("stable_baselines3")
    from swim_agents.vec_env import make_swim_vec_env

    venv = make_swim_vec_env(FORWARD, MEMBERS, seed=3)
    venv.reset()
    return Player(venv.step, lambda: state_of(venv.env), (MEMBERS, JOINTS))


PLAYERS: dict[str, Callable[[], Player]] = {
    "single": single,
    "single, target": lambda: single(TARGET),
    "batch": lambda: batch(FORWARD),
    "batch, target": lambda: batch(TARGET),
    "simulator": simulator,
    "vec_env": vec_env,
}


def refused(player: Player, action: Any, *parts: str) -> None:
    """Let a player refuse an action: one line that says this much, and nothing else happens."""
    before = player.state()
    given = action.copy() if isinstance(action, np.ndarray) else None
    with refuses(player.error, *parts) as caught:
        player.step(action)
    assert isinstance(caught.value, ValueError)
    assert_same(player.state(), before, f"after a refusal ({caught.value})")
    if given is not None and given.dtype != object:
        assert action.tobytes() == given.tobytes(), "the caller's array was written to"


def with_one(shape: tuple[int, ...], at: tuple[int, ...], value: float, dtype: Any = float) -> Any:
    """Return good actions with one bad number in them, and others after it, in read-only memory."""
    actions = np.linspace(-1.0, 1.0, int(np.prod(shape))).reshape(shape).astype(dtype)
    actions[at] = value
    if dtype is not object:
        actions[(*at[:-1], slice(at[-1] + 1, None))] = np.nan
    actions.flags.writeable = False
    return actions


#: What is no action, whatever the shape.
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
    "ragged at the end": lambda shape: [*np.zeros(shape).tolist()[:-1], [0.0, 0.0]],
    "a part missing": lambda shape: [*np.zeros(shape)[:-1], None],
}


@pytest.mark.parametrize("kind", PLAYERS)
def test_an_episode_full_of_refused_actions_is_the_one_without_them(kind):
    """Between any two actions come all kinds of bad ones, in the caller's one buffer at last."""
    player, twin = PLAYERS[kind](), PLAYERS[kind]()
    shape = player.shape
    rng = np.random.default_rng(1)
    buffer = np.empty(shape, order="F")
    for step in range(12):
        at = tuple(int(rng.integers(size)) for size in shape[:-1]) + (step % JOINTS,)
        place = f"joint {at[-1]}" + (f" of member {at[0]}" if len(at) > 1 else "")
        for value in (np.nan, np.inf, -np.inf):
            for dtype in (np.float16, np.float32, np.float64, np.longdouble):
                bad = with_one(shape, at, value, dtype)
                refused(player, bad, f"must be finite, got {value} at {place}")
            refused(player, bad.tolist(), f"must be finite, got {value} at {place}")
        if step in (4, 9):
            for name, made in NOT_NUMBERS.items():
                # None is for stable-baselines3 what `step_async` was not called with.
                if (kind, name) != ("vec_env", "none"):
                    refused(player, made(shape), f"must be numbers of shape {shape}")
            longer, shorter = (*shape[:-1], JOINTS + 1), (*shape[:-1], JOINTS - 1)
            for wrong in ((), (0,), longer, shorter, (1, *shape), (*shape, 1), shape[::-1] + (2,)):
                refused(player, np.zeros(wrong), f"must have shape {shape}, got {wrong}")
        good = rng.uniform(-1.0, 1.0, shape)
        buffer[:] = good
        buffer[at] = np.inf
        refused(player, buffer, f"got inf at {place}")
        buffer[at] = good[at]
        assert_same(player.step(buffer), twin.step(good.copy()), f"step {step}")
        buffer[:] = np.nan
        # With the recording, where there is one.
        assert_same(player.state(), twin.state(), f"state after step {step}")


@each_task
def test_what_overflows_is_refused_and_what_is_huge_counts_as_one(task):
    """Numbers of any size are clipped, those that their type made infinite are refused."""
    player, twin = single(task), single(task)
    sign = np.where(np.arange(JOINTS) % 3 == 0, -1.0, 1.0)
    with np.errstate(over="ignore"):
        half = (1e6 * sign).astype(np.float16)
    refused(player, half, "finite, got -inf at joint 0")
    if LONG.maxexp > 1024:  # beyond double precision
        refused(player, np.full(JOINTS, np.longdouble("1e4000")), "finite, got inf at joint 0")
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
        kept = copy.deepcopy(action)
        assert_same(player.step(action), twin.step(sign), f"{np.asarray(action).dtype}")
        assert_same(action, kept, "the caller's array was clipped in place")
    most = np.full(JOINTS, np.iinfo(np.uint64).max, dtype=np.uint64)
    assert_same(player.step(most), twin.step(np.ones(JOINTS)), "uint64")
    # What is finer than double precision is rounded to it, and what is smaller is nothing.
    thirds = np.linspace(-1.0, 1.0, JOINTS).astype(np.longdouble) / 3
    for fine in (thirds, LONG.tiny * thirds):
        assert_same(player.step(fine), twin.step(fine.astype(np.float64)), "long double")


@each_task
def test_without_an_episode_bad_actions_are_not_looked_at(task):
    """Before the first reset and after an end the error is about that, and nothing changes."""
    env = make(task, overrides=LIVELY)
    bad = (np.full(3, np.nan), None, np.zeros(9))
    for action in bad:
        with pytest.raises(gymnasium.error.ResetNeeded):
            env.step(action)
    env.reset(seed=0)
    while not env.step(np.ones(3))[2]:
        pass
    for action in bad:
        with refuses(SimulationEndedError, "call reset", leaving=env):
            env.step(action)


@each_task
@pytest.mark.parametrize("threads", [1, 2, 5])
@each_mode
def test_one_bad_member_among_many_changes_nothing_of_anybody(task, threads, mode):
    """Members end and start anew at all times; in between come bad actions of one, or of some."""
    members, joints = 7, 3
    envs, twin = (
        make_batch(
            task,
            members,
            overrides={**LIVELY, "recording": True},
            heading_weight=0.2,
            max_episode_steps=40,
            num_threads=threads,
            autoreset_mode=mode,
        )
        for _ in range(2)
    )
    shape = (members, joints)
    rng = np.random.default_rng(threads)
    assert_same(envs.reset(seed=11), twin.reset(seed=11), "reset")
    ended = np.zeros(members, dtype=np.bool_)
    ignored, ends = 0, []
    for step in range(90):
        good = rng.uniform(-1.0, 1.0, shape).round()
        value = float(rng.choice([np.nan, np.inf, -np.inf]))
        if mode is AutoresetMode.DISABLED and ended.any():
            for bad in (np.full(shape, value), None, good):
                with refuses(gymnasium.error.ResetNeeded, "have ended", leaving=envs):
                    envs.step(bad)
            options = {"reset_mask": ended}
            one, other = envs.reset(options=options), twin.reset(options=options)
            assert_same(one, other, f"reset {step}")
        waiting = mode is AutoresetMode.NEXT_STEP and ended.any()
        playing = np.flatnonzero(~ended) if waiting else np.arange(members)
        if len(playing):
            some = np.sort(rng.choice(playing, rng.integers(1, len(playing) + 1), replace=False))
            joint = int(rng.integers(joints))
            bad = good.copy()
            bad[some, joint] = value
            if waiting:
                bad[ended] = np.nan
            where = f"actions must be finite, got {value} at joint {joint} of member {some[0]}"
            with refuses(ActionError, where, leaving=envs):
                envs.step(bad)
        if waiting:
            for bad in (None, np.zeros((members, joints + 1)), [["a"] * joints] * members):
                with refuses(ActionError, f"shape {shape}", leaving=envs):
                    envs.step(bad)
        given = good.copy()
        if waiting:
            # The actions of those that start anew do not count.
            given[ended] = value
            ignored += int(ended.sum())
        one, other = envs.step(given), twin.step(good)
        given[:] = np.nan
        assert_same(one, other, f"step {step}")
        ended = one[2] | one[3]
        if ended.any():
            ends.append(step)
        if step % 10 == 9:
            assert_same(state_of(envs), state_of(twin), f"state and recording after step {step}")
    assert mode is not AutoresetMode.NEXT_STEP or ignored > members, "nobody has ever waited"
    assert len(ends) > 3, f"all members did the same: {ends}"
