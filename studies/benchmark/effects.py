"""What an effect costs: the same steps with it and without it, timed in turn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from studies.benchmark.parts import bent_body
from studies.benchmark.timing import Progress, no_progress, ratio, spread_of, time_in_turn
from swim_env.scene import Scene, load_scene

#: Steps that bend the body before anything is timed, and steps in a timed call.
_STEPS_BEFORE, _STEPS = 200, 100


def effect_pairs() -> dict[str, tuple[Scene, Scene]]:
    """Return for every effect a scene with it and the same scene without it.

    All are scene swimmer but one: a body without stiffness collapses under torque, and is compared
    drifting. Damping is taken away from scene swimmer, the other effects are added to it.
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
    return {
        "bending_stiffness": (drifting, drifting.replace("beam.bending_stiffness", None)),
        "damping": (swimmer, swimmer.replace("damping", None)),
        **{name: (swimmer.replace(change), swimmer) for name, change in added.items()},
    }


def measure_effects(rounds: int, progress: Progress = no_progress) -> list[dict[str, Any]]:
    """Measure what every effect adds to a physics step; `progress` is called after each.

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
        each["added"] = each["with"] - each["without"]
        spreads = {key: spread_of(values).as_dict() for key, values in each.items()}
        removed = ratio(each["without"], each["with"]).as_dict()
        found.append({"effect": name, **spreads, "removed": removed})
        progress(1)
    return found


def _steps(scene: Scene) -> Callable[[], object]:
    """Return a call that takes the same steps again and again."""
    bodies, torques = bent_body(scene, _STEPS_BEFORE, _STEPS)
    begin = bodies.states.copy()
    record = bodies.new_record(_STEPS)
    # Internal forces are written to a trace; the other effects are compared without one.
    with_trace = scene.internal_forces is not None
    trace = np.empty((1, _STEPS, bodies.trace_columns)) if with_trace else None

    def call() -> None:
        bodies.states[:] = begin
        bodies.begin_recording(0)
        bodies.advance(torques, 1, record, trace=trace)

    return call
