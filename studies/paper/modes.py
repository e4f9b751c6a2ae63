"""The straight body's natural frequencies, in its fluid and alone."""

from __future__ import annotations

import math
from typing import Any

from studies.paper.units import Arrays, Figures, Unit
from swim_env.analysis.kirchhoff import mass_matrix, rigid_mass
from swim_env.analysis.modes import bending_frequencies, natural_frequencies
from swim_env.scene import Scene
from swim_env.sim.simulator import Simulator

__all__ = ["bending_orders", "measure_modes", "modes_figures"]

#: beta l of a free-free beam's first bending modes (Rayleigh).
FREE_FREE = (4.730041, 7.853205, 10.995608)


def modes_figures(scene: Scene) -> dict[str, Any]:
    """Return natural frequencies and rigid masses of a scene, for JSON.

    Returns
    -------
    dict
        ``frequencies`` (Hz), ``fine`` the same with three times the panels and ends to match, and
        ``highest`` of all, ``along``, ``across`` (kg), ``inertia``
        (kg m^2) and ``coupling`` (kg m).
    """
    matrix = mass_matrix(Simulator(scene))
    frequencies = bending_frequencies(scene, matrix)
    mass = rigid_mass(matrix)
    return {
        "frequencies": frequencies[:3],
        "fine": natural_frequencies(_with_fine_panels(scene), 3),
        "highest": frequencies[-1],
        "along": mass.along,
        "across": mass.across,
        "inertia": mass.inertia,
        "coupling": mass.coupling,
    }


def _with_fine_panels(scene: Scene) -> Scene:
    assert scene.fluid is not None
    panels = 3 * scene.fluid.panels_per_element
    return scene.replace({"fluid.panels_per_element": panels, "fluid.cap_panels": "proportional"})


def measure_modes(unit: Unit) -> tuple[Figures, Arrays]:
    """Return the figures of `modes_figures`, of the first scene with those of `bending_orders`."""
    found: Figures = modes_figures(unit.scene)
    if unit.options.get("orders"):
        found["orders"] = bending_orders(unit.scene)
    return found, {}


def bending_orders(scene: Scene) -> dict[str, Any]:
    """Return how the first bending frequency of the beam alone converges in the elements.

    Returns
    -------
    dict
        ``elements``, ``frequencies`` (Hz) and their relative ``errors`` against the free-free
        beam (rotary inertia made negligible), the observed ``order`` of the last two and that of
        the two ``before``.
    """
    beam = scene.beam
    exact = FREE_FREE[0] ** 2 / beam.length**2 / (2.0 * math.pi)
    exact *= math.sqrt(float(beam.stiffness_at_joints()[0]) / beam.line_density)
    counts, found = (9, 18, 36), []
    for elements in counts:
        alone = scene.replace(
            {"beam.elements": elements, "beam.rotary_inertia": 1e-9, "fluid": None}
        )
        found.append(natural_frequencies(alone, 1)[0])
    errors = [abs(one / exact - 1.0) for one in found]
    return {
        "elements": list(counts),
        "frequencies": found,
        "exact": exact,
        "errors": errors,
        "order": math.log2(errors[-2] / errors[-1]),
        "before": math.log2(errors[-3] / errors[-2]),
    }
