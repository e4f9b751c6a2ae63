"""Builds the kernels' constants from a scene."""

from __future__ import annotations

import numpy as np

from swim_env.physics.fluid.layout import FluidConstants
from swim_env.physics.fluid.models import MODELS, fluid_constants
from swim_env.physics.fluid.outline import FluidGeometry
from swim_env.physics.fluid.strip import plate_added_mass
from swim_env.physics.planar.chain import BeamConstants
from swim_env.physics.solve.constants import SolverConstants
from swim_env.scene import Fluid, Scene
from swim_env.scene.fluid import NO_FLUID

#: Time that an outer step may take before it ends unsolved (s), by rough figures of the costs: a
#: core that is shared takes twice as long, and has to be done within a second.
LONGEST_STEP = 0.4
#: Smallest scale of a step's residual, in `momentum_units`.
SMALLEST_SCALE = 1e-3


def scene_constants(scene: Scene) -> tuple[BeamConstants, FluidConstants, SolverConstants]:
    """Return the constants of a scene for the kernels."""
    beam = scene.beam
    dl = beam.element_length
    stiffness = beam.stiffness_at_joints() / dl
    retardation = scene.damping.retardation_time if scene.damping else 0.0
    fluid = scene.fluid or Fluid(model=NO_FLUID)
    model = MODELS[fluid.model]
    geometry = FluidGeometry(
        beam.elements,
        dl,
        beam.half_thickness,
        fluid.panels_per_element // model.sides,
        fluid.panels_per_end(beam),
    )
    density = fluid.density or 0.0
    momentum, spin = momentum_units(scene)
    drag, stream = scene.cross_flow_drag, scene.stream
    return (
        BeamConstants(
            beam.elements,
            dl,
            dl * beam.line_density,
            dl * beam.rotary_inertia,
            stiffness,
            stiffness * retardation,
            scene.integrator.strain != "averaged_directors",
            scene.integrator.strain == "joint_angle",
            beam.half_thickness if scene.self_contact else 0.0,
            SMALLEST_SCALE * momentum,
            SMALLEST_SCALE * spin,
        ),
        fluid_constants(
            fluid.model,
            geometry,
            density,
            axial=scene.axial_added_mass is not None,
            terms=model.terms(fluid, geometry),
            drag=0.5 * density * drag.coefficient if drag else 0.0,
            stream=stream.velocity if stream else (0.0, 0.0),
        ),
        solver_constants(scene, _costs(scene)),
    )


def solver_constants(scene: Scene, costs: tuple[float, float, float]) -> SolverConstants:
    """Return the integrator's constants; the costs are those of `SolverConstants`."""
    integrator = scene.integrator
    return SolverConstants(
        integrator.time_step,
        integrator.tolerance,
        *costs,
        integrator.scheme == "composed",
        scene.internal_forces is not None,
        integrator.energy_tolerance if integrator.energy_excess == "end" else np.inf,
    )


def momentum_units(scene: Scene) -> tuple[float, float]:
    """Return the units of linear and angular momentum in which nothing depends on the body's size.

    They are those of the straight body, with its added mass as a plate, that moves by its length,
    or turns by 1 rad, in a thousand time steps (kg m/s, kg m^2/s).
    """
    beam, fluid = scene.beam, scene.fluid
    mass = beam.line_density * beam.length
    if fluid is not None and fluid.density is not None:
        mass += plate_added_mass(fluid.density, beam.length) * beam.length
    momentum = 1e-3 * mass * beam.length / scene.integrator.time_step
    return momentum, momentum * beam.length


def _costs(scene: Scene) -> tuple[float, float, float]:
    """Return what a residual, an added mass and a matrix take of the effort of a step.

    A step may take `LONGEST_STEP`, or as long as one attempt to solve it where this is longer. The
    times are rough (s on a core of 2023), and depend on sizes alone, so that results do not depend
    on the machine.
    """
    elements, fluid = scene.beam.elements, scene.fluid
    residual = 3e-7 + 5e-8 * elements
    added_mass = 0.0
    matrix = 5e-7 + 5e-9 * elements**2 + 1.5e-10 * elements**3
    if fluid is not None and fluid.present:
        residual += 2e-9 * elements**2
        matrix *= 2.0
        panels = elements * fluid.panels_per_element + 2 * fluid.panels_per_end(scene.beam)
        own, added_mass = MODELS[fluid.model].costs(elements, panels)
        residual += own
    # In the second half of a composed step every evaluation needs the added mass of a shape.
    shapes = 8.0 if scene.integrator.scheme == "composed" else 2.0
    attempt = shapes * added_mass + 3.0 * matrix + 12.0 * residual
    budget = max(LONGEST_STEP, attempt)
    return residual / budget, added_mass / budget, matrix / budget
