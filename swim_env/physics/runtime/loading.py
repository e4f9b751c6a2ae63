"""Loads groups of compiled kernels, in one order; separate processes compile them.

Two entry points that share a callee both bring a copy of it, and a process binds both to the copy
that came first. Copies may differ in the last bit, because the compiler contracts products and
sums differently in different surroundings. For results to be the same to the bit in every process,
kernels are therefore always taken from the cache and always in the same order. A process that
finds the cache empty has another one fill it.
"""

from __future__ import annotations

import contextlib
import functools
import gc
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
from filelock import FileLock, Timeout
from numba.core import config as numba_config

from swim_env.physics.runtime.cache import ForgivingCache, cache_folder, say, why_temporary

Loads = list[Callable[[], None]]

#: Processes that compile side by side, where there are as many processors. More would wait for the
#: kernel that takes longest.
_MOST_PROCESSES = 4

# Held while kernels are loaded: threads that came first together would restore each other's limits.
_loading = threading.RLock()


def linked(kernel: Any, *arguments: object) -> Callable[[], None]:
    """Return what loads a kernel that others call at an address, with arguments like these."""
    kernel.linked.declare(*arguments)
    return kernel.linked.load  # type: ignore[no-any-return]


def entry(kernel: Any, *arguments: object) -> Callable[[], None]:
    """Return what loads a kernel that Python calls with arguments like these."""
    return functools.partial(kernel.compile, tuple(map(numba.typeof, arguments)))


@contextlib.contextmanager
def _rarely_collected() -> Iterator[None]:
    """Let the garbage collector rest: compilers and caches make much that lasts, and little else.

    It takes a tenth of the time otherwise.
    """
    with _loading:
        before = gc.get_threshold()
        gc.set_threshold(max(before[0], 100_000) if before[0] else 0, *before[1:])
        try:
            yield
        finally:
            gc.set_threshold(*before)


class KernelGroup:
    """Kernels that are needed together: all that others call at an address, or Python calls.

    Parameters
    ----------
    module, attribute : str
        Where the group is found; the latter may be an item of an attribute.
    name : str
        What they are, for messages.
    marker : str
        File of the cache folder that says that all of them are there.
    kernels : callable
        Returns what compiles each kernel or takes it from the cache; what takes longest is first,
        as processes that compile take one kernel after the other.
    """

    def __init__(
        self,
        module: str,
        attribute: str,
        name: str,
        marker: str,
        kernels: Callable[[], Loads],
    ) -> None:
        self._module = module
        self._attribute = attribute
        self._name = name
        self._marker = marker
        self._kernels = kernels

    def load(self) -> None:
        """Load every kernel; compile them first where that is needed.

        It takes a fraction of a second where the cache is filled, and announces on stderr when it
        is not. Of several processes that find it empty one compiles, and the others wait for it.
        """
        if numba_config.DISABLE_JIT:
            say(
                f"NUMBA_DISABLE_JIT is set: the {self._name} run as Python, a thousand times slower"
            )
            return
        marker = cache_folder() / self._marker
        if not marker.exists():
            with self._alone():
                if not marker.exists():
                    self._fill_cache(marker)
        self._load_all()

    def compile_share(self, claims: str) -> None:
        """Compile the kernels that no other process has claimed.

        Parameters
        ----------
        claims : str
            A folder with an empty file for every kernel that is being compiled or done.
        """
        with _rarely_collected():
            for number, load in enumerate(self._kernels()):
                try:
                    (Path(claims) / str(number)).touch(exist_ok=False)
                except FileExistsError:
                    continue
                load()

    def _load_all(self) -> None:
        with _rarely_collected():
            for load in self._kernels():
                load()

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """Wait while another process compiles into the same folder."""
        lock = FileLock(cache_folder() / "lock")
        try:
            lock.acquire(blocking=False)
        except Timeout:
            say("another process compiles the physics kernels; waiting for it")
            lock.acquire()
        except (OSError, NotImplementedError):
            # A file system without locks: each compiles for itself.
            yield
            return
        try:
            yield
        finally:
            lock.release()

    def _fill_cache(self, marker: Path) -> None:
        """Compile everything and leave a mark that all of it is there."""
        start = time.perf_counter()
        say(f"compiling the {self._name}, once for this version and machine (about half a minute)")
        filled = self._compile_in_own_processes()
        self._load_all()
        took = f"compiled in {time.perf_counter() - start:.0f} s"
        if not filled:
            # Results may then differ in the last bit from those of processes that load the cache.
            say("a process that compiled kernels was lost; the next start tries again")
        elif ForgivingCache.complaints:
            say(f"{took} for this process only")
        elif why_temporary():
            say(
                f"{took} for this process only, as {why_temporary()}; "
                "NUMBA_CACHE_DIR may name a folder"
            )
        else:
            try:
                marker.touch()
                say(f"{took}, kept in the kernel cache")
            except OSError as error:
                say(f"{took} for this process only: {error}")

    def _compile_in_own_processes(self) -> bool:
        """Fill the cache; return whether that went well.

        Where no process can be started, this one compiles as it loads.
        """
        if not sys.executable:
            return True
        number = min(numba_config.NUMBA_DEFAULT_NUM_THREADS, _MOST_PROCESSES, len(self._kernels()))
        started: list[subprocess.Popen[bytes]] = []
        with contextlib.ExitStack() as stack:
            try:
                with contextlib.suppress(OSError):
                    claims = tempfile.TemporaryDirectory(
                        dir=cache_folder(), prefix="claims-", ignore_cleanup_errors=True
                    )
                    folder = stack.enter_context(claims)
                    while len(started) < number:
                        started.append(self._start_compiler(folder))
                return all([process.wait() == 0 for process in started])
            except BaseException:
                for process in started:
                    process.kill()
                    process.wait()
                raise

    def _start_compiler(self, claims: str) -> subprocess.Popen[bytes]:
        """Start a process that compiles its share of the kernels."""
        root = str(Path(__file__).parents[3])
        code = (
            f"import sys; sys.path.append({root!r}); "
            f"import {self._module} as module; "
            f"module.{self._attribute}.compile_share({claims!r})"
        )
        return subprocess.Popen(
            [sys.executable, "-P", "-c", code],
            stdin=subprocess.DEVNULL,
            # What stops them stops this process as well, and it says so once.
            stderr=subprocess.DEVNULL,
            env={**os.environ, "NUMBA_CACHE_DIR": str(cache_folder().parent)},
        )
