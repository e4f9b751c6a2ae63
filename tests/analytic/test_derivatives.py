"""Gradients of the added mass and of L_d against an independent complex step."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from swim_env.physics.fluid.layout import FluidConstants
from swim_env.physics.planar.chain import BeamConstants
from tests.analytic.probes import StepProbe, fluid_constants, probe_fluid, probe_step
from tests.invariants.runs import (
    largest,
    orders,
)
from tests.reference import independent
from tests.support import Array, uniform


class Shape(NamedTuple):
    """A bent beam in its fluid."""

    joints: Array
    fluid: FluidConstants


SHAPES = {
    "straight": Shape(np.zeros(8), fluid_constants(9, 4)),
    "default bent": Shape(uniform(8, seed=9, size=0.5), fluid_constants(9, 4)),
    "two elements": Shape(np.array([0.9]), fluid_constants(2, 2, 3)),
    "two at 140 degrees": Shape(np.array([2.45]), fluid_constants(2, 8)),
    "three finely cut": Shape(np.array([1.9, -1.2]), fluid_constants(3, 12)),
    "axial": Shape(uniform(4, seed=5, size=0.9), fluid_constants(5, 6, 2, axial=True)),
    "axial, three strongly": Shape(np.array([1.6, 1.5]), fluid_constants(3, 12, 4, axial=True)),
    "zigzag": Shape(1.5 * (-1.0) ** np.arange(8), fluid_constants(9, 8, 2)),
    "hook": Shape(np.full(8, 0.6), fluid_constants(9, 4, axial=True)),
    "long": Shape(uniform(26, seed=27, size=0.4), fluid_constants(27, 4)),
    "thick and short": Shape(
        np.array([0.5, -0.7, 0.3]),
        fluid_constants(4, 6, 5, axial=True, length=0.3, half_thickness=0.02, density=998.0),
    ),
}


def reference_fluid(fluid: FluidConstants) -> dict[str, Any]:
    """Return what the independent implementation calls these constants."""
    geometry = fluid.geometry
    return {
        "length": geometry.elements * geometry.element_length,
        "half_thickness": geometry.half_thickness,
        "density": fluid.density,
        "panels_per_element": 2 * geometry.side_panels,
        "cap_panels": geometry.cap_panels,
        "axial": fluid.axial,
    }


def kept_motions(fluid: FluidConstants) -> list[int]:
    """Return which of the reference's motions the package has: of the axial ones the ends'."""
    n = fluid.geometry.elements
    return [*range(2 * n), *([2 * n, 3 * n - 1] if fluid.axial else [])]


def reference_mass(shape: Shape) -> tuple[Array, Array]:
    """Return A (K, K) and dA/dtheta (N, K, K) of the independent implementation."""
    angles = np.concatenate([[0.0], np.cumsum(shape.joints)])
    mass, tensor = independent._added_mass_and_tensor(angles, **reference_fluid(shape.fluid))
    kept = kept_motions(shape.fluid)
    dropped = np.delete(mass, kept, axis=0)
    assert np.abs(dropped).max(initial=0.0) < 1e-15 * largest(mass)
    return mass[np.ix_(kept, kept)], tensor[:, kept][:, :, kept]


@pytest.mark.parametrize("name", SHAPES)
def test_added_mass_is_the_independent_one(name: str) -> None:
    shape = SHAPES[name]
    exact, _ = reference_mass(shape)
    found = probe_fluid(shape.joints, shape.fluid).mass
    assert largest(found - exact) < 1e-13 * largest(exact)
    assert np.array_equal(found, found.T), f"{name}: A is not symmetric"


@pytest.mark.parametrize("name", SHAPES)
def test_shape_gradient_is_the_complex_step(name: str) -> None:
    shape = SHAPES[name]
    mass, tensor = reference_mass(shape)
    rng = np.random.default_rng(7)
    for _ in range(3):
        motion = rng.normal(size=tensor.shape[1])
        exact = 0.5 * np.einsum("i,kij,j->k", motion, tensor, motion)
        found = probe_fluid(shape.joints, shape.fluid, motion).gradient
        # The mirror makes a straight beam's gradient vanish.
        scale = max(float(np.abs(exact).max()), 0.01 * float(motion @ mass @ motion))
        assert largest(found - exact) < 1e-11 * scale
        whole = abs(float(found.sum())) / scale
        assert whole < 1e-14, f"{name}: turning the whole beam changes A by {whole:.1e}"


class Step(NamedTuple):
    """A step from q by the increment z, both in the package's coordinates."""

    q: Array
    p: Array
    torques: Array
    z: Array
    h: float
    beam: BeamConstants
    fluid: FluidConstants
    reference: independent._Beam

    def probe(self, *, difference: float = 0.0, adjoint: bool = False) -> StepProbe:
        return probe_step(*self[:7], difference=difference, adjoint=adjoint)


def make_step(
    elements: int,
    fluid: FluidConstants,
    bend: float,
    seed: int,
    h: float = 0.01,
    retardation: float = 1e-3,
) -> Step:
    rng = np.random.default_rng(seed)
    dl = 1.0 / elements
    stiffness = rng.uniform(1.0, 8.0, elements - 1)
    beam = BeamConstants(
        elements, dl, 0.31 * dl, 1e-3 * dl, stiffness / dl, stiffness / dl * retardation
    )
    q = np.concatenate([[0.4, -0.7, 2.5], rng.uniform(-bend, bend, elements - 1)])
    z = np.concatenate([rng.normal(size=2) * 0.02, rng.uniform(-0.1, 0.1, elements)])
    p, torques = rng.normal(size=elements + 2), rng.normal(size=elements - 1)
    reference = independent._Beam(dl, 0.31, 1e-3, stiffness, h, fluid.axial)
    return Step(q, p, torques, z, h, beam, fluid, reference)


STEPS = {
    "default": lambda: make_step(9, fluid_constants(9, 4), 0.4, 1),
    "three, strongly bent": lambda: make_step(3, fluid_constants(3, 12), 1.3, 2),
    "axial": lambda: make_step(5, fluid_constants(5, 4, 2, axial=True), 0.8, 3, h=0.005),
    "two elements": lambda: make_step(2, fluid_constants(2, 6, axial=True), 1.5, 4, h=0.05),
    "no fluid": lambda: make_step(
        6, fluid_constants(6, 2, density=0.0, model="none"), 1.0, 5, retardation=0.01
    ),
}


def angles_of(q: Array) -> Array:
    """Return (mean centre, element angles) of q, whose angles are the first and the joints'."""
    return np.concatenate([q[:2], np.cumsum(q[2:])])


def head_coordinates(x: NDArray[Any], dl: float) -> NDArray[Any]:
    """Turn (mean centre, angles) (..., N + 2) into the reference's (head, angles)."""
    tangents = independent._tangent(x[..., 2:])
    from_head = np.cumsum(dl * tangents, axis=-2) - 0.5 * dl * tangents
    return np.concatenate([x[..., :2] - from_head.mean(axis=-2), x[..., 2:]], axis=-1)


def reference_derivatives(step: Step, z: Array, shape: bool = True) -> tuple[Array, Array]:
    """Return D1 L_d and D2 L_d in (mean centre, angles) by complex step of the literal L_d."""
    dl = step.reference.dl
    x0, x1 = angles_of(step.q), angles_of(step.q + z)
    mass = tensor = None
    if step.fluid.density:
        fluid = reference_fluid(step.fluid)
        mass, tensor = independent._added_mass_and_tensor(x0[2:], **fluid)
    probe = 1j * independent.STEP * np.eye(len(x0))
    u0, u1 = head_coordinates(x0, dl), head_coordinates(x1, dl)
    value = independent._discrete_lagrangian
    first = value(head_coordinates(x0 + probe, dl), u1, mass, step.reference).imag
    second = value(u0, head_coordinates(x1 + probe, dl), mass, step.reference).imag
    first, second = first / independent.STEP, second / independent.STEP
    if tensor is not None and shape:
        motion = independent._step_motions(u0, u1, step.reference)
        first[2:] += np.einsum("i,kij,j->k", motion, tensor, motion) / (2.0 * step.h)
    return first, second


def generalised_impulse(step: Step, z: Array) -> Array:
    """Return the impulse h F of torques and damping on mean centre and angles."""
    impulse = step.h * step.torques - step.beam.joint_damping * z[3:]
    force = np.zeros(len(z))
    force[3:] += impulse
    force[2:-1] -= impulse
    return force


def reference_residual(step: Step, z: Array, shape: bool = True) -> Array:
    first = reference_derivatives(step, z, shape)[0]
    return step.p + first + 0.5 * generalised_impulse(step, z)


@pytest.mark.parametrize("name", STEPS)
def test_residual_and_change_are_derivatives_of_the_lagrangian(name: str) -> None:
    step = STEPS[name]()
    found = step.probe()
    first, second = reference_derivatives(step, step.z)
    scale = float(np.abs(first).max())
    residual = reference_residual(step, step.z)
    assert largest(found.residual - residual) < 1e-12 * scale
    change = first + second + generalised_impulse(step, step.z)
    assert largest(found.change - change) < 1e-12 * scale
    # What is left undisturbed by shifting and turning everything: momentum's conservation law.
    assert not found.change[:2].any(), f"{name}: linear momentum changes by {found.change[:2]}"


@pytest.mark.parametrize("name", STEPS)
def test_mass_is_the_independent_one(name: str) -> None:
    step = STEPS[name]()
    found = step.probe().mass
    x = angles_of(step.q)
    mass = None
    if step.fluid.density:
        mass, _ = independent._added_mass_and_tensor(x[2:], **reference_fluid(step.fluid))
    u = head_coordinates(x, step.reference.dl)
    probe = x + 1j * independent.STEP * np.eye(len(x))
    chain = head_coordinates(probe, step.reference.dl).imag / independent.STEP
    exact = chain @ independent._mass(u, mass, step.reference) @ chain.T
    assert largest(found - exact) < 1e-13 * largest(exact)


def differentiate(function: Callable[[Array], Array], z: Array) -> Array:
    """Return the Jacobian of a function at z by differences of eighth order."""
    weights = {1: 4.0 / 5.0, 2: -1.0 / 5.0, 3: 4.0 / 105.0, 4: -1.0 / 280.0}
    size = 0.02
    columns = [
        sum(
            weight * (function(z + k * size * unit) - function(z - k * size * unit)) / size
            for k, weight in weights.items()
        )
        for unit in np.eye(len(z))
    ]
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("name", STEPS)
def test_newton_matrix_with_the_shape_force_held(name: str) -> None:
    step = STEPS[name]()
    found = step.probe().jacobian
    exact = -differentiate(lambda z: reference_residual(step, z, shape=False), step.z)
    assert largest(found - exact) < 1e-12 * largest(exact)


@pytest.mark.parametrize("name", [name for name in STEPS if name != "no fluid"])
def test_newton_matrix_with_the_shape_force_differenced(name: str) -> None:
    step = STEPS[name]()
    exact = -differentiate(lambda z: reference_residual(step, z), step.z)
    held = step.probe().jacobian
    part = float(np.abs(held - exact).max())
    sizes = [1e-1, 1e-2, 1e-3]
    errors = []
    for size in sizes:
        found = step.probe(difference=size).jacobian
        errors.append(float(np.abs(found - exact).max()) / part)
    observed = orders(errors, ratio=10.0)
    text = f"{name}: errors {errors} of the shape force's part {part:.2e}, sizes {sizes}"
    # The force is a quadratic form, so the quotient is off in proportion to its step.
    assert (np.abs(observed - 1.0) < 1e-3).all(), f"{text}, orders {observed.tolist()}"
    used = step.probe(difference=1e-5).jacobian
    assert largest(used - exact) < 1e-3 * part
