"""The surface of a spatial body: vertices, faces, limits, and derivatives by the elements' turns.

Rings of vertices lie around the elements. Ring `rows` k lies at the node in front of element k
(0-based), on an inner node as the mean of what both elements make of it, each prism being cut by
the bisecting plane: x_k = node + zeta_k - d3^k (zeta_k . m)/(d3^k . m), m the sum of both tangents.
All others move with their element. An end with a width is closed by a flat cap (a ring of half the
semi-axes, then a fan of triangles), one without ends in a point. Panels are numbered from head to
tail, so those of an element follow each other.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import embedded, kernel
from swim_env.physics.spatial.panels.influence import CENTROID
from swim_env.physics.spatial.vectors import (
    Vector,
    add_row,
    column,
    cross,
    director,
    inner,
    plus,
    row,
    scaled,
    size,
    write_row,
)
from swim_env.physics.status import FINE, OUTLINE_DEGENERATE, UNDER_RESOLVED_GAP

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Shortest strip allowed, in lengths of those of the straight body.
SHORTEST_STRIP = 0.1
#: Largest rotation of a joint (rad).
LARGEST_JOINT = 0.9 * math.pi
#: Smallest gap between panels of elements at least APART places apart, in longest edges.
GAP_TO_EDGE = 0.5
APART = 3

# Columns of `Surface.rings`: place along the element from its centre, half width, half height (m).
PLACE, WIDTH, HEIGHT = range(3)
# Rows of a panel's sizes, columns of an element's: longest edge, reach from the centre (m).
EDGE, REACH = range(2)


class Surface(NamedTuple):
    """How a body is wrapped into panels, from `surface_of_sections`.

    Attributes
    ----------
    elements : int
        Number N of elements.
    element_length : float
        dl (m).
    rows : int
        Rows of panels on each element.
    gauss : bool
        Whether a panel's own normal influence follows from Gauss's law.
    density : float
        Of the fluid (kg/m^3).
    rings : (R, 3) array
        See the columns above.
    ring_elements : (R, 2) int array
        The elements that make a ring; twice the same but at inner nodes.
    first_row : int
        Ring in front of the first row, -1 for the head's point.
    circle : (2, around) array
        Cosine and sine of the angle of every vertex of a ring, from d1 towards d2.
    faces : (M, 4) int array
        Vertices of every panel, counter-clockwise seen from the fluid.
    first : (N + 1,) int array
        First panel of every element, and M.
    """

    elements: int
    element_length: float
    rows: int
    gauss: bool
    density: float
    rings: Array
    ring_elements: Integers
    first_row: int
    circle: Array
    faces: Integers
    first: Integers


def surface_of_sections(
    element_length: float,
    half_width: Array,
    half_height: Array,
    *,
    elements: int,
    around: int = 12,
    density: float = 1.0,
    self_term: str = "gauss",
    rings: str = "area_true",
) -> Surface:
    """Wrap a body into panels.

    Parameters
    ----------
    element_length : float
        dl (m).
    half_width, half_height : (N rows + 1,) arrays
        Semi-axes (m) of the elliptical sections along d1 and d2 at equal steps of s from head to
        tail, at least three of a body that ends in points; both are zero at these.
    elements : int
        Number N of elements; `rows` per element follow from it and the number of sections.
    around : int
        Vertices of a ring, a multiple of 4.
    density : float
        Of the fluid (kg/m^3).
    self_term : {"gauss", "flat"}
        A panel's own normal influence: from Gauss's law, or -2 pi.
    rings : {"area_true", "inscribed"}
        Polygons with the area of the ellipse, or inscribed in it.
    """
    count = len(half_width) - 1
    rows = count // elements
    turn = 2.0 * np.pi / around
    scale = math.sqrt(turn / math.sin(turn)) if rings == "area_true" else 1.0
    pointed = half_width[0] == 0.0
    section = np.arange(1, count) if pointed else np.arange(count + 1)
    # A ring at an inner node counts to the element in front of it.
    owner = np.maximum(section - 1, 0) // rows
    table = np.empty((len(section), 3))
    table[:, PLACE] = (section / rows - owner - 0.5) * element_length
    table[:, WIDTH] = scale * np.asarray(half_width)[section]
    table[:, HEIGHT] = scale * np.asarray(half_height)[section]
    other = owner + ((section % rows == 0) & (section > 0) & (section < count))
    row_elements = np.arange(count) // rows
    if not pointed:
        halves = table[[0, -1]] * (1.0, 0.5, 0.5)
        table = np.concatenate([halves[:1], table, halves[1:]])
        owner, other = (np.concatenate([one[:1], one, one[-1:]]) for one in (owner, other))
        ends = np.zeros(2, dtype=np.int64)
        row_elements = np.concatenate([ends, row_elements, ends + elements - 1])
    angle = turn * np.arange(around)
    return Surface(
        elements,
        float(element_length),
        rows,
        self_term == "gauss",
        float(density),
        table,
        np.stack([owner, other], axis=1).astype(np.int64),
        -1 if pointed else 1,
        np.stack([np.cos(angle), np.sin(angle)]),
        _faces(len(table), around),
        np.searchsorted(np.repeat(row_elements, around), np.arange(elements + 1)).astype(np.int64),
    )


def _faces(rings: int, around: int) -> Integers:
    """Return the fan at the head, the strips between rings and the fan at the tail."""
    here = np.arange(around)
    after = (here + 1) % around
    head = np.zeros(around, dtype=np.int64)
    tail = head + 1 + rings * around
    first, last = 1, 1 + (rings - 1) * around
    parts = [np.stack([first + after, first + here, head, head], axis=1)]
    for start in range(first, last, around):
        behind = start + around
        parts.append(np.stack([start + here, start + after, behind + after, behind + here], axis=1))
    parts.append(np.stack([last + here, last + after, tail, tail], axis=1))
    return np.concatenate(parts).astype(np.int64)


@kernel
def place_centres(directors: Array, surface: Surface, centres: Array) -> None:
    """Write the elements' centres (N, 3), their mean at the origin."""
    half = 0.5 * surface.element_length
    centre = mean = (0.0, 0.0, 0.0)
    for k in range(surface.elements):
        if k > 0:
            step = plus(director(directors, k - 1, 2), 1.0, director(directors, k, 2))
            centre = plus(centre, half, step)
        mean = plus(mean, 1.0 / surface.elements, centre)
        write_row(centres, k, centre)
    for k in range(surface.elements):
        add_row(centres, k, scaled(-1.0, mean))


@embedded
def _section(directors: Array, k: int, ring: int, v: int, surface: Surface) -> Vector:
    """Return zeta of a ring's vertex in the frame of element k."""
    width = surface.rings[ring, WIDTH] * surface.circle[0, v]
    height = surface.rings[ring, HEIGHT] * surface.circle[1, v]
    return plus(scaled(width, director(directors, k, 0)), height, director(directors, k, 1))


@embedded
def _cut(zeta: Vector, own: Vector, other: Vector) -> tuple[Vector, float]:
    """Return zeta - d3 (zeta . m)/(d3 . m) of an element, and d3 . m."""
    share = 1.0 + inner(own, other)
    return plus(zeta, -inner(zeta, other) / share, own), share


@embedded
def ends(surface: Surface) -> tuple[int, int]:
    """Return the first and the last vertex, at the middle of both ends."""
    return 0, 1 + surface.rings.shape[0] * surface.circle.shape[1]


@kernel
def place_vertices(directors: Array, centres: Array, surface: Surface, out: Array) -> None:
    """Write the vertices (V, 3) of the surface."""
    half = 0.5 * surface.element_length
    around = surface.circle.shape[1]
    last = surface.elements - 1
    head, tail = ends(surface)
    write_row(out, head, plus(row(centres, 0), -half, director(directors, 0, 2)))
    write_row(out, tail, plus(row(centres, last), half, director(directors, last, 2)))
    for ring in range(surface.rings.shape[0]):
        k, other = surface.ring_elements[ring, 0], surface.ring_elements[ring, 1]
        tangent, behind = director(directors, k, 2), director(directors, other, 2)
        middle = plus(row(centres, k), surface.rings[ring, PLACE], tangent)
        for v in range(around):
            zeta = _section(directors, k, ring, v, surface)
            if k != other:
                front, _ = _cut(zeta, tangent, behind)
                back, _ = _cut(_section(directors, other, ring, v, surface), behind, tangent)
                zeta = scaled(0.5, plus(front, 1.0, back))
            write_row(out, 1 + ring * around + v, plus(middle, 1.0, zeta))


@kernel
def joints_status(directors: Array, surface: Surface) -> int:
    """Return FINE, or OUTLINE_DEGENERATE where a joint turns by more than LARGEST_JOINT."""
    for k in range(surface.elements - 1):
        trace = 0.0
        for axis in range(3):
            trace += inner(director(directors, k, axis), director(directors, k + 1, axis))
        if not 0.5 * (trace - 1.0) > math.cos(LARGEST_JOINT):
            return OUTLINE_DEGENERATE
    return FINE


@kernel
def strips_status(directors: Array, surface: Surface, vertices: Array) -> int:
    """Return FINE, or OUTLINE_DEGENERATE where a strip is shorter than SHORTEST_STRIP."""
    around = surface.circle.shape[1]
    shortest = SHORTEST_STRIP * surface.element_length / surface.rows
    head, tail = ends(surface)
    for r in range(surface.elements * surface.rows):
        tangent = director(directors, r // surface.rows, 2)
        first = 1 + (surface.first_row + r) * around
        for v in range(around):
            start, end = max(first + v, head), min(first + around + v, tail)
            strip = plus(row(vertices, end), -1.0, row(vertices, start))
            if not inner(strip, tangent) >= shortest:
                return OUTLINE_DEGENERATE
    return FINE


@embedded
def _apart(a: Vector, b: Vector) -> float:
    return size(plus(a, -1.0, b))


@embedded
def _corner(surface: Surface, vertices: Array, points: Array, p: int, v: int) -> Vector:
    """Return corner v of a panel, or its centroid where v is 4."""
    if v == 4:
        return column(points, CENTROID, p)
    return row(vertices, surface.faces[p, v])


@kernel
def _pair_too_close(
    k: int, m: int, surface: Surface, vertices: Array, points: Array, sizes: Array
) -> bool:
    """Compare corners and centroids of two elements' panels one by one."""
    for i in range(surface.first[k], surface.first[k + 1]):
        for j in range(surface.first[m], surface.first[m + 1]):
            limit = GAP_TO_EDGE * max(sizes[EDGE, i], sizes[EDGE, j])
            centres = _apart(column(points, CENTROID, i), column(points, CENTROID, j))
            if centres >= limit + sizes[REACH, i] + sizes[REACH, j]:
                continue
            for a in range(5):
                for b in range(5):
                    one = _corner(surface, vertices, points, i, a)
                    if not _apart(one, _corner(surface, vertices, points, j, b)) >= limit:
                        return True
    return False


@kernel
def gap_status(
    centres: Array, surface: Surface, vertices: Array, points: Array, sizes: Array, spheres: Array
) -> int:
    """Check that panels of elements that are far along the body keep their distance.

    Elements, and panels, whose circumscribed spheres are far enough apart are passed over.

    Parameters
    ----------
    centres, surface, vertices, points
        The body's surface and its panels.
    sizes : (2 or more, M or more) array
        Work space: longest edge of every panel, largest distance of its corners from its centroid.
    spheres : (N, 2 or more) array
        Work space: longest edge of every element, radius of its sphere.

    Returns
    -------
    int
        FINE or UNDER_RESOLVED_GAP.
    """
    for k in range(surface.elements):
        spheres[k, EDGE] = 0.0
        spheres[k, REACH] = 0.0
        for p in range(surface.first[k], surface.first[k + 1]):
            edge = reach = 0.0
            for v in range(5):
                corner = _corner(surface, vertices, points, p, v)
                after = row(vertices, surface.faces[p, (v + 1) % 4])
                edge = max(edge, _apart(corner, after) if v < 4 else 0.0)
                reach = max(reach, _apart(corner, column(points, CENTROID, p)))
                spheres[k, REACH] = max(spheres[k, REACH], _apart(corner, row(centres, k)))
            sizes[EDGE, p] = edge
            sizes[REACH, p] = reach
            spheres[k, EDGE] = max(spheres[k, EDGE], edge)
    for k in range(surface.elements):
        for m in range(k + APART, surface.elements):
            far = GAP_TO_EDGE * max(spheres[k, EDGE], spheres[m, EDGE])
            far += spheres[k, REACH] + spheres[m, REACH]
            near = _apart(row(centres, k), row(centres, m)) < far
            if near and _pair_too_close(k, m, surface, vertices, points, sizes):
                return UNDER_RESOLVED_GAP
    return FINE


@kernel
def gradient_to_turns(
    directors: Array,
    surface: Surface,
    gradient: Array,
    forces: Array,
    torques: Array,
    nodes: Array,
    out: Array,
) -> None:
    """Turn a derivative by the vertices into that by a rotation of every element in its own axes.

    Parameters
    ----------
    directors, surface
        The surface that the derivative belongs to.
    gradient : (V, 3) array
        Derivative by the vertices; it does not change when all are shifted.
    forces, torques : (N, 3) arrays
        Derivatives by the elements' centres, and by turns about them, of what depends on those
        directly; added to.
    nodes : (N, 3) array
        Work space: derivative by the node behind every element.
    out : (N, 3) array
        Overwritten.
    """
    half = 0.5 * surface.element_length
    around = surface.circle.shape[1]
    last = surface.elements - 1
    head, tail = ends(surface)
    nodes[:] = 0.0
    add_row(forces, 0, row(gradient, head))
    add_row(forces, last, row(gradient, tail))
    front, back = scaled(-half, director(directors, 0, 2)), director(directors, last, 2)
    add_row(torques, 0, cross(front, row(gradient, head)))
    add_row(torques, last, cross(scaled(half, back), row(gradient, tail)))
    for ring in range(surface.rings.shape[0]):
        k, other = surface.ring_elements[ring, 0], surface.ring_elements[ring, 1]
        for v in range(around):
            load = row(gradient, 1 + ring * around + v)
            if k == other:
                arm = _section(directors, k, ring, v, surface)
                arm = plus(arm, surface.rings[ring, PLACE], director(directors, k, 2))
                add_row(forces, k, load)
                add_row(torques, k, cross(arm, load))
                continue
            add_row(nodes, k, load)
            for side in range(2):
                own, across = (k, other) if side == 0 else (other, k)
                tangent, beyond = director(directors, own, 2), director(directors, across, 2)
                cut, share = _cut(_section(directors, own, ring, v, surface), tangent, beyond)
                # The other element turns the plane of the cut.
                turn = scaled(0.5 * inner(load, tangent) / share, cross(cut, beyond))
                add_row(torques, across, turn)
                add_row(torques, own, plus(scaled(0.5, cross(cut, load)), -1.0, turn))
    # From tail to head: an element's turn moves all that is behind it.
    behind = (0.0, 0.0, 0.0)
    for back_to in range(surface.elements):
        k = last - back_to
        behind = plus(behind, 1.0, row(nodes, k))
        load = plus(row(forces, k), 2.0, behind)
        add_row(torques, k, scaled(half, cross(director(directors, k, 2), load)))
        behind = plus(behind, 1.0, row(forces, k))
        for axis in range(3):
            out[k, axis] = inner(director(directors, k, axis), row(torques, k))


def no_surface(elements: int) -> Surface:
    """Return the surface of a body that has no panels."""
    none = np.zeros(0, dtype=np.int64)
    return Surface(
        *(elements, 1.0, 0, False, 0.0, np.zeros((0, 3)), none.reshape(0, 2), 0),
        *(np.zeros((2, 0)), none.reshape(0, 4), np.zeros(elements + 1, dtype=np.int64)),
    )
