"""Rigid-body added mass of any closed outline, from the panel code that the swimmer uses."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.errors import OutlineError
from swim_env.physics.fluid.outline import CT, CX, CY, LENGTH, ST, X, Y
from swim_env.physics.fluid.sources import LAYERS, POTENTIAL, influence, normal_influence
from swim_env.physics.loading import load_kernels
from swim_env.physics.runtime.views import padded
from swim_env.scene.checks import is_number

Array = NDArray[np.float64]

_ROWS = 7
#: Largest number of panels: the matrices of more take over a gigabyte.
MOST_PANELS = 5000
#: A last corner this close to the first one, in sizes of the outline, repeats it.
_CLOSED = 1e-6
#: Outlines of up to this many panels are checked by cutting each in two, and a change of the added
#: mass beyond this share is warned of.
_CHECKED, _LARGEST_CHANGE = 512, 0.05


def added_mass_of_polygon(
    vertices: ArrayLike, density: float = 1.0, *, panels_per_edge: int = 1
) -> Array:
    """Compute the rigid-body added mass of a closed outline in the plane.

    Every edge is one source panel of constant strength with its collocation point at the middle
    (Hess & Smith), or is cut into `panels_per_edge` equal ones. Polygons inscribed in a smooth
    curve converge at first order in the number of edges: about 250 edges for 1 %.

    Parameters
    ----------
    vertices : (M, 2) array_like
        Corners of the outline (m), M >= 3, in either turning sense; the last edge closes it (a
        last corner that repeats the first one to a millionth of the size is dropped). Edges must
        not cross or touch.
    density : float
        Fluid density (kg/m^3, unit depth).
    panels_per_edge : int
        Panels on every edge; at most 5000 in all. The edges of a body with corners, such as a
        square, need many.

    Returns
    -------
    (3, 3) array
        Symmetric added mass for motion along x, along y and rotation about the origin (kg,
        kg m, kg m^2 per metre of depth).

    Raises
    ------
    OutlineError
        If the corners are not a finite (M, 2) array, edges have no length, cross or touch, the
        outline encloses no area, there are too many panels, or the density is not a positive
        number.

    Warns
    -----
    UserWarning
        If an outline of up to 512 panels has too few: the added mass changes by more than 5 % when
        each is cut in two.
    """
    # What is not finite leaves a rest that is no number.
    if not is_number(panels_per_edge) or panels_per_edge % 1 != 0:
        raise OutlineError(f"panels_per_edge must be a whole number, got {panels_per_edge!r}")
    if panels_per_edge < 1:
        raise OutlineError(f"panels_per_edge must be at least 1, got {panels_per_edge}")
    parts = int(panels_per_edge)
    corners = _cut(_checked_corners(vertices, parts), parts)
    if not is_number(density):
        raise OutlineError(f"density must be a number in kg/m^3, got {density!r}")
    if not 0.0 < float(density) < np.inf:
        raise OutlineError(f"density must be a positive number in kg/m^3, got {density!r}")
    load_kernels()
    mass = _added_mass(corners, float(density))
    if len(corners) <= _CHECKED:
        finer = _added_mass(_cut(corners, 2), float(density))
        # A body that is thin, or round, has hardly any of its own along itself, or in rotation.
        moving = finer[:2, :2].diagonal().max()
        radius = 0.5 * float(np.ptp(corners, axis=0).max())
        scale = np.sqrt([moving, moving, max(moving * radius**2, finer[2, 2])])
        change = float((np.abs(finer - mass) / np.outer(scale, scale)).max())
        if not change <= _LARGEST_CHANGE:
            warnings.warn(
                f"{len(corners)} panels are too few for this outline: its added mass changes by "
                f"{change:.0%} when each is cut in two; give more corners or panels_per_edge",
                stacklevel=2,
            )
    return mass


def _cut(corners: Array, parts: int) -> Array:
    """Cut every edge into equal parts."""
    edges = np.roll(corners, -1, axis=0) - corners
    shares = np.arange(parts) / parts
    cut: Array = (corners[:, None] + shares[:, None] * edges[:, None]).reshape(-1, 2)
    return cut


def _added_mass(corners: Array, density: float) -> Array:
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
    mass = -density * motions.T @ (panels[LENGTH][:, None] * potential)
    symmetric: Array = 0.5 * (mass + mass.T)
    return symmetric


def _checked_corners(vertices: ArrayLike, panels_per_edge: int) -> Array:
    try:
        corners = np.array(vertices, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise OutlineError(f"vertices must be an (M, 2) array of numbers: {error}") from None
    if corners.ndim != 2 or corners.shape[1] != 2:
        raise OutlineError(f"vertices must have shape (M, 2), got {corners.shape}")
    if not np.isfinite(corners).all():
        row = int(np.flatnonzero(~np.isfinite(corners).all(axis=1))[0])
        raise OutlineError(f"vertices must be finite, got {corners[row].tolist()} in row {row}")
    size = float(np.ptp(corners, axis=0).max(initial=0.0)) if len(corners) else 0.0
    if len(corners) > 1 and np.hypot(*(corners[0] - corners[-1])) <= _CLOSED * size:
        corners = corners[:-1]
    if len(corners) < 3:
        raise OutlineError(f"an outline must have at least 3 corners, got {len(corners)}")
    if len(corners) * panels_per_edge > MOST_PANELS:
        raise OutlineError(
            f"an outline may have at most {MOST_PANELS} panels, got {len(corners)} edges with "
            f"{panels_per_edge} on each"
        )
    edges = np.roll(corners, -1, axis=0) - corners
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
