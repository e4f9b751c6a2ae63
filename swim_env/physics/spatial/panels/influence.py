r"""Constant-strength source panels on a closed surface (Hess & Smith 1967).

Every face is a panel; a triangle is a quadrilateral whose last two corners coincide. The corners
are projected on the plane through their mean whose normal n, into the fluid, is along the cross
product of the diagonals; the collocation point is the projected panel's area centroid. A panel's
plane has the axes e1 (along the first diagonal) and e2, with the origin in the mean of its corners.

With x a point, (X, Y, Z) its coordinates there, r its distances from the corners and, for an edge
of length l from a to b, t its direction, nu = t x n the outward normal, h = (a - x) . nu and
s = r_a + r_b, a unit source strength gives

.. math::
    L = \int_{edge} dl/r = \ln\frac{s + l}{s - l}, \qquad
    \phi = \int dS/r = \sum h L - Z \Omega, \qquad
    \nabla\phi = -\sum \nu L - n \Omega,

with Omega the solid angle that the panel subtends, positive where Z is. Over a triangle a, b, c of
area S, tan(Omega/2) = 2 S Z/D with D = r_a r_b r_c + (a . b) r_c + (b . c) r_a + (c . a) r_b; the
product of the complex numbers D + 2 i S Z of both triangles has the quadrilateral's half angle.
Scalar products come from lengths: a . b + r_a r_b = (s^2 - l^2)/2.

Matrices are kept transposed, row j being what panel j does everywhere: a panel's constants are
then scalars, and the points fill vector registers.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import embedded, entry_kernel, kernel
from swim_env.physics.runtime.dense import dot
from swim_env.physics.runtime.elementary import atan2, log_quotient
from swim_env.physics.spatial.vectors import (
    Vector,
    column,
    cross,
    inner,
    part,
    plus,
    row,
    scaled,
    size,
    sum_of,
    write_part,
)

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Edge = tuple[float, float, float, float, float, float]

# Rows of `points`: collocation point (m), normal into the fluid, area (m^2).
CENTROID, NORMAL, AREA = 0, 3, 6
POINT_ROWS = 7
# Columns of `sources`: origin (m) and axes of a panel's plane; its corners there (m); centroid
# there (m); distance of the first corner from the plane (m), those that follow being as far on
# alternate sides; length of the cross product of the diagonals (m^2).
ORIGIN, FIRST_AXIS, SECOND_AXIS, THIRD_AXIS, CORNERS, CENTRE, OFFSET, CROSS = (
    *(0, 3, 6, 9),
    *(12, 20, 22, 23),
)
SOURCE_COLUMNS = 24
# Layers of what `influence` keeps for derivatives: the four edges' logarithms, the solid angle.
SOLID_ANGLE = 4
KEPT = 5


@entry_kernel
def lay_panels(vertices: Array, faces: Integers, points: Array, sources: Array) -> None:
    """Project faces (M, 4) on their planes.

    Parameters
    ----------
    vertices : (V, 3) array
        Corners (m).
    faces : (M, 4) int array
        Their indices, counter-clockwise seen from the fluid.
    points : (POINT_ROWS, M') array
        Overwritten; panels beyond M have no area and no normal and lie where panel 0 does.
    sources : (M' or more, SOURCE_COLUMNS) array
        Overwritten but for rows beyond M.
    """
    count = faces.shape[0]
    for p in range(count):
        source = sources[p]
        a, b = row(vertices, faces[p, 0]), row(vertices, faces[p, 1])
        c, d = row(vertices, faces[p, 2]), row(vertices, faces[p, 3])
        origin = scaled(0.25, plus(plus(plus(a, 1.0, b), 1.0, c), 1.0, d))
        diagonal = plus(c, -1.0, a)
        normal = cross(diagonal, plus(d, -1.0, b))
        source[CROSS] = size(normal)
        normal = scaled(1.0 / size(normal), normal)
        first = scaled(1.0 / size(diagonal), diagonal)
        second = cross(normal, first)
        write_part(source, ORIGIN, origin)
        write_part(source, FIRST_AXIS, first)
        write_part(source, SECOND_AXIS, second)
        write_part(source, THIRD_AXIS, normal)
        for v in range(4):
            corner = plus(row(vertices, faces[p, v]), -1.0, origin)
            source[CORNERS + 2 * v] = inner(corner, first)
            source[CORNERS + 2 * v + 1] = inner(corner, second)
        source[OFFSET] = inner(plus(a, -1.0, origin), normal)
        near, far = doubled_areas(source)
        for axis in range(2):
            x0, x1, x2, x3 = corners(source, axis)
            moment = near * (x0 + x1 + x2) + far * (x0 + x2 + x3)
            source[CENTRE + axis] = moment / (3.0 * (near + far))
        centre = sum_of(1.0, origin, source[CENTRE], first, source[CENTRE + 1], second)
        for axis in range(3):
            points[CENTROID + axis, p] = centre[axis]
            points[NORMAL + axis, p] = normal[axis]
        points[AREA, p] = 0.5 * (near + far)
    for p in range(count, points.shape[1]):
        for r in range(POINT_ROWS):
            points[r, p] = points[r, 0] if r < NORMAL else 0.0


@embedded
def corners(source: Array, axis: int) -> tuple[float, float, float, float]:
    """Return one coordinate of the four corners in their plane."""
    first = CORNERS + axis
    return source[first], source[first + 2], source[first + 4], source[first + 6]


@embedded
def doubled_areas(source: Array) -> tuple[float, float]:
    """Return twice the areas of the triangles 0 1 2 and 0 2 3."""
    x0, x1, x2, x3 = corners(source, 0)
    y0, y1, y2, y3 = corners(source, 1)
    return (
        (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0),
        (x2 - x0) * (y3 - y0) - (y2 - y0) * (x3 - x0),
    )


@embedded
def frame_of(source: Array) -> tuple[Vector, Vector, Vector, Vector]:
    """Return the origin and the axes of a panel's plane."""
    return (
        part(source, ORIGIN),
        part(source, FIRST_AXIS),
        part(source, SECOND_AXIS),
        part(source, THIRD_AXIS),
    )


@embedded
def edge_of(source: Array, e: int) -> Edge:
    """Return direction, length, 1/length, distance from the origin and the start along it."""
    after = (e + 1) % 4
    x, y = source[CORNERS + 2 * e], source[CORNERS + 2 * e + 1]
    tx, ty = source[CORNERS + 2 * after] - x, source[CORNERS + 2 * after + 1] - y
    length = math.sqrt(tx * tx + ty * ty)
    inverse = 1.0 / length if length > 0.0 else 0.0  # a triangle has an edge without one
    tx *= inverse
    ty *= inverse
    return tx, ty, length, inverse, x * ty - y * tx, x * tx + y * ty


@embedded
def distance(x: float, y: float, z: float) -> float:
    """Return the length of (x, y, z)."""
    return math.sqrt(x * x + (y * y + z * z))


@kernel
def _influence_of_panel(
    j: int, points: Array, source: Array, normal: Array, potential: Array, kept: Array, place: int
) -> None:
    """Write row j of both matrices, and a row of what is kept."""
    origin, first, second, third = frame_of(source)
    x0, x1, x2, x3 = corners(source, 0)
    y0, y1, y2, y3 = corners(source, 1)
    doubled_near, doubled_far = doubled_areas(source)
    diagonal = (x2 - x0) * (x2 - x0) + (y2 - y0) * (y2 - y0)
    tx0, ty0, l0, _, d0, _ = edge_of(source, 0)
    tx1, ty1, l1, _, d1, _ = edge_of(source, 1)
    tx2, ty2, l2, _, d2, _ = edge_of(source, 2)
    tx3, ty3, l3, _, d3, _ = edge_of(source, 3)
    # The compiler sees a multiple of the vector registers' width: no loop over a rest follows.
    for i in range((points.shape[1] >> 3) << 3):
        seen = plus(column(points, CENTROID, i), -1.0, origin)
        x, y, z = inner(seen, first), inner(seen, second), inner(seen, third)
        r0 = distance(x - x0, y - y0, z)
        r1 = distance(x - x1, y - y1, z)
        r2 = distance(x - x2, y - y2, z)
        r3 = distance(x - x3, y - y3, z)
        s0, s1, s2, s3 = r0 + r1, r1 + r2, r2 + r3, r3 + r0
        # Twice a . b of the diagonal, twice r_a r_b + a . b of the edges.
        dots = r0 * r0 + r2 * r2 - diagonal
        near = r2 * ((s0 - l0) * (s0 + l0)) + r0 * ((s1 - l1) * (s1 + l1))
        near += r1 * dots - 2.0 * r0 * r1 * r2
        far = r0 * ((s2 - l2) * (s2 + l2)) + r2 * ((s3 - l3) * (s3 + l3))
        far += r3 * dots - 2.0 * r0 * r2 * r3
        near_z, far_z = 2.0 * doubled_near * z, 2.0 * doubled_far * z
        angle = 2.0 * atan2(near_z * far + far_z * near, near * far - near_z * far_z)
        log0, log1 = log_quotient(s0, l0), log_quotient(s1, l1)
        log2, log3 = log_quotient(s2, l2), log_quotient(s3, l3)
        kept[0, place, i] = log0
        kept[1, place, i] = log1
        kept[2, place, i] = log2
        kept[3, place, i] = log3
        kept[SOLID_ANGLE, place, i] = angle
        # Minus the velocity in the plane.
        ux = ty0 * log0 + ty1 * log1 + ty2 * log2 + ty3 * log3
        uy = -(tx0 * log0 + tx1 * log1 + tx2 * log2 + tx3 * log3)
        from_edges = d0 * log0 + d1 * log1 + d2 * log2 + d3 * log3
        potential[j, i] = from_edges - (x * ux + y * uy + z * angle)
        velocity = sum_of(ux, first, uy, second, angle, third)
        normal[j, i] = -inner(column(points, NORMAL, i), velocity)


@entry_kernel
def influence(
    points: Array,
    sources: Array,
    count: int,
    gauss: bool,
    normal: Array,
    potential: Array,
    kept: Array,
) -> None:
    """Assemble the influence of every panel on every collocation point.

    Parameters
    ----------
    points, sources
        As `lay_panels` left them.
    count : int
        M.
    gauss : bool
        Whether a panel's own normal influence follows from Gauss's law, which makes S^T G of a
        closed surface -4 pi S^T; else it is -2 pi.
    normal, potential : (M', M') arrays
        The first M rows are overwritten with the transposed normal influence G and potential
        influence P (m): row j is what panel j does. Columns beyond M are zero in G.
    kept : (KEPT, M or 1, M') array
        Overwritten with what the derivatives take, of every panel or, to save space, of the last.
    """
    for j in range(count):
        place = j if kept.shape[1] > 1 else 0
        _influence_of_panel(j, points, sources[j], normal, potential, kept, place)
        # What the point has of its own panel, between both sides.
        kept[SOLID_ANGLE, place, j] = 0.0
        normal[j, j] = 0.0
        if gauss:
            sent = dot(normal[j], points[AREA])
            normal[j, j] = -4.0 * np.pi - sent / points[AREA, j]
        else:
            normal[j, j] = -2.0 * np.pi
