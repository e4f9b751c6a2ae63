"""Where the runs of a sweep are done: in processes of this machine, or by Ray."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Generator, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import NamedTuple, cast

from tqdm import tqdm

from swim_agents.sweep.config import Run
from swim_agents.sweep.runs import perform
from swim_env.errors import SwimError, require_packages

#: How often a run is begun whose process is lost.
_TRIES = 2

#: Each run that is over, and why it has no record, if that is so.
Outcomes = Generator[tuple[Run, str]]


class _Worker(NamedTuple):
    """A process that does one run after another, and this end of its pipe."""

    process: SpawnProcess
    pipe: Connection


def on_this_machine(runs: Sequence[Run], folder: Path, workers: int, threads: int) -> Outcomes:
    """Do runs in so many processes, each with that many kernel threads.

    A run whose process is lost is begun again once, in another. All end with this process.
    """
    waiting, begun = deque(runs), Counter[str]()
    idle: list[_Worker] = []
    under_way: dict[Connection, tuple[_Worker, Run]] = {}
    try:
        while waiting or under_way:
            while waiting and len(under_way) < workers:
                run, worker = waiting.popleft(), idle.pop() if idle else _start()
                begun[run.name] += 1
                under_way[worker.pipe] = worker, run
                with contextlib.suppress(BrokenPipeError):  # it was lost: seen below
                    worker.pipe.send((run, folder / run.name, threads))
            for pipe in cast(list[Connection], wait(list(under_way))):
                worker, run = under_way.pop(pipe)
                try:
                    reason = pipe.recv()
                    idle.append(worker)
                except (EOFError, ConnectionResetError):
                    worker.process.join()
                    if begun[run.name] < _TRIES:
                        waiting.append(run)
                        continue
                    reason = f"its process was lost {_TRIES} times, {_how(worker)}"
                yield run, reason
    finally:
        for worker in [*idle, *(worker for worker, _ in under_way.values())]:
            worker.process.kill()
            worker.process.join()


def _how(worker: _Worker) -> str:
    code = worker.process.exitcode or 0
    return f"exit code {code}" if code >= 0 else signal.Signals(-code).name


def _start() -> _Worker:
    context = multiprocessing.get_context("spawn")
    pipe, other = context.Pipe()
    process = context.Process(target=_work, args=(other,), daemon=True)
    process.start()
    other.close()
    return _Worker(process, pipe)


def _work(pipe: Connection) -> None:
    """Do runs as they come; send back why one has no record, nothing if it has."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the sweep's process is told, and ends this one
    threading.Thread(target=_end_with_parent, daemon=True).start()
    tqdm.set_lock(threading.RLock())  # its own lock would outlive a killed process
    while True:
        try:
            perform(*pipe.recv())
            pipe.send("")
        except OSError as error:
            pipe.send(_unwritten(error))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _unwritten(error: OSError) -> str:
    return f"its record cannot be written: {error.strerror or error}"


def on_ray(
    runs: Sequence[Run], folder: Path, workers: int, threads: int, address: str | None = None
) -> Outcomes:
    """Do runs as tasks of Ray, each on as many processors as it has threads.

    Parameters
    ----------
    runs, folder, threads
        As for `on_this_machine`. The folder must be one that all machines see.
    workers : int
        Runs at a time where Ray is started here.
    address : str, optional
        Of a cluster that runs already: ``auto`` or what `ray.init` takes.

    Raises
    ------
    SwimError
        If Ray is not installed, or there is no cluster at the address.
    """
    require_packages("sweeps on Ray need", {"ray": "Ray"}, "ray")
    import ray

    try:
        here = {} if address else {"num_cpus": workers * threads, "include_dashboard": False}
        ray.init(address or "local", log_to_driver=False, logging_level="error", **here)
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise SwimError(f"no cluster of Ray at {address}: {' '.join(str(error).split())}") from None
    try:
        task = ray.remote(num_cpus=threads, max_retries=_TRIES - 1)(perform)
        under_way = {task.remote(run, folder / run.name, threads): run for run in runs}
        while under_way:
            (done,), _ = ray.wait(list(under_way))
            run, reason = under_way.pop(done), ""
            try:
                ray.get(done)
            except ray.exceptions.RayTaskError as error:
                if not isinstance(error.cause, OSError):
                    raise
                reason = _unwritten(error.cause)
            except ray.exceptions.RayError as error:
                reason = f"its process was lost: {str(error).splitlines()[0]}"
            yield run, reason
    finally:
        ray.shutdown()
