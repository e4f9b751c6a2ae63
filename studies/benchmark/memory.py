"""Memory of the environments: what their arrays hold, and what a process grows by."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from studies.benchmark.subprocesses import run_python
from swim_env.envs.vector import SwimVectorEnv
from swim_env.scene import Scene, load_scene

_MANY_ELEMENTS = 81


def measure_memory(
    scene: Scene | str = "swimmer", members: tuple[int, ...] = (1, 64, 256)
) -> dict[str, Any]:
    """Measure what batches of a scene need, of rising numbers of members, at least two.

    Returns
    -------
    dict
        ``arrays``: by number of members the ``bytes`` that the batch's arrays hold, the
        ``bytes_per_member`` between the two largest batches, the ``fixed_bytes`` beside them, and
        ``linearity``, the largest relative deviation from that straight line; ``resident``, None
        where the system does not say: the bytes of a ``process`` after a first batch of one member
        has taken steps, and its ``growth``, by number of members, with every further batch; and
        the ``bytes_per_member`` of the same scene with 81 elements under ``many_elements``.
    """
    scene = load_scene(scene)
    sizes = {count: _held_bytes(SwimVectorEnv(count, scene)) for count in members}
    small, large = members[-2:]
    slope = (sizes[large] - sizes[small]) / (large - small)
    fixed = sizes[large] - slope * large
    deviation = max(abs(size - fixed - slope * count) / size for count, size in sizes.items())
    fine = scene.replace("beam.elements", _MANY_ELEMENTS)
    one, two = (_held_bytes(SwimVectorEnv(count, fine)) for count in (1, 2))
    return {
        "scene": scene.name,
        "elements": scene.beam.elements,
        "arrays": {
            "bytes": {str(count): size for count, size in sizes.items()},
            "bytes_per_member": slope,
            "fixed_bytes": fixed,
            "linearity": deviation,
        },
        "resident": _resident(scene.name, members),
        "many_elements": {"elements": _MANY_ELEMENTS, "bytes_per_member": two - one},
    }


def _held_bytes(envs: SwimVectorEnv) -> int:
    """Return the bytes of all arrays that a batch holds: states, work space, results, constants."""
    found: dict[int, int] = {}
    values = [*vars(envs.episodes).values(), *vars(envs.episodes.bodies).values()]
    while values:
        value = values.pop()
        if isinstance(value, np.ndarray):
            # Views count as the whole that they are part of, and that once.
            while isinstance(value.base, np.ndarray):
                value = value.base
            found[id(value)] = value.nbytes
        elif isinstance(value, (list, tuple)):
            values += value
    return sum(found.values())


_RESIDENT_CODE = """
import json
import os
import sys
import numpy as np
import swim_env

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

scene, *members = json.loads(sys.argv[1])
held, sizes = [], []
for count in (1, *members):
    envs = swim_env.SwimVectorEnv(count, scene, num_threads=1)
    envs.reset(seed=0)
    for _ in range(3):
        envs.step(np.zeros(envs.action_space.shape))
    held.append(envs)
    sizes.append(resident())
print(json.dumps({"process": sizes[0], "growth": dict(zip(members, np.diff(sizes).tolist()))}))
"""


def _resident(scene: str, members: tuple[int, ...]) -> dict[str, Any] | None:
    if not Path("/proc/self/statm").exists():
        return None
    found: dict[str, Any] = json.loads(run_python(_RESIDENT_CODE, json.dumps([scene, *members]))[0])
    return found
