"""Work side by side in fresh processes, which end with the one that started them or before."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from swim_env.errors import SwimError

__all__ = ["Call", "in_fresh_processes"]

#: A function of a module and its arguments.
Call = tuple[Callable[..., Any], tuple[Any, ...]]


def in_fresh_processes(
    calls: Sequence[Call],
    workers: int | None = None,
    prepare: Callable[[], object] | None = None,
    advice: str = "",
) -> Generator[tuple[int, Any], None, None]:
    """Make calls side by side in new processes; yields index and result as each is done.

    Processes are started afresh, as a fork would inherit locks of a process that has threads. They
    leave an interrupt from the keyboard to this one, which ends them at once: also when a call
    fails, or when the iterator is closed.

    Parameters
    ----------
    calls : sequence of Call
        What to do; the first are begun first. Functions, arguments and results must pickle.
    workers : int, optional
        Processes side by side, as many as there are processors unless given.
    prepare : callable, optional
        What every process does before its first call, a function of a module.
    advice : str
        What the user can do when a process has died; it follows the message.

    Raises
    ------
    SwimError
        If a process has died.
    BaseException
        Whatever a call raises.
    """
    count = max(1, min(workers or os.cpu_count() or 1, len(calls)))
    before = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(count, mp_context=context, initializer=_begin, initargs=(prepare,))
    finished = False
    try:
        waiting = {pool.submit(*_flat(call)): index for index, call in enumerate(calls)}
        for future in as_completed(waiting):
            yield waiting.pop(future), future.result()
        finished = True
    except BrokenProcessPool:
        text = "a worker process has died, killed or perhaps for want of memory"
        raise SwimError(f"{text}; {advice}" if advice else text) from None
    finally:
        if not finished:
            # What runs could take minutes, and nobody waits for it any more.
            for process in set(multiprocessing.active_children()) - before:
                process.terminate()
        # Waits for the pool's own thread, which waits for the processes: to wait for them here as
        # well would leave open who of the two hears of an end, and when the other does.
        pool.shutdown(cancel_futures=True)


def _flat(call: Call) -> tuple[Any, ...]:
    function, arguments = call
    return (function, *arguments)


def _begin(prepare: Callable[[], object] | None) -> None:
    # A terminal interrupts all processes of a command: one of them answers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if prepare is not None:
        prepare()
