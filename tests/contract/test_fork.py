"""Batches in threads beside forked processes: no deadlock, and the same bits everywhere."""

from __future__ import annotations

import os
import pickle
import select
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv
from numpy.typing import NDArray

from swim_env import SwimVectorEnv

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork"),
    # A deadlock fails here and hangs nothing.
    pytest.mark.timeout(90),
    # Later versions of Python warn of every fork beside threads.
    pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork.*:DeprecationWarning"),
]

FORWARD = "swim_env/KirchhoffSwimmer-v0"
TARGET = "swim_env/KirchhoffSwimmerTarget-v0"
each_task = pytest.mark.parametrize("task", [FORWARD, TARGET], ids=("forward", "target"))

SCENE: dict[str, object] = {"beam.elements": 4, "fluid.panels_per_element": 2}
MEMBERS, JOINTS, STEPS, SEED = 6, 3, 12, 40
#: Seconds that a process may take for what takes a few hundredths.
PATIENCE = 30.0

Results = list[tuple[NDArray[Any], ...]]


def actions_of(step: int) -> NDArray[np.float64]:
    return np.random.default_rng(step).uniform(-1.0, 1.0, (MEMBERS, JOINTS))


def make_batch(task: str = FORWARD, num_threads: int = 2) -> SwimVectorEnv:
    envs = gymnasium.make_vec(
        task, MEMBERS, overrides=SCENE, max_episode_steps=8, num_threads=num_threads
    )
    assert isinstance(envs, SwimVectorEnv)
    return envs


def play(envs: Any, first: int = 0, steps: int = STEPS) -> Results:
    """Step a batch and return what it observed and gained, without the infos."""
    return [tuple(envs.step(actions_of(step))[:4]) for step in range(first, first + steps)]


def play_anew(envs: Any) -> Results:
    observations, _ = envs.reset(seed=SEED)
    return [(observations,), *play(envs)]


def assert_same(left: Any, right: Any) -> None:
    assert len(left) == len(right)
    for one, other in zip(left, right, strict=True):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            assert a.dtype == b.dtype
            np.testing.assert_array_equal(a, b)


def in_a_fork(work: Callable[[], Any]) -> Any:
    """Return what a forked child makes of a call; a child that hangs is ended and told of."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            # Nothing of the parent's clock or clean-up is the child's business.
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.alarm(int(PATIENCE))
            os.close(reader)
            with os.fdopen(writer, "wb") as stream:
                try:
                    outcome = (True, work())
                except BaseException as error:
                    outcome = (False, f"{type(error).__name__}: {error}")
                stream.write(pickle.dumps(outcome))
            code = 0
        finally:
            os._exit(code)
    os.close(writer)
    received = b""
    deadline = time.monotonic() + PATIENCE
    try:
        while True:
            left = deadline - time.monotonic()
            ready, _, _ = select.select([reader], [], [], max(0.0, left))
            assert ready, "the child hangs"
            part = os.read(reader, 1 << 16)
            if not part:
                break
            received += part
    finally:
        os.close(reader)
        if time.monotonic() >= deadline:
            os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
    assert status == 0, f"the child ended with status {status}"
    fine, value = pickle.loads(received)
    assert fine, value
    return value


@pytest.fixture(scope="module")
def expected() -> dict[str, Results]:
    """What the members do one after the other, in one thread."""
    return {task: play_anew(make_batch(task, num_threads=1)) for task in (FORWARD, TARGET)}


@pytest.fixture
def running() -> Iterator[SwimVectorEnv]:
    """A batch that has just been stepped by two threads in this process."""
    envs = make_batch()
    envs.reset(seed=1)
    play(envs, steps=2)
    names = [thread.name for thread in threading.enumerate()]
    assert any(name.startswith("swim_env") for name in names), "no second thread was started"
    yield envs
    envs.close()


def test_the_expectation_can_fail(expected: dict[str, Results]) -> None:
    """Members differ, episodes end, and another seed gives other bits."""
    steps = expected[FORWARD]
    assert len(np.unique(steps[3][0], axis=0)) == MEMBERS
    assert any(step[3].all() for step in steps[1:])
    with pytest.raises(AssertionError):
        assert_same(expected[TARGET][1:], steps[1:])


@each_task
def test_a_fork_steps_its_own_batch_with_threads(
    task: str, running: SwimVectorEnv, expected: dict[str, Results]
) -> None:
    assert_same(in_a_fork(lambda: play_anew(make_batch(task))), expected[task])
    assert_same(play_anew(make_batch(task)), expected[task])


def test_a_fork_goes_on_with_the_parents_batch(running: SwimVectorEnv) -> None:
    """Parent and children continue the same episodes, each on its own."""
    children = [in_a_fork(lambda: play(running, 2)) for _ in range(3)]
    here = play(running, 2)
    for child in children:
        assert_same(child, here)


def test_a_fork_of_a_fork_works(running: SwimVectorEnv, expected: dict[str, Results]) -> None:
    def both() -> tuple[Results, Results]:
        before = play_anew(make_batch())
        return before, in_a_fork(lambda: play_anew(make_batch()))

    before, grandchild = in_a_fork(both)
    assert_same(before, expected[FORWARD])
    assert_same(grandchild, expected[FORWARD])
    assert_same(play_anew(running), expected[FORWARD])


def test_a_forks_other_threads_can_step(
    running: SwimVectorEnv, expected: dict[str, Results]
) -> None:
    """Nothing that the forking thread held is still held in the child."""

    def in_another_thread() -> Results:
        with ThreadPoolExecutor(1) as threads:
            return threads.submit(lambda: play_anew(make_batch())).result()

    assert_same(in_a_fork(in_another_thread), expected[FORWARD])
    assert_same(in_another_thread(), expected[FORWARD])


def test_many_forks_in_a_row_leave_the_parent_running(
    running: SwimVectorEnv, expected: dict[str, Results]
) -> None:
    for _ in range(10):
        results = in_a_fork(lambda: play_anew(make_batch()))
        assert_same(results, expected[FORWARD])
        assert_same(play_anew(running), expected[FORWARD])


def test_a_fork_in_the_middle_of_a_step_of_another_thread(
    expected: dict[str, Results],
) -> None:
    """The fork waits for the step; neither the child nor the stepping thread is harmed."""
    envs, stop = make_batch(), threading.Event()
    rounds: list[Results] = []

    def keep_stepping() -> None:
        while not stop.is_set():
            rounds.append(play_anew(envs))

    with ThreadPoolExecutor(1) as threads:
        stepping = threads.submit(keep_stepping)
        try:
            for _ in range(8):
                assert_same(in_a_fork(lambda: play_anew(make_batch())), expected[FORWARD])
        finally:
            stop.set()
        stepping.result(timeout=PATIENCE)
    assert len(rounds) > 1
    for results in rounds:
        assert_same(results, expected[FORWARD])


@each_task
def test_gymnasiums_processes_give_the_same_bits(
    task: str, running: SwimVectorEnv, expected: dict[str, Results]
) -> None:
    def make_one() -> gymnasium.Env[Any, Any]:
        return gymnasium.make(task, overrides=SCENE, max_episode_steps=8)

    envs = AsyncVectorEnv([make_one] * MEMBERS, context="fork")
    try:
        envs.reset_async(seed=SEED)
        observations, infos = envs.reset_wait(timeout=PATIENCE)
        results: Results = [(observations,)]
        for step in range(STEPS):
            envs.step_async(actions_of(step))
            *result, infos = envs.step_wait(timeout=PATIENCE)
            results.append(tuple(result))
        batch = make_batch(task)
        batch.reset(seed=SEED)
        for step in range(STEPS):
            *_, told = batch.step(actions_of(step))
    finally:
        envs.close(terminate=True)
    assert_same(results, expected[task])
    assert set(infos) == set(told)
    for key in told:
        np.testing.assert_array_equal(infos[key], told[key])
    running.reset(seed=SEED)
    assert_same(play(running), expected[FORWARD][1:])


@each_task
def test_the_processes_of_stable_baselines3_give_the_same_bits(
    task: str, running: SwimVectorEnv, expected: dict[str, Results]
) -> None:
    vec_env = pytest.importorskip("stable_baselines3.common.vec_env")

    def make_one() -> gymnasium.Env[Any, Any]:
        return gymnasium.make(task, overrides=SCENE, max_episode_steps=8)

    envs = vec_env.SubprocVecEnv([make_one] * MEMBERS, start_method="fork")
    try:
        envs.seed(SEED)
        np.testing.assert_array_equal(envs.reset(), expected[task][0][0])
        # It starts members anew in the step of their end; until then both are the same.
        for step in range(7):
            observations, rewards, over, infos = envs.step(actions_of(step))
            wanted = expected[task][1 + step]
            np.testing.assert_array_equal(observations, wanted[0])
            np.testing.assert_array_equal(rewards, wanted[1])
            assert not over.any()
        observations, rewards, over, infos = envs.step(actions_of(7))
        assert over.all()
        last = np.array([info["terminal_observation"] for info in infos])
        np.testing.assert_array_equal(last, expected[task][8][0])
        assert all(info["TimeLimit.truncated"] for info in infos)
        # Their next starts are drawn from the members' own random numbers.
        np.testing.assert_array_equal(observations, expected[task][9][0])
    except BaseException:  # closing would wait for an answer that may never come
        for process in envs.processes:
            process.terminate()
        raise
    envs.close()
    assert_same(play_anew(running), expected[FORWARD])


def test_batches_step_side_by_side_in_threads(expected: dict[str, Results]) -> None:
    """Two batches stepped at once from two threads give what they give alone."""
    start = threading.Barrier(2, timeout=PATIENCE)

    def work(task: str) -> list[Results]:
        envs = make_batch(task)
        start.wait()
        return [play_anew(envs) for _ in range(8)]

    with ThreadPoolExecutor(2) as threads:
        running = {task: threads.submit(work, task) for task in (FORWARD, TARGET)}
        for task, future in running.items():
            for results in future.result(timeout=PATIENCE):
                assert_same(results, expected[task])


def test_batches_of_different_widths_step_side_by_side() -> None:
    """The threads they share grow with the widest while others are at work."""
    counts = (2, 3, 5, 4)
    start = threading.Barrier(len(counts), timeout=PATIENCE)

    def work(num_threads: int) -> Results:
        envs = make_batch(num_threads=num_threads)
        start.wait()
        return play_anew(envs) + play_anew(envs)

    alone = play_anew(make_batch(num_threads=1))
    with ThreadPoolExecutor(len(counts)) as threads:
        for future in [threads.submit(work, count) for count in counts]:
            assert_same(future.result(timeout=PATIENCE), alone + alone)


def test_an_error_in_one_thread_leaves_the_next_step_free(running: SwimVectorEnv) -> None:
    """A refused step holds no lock: forks and other threads go on."""
    with pytest.raises(ValueError):
        running.step(np.full((MEMBERS, JOINTS), np.nan))
    with ThreadPoolExecutor(1) as threads:
        there = threads.submit(play, make_batch_reset()).result(timeout=PATIENCE)
    assert_same(in_a_fork(lambda: play(make_batch_reset())), there)


def make_batch_reset() -> SwimVectorEnv:
    envs = make_batch()
    envs.reset(seed=3)
    return envs


def test_forking_warns_of_nothing_while_no_other_thread_lives(running: SwimVectorEnv) -> None:
    """The pool's threads are gone before a fork, so that the child inherits no half of them."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        names = in_a_fork(lambda: [thread.name for thread in threading.enumerate()])
    assert not any(name.startswith("swim_env") for name in names)
    assert threading.active_count() >= 1
