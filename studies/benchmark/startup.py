"""Start-up: from nothing to the first step, with kernels in the cache and without."""

from __future__ import annotations

import contextlib
import json
import tempfile
from collections.abc import Iterator
from typing import Any

from studies.benchmark.subprocesses import Finished, run_python
from studies.benchmark.timing import Progress, no_progress, spread_of
from swim_env.physics.loading import load_kernels

#: What a start consists of; ``total`` is their sum and ``process`` all that the process took.
PHASES = ("import", "make_and_reset", "first_step", "total", "process")

#: What ``total`` should stay below (s), with the kernels in the cache and without.
_WARM_AIM, _COLD_AIM = 2.0, 25.0

_CODE = """
import time
start = time.perf_counter()
import gymnasium
import swim_env
imported = time.perf_counter()
env = gymnasium.make("swim_env/KirchhoffSwimmer-v0", scene="swimmer")
env.reset(seed=0)
made = time.perf_counter()
env.step(env.action_space.sample())
stepped = time.perf_counter()
import json
print(json.dumps([imported - start, made - imported, stepped - made, stepped - start]))
"""


def _phases(done: Finished) -> dict[str, float]:
    seconds = [*json.loads(done.output.splitlines()[-1]), done.seconds]
    return dict(zip(PHASES, seconds, strict=True))


@contextlib.contextmanager
def _kept_bytecode() -> Iterator[dict[str, str]]:
    """Yield variables for starts that find Python's bytecode, as an installation has it.

    A checkout has it from its second start on, unless PYTHONDONTWRITEBYTECODE is set.
    """
    load_kernels()
    with tempfile.TemporaryDirectory(prefix="swim_env-", ignore_cleanup_errors=True) as folder:
        variables = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": folder}
        run_python(_CODE, variables=variables)
        yield variables


def measure_warm_start(rounds: int, progress: Progress = no_progress) -> dict[str, Any]:
    """Measure starts with the compiled kernels in the cache, each in a process of its own.

    One more start comes first, which does not count. Returns spreads of PHASES (s), ``aim`` for the
    total, and ``met``: whether its median is below.
    """
    runs = []
    with _kept_bytecode() as variables:
        for _ in range(rounds):
            runs.append(_phases(run_python(_CODE, variables=variables)))
            progress(1)
    spreads: dict[str, Any] = {
        phase: spread_of([run[phase] for run in runs]).as_dict() for phase in PHASES
    }
    return {**spreads, "aim": _WARM_AIM, "met": spreads["total"]["median"] < _WARM_AIM}


def measure_cold_start() -> dict[str, Any]:
    """Measure one start with an empty cache, which compiles the kernels.

    Returns PHASES (s); ``aim`` and ``met`` as for `measure_warm_start`; ``announcement``: the lines
    on standard error that say what is happening; ``announced_after``: when the first of them came,
    from the start of the process (s), None without one.
    """
    with (
        tempfile.TemporaryDirectory(prefix="swim_env-", ignore_cleanup_errors=True) as folder,
        _kept_bytecode() as variables,
    ):
        done = run_python(_CODE, variables={**variables, "NUMBA_CACHE_DIR": folder})
    said = [(when, line) for when, line in done.messages if line.startswith("swim_env: ")]
    phases = _phases(done)
    return {
        **phases,
        "aim": _COLD_AIM,
        "met": phases["total"] < _COLD_AIM,
        "announcement": [line for _, line in said],
        "announced_after": said[0][0] if said else None,
    }
