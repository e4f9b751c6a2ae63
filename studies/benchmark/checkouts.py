"""Two checkouts of this project, timed against each other, to see if the new one is slower.

Each runs in a process of its own that waits for its turn. In every round both play the same steps
of the same scene, and they take turns in being the first. The time that counts is the processor
time of the process itself.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np

from studies.benchmark.timing import Progress, no_progress, ratio, spread_of
from swim_env.errors import SwimError

#: Runs by name: scene, changes to it, and steps. Only what every version of the project knows.
EASY_SCENES: dict[str, tuple[str, dict[str, object], int]] = {
    "paper_i": ("paper_i", {}, 100),
    "swimmer": ("swimmer", {}, 100),
    "27 elements": ("paper_i", {"beam.elements": 27}, 15),
    "no fluid": ("paper_i", {"fluid": None}, 400),
    "passive": ("paper_x", {}, 100),
}

# A process builds every scene, says so, and times whatever it is asked for.
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
    before: str | os.PathLike[str], rounds: int = 101, progress: Progress = no_progress
) -> dict[str, Any]:
    """Time this checkout against the one in another folder, each scene `rounds` times.

    Returns by scene ``before`` and ``after``, microseconds a step as spreads, ``ratio``, the spread
    of after/before in the same round, and ``ratio_of_smallest``. If there is no such checkout, or
    one of the two fails, it is a SwimError.
    """
    there, here = Path(before).resolve(), Path(__file__).parents[2]
    if not (there / "swim_env" / "__init__.py").is_file():
        raise SwimError(f"no package swim_env in the folder to compare with ({there})")
    if there == here:
        raise SwimError(f"the folder to compare with is this checkout itself ({there})")
    found: dict[str, Any] = {}
    with ExitStack() as stack:
        workers = [_start(folder, stack) for folder in (there, here)]
        for name, (_, _, steps) in EASY_SCENES.items():
            seconds = np.empty((2, rounds))
            for index in range(rounds):
                for which in (0, 1) if index % 2 == 0 else (1, 0):
                    seconds[which, index] = workers[which](name)
                progress(1)
            old, new = 1e6 * seconds / steps
            found[name] = {
                "before": spread_of(old).as_dict(),
                "after": spread_of(new).as_dict(),
                "ratio": ratio(new, old).as_dict(),
                "ratio_of_smallest": float(new.min() / old.min()),
            }
    return found


def _start(folder: Path, stack: ExitStack) -> Callable[[str], float]:
    """Start a process that a stack ends; returns what gives the seconds of a scene's steps."""
    command = [sys.executable, "-P", "-c", _WORKER, str(folder), repr(EASY_SCENES)]
    pipe = subprocess.PIPE
    process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)
    assert process.stdin is not None and process.stdout is not None
    questions, answers = process.stdin, process.stdout
    stack.callback(process.communicate)
    stack.callback(process.kill)

    def answer() -> str:
        line = answers.readline()
        if not line:
            raise SwimError(f"the checkout could not be timed, see above ({folder})")
        return line

    def seconds(name: str) -> float:
        with suppress(OSError):  # it has died, and has no answer
            questions.write(name + "\n")
            questions.flush()
        text, *reason = answer().split()
        if reason:
            raise SwimError(f"scene {name} ended with {reason[0]} in {folder}")
        return float(text)

    answer()
    for name in EASY_SCENES:  # the first of each warms up
        seconds(name)
    return seconds
