"""Views into the compiled kernels and into a simulator's mass, for tests only."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env import Simulator
from swim_env.physics.fluid import models
from swim_env.physics.fluid.layout import (
    FluidConstants,
    FluidWork,
    motion_count,
    new_fluid_work,
)
from swim_env.physics.fluid.models import added_mass, shape_force
from swim_env.physics.fluid.outline import LATERAL, LENGTH, ROTARY, FluidGeometry
from swim_env.physics.fluid.sources import POTENTIAL, normal_influence
from swim_env.physics.loading import load_model
from swim_env.physics.planar.chain import BeamConstants
from swim_env.physics.planar.equations import evaluate_step
from swim_env.physics.planar.matrix import (
    adjoint_jacobian,
    mass_matrix,
    pose_jacobian,
    step_jacobian,
)
from swim_env.physics.runtime.compile import entry_kernel
from swim_env.physics.runtime.dense import copy
from swim_env.physics.runtime.references import Referenced
from swim_env.physics.solve.constants import Constants, SolverConstants
from swim_env.physics.solve.prepare import prepare
from swim_env.physics.solve.state import Member, new_member
from swim_env.sim.batch import Bodies
from tests.support import Array

Integers = NDArray[np.int64]


class FluidProbe(NamedTuple):
    """Added mass, the matrix before its symmetric part is taken, and the shape gradient."""

    mass: Array
    raw: Array
    gradient: Array


@entry_kernel
def _fluid_probe(
    joint_angles: Array,
    motion: Array,
    fluid: FluidConstants,
    work: FluidWork,
    out: FluidProbe,
) -> int:
    status = added_mass(joint_angles, fluid, work, out.mass)
    if status == 0:
        shape_force(motion, fluid, work, out.gradient)
        for a in range(out.raw.shape[0]):
            for b in range(out.raw.shape[0]):
                out.raw[a, b] = -fluid.density * work.product[a, b]
    return status


class StepProbe(NamedTuple):
    """A step's residual and change of momentum, and matrices at its start.

    They are minus the residual's Jacobian, the Jacobian that is made of the mass at q_n, and that
    mass.
    """

    residual: Array
    change: Array
    jacobian: Array
    pose: Array
    mass: Array


@entry_kernel
def _step_probe(
    q: Array,
    p: Array,
    torques: Array,
    z: Array,
    h: float,
    difference: float,
    ends: Array,
    scene: Constants,
    m: Member,
    out: StepProbe,
) -> int:
    beam, fluid, solver = scene.beam, scene.fluid, scene.solver
    body, work, newton = m.body, m.fluid_work, m.newton
    copy(q, m.state.q)
    copy(p, m.state.p)
    copy(q[3:], m.state.inertia)
    status = prepare(m.state, beam, fluid, solver, body, work, newton, m.step.effort)
    if status != 0:
        return status
    pose_jacobian(h, beam, body.pose, body.mass, newton.jacobian)
    for i in range(out.pose.shape[0]):
        copy(newton.jacobian[i], out.pose[i])
    mass_matrix(beam, fluid, body, newton)  # prepare has left its factor
    for i in range(out.mass.shape[0]):
        copy(body.mass.total[i], out.mass[i])
    if ends.size > 0:
        status = added_mass(ends, fluid, work, body.mass.added)
        if status != 0:
            return status
        evaluate_step(p, torques, z, h, True, False, beam, fluid, body, work)
        adjoint_jacobian(h, beam, fluid, body, newton)
    else:
        evaluate_step(p, torques, z, h, False, False, beam, fluid, body, work)
        step_jacobian(h, difference, beam, fluid, body, work, newton)
    copy(body.balance.residual, out.residual)
    copy(body.balance.change, out.change)
    for i in range(out.jacobian.shape[0]):
        copy(newton.jacobian[i], out.jacobian[i])
    return status


def fluid_constants(
    elements: int,
    panels: int,
    caps: int = 1,
    *,
    axial: bool = False,
    length: float = 1.0,
    half_thickness: float = 0.01,
    density: float = 10.0,
    model: str = "panels",
) -> FluidConstants:
    geometry = FluidGeometry(elements, length / elements, half_thickness, panels // 2, caps)
    return models.fluid_constants(model, geometry, density, axial=axial)


def probe_fluid(
    joint_angles: Array, fluid: FluidConstants, motion: Array | None = None
) -> FluidProbe:
    load_model(list(models.MODELS)[fluid.model])
    count = int(motion_count(fluid))
    if motion is None:
        motion = np.zeros(count)
    gradient = np.zeros(fluid.geometry.elements)
    out = FluidProbe(np.zeros((count, count)), np.zeros((count, count)), gradient)
    given = Referenced(fluid), Referenced(new_fluid_work(fluid))
    status = _fluid_probe(np.asarray(joint_angles, dtype=float), motion, *given, out)
    assert status == 0, f"no added mass, status {status}, for joints {joint_angles}"
    return out


class PanelProbe(NamedTuple):
    """The added mass of panels and what it is made of.

    Normal influence and potential of unit sources (M, M), the panels' normal velocity under unit
    motions (M, 2 N), and their lengths (M,), padded by panels without length.
    """

    mass: Array
    normal: Array
    potential: Array
    motions: Array
    lengths: Array


def probe_panels(joint_angles: Array, fluid: FluidConstants) -> PanelProbe:
    elements = fluid.geometry.elements
    load_model(list(models.MODELS)[fluid.model])
    work = new_fluid_work(fluid)
    mass = np.zeros((2 * elements, 2 * elements))
    assert added_mass(joint_angles, Referenced(fluid), Referenced(work), mass) == 0
    panels, element = work.outline.panels, work.outline.element
    lengths = panels[LENGTH]
    normal = np.empty((lengths.size, lengths.size))
    normal_influence(panels, int(np.count_nonzero(lengths)), work.layers, normal)
    motions = np.zeros((lengths.size, 2 * elements))
    every = np.arange(lengths.size)
    motions[every, element], motions[every, elements + element] = panels[LATERAL], panels[ROTARY]
    return PanelProbe(mass, normal, work.layers[POTENTIAL], motions, lengths)


def probe_step(
    q: Array,
    p: Array,
    torques: Array,
    z: Array,
    h: float,
    beam: BeamConstants,
    fluid: FluidConstants,
    *,
    difference: float = 0.0,
    adjoint: bool = False,
) -> StepProbe:
    """Evaluate a step from q by z as a run does, or the adjoint of a step."""
    load_model(list(models.MODELS)[fluid.model])
    n = beam.elements + 2
    square = np.zeros((3, n, n))
    out = StepProbe(np.zeros(n), np.zeros(n), *square)
    scene = Referenced(Constants(beam, fluid, SolverConstants(h, 1e-10)))
    member = Referenced(new_member(fluid))
    ends = q[3:] + z[3:] if adjoint else np.zeros(0)
    status = _step_probe(q, p, torques, z, h, difference, ends, scene, member, out)
    assert status == 0, f"the step cannot be evaluated, status {status}"
    return out


def mass_of(simulator: Simulator) -> Array:
    """Return the total mass (N + 2, N + 2) on (mean centre, element angles) at the present pose.

    The start by momentum p_0 = M v_0 gives one column for every unit velocity.
    """
    bodies = Bodies(simulator.scene)
    mass = []
    for velocity in np.eye(simulator.elements + 2):
        bodies.start(0, simulator.coordinates, velocity)
        mass.append(bodies.momenta[0].copy())
    return np.array(mass)


class RigidMass(NamedTuple):
    """Mass of the stiff straight body along itself and across, inertia and coupling there."""

    along: float
    across: float
    inertia: float
    coupling: float


def rigid_mass(simulator: Simulator) -> RigidMass:
    """Sum the mass of the straight beam along x to that of the rigid body about its centre."""
    mass = mass_of(simulator)
    n = simulator.elements + 2
    turning = np.zeros(n)
    turning[2:] = 1.0
    return RigidMass(
        float(mass[0, 0]),
        float(mass[1, 1]),
        float(turning @ mass @ turning),
        float(mass[1] @ turning),
    )
