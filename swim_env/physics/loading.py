"""Loading the compiled kernels: once per process, in one order, compiled by a process of its own.

Two entry points that share a callee both bring a copy of it, and a process binds both to the copy
that came first. Copies may differ in the last bit, because the compiler contracts products and
sums differently in different surroundings. For results to be the same to the bit in every process,
kernels are therefore always taken from the cache and always in the same order. A process that
finds the cache empty has another one fill it.
"""

from __future__ import annotations

import functools
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from swim_env.physics._compile import cache_folder
from swim_env.physics.added_mass import FLUID_MODELS, FluidConstants
from swim_env.physics.beam import BeamConstants, centres, centres_of_trajectory
from swim_env.physics.integrator import (
    RECORD_NAMES,
    SolverConstants,
    advance,
    pack_constants,
    state_size,
    weigh,
    work_sizes,
)
from swim_env.physics.outline import LANES, FluidGeometry
from swim_env.physics.panels import LAYERS, influence, normal_influence

__all__ = ["load_kernels"]


@functools.cache
def load_kernels() -> None:
    """Load every kernel that is called from Python; compile them first where that is needed.

    Whoever calls a kernel from Python calls this before. It takes a fraction of a second where
    the cache is filled, and announces on stderr when it is not.
    """
    marker = cache_folder() / "compiled"
    if not marker.exists():
        start = time.perf_counter()
        _say("compiling the physics kernels, once for this version and machine (under a minute)")
        _compile_in_own_process()
        _call_all()
        marker.touch()
        _say(f"compiled in {time.perf_counter() - start:.0f} s, kept in the kernel cache")
    else:
        _call_all()


def _say(message: str) -> None:
    print(f"swim_env: {message}", file=sys.stderr, flush=True)


def _compile_in_own_process() -> None:
    """Fill the cache; where no process can be started, this one compiles as it calls."""
    if not sys.executable:
        return
    root = str(Path(__file__).parents[2])
    code = f"import sys; sys.path.append({root!r}); from swim_env.physics import loading"
    command = [sys.executable, "-P", "-c", f"{code}; loading._call_all()"]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache_folder().parent)}
    try:
        subprocess.run(command, check=False, stdin=subprocess.DEVNULL, env=environment)
    except OSError:
        return


def _call_all() -> None:
    """Call every entry point on a beam of two elements at rest."""
    elements = 2
    unknowns = elements + 2
    beam = BeamConstants(elements, 0.5, 0.1, 1e-3, np.ones(1), np.zeros(1))
    geometry = FluidGeometry(elements, 0.5, 0.01, 1, 1)
    fluid = FluidConstants(FLUID_MODELS["panels"], geometry, 1.0, False)
    solver = SolverConstants(0.01, 1e-10, 1)
    constants = pack_constants(beam, fluid, solver)
    floats, integers = work_sizes(beam, fluid)
    states = np.zeros((1, state_size(elements)))
    work = (np.zeros((1, floats)), np.zeros((1, integers), dtype=np.int64))
    trace = np.zeros((2, 1, 1, unknowns))
    record = np.zeros((1, 1, len(RECORD_NAMES)))
    advance(
        np.zeros(1, dtype=np.int64),
        states,
        np.zeros((1, 1, 1)),
        1,
        *constants,
        work[0],
        work[1],
        trace[0],
        trace[1],
        record,
        np.zeros((1, unknowns)),
        np.zeros((1, 2), dtype=np.int64),
    )
    state = states[0]
    weigh(state, np.zeros(unknowns), False, *constants, work[0][0], work[1][0])
    centres(state[:unknowns], 0.5, np.zeros((elements, 2)))
    centres_of_trajectory(trace[0, 0], 0.5, np.zeros((1, elements, 2)))
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
