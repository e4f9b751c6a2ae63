"""Sharing a batch among threads, safely beside forked processes.

Kernels release the interpreter's lock, so plain threads run them side by side. A pool of Python's
threads is preferred to numba's own for two reasons. The very same compiled code then serves one
member and many, with one thread and with several, so results cannot depend on either. And a
process that forks afterwards, as `AsyncVectorEnv` and `SubprocVecEnv` do, is not harmed: the
threads are stopped before the fork and started again when they are needed next.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np
from numba.np.ufunc import parallel
from numpy.typing import NDArray

Indices = NDArray[np.int64]

#: Pieces per thread: members differ in cost, and who is done early takes another piece.
_PIECES_PER_THREAD = 4

# Held while a batch is running, so that no fork happens in the middle of one.
_lock = threading.RLock()
_pool: ThreadPoolExecutor | None = None
_pool_size = 0


def usable_threads() -> int:
    """Return the number of threads that numba may use.

    That is what `numba.set_num_threads` was given, or the variable NUMBA_NUM_THREADS, by default
    the number of processors.
    """
    # Asking numba itself would start its threads, which no fork survives; they run already where
    # their number was set.
    if getattr(parallel, "_is_initialized", False):
        return int(numba.get_num_threads())
    return int(numba.config.NUMBA_NUM_THREADS)


def share(run: Callable[[Indices], None], members: Indices, threads: int) -> None:
    """Call `run` on pieces of `members` in up to that many threads, this one among them.

    Parameters
    ----------
    run : callable
        Takes an array of member indices; releases the interpreter's lock for most of its time.
    members : (K,) array of int
        Each index is handed to exactly one call.
    threads : int
        With 1, or with one member, `run` is called once, here.
    """
    count = min(threads, len(members))
    if count <= 1:
        run(members)
        return
    size = max(1, -(-len(members) // (count * _PIECES_PER_THREAD)))
    pieces = iter([members[first : first + size] for first in range(0, len(members), size)])

    def work() -> None:
        for piece in pieces:  # a list's iterator hands out every item once, to whichever thread
            run(piece)

    with _lock:
        helpers = [_executor(count - 1).submit(work) for _ in range(count - 1)]
        try:
            work()
        finally:
            for helper in helpers:
                helper.result()


def _executor(size: int) -> ThreadPoolExecutor:
    """Return the pool with at least that many threads; called with the lock held."""
    global _pool, _pool_size
    if _pool is None or _pool_size < size:
        _stop()
        _pool = ThreadPoolExecutor(size, thread_name_prefix="swim_env")
        _pool_size = size
    return _pool


def _stop() -> None:
    global _pool, _pool_size
    if _pool is not None:
        _pool.shutdown(wait=True)
    _pool, _pool_size = None, 0


def _before_fork() -> None:
    _lock.acquire()
    _stop()


def _after_fork_in_child() -> None:
    global _lock
    _lock = threading.RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=_before_fork,
        after_in_parent=lambda: _lock.release(),
        after_in_child=_after_fork_in_child,
    )
