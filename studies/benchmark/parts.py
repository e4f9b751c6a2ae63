"""What the parts of a physics step cost, and how it compares with the floor of its arithmetic."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from swim_env.physics.planar.lagrangian import (
    DIRECTION,
    MOTION,
    PREPARED,
    RESIDUAL,
    SHAPE,
    evaluate_held_step,
    evaluate_step,
    step_jacobian,
)
from swim_env.physics.solve.integrator import RECORD_NAMES, member_views, prepare, unpack_constants

from studies.benchmark.floor import floor_calls
from studies.benchmark.timing import Spread, ratio, spread_of, time_in_turn
from swim_env.physics.fluid.added_mass import SMALLEST_PIVOT, added_mass, shape_force
from swim_env.physics.fluid.outline import build_outline, outline_status, panel_count
from swim_env.physics.fluid.panels import influence, normal_influence
from swim_env.physics.runtime.compile import entry_kernel
from swim_env.physics.runtime.dense import copy, invert_in_order, lu_factor, lu_solve
from swim_env.scene import Scene
from swim_env.sim.batch import Bodies, minimal_start
from swim_env.sim.simulator import Simulator

__all__ = ["PARTS", "measure_parts"]

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

(
    _OUTLINE,
    _INFLUENCE,
    _FACTORISATION,
    _ADDED_MASS,
    _POSE,
    _JACOBIAN,
    _HELD_STEP,
    _WHOLE_STEP,
    _SHAPE_FORCE,
    _SET_UP,
) = range(10)
_WITH_PANELS = (_OUTLINE, _INFLUENCE, _FACTORISATION, _ADDED_MASS, _SHAPE_FORCE)
_ALWAYS = (_POSE, _JACOBIAN, _HELD_STEP, _WHOLE_STEP)

#: Length of one timed call of a part (s), and of the run whose steps are timed (s, steps).
_CALL_SECONDS = 2e-3
_RUN_SECONDS = 0.2
_FEWEST_STEPS, _MOST_STEPS = 20, 100
#: Steps before, in which the body bends and the extrapolation gets its history.
_STEPS_BEFORE = 40


@entry_kernel
def _repeat(
    part: int,
    times: int,
    state: Array,
    torques: Array,
    reals: Array,
    sizes: NDArray[np.int64],
    floats: Array,
    integers: NDArray[np.int64],
) -> None:
    """Evaluate one part of a step a number of times, at the pose of a state; set up before."""
    beam, fluid, solver = unpack_constants(reals, sizes)
    m = member_views(state, beam, fluid, floats, integers)
    work = m.fluid_work
    panels = work.outline.panels
    count = panel_count(fluid.geometry)
    unknowns = m.step.unknowns
    h = solver.time_step
    for _ in range(times):
        if part == _OUTLINE:
            build_outline(m.q[3:], fluid.geometry, work.outline)
            outline_status(fluid.geometry, work.outline)
        elif part == _INFLUENCE:
            influence(panels, count, 1.0, work.half_log, work.layers)
        elif part == _FACTORISATION:
            normal_influence(panels, count, work.layers, work.inverse)
            invert_in_order(work.inverse, SMALLEST_PIVOT)
        elif part == _ADDED_MASS:
            added_mass(m.q[3:], fluid, work, m.step.added_mass)
        elif part == _POSE:
            unknowns[PREPARED, 0] = 0.0
            prepare(m.q, m.p, beam, fluid, work, m.step)
        elif part == _JACOBIAN:
            step_jacobian(h, beam, fluid, work, 0.0, m.step)
            lu_factor(m.step.jacobian, m.permutation)
        elif part == _HELD_STEP:
            evaluate_held_step(m.p, torques, m.history[0], h, beam, fluid, m.step)
            copy(unknowns[RESIDUAL], unknowns[DIRECTION])
            lu_solve(m.step.jacobian, m.permutation, unknowns[DIRECTION])
        elif part == _WHOLE_STEP:
            evaluate_step(m.p, torques, m.history[0], h, beam, fluid, work, m.step)
        elif part == _SHAPE_FORCE:
            shape_force(m.step.motions[MOTION], fluid, work, m.step.elements[SHAPE])
        elif part == _SET_UP:
            prepare(m.q, m.p, beam, fluid, work, m.step)
            evaluate_step(m.p, torques, m.history[0], h, beam, fluid, work, m.step)
            step_jacobian(h, beam, fluid, work, 0.0, m.step)
            lu_factor(m.step.jacobian, m.permutation)


def _calibrated(call: Callable[[int], object]) -> tuple[Callable[[], object], int]:
    """Return a call that repeats something often enough to be timed, and how often that is."""
    call(1)
    start = time.perf_counter()
    call(1)
    once = time.perf_counter() - start
    times = int(np.clip(_CALL_SECONDS / max(once, 1e-9), 1, 20_000))
    return partial(call, times), times


def measure_parts(scene: Scene, rounds: int) -> dict[str, Any]:
    """Measure the physics step of a scene, driven by its prescribed torques, by part.

    All parts, the whole step and the floor are timed in the same rounds.

    Parameters
    ----------
    scene : Scene
        The scene.
    rounds : int
        How often each is timed.

    Returns
    -------
    dict
        ``elements``; ``panels_per_element`` (0 without panels); ``fluid_model``; ``scene``, its
        name; ``time_step`` (s); spreads in microseconds per step: ``step``, ``parts`` by name of
        PARTS, ``floor`` (None without panels), and the ratio ``step_to_floor``; ``floor_way``, the
        faster of the floor's two ways; ``iterations``: mean ``corrections`` and ``evaluations`` of
        the shape force in a step; ``real_time``: the simulated seconds per wall second.
    """
    bodies = Bodies(scene)
    bodies.start(0, *minimal_start(scene, scene.initial))
    torques = Simulator(scene).prescribed_torques(_STEPS_BEFORE + _MOST_STEPS)
    bodies.advance(torques[None, :_STEPS_BEFORE], 1, bodies.new_record(_STEPS_BEFORE))
    begin = bodies.states.copy()
    start = time.perf_counter()
    bodies.advance(torques[None, -3:], 1, bodies.new_record(3))
    once = (time.perf_counter() - start) / 3
    count = int(np.clip(_RUN_SECONDS / once, _FEWEST_STEPS, _MOST_STEPS))
    run = torques[None, _STEPS_BEFORE : _STEPS_BEFORE + count]
    record = bodies.new_record(count)

    def steps(times: int) -> None:
        for _ in range(times):
            bodies.states[:] = begin
            bodies.advance(run, 1, record)

    with_panels = scene.fluid is not None and scene.fluid.model == "panels"
    calls: dict[str, tuple[Callable[[], object], int]] = {"step": _calibrated(steps)}
    alone = Bodies(scene)
    alone.states[:] = begin
    given = (alone.states[0], torques[_STEPS_BEFORE], *alone.member(0))
    _repeat(_SET_UP, 1, *given)

    def repeat(part: int, times: int) -> None:
        _repeat(part, times, *given)

    for part in _ALWAYS + (_WITH_PANELS if with_panels else ()):
        calls[str(part)] = _calibrated(partial(repeat, part))
    if with_panels:
        calls.update({way: _calibrated(call) for way, call in floor_calls(scene).items()})
    seconds = time_in_turn({name: call for name, (call, _) in calls.items()}, rounds=rounds)
    each = {name: 1e6 * seconds[name] / times for name, (_, times) in calls.items()}
    each["step"] /= count
    corrections, evaluations, poses = (
        float(record[0, :, RECORD_NAMES.index(name)].mean())
        for name in ("iterations", "evaluations", "parts")
    )
    parts = _parts(each, corrections, evaluations, poses, with_panels)
    floor: Array | None = None
    way: str | None = None
    if with_panels:
        way = min(("elimination", "inverse"), key=lambda name: float(np.median(each[name])))
        floor = each[way]
    step = spread_of(each["step"])
    return {
        "scene": scene.name,
        "elements": scene.beam.elements,
        "panels_per_element": scene.fluid.panels_per_element if with_panels and scene.fluid else 0,
        "fluid_model": scene.fluid.model if scene.fluid else "none",
        "time_step": scene.integrator.time_step,
        "parts": {name: spread.as_dict() for name, spread in parts.items()},
        "step": step.as_dict(),
        "floor": None if floor is None else spread_of(floor).as_dict(),
        "floor_way": way,
        "step_to_floor": None if floor is None else ratio(each["step"], floor).as_dict(),
        "iterations": {"corrections": corrections, "evaluations": evaluations},
        "real_time": 1e6 * scene.integrator.time_step / step.median,
    }


def _parts(
    each: dict[str, Array],
    corrections: float,
    evaluations: float,
    poses: float,
    with_panels: bool,
) -> dict[str, Spread]:
    """Return what every part takes of a step (us), with the rest that no part accounts for."""
    nothing = np.zeros_like(each["step"])

    def of(part: int) -> Array:
        return each.get(str(part), nothing)

    fluid = of(_ADDED_MASS)
    panels = of(_OUTLINE) + of(_INFLUENCE) + of(_FACTORISATION)
    # The last evaluation of every part is followed by a correction that is not counted.
    newton = (
        of(_JACOBIAN)
        + (corrections + poses) * of(_HELD_STEP)
        + evaluations * (of(_WHOLE_STEP) - of(_SHAPE_FORCE))
    )
    amounts = [
        poses * of(_OUTLINE),
        poses * of(_INFLUENCE),
        poses * of(_FACTORISATION),
        poses * (fluid - panels) if with_panels else nothing,
        poses * (of(_POSE) - fluid),
        newton,
        evaluations * of(_SHAPE_FORCE),
    ]
    amounts.append(each["step"] - sum(amounts, nothing))
    return {name: spread_of(amount) for name, amount in zip(PARTS, amounts, strict=True)}
