"""Two checkouts of this project, timed against each other, to see if the new one is slower.

Each runs in a process of its own that waits for its turn. In every round both play the same steps
of the same scene, and which one begins changes from round to round. What counts is the time that
the process itself had the processor.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from studies.benchmark.timing import ratio, spread_of
from swim_env.errors import SwimError

__all__ = ["EASY_SCENES", "compare_checkouts"]

#: Runs by name: scene, changes to it, and steps. Only what every version of the project knows.
EASY_SCENES: dict[str, tuple[str, dict[str, object], int]] = {
    "paper_i": ("paper_i", {}, 100),
    "swimmer": ("swimmer", {}, 100),
    "27 elements": ("paper_i", {"beam.elements": 27}, 15),
    "no fluid": ("paper_i", {"fluid": None}, 400),
    "passive": ("paper_x", {}, 100),
}

# What a process does: it builds every scene, says so, and times whatever it is asked for.
_WORKER = """
import sys, time
sys.path.insert(0, sys.argv[1])
import swim_env
if not swim_env.__file__.startswith(sys.argv[1]):
    sys.exit("swim_env was found in " + swim_env.__file__)
from swim_env import Simulator, load_scene
runs = {}
for name, (scene, changes, steps) in eval(sys.argv[2]).items():
    simulator = Simulator(load_scene(scene, changes))
    runs[name] = (simulator, simulator.prescribed_torques(steps))
print("ready", flush=True)
for line in sys.stdin:
    simulator, torques = runs[line.strip()]
    simulator.reset()
    start = time.thread_time()
    trajectory = simulator.rollout(torques)
    print(time.thread_time() - start, trajectory.termination_reason, flush=True)
"""


def compare_checkouts(
    before: str | os.PathLike[str],
    rounds: int = 101,
    progress: Callable[[int], object] | None = None,
) -> dict[str, Any]:
    """Time this checkout against another one.

    Parameters
    ----------
    before : path
        The folder of the other one, with the package ``swim_env`` in it.
    rounds : int
        How often each plays each scene.
    progress : callable, optional
        Called with 1 after every round of every scene.

    Returns
    -------
    dict
        By scene: ``before`` and ``after``, microseconds a step as spreads, ``ratio``, the spread of
        after/before in the same round, and ``ratio_of_smallest``.

    Raises
    ------
    SwimError
        If there is no such checkout, or one of the two fails.
    """
    there = Path(before).resolve()
    here = Path(__file__).parents[2]
    if not (there / "swim_env" / "__init__.py").is_file():
        raise SwimError(f"no package swim_env in the folder to compare with ({there})")
    if there == here:
        raise SwimError(f"the folder to compare with is this checkout itself ({there})")
    found: dict[str, Any] = {}
    with _Worker(there) as old, _Worker(here) as new:
        for name, (_, _, steps) in EASY_SCENES.items():
            seconds = np.empty((2, rounds))
            for index in range(rounds):
                pair = (old, new) if index % 2 == 0 else (new, old)
                for worker in pair:
                    seconds[0 if worker is old else 1, index] = worker.seconds(name)
                if progress is not None:
                    progress(1)
            each = 1e6 * seconds / steps
            found[name] = {
                "before": spread_of(each[0]).as_dict(),
                "after": spread_of(each[1]).as_dict(),
                "ratio": ratio(seconds[1], seconds[0]).as_dict(),
                "ratio_of_smallest": float(seconds[1].min() / seconds[0].min()),
            }
    return found


class _Worker:
    """A process that times one checkout on demand."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _WORKER, str(folder), repr(EASY_SCENES)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> _Worker:
        try:
            self._answer()
            # The first of each warms up.
            for name in EASY_SCENES:
                self.seconds(name)
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._end()

    def seconds(self, name: str) -> float:
        """Return how long the checkout took for a scene (s)."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(name + "\n")
            self._process.stdin.flush()
        except OSError:
            pass
        text, *reason = self._answer().split()
        if reason:
            raise SwimError(f"scene {name} ended with {reason[0]} in {self._folder}")
        return float(text)

    def _answer(self) -> str:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise SwimError(f"the checkout could not be timed, see above ({self._folder})")
        return line

    def _end(self) -> None:
        self._process.kill()
        self._process.communicate()
