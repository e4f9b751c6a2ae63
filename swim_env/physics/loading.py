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
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
from filelock import FileLock, Timeout
from numba.core import config as numba_config
from numpy.typing import NDArray

from swim_env.physics.fluid.layout import FluidConstants
from swim_env.physics.fluid.models import fluid_constants
from swim_env.physics.fluid.outline import FluidGeometry
from swim_env.physics.fluid.sources import LAYERS, influence, normal_influence
from swim_env.physics.planar.chain import BeamConstants, centres, centres_of_trajectory
from swim_env.physics.planar.equations import (
    evaluate_adjoint_step,
    evaluate_held_step,
    evaluate_step,
)
from swim_env.physics.planar.matrix import adjoint_jacobian, step_jacobian
from swim_env.physics.runtime.cache import ForgivingCache, cache_folder, say, why_temporary
from swim_env.physics.runtime.views import LANES
from swim_env.physics.solve.advance import advance, energy_and_velocity, momentum_of_velocity
from swim_env.physics.solve.constants import Constants, SolverConstants, pack_constants
from swim_env.physics.solve.prepare import prepare
from swim_env.physics.solve.state import RECORD_NAMES, Member, member_views, state_size, work_sizes

Array = NDArray[np.float64]


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
    _call_all()


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
        # A file system without locks: each compiles for itself, as before.
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
    _call_all()
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

    Where no process can be started, this one compiles as it calls.

    Two processes compile at the same time: first a half each of what a step calls, then what calls
    both halves, which takes them from the cache, and the rest.
    """
    if not sys.executable:
        return True
    well = True
    root = str(Path(__file__).parents[2])
    setup = f"import sys; sys.path.append({root!r}); from swim_env.physics import loading"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache_folder().parent)}
    for together in ((_compile_pose, _compile_motion), (_call_advance, _call_others)):
        started = []
        try:
            for function in together:
                code = f"{setup}; loading.{function.__name__}()"
                command = [sys.executable, "-P", "-c", code]
                started.append(
                    subprocess.Popen(
                        command,
                        stdin=subprocess.DEVNULL,
                        # What stops them stops this process as well, and it says so once.
                        stderr=subprocess.DEVNULL,
                        env=environment,
                    )
                )
        except OSError:
            pass
        try:
            well = all([process.wait() == 0 for process in started]) and well
        except BaseException:
            for process in started:
                process.kill()
                process.wait()
            raise
    return well


class _Sample(NamedTuple):
    """A beam of two elements at rest, to compile for and to call with."""

    beam: BeamConstants
    fluid: FluidConstants
    solver: SolverConstants
    constants: Constants
    states: Array
    floats: Array
    integers: NDArray[np.int64]


def _sample() -> _Sample:
    elements = 2
    beam = BeamConstants(elements, 0.5, 0.1, 1e-3, np.ones(1), np.zeros(1))
    geometry = FluidGeometry(elements, 0.5, 0.01, 1, 1)
    fluid = fluid_constants("panels", geometry, 1.0)
    solver = SolverConstants(0.01, 1e-10)
    constants = pack_constants(beam, fluid, solver)
    floats, integers = work_sizes(beam, fluid)
    return _Sample(
        beam,
        fluid,
        solver,
        constants,
        np.zeros((1, state_size(elements))),
        np.zeros((1, floats)),
        np.zeros((1, integers), dtype=np.int64),
    )


def _compile(kernel: Any, *arguments: object) -> None:
    """Compile a kernel for arguments like these, and keep it in the cache."""
    kernel.compile(tuple(numba.typeof(argument) for argument in arguments))


def _views(one: _Sample) -> Member:
    return member_views(one.states[0], one.beam, one.fluid, one.floats[0], one.integers[0])[0]


def _compile_pose() -> None:
    """Compile what evaluates a pose."""
    one = _sample()
    m = _views(one)
    scene = (one.beam, one.fluid, one.solver)
    work = (m.body, m.fluid_buffers, m.newton, m.step.effort)
    _compile(prepare, m.state, *scene, *work)


def _compile_motion() -> None:
    """Compile what evaluates the equations of a step and their Jacobian."""
    one = _sample()
    m = _views(one)
    scene = (one.beam, one.fluid, m.body)
    step = (m.state.p, m.state.p, m.state.p, 0.01)
    _compile(evaluate_step, *step, *scene, m.fluid_buffers)
    _compile(evaluate_held_step, *step, *scene)
    _compile(evaluate_adjoint_step, *step, *scene)
    _compile(step_jacobian, 0.01, 0.0, *scene, m.fluid_buffers, m.newton)
    _compile(adjoint_jacobian, 0.01, *scene, m.newton)


def _call_all() -> None:
    """Call every entry point."""
    _call_advance()
    _call_others()


def _call_advance() -> None:
    one = _sample()
    unknowns = one.beam.elements + 2
    advance(
        np.zeros(1, dtype=np.int64),
        one.states,
        np.zeros((1, 1, 1)),
        1,
        *one.constants,
        one.floats,
        one.integers,
        np.zeros((1, 1, 2 * unknowns)),
        np.zeros((1, 1, len(RECORD_NAMES))),
        np.zeros((1, unknowns)),
        np.zeros((1, 2), dtype=np.int64),
    )


def _call_others() -> None:
    one = _sample()
    elements = one.beam.elements
    unknowns = elements + 2
    state = one.states[0]
    for call in (energy_and_velocity, momentum_of_velocity):
        call(state, np.zeros(unknowns), *one.constants, one.floats[0], one.integers[0])
    centres(state[:unknowns], 0.5, np.zeros((elements, 2)))
    centres_of_trajectory(np.zeros((1, unknowns)), 0.5, np.zeros((1, elements, 2)))
    corners = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    following = np.roll(corners, -1, axis=1)
    edges = following - corners
    length = np.hypot(*edges)
    sides = np.concatenate([corners, 0.5 * (corners + following), edges / length, length[None, :]])
    panels = np.zeros((len(sides), LANES))
    panels[:, :3] = sides
    layers = np.zeros((LAYERS, LANES, LANES))
    influence(panels, 3, 1.0, np.empty(LANES + 1), layers)
    normal_influence(panels, 3, layers, np.empty((LANES, LANES)))
