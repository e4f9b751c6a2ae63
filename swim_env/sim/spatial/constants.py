"""Builds the constants of the spatial kernels from a scene."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SimulationEndedError
from swim_env.physics.spatial.chain import SpatialBeam
from swim_env.physics.spatial.constants import SpatialConstants
from swim_env.physics.spatial.layout import SpatialFluid
from swim_env.physics.spatial.loading import load_panel_kernels
from swim_env.physics.spatial.panels.mass import evaluate_added_mass, panel_costs
from swim_env.physics.spatial.panels.surface import Surface, no_surface, surface_of_sections
from swim_env.physics.status import TERMINATION_REASONS, describe
from swim_env.scene.fluid import NO_FLUID
from swim_env.scene.spatial.scene import SpatialScene
from swim_env.sim.constants import LONGEST_STEP, SMALLEST_SCALE, solver_constants

Array = NDArray[np.float64]


def spatial_constants(scene: SpatialScene) -> SpatialConstants:
    """Return the constants of a scene for the kernels."""
    beam, fluid = scene.beam, scene.fluid
    dl = beam.element_length
    inertia = dl * scene.inertia_per_length()
    stiffness = np.ascontiguousarray(beam.stiffness_at_joints() / dl)
    damping = stiffness * scene.damping.times if scene.damping else np.zeros_like(stiffness)
    model = fluid.model if fluid is not None else NO_FLUID
    varies = _ADDED_MASS[model] is None
    added = np.zeros((0, 0)) if varies else added_mass_of(scene)
    momentum, spin = momentum_units(scene)
    stream = np.array(scene.stream.velocity) if scene.stream else np.zeros(3)
    return SpatialConstants(
        SpatialBeam(
            beam.elements,
            dl,
            np.ascontiguousarray(inertia[:, 0]),
            np.ascontiguousarray(inertia[:, 1:]),
            stiffness,
            damping,
            np.ascontiguousarray(dl * beam.natural_curvature_at_joints()),
            scene.integrator.strain == "joint_angle",
            SMALLEST_SCALE * momentum,
            SMALLEST_SCALE * spin,
        ),
        SpatialFluid(model != NO_FLUID, model != "strip", varies, added.flatten(), stream),
        solver_constants(scene, _costs(scene)),
        surface_of(scene) if varies else no_surface(beam.elements),
    )


def momentum_units(scene: SpatialScene) -> tuple[float, float]:
    """Return the units of linear and angular momentum in which nothing depends on the body's size.

    They are those of a body with as much added mass as its own that moves by its length, or turns
    by 1 rad, in a thousand time steps (kg m/s, kg m^2/s).
    """
    mass = 2.0 * float(scene.inertia_per_length()[:, 0].sum()) * scene.beam.element_length
    momentum = 1e-3 * mass * scene.beam.length / scene.integrator.time_step
    return momentum, momentum * scene.beam.length


def surface_of(scene: SpatialScene) -> Surface:
    """Return how a scene's body is wrapped into panels."""
    beam, fluid = scene.beam, scene.fluid
    assert fluid is not None and fluid.density is not None
    s = np.linspace(0.0, beam.length, beam.elements * fluid.rows + 1)
    return surface_of_sections(
        beam.element_length,
        beam.half_width_at(s),
        beam.half_height_at(s),
        elements=beam.elements,
        around=fluid.around,
        density=fluid.density,
        self_term=fluid.self_term,
        rings=fluid.rings,
    )


@lru_cache(maxsize=32)
def added_mass_of(scene: SpatialScene) -> Array:
    """Return the constant added mass of a scene's fluid, (6 N, 6 N), in the elements' frames.

    Raises
    ------
    SimulationEndedError
        If the straight body has none.
    """
    find = _ADDED_MASS[scene.fluid.model if scene.fluid is not None else NO_FLUID]
    assert find is not None
    return find(scene)


def _given(scene: SpatialScene) -> Array:
    assert scene.fluid is not None
    return np.array(scene.fluid.matrix)


def _straight(scene: SpatialScene) -> Array:
    """Return the straight body's from panels."""
    load_panel_kernels()
    straight = np.tile(_REFERENCE, (scene.beam.elements, 1, 1))
    found, status = evaluate_added_mass(straight, surface_of(scene))
    if status:
        reason = TERMINATION_REASONS[status]
        raise SimulationEndedError(reason, 0.0, describe(reason))
    return found


#: Directors of the reference pose: d1 = e_y, d2 = e_z, d3 = e_x.
_REFERENCE = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def _strips(scene: SpatialScene) -> Array:
    """Return the added mass of every element's own sections, by the Gauss points of (18)."""
    beam, fluid = scene.beam, scene.fluid
    assert fluid is not None and fluid.density is not None
    s, weights = beam.gauss_points()
    b, a = beam.half_width_at(s), beam.half_height_at(s)
    per_length = fluid.density * np.pi
    weights = weights * beam.element_length
    arm = s - s.mean(axis=1, keepdims=True)
    n = beam.elements
    added = np.zeros((n, 6, n, 6))
    k = np.arange(n)
    # A section at the distance x from the centre moves by v1 + x w2 along d1, v2 - x w1 along d2.
    for i, j, density, sign in ((0, 4, per_length * a**2, 1.0), (1, 3, per_length * b**2, -1.0)):
        added[k, i, k, i] = density @ weights
        added[k, i, k, j] = added[k, j, k, i] = sign * (density * arm) @ weights
        added[k, j, k, j] = (density * arm**2) @ weights
    added[k, 5, k, 5] = (per_length / 8.0 * (a**2 - b**2) ** 2) @ weights
    return added.reshape(6 * n, 6 * n)


#: What finds the constant added mass by `fluid.model`; None where it varies with the shape.
_ADDED_MASS: dict[str, Callable[[SpatialScene], Array] | None] = {
    NO_FLUID: lambda scene: np.zeros((0, 0)),
    "strip": _strips,
    "frozen": _straight,
    "given": _given,
    "panels": None,
}


def _costs(scene: SpatialScene) -> tuple[float, float, float]:
    """Return what a residual, an added mass and a matrix take of the effort of a step.

    They are rough times (s on a core of 2023) and depend on sizes alone, see
    `swim_env.sim.constants`.
    """
    n, fluid = scene.beam.elements, scene.fluid
    residual = 5e-7 + 4e-7 * n
    matrix = 2e-6 + 1.2e-6 * n + 2e-8 * n**2 + 1e-8 * n**3
    added_mass = 0.0
    if fluid is not None and fluid.present and fluid.model != "strip":
        residual += 5e-9 * n**2
        matrix += 1.5e-8 * n**3
        if fluid.model == "panels":
            shape_force, added_mass = panel_costs(fluid.panels_in_all(scene.beam))
            added_mass = max(added_mass, 2.0 * shape_force)
    shapes = 12.0 if scene.integrator.scheme == "composed" else 4.0
    attempt = shapes * added_mass + 3.0 * matrix + 12.0 * residual
    budget = max(LONGEST_STEP, attempt)
    return residual / budget, added_mass / budget, matrix / budget
