"""Loads the compiled kernels once per process, in one order; separate processes compile them.

Two entry points that share a callee both bring a copy of it, and a process binds both to the copy
that came first. Copies may differ in the last bit, because the compiler contracts products and
sums differently in different surroundings. For results to be the same to the bit in every process,
kernels are therefore always taken from the cache and always in the same order. A process that
finds the cache empty has another one fill it.
"""

from __future__ import annotations

import contextlib
import functools
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
import numpy as np
from filelock import FileLock, Timeout
from numba.core import config as numba_config

from swim_env.physics.fluid.models import MODELS, SAMPLE, added_mass, linked_kernels, shape_force
from swim_env.physics.fluid.sources import influence, normal_influence
from swim_env.physics.planar.chain import BeamConstants, centres, centres_of_trajectory
from swim_env.physics.planar.equations import evaluate_step
from swim_env.physics.planar.matrix import adjoint_jacobian, step_jacobian
from swim_env.physics.runtime.cache import ForgivingCache, cache_folder, say, why_temporary
from swim_env.physics.solve.advance import advance, energy_and_velocity, momentum_of_velocity
from swim_env.physics.solve.constants import SolverConstants, pack_constants
from swim_env.physics.solve.newton import newton_in_passes, newton_with_shortening
from swim_env.physics.solve.prepare import prepare
from swim_env.physics.solve.state import member_views, state_size, work_sizes


@functools.cache
def load_kernels() -> None:
    """Load every kernel that is called from Python; compile them first where that is needed.

    Call this before calling a kernel from Python. It takes a fraction of a second where
    the cache is filled, and announces on stderr when it is not. Of several processes that find it
    empty one compiles, and the others wait for it.
    """
    if numba_config.DISABLE_JIT:
        say("NUMBA_DISABLE_JIT is set: the kernels run as Python, a thousand times slower")
        return
    marker = cache_folder() / "compiled"
    if not marker.exists():
        with _alone():
            if not marker.exists():
                _fill_cache(marker)
    _load_all()


@contextlib.contextmanager
def _alone() -> Iterator[None]:
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


def _fill_cache(marker: Path) -> None:
    """Compile everything and leave a mark that all of it is there."""
    start = time.perf_counter()
    say("compiling the physics kernels, once for this version and machine (half a minute)")
    filled = _compile_in_own_processes()
    _load_all()
    took = f"compiled in {time.perf_counter() - start:.0f} s"
    if not filled:
        # Results may then differ in the last bit from those of processes that load the cache.
        say("a process that compiled kernels was lost; the next start tries again")
    elif ForgivingCache.complaints:
        say(f"{took} for this process only")
    elif why_temporary():
        say(
            f"{took} for this process only, as {why_temporary()}; NUMBA_CACHE_DIR may name a folder"
        )
    else:
        try:
            marker.touch()
            say(f"{took}, kept in the kernel cache")
        except OSError as error:
            say(f"{took} for this process only: {error}")


def _compile_in_own_processes() -> bool:
    """Fill the cache; return whether that went well.

    Where no process can be started, this one compiles as it loads. Otherwise two processes compile
    one half of the kernels each.
    """
    if not sys.executable:
        return True
    root = str(Path(__file__).parents[2])
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache_folder().parent)}
    started = []
    try:
        for half in range(2):
            code = (
                f"import sys; sys.path.append({root!r}); from swim_env.physics import loading; "
                f"loading.compile_half({half})"
            )
            started.append(
                subprocess.Popen(
                    [sys.executable, "-P", "-c", code],
                    stdin=subprocess.DEVNULL,
                    # What stops them stops this process as well, and it says so once.
                    stderr=subprocess.DEVNULL,
                    env=environment,
                )
            )
    except OSError:
        pass
    try:
        return all([process.wait() == 0 for process in started])
    except BaseException:
        for process in started:
            process.kill()
            process.wait()
        raise


def compile_half(half: int) -> None:
    """Compile the kernels of the first or the second half, which take about as long."""
    for load in _kernels()[half]:
        load()


def _load_all() -> None:
    first, second = _kernels()
    for load in (*first, *second):
        load()


def _kernels() -> tuple[list[Callable[[], None]], list[Callable[[], None]]]:
    """Return what compiles each kernel or takes it from the cache, in two halves.

    All kernels that others call at an address, and all that Python calls.
    """
    elements = 2
    beam = BeamConstants(elements, 0.5, 0.1, 1e-3, np.ones(1), np.zeros(1))
    fluid, solver = SAMPLE, SolverConstants(0.01, 1e-10)
    constants = pack_constants(beam, fluid, solver)
    sizes = work_sizes(beam, fluid)
    states, numbers = np.zeros((1, state_size(elements))), np.zeros(1, dtype=np.int64)
    floats, integers = np.zeros((1, sizes[0])), np.zeros((1, sizes[1]), dtype=np.int64)
    m, _ = member_views(states[0], beam, fluid, floats[0], integers[0])
    row, rows, steps = np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1, 1))
    whole, scene = (beam, fluid, solver), (beam, fluid, m.body)
    mass = m.body.mass.added

    def linked(kernel: Any, *arguments: object) -> Callable[[], None]:
        kernel.linked.declare(*arguments)
        return kernel.linked.load  # type: ignore[no-any-return]

    def entry(kernel: Any, *arguments: object) -> Callable[[], None]:
        return functools.partial(kernel.compile, tuple(map(numba.typeof, arguments)))

    of_a_state = (row, row, *constants, row, numbers)
    first = [
        linked(evaluate_step, row, row, row, 0.01, True, True, *scene, m.fluid_buffers),
        linked(prepare, m.state, *whole, m.body, m.fluid_buffers, m.newton, m.step.effort),
        linked(step_jacobian, 0.01, 0.0, *scene, m.fluid_buffers, m.newton),
        linked(adjoint_jacobian, 0.01, *scene, m.newton),
        entry(
            advance,
            *(numbers, rows, steps, 1, *constants, rows, integers),
            *(steps, steps, rows, integers),
        ),
        entry(energy_and_velocity, *of_a_state),
        entry(momentum_of_velocity, *of_a_state),
    ]
    second = [
        linked(newton_in_passes, m, row, 0.01, True, *whole, True),
        linked(newton_with_shortening, m, row, 0.01, True, *whole),
        linked(added_mass, row, fluid, m.fluid_buffers, mass),
        linked(shape_force, row, fluid, m.fluid_buffers, row),
        *(one.load for model in MODELS for one in linked_kernels(model)),
        entry(centres, row, 0.5, rows),
        entry(centres_of_trajectory, rows, 0.5, steps),
        entry(influence, rows, 3, 1.0, row, steps),
        entry(normal_influence, rows, 3, steps, rows),
    ]
    return first, second
