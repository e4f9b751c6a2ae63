"""What the parts of a physics step cost, and how it compares with the floor of its arithmetic."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.benchmark.floor import FLOOR_WAYS, floor_calls
from studies.benchmark.timing import Spread, ratio, spread_of, time_in_turn
from swim_env.physics.fluid.models import added_mass, shape_force
from swim_env.physics.fluid.outline import build_outline, outline_status, panel_count
from swim_env.physics.fluid.panel_mass import SMALLEST_PIVOT
from swim_env.physics.fluid.sources import influence, normal_influence
from swim_env.physics.planar.equations import evaluate_step
from swim_env.physics.planar.layout import ADDED, TOTAL
from swim_env.physics.planar.matrix import step_jacobian
from swim_env.physics.runtime.compile import entry_kernel
from swim_env.physics.runtime.dense import copy, invert_in_order, lu_factor, lu_solve
from swim_env.physics.solve.constants import constants_at
from swim_env.physics.solve.prepare import prepare
from swim_env.physics.solve.state import RECORD_NAMES, member_at
from swim_env.scene import Scene
from swim_env.sim.batch import Bodies, minimal_start
from swim_env.sim.simulator import Simulator

Array = NDArray[np.float64]

#: The parts that a step is divided into; what is left of it is "rest".
PARTS = (
    "outline",
    "influence assembly",
    "factorisation",
    "added mass",
    "mass matrix",
    "Newton iterations",
    "shape gradient",
    "rest",
)

#: What is timed by itself, in the order of the codes of `_repeat`; the second with panels only.
_PIECES = ("pose", "whole step", "jacobian", "held step")
_PANEL_PIECES = ("outline", "influence", "factorisation", "added mass", "shape force")
_POSE, _WHOLE_STEP, _JACOBIAN, _HELD_STEP = range(4)
_OUTLINE, _INFLUENCE, _FACTORISATION, _ADDED_MASS, _SHAPE_FORCE = range(4, 9)

#: Length of one timed call of a part (s), and of the run whose steps are timed (s, steps).
_CALL_SECONDS, _RUN_SECONDS = 2e-3, 0.2
_FEWEST_STEPS, _MOST_STEPS = 20, 100
#: Steps before, in which the body bends and the extrapolation gets its history.
_STEPS_BEFORE = 40


@entry_kernel
def _repeat(
    part: int,
    times: int,
    torques: Array,
    constants: NDArray[np.int64],
    place: NDArray[np.int64],
) -> None:
    """Evaluate one part of a step a number of times, at the pose of a state."""
    scene, m = constants_at(constants), member_at(place)
    beam, fluid, solver = scene.beam, scene.fluid, scene.solver
    state, body, work, newton, step = m.state, m.body, m.fluid_work, m.newton, m.step
    q, p, z = state.q, state.p, state.history[0]
    panels = work.outline.panels
    count = panel_count(fluid.geometry)
    h = solver.time_step
    for _ in range(times):
        if part == _POSE:
            # It remembers its pose and the joint angles of its added mass.
            body.mass.known[TOTAL] = 0
            body.mass.known[ADDED] = 0
            prepare(state, beam, fluid, solver, body, work, newton, step.effort)
        elif part == _WHOLE_STEP:
            evaluate_step(p, torques, z, h, False, False, beam, fluid, body, work)
        elif part == _JACOBIAN:
            step_jacobian(h, 0.0, beam, fluid, body, work, newton)
            lu_factor(newton.jacobian, newton.permutation)
        elif part == _HELD_STEP:
            evaluate_step(p, torques, z, h, False, True, beam, fluid, body, work)
            copy(body.balance.residual, newton.correction)
            lu_solve(newton.jacobian, newton.permutation, newton.correction)
        elif part == _OUTLINE:
            build_outline(q[3:], fluid.geometry, work.outline)
            outline_status(fluid.geometry, work.outline)
        elif part == _INFLUENCE:
            influence(panels, count, 1.0, work.half_log, work.layers)
        elif part == _FACTORISATION:
            normal_influence(panels, count, work.layers, work.inverse)
            invert_in_order(work.inverse, SMALLEST_PIVOT)
        elif part == _ADDED_MASS:
            added_mass(q[3:], fluid, work, body.mass.added)
        elif part == _SHAPE_FORCE:
            shape_force(body.inc.motion, fluid, work, body.balance.shape)


def _calibrated(call: Callable[[int], object]) -> tuple[Callable[[], object], int]:
    """Return a call that repeats something often enough to be timed, and how often that is."""
    call(1)
    start = time.perf_counter()
    call(1)
    once = time.perf_counter() - start
    times = int(np.clip(_CALL_SECONDS / max(once, 1e-9), 1, 20_000))
    return partial(call, times), times


def bent_body(scene: Scene, before: int, count: int) -> tuple[Bodies, Array]:
    """Return a body after some steps under its prescribed torques, and those of `count` more.

    The torques (N m) are (1, `count`, N - 1), zero where the scene has none.
    """
    bodies = Bodies(scene)
    bodies.start(0, *minimal_start(scene, scene.initial))
    torques = Simulator(scene).prescribed_torques(before + count)[None]
    bodies.advance(torques[:, :before], 1, bodies.new_record(before))
    return bodies, torques[:, before:]


def measure_parts(scene: Scene, rounds: int) -> dict[str, Any]:
    """Measure the physics step of a scene, driven by its prescribed torques, by part.

    All parts, the whole step and the floor are timed in the same rounds.

    Returns
    -------
    dict
        ``elements``; ``panels_per_element`` (0 without panels); ``fluid_model``; ``scene``, its
        name; ``time_step`` (s); spreads in microseconds per step: ``step``, ``parts`` by name of
        PARTS, ``floor`` (None without panels), and the ratio ``step_to_floor``; ``floor_way``, the
        faster of the floor's two ways; ``iterations``: mean ``corrections`` and ``evaluations`` of
        the shape force in a step; ``real_time``: the simulated seconds per wall second.
    """
    bodies, torques = bent_body(scene, _STEPS_BEFORE, _MOST_STEPS)
    begin = bodies.states.copy()
    start = time.perf_counter()
    bodies.advance(torques[:, -3:], 1, bodies.new_record(3))
    once = (time.perf_counter() - start) / 3
    count = int(np.clip(_RUN_SECONDS / once, _FEWEST_STEPS, _MOST_STEPS))
    run, record = torques[:, :count], bodies.new_record(count)

    def steps(times: int) -> None:
        for _ in range(times):
            bodies.states[:] = begin
            bodies.advance(run, 1, record)

    alone = Bodies(scene)
    alone.states[:] = begin
    given = (torques[0, 0], *alone.member(0))

    def repeat(part: int, times: int) -> None:
        _repeat(part, times, *given)

    for part in (_POSE, _WHOLE_STEP, _JACOBIAN):  # what the others need
        repeat(part, 1)
    with_panels = scene.fluid is not None and scene.fluid.model == "panels"
    repeated: dict[str, Callable[[int], object]] = {"step": steps}
    for code, name in enumerate(_PIECES + (_PANEL_PIECES if with_panels else ())):
        repeated[name] = partial(repeat, code)
    if with_panels:
        repeated |= floor_calls(scene)
    calls = {name: _calibrated(call) for name, call in repeated.items()}
    seconds = time_in_turn({name: call for name, (call, _) in calls.items()}, rounds=rounds)
    each = {name: 1e6 * seconds[name] / times for name, (_, times) in calls.items()}
    each["step"] /= count
    means = record[0].mean(axis=0)
    corrections, evaluations, poses = (
        float(means[RECORD_NAMES.index(name)]) for name in ("iterations", "evaluations", "parts")
    )
    parts = _parts(each, corrections, evaluations, poses)
    step = spread_of(each["step"])
    found = {
        "scene": scene.name,
        "elements": scene.beam.elements,
        "panels_per_element": scene.fluid.panels_per_element if with_panels and scene.fluid else 0,
        "fluid_model": scene.fluid.model if scene.fluid else "none",
        "time_step": scene.integrator.time_step,
        "parts": {name: spread.as_dict() for name, spread in parts.items()},
        "step": step.as_dict(),
        **dict.fromkeys(("floor", "floor_way", "step_to_floor")),
        "iterations": {"corrections": corrections, "evaluations": evaluations},
        "real_time": 1e6 * scene.integrator.time_step / step.median,
    }
    if with_panels:
        way = min(FLOOR_WAYS, key=lambda name: float(np.median(each[name])))
        found["floor"], found["floor_way"] = spread_of(each[way]).as_dict(), way
        found["step_to_floor"] = ratio(each["step"], each[way]).as_dict()
    return found


def _parts(
    each: Mapping[str, Array], corrections: float, evaluations: float, poses: float
) -> dict[str, Spread]:
    """Return what every part takes of a step (us), with the rest that no part accounts for."""
    nothing = np.zeros_like(each["step"])
    outline, influences, factorisation, mass, shape = (
        each.get(name, nothing) for name in _PANEL_PIECES
    )
    amounts = [
        poses * outline,
        poses * influences,
        poses * factorisation,
        poses * (mass - outline - influences - factorisation),
        poses * (each["pose"] - mass),
        # The last evaluation of every part is followed by a correction that is not counted.
        each["jacobian"]
        + (corrections + poses) * each["held step"]
        + evaluations * (each["whole step"] - shape),
        evaluations * shape,
    ]
    amounts.append(each["step"] - sum(amounts, nothing))
    return {name: spread_of(amount) for name, amount in zip(PARTS, amounts, strict=True)}
