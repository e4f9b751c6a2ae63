r"""Second derivatives of the spatial discrete Lagrangian, applied to a direction.

As `planar_variation`, for bodies in space whose added mass does not vary with the shape. The
Lagrangian has torques and damping in it: a constant force f conjugate to the rotation vector theta
of a joint has the potential -f . theta, and its impulse at either end of a step is half of h f.

Directions and derivatives (3 N + 3,) are a shift of the mean centre and rotations omega of the
elements in the axes of space, R -> exp(hat omega) R. Derivatives along two rotations do not
commute,

.. math::
    \partial_\eta \partial_\omega L - \partial_\omega \partial_\eta L
        = \partial_{\omega \times \eta} L,

so that the derivative of (omega . grad L) by eta, which an adjoint needs, is what is computed
here, that of (eta . grad L) along omega, and (grad L x omega) . eta.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.gradients.planar_variation import SMALL
from swim_env.physics.runtime.compile import embedded, kernel
from swim_env.physics.runtime.linking import linked_kernel
from swim_env.physics.runtime.views import padded
from swim_env.physics.spatial.chain import SpatialBeam, sum_from_centres, sum_to_centres
from swim_env.physics.spatial.equations import apply_added_mass
from swim_env.physics.spatial.layout import Body, SpatialFluid
from swim_env.physics.spatial.rotations import (
    cross_matrix,
    inverse_jacobian,
    product,
    rotate,
    rotate_back,
    transposed_product,
)

Array = NDArray[np.float64]
# Of complex numbers; kernels that take real ones elsewhere take them too.
Complex = NDArray[Any]


def spatial_parameter_count(elements: int) -> int:
    """Return the number of parameters of a spatial beam.

    They are the masses of the elements (kg), their two rotary inertias (kg m^2), the share by which
    the fluid is denser, then stiffness, damping and natural bend of every joint, three numbers each
    (N m, N m s, 1).
    """
    return 3 * elements + 1 + 9 * (elements - 1)


class SpatialVariation(NamedTuple):
    """Work space of `vary_spatial`.

    Attributes
    ----------
    here, there : (N, 3, 3) complex arrays
        Directors at `a` and at `b`.
    blocks : (7, 3, 3) complex array
        Scratch.
    change, shift, push, lever : (N, 3) complex arrays
        Changes of d3, shifts of the centres, momenta and their levers.
    moved : (3,) complex array
        Shift of the mean centre.
    impulse : (6 N,) complex array
        A V/h.
    motion, product : (6 N,) arrays, padded
        The derivative of V, and A times it.
    u_a, u_b : (3 N + 3,) arrays
        The direction, times SMALL.
    slopes : (2, N - 1, 3) array
        Changes of the joints' rotation vectors at `a` and `b`.
    vectors : (2, 3) array
        Scratch.
    changes, parameters : (P,) arrays
        The direction's part by the parameters, times SMALL, and derivatives by them.
    """

    here: Complex
    there: Complex
    blocks: Complex
    change: Complex
    shift: Complex
    push: Complex
    lever: Complex
    moved: Complex
    impulse: Complex
    motion: Array
    product: Array
    u_a: Array
    u_b: Array
    slopes: Array
    vectors: Array
    changes: Array
    parameters: Array


def new_spatial_variation(elements: int) -> SpatialVariation:
    """Return the work space of `vary_spatial` for a body."""
    n, parameters = 3 * elements + 3, spatial_parameter_count(elements)
    return SpatialVariation(
        here=np.zeros((elements, 3, 3), np.complex128),
        there=np.zeros((elements, 3, 3), np.complex128),
        blocks=np.zeros((7, 3, 3), np.complex128),
        change=np.zeros((elements, 3), np.complex128),
        shift=np.zeros((elements, 3), np.complex128),
        push=np.zeros((elements, 3), np.complex128),
        lever=np.zeros((elements, 3), np.complex128),
        moved=np.zeros(3, np.complex128),
        impulse=np.zeros(6 * elements, np.complex128),
        motion=np.zeros(padded(6 * elements)),
        product=np.zeros(padded(6 * elements)),
        u_a=np.zeros(n),
        u_b=np.zeros(n),
        slopes=np.zeros((2, elements - 1, 3)),
        vectors=np.zeros((2, 3)),
        changes=np.zeros(parameters),
        parameters=np.zeros(parameters),
    )


@kernel
def _turn_frames(frames: Array, u: Array, out: Complex) -> None:
    """Write directors with their changes hat(omega) R."""
    for k in range(frames.shape[0]):
        x, y, z = u[3 + 3 * k], u[4 + 3 * k], u[5 + 3 * k]
        for a in range(3):
            p, q, r = frames[k, 0, a], frames[k, 1, a], frames[k, 2, a]
            out[k, 0, a] = complex(p, y * r - z * q)
            out[k, 1, a] = complex(q, z * p - x * r)
            out[k, 2, a] = complex(r, x * q - y * p)


@embedded
def _add_axial(factor: float, m: Complex, out: Complex) -> None:
    """Add a multiple of the axial vector of M - M^T."""
    out[0] += factor * (m[2, 1] - m[1, 2])
    out[1] += factor * (m[0, 2] - m[2, 0])
    out[2] += factor * (m[1, 0] - m[0, 1])


@embedded
def _add_cross(factor: float, a: Complex, b: Complex, out: Complex) -> None:
    """Add a multiple of a vector product."""
    out[0] += factor * (a[1] * b[2] - a[2] * b[1])
    out[1] += factor * (a[2] * b[0] - a[0] * b[2])
    out[2] += factor * (a[0] * b[1] - a[1] * b[0])


@embedded
def _product_transposed(a: Complex, b: Complex, out: Complex) -> None:
    """Write a b^T (3, 3); not onto them."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[j, 0] + a[i, 1] * b[j, 1] + a[i, 2] * b[j, 2]


@kernel
def _curving(square: complex) -> complex:
    """Return (1 - (t/2) cot(t/2))/t^2 of an angle by its square, with its derivative."""
    s = square.real
    if s <= 0.01:
        value = 1.0 / 12.0 + s * (
            1.0 / 720.0 + s * (1.0 / 30240.0 + s * (1.0 / 1209600.0 + s / 47900160.0))
        )
        slope = 1.0 / 720.0 + s * (1.0 / 15120.0 + s * (1.0 / 403200.0 + s / 11975040.0))
    else:
        t = math.sqrt(s)
        sine, cosine = math.sin(0.5 * t), math.cos(0.5 * t)
        value = (1.0 - 0.5 * t * cosine / sine) / s
        slope = ((0.125 / (sine * sine)) - 0.25 * cosine / (sine * t) - value) / s
    return complex(value, slope * square.imag)


@kernel
def _add_force(
    half: float, theta: Complex, force: Complex, frame: Complex, v: Complex, out: Complex, j: int
) -> None:
    """Add half R J_l(theta)^-1 f to the element behind joint j, and take it off that in front."""
    t, local = v[0], v[1]
    curving = _curving(theta[0] * theta[0] + theta[1] * theta[1] + theta[2] * theta[2])
    t[:] = 0.0
    _add_cross(1.0, theta, force, t)
    for i in range(3):
        local[i] = force[i] - 0.5 * t[i]
    # theta x (theta x f) = theta (theta . f) - f (theta . theta).
    along = theta[0] * force[0] + theta[1] * force[1] + theta[2] * force[2]
    square = theta[0] * theta[0] + theta[1] * theta[1] + theta[2] * theta[2]
    for i in range(3):
        local[i] += curving * (theta[i] * along - force[i] * square)
    for i in range(3):
        turned = half * (frame[i, 0] * local[0] + frame[i, 1] * local[1] + frame[i, 2] * local[2])
        out[j + 1, i] += turned
        out[j, i] -= turned


@kernel
def _vary_strain(
    j: int,
    h: float,
    first: int,
    beam: SpatialBeam,
    v: SpatialVariation,
    out: Complex,
    late: Complex,
) -> None:
    """Add the derivatives of -h W of a joint whose directors are averaged, at both ends."""
    mean, behind, m, moment, turned = (
        v.blocks[0],
        v.blocks[1],
        v.blocks[2],
        v.blocks[3],
        v.blocks[4],
    )
    for i in range(3):
        for a in range(3):
            mean[i, a] = 0.5 * (v.here[j, i, a] + v.there[j, i, a])
            behind[i, a] = 0.5 * (v.here[j + 1, i, a] + v.there[j + 1, i, a])
    transposed_product(mean, behind, m)
    strain = v.blocks[5, 0]
    strain[:] = 0.0
    _add_axial(0.5, m, strain)
    joints = beam.elements - 1
    for i in range(3):
        place = first + 3 * j + i
        strain[i] -= complex(beam.rest[j, i], v.changes[place + 6 * joints])
        stiffness = complex(beam.stiffness[j, i], v.changes[place])
        v.parameters[place] -= h * strain[i].real * strain[i].imag
        strain[i] = -h * stiffness * strain[i]
        v.parameters[place + 6 * joints] -= strain[i].imag
    cross_matrix(1.0, strain, moment)
    for end in range(2):
        frames = v.here if end == 0 else v.there
        torque = out if end == 0 else late
        product(frames[j + 1], moment, m)
        _product_transposed(m, mean, turned)
        _add_axial(0.25, turned, torque[j + 1])
        product(behind, moment, m)
        _product_transposed(m, frames[j], turned)
        _add_axial(-0.25, turned, torque[j])


@kernel
def _vary_joints(
    h: float,
    held: Array,
    torque_changes: Array,
    transposed: bool,
    second: bool,
    beam: SpatialBeam,
    body: Body,
    v: SpatialVariation,
    by_torques: Array,
    torque: Complex,
    late: Complex,
) -> None:
    """Add the derivatives of what acts at the joints, at `a` and at `b`."""
    pose, inc = body.pose, body.inc
    elements = beam.elements
    first, joints = 3 * elements + 1, elements - 1
    theta, force = v.blocks[5], v.blocks[6]
    for j in range(joints):
        for end in range(2):
            u = v.u_a if end == 0 else v.u_b
            frames = pose.directors if end == 0 else inc.directors
            angles = pose.angles if end == 0 else inc.angles
            for i in range(3):
                v.vectors[0, i] = u[6 + 3 * j + i] - u[3 + 3 * j + i]
            rotate_back(frames[j + 1], v.vectors[0], v.vectors[1])
            inverse_jacobian(1.0, angles[j], v.vectors[1], v.slopes[end, j])
        if not beam.strain_of_angles:
            _vary_strain(j, h, first, beam, v, torque, late)
        for i in range(3):
            place = first + 3 * j + i
            here, there = v.slopes[0, j, i], v.slopes[1, j, i]
            turned = inc.angles[j, i] - pose.angles[j, i]
            change = there - here
            if second:
                turned, change = -turned, -change
            by_torques[j, i] += 0.5 * h * (here + there) / SMALL
            v.parameters[place + 3 * joints] -= 0.5 * turned * (here + there)
            rate = beam.damping[j, i] / h
            early = later = (
                SMALL * torque_changes[j, i] - v.changes[place + 3 * joints] * turned / h
            )
            if transposed:
                # Dampers of the earlier and the later end do not do the same.
                early += rate * (here + there)
                later -= rate * (here + there)
            else:
                early -= rate * change
                later -= rate * change
            if second:
                early, later = later, early
            strain = complex(0.0, 0.0)
            if beam.strain_of_angles:
                bend = complex(
                    0.5 * (pose.angles[j, i] + inc.angles[j, i]) - beam.rest[j, i],
                    0.5 * (here + there) - v.changes[place + 6 * joints],
                )
                strain = complex(beam.stiffness[j, i], v.changes[place]) * bend
                v.parameters[place] -= h * bend.real * bend.imag
                v.parameters[place + 6 * joints] += h * strain.imag
            force[0, i] = complex(held[j, i], early) - strain
            force[1, i] = complex(held[j, i], later) - strain
            theta[0, i] = complex(pose.angles[j, i], here)
            theta[1, i] = complex(inc.angles[j, i], there)
        half = 0.5 * h
        _add_force(half, theta[0], force[0], v.here[j + 1], v.blocks[0], torque, j)
        _add_force(half, theta[1], force[1], v.there[j + 1], v.blocks[0], late, j)


@kernel
def _vary_motion(
    z: Array, h: float, beam: SpatialBeam, fluid: SpatialFluid, body: Body, v: SpatialVariation
) -> None:
    """Write shifts and the fluid's impulse with their derivatives."""
    pose, inc, mass = body.pose, body.inc, body.mass
    elements = beam.elements
    _turn_frames(pose.directors, v.u_a, v.here)
    _turn_frames(inc.directors, v.u_b, v.there)
    for k in range(elements):
        for i in range(3):
            imaginary = v.there[k, i, 2].imag - v.here[k, i, 2].imag
            v.change[k, i] = complex(inc.change[k, i, 2], imaginary)
    for i in range(3):
        v.moved[i] = complex(z[i], v.u_b[i] - v.u_a[i])
    sum_to_centres(v.change, v.moved, beam.element_length, v.shift)
    if not fluid.present:
        return
    turn, local = v.blocks[0], v.blocks[1, 0]
    for k in range(elements):
        rotate_back(v.here[k], v.shift[k], local)
        for i in range(3):
            v.motion[6 * k + i] = local[i].imag
        transposed_product(v.here[k], v.there[k], turn)
        local[:] = 0.0
        _add_axial(0.5, turn, local)
        for i in range(3):
            v.motion[6 * k + 3 + i] = local[i].imag
    apply_added_mass(fluid, mass.added, v.motion, v.product)
    denser, energy = v.changes[3 * elements], 0.0
    for i in range(6 * elements):
        v.impulse[i] = complex(inc.impulse[i], v.product[i] / h + denser * inc.impulse[i])
        energy += inc.motion[i] * v.product[i] / h
    v.parameters[3 * elements] += energy


@linked_kernel
def vary_spatial(
    z: Array,
    h: float,
    u_a: Array,
    u_b: Array,
    changes: Array,
    held: Array,
    torque_changes: Array,
    transposed: bool,
    second: bool,
    beam: SpatialBeam,
    fluid: SpatialFluid,
    body: Body,
    v: SpatialVariation,
    out_a: Array,
    out_b: Array,
    by_torques: Array,
    parameters: Array,
) -> None:
    """Differentiate dL/da and dL/db of a step along a direction.

    Parameters
    ----------
    z : (3 N + 3,) array
        Increment from `a` to `b`.
    h : float
        Length of the step (s).
    u_a, u_b : (3 N + 3,) arrays
        The direction.
    changes, torque_changes : (P,), (N - 1, 3) arrays
        Its part by the parameters, see `spatial_parameter_count`, and by the torques.
    held : (N - 1, 3) array
        Torques less what damping takes (N m).
    transposed : bool
        Whether the direction multiplies the derivatives from the left, as in an adjoint, where the
        derivatives by the direction's own ends are wanted.
    second : bool
        Whether `a` is the later end.
    beam, fluid, body : SpatialBeam, SpatialFluid, Body
        The scene, and what `evaluate_spatial_step` left for the step from `a` to `b`.
    v : SpatialVariation
        Work space.
    out_a, out_b : (3 N + 3,) arrays
        Overwritten: the derivatives of dL/da and dL/db.
    by_torques, parameters : (N - 1, 3), (P,) arrays
        The derivatives by the torques and of dL/d parameter are added.
    """
    elements = beam.elements
    for i in range(u_a.size):
        v.u_a[i] = SMALL * u_a[i]
        v.u_b[i] = SMALL * u_b[i]
    for i in range(changes.size):
        v.changes[i] = SMALL * changes[i]
        v.parameters[i] = 0.0
    _vary_motion(z, h, beam, fluid, body, v)
    rate = 1.0 / h
    turn, spin, m = v.blocks[0], v.blocks[1], v.blocks[2]
    local, turning, other, total = v.blocks[3, 0], v.blocks[3, 1], v.blocks[3, 2], v.blocks[4, 0]
    total[:] = 0.0
    for k in range(elements):
        if fluid.present:
            for i in range(3):
                local[i] = v.impulse[6 * k + i]
            rotate(v.here[k], local, v.push[k])
        mass = rate * complex(beam.mass[k], v.changes[k])
        for i in range(3):
            v.parameters[k] += rate * v.shift[k, i].real * v.shift[k, i].imag
            # What the fluid pushes with is kept for the Munk moment.
            v.change[k, i] = v.push[k, i] if fluid.present else 0.0
            v.push[k, i] = mass * v.shift[k, i] + v.change[k, i]
            total[i] += v.push[k, i]
    sum_from_centres(v.push, beam.element_length, v.lever)
    for i in range(3):
        out_a[i], out_b[i] = -total[i].imag, total[i].imag
    for k in range(elements):
        turning[:] = 0.0
        if fluid.present:
            transposed_product(v.here[k], v.there[k], turn)
            for i in range(3):
                local[i] = v.impulse[6 * k + 3 + i]
            cross_matrix(1.0, local, spin)
            product(turn, spin, m)
            local[:] = 0.0
            _add_axial(0.5, m, local)
            rotate(v.here[k], local, turning)
        for a in range(2):
            inertia = rate * complex(beam.inertia[k, a], v.changes[elements + 2 * k + a])
            local[:] = 0.0
            _add_cross(1.0, v.here[k, :, a], v.there[k, :, a], local)
            along = complex(0.0, 0.0)
            for i in range(3):
                turning[i] += inertia * local[i]
                along += v.here[k, i, a] * v.there[k, i, a]
            # |d' - d|^2/2 = 1 - d . d'.
            v.parameters[elements + 2 * k + a] -= rate * along.imag
        # The gradient at `a`, and at `b` in place of the push.
        for i in range(3):
            local[i] = v.lever[k, i]
            other[i] = v.change[k, i]
        v.change[k] = 0.0
        v.push[k] = 0.0
        _add_cross(-1.0, v.here[k, :, 2], local, v.change[k])
        _add_cross(1.0, v.there[k, :, 2], local, v.push[k])
        _add_cross(1.0, other, v.shift[k], v.change[k])
        for i in range(3):
            v.change[k, i] -= turning[i]
            v.push[k, i] += turning[i]
    _vary_joints(
        *(h, held, torque_changes, transposed, second, beam, body, v),
        *(by_torques, v.change, v.push),
    )
    for k in range(elements):
        first = 3 + 3 * k
        for i in range(3):
            out_a[first + i] = v.change[k, i].imag
            out_b[first + i] = v.push[k, i].imag
        if transposed:
            for end in range(2):
                u, gradient = (v.u_a, v.change[k]) if end == 0 else (v.u_b, v.push[k])
                out = out_a if end == 0 else out_b
                for i in range(3):
                    s, t = (i + 1) % 3, (i + 2) % 3
                    out[first + i] += (
                        gradient[s].real * u[first + t] - gradient[t].real * u[first + s]
                    )
    for i in range(out_a.size):
        out_a[i] /= SMALL
        out_b[i] /= SMALL
    for i in range(changes.size):
        parameters[i] += v.parameters[i] / SMALL
