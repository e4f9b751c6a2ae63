r"""Added mass of a body's panels, and its exact shape derivative by one adjoint.

The kinetic energy of the potential flow is a quadratic form of the elements' motions in their own
frames, V_k = (v1 v2 v3 w1 w2 w3), velocity of the centre and spin. With B the normal velocity of
the surface per unit motion (n . d_i, and ((x - r) x n) . d_i), S the areas, G the normal and P the
potential influence, n into the fluid,

.. math:: A = -\rho\, \mathrm{sym}(B^T \mathrm{diag}(S)\, P\, G^{-1} B),

as in the plane; it is positive because G is negative. With u = B V, sigma = G^-1 u, phi = P sigma
and mu = G^-T P^T S u the derivative of V^T A V/2 is -rho/2 times

.. math:: du \cdot (S \phi + \mu) + dS\, u \phi + (S u)^T dP\, \sigma - \mu^T dG\, \sigma.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.panel_mass import LARGEST_CONDITION, largest_column_sum
from swim_env.physics.runtime.compile import entry_kernel, kernel
from swim_env.physics.runtime.dense import (
    add_multiple,
    dot,
    invert,
    invert_in_order,
    mat_vec,
    mat_vec_transposed,
    multiply,
)
from swim_env.physics.runtime.linking import linked_kernel
from swim_env.physics.runtime.references import Referenced
from swim_env.physics.runtime.views import MEASURE, matrix, padded, vector
from swim_env.physics.spatial.panels.derivative import (
    BY_AREA,
    BY_CENTROID,
    BY_NORMAL,
    RECEIVER_ROWS,
    SOURCE_GRADIENTS,
    differentiate_influence,
    differentiate_panels,
)
from swim_env.physics.spatial.panels.influence import (
    AREA,
    CENTROID,
    KEPT,
    NORMAL,
    POINT_ROWS,
    SOURCE_COLUMNS,
    influence,
    lay_panels,
)
from swim_env.physics.spatial.panels.surface import (
    Surface,
    gap_status,
    gradient_to_turns,
    joints_status,
    place_centres,
    place_vertices,
    strips_status,
)
from swim_env.physics.spatial.vectors import (
    add_column,
    add_row,
    column,
    cross,
    director,
    inner,
    part,
    plus,
    row,
    scaled,
    to_space,
)
from swim_env.physics.status import FINE, INFLUENCE_SINGULAR

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: The normal influence is eliminated without row exchanges while no pivot is below this (its
#: diagonal is about -2 pi). On bodies of a metre with semi-axes from 1 to 200 mm, round or up to
#: twelve times as high as wide, bent by 0.4 rad at every joint, pivots stayed above 2 and no entry
#: grew beyond 13; flatter bodies take the elimination with exchanges.
SMALLEST_PIVOT = 0.3
#: Motions of an element.
MOTIONS = 6
# Rows of `PanelWork.vectors`.
VELOCITY, WEIGHT, SIGMA, MU, PHI, LOAD, SHARE, FACTORS, SUMS = range(9)
VECTORS = 9


class PanelWork(NamedTuple):
    """Arrays that `panel_added_mass` leaves behind for `panel_shape_force`, and scratch space.

    The numbers M of panels and 6 N of motions are padded to M' and K', multiples of LANES.

    Attributes
    ----------
    normal, potential, inverse : (M', M') arrays
        Transposed influences, and the inverse of the first.
    kept : (KEPT, M', M') array
        What the derivative takes of the influences.
    strengths, loads, product : (K', M'), (M', K'), (K', K') arrays
        Source strengths per unit motion; P^T diag(S) B; B^T G^-T P^T diag(S) B.
    points, motions, receivers, vectors : (POINT_ROWS, MOTIONS, RECEIVER_ROWS, VECTORS; M') arrays
        The panels; their normal velocities per unit motion of their element; derivatives by what
        receives; vectors, see the row names above.
    sources, gradients : (M', SOURCE_COLUMNS), (M', SOURCE_GRADIENTS) arrays
        The panels; derivatives by what sends.
    vertices, by_vertices : (V, 3) arrays
        The surface (m); derivatives by it.
    centres, forces, torques, nodes : (N, 3) arrays
        The elements' centres (m); derivatives by what moves and turns with elements and nodes.
    permutation : (M',) int array
        Row exchanges of the elimination.
    """

    normal: Array
    potential: Array
    inverse: Array
    kept: Array
    strengths: Array
    loads: Array
    product: Array
    points: Array
    motions: Array
    receivers: Array
    vectors: Array
    sources: Array
    gradients: Array
    vertices: Array
    by_vertices: Array
    centres: Array
    forces: Array
    torques: Array
    nodes: Array
    permutation: Integers


def panel_views(floats: Array, integers: Integers, surface: Surface) -> tuple[PanelWork, int]:
    """Lay out a `PanelWork`; returns it and how many float64 numbers it takes.

    The buffers are zero at first: what pads them is never written.
    """
    n = surface.elements
    m = padded(surface.faces.shape[0])
    k = padded(MOTIONS * n)
    v = 2 + surface.rings.shape[0] * surface.circle.shape[1]
    normal, end = matrix(floats, 0, m, m)
    potential, end = matrix(floats, end, m, m)
    inverse, end = matrix(floats, end, m, m)
    kept, end = vector(floats, end, KEPT * m * m)
    strengths, end = matrix(floats, end, k, m)
    loads, end = matrix(floats, end, m, k)
    product, end = matrix(floats, end, k, k)
    points, end = matrix(floats, end, POINT_ROWS, m)
    motions, end = matrix(floats, end, MOTIONS, m)
    receivers, end = matrix(floats, end, RECEIVER_ROWS, m)
    vectors, end = matrix(floats, end, VECTORS, m)
    sources, end = matrix(floats, end, m, SOURCE_COLUMNS)
    gradients, end = matrix(floats, end, m, SOURCE_GRADIENTS)
    vertices, end = matrix(floats, end, v, 3)
    by_vertices, end = matrix(floats, end, v, 3)
    centres, end = matrix(floats, end, n, 3)
    forces, end = matrix(floats, end, n, 3)
    torques, end = matrix(floats, end, n, 3)
    nodes, end = matrix(floats, end, n, 3)
    work = PanelWork(
        *(normal, potential, inverse, kept.reshape((KEPT, m, m)), strengths, loads, product),
        *(points, motions, receivers, vectors, sources, gradients, vertices, by_vertices),
        *(centres, forces, torques, nodes, integers),
    )
    return work, end


def panel_work_sizes(surface: Surface) -> tuple[int, int]:
    """Return how many float64 and int64 numbers of work space the panels take."""
    floats = int(panel_views(MEASURE, MEASURE, surface)[1])
    return floats, int(padded(len(surface.faces)))


def new_panel_work(surface: Surface) -> PanelWork:
    """Return new work space."""
    floats, integers = panel_work_sizes(surface)
    return panel_views(np.zeros(floats), np.zeros(integers, dtype=np.int64), surface)[0]


def panel_costs(panels: int) -> tuple[float, float]:
    """Return the rough times (s) of `panel_shape_force` and `panel_added_mass`."""
    return 3e-6 + 2e-8 * panels**2, 6e-6 + 1.9e-8 * panels**2 + 1e-10 * panels**3


@kernel
def invert_influence(count: int, work: PanelWork) -> int:
    """Invert the normal influence of the first panels, as many as count; 0 or a reason's code."""
    size = work.inverse.shape[0]
    for exchanged in range(2):
        for j in range(size):
            for i in range(size):
                work.inverse[j, i] = work.normal[j, i]
            if j >= count:
                work.inverse[j, j] = 1.0
        if exchanged == 0:
            if invert_in_order(work.inverse, SMALLEST_PIVOT):
                break
        else:
            before = largest_column_sum(count, work.inverse)
            if not invert(work.inverse, work.permutation):
                return INFLUENCE_SINGULAR
            if not before * largest_column_sum(count, work.inverse) <= LARGEST_CONDITION:
                return INFLUENCE_SINGULAR
    return FINE


@kernel
def _normal_velocities(directors: Array, surface: Surface, work: PanelWork) -> None:
    """Write B, of which every panel has the six numbers of its element."""
    for k in range(surface.elements):
        for p in range(surface.first[k], surface.first[k + 1]):
            normal = column(work.points, NORMAL, p)
            arm = plus(column(work.points, CENTROID, p), -1.0, row(work.centres, k))
            turning = cross(arm, normal)
            for axis in range(3):
                work.motions[axis, p] = inner(normal, director(directors, k, axis))
                work.motions[3 + axis, p] = inner(turning, director(directors, k, axis))


@kernel
def _collect_motions(surface: Surface, work: PanelWork) -> None:
    """Write the sources per unit motion, and P^T diag(S) B."""
    area = work.points[AREA]
    work.strengths[:] = 0.0
    for k in range(surface.elements):
        for p in range(surface.first[k], surface.first[k + 1]):
            for c in range(MOTIONS):
                add_multiple(work.strengths[MOTIONS * k + c], work.inverse[p], work.motions[c, p])
    weighted = work.receivers
    for c in range(MOTIONS):
        for p in range(area.size):
            weighted[c, p] = work.motions[c, p] * area[p]
    for j in range(surface.faces.shape[0]):
        for k in range(surface.elements):
            first, behind = surface.first[k], surface.first[k + 1]
            for c in range(MOTIONS):
                work.loads[j, MOTIONS * k + c] = dot(
                    work.potential[j, first:behind], weighted[c, first:behind]
                )


@linked_kernel
def panel_added_mass(directors: Array, surface: Surface, work: PanelWork, out: Array) -> int:
    """Evaluate the added mass of a shape.

    Parameters
    ----------
    directors : (N, 3, 3) array
        R_k of every element, columns d1, d2, d3.
    surface : Surface
        How the body is wrapped into panels.
    work : PanelWork
        Overwritten; `panel_shape_force` reads it.
    out : (6 N, 6 N) array, or padded
        Overwritten: the symmetric added mass in the elements' frames, motions element by element
        (kg, kg m, kg m^2).

    Returns
    -------
    int
        0, or the code of the reason why there is none (see `swim_env.physics.status`).
    """
    count = surface.faces.shape[0]
    status = joints_status(directors, surface)
    if status != FINE:
        return status
    place_centres(directors, surface, work.centres)
    place_vertices(directors, work.centres, surface, work.vertices)
    status = strips_status(directors, surface, work.vertices)
    if status != FINE:
        return status
    lay_panels(work.vertices, surface.faces, work.points, work.sources)
    status = gap_status(
        work.centres, surface, work.vertices, work.points, work.vectors, work.forces
    )
    if status != FINE:
        return status
    influence(
        work.points, work.sources, count, surface.gauss, work.normal, work.potential, work.kept
    )
    status = invert_influence(count, work)
    if status != FINE:
        return status
    _normal_velocities(directors, surface, work)
    _collect_motions(surface, work)
    multiply(work.strengths, work.loads, work.product)
    half = -0.5 * surface.density
    for a in range(MOTIONS * surface.elements):
        for b in range(a + 1):
            value = half * (work.product[a, b] + work.product[b, a])
            out[a, b] = value
            out[b, a] = value
    return FINE


@kernel
def _differentiate_velocities(
    directors: Array, surface: Surface, motion: Array, by_velocity: Array, work: PanelWork
) -> None:
    """Add what the panels' normal velocities depend on: normals, arms, and the elements' frames."""
    work.forces[:] = 0.0
    work.torques[:] = 0.0
    for k in range(surface.elements):
        velocity = to_space(directors, k, part(motion, MOTIONS * k))
        spin = to_space(directors, k, part(motion, MOTIONS * k + 3))
        for p in range(surface.first[k], surface.first[k + 1]):
            normal = scaled(by_velocity[p], column(work.points, NORMAL, p))
            arm = plus(column(work.points, CENTROID, p), -1.0, row(work.centres, k))
            moving = plus(velocity, 1.0, cross(spin, arm))
            add_column(work.receivers, BY_NORMAL, p, scaled(by_velocity[p], moving))
            push = cross(normal, spin)
            add_column(work.receivers, BY_CENTROID, p, push)
            add_row(work.forces, k, scaled(-1.0, push))
            add_row(work.torques, k, cross(velocity, normal))
            add_row(work.torques, k, cross(spin, cross(arm, normal)))


@linked_kernel
def panel_shape_force(
    directors: Array, motion: Array, surface: Surface, work: PanelWork, out: Array
) -> None:
    """Differentiate V^T A V/2 with respect to a rotation of every element, V held.

    Parameters
    ----------
    directors : (N, 3, 3) array
        As for `panel_added_mass`.
    motion : (6 N,) array, or padded
        Unit-motion velocities V (or increments), element by element.
    surface, work
        As `panel_added_mass` took and left them for this shape.
    out : (N, 3) array
        Overwritten: the derivative by eta_k, R_k -> R_k exp(hat eta_k), in units of V^T A V.
    """
    vectors, points, receivers = work.vectors, work.points, work.receivers
    velocity, weight, sigma, mu = vectors[VELOCITY], vectors[WEIGHT], vectors[SIGMA], vectors[MU]
    phi, load, share, sums = vectors[PHI], vectors[LOAD], vectors[SHARE], vectors[SUMS]
    area = points[AREA]
    count = surface.faces.shape[0]
    vectors[:] = 0.0
    receivers[:] = 0.0
    for k in range(surface.elements):
        for p in range(surface.first[k], surface.first[k + 1]):
            for c in range(MOTIONS):
                velocity[p] += work.motions[c, p] * motion[MOTIONS * k + c]
            weight[p] = velocity[p] * area[p]
    mat_vec_transposed(work.inverse, velocity, sigma)
    mat_vec_transposed(work.potential, sigma, phi)
    mat_vec(work.potential, weight, load)
    mat_vec(work.inverse, load, mu)
    if surface.gauss:
        for p in range(count):
            share[p] = mu[p] / area[p]
            load[p] = share[p] * sigma[p]
        mat_vec_transposed(work.normal, load, sums)
        for p in range(count):
            receivers[BY_AREA, p] = sums[p] + 4.0 * np.pi * load[p]
    for p in range(count):
        receivers[BY_AREA, p] += velocity[p] * phi[p]
    differentiate_influence(
        *(points, work.sources, work.kept, count, weight, sigma, mu, share),
        *(vectors[FACTORS], receivers, work.gradients),
    )
    for p in range(count):
        weight[p] = area[p] * phi[p] + mu[p]
    _differentiate_velocities(directors, surface, motion, weight, work)
    differentiate_panels(surface.faces, work.sources, receivers, work.gradients, work.by_vertices)
    gradient_to_turns(
        directors, surface, work.by_vertices, work.forces, work.torques, work.nodes, out
    )
    for k in range(surface.elements):
        for axis in range(3):
            out[k, axis] *= -0.5 * surface.density


@entry_kernel
def panel_mass(directors: Array, surface: Any, work: Any, out: Array) -> int:
    """Call `panel_added_mass` from Python, with surface and work space `Referenced`."""
    return panel_added_mass(directors, surface, work, out)


def evaluate_added_mass(directors: Array, surface: Surface) -> tuple[Array, int]:
    """Return the added mass (6 N, 6 N) of a pose, and 0 or the code of why there is none."""
    out = np.zeros((MOTIONS * surface.elements, MOTIONS * surface.elements))
    given = Referenced(surface), Referenced(new_panel_work(surface))
    return out, int(panel_mass(directors, *given, out))
