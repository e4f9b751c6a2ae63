"""The surface of a body in space as it is shown: sections of the true size along the body.

It is the surface of the source panels (`swim_env.physics.spatial.panels.surface`), with as many
rings as look smooth, and of many instants at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.spatial.panels.surface import (
    HEIGHT,
    PLACE,
    WIDTH,
    Surface,
    surface_of_sections,
)
from swim_env.scene.spatial.scene import SpatialScene

__all__ = ["BodySurface"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Where rings are added near an end that is a point, as shares of the way to the first ring.
_NEAR_END = np.array([0.05, 0.3])


class BodySurface:
    """A closed surface around a scene's body, of rings of vertices between two points.

    Parameters
    ----------
    scene : SpatialScene
        The scene.
    rings : int
        Rings along the body, about; at least one for each element.
    around : int
        Vertices of a ring, a multiple of 4. The polygons have the area of the ellipse.
    round_ends : bool
        Whether there are more rings close to ends that are points, which may be blunt.

    Attributes
    ----------
    faces : (M, 4) int array
        Corners of every face, counter-clockwise seen from outside; the last two of a triangle are
        the same.
    triangles : (K, 3) int array
        Corners of the faces, each cut into two.
    """

    def __init__(
        self, scene: SpatialScene, rings: int = 36, around: int = 16, round_ends: bool = True
    ) -> None:
        beam = scene.beam
        rows = -(-rings // beam.elements)
        s = np.linspace(0.0, beam.length, rows * beam.elements + 1)
        width, height = beam.half_width_at(s), beam.half_height_at(s)
        surface = surface_of_sections(
            beam.element_length, width, height, elements=beam.elements, around=around
        )
        if round_ends and width[0] == 0.0:
            surface = _with_round_ends(surface, scene, s[1])
        self._surface = surface
        self.faces: Integers = self._surface.faces
        halves = [self.faces[:, [0, 1, 2]], self.faces[self.faces[:, 2] != self.faces[:, 3]]]
        self.triangles: Integers = np.concatenate([halves[0], halves[1][:, [0, 2, 3]]])

    def vertices(self, centres: Array, directors: Array) -> Array:
        """Return the vertices (..., V, 3) (m) of shapes.

        Parameters
        ----------
        centres : (..., N, 3) array
            Element centres (m).
        directors : (..., N, 3, 3) array
            R_k, with columns d1, d2, d3.
        """
        surface = self._surface
        k, other = surface.ring_elements.T
        tangents = directors[..., 2]
        tangent, behind = tangents[..., k, :], tangents[..., other, :]
        # Rings at inner nodes are the mean of both elements', each cut by the bisecting plane.
        share = 1.0 + (tangent * behind).sum(axis=-1)[..., None]
        found = np.zeros(())
        inner = (k != other)[:, None, None]
        for element, own, next_to in ((k, tangent, behind), (other, behind, tangent)):
            zeta = np.einsum("...rij,jrv->...rvi", directors[..., element, :, :2], self._sections)
            along = np.einsum("...rvi,...ri->...rv", zeta, next_to) / share
            cut = np.where(inner, along[..., None] * own[..., None, :], 0.0)
            found = found + 0.5 * (zeta - cut)
        place = centres[..., k, :] + surface.rings[:, PLACE, None] * tangent
        rings = (place[..., None, :] + found).reshape(*centres.shape[:-2], -1, 3)
        half = 0.5 * surface.element_length
        head = centres[..., :1, :] - half * tangents[..., :1, :]
        tail = centres[..., -1:, :] + half * tangents[..., -1:, :]
        vertices: Array = np.concatenate([head, rings, tail], axis=-2)
        return vertices

    @property
    def _sections(self) -> Array:
        """Coordinates of the rings' vertices along d1 and d2, (2, R, around) (m)."""
        surface = self._surface
        semi_axes = surface.rings[:, [WIDTH, HEIGHT]].T
        return semi_axes[:, :, None] * surface.circle[:, None, :]

    def areas(self, vertices: Array) -> Array:
        """Return the areas of the faces times their normals, outwards, (..., M, 3) (m^2)."""
        corners = vertices[..., self.faces, :]
        diagonals = corners[..., 2:, :] - corners[..., :2, :]
        areas: Array = 0.5 * np.cross(diagonals[..., 0, :], diagonals[..., 1, :])
        return areas

    def normals(self, vertices: Array) -> Array:
        """Return the unit normals (..., V, 3) at vertices, outwards, of the faces around them."""
        areas = self.areas(vertices)
        total = np.zeros_like(vertices)
        for corner in range(4):
            by_vertex, by_face = np.moveaxis(total, -2, 0), np.moveaxis(areas, -2, 0)
            np.add.at(by_vertex, self.faces[:, corner], by_face)
        size = np.linalg.norm(total, axis=-1, keepdims=True)
        return total / np.where(size > 0.0, size, 1.0)

    def on_surface(self, values: Array) -> Array:
        """Return what bending moments at joints (..., N - 1, 3) are at the vertices, (..., V).

        It is their part about the axis that bends the body towards a vertex, positive where the
        body is shortened: value_2 at d1 and -value_1 at d2. It is linear between joints and zero at
        the free ends; twist (value_3) bends nothing.
        """
        surface = self._surface
        joints = values.shape[-2]
        at = surface.ring_elements[:, 0] + 0.5 + surface.rings[:, PLACE] / surface.element_length
        ends = np.zeros((*values.shape[:-2], 1, 3))
        padded = np.concatenate([ends, values, ends], axis=-2)
        lower = np.clip(at.astype(np.int64), 0, joints)
        share = (at - lower)[:, None]
        between = padded[..., lower, :] * (1.0 - share) + padded[..., lower + 1, :] * share
        cosine, sine = surface.circle
        rings = between[..., 1:2] * cosine - between[..., 0:1] * sine
        rings = rings.reshape(*values.shape[:-2], -1)
        end = np.zeros((*values.shape[:-2], 1))
        found: Array = np.concatenate([end, rings, end], axis=-1)
        return found


def _with_round_ends(surface: Surface, scene: SpatialScene, step: float) -> Surface:
    """Return a surface with more rings on the first and the last step (m) along the body."""
    beam, around = scene.beam, surface.circle.shape[1]
    scale = surface.rings[0, WIDTH] / beam.half_width_at(step)
    tables = []
    for s in (step * _NEAR_END, beam.length - step * _NEAR_END[::-1]):
        table = np.empty((len(s), 3))
        k = 0 if s[0] < step else beam.elements - 1
        table[:, PLACE] = s - (k + 0.5) * beam.element_length
        table[:, WIDTH], table[:, HEIGHT] = beam.half_width_at(s), beam.half_height_at(s)
        tables.append(table * (1.0, scale, scale))
    rings = np.concatenate([tables[0], surface.rings, tables[1]])
    owners = np.zeros((len(_NEAR_END), 2), dtype=np.int64)
    elements = [owners, surface.ring_elements, owners + beam.elements - 1]
    # Faces depend on the number of rings alone.
    pointed = np.ones(len(rings) + 2)
    pointed[[0, -1]] = 0.0
    faces = surface_of_sections(1.0, pointed, pointed, elements=1, around=around).faces
    return surface._replace(rings=rings, ring_elements=np.concatenate(elements), faces=faces)
