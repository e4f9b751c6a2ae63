"""The fluid around a body in space: its model, density and surface panels, and its stream."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SceneError
from swim_env.scene.checks import Triple, got, integer, listed, one_of, reals, vector
from swim_env.scene.effects import Effect
from swim_env.scene.fluid import MOST_PANELS, MOST_PANELS_IN_ALL, NO_FLUID, FluidBase, FluidModel
from swim_env.scene.spatial.body import SpatialBeam

Floats = NDArray[np.float64]
Matrix = tuple[tuple[float, ...], ...]

SPATIAL_FLUID_TABLE: dict[str, FluidModel] = {
    NO_FLUID: FluidModel(needs_density=False),
    "strip": FluidModel(),
    "frozen": FluidModel(panels=True),
    "panels": FluidModel(panels=True),
    "given": FluidModel(needs_density=False, field="matrix"),
}
"""The models by name, from the crudest to the full one; the last one is for comparisons."""

SPATIAL_FLUID_MODEL_NAMES: tuple[str, ...] = tuple(SPATIAL_FLUID_TABLE)
"""Names that `SpatialFluid.model` may have."""

SELF_TERM_NAMES: tuple[str, ...] = ("gauss", "flat")
"""Names that `SpatialFluid.self_term` may have."""

RING_NAMES: tuple[str, ...] = ("area_true", "inscribed")
"""Names that `SpatialFluid.rings` may have."""

#: Largest difference of an entry of a given matrix from the one opposite, as a share of the largest
#: entry: rounding.
_ASYMMETRY = 1e-12


def _check_around(value: object, field: str) -> int:
    around = integer(4, MOST_PANELS)(value, field)
    if around % 4:
        raise SceneError(
            f"{field} must be a multiple of 4, so that rings have both mirror planes, got {around}"
        )
    return around


def _check_matrix(value: object, field: str) -> Matrix:
    items = listed(value)
    if not items:
        raise SceneError(f"{field} must be a list of 6N rows of 6N numbers, got {got(value)}")
    rows = tuple(reals("kg, kg m or kg m^2")(item, f"{field}[{i}]") for i, item in enumerate(items))
    for i, row in enumerate(rows):
        if len(row) != len(rows):
            raise SceneError(
                f"{field} must be square, {len(rows)} numbers in each of its rows, got {len(row)} "
                f"in {field}[{i}]"
            )
    matrix = np.array(rows)
    difference = np.abs(matrix - matrix.T)
    i, j = divmod(int(np.argmax(difference)), len(rows))
    if difference[i, j] > _ASYMMETRY * np.abs(matrix).max():
        raise SceneError(
            f"{field} must be symmetric, got {rows[i][j]!r} in {field}[{i}][{j}] and "
            f"{rows[j][i]!r} in {field}[{j}][{i}]"
        )
    return rows


@dataclass(frozen=True)
class SpatialFluid(FluidBase, path="fluid"):
    """The fluid around a body in space: inviscid, irrotational, at rest far away.

    Attributes
    ----------
    model : str
        One of `SPATIAL_FLUID_MODEL_NAMES`. ``none`` is the same as no fluid at all; ``strip`` gives
        every element the added mass of its own sections; ``frozen`` takes the straight body's from
        panels on its surface, whatever the shape; ``panels`` evaluates every shape; ``given`` takes
        a matrix.
    density : float or None
        Fluid density [kg/m^3], above 0, also the body's where that has none; None with the model
        ``none``, and as one likes with ``given``.
    rows : int
        Rings of panels on each element, 1 to 1000.
    around : int
        Panels in a ring, a multiple of 4, 4 to 1000. Models without panels leave both alone.
    self_term : str
        One of `SELF_TERM_NAMES`, a panel's influence on itself, with panels alone: from Gauss's
        law, or that of a ``flat`` panel, for comparison only.
    rings : str
        One of `RING_NAMES`, with panels alone: polygons of the ellipse's area, or polygons
        ``inscribed`` in it, for comparison only.
    matrix : tuple of tuple of float, or None
        With the model ``given`` alone: the added mass, (6N, 6N) and symmetric, for the velocities
        (v1 v2 v3 w1 w2 w3) of every element along and about its directors [kg, kg m, kg m^2].
    """

    _models = SPATIAL_FLUID_TABLE

    model: Annotated[str, one_of(SPATIAL_FLUID_MODEL_NAMES)] = "panels"
    rows: Annotated[int, integer(1, MOST_PANELS)] = 2
    around: Annotated[int, _check_around] = 12
    self_term: Annotated[str, one_of(SELF_TERM_NAMES)] = SELF_TERM_NAMES[0]
    rings: Annotated[str, one_of(RING_NAMES)] = RING_NAMES[0]
    matrix: Annotated[Matrix | None, _check_matrix] = None

    def __post_init__(self) -> None:
        """Check every field, and that the model has a use for it."""
        super().__post_init__()
        panels = [name for name, row in SPATIAL_FLUID_TABLE.items() if row.panels]
        for name, default in (("self_term", SELF_TERM_NAMES[0]), ("rings", RING_NAMES[0])):
            if self.model not in panels and getattr(self, name) != default:
                raise SceneError(
                    f"fluid.{name} has no meaning with fluid.model {self.model}, only with "
                    f"{' or '.join(panels)}; leave it out, got {getattr(self, name)!r}"
                )
        if self.model == "given" and self.matrix is None:
            raise SceneError(
                "fluid.model given needs fluid.matrix, a list of 6N rows of 6N numbers, got null"
            )

    def panels_in_all(self, beam: SpatialBeam) -> int:
        """Return the number of panels of the whole surface.

        A flat cap of a uniform body has a ring of quadrilaterals and a fan of triangles.
        """
        caps = 4 if beam.section.profile == "uniform" else 0
        return self.around * (beam.elements * self.rows + caps)

    def check_body(self, beam: SpatialBeam) -> None:
        """Refuse a body that the model cannot be computed for.

        Raises
        ------
        SceneError
            If it has too many panels, or the given matrix does not fit it.
        """
        if SPATIAL_FLUID_TABLE[self.model].panels:
            panels = self.panels_in_all(beam)
            if panels > MOST_PANELS_IN_ALL:
                raise SceneError(
                    f"beam.elements times fluid.rows times fluid.around and the caps' panels must "
                    f"be at most {MOST_PANELS_IN_ALL} panels, got {panels}"
                )
        size = 6 * beam.elements
        if self.matrix is not None and len(self.matrix) != size:
            raise SceneError(
                f"fluid.matrix must have 6N rows, {size} for beam.elements = {beam.elements}, got "
                f"{len(self.matrix)}"
            )


@dataclass(frozen=True)
class SpatialStream(Effect, path="stream"):
    """Effect: the fluid far away moves with one velocity; see `Stream`, that of the plane.

    Attributes
    ----------
    velocity : tuple of float
        (x, y, z) [m/s].
    """

    needs_fluid = True

    velocity: Annotated[Triple, vector("m/s", "x", "y", "z")]
