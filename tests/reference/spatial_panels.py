"""Independent reference for panels on the surface of a spatial body, written for clarity.

No gradient is derived by hand: derivatives are complex steps, d f(x)/dx = Im f(x + i h)/h with
h = 1e-30. So all functions accept complex vertices and directors, and avoid ``abs``, ``norm`` and
``conj``. Positions are in space, nothing is transformed to a panel's own axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STEP = 1e-30


@dataclass(frozen=True)
class Body:
    """Elements of equal length; semi-axes of the sections at equal steps from head to tail."""

    elements: int
    element_length: float
    half_width: Array
    half_height: Array
    around: int
    self_term: str = "gauss"
    rings: str = "area_true"

    @property
    def rows(self) -> int:
        return (len(self.half_width) - 1) // self.elements


def _atan2(y: NDArray, x: NDArray) -> NDArray:
    """Angle of (x, y), continued to first order in the imaginary parts."""
    real = np.arctan2(y.real, x.real)
    return real + 1j * (y.imag * x.real - y.real * x.imag) / (x.real**2 + y.real**2)


def _length(a: NDArray) -> NDArray:
    return np.sqrt((a * a).sum(axis=-1))


def centres(body: Body, directors: NDArray) -> NDArray:
    """Return the elements' centres, their mean at the origin."""
    places = [np.zeros(3)]
    for k in range(1, body.elements):
        step = body.element_length / 2 * (directors[k - 1][:, 2] + directors[k][:, 2])
        places.append(places[-1] + step)
    return np.array(places) - np.mean(places, axis=0)


def mesh(body: Body, directors: NDArray) -> tuple[NDArray, list[list[int]], list[int]]:
    """Return vertices, faces and the element of every face."""
    n, rows, around, dl = body.elements, body.rows, body.around, body.element_length
    r = centres(body, directors)
    corner = 2 * np.pi / around
    scale = np.sqrt(corner / np.sin(corner)) if body.rings == "area_true" else 1.0

    def section(k: int, width: float, height: float, j: int) -> NDArray:
        d1, d2 = directors[k][:, 0], directors[k][:, 1]
        psi = corner * j
        return scale * (width * np.cos(psi) * d1 + height * np.sin(psi) * d2)

    vertices: list[NDArray] = []

    def ring(points: list[NDArray]) -> list[int]:
        vertices.extend(points)
        return list(range(len(vertices) - len(points), len(vertices)))

    head = r[0] - dl / 2 * directors[0][:, 2]
    tail = r[-1] + dl / 2 * directors[-1][:, 2]
    rings: list[list[int]] = []
    for i, (width, height) in enumerate(zip(body.half_width, body.half_height, strict=True)):
        k, part = divmod(i, rows)
        if i == 0 or i == n * rows:
            end, node = (0, head) if i == 0 else (n - 1, tail)
            if width == 0.0:
                rings.append(ring([node]) * around)
            else:
                points = [node + section(end, width, height, j) for j in range(around)]
                rings.append(ring(points))
        elif part == 0:
            node = r[k - 1] + dl / 2 * directors[k - 1][:, 2]
            points = []
            m = directors[k - 1][:, 2] + directors[k][:, 2]
            for j in range(around):
                point = np.zeros(3)
                for e in (k - 1, k):
                    zeta, d3 = section(e, width, height, j), directors[e][:, 2]
                    point = point + 0.5 * (node + zeta - d3 * (zeta @ m) / (d3 @ m))
                points.append(point)
            rings.append(ring(points))
        else:
            place = (part / rows - 0.5) * dl
            centre = r[k] + place * directors[k][:, 2]
            rings.append(ring([centre + section(k, width, height, j) for j in range(around)]))

    faces: list[list[int]] = []
    element: list[int] = []

    def add(k: int, *corners: int) -> None:
        distinct = list(dict.fromkeys(corners))
        faces.append(distinct + distinct[-1:] * (4 - len(distinct)))
        element.append(k)

    def strip(k: int, front: list[int], behind: list[int]) -> None:
        for j in range(around):
            after = (j + 1) % around
            add(k, front[j], front[after], behind[after], behind[j])

    for i in range(n * rows):
        strip(i // rows, rings[i], rings[i + 1])
    for k, i, node in ((0, 0, head), (n - 1, n * rows, tail)):
        width, height = body.half_width[i] / 2, body.half_height[i] / 2
        if width > 0.0:
            half = ring([node + section(k, width, height, j) for j in range(around)])
            tip = ring([node]) * around
            order = [tip, half, rings[0]] if i == 0 else [rings[-1], half, tip]
            strip(k, order[0], order[1])
            strip(k, order[1], order[2])
    return np.array(vertices), faces, element


@dataclass(frozen=True)
class Panel:
    """A face projected on its mean plane."""

    corners: NDArray
    centroid: NDArray
    normal: NDArray
    area: NDArray


def panel(corners: NDArray) -> Panel:
    """Project four corners on their mean plane."""
    normal = np.cross(corners[2] - corners[0], corners[3] - corners[1])
    normal = normal / _length(normal)
    middle = corners.mean(axis=0)
    flat = np.array([c - ((c - middle) @ normal) * normal for c in corners])
    first = np.cross(flat[1] - flat[0], flat[2] - flat[0]) @ normal / 2
    second = np.cross(flat[2] - flat[0], flat[3] - flat[0]) @ normal / 2
    area = first + second
    moment = first * (flat[0] + flat[1] + flat[2]) + second * (flat[0] + flat[2] + flat[3])
    return Panel(flat, moment / (3 * area), normal, area)


def _solid_angle(a: NDArray, b: NDArray, c: NDArray) -> NDArray:
    """Return the solid angle of a triangle seen from its back (van Oosterom & Strackee 1983)."""
    ra, rb, rc = _length(a), _length(b), _length(c)
    volume = (a * np.cross(b, c)).sum(axis=-1)
    ab, bc, ca = (a * b).sum(axis=-1), (b * c).sum(axis=-1), (c * a).sum(axis=-1)
    return 2 * _atan2(volume, ra * rb * rc + ab * rc + bc * ra + ca * rb)


def edge_sums(source: Panel, points: NDArray) -> tuple[NDArray, NDArray]:
    """Return what a panel's edges add to its potential and velocity at points (n, 3)."""
    seen = [corner - points for corner in source.corners]
    potential, velocity = (
        np.zeros(len(points), dtype=complex),
        np.zeros(points.shape, dtype=complex),
    )
    for start, end in zip(seen, seen[1:] + seen[:1], strict=True):
        edge = (end - start)[0]
        length = _length(edge)
        if length == 0.0:
            continue  # a triangle
        outward = np.cross(edge / length, source.normal)
        total = _length(start) + _length(end)
        log = np.log((total + length) / (total - length))
        potential += (start @ outward) * log
        velocity -= log[:, None] * outward
    return potential, velocity


def solid_angle(source: Panel, points: NDArray) -> NDArray:
    """Return the solid angle of a panel, positive on the side of its normal."""
    a, b, c, d = (corner - points for corner in source.corners)
    angle = -_solid_angle(a, b, c)
    triangle = (source.corners[2] == source.corners[3]).all()
    return angle if triangle else angle - _solid_angle(a, c, d)


def influences(panels: list[Panel], self_term: str) -> tuple[NDArray, NDArray]:
    """Return the normal influence G and the potential influence P, row by receiving panel."""
    points = np.array([one.centroid for one in panels])
    normals = np.array([one.normal for one in panels])
    area = np.array([one.area for one in panels])
    count = len(panels)
    g, p = np.zeros((2, count, count), dtype=complex)
    for j, source in enumerate(panels):
        p[:, j], velocity = edge_sums(source, points)
        # In its own plane there is no height, and the angle is that of one side or the other.
        others = np.arange(count) != j
        angle = solid_angle(source, points[others])
        p[others, j] -= (points[others] - source.centroid) @ source.normal * angle
        velocity[others] -= angle[:, None] * source.normal
        g[:, j] = (normals * velocity).sum(axis=1)
        g[j, j] = 0.0
        if self_term == "gauss":
            g[j, j] = -4 * np.pi - (area * g[:, j]).sum() / area[j]
        else:
            g[j, j] = -2 * np.pi
    return g, p


def added_mass(body: Body, directors: NDArray) -> NDArray:
    """Return A (6 N, 6 N) for unit density, complex where the directors are."""
    vertices, faces, element = mesh(body, directors)
    r = centres(body, directors)
    panels = [panel(vertices[face]) for face in faces]
    b = np.zeros((len(panels), 6 * body.elements), dtype=complex)
    for i, (one, k) in enumerate(zip(panels, element, strict=True)):
        arm = np.cross(one.centroid - r[k], one.normal)
        b[i, 6 * k : 6 * k + 3] = directors[k].T @ one.normal
        b[i, 6 * k + 3 : 6 * k + 6] = directors[k].T @ arm
    g, p = influences(panels, body.self_term)
    area = np.array([one.area for one in panels])
    mass = -b.T @ (area[:, None] * (p @ np.linalg.solve(g, b)))
    return (mass + mass.T) / 2


def shape_derivative(body: Body, directors: Array, motion: Array) -> Array:
    """Return the derivative (N, 3) of V^T A V/2 by a rotation of every element in its own axes."""
    out = np.zeros((body.elements, 3))
    for k in range(body.elements):
        for axis in range(3):
            turned = directors.astype(complex)
            # R (1 + i h hat(e)): columns of R hat(e) are R (e x e_c).
            turned[k] += 1j * STEP * directors[k] @ np.cross(np.eye(3)[axis], np.eye(3)).T
            out[k, axis] = (motion @ added_mass(body, turned) @ motion / 2).imag / STEP
    return out
