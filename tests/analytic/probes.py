"""Views into the compiled kernels and into a simulator's mass, for tests only."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from swim_env.physics.planar.beam import BeamConstants
from swim_env.physics.planar.lagrangian import (
    CHANGE,
    RESIDUAL,
    carve_step_arrays,
    evaluate_step,
    mass_matrix,
    pose_jacobian,
    set_pose,
    step_array_size,
    step_jacobian,
)
from swim_env.physics.solve.integrator import prepare, work_sizes

from swim_env import Simulator
from swim_env.physics.fluid.added_mass import (
    FLUID_MODELS,
    FluidConstants,
    added_mass,
    carve_fluid_work,
    fluid_work_sizes,
    motion_count,
    shape_force,
)
from swim_env.physics.fluid.outline import FluidGeometry
from swim_env.physics.loading import load_kernels
from swim_env.physics.runtime.compile import entry_kernel
from swim_env.physics.runtime.dense import copy
from swim_env.sim.batch import Bodies

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@entry_kernel
def _fluid_probe(
    joint_angles: Array,
    motion: Array,
    fluid: FluidConstants,
    floats: Array,
    integers: Integers,
    mass: Array,
    raw: Array,
    gradient: Array,
) -> int:
    work = carve_fluid_work(floats, integers, fluid)
    status = added_mass(joint_angles, fluid, work, mass)
    if status == 0:
        shape_force(motion, fluid, work, gradient)
        for a in range(raw.shape[0]):
            for b in range(raw.shape[0]):
                total = 0.0
                for i in range(work.loads.shape[1]):
                    total += work.loads[a, i] * work.strengths[i, b]
                raw[a, b] = -fluid.density * total
    return status


@entry_kernel
def _step_probe(
    q: Array,
    p: Array,
    torques: Array,
    z: Array,
    h: float,
    difference: float,
    beam: BeamConstants,
    fluid: FluidConstants,
    floats: Array,
    integers: Integers,
    residual: Array,
    change: Array,
    jacobian: Array,
    mass: Array,
) -> int:
    used = fluid_work_sizes(fluid)[0]
    step = floats[used : used + step_array_size(beam.elements, motion_count(fluid))]
    w = carve_step_arrays(step, beam.elements, motion_count(fluid))
    work = carve_fluid_work(floats[:used], integers, fluid)
    set_pose(q, beam, w)
    status = added_mass(q[3:], fluid, work, w.added_mass)
    if status == 0:
        mass_matrix(beam, fluid, work, w)
        for i in range(mass.shape[0]):
            copy(w.mass[i], mass[i])
        evaluate_step(p, torques, z, h, beam, fluid, work, w)
        copy(w.unknowns[RESIDUAL], residual)
        copy(w.unknowns[CHANGE], change)
        step_jacobian(h, beam, fluid, work, difference, w)
        for i in range(jacobian.shape[0]):
            copy(w.jacobian[i], jacobian[i])
    return status


@entry_kernel
def _pose_probe(
    q: Array,
    p: Array,
    torques: Array,
    z: Array,
    h: float,
    ends: Array,
    beam: BeamConstants,
    fluid: FluidConstants,
    floats: Array,
    integers: Integers,
    residual: Array,
    change: Array,
    jacobian: Array,
    pose: Array,
) -> int:
    used = fluid_work_sizes(fluid)[0]
    step = floats[used : used + step_array_size(beam.elements, motion_count(fluid))]
    w = carve_step_arrays(step, beam.elements, motion_count(fluid))
    work = carve_fluid_work(floats[:used], integers, fluid)
    status = prepare(q, p, beam, fluid, work, w)
    if status != 0:
        return status
    pose_jacobian(h, beam, w)
    for i in range(pose.shape[0]):
        copy(w.jacobian[i], pose[i])
    if ends.size > 0:
        w.adjoint[0] = 1.0
        status = added_mass(ends, fluid, work, w.added_mass)
        if status != 0:
            return status
    evaluate_step(p, torques, z, h, beam, fluid, work, w)
    copy(w.unknowns[RESIDUAL], residual)
    copy(w.unknowns[CHANGE], change)
    step_jacobian(h, beam, fluid, work, 0.0, w)
    for i in range(jacobian.shape[0]):
        copy(w.jacobian[i], jacobian[i])
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
    return FluidConstants(FLUID_MODELS[model], geometry, density, axial)


class FluidProbe(NamedTuple):
    """Added mass, the matrix before its symmetric part is taken, and the shape gradient."""

    mass: Array
    raw: Array
    gradient: Array


def probe_fluid(
    joint_angles: Array, fluid: FluidConstants, motion: Array | None = None
) -> FluidProbe:
    load_kernels()
    count = int(motion_count(fluid))
    floats, integers = fluid_work_sizes(fluid)
    if motion is None:
        motion = np.zeros(count)
    mass, raw = np.zeros((count, count)), np.zeros((count, count))
    gradient = np.zeros(fluid.geometry.elements)
    work = (np.zeros(floats), np.zeros(integers, dtype=np.int64))
    status = _fluid_probe(
        np.asarray(joint_angles, dtype=float), motion, fluid, *work, mass, raw, gradient
    )
    assert status == 0, f"no added mass, status {status}, for joints {joint_angles}"
    return FluidProbe(mass, raw, gradient)


class StepProbe(NamedTuple):
    """Residual, change of the momentum, minus the residual's Jacobian, and the mass at q_n."""

    residual: Array
    change: Array
    jacobian: Array
    mass: Array


def probe_step(
    q: Array,
    p: Array,
    torques: Array,
    z: Array,
    h: float,
    beam: BeamConstants,
    fluid: FluidConstants,
    difference: float = 0.0,
) -> StepProbe:
    load_kernels()
    n = beam.elements + 2
    floats, integers = work_sizes(beam, fluid)
    out = StepProbe(np.zeros(n), np.zeros(n), np.zeros((n, n)), np.zeros((n, n)))
    work = (np.zeros(floats), np.zeros(integers, dtype=np.int64))
    status = _step_probe(q, p, torques, z, h, difference, beam, fluid, *work, *out)
    assert status == 0, f"the step cannot be evaluated, status {status}"
    return out


class PoseProbe(NamedTuple):
    """Residual, change, Newton's matrix, and the one made of the mass at q_n."""

    residual: Array
    change: Array
    jacobian: Array
    pose: Array


def probe_pose(
    q: Array,
    p: Array,
    torques: Array,
    z: Array,
    h: float,
    beam: BeamConstants,
    fluid: FluidConstants,
    *,
    adjoint: bool = False,
) -> PoseProbe:
    """Evaluate a step after `prepare`, as a run does, or the adjoint of a step."""
    load_kernels()
    n = beam.elements + 2
    floats, integers = work_sizes(beam, fluid)
    out = PoseProbe(np.zeros(n), np.zeros(n), np.zeros((n, n)), np.zeros((n, n)))
    work = (np.zeros(floats), np.zeros(integers, dtype=np.int64))
    ends = q[3:] + z[3:] if adjoint else np.zeros(0)
    status = _pose_probe(q, p, torques, z, h, ends, beam, fluid, *work, *out)
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
