"""What an effect costs: the same steps with it and without it, timed in turn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.benchmark.timing import ratio, spread_of, time_in_turn
from swim_env.scene import Scene, load_scene
from swim_env.sim.batch import Bodies, minimal_start
from swim_env.sim.simulator import Simulator

__all__ = ["effect_pairs", "measure_effects"]

Array = NDArray[np.float64]

#: Steps before, in which the body bends, and steps in a timed call.
_STEPS_BEFORE, _STEPS = 200, 100


def effect_pairs() -> dict[str, tuple[Scene, Scene]]:
    """Return for every effect a scene with it and the same scene without it.

    All are scene swimmer, but for two: a body without stiffness collapses under torque, and is
    compared drifting; and damping is taken from the whole scene.
    """
    swimmer = load_scene("swimmer")
    drifting = load_scene("paper_xii").replace("initial.velocity", [0.01, 0.0])
    added: dict[str, Mapping[str, object]] = {
        "axial_added_mass": {"axial_added_mass": True},
        "cross_flow_drag": {"cross_flow_drag.coefficient": 1.0},
        "stream": {"stream.velocity": [0.05, 0.0]},
        "self_contact": {"self_contact": True},
        "internal_forces": {"internal_forces": True},
        "recording": {"recording": True},
    }
    pairs = {
        "bending_stiffness": (drifting, drifting.replace("beam.bending_stiffness", None)),
        "damping": (swimmer, swimmer.replace("damping", None)),
    }
    pairs |= {name: (swimmer.replace(change), swimmer) for name, change in added.items()}
    return pairs


def measure_effects(
    rounds: int, progress: Callable[[int], object] | None = None
) -> list[dict[str, Any]]:
    """Measure what every effect adds to a physics step.

    Parameters
    ----------
    rounds : int
        How often each scene is timed.
    progress : callable, optional
        Called with 1 after every effect.

    Returns
    -------
    list of dict
        ``effect``; spreads in microseconds per step: ``with``, ``without`` and ``added``, their
        difference in the same round; ``removed``, the spread of the ratio of without to with.
    """
    found = []
    for name, (present, absent) in effect_pairs().items():
        calls = {"with": _steps(present), "without": _steps(absent)}
        seconds = time_in_turn(calls, rounds=rounds)
        each = {key: 1e6 / _STEPS * value for key, value in seconds.items()}
        found.append(
            {
                "effect": name,
                "with": spread_of(each["with"]).as_dict(),
                "without": spread_of(each["without"]).as_dict(),
                "added": spread_of(each["with"] - each["without"]).as_dict(),
                "removed": ratio(each["without"], each["with"]).as_dict(),
            }
        )
        if progress is not None:
            progress(1)
    return found


def _steps(scene: Scene) -> Callable[[], object]:
    """Return a call that takes the same steps again and again."""
    bodies = Bodies(scene)
    bodies.start(0, *minimal_start(scene, scene.initial))
    torques = Simulator(scene).prescribed_torques(_STEPS_BEFORE + _STEPS)
    bodies.advance(torques[None, :_STEPS_BEFORE], 1, bodies.new_record(_STEPS_BEFORE))
    begin = bodies.states.copy()
    record = bodies.new_record(_STEPS)
    run = torques[None, _STEPS_BEFORE:]
    # Internal forces go to a trace; the others are compared without one.
    trace: Array | None = None
    if scene.internal_forces is not None:
        trace = np.empty((1, _STEPS, bodies.trace_columns))

    def call() -> None:
        bodies.states[:] = begin
        bodies.begin_recording(0)
        bodies.advance(run, 1, record, trace=trace)

    return call
