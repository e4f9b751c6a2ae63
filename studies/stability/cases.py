"""The hard cases: families of runs that vary what makes a swimming beam hard to compute."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from studies.stability.runs import HardRun, Torques
from studies.stability.torques import Ramp, SquareWave, WhiteNoise
from swim_env.physics.fluid.fluid_terms import plate_added_mass
from swim_env.scene import Scene, load_scene

__all__ = ["CASES", "hard_runs"]

_TWO_PI = 2.0 * math.pi
_DAMPING = (0.001, None)


def hard_runs(names: tuple[str, ...] | None = None) -> list[HardRun]:
    """Return the runs of all cases, or of some."""
    chosen = CASES if names is None else {name: CASES[name] for name in names}
    return [run for make in chosen.values() for run in make()]


def _scene(base: str = "swimmer", **dotted: object) -> Scene:
    changes = {key.replace("__", "."): value for key, value in dotted.items()}
    return load_scene(base).replace(changes)


def _damped(scene: Scene, retardation: float | None) -> Scene:
    block = None if retardation is None else {"retardation_time": retardation}
    return scene.replace("damping", block)


def _how(retardation: float | None) -> str:
    return "damped" if retardation else "undamped"


def _with_and_without(
    case: str, label: str, scene: Scene, retardation: float | None, flagged: bool = False
) -> HardRun:
    """Return 20 s of a scene that has a solution where it is damped."""
    return HardRun(
        case,
        f"{label}, {_how(retardation)}",
        _damped(scene, retardation),
        20.0,
        must_last=retardation is not None,
        compared=True,
        flagged=flagged,
    )


def resonance() -> Iterator[HardRun]:
    """Drive paper_i through its first bending mode."""
    for step in (0.01, 0.005):
        for retardation in _DAMPING:
            for frequency in np.arange(3.0, 8.01, 0.25):
                scene = _scene("paper_i", actuation__frequency=_TWO_PI * float(frequency))
                scene = _damped(scene.replace("integrator.time_step", step), retardation)
                yield HardRun(
                    "resonance",
                    f"{frequency:.2f} Hz, {1e3 * step:g} ms, {_how(retardation)}",
                    scene,
                    60.0,
                    must_last=retardation is not None,
                    compared=True,
                    # Next to the resonance itself, and the finer the step the closer to it.
                    flagged=abs(frequency - 5.0) < (0.3 if step > 0.005 else 0.26),
                )


def violent() -> Iterator[HardRun]:
    """Drive with white noise and square waves at many times the torque that actions can reach."""
    for retardation in _DAMPING:
        scene = _damped(load_scene("swimmer"), retardation)
        for factor in (10.0, 50.0, 500.0):
            amplitude = factor * scene.torque_limit
            drives: dict[str, Torques] = {
                "white noise": WhiteNoise(amplitude, 1),
                "white noise, every step": WhiteNoise(amplitude, 2, 0.005),
                "square wave": SquareWave(amplitude),
                "fast square wave": SquareWave(amplitude, 0.02),
            }
            for name, drive in drives.items():
                yield HardRun(
                    "violent torques",
                    f"{name}, {factor:g} times the limit, {_how(retardation)}",
                    scene,
                    10.0,
                    drive,
                    compared=True,
                )
    # Where a solution takes long, one that fails may take too long.
    for elements, model, panels in (
        (27, "panels", 4),
        (27, "expansion", 4),
        (81, "panels", 4),
        (81, "panels", 12),
        (161, "panels", 4),
        (161, "frozen", 4),
        (161, "none", 4),
    ):
        for scheme in ("paper", "composed"):
            scene = _scene(
                beam__elements=elements,
                fluid__model=model,
                fluid__panels_per_element=panels,
                integrator__scheme=scheme,
            )
            yield HardRun(
                "violent torques",
                f"white noise, 60 times the limit, N = {elements}, {model} {panels}, {scheme}",
                scene,
                0.05,
                WhiteNoise(60.0, 1, 0.005),
            )


def stiff() -> Iterator[HardRun]:
    """Go from a limp body to a rigid one, uniform and jumping by a million between neighbours."""
    for retardation in _DAMPING:
        for power in range(-3, 9):
            stiffness = 10.0**power
            scene = _scene(beam__bending_stiffness=stiffness)
            # A torque that a body so limp can withstand.
            scene = scene.replace("actuation.amplitude", min(1.0, stiffness / 5.0))
            yield _with_and_without("stiff", f"EI 1e{power}", scene, retardation)
        for low in (1e-3, 1.0, 100.0):
            values = [low if joint % 2 == 0 else 1e6 * low for joint in range(8)]
            scene = _scene(beam__bending_stiffness=values)
            scene = scene.replace("actuation.amplitude", min(1.0, low / 5.0))
            label = f"EI {low:g} and {1e6 * low:g} in turn"
            yield _with_and_without("stiff", label, scene, retardation)


def time_steps() -> Iterator[HardRun]:
    """Take steps from 0.1 ms to a fifth of a period."""
    for name in ("swimmer", "paper_i"):
        for scheme in ("paper", "composed"):
            for step in (1e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2):
                scene = load_scene(name).replace(
                    {
                        "integrator.time_step": step,
                        "integrator.scheme": scheme,
                        "episode.control_interval": max(step, 0.02),
                    }
                )
                yield HardRun(
                    "time step", f"{name}, {scheme}, {1e3 * step:g} ms", scene, 10.0, compared=True
                )


def body_mass() -> Iterator[HardRun]:
    """Take bodies that weigh next to nothing in the fluid, and bodies that hardly notice it."""
    of_fluid = plate_added_mass(10.0, 1.0)
    for retardation in _DAMPING:
        for power in range(-6, 4):
            ratio = 10.0**power
            density = ratio * of_fluid
            scene = _scene(
                beam__line_density=density,
                # As slender as the default: its radius of gyration.
                beam__rotary_inertia=density * 7.8e-6 / 0.31,
            )
            # Of the lightest, next to no inertia is along the body.
            label, flagged = f"1e{power} times the fluid's", power <= -5
            yield _with_and_without("body mass", label, scene, retardation, flagged)


def thickness() -> Iterator[HardRun]:
    """Take half thicknesses from a millionth to a fifth of an element."""
    dl = 1.0 / 9.0
    for retardation in _DAMPING:
        for share in (1e-6, 1e-5, 1e-4, 1e-3, 0.01, 0.03, 0.1, 0.15, 0.2):
            scene = _scene(beam__half_thickness=share * dl)
            yield _with_and_without("thickness", f"{share:g} of an element", scene, retardation)


def resolution() -> Iterator[HardRun]:
    """Take two elements and 161, two panels an element and 24."""
    for elements, panels, duration in (
        (2, 4, 20.0),
        (2, 24, 20.0),
        (3, 2, 20.0),
        (3, 4, 20.0),
        (3, 24, 20.0),
        (9, 2, 20.0),
        (9, 8, 20.0),
        (9, 24, 5.0),
        (27, 24, 0.1),
        (81, 2, 1.0),
        (81, 4, 0.5),
        (81, 12, 0.03),
        (161, 2, 0.3),
        (161, 4, 0.1),
    ):
        scene = _scene(beam__elements=elements, fluid__panels_per_element=panels)
        # As many torques per length as nine elements have.
        scene = scene.replace("actuation.amplitude", min(1.0, 8.0 / (elements - 1)))
        yield HardRun(
            "resolution", f"N = {elements}, {panels} panels", scene, duration, must_last=True
        )
    for elements in (81, 161):
        scene = _scene(beam__elements=elements, fluid__model="frozen", fluid__panels_per_element=2)
        scene = scene.replace("actuation.amplitude", 8.0 / (elements - 1))
        yield HardRun("resolution", f"N = {elements}, frozen", scene, 2.0, must_last=True)


def curling() -> Iterator[HardRun]:
    """Bring the head to the tail, and joints towards half a turn, by torques."""
    for strain in ("averaged_directors", "mean_angles", "joint_angle"):
        for model in ("panels", "frozen", "none"):
            for name, elements, torque, contact in (
                ("head to tail", 9, Ramp(9.0), False),
                ("head to tail, watched", 9, Ramp(9.0), True),
                ("one joint", 9, Ramp(30.0, 4), False),
                ("folding rule", 2, Ramp(5.0), False),
                ("held beyond 90 degrees", 3, Ramp(30.0, 0, most=27.0), False),
            ):
                scene = _scene(
                    beam__elements=elements,
                    fluid__model=model,
                    integrator__strain=strain,
                    damping__retardation_time=0.02,
                )
                if contact:
                    scene = scene.replace("self_contact", {})
                yield HardRun("curling", f"{name}, {model}, {strain}", scene, 6.0, torque)


def long_runs() -> Iterator[HardRun]:
    """Take a million steps, passive and driven."""
    for retardation in _DAMPING:
        for drive in ("passive", "driven"):
            scene = _damped(load_scene("swimmer"), retardation)
            if drive == "passive":
                # It rings, and drifts.
                scene = scene.replace(
                    {
                        "actuation": None,
                        "initial.joint_angles": 0.02,
                        "initial.velocity": [0.0, 0.01],
                    }
                )
            yield HardRun(
                "long",
                f"1e6 steps {drive}, {_how(retardation)}",
                scene,
                1e6 * scene.integrator.time_step,
                must_last=retardation is not None,
                steady=retardation is None and drive == "passive",
            )


def fast() -> Iterator[HardRun]:
    """Throw bodies at up to a thousand lengths a second, and spin them at up to 1000 rad/s."""
    for power in range(-1, 4):
        speed = 10.0**power
        for name, direction in (
            ("ahead", (1.0, 0.0)),
            ("askew", (0.8, 0.6)),
            ("across", (0.0, 1.0)),
        ):
            scene = _scene(
                actuation=None, initial__velocity=[speed * direction[0], speed * direction[1]]
            )
            yield HardRun("fast", f"{speed:g} lengths a second {name}", scene, 2.0, compared=True)
    for rate in (1.0, 10.0, 50.0, 100.0, 200.0, 1000.0):
        scene = _scene(actuation=None)
        yield HardRun(
            "fast",
            f"spinning at {rate:g} rad/s",
            scene,
            2.0,
            velocity=np.concatenate([[0.0, 0.0], np.full(scene.beam.elements, rate)]),
            compared=True,
        )


def straight() -> Iterator[HardRun]:
    """Send a straight body ahead, unstable as Kirchhoff says, and leave it to itself."""
    for elements in (3, 9, 27):
        for lateral in (0.0, 1e-16, 1e-4):
            scene = load_scene("paper_x").replace(
                {"beam.elements": elements, "initial.velocity": [0.1, lateral]}
            )
            yield HardRun(
                "straight ahead",
                f"N = {elements}, [0.1, {lateral:g}] m/s",
                scene,
                20.0 if elements == 27 else 60.0,
                must_last=True,
            )


#: Cases by name, in the order of the table.
CASES: dict[str, Callable[[], Iterator[HardRun]]] = {
    "resonance": resonance,
    "violent torques": violent,
    "stiff": stiff,
    "time step": time_steps,
    "body mass": body_mass,
    "thickness": thickness,
    "resolution": resolution,
    "curling": curling,
    "long": long_runs,
    "fast": fast,
    "straight ahead": straight,
}
