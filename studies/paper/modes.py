"""The paper's natural frequencies beside those of `swim_env.analysis.modes`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from studies.kirchhoff import rigid_mass
from studies.paper.units import Arrays, Figures, Unit
from swim_env.analysis.modes import bending_frequencies, mass_matrix, natural_frequencies
from swim_env.scene import Scene, load_scene
from swim_env.sim.simulator import Simulator

#: beta l of a free-free beam's first bending mode (Rayleigh).
FREE_FREE = 4.730041


def modes_units(numerals: Sequence[str]) -> list[Unit]:
    """Return a unit for every scene of the paper; i also has the order in the elements."""
    return [
        Unit(f"modes_{one}", measure_modes, load_scene(f"paper_{one}"), {"orders": one == "i"}, 0.1)
        for one in numerals
    ]


def measure_modes(unit: Unit) -> tuple[Figures, Arrays]:
    """Return the figures of `modes_figures`, of the first scene with those of `bending_orders`."""
    found: Figures = modes_figures(unit.scene)
    if unit.options["orders"]:
        found["orders"] = bending_orders(unit.scene)
    return found, {}


def modes_figures(scene: Scene) -> dict[str, Any]:
    """Return natural frequencies and rigid masses of a scene, for JSON.

    They are the first ``frequencies`` (Hz), ``fine`` the same with three times the panels and ends
    to match, the ``highest`` of all, and the fields of `RigidMass`.
    """
    assert scene.fluid is not None
    panels = 3 * scene.fluid.panels_per_element
    finer = {"fluid.panels_per_element": panels, "fluid.cap_panels": "proportional"}
    matrix = mass_matrix(Simulator(scene))
    frequencies = bending_frequencies(scene, matrix)
    return {
        "frequencies": frequencies[:3],
        "fine": natural_frequencies(scene.replace(finer), 3),
        "highest": frequencies[-1],
        **asdict(rigid_mass(matrix)),
    }


def bending_orders(scene: Scene) -> dict[str, Any]:
    """Return how the first bending frequency of the beam alone converges in the elements.

    That is ``elements``, ``frequencies`` (Hz) and their relative ``errors`` against the free-free
    beam (rotary inertia made negligible), the observed ``order`` of the last two and that of the
    two ``before``.
    """
    beam = scene.beam
    exact = FREE_FREE**2 / beam.length**2 / (2.0 * math.pi)
    exact *= math.sqrt(float(beam.stiffness_at_joints()[0]) / beam.line_density)
    counts = (9, 18, 36)
    alone = scene.replace({"beam.rotary_inertia": 1e-9, "fluid": None})
    found = [natural_frequencies(alone.replace("beam.elements", n), 1)[0] for n in counts]
    errors = [abs(one / exact - 1.0) for one in found]
    return {
        "elements": list(counts),
        "frequencies": found,
        "exact": exact,
        "errors": errors,
        "order": math.log2(errors[-2] / errors[-1]),
        "before": math.log2(errors[-3] / errors[-2]),
    }
