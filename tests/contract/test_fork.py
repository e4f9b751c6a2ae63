"""Batches in threads beside forked processes: no deadlock, and the same bits everywhere."""

import multiprocessing
import os
import threading
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv
from numpy.typing import NDArray

from swim_env import ActionError, SwimVectorEnv
from tests.support import FORWARD, TARGET, TASKS, assert_same, each_task, make_batch, uniform

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork"),
    # A deadlock fails here and hangs nothing.
    pytest.mark.timeout(90),
    # Later versions of Python warn of every fork beside threads.
    pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork.*:DeprecationWarning"),
]

SCENE: dict[str, object] = {"beam.elements": 4, "fluid.panels_per_element": 2}
MEMBERS, JOINTS, STEPS, SEED = 6, 3, 12, 40
#: Actions to an episode.
LIMIT = 8
#: Seconds that a process may take for what takes a few hundredths.
PATIENCE = 30.0

Results = list[tuple[NDArray[Any], ...]]


def new(task: str = FORWARD, num_threads: int = 2) -> SwimVectorEnv:
    return make_batch(
        task, MEMBERS, overrides=SCENE, max_episode_steps=LIMIT, num_threads=num_threads
    )


def make_one(task: str) -> Callable[[], gymnasium.Env[Any, Any]]:
    return lambda: gymnasium.make(task, overrides=SCENE, max_episode_steps=LIMIT)


def actions_of(step: int) -> NDArray[np.float64]:
    return uniform(MEMBERS, JOINTS, seed=step)


def play(envs: Any, steps: int = STEPS) -> Results:
    """Step a batch and return what it observed and gained, without the infos."""
    return [tuple(envs.step(actions_of(step))[:4]) for step in range(steps)]


def play_anew(envs: Any) -> Results:
    observations, _ = envs.reset(seed=SEED)
    return [(observations,), *play(envs)]


def in_a_fork(work: Callable[[], Any]) -> Any:
    """Return what a forked child makes of a call; a child that hangs is ended."""
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    child = context.Process(target=lambda: sender.send(work()))
    child.start()
    sender.close()
    try:
        assert receiver.poll(PATIENCE), "the child hangs"
        return receiver.recv()  # EOFError: the child has failed, and said why
    finally:
        child.kill()
        child.join()


@pytest.fixture(scope="module")
def expected() -> dict[str, Results]:
    """What the members do one after the other, in one thread."""
    results = {task: play_anew(new(task, num_threads=1)) for task in TASKS}
    steps = results[FORWARD]
    assert len(np.unique(steps[3][0], axis=0)) == MEMBERS, "members do the same"
    assert any(step[3].all() for step in steps[1:]), "no episode ends"
    with pytest.raises(AssertionError):
        assert_same(results[TARGET][1:], steps[1:])
    return results


@pytest.fixture
def running() -> Iterator[SwimVectorEnv]:
    """A batch that has just been stepped by two threads in this process."""
    envs = new()
    envs.reset(seed=1)
    play(envs, steps=2)
    names = [thread.name for thread in threading.enumerate()]
    assert any(name.startswith("swim_env") for name in names), "no second thread was started"
    yield envs
    envs.close()


@each_task
def test_forks_in_a_row_step_their_own_batches_and_leave_the_parent_running(
    task, running, expected
):
    for _ in range(6):
        assert_same(in_a_fork(lambda: play_anew(new(task))), expected[task])
        assert_same(play_anew(running), expected[FORWARD])
    assert_same(play_anew(new(task)), expected[task])


def test_a_fork_continues_the_parents_batch(running):
    """Parent and children continue the same episodes, each on its own."""
    children = [in_a_fork(lambda: play(running, 2)) for _ in range(3)]
    here = play(running, 2)
    for child in children:
        assert_same(child, here)


def test_a_fork_of_a_fork_works(running, expected):
    def both() -> tuple[Results, Results]:
        return play_anew(new()), in_a_fork(lambda: play_anew(new()))

    assert_same(in_a_fork(both), (expected[FORWARD], expected[FORWARD]))
    assert_same(play_anew(running), expected[FORWARD])


def test_a_forks_other_threads_can_step(running, expected):
    """Nothing that the forking thread held is still held in the child."""

    def in_another_thread() -> Results:
        with ThreadPoolExecutor(1) as threads:
            return threads.submit(lambda: play_anew(new())).result()

    assert_same(in_a_fork(in_another_thread), expected[FORWARD])
    assert_same(in_another_thread(), expected[FORWARD])


def test_a_fork_in_the_middle_of_a_step_of_another_thread(expected):
    """The fork waits for the step; neither the child nor the stepping thread is harmed."""
    envs, stop = new(), threading.Event()
    rounds: list[Results] = []

    def keep_stepping() -> None:
        while not stop.is_set():
            rounds.append(play_anew(envs))

    with ThreadPoolExecutor(1) as threads:
        stepping = threads.submit(keep_stepping)
        try:
            for _ in range(8):
                assert_same(in_a_fork(lambda: play_anew(new())), expected[FORWARD])
        finally:
            stop.set()
        stepping.result(timeout=PATIENCE)
    assert len(rounds) > 1
    for results in rounds:
        assert_same(results, expected[FORWARD])


@each_task
def test_gymnasiums_processes_give_the_same_bits(task, running, expected):
    envs = AsyncVectorEnv([make_one(task)] * MEMBERS, context="fork")
    batch = new(task)
    batch.reset(seed=SEED)
    try:
        envs.reset_async(seed=SEED)
        results: Results = [(envs.reset_wait(timeout=PATIENCE)[0],)]
        for step in range(STEPS):
            envs.step_async(actions_of(step))
            *result, infos = envs.step_wait(timeout=PATIENCE)
            results.append(tuple(result))
            assert_same(infos, batch.step(actions_of(step))[4], f"infos of step {step}")
    finally:
        envs.close(terminate=True)
    assert_same(results, expected[task])
    assert_same(play_anew(running), expected[FORWARD])


@each_task
def test_the_processes_of_stable_baselines3_give_the_same_bits(task, running, expected):
    vec_env = pytest.importorskip("stable_baselines3.common.vec_env")
    envs = vec_env.SubprocVecEnv([make_one(task)] * MEMBERS, start_method="fork")
    try:
        envs.seed(SEED)
        np.testing.assert_array_equal(envs.reset(), expected[task][0][0])
        # It starts members anew in the step of their end; until then both are the same.
        for step in range(LIMIT - 1):
            observations, rewards, over, infos = envs.step(actions_of(step))
            wanted = expected[task][1 + step]
            np.testing.assert_array_equal(observations, wanted[0])
            np.testing.assert_array_equal(rewards, wanted[1])
            assert not over.any()
        observations, rewards, over, infos = envs.step(actions_of(LIMIT - 1))
        assert over.all()
        last = np.array([info["terminal_observation"] for info in infos])
        np.testing.assert_array_equal(last, expected[task][LIMIT][0])
        assert all(info["TimeLimit.truncated"] for info in infos)
        # Their next starts are drawn from the members' own random numbers.
        np.testing.assert_array_equal(observations, expected[task][LIMIT + 1][0])
    except BaseException:  # closing would wait for an answer that may never come
        for process in envs.processes:
            process.terminate()
        raise
    envs.close()
    assert_same(play_anew(running), expected[FORWARD])


@pytest.mark.parametrize("widths", [(2, 2), (2, 3, 5, 4)], ids=str)
def test_batches_step_side_by_side_in_threads(widths, expected):
    """The threads they share grow with the widest while others are at work."""
    start = threading.Barrier(len(widths), timeout=PATIENCE)

    def work(index: int) -> list[Results]:
        envs = new(TASKS[index % 2], num_threads=widths[index])
        start.wait()
        return [play_anew(envs) for _ in range(8)]

    with ThreadPoolExecutor(len(widths)) as threads:
        running = [threads.submit(work, index) for index in range(len(widths))]
        for index, future in enumerate(running):
            for results in future.result(timeout=PATIENCE):
                assert_same(results, expected[TASKS[index % 2]])


def test_an_error_in_one_thread_leaves_the_next_step_free(running, expected):
    """A refused step holds no lock: forks and other threads can step."""
    with pytest.raises(ActionError):
        running.step(np.full((MEMBERS, JOINTS), np.nan))
    with ThreadPoolExecutor(1) as threads:
        there = threads.submit(lambda: play_anew(new())).result(timeout=PATIENCE)
    assert_same(there, expected[FORWARD])
    assert_same(in_a_fork(lambda: play_anew(new())), expected[FORWARD])


def test_forking_warns_of_nothing_while_no_other_thread_lives(running):
    """The pool's threads are gone before a fork, so that the child inherits no half of them."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        names = in_a_fork(lambda: [thread.name for thread in threading.enumerate()])
    assert not any(name.startswith("swim_env") for name in names)
