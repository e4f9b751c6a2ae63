"""Rigid-body added mass of any closed outline, from the panel code that the swimmer uses."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.errors import OutlineError
from swim_env.physics.fluid.outline import CT, CX, CY, LENGTH, ST, X, Y
from swim_env.physics.fluid.sources import LAYERS, POTENTIAL, influence, normal_influence
from swim_env.physics.loading import load_kernels
from swim_env.physics.runtime.views import padded

Array = NDArray[np.float64]

_ROWS = 7


def added_mass_of_polygon(vertices: ArrayLike, density: float = 1.0) -> Array:
    """Compute the rigid-body added mass of a closed outline in the plane.

    Every edge is one source panel of constant strength with its collocation point at the middle
    (Hess & Smith). Polygons inscribed in a smooth curve converge at first order in the number
    of edges: about 250 edges for 1 %.

    Parameters
    ----------
    vertices : (M, 2) array_like
        Corners of the outline (m), M >= 3, in either turning sense; the last edge closes it (a
        repeated first corner at the end is dropped). Edges must not cross or touch.
    density : float
        Fluid density (kg/m^3, unit depth).

    Returns
    -------
    (3, 3) array
        Symmetric added mass for motion along x, along y and rotation about the origin (kg,
        kg m, kg m^2 per metre of depth).

    Raises
    ------
    OutlineError
        If the corners are not a finite (M, 2) array, edges have no length, cross or touch, the
        outline encloses no area, or the density is not a positive number.
    """
    corners = _checked_corners(vertices)
    if isinstance(density, bool) or not isinstance(density, (int, float, np.number)):
        raise OutlineError(f"density must be a number in kg/m^3, got {density!r}")
    if not 0.0 < float(density) < np.inf:
        raise OutlineError(f"density must be a positive number in kg/m^3, got {density!r}")
    load_kernels()
    count = len(corners)
    panels = _panels(corners)
    size = panels.shape[1]
    layers = np.zeros((LAYERS, size, size))
    # The net flux of a rigid motion through a closed outline is zero, so the length in whose
    # units the logarithm is taken drops out; the perimeter keeps the numbers of order one.
    influence(panels, count, float(panels[LENGTH].sum()), np.empty(size + 1), layers)
    normal = np.empty((size, size))
    normal_influence(panels, count, layers, normal)
    panels = panels[:, :count]
    normal_x, normal_y = panels[ST], -panels[CT]
    motions = np.stack([normal_x, normal_y, normal_y * panels[CX] - normal_x * panels[CY]], axis=1)
    strengths = np.linalg.solve(normal[:count, :count], motions)
    potential = layers[POTENTIAL, :count, :count] @ strengths
    mass = -float(density) * motions.T @ (panels[LENGTH][:, None] * potential)
    symmetric: Array = 0.5 * (mass + mass.T)
    return symmetric


def _checked_corners(vertices: ArrayLike) -> Array:
    try:
        corners = np.array(vertices, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise OutlineError(f"vertices must be an (M, 2) array of numbers: {error}") from None
    if corners.ndim != 2 or corners.shape[1] != 2:
        raise OutlineError(f"vertices must have shape (M, 2), got {corners.shape}")
    if not np.isfinite(corners).all():
        row = int(np.flatnonzero(~np.isfinite(corners).all(axis=1))[0])
        raise OutlineError(f"vertices must be finite, got {corners[row].tolist()} in row {row}")
    if len(corners) > 1 and np.array_equal(corners[0], corners[-1]):
        corners = corners[:-1]
    if len(corners) < 3:
        raise OutlineError(f"an outline must have at least 3 corners, got {len(corners)}")
    edges = np.roll(corners, -1, axis=0) - corners
    size = float(np.ptp(corners, axis=0).max())
    short = np.flatnonzero(np.hypot(edges[:, 0], edges[:, 1]) <= 1e-14 * size)
    if short.size:
        raise OutlineError(f"edge {int(short[0])} of the outline has no length")
    # Corners seen from the first one: far from the origin the products would lose the area.
    seen = corners - corners[0]
    furthest = seen[np.argmax(np.hypot(seen[:, 0], seen[:, 1]))]
    off_line = np.abs(furthest[0] * seen[:, 1] - furthest[1] * seen[:, 0])
    if float(off_line.max()) <= 1e-14 * size * size:
        raise OutlineError("the outline must enclose an area, its corners lie on one line")
    _refuse_crossings(corners)
    following = np.roll(seen, -1, axis=0)
    doubled_area = float(np.sum(seen[:, 0] * following[:, 1] - following[:, 0] * seen[:, 1]))
    return corners if doubled_area > 0.0 else corners[::-1].copy()


def _refuse_crossings(corners: Array) -> None:
    """Refuse edges that cross or touch others than their neighbours."""
    count = len(corners)
    ends = np.roll(corners, -1, axis=0)
    for i in range(count - 2):
        others = np.arange(i + 2, count if i > 0 else count - 1)
        a, b, c, d = corners[i], ends[i], corners[others], ends[others]
        first = _side(a, b, c) * _side(a, b, d)
        second = _side(c, d, a) * _side(c, d, b)
        crossing = (first <= 0.0) & (second <= 0.0) & _boxes_meet(a, b, c, d)
        if crossing.any():
            j = int(others[np.flatnonzero(crossing)[0]])
            raise OutlineError(f"edges {i} and {j} of the outline cross or touch")


def _side(a: Array, b: Array, c: Array) -> Array:
    side: Array = (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (
        c[..., 0] - a[..., 0]
    )
    return np.sign(side)


def _boxes_meet(a: Array, b: Array, c: Array, d: Array) -> NDArray[np.bool_]:
    low, high = np.minimum(a, b), np.maximum(a, b)
    others_low, others_high = np.minimum(c, d), np.maximum(c, d)
    meet: NDArray[np.bool_] = np.all((low <= others_high) & (others_low <= high), axis=-1)
    return meet


def _panels(corners: Array) -> Array:
    """Lay out the edges of a counter-clockwise outline as panels, padded as kernels take them."""
    following = np.roll(corners, -1, axis=0)
    edges = following - corners
    length = np.hypot(edges[:, 0], edges[:, 1])
    count = len(corners)
    panels = np.zeros((_ROWS, padded(count)))
    panels[[X, Y], :count] = corners.T
    panels[[X, Y], count:] = corners[:1].T
    panels[[CX, CY], :count] = (0.5 * (corners + following)).T
    panels[CT] = 1.0
    panels[[CT, ST], :count] = (edges / length[:, None]).T
    panels[LENGTH, :count] = length
    return panels
