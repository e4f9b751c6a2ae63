"""Alternative readings of the printed equations, applied to the paper's scenes."""

from __future__ import annotations

import itertools
from dataclasses import asdict

import numpy as np

from studies.kirchhoff import growth_rate, rigid_mass
from studies.paper.onset import SPEED
from studies.paper.runs import NUMERALS, guess, played, run_figures
from studies.paper.units import Arrays, Figures, Unit
from swim_env.analysis.modes import mass_matrix
from swim_env.errors import SimulationEndedError
from swim_env.scene import Scene, load_scene
from swim_env.sim.simulator import Simulator

#: What is compared with the closed outline, and what it is in words.
VARIANTS: dict[str, str] = {
    "frozen": "closed outline, the straight body's added mass",
    "halved": "the same, turning with the printed factor 1/2",
    "consistent": "centreline sources, arm from the element's centre",
    "printed_factor": "centreline sources, factor 1/2",
    "arm_from_start": "centreline sources, arm from the element's start",
    "printed_factor_arm_from_start": "centreline sources, factor 1/2, arm from the start",
}


def variant_units(duration: float, quick: bool = False) -> list[Unit]:
    """Return every variant on every scene for a duration (s).

    The quick ones leave out the scene with 27 elements and half of the variants.
    """
    names = ("frozen", "halved", "consistent", "printed_factor") if quick else tuple(VARIANTS)
    units = []
    for variant, numeral in itertools.product(names, NUMERALS[:-1] if quick else NUMERALS):
        scene = load_scene(f"paper_{numeral}")
        cost = 3.0 * guess(scene) if "arm" in variant else 1.0
        scene = of_variant(scene.replace("episode.duration", duration), variant)
        options = {"variant": variant, "scene": numeral}
        name = f"variant_{variant}_{numeral}"
        units.append(Unit(name, measure_variant, scene, options, cost))
    scene = load_scene("paper_i", {"actuation.phase": np.pi, "episode.duration": duration})
    mirrored = of_variant(scene, "consistent")
    options = {"variant": "consistent", "scene": "i"}
    return [*units, Unit("variant_mirrored", measure_variant, mirrored, options)]


def of_variant(scene: Scene, variant: str) -> Scene:
    """Return a scene with the fluid model of a variant; `halved` also needs its own simulator."""
    if variant in ("frozen", "halved"):
        return scene.replace("fluid.model", "frozen")
    return scene.replace({"fluid.model": "centreline", "fluid.variant": variant})


def with_halved_turning(scene: Scene) -> Simulator:
    """Return a simulator of the closed outline whose turning motions have half the boundary value.

    The printed (28) has the factor 1/2 on the normal velocity of a turning element; A = -rho B^T L
    P G^-1 B is quadratic in it, so the entries of turning with moving across are halved and those
    of turning with turning quartered. No scene has that, as it is a misprint: a turning plate would
    have a quarter of its inertia. The scene's fluid model is ``frozen``.
    """
    simulator = Simulator(scene)
    n = scene.beam.elements
    factors = np.concatenate([np.ones(n), np.full(n, 0.5)])
    scaled = np.outer(factors, factors)[np.tril_indices(2 * n)]
    # The model's constants are the lower triangle of A, row by row.
    bodies = simulator._bodies
    bodies._constants.fluid.terms[:] *= scaled
    # The work space keeps the mass, which does not depend on the shape here: clear it.
    bodies._integers[:] = 0
    simulator.reset()
    return simulator


def measure_variant(unit: Unit) -> tuple[Figures, Arrays]:
    """Simulate a scene with a variant, and again with half the step.

    The figures are ``variant``, ``scene``, ``base`` and ``half``: those of `run_figures`; the
    straight body's ``kirchhoff`` rate at the paper's 0.1 m/s (1/s) and the fields of `RigidMass`. A
    run that cannot begin has its reason under ``end``.
    """
    variant = str(unit.options["variant"])
    make = with_halved_turning if variant == "halved" else Simulator
    found: Figures = dict(unit.options)
    mass = rigid_mass(mass_matrix(make(unit.scene)))
    rate = growth_rate(mass, SPEED)
    found |= {"kirchhoff": rate if np.isfinite(rate) else None, **asdict(mass)}
    for level, step in (("base", 0.01), ("half", 0.005)):
        scene = unit.scene.replace("integrator.time_step", step)
        try:
            found[level] = run_figures(played(make(scene)))
        except SimulationEndedError as error:
            found[level] = {"end": error.reason, "duration": 0.0}
    return found, {}
