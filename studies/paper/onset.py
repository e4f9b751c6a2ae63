"""When the straight body leaves its line, compared with the paper's times and Kirchhoff's rate."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import brentq, minimize_scalar

from studies.kirchhoff import RigidMass, growth_rate, rigid_mass
from studies.paper.runs import LEFT_LINE, first_crossing
from studies.paper.units import Arrays, Figures, Unit
from swim_env.analysis.modes import mass_matrix
from swim_env.scene import Scene, load_scene
from swim_env.sim.simulator import Simulator

Array = NDArray[np.float64]

SPEED = 0.1
#: The paper's three perturbations: the floating-point accuracy, a small velocity, a linear one.
LATERAL = {"epsilon": 2.2e-16, "small": 1e-4, "sloped": 1e-5}
STIFFNESS = (5.0, 10.0, 1e2, 1e3, 1e4)
#: First deviation (s) as the paper has it, by elements, panels and perturbation.
PAPER_TIMES: dict[tuple[int, int, str], float] = {
    (*body, kind): time
    for body, times in {
        (3, 12): (35.13, 2.13, 3.8),
        (9, 4): (78.1, 4.4, 9.91),
        (9, 12): (78.03, 4.37, 9.86),
        (27, 4): (82.04, 5.26, 4.59),
    }.items()
    for kind, time in zip(LATERAL, times, strict=True)
}
#: Elements and panels of the paper's scenes x, xi and xii.
PAPER_BODIES = {"x": (3, 12), "xi": (9, 4), "xii": (27, 4)}
#: Longest run (s), and that of one that should stay on its line for ever.
LONGEST, STRAIGHT = 300.0, 100.0
#: Wall time of a step (s) by elements and panels, for guesses of cost.
_STEP = {(3, 4): 3e-5, (3, 12): 7e-5, (9, 4): 1e-4, (9, 12): 5e-4, (27, 4): 5e-4, (27, 12): 6e-3}
#: Between these angles (rad) growth is that of the linear equations: above rounding, below bends.
_LINEAR = 0.02
#: Angles below this share of the largest have the weight of that share in the fit.
_EARLY = 1e-2
_BLOCK = 200


def onset_units(quick: bool = False) -> list[Unit]:
    """Return the study: perturbations x elements x panels x stiffness, finer runs, and controls.

    Steps of 27 elements with 12 panels take several milliseconds each. Where the perturbation is so
    small that it takes minutes to grow, that body has panels at both ends of the stiffness alone,
    and in between the constant added mass of the straight body (`frozen`, the same while the body
    is straight); so has its run with half the step.
    """
    units = []
    counts = (3, 9) if quick else (3, 9, 27)
    stiffnesses = (5.0, 1e4) if quick else STIFFNESS
    kinds = ("small", "sloped") if quick else tuple(LATERAL)
    for elements, panels, stiffness, kind in itertools.product(counts, (4, 12), stiffnesses, kinds):
        long = kind == "epsilon" and (elements, panels) == (27, 12)
        model = "frozen" if long and stiffness not in (5.0, 1e4) else "panels"
        units.append(_unit(elements, panels, stiffness, kind, model))
        if stiffness == 5.0:
            finer = "frozen" if long else model
            units.append(_unit(elements, panels, stiffness, kind, finer, step=0.005))
    if not quick:
        # That frozen is the same is measured, not assumed.
        units += [_unit(27, 12, stiffness, "epsilon", "frozen") for stiffness in (5.0, 1e4)]
    units += [_unit(n, panels, 5.0, "none") for n in counts for panels in (4, 12)]
    return units


def _unit(
    elements: int,
    panels: int,
    stiffness: float,
    kind: str,
    model: str = "panels",
    step: float = 0.01,
) -> Unit:
    scene = perturbed(elements, panels, stiffness, kind)
    scene = scene.replace({"fluid.model": model, "integrator.time_step": step})
    name = f"onset_{kind}_{elements}_{panels}_{stiffness:g}"
    name += "" if model == "panels" else f"_{model}"
    name += "" if step == 0.01 else "_half"
    seconds = {"epsilon": 275.0, "none": STRAIGHT}.get(kind, 10.0)
    each = _STEP[elements, panels] if model == "panels" else 5e-5
    options = {
        "elements": elements,
        "panels": panels,
        "stiffness": stiffness,
        "perturbation": kind,
        "model": model,
        "step": step,
        "duration": STRAIGHT if kind == "none" else LONGEST,
    }
    return Unit(name, measure_onset, scene, options, seconds / step * each)


def perturbed(elements: int, panels: int, stiffness: float, kind: str) -> Scene:
    """Return the straight body with one of the paper's initial velocities.

    The third one, (3.5 - x/dl) 1e-5 across, is a uniform part and a slope, which is also the
    turning rate: without it the velocities would break (15). The print divides x by the time step,
    which is taken for a slip: x is counted in elements here, from the head, as s/dl is in the
    caption of the paper's Fig. 6.
    """
    start: dict[str, Any] = {"velocity": [SPEED, LATERAL.get(kind, 0.0)]}
    if kind == "sloped":
        slope = -LATERAL[kind] * elements
        start = {"velocity": [SPEED, 3.5 * LATERAL[kind]], "velocity_slope": slope}
    body = {"beam.elements": elements, "beam.bending_stiffness": stiffness}
    return load_scene("paper_x", {**body, "fluid.panels_per_element": panels, "initial": start})


def measure_onset(unit: Unit) -> tuple[Figures, Arrays]:
    """Simulate a perturbed straight body until an end has left its line.

    The figures are the unit's options, and ``time`` of the first deviation of 1 % (s, between
    steps) or None, ``end`` (why the run ended early, or empty), ``rate`` the growth that was fitted
    (1/s) or None, ``kirchhoff`` its analytic value and ``expected`` the time by the linear
    equations (s), both with the discrete body's own masses; ``largest_angle`` (rad) and
    ``largest_offset`` (m) of an end over the whole run, ``lateral`` of the centre (m/s).
    """
    simulator = Simulator(unit.scene)
    mass = rigid_mass(mass_matrix(simulator))
    length = unit.scene.beam.length
    moving = simulator.velocity()
    step = simulator.time_step
    steps = round(float(unit.options["duration"]) / step)
    watch_all = unit.options["perturbation"] == "none"
    times, angles, offsets, bends = ([np.zeros(1)] for _ in range(4))
    first: Array | None = None
    left = None
    while simulator.steps < steps and not simulator.termination_reason:
        count = min(_BLOCK, steps - simulator.steps)
        part = simulator.rollout(np.zeros((count, simulator.elements - 1)))
        ends = part.nodes[:, [0, -1], 1]
        first = ends[0] if first is None else first
        off = np.abs(ends - first).max(axis=1)[1:]
        times.append(part.time[1:])
        angles.append(part.angles.mean(axis=1)[1:])
        bends.append(np.abs(part.angles).max(axis=1)[1:])
        offsets.append(off)
        if left is None:
            # From the last instant of the block before.
            line = np.concatenate([offsets[-2][-1:], off])
            left = first_crossing(part.time, line, LEFT_LINE * length)
        if left is not None and not watch_all:
            break
    time, angle = np.concatenate(times), np.concatenate(angles)
    rate = growth_rate(mass, SPEED)
    across, turning = float(moving[1]), float(moving[2])
    expected = onset_by_kirchhoff(mass, SPEED, across, turning, length, LEFT_LINE)
    figures = {
        **unit.options,
        "time": left,
        "end": simulator.termination_reason,
        "rate": None if watch_all else fitted_rate(time, angle, rate),
        "kirchhoff": rate,
        "expected": expected if math.isfinite(expected) else None,
        "largest_angle": float(np.concatenate(bends).max()),
        "largest_offset": float(np.concatenate(offsets).max()),
        "lateral": across,
        "turning": turning if unit.options["perturbation"] == "sloped" else 0.0,
    }
    return figures, {}


def fitted_rate(time: Array, angle: Array, guess: float) -> float | None:
    """Return the rate at which an angle grows, fitted over its linear part.

    theta = a + b exp(lambda t) + c exp(-lambda t) solves Kirchhoff's linear equations from any
    start; a, b and c follow from lambda by linear least squares. Each point is weighted by the size
    of the angle there, so that early and late growth count alike, but for the first hundredth of
    the angle, where the little that the body bends at the start would count. lambda (1/s) is sought
    between a fifth and five times the ``guess``; it is good to about 1e-3 where the angle covers
    two growth times, and None where that has fewer than ten instants, or never moves.
    """
    linear = np.abs(angle) <= _LINEAR
    upto = len(angle) if linear.all() else int(np.argmin(linear))
    time, angle = time[1:upto], angle[1:upto]
    thin = max(1, len(time) // 2000)
    time, angle = time[::thin], angle[::thin]
    if len(time) < 10 or not np.abs(angle).max() > 0.0:
        return None
    weight = 1.0 / np.maximum(np.abs(angle), _EARLY * np.abs(angle).max())

    def misfit(logarithm: float) -> float:
        rate = math.exp(logarithm)
        grown, shrunk = np.exp(rate * (time - time[-1])), np.exp(-rate * time)
        weighted = np.stack([np.ones_like(time), grown, shrunk], axis=1) * weight[:, None]
        solved, *_ = np.linalg.lstsq(weighted, angle * weight, rcond=None)
        return float(np.sum((weighted @ solved - angle * weight) ** 2))

    spread = np.linspace(math.log(guess / 5.0), math.log(guess * 5.0), 41)
    best = int(np.argmin([misfit(one) for one in spread]))
    low, high = spread[max(0, best - 1)], spread[min(40, best + 1)]
    found = minimize_scalar(misfit, bounds=(low, high), method="bounded", options={"xatol": 1e-7})
    return float(math.exp(found.x))


def implied_rate(slow: float, quick: float) -> float:
    """Return the rate (1/s) that two times of onset need, of the epsilon and the small start.

    The same exponential growth from 1e-4 instead of 2.2e-16 m/s is ln(1e-4/2.2e-16)/lambda sooner.
    """
    return math.log(LATERAL["small"] / LATERAL["epsilon"]) / (slow - quick)


def onset_by_kirchhoff(
    mass: RigidMass, speed: float, lateral: float, turning: float, length: float, share: float
) -> float:
    """Return when (s) an end of a rigid straight body leaves its line, by the linearised equations.

    The centre starts with velocities along and across the body (m/s), and it turns (rad/s). An end
    has left its line a ``share`` of the length (m) away from its first y. Infinite where that does
    not happen within 1000 s.
    """
    # (y, theta, v, omega): y' = v + U theta, theta' = omega; Kirchhoff's equations for v and omega.
    system = np.zeros((4, 4))
    system[0, 1], system[0, 2], system[1, 3] = speed, 1.0, 1.0
    inertia = np.array([[mass.across, mass.coupling], [mass.coupling, mass.inertia]])
    forces = -speed * np.array([[0.0, mass.along], [mass.across - mass.along, mass.coupling]])
    system[2:, 2:] = np.linalg.solve(inertia, forces)
    state = np.array([0.0, 0.0, lateral, turning])
    ends = np.array([[1.0, 0.5 * length, 0.0, 0.0], [1.0, -0.5 * length, 0.0, 0.0]])
    step = 0.01
    once = expm(system * step)
    for n in range(1, 100_001):
        state = once @ state
        if np.abs(ends @ state).max() > share * length:
            return n * step
    return math.inf


def rate_for_onset(
    mass: RigidMass, speed: float, lateral: float, length: float, share: float, time: float
) -> float:
    """Return the growth rate (1/s) with which such a body leaves its line at a time (s).

    It does not turn at first. The masses are kept, and the rotary inertia is what this takes.
    """

    def with_inertia(factor: float) -> RigidMass:
        return dataclasses.replace(mass, inertia=factor * mass.inertia)

    def late(factor: float) -> float:
        return onset_by_kirchhoff(with_inertia(factor), speed, lateral, 0.0, length, share) - time

    return growth_rate(with_inertia(brentq(late, 1e-4, 1.0, xtol=1e-9)), speed)
