"""The scenes and settings of the study."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from swim_env.accuracy.settings import PAPER_SETTINGS, Settings, lists_values
from swim_env.errors import SwimError
from swim_env.scene import Scene, load_scene

__all__ = [
    "CHOSEN_TOLERANCES",
    "FINE_STEPS",
    "SOLVED",
    "Case",
    "case_of",
    "duration_for",
    "full_grid",
    "held_out_scenes",
    "quick_grid",
    "study_scenes",
]

#: Tolerances that `Scene.for_accuracy` is judged by.
CHOSEN_TOLERANCES = (3e-2, 1e-2, 3e-3)
_PROPORTIONAL = "proportional"
#: Longest run that settings are compared on (s): errors of a steady gait do not grow with time.
_LONGEST = 20.0
#: Of the grid, the front and the references; all their steps divide it (s).
_COARSEST_STEP = 0.02
#: Panels per element and at each end, the paper's and finer ones.
_PANELS: tuple[tuple[int, int | str], ...] = (
    (4, 1),
    (4, _PROPORTIONAL),
    (8, 1),
    (8, _PROPORTIONAL),
    (12, _PROPORTIONAL),
)
#: How Newton's tolerance is varied besides the paper's settings.
FINE_STEPS = (
    Settings("frozen", 12, 18, _PROPORTIONAL, 0.01, "composed"),
    Settings("panels", 9, 8, _PROPORTIONAL, 0.01, "composed"),
)
#: What SciPy's solvers are compared on; the step is that at whose multiples they are.
SOLVED = Settings("frozen", 9, 24, _PROPORTIONAL, 0.01, "composed")
_COARSE_AND_FINE: tuple[tuple[int, int | str], ...] = ((4, 1), (16, _PROPORTIONAL))


class Case(NamedTuple):
    """A scene of the study and how long it is played.

    Attributes
    ----------
    scene : Scene
        The scene.
    duration : float
        Simulated time (s).
    """

    scene: Scene
    duration: float


def _made(base: str, name: str, **changes: object) -> Scene:
    dotted = {key.replace("__", "."): value for key, value in changes.items()}
    return load_scene(base).replace({"name": name, "description": "", **dotted})


def duration_for(wanted: float) -> float:
    """Return how long (s) to play for a duration (s): 20 s at most, whole steps of all settings.

    So all runs end at the same instant.
    """
    return max(1, round(min(wanted, _LONGEST) / _COARSEST_STEP)) * _COARSEST_STEP


def case_of(scene: Scene) -> Case:
    """Return any scene as one of a study, played as long as its episode is, 20 s at most.

    Raises
    ------
    SwimError
        If the scene lists values for every joint or element, so that their number cannot vary.
    """
    if lists_values(scene):
        raise SwimError(
            f"scene {scene.name} lists values for every joint or element, so their number cannot "
            "vary as the study needs it; give a law in s/l"
        )
    return Case(scene, duration_for(scene.episode.duration))


def study_scenes() -> list[Case]:
    """Return the scenes of the study.

    The paper's and the learning scene; the learning scene driven at its first resonance; a long,
    soft, damped body; a stiff one driven fast; and one with drag.
    """
    two_pi = 2.0 * math.pi
    scenes = [
        load_scene("paper_i"),
        load_scene("swimmer"),
        _made("swimmer", "resonant", actuation__frequency=5.2 * two_pi, actuation__wave_number=6.0),
        _made("paper_v", "flexible", damping__retardation_time=0.002),
        _made(
            "swimmer",
            "stiff",
            beam__bending_stiffness=50.0,
            actuation__frequency=3.0 * two_pi,
            actuation__wave_number=math.pi,
            actuation__amplitude=5.0,
        ),
        _made("swimmer", "dragged", cross_flow_drag__coefficient=2.0, actuation__amplitude=2.0),
    ]
    return [Case(scene, 20.0) for scene in scenes]


def held_out_scenes() -> list[Case]:
    """Return scenes that the study does not use, for the judgement of `Scene.for_accuracy`.

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
        scene = _made(
            "swimmer",
            f"held_out_{i + 1}",
            beam__bending_stiffness=stiffness,
            beam__length=length,
            actuation__frequency=2.0 * math.pi * frequency,
            actuation__wave_number=wave_number,
            actuation__amplitude=amplitude,
        )
        if damping is None:
            scene = scene.replace("damping", None)
        else:
            scene = scene.replace("damping.retardation_time", damping)
        cases.append(Case(scene, 20.0))
    return cases


def full_grid() -> list[Settings]:
    """Return the settings of the full study, from the cheap to the costly ones."""
    parts = (_frozen(), _others(), _panels(), _single_changes(), _tolerances(), _solvers())
    return list(dict.fromkeys(itertools.chain(*parts)))


def quick_grid() -> list[Settings]:
    """Return settings that show the same in a minute or two."""
    steps = ((0.02, "composed"), (0.01, "paper"), (0.01, "composed"))
    grid = [
        Settings(model, elements, panels, caps, step, scheme)
        for model, elements, (panels, caps), (step, scheme) in itertools.product(
            ("strip", "frozen", "expansion"), (5, 9), _COARSE_AND_FINE, steps
        )
    ]
    solver = replace(SOLVED, scheme="LSODA", tolerance=1e-3)
    return [*grid, PAPER_SETTINGS, replace(PAPER_SETTINGS, scheme="composed"), solver]


def _frozen() -> Iterator[Settings]:
    steps = (0.02, 0.01, 0.005, 0.0025)
    for elements, step, scheme in itertools.product(
        (5, 7, 9, 12, 18, 27), steps, ("paper", "composed")
    ):
        # As many panels along the body at every N, which cost nothing, and the paper's.
        fine = max(8, 2 * round(216 / elements / 2))
        yield Settings("frozen", elements, fine, _PROPORTIONAL, step, scheme)
        yield Settings("frozen", elements, 4, 1, step, scheme)
        if elements == PAPER_SETTINGS.elements:
            yield Settings("frozen", elements, 8, 1, step, scheme)
            yield Settings("frozen", elements, 8, _PROPORTIONAL, step, scheme)
        # Where all else is fine, the panels are what is left.
        if elements >= 12 and step < 0.02:
            finest = 2 * round(432 / elements / 2)
            yield Settings("frozen", elements, finest, _PROPORTIONAL, step, scheme)


def _others() -> Iterator[Settings]:
    for elements, step, scheme in itertools.product(
        (5, 9, 12, 18), (0.02, 0.01, 0.005), ("paper", "composed")
    ):
        yield Settings("strip", elements, 4, 1, step, scheme)
        if elements < 18:
            for panels, caps in _COARSE_AND_FINE:
                yield Settings("expansion", elements, panels, caps, step, scheme)


def _panels() -> Iterator[Settings]:
    for elements, (panels, caps), (step, scheme) in itertools.product(
        (5, 9, 12, 18),
        _PANELS,
        ((0.01, "paper"), (0.005, "paper"), (0.01, "composed")),
    ):
        # Beyond, a run takes minutes and is on nobody's front.
        if elements * panels <= 150:
            yield Settings("panels", elements, panels, caps, step, scheme)


def _single_changes() -> Iterator[Settings]:
    """Change one thing at a time from the paper's settings."""
    paper = PAPER_SETTINGS
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-12):
        yield replace(paper, tolerance=tolerance)
    for step in (0.02, 0.0025):
        yield replace(paper, time_step=step)
    for scheme, step in itertools.product(("paper", "composed"), (0.02, 0.01, 0.005)):
        yield replace(paper, strain="mean_angles", scheme=scheme, time_step=step)
    yield replace(paper, fluid_model="centreline")


def _tolerances() -> Iterator[Settings]:
    """Vary Newton's tolerance where all else is fine, so that nothing hides it."""
    for settings, tolerance in itertools.product(FINE_STEPS, (1e-4, 1e-6, 1e-8)):
        yield replace(settings, tolerance=tolerance)


def _solvers() -> Iterator[Settings]:
    """Let SciPy solve a chain whose panels are as good as free.

    Beyond, runs take minutes: undamped modes have to be followed, and where they are damped and
    stiff, the explicit solvers' steps are no longer.
    """
    tolerances = {"Radau": (1e-2, 1e-3), "LSODA": (1e-3, 1e-4, 1e-5)}
    for method, some in tolerances.items():
        for tolerance in some:
            yield replace(SOLVED, scheme=method, tolerance=tolerance)
