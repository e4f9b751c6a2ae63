"""The hard cases: families of runs that vary what makes a swimming beam hard to compute."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from studies.stability.runs import HardRun, Torques
from studies.stability.torques import Ramp, SquareWave, WhiteNoise
from swim_env.physics.fluid.strip import plate_added_mass
from swim_env.scene import load_scene

Runs = Iterator[HardRun]

#: Cases by name, in the order of the table.
CASES: dict[str, Callable[[], Runs]] = {}

_DAMPING: dict[str, object] = {"damped": {"retardation_time": 0.001}, "undamped": None}


def hard_runs(names: tuple[str, ...] | None = None) -> list[HardRun]:
    """Return the runs of all cases, or of some."""
    return [run for name in names or CASES for run in CASES[name]()]


def _case(name: str) -> Callable[[Callable[[], Runs]], Callable[[], Runs]]:
    """Register a case, whose runs get its name."""

    def register(make: Callable[[], Runs]) -> Callable[[], Runs]:
        CASES[name] = lambda: (replace(run, case=name) for run in make())
        return make

    return register


def _damped_and_not(bodies: Iterable[tuple[str, dict[str, object], bool]]) -> Runs:
    """Yield 20 s of scene swimmer with changes, each of which has a solution where it is damped."""
    bodies = list(bodies)
    for how, damping in _DAMPING.items():
        for label, changes, flagged in bodies:
            options = {"must_last": damping is not None, "compared": True, "flagged": flagged}
            yield _swim(f"{label}, {how}", {**changes, "damping": damping}, 20.0, **options)


def _swim(label: str, changes: Mapping[str, object], duration: float, **how: Any) -> HardRun:
    """Return a run of scene swimmer with changes."""
    return HardRun(label, load_scene("swimmer", changes), duration, **how)


def _fluid(elements: int, model: str, panels: int) -> dict[str, object]:
    """Return the changes of a scene to so many elements, a fluid model and panels per element."""
    beam: dict[str, object] = {"beam.elements": elements}
    return {**beam, "fluid.model": model, "fluid.panels_per_element": panels}


@_case("resonance")
def _resonance() -> Runs:
    """Drive paper_i through its first bending mode."""
    frequencies = np.arange(3.0, 8.01, 0.25).tolist()
    for step, (how, damping), frequency in product((0.01, 0.005), _DAMPING.items(), frequencies):
        changes = {
            "actuation.frequency": 2.0 * math.pi * frequency,
            "integrator.time_step": step,
            "damping": damping,
        }
        yield HardRun(
            f"{frequency:.2f} Hz, {1e3 * step:g} ms, {how}",
            load_scene("paper_i", changes),
            60.0,
            must_last=damping is not None,
            compared=True,
            # Next to the resonance itself, and the finer the step the closer to it.
            flagged=abs(frequency - 5.0) < (0.3 if step > 0.005 else 0.26),
        )


@_case("violent torques")
def _violent() -> Runs:
    """Drive with white noise and square waves at many times the torque that actions can reach."""
    for how, damping in _DAMPING.items():
        scene = load_scene("swimmer", {"damping": damping})
        for factor in (10.0, 50.0, 500.0):
            amplitude = factor * scene.torque_limit
            drives: dict[str, Torques] = {
                "white noise": WhiteNoise(amplitude, 1),
                "white noise, every step": WhiteNoise(amplitude, 2, 0.005),
                "square wave": SquareWave(amplitude),
                "fast square wave": SquareWave(amplitude, 0.02),
            }
            for name, drive in drives.items():
                label = f"{name}, {factor:g} times the limit, {how}"
                yield HardRun(label, scene, 10.0, drive, compared=True)
    # Where a solution takes long, one that fails may take too long.
    fluids = (
        *((27, "panels", 4), (27, "expansion", 4), (81, "panels", 4), (81, "panels", 12)),
        *((161, "panels", 4), (161, "frozen", 4), (161, "none", 4)),
    )
    for (elements, model, panels), scheme in product(fluids, ("paper", "composed")):
        label = f"white noise, 60 times the limit, N = {elements}, {model} {panels}, {scheme}"
        changes = {**_fluid(elements, model, panels), "integrator.scheme": scheme}
        yield _swim(label, changes, 0.05, torques=WhiteNoise(60.0, 1, 0.005))


@_case("stiff")
def _stiff() -> Runs:
    """Vary the body from limp to rigid, uniform and jumping by a million between neighbours."""
    bodies: list[tuple[str, object, float]] = [
        (f"EI 1e{power}", 10.0**power, 10.0**power) for power in range(-3, 9)
    ]
    for low in (1e-3, 1.0, 100.0):
        label = f"EI {low:g} and {1e6 * low:g} in turn"
        bodies.append((label, [low, 1e6 * low] * 4, low))
    # A torque that a body so limp can withstand.
    stiff, driven = "beam.bending_stiffness", "actuation.amplitude"
    return _damped_and_not(
        (label, {stiff: stiffness, driven: min(1.0, lowest / 5.0)}, False)
        for label, stiffness, lowest in bodies
    )


@_case("time step")
def _time_steps() -> Runs:
    """Take steps from 0.1 ms to a fifth of a period."""
    steps = (1e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2)
    for name, scheme, step in product(("swimmer", "paper_i"), ("paper", "composed"), steps):
        changes = {
            "integrator.time_step": step,
            "integrator.scheme": scheme,
            "episode.control_interval": max(step, 0.02),
        }
        label = f"{name}, {scheme}, {1e3 * step:g} ms"
        yield HardRun(label, load_scene(name, changes), 10.0, compared=True)


@_case("body mass")
def _body_mass() -> Runs:
    """Take bodies of next to no mass in the fluid, and bodies that hardly notice it."""
    bodies: list[tuple[str, dict[str, object], bool]] = []
    for power in range(-6, 4):
        density = 10.0**power * plate_added_mass(10.0, 1.0)
        # As slender as the default: its radius of gyration.
        inertia = density * 7.8e-6 / 0.31
        # Of the lightest, next to no inertia is along the body.
        label, flagged = f"1e{power} times the fluid's", power <= -5
        changes = {"beam.line_density": density, "beam.rotary_inertia": inertia}
        bodies.append((label, {**changes}, flagged))
    return _damped_and_not(bodies)


@_case("thickness")
def _thickness() -> Runs:
    """Take half thicknesses from a millionth to a fifth of an element."""
    return _damped_and_not(
        (f"{share:g} of an element", {"beam.half_thickness": share * (1.0 / 9.0)}, False)
        for share in (1e-6, 1e-5, 1e-4, 1e-3, 0.01, 0.03, 0.1, 0.15, 0.2)
    )


@_case("resolution")
def _resolution() -> Runs:
    """Take two elements and 161, two panels an element and 24."""
    for elements, model, panels, duration in (
        *((2, "panels", 4, 20.0), (2, "panels", 24, 20.0)),
        *((3, "panels", 2, 20.0), (3, "panels", 4, 20.0), (3, "panels", 24, 20.0)),
        *((9, "panels", 2, 20.0), (9, "panels", 8, 20.0), (9, "panels", 24, 5.0)),
        (27, "panels", 24, 0.1),
        *((81, "panels", 2, 1.0), (81, "panels", 4, 0.5), (81, "panels", 12, 0.03)),
        *((161, "panels", 2, 0.3), (161, "panels", 4, 0.1)),
        *((81, "frozen", 2, 2.0), (161, "frozen", 2, 2.0)),
    ):
        # As many torques per length as nine elements have.
        amplitude = min(1.0, 8.0 / (elements - 1))
        changes = {**_fluid(elements, model, panels), "actuation.amplitude": amplitude}
        how = f"{panels} panels" if model == "panels" else model
        yield _swim(f"N = {elements}, {how}", changes, duration, must_last=True)


@_case("curling")
def _curling() -> Runs:
    """Bring the head to the tail, and joints towards half a turn, by torques."""
    shapes: tuple[tuple[str, int, Ramp, dict[str, object]], ...] = (
        ("head to tail", 9, Ramp(9.0), {}),
        ("head to tail, watched", 9, Ramp(9.0), {"self_contact": {}}),
        ("one joint", 9, Ramp(30.0, 4), {}),
        ("folding rule", 2, Ramp(5.0), {}),
        ("held beyond 90 degrees", 3, Ramp(30.0, 0, most=27.0), {}),
    )
    strains = ("averaged_directors", "mean_angles", "joint_angle")
    for strain, model, shape in product(strains, ("panels", "frozen", "none"), shapes):
        name, elements, torque, contact = shape
        changes: dict[str, object] = {
            "beam.elements": elements,
            "fluid.model": model,
            "integrator.strain": strain,
            "damping.retardation_time": 0.02,
            **contact,
        }
        yield _swim(f"{name}, {model}, {strain}", changes, 6.0, torques=torque)


@_case("long")
def _long_runs() -> Runs:
    """Take a million steps, passive and driven."""
    # It rings, and drifts.
    start = {"initial.joint_angles": 0.02, "initial.velocity": [0.0, 0.01]}
    drives = {"passive": {"actuation": None, **start}, "driven": {}}
    for (how, damping), (drive, changes) in product(_DAMPING.items(), drives.items()):
        scene = load_scene("swimmer", {**changes, "damping": damping})
        yield HardRun(
            f"1e6 steps {drive}, {how}",
            scene,
            1e6 * scene.integrator.time_step,
            must_last=damping is not None,
            steady=damping is None and drive == "passive",
        )


@_case("fast")
def _fast() -> Runs:
    """Throw bodies at up to a thousand lengths a second, and spin them at up to 1000 rad/s."""
    directions = {"ahead": (1.0, 0.0), "askew": (0.8, 0.6), "across": (0.0, 1.0)}
    for power, (name, (x, y)) in product(range(-1, 4), directions.items()):
        speed = 10.0**power
        changes = {"actuation": None, "initial.velocity": [speed * x, speed * y]}
        yield _swim(f"{speed:g} lengths a second {name}", changes, 2.0, compared=True)
    for rate in (1.0, 10.0, 50.0, 100.0, 200.0, 1000.0):
        how = {"velocity": np.array([0.0, 0.0] + [rate] * 9), "compared": True}
        yield _swim(f"spinning at {rate:g} rad/s", {"actuation": None}, 2.0, **how)


@_case("straight ahead")
def _straight() -> Runs:
    """Send a straight body ahead, unstable by Kirchhoff's equations, and leave it to itself."""
    for elements, lateral in product((3, 9, 27), (0.0, 1e-16, 1e-4)):
        changes = {"beam.elements": elements, "initial.velocity": [0.1, lateral]}
        label = f"N = {elements}, [0.1, {lateral:g}] m/s"
        duration = 20.0 if elements == 27 else 60.0
        yield HardRun(label, load_scene("paper_x", changes), duration, must_last=True)
