r"""Exact derivative of sums over the panels' influence by the corners of all faces.

For fixed w, sigma and mu, `differentiate_influence` takes the derivative of

.. math:: \sum_{ij} w_i P_{ij} \sigma_j - \sum_{ij} \mu_i G_{ij} \sigma_j.

With Gauss's self term the second sum is, up to constants, that over i != j with
mu_i - S_i mu_j/S_j in place of mu_i; what is left is a derivative by the areas,
S_i -> (G m sigma)_i + 4 pi m_i sigma_i with m = mu/S.

A pair is a function F of the point x, the normal g and the corners in the panel's own plane,
F = sum L A + Omega C with A = w h + k g . nu, C = -w Z + k g . n, where w and k are what P and -G
are multiplied by. With q = r_a r_b + a . b,

.. math::
    dL &= t \cdot (db/r_b - da/r_a) - (l/q)\, (h \nu - Z n) \cdot (da/r_a + db/r_b), \\
    d\Omega &= (l/q)\, (Z \nu + h n) \cdot (da/r_a + db/r_b), \\
    dh &= \nu \cdot (l_b\, da - l_a\, db)/l, \qquad d\nu = -t\, \nu \cdot (db - da)/l,

where l_a = t . (a - x): no new logarithm and no angle. How F changes with the panel's place and
attitude follows from its invariance under motions of all together. `differentiate_panels` adds
centroids, areas, and the projection of the corners on the mean plane.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import embedded, kernel, vector_kernel
from swim_env.physics.spatial.panels.influence import (
    AREA,
    CENTRE,
    CENTROID,
    CORNERS,
    CROSS,
    NORMAL,
    OFFSET,
    SOLID_ANGLE,
    Edge,
    corners,
    distance,
    doubled_areas,
    edge_of,
    frame_of,
)
from swim_env.physics.spatial.vectors import (
    Vector,
    add_column,
    add_row,
    column,
    cross,
    inner,
    plus,
    sum_of,
    write_part,
)

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# Rows of the receivers' gradient: by collocation point, normal and area of every panel.
BY_CENTROID, BY_NORMAL, BY_AREA = 0, 3, 6
RECEIVER_ROWS = 7
# Columns of the sources' gradient: by the corners in the plane, shifts along its normal, and turns
# about its two axes.
BY_CORNERS, BY_SHIFT, BY_TURN = 0, 8, 9
SOURCE_GRADIENTS = 11


@embedded
def _edge_gradient(
    edge: Edge,
    log: float,
    x: float,
    y: float,
    z: float,
    r_a: float,
    r_b: float,
    g: Vector,
    weight: float,
    factor: float,
    angle_factor: float,
) -> tuple[float, float, float, float, float]:
    """Return dF by both ends of an edge, and what it adds to -dF/dZ."""
    tx, ty, length, inverse, from_origin, start = edge
    inverse_a = 1.0 / r_a
    inverse_b = 1.0 / r_b
    h = from_origin - (x * ty - y * tx)
    along = start - (x * tx + y * ty)
    turned = factor * (g[0] * tx + g[1] * ty)
    own = weight * h + factor * (g[0] * ty - g[1] * tx)
    s = r_a + r_b
    reach = 2.0 * length / ((s - length) * (s + length))
    across = reach * (angle_factor * z - own * h)
    share = log * inverse
    across_a = share * (weight * (along + length) + turned) + across * inverse_a
    across_b = across * inverse_b - share * (weight * along + turned)
    along_a = -own * inverse_a
    along_b = own * inverse_b
    lift = reach * (inverse_a + inverse_b) * (own * z + angle_factor * h)
    return (
        along_a * tx + across_a * ty,
        along_a * ty - across_a * tx,
        along_b * tx + across_b * ty,
        along_b * ty - across_b * tx,
        lift,
    )


@embedded
def in_space(a: Vector, first: Vector, second: Vector, third: Vector) -> Vector:
    """Return the vector that has these components along three axes."""
    return sum_of(a[0], first, a[1], second, a[2], third)


@vector_kernel
def _add_panel(
    points: Array,
    source: Array,
    kept: Array,
    j: int,
    sigma: float,
    weight: Array,
    factors: Array,
    receivers: Array,
    gradient: Array,
) -> None:
    """Add what panel j does at all points; factors are those of -G."""
    origin, first, second, third = frame_of(source)
    x0, x1, x2, x3 = corners(source, 0)
    y0, y1, y2, y3 = corners(source, 1)
    e0, e1, e2, e3 = edge_of(source, 0), edge_of(source, 1), edge_of(source, 2), edge_of(source, 3)
    gx0 = gy0 = gx1 = gy1 = gx2 = gy2 = gx3 = gy3 = 0.0
    shift = turn_x = turn_y = 0.0
    for i in range((points.shape[1] >> 3) << 3):
        seen = plus(column(points, CENTROID, i), -1.0, origin)
        x, y, z = inner(seen, first), inner(seen, second), inner(seen, third)
        normal = column(points, NORMAL, i)
        g = inner(normal, first), inner(normal, second), inner(normal, third)
        w = sigma * weight[i]
        k = sigma * factors[i]
        c = k * g[2] - w * z
        r0 = distance(x - x0, y - y0, z)
        r1 = distance(x - x1, y - y1, z)
        r2 = distance(x - x2, y - y2, z)
        r3 = distance(x - x3, y - y3, z)
        log0, log1, log2, log3 = kept[0, j, i], kept[1, j, i], kept[2, j, i], kept[3, j, i]
        angle = kept[SOLID_ANGLE, j, i]
        ax0, ay0, bx1, by1, z0 = _edge_gradient(e0, log0, x, y, z, r0, r1, g, w, k, c)
        ax1, ay1, bx2, by2, z1 = _edge_gradient(e1, log1, x, y, z, r1, r2, g, w, k, c)
        ax2, ay2, bx3, by3, z2 = _edge_gradient(e2, log2, x, y, z, r2, r3, g, w, k, c)
        ax3, ay3, bx0, by0, z3 = _edge_gradient(e3, log3, x, y, z, r3, r0, g, w, k, c)
        gx0 += ax0 + bx0
        gy0 += ay0 + by0
        gx1 += ax1 + bx1
        gy1 += ay1 + by1
        gx2 += ax2 + bx2
        gy2 += ay2 + by2
        gx3 += ax3 + bx3
        gy3 += ay3 + by3
        # By the point and by its normal, in the panel's axes.
        by_point = (
            -((ax0 + bx0) + (ax1 + bx1) + (ax2 + bx2) + (ax3 + bx3)),
            -((ay0 + by0) + (ay1 + by1) + (ay2 + by2) + (ay3 + by3)),
            -(w * angle + z0 + z1 + z2 + z3),
        )
        by_normal = (
            k * (e0[1] * log0 + e1[1] * log1 + e2[1] * log2 + e3[1] * log3),
            -k * (e0[0] * log0 + e1[0] * log1 + e2[0] * log2 + e3[0] * log3),
            k * angle,
        )
        torque = plus(cross((x, y, z), by_point), 1.0, cross(g, by_normal))
        shift -= by_point[2]
        turn_x -= torque[0]
        turn_y -= torque[1]
        add_column(receivers, BY_CENTROID, i, in_space(by_point, first, second, third))
        add_column(receivers, BY_NORMAL, i, in_space(by_normal, first, second, third))
    write_part(gradient, BY_CORNERS, (gx0, gy0, gx1))
    write_part(gradient, BY_CORNERS + 3, (gy1, gx2, gy2))
    write_part(gradient, BY_CORNERS + 6, (gx3, gy3, shift))
    gradient[BY_TURN], gradient[BY_TURN + 1] = turn_x, turn_y


@kernel
def differentiate_influence(
    points: Array,
    sources: Array,
    kept: Array,
    count: int,
    weight: Array,
    sigma: Array,
    mu: Array,
    share: Array,
    factors: Array,
    receivers: Array,
    gradients: Array,
) -> None:
    """Differentiate the sums of this module by what panels are made of, but for their areas.

    Parameters
    ----------
    points, sources, kept, count
        As for `influence`, which kept what every panel does.
    weight, sigma, mu : (M',) arrays
        The vectors of the sums, zero beyond M.
    share : (M',) array
        m = mu/S where Gauss's law gives the self terms, else zero.
    factors : (M',) array
        Work space.
    receivers : (RECEIVER_ROWS, M') array
        Added to.
    gradients : (M', SOURCE_GRADIENTS) array
        Overwritten but for rows beyond M.
    """
    area = points[AREA]
    for j in range(count):
        for i in range(factors.size):
            factors[i] = mu[i] - area[i] * share[j]
        factors[j] = 0.0  # a panel's own influence is a constant, or has been dealt with
        _add_panel(points, sources[j], kept, j, sigma[j], weight, factors, receivers, gradients[j])


@kernel
def differentiate_panels(
    faces: Integers, sources: Array, receivers: Array, gradients: Array, out: Array
) -> None:
    """Turn the derivatives by what panels are made of into those by the vertices.

    Parameters
    ----------
    faces, sources
        As for `lay_panels`.
    receivers, gradients
        As `differentiate_influence` left them, with all that else depends on the panels added.
    out : (V, 3) array
        Overwritten with the derivative by the vertices.
    """
    out[:] = 0.0
    for p in range(faces.shape[0]):
        source, plane = sources[p], gradients[p]
        _, first, second, third = frame_of(source)
        load = column(receivers, BY_CENTROID, p)
        turned = column(receivers, BY_NORMAL, p)
        by_area = receivers[BY_AREA, p]
        _add_centroid_and_area(source, inner(load, first), inner(load, second), by_area, plane)
        lift = inner(load, third)
        shift = plane[BY_SHIFT] + lift
        turn_x = plane[BY_TURN] + source[CENTRE + 1] * lift - inner(turned, second)
        turn_y = plane[BY_TURN + 1] - source[CENTRE] * lift + inner(turned, first)
        # By the normal: the plane turns with it, and the corners' offsets are along it. It has the
        # direction of the cross product of the diagonals.
        x, y = turn_y, -turn_x
        for v in range(4):
            offset = source[OFFSET] if v % 2 == 0 else -source[OFFSET]
            x -= offset * plane[BY_CORNERS + 2 * v]
            y -= offset * plane[BY_CORNERS + 2 * v + 1]
        x0, x1, x2, x3 = corners(source, 0)
        y0, y1, y2, y3 = corners(source, 1)
        even = ((x3 - x1) * y - (y3 - y1) * x) / source[CROSS]
        odd = ((y2 - y0) * x - (x2 - x0) * y) / source[CROSS]
        for v in range(4):
            raised = even if v % 2 == 0 else odd
            load = (
                plane[BY_CORNERS + 2 * v],
                plane[BY_CORNERS + 2 * v + 1],
                0.25 * shift + (raised if v > 1 else -raised),
            )
            add_row(out, faces[p, v], in_space(load, first, second, third))


@kernel
def _add_centroid_and_area(
    source: Array, by_x: float, by_y: float, by_area: float, plane: Array
) -> None:
    """Add derivatives by a panel's centroid and area, in its plane, to those by its corners.

    With c_v = x_v y_v+1 - x_v+1 y_v the area is sum c_v/2, and the centroid times the area is
    sum c_v (p_v + p_v+1)/6.
    """
    first, second = doubled_areas(source)
    inverse = 2.0 / (first + second)
    by_area -= (by_x * source[CENTRE] + by_y * source[CENTRE + 1]) * inverse
    inverse /= 6.0
    for v in range(4):
        x, y = source[CORNERS + 2 * v], source[CORNERS + 2 * v + 1]
        after = CORNERS + 2 * ((v + 1) % 4)
        before = CORNERS + 2 * ((v + 3) % 4)
        ax, ay = source[after], source[after + 1]
        bx, by = source[before], source[before + 1]
        crosses = (x * ay - ax * y + bx * y - x * by) * inverse
        sum_after = 0.5 * by_area + (by_x * (x + ax) + by_y * (y + ay)) * inverse
        sum_before = 0.5 * by_area + (by_x * (x + bx) + by_y * (y + by)) * inverse
        plane[BY_CORNERS + 2 * v] += by_x * crosses + sum_after * ay - sum_before * by
        plane[BY_CORNERS + 2 * v + 1] += by_y * crosses - sum_after * ax + sum_before * bx
