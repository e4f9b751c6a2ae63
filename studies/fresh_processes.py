"""Work side by side in fresh processes, which never outlive the one that started them."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import traceback
from collections.abc import Callable, Generator, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import ForkingPickler
from typing import Any, cast

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
    leave an interrupt from the keyboard to this one, which ends them at once, as it does when a
    call fails or the iterator is closed. (A `concurrent.futures.ProcessPoolExecutor` cannot end
    what runs, and a `multiprocessing.Pool` waits for ever for the result of a worker that died.)

    Parameters
    ----------
    calls : sequence of Call
        What to do; the first are begun first. Functions, arguments and results must pickle.
    workers : int, optional
        Processes side by side, as many as there are processors unless given.
    prepare : callable, optional
        What every process does before its first call, a function of a module.
    advice : str
        What the user can do if a process has died; it follows the message.

    Raises
    ------
    SwimError
        If a process has died.
    Exception
        Whatever a call raises; its notes say where in the worker.
    """
    context = multiprocessing.get_context("spawn")
    waiting = list(enumerate(calls))[::-1]
    busy: dict[Connection, int] = {}
    idle: list[Connection] = []
    processes: list[BaseProcess] = []
    try:
        for _ in range(min(max(1, workers or os.cpu_count() or 1), len(calls))):
            ours, theirs = context.Pipe()
            # Daemons are ended where Python ends and nobody has closed the iterator.
            process = context.Process(target=_work, args=(theirs, prepare), daemon=True)
            process.start()
            processes.append(process)
            idle.append(ours)
            # Now the worker alone has that end, and with its death nothing more comes from there.
            theirs.close()
        while waiting or busy:
            try:
                while waiting and idle:
                    index, call = waiting.pop()
                    busy[idle[-1]] = index
                    idle.pop().send(call)
                connection = cast(Connection, wait(list(busy))[0])
                went_well, answer = connection.recv()
            except (EOFError, ConnectionError):
                text = "a worker process has died, killed or perhaps out of memory"
                raise SwimError(f"{text}; {advice}" if advice else text) from None
            if not went_well:
                raise answer
            idle.append(connection)
            yield busy.pop(connection), answer
    finally:
        for connection in (*busy, *idle):
            connection.close()
        for one in processes:
            # What still runs could take minutes, and nobody waits for it any more.
            one.terminate()
            one.join()


def _work(calls: Connection, prepare: Callable[[], object] | None) -> None:
    """Answer calls until there are no more: with True and the result, or False and the error."""
    # A terminal interrupts all processes of a command: one of them answers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(EOFError, ConnectionError):
        while True:
            function, arguments = calls.recv()
            try:
                if prepare is not None:
                    prepare()
                    prepare = None
                # What cannot be sent is an error of the call, so it becomes bytes here.
                answer = ForkingPickler.dumps((True, function(*arguments)))
            except Exception as error:
                answer = ForkingPickler.dumps((False, _portable(error)))
            calls.send_bytes(answer)


def _portable(error: Exception) -> Exception:
    """Return an error that can be sent, with where it happened among its notes."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        error = RuntimeError(f"{type(error).__name__}: {error}")
    error.add_note(f"in a worker process:\n{traceback.format_exc()}")
    return error
