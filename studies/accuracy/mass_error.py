"""The error of the added mass alone: that of the rigid motions of a straight and of a bent body."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SimulationEndedError
from swim_env.scene import Scene
from swim_env.sim.simulator import Simulator

Array = NDArray[np.float64]

#: Angle between head and tail of the bent body, an arc (rad).
BEND = 1.5
#: Elements of the body that others are compared with, and its panels on each, from which the limit
#: of infinitely many is found.
_FINE_ELEMENTS, _FINE_PANELS = 36, (12, 24, 48)


def rigid_added_mass(scene: Scene, bend: float) -> Array:
    """Return the added mass (3, 3) of a body that is bent to an arc and moves rigidly.

    The bend is the angle between head and tail (rad). Motions are along the arc's middle, across
    it, and rotation about the mean centre (kg, kg m, kg m^2 per metre of depth), lengths in units
    of the body's. It is a SimulationEndedError if the shape has none.
    """
    beam = scene.beam
    n = beam.elements
    # The joints of a chain on an arc; its ends turn by half a joint less.
    joint = bend / n
    coordinates = np.zeros(n + 2)
    coordinates[2] = -0.5 * joint * (n - 1)
    coordinates[3:] = joint
    motions = np.zeros((3, n + 2))
    motions[0, 0] = motions[1, 1] = 1.0
    motions[2, 2:] = 1.0 / beam.length
    simulator = Simulator(scene.replace({"initial": {}, "stream": None}))
    total = []
    for velocity in motions:
        simulator.reset_to(coordinates, velocity)
        total.append(simulator.momentum() / [1.0, 1.0, beam.length])
    # Less the body's own, about the mean centre, which is at the origin.
    mass = beam.line_density * beam.element_length
    inertia = mass * (simulator.centres**2).sum() + beam.rotary_inertia * beam.length
    body = np.diag([n * mass, n * mass, inertia / beam.length**2])
    added: Array = np.array(total) - body
    return added


def mass_errors(scene: Scene) -> tuple[float | None, float | None]:
    """Return the relative errors of the rigid added mass, straight and bent; None where none is.

    The Frobenius norm of the difference to what a body of 36 elements converges to when its panels
    and those of its ends are refined, over that of the matrix. The limit is extrapolated from three
    counts, each twice the one before: the difference to the next shrinks by half (bent) to two
    thirds (straight) at every doubling, and that of 24 panels on an element is still 5e-3 (bent).
    So an error is known to about 3e-4, of which 2e-4 are for the elements. The three take a second
    for a body, once in a process.
    """
    if scene.fluid is None or not scene.fluid.present:
        return None, None
    found: list[float | None] = []
    for bend in (0.0, BEND):
        try:
            fine = _fine_mass(_body(scene), bend)
            mass = rigid_added_mass(scene, bend)
        except SimulationEndedError:
            found.append(None)
            continue
        found.append(float(np.linalg.norm(mass - fine) / np.linalg.norm(fine)))
    return found[0], found[1]


def _body(scene: Scene) -> Scene:
    """Return the same body in the same fluid, computed finely, without all else."""
    data = scene.to_dict()
    beam = {**data["beam"], "elements": _FINE_ELEMENTS, "bending_stiffness": 1.0}
    blocks = {"axial_added_mass": data["axial_added_mass"]} if scene.axial_added_mass else {}
    fluid = {"density": data["fluid"]["density"], "panels_per_element": _FINE_PANELS[0]}
    fluid["cap_panels"] = "proportional"
    return Scene.from_dict({"beam": beam, "fluid": fluid, **blocks})


@functools.lru_cache(maxsize=64)
def _fine_mass(scene: Scene, bend: float) -> Array:
    coarse, middle, fine = (
        rigid_added_mass(scene.replace("fluid.panels_per_element", panels), bend)
        for panels in _FINE_PANELS
    )
    first, second = middle - coarse, fine - middle
    ratio = float((first * second).sum() / (first * first).sum())
    limit: Array = fine + second * ratio / (1.0 - ratio)
    return limit
