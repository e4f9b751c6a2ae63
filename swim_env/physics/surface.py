"""Rigid-body added mass of any closed surface, from the panel code that the swimmer uses."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.errors import SurfaceError
from swim_env.physics.runtime.views import padded
from swim_env.physics.spatial.loading import load_panel_kernels
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
from swim_env.scene.checks import is_number

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Largest number of panels: the matrices of more take over a gigabyte.
MOST_PANELS = 5000
#: Smallest length of an edge, and root of a panel's area, in sizes of the surface.
_SMALLEST = 1e-7


def added_mass_of_surface(
    vertices: ArrayLike, faces: ArrayLike, density: float = 1.0
) -> NDArray[np.float64]:
    """Compute the rigid-body added mass of a closed surface in space.

    Every face is one source panel of constant strength (Hess & Smith). A quadrilateral that is not
    flat is projected on its mean plane; the panels' own normal influences follow from Gauss's law.

    Parameters
    ----------
    vertices : (V, 3) array_like
        Corners of the faces (m).
    faces : (F, 4) or (F, 3) array_like of int
        Indices of each face's corners in order around it; a triangle among quadrilaterals repeats
        its last corner. Neighbours must run along their common edge in opposite directions: all
        faces counter-clockwise seen from the fluid, or all of them clockwise.
    density : float
        Fluid density (kg/m^3).

    Returns
    -------
    (6, 6) array
        Symmetric added mass for motion along x, y, z and rotation about x, y, z through the origin
        (kg, kg m, kg m^2).

    Raises
    ------
    SurfaceError
        If the arrays have other shapes or hold what is not finite or no index, the surface is not
        closed, its faces are not oriented alike, one has no area, there are more than 5000, or the
        density is not a positive number.
    """
    corners = _checked_vertices(vertices)
    panels = _checked_faces(faces, corners)
    if not is_number(density) or not 0.0 < float(density) < np.inf:
        raise SurfaceError(f"density must be a positive number in kg/m^3, got {density!r}")
    # Seen from its middle: far from the origin, products would lose the panels' sizes.
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    corners -= middle
    panels = _outward(corners, panels)
    load_panel_kernels()
    count, size = len(panels), padded(len(panels))
    points, sources = np.zeros((POINT_ROWS, size)), np.zeros((size, SOURCE_COLUMNS))
    lay_panels(corners, panels, points, sources)
    normal, potential = np.zeros((2, size, size))
    influence(points, sources, count, True, normal, potential, np.empty((KEPT, 1, size)))
    points = points[:, :count]
    normals = points[NORMAL:AREA].T
    turning = np.cross(points[CENTROID:NORMAL].T + middle, normals)
    motions = np.concatenate([normals, turning], axis=1)
    try:
        strengths = np.linalg.solve(normal[:count, :count].T, motions)
    except np.linalg.LinAlgError:
        raise SurfaceError("the faces' influence is singular: they must not cross") from None
    potentials = potential[:count, :count].T @ strengths
    mass = -float(density) * motions.T @ (points[AREA][:, None] * potentials)
    symmetric: Array = 0.5 * (mass + mass.T)
    return symmetric


def _checked_vertices(vertices: ArrayLike) -> Array:
    try:
        corners = np.array(vertices, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SurfaceError(f"vertices must be a (V, 3) array of numbers: {error}") from None
    if corners.ndim != 2 or corners.shape[1] != 3:
        raise SurfaceError(f"vertices must have shape (V, 3), got {corners.shape}")
    if not np.isfinite(corners).all():
        row = int(np.flatnonzero(~np.isfinite(corners).all(axis=1))[0])
        raise SurfaceError(f"vertices must be finite, got {corners[row].tolist()} in row {row}")
    return corners


def _checked_faces(faces: ArrayLike, corners: Array) -> Integers:
    """Return the faces as (F, 4) of a surface that is closed and whose faces have a size."""
    try:
        given = np.array(faces)
    except ValueError as error:
        raise SurfaceError(f"faces must be an (F, 4) array of indices: {error}") from None
    if given.ndim != 2 or given.shape[1] not in (3, 4):
        raise SurfaceError(f"faces must have shape (F, 4) or (F, 3), got {given.shape}")
    if given.dtype.kind not in "iu":
        raise SurfaceError(f"faces must hold integers, got {given.dtype}")
    if len(given) > MOST_PANELS:
        raise SurfaceError(f"a surface may have at most {MOST_PANELS} faces, got {len(given)}")
    if len(given) < 4:
        raise SurfaceError(f"a closed surface must have at least 4 faces, got {len(given)}")
    wrong = np.flatnonzero(((given < 0) | (given >= len(corners))).any(axis=1))
    if wrong.size:
        raise SurfaceError(
            f"face {int(wrong[0])} must hold indices from 0 to {len(corners) - 1}, got "
            f"{given[wrong[0]].tolist()}"
        )
    panels = np.concatenate([given, given[:, -1:]], axis=1)[:, :4].astype(np.int64)
    _refuse_degenerate(corners, panels)
    _refuse_open(panels)
    return panels


def _refuse_degenerate(corners: Array, panels: Integers) -> None:
    """Refuse faces with an edge or an area of no size."""
    smallest = _SMALLEST * float(np.ptp(corners, axis=0).max(initial=0.0))
    at = corners[panels]
    edges = np.linalg.norm(np.roll(at, -1, axis=1) - at, axis=2)
    edges[panels[:, 2] == panels[:, 3], 2] = np.inf  # a triangle
    cross = np.cross(at[:, 2] - at[:, 0], at[:, 3] - at[:, 1])
    area = 0.5 * np.linalg.norm(cross, axis=1)
    wrong = np.flatnonzero((edges <= smallest).any(axis=1) | (area <= smallest**2))
    if wrong.size:
        raise SurfaceError(
            f"face {int(wrong[0])} must have an area and edges of some length (a triangle repeats "
            f"its last corner), got corners {panels[wrong[0]].tolist()}"
        )


def _refuse_open(panels: Integers) -> None:
    """Refuse edges that do not belong to two faces which run along them in opposite directions."""
    edges = np.stack([panels, np.roll(panels, -1, axis=1)], axis=2).reshape(-1, 2)
    edges = edges[edges[:, 0] != edges[:, 1]]
    both, times = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    if (times != 2).any():
        a, b = both[times != 2][0].tolist()
        raise SurfaceError(
            f"the surface must be closed, every edge in two faces; that of vertices {a} and {b} is "
            f"in {int(times[times != 2][0])}"
        )
    directed, times = np.unique(edges, axis=0, return_counts=True)
    if (times != 1).any():
        a, b = directed[times != 1][0].tolist()
        raise SurfaceError(
            "the faces must be oriented alike, neighbours running along their edge in opposite "
            f"directions; those at vertices {a} and {b} do not"
        )


def _outward(corners: Array, panels: Integers) -> Integers:
    """Return faces that are counter-clockwise from outside; refuse parts of unlike orientation."""
    part = np.arange(len(corners))
    while True:  # every vertex takes the least number among its faces' vertices
        least = part[panels].min(axis=1)
        before = part.copy()
        np.minimum.at(part, panels, least[:, None])
        if np.array_equal(part, before):
            break
    at = corners[panels]
    # Six times the volume between every face, cut into two triangles, and the middle.
    volume = np.einsum("fi,fi->f", at[:, 0], np.cross(at[:, 1], at[:, 2]))
    volume += np.einsum("fi,fi->f", at[:, 0], np.cross(at[:, 2], at[:, 3]))
    parts = np.bincount(part[panels[:, 0]], weights=volume)
    volumes = parts[np.unique(part[panels[:, 0]])]
    if (volumes > 0.0).all():
        return panels
    if (volumes < 0.0).all():
        return panels[:, [1, 0, 3, 2]].copy()  # a triangle's last corner stays the repeated one
    raise SurfaceError(
        "the faces of all parts must be oriented alike and enclose a volume, got volumes "
        f"{(volumes / 6.0).tolist()} m^3"
    )
