"""The scenes and settings of the study."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product
from typing import NamedTuple

from swim_env.accuracy.settings import PAPER_SETTINGS, Settings, duration_for, refuse_lists
from swim_env.scene import Scene, load_scene

#: Tolerances that `Scene.for_accuracy` is judged by.
CHOSEN_TOLERANCES = (3e-2, 1e-2, 3e-3)
_FINE = "proportional"
_SCHEMES = ("paper", "composed")
#: Panels on an element and at each end.
_Panels = tuple[int, int | str]
_COARSE_AND_FINE: tuple[_Panels, ...] = ((4, 1), (16, _FINE))
_PANELS: tuple[_Panels, ...] = ((4, 1), (4, _FINE), (8, 1), (8, _FINE), (12, _FINE))
#: How Newton's tolerance is varied besides the paper's settings.
FINE_STEPS = (
    Settings("frozen", 12, 18, _FINE, 0.01, "composed"),
    Settings("panels", 9, 8, _FINE, 0.01, "composed"),
)
#: What SciPy's solvers are compared on. Their solutions are sampled at multiples of its step.
SOLVED = Settings("frozen", 9, 24, _FINE, 0.01, "composed")


class Case(NamedTuple):
    """A scene of the study and how long it is played (s)."""

    scene: Scene
    duration: float


def case_of(scene: Scene) -> Case:
    """Return any scene as one of a study, played as long as its episode is, 20 s at most.

    It is a SwimError if it lists values for every joint or element: their number cannot vary.
    """
    refuse_lists(scene, "vary as the study needs it; give a law in s/l")
    return Case(scene, duration_for(scene, scene.episode.duration))


def study_scenes() -> list[Case]:
    """Return the scenes of the study.

    The paper's and the learning scene; the learning scene driven at its first resonance; a long,
    soft, damped body; a stiff one driven fast; and one with drag.
    """
    resonant = {"actuation.frequency": 5.2 * 2.0 * math.pi, "actuation.wave_number": 6.0}
    stiff = {
        "beam.bending_stiffness": 50.0,
        "actuation.frequency": 3.0 * 2.0 * math.pi,
        "actuation.wave_number": math.pi,
        "actuation.amplitude": 5.0,
    }
    dragged = {"cross_flow_drag.coefficient": 2.0, "actuation.amplitude": 2.0}
    scenes = [
        load_scene("paper_i"),
        load_scene("swimmer"),
        _changed("swimmer", "resonant", resonant),
        _changed("paper_v", "flexible", {"damping.retardation_time": 0.002}),
        _changed("swimmer", "stiff", stiff),
        _changed("swimmer", "dragged", dragged),
    ]
    return [Case(scene, 20.0) for scene in scenes]


def held_out_scenes() -> list[Case]:
    """Return scenes that the study does not use, to judge `Scene.for_accuracy` by.

    Other stiffness, length, frequency, wave number and amplitude, with damping and without.
    """
    table = (
        # EI (N m^2), length (m), frequency (Hz), kappa (rad), A (N m), t_kv (s)
        (5.0, 1.0, 2.0, 4.0, 1.5, 0.001),
        (10.0, 1.0, 1.0, 7.0, 2.0, 0.001),
        (3.0, 0.8, 1.5, 5.0, 0.7, 0.001),
        (20.0, 1.3, 2.5, 3.0, 3.0, 0.001),
        (8.0, 1.0, 4.0, 8.0, 1.0, 0.002),
        (2.0, 1.0, 0.5, 6.0, 0.4, 0.001),
        (5.0, 1.5, 1.2, -5.0, 0.8, 0.002),
        (15.0, 1.1, 5.0, 6.5, 2.0, 0.001),
        (6.0, 0.9, 1.0, 6.0, 1.0, None),
        (4.0, 1.2, 0.8, 9.0, 1.0, None),
    )
    cases = []
    for i, (stiffness, length, frequency, wave_number, amplitude, damping) in enumerate(table):
        changes = {
            "beam.bending_stiffness": stiffness,
            "beam.length": length,
            "actuation.frequency": 2.0 * math.pi * frequency,
            "actuation.wave_number": wave_number,
            "actuation.amplitude": amplitude,
            "damping": None if damping is None else {"retardation_time": damping},
        }
        cases.append(Case(_changed("swimmer", f"held_out_{i + 1}", changes), 20.0))
    return cases


def _changed(base: str, name: str, changes: Mapping[str, object]) -> Scene:
    return load_scene(base).replace({"name": name, "description": "", **changes})


def full_grid() -> list[Settings]:
    """Return the settings of the full study, from the cheap to the costly ones."""
    return list(dict.fromkeys(_all_settings()))


def quick_grid() -> list[Settings]:
    """Return settings that show the same in a minute or two."""
    models, counts = ("strip", "frozen", "expansion"), (5, 9)
    steps = ((0.02, "composed"), (0.01, "paper"), (0.01, "composed"))
    grid = [
        Settings(model, elements, *panels, *step)
        for model, elements, panels, step in product(models, counts, _COARSE_AND_FINE, steps)
    ]
    solver = replace(SOLVED, scheme="LSODA", tolerance=1e-3)
    return [*grid, PAPER_SETTINGS, replace(PAPER_SETTINGS, scheme="composed"), solver]


def _all_settings() -> Iterator[Settings]:
    steps = list(product((0.02, 0.01, 0.005, 0.0025), _SCHEMES))
    for elements, step in product((5, 7, 9, 12, 18, 27), steps):
        # As many panels along the body at every N, which cost nothing, and the paper's.
        panels: list[_Panels] = [(max(8, 2 * round(108 / elements)), _FINE), (4, 1)]
        if elements == PAPER_SETTINGS.elements:
            panels += [(8, 1), (8, _FINE)]
        # Where all else is fine, the panels are what is left.
        if elements >= 12 and step[0] < 0.02:
            panels.append((2 * round(216 / elements), _FINE))
        for each in panels:
            yield Settings("frozen", elements, *each, *step)
    for elements, step in product((5, 9, 12, 18), steps[:6]):
        yield Settings("strip", elements, 4, 1, *step)
        for each in _COARSE_AND_FINE if elements < 18 else ():
            yield Settings("expansion", elements, *each, *step)
    few = ((0.01, "paper"), (0.005, "paper"), (0.01, "composed"))
    for elements, each, step in product((5, 9, 12, 18), _PANELS, few):
        # Beyond that a run takes minutes and is on no front.
        if elements * each[0] <= 150:
            yield Settings("panels", elements, *each, *step)
    # One change at a time from the paper's settings.
    paper = PAPER_SETTINGS
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-12):
        yield replace(paper, tolerance=tolerance)
    for time_step in (0.02, 0.0025):
        yield replace(paper, time_step=time_step)
    for scheme, time_step in product(_SCHEMES, (0.02, 0.01, 0.005)):
        yield replace(paper, strain="mean_angles", scheme=scheme, time_step=time_step)
    yield replace(paper, fluid_model="centreline")
    # Newton's tolerance where everything else is fine, so that nothing hides its effect.
    for settings, tolerance in product(FINE_STEPS, (1e-4, 1e-6, 1e-8)):
        yield replace(settings, tolerance=tolerance)
    # SciPy's solvers. Tighter tolerances would take minutes: undamped modes have to be followed,
    # and if the modes are damped and stiff, the explicit solvers' steps are no longer.
    for method, tolerances in {"Radau": (1e-2, 1e-3), "LSODA": (1e-3, 1e-4, 1e-5)}.items():
        for tolerance in tolerances:
            yield replace(SOLVED, scheme=method, tolerance=tolerance)
