"""The body's cross-section: an ellipse whose semi-axes vary along it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SceneError
from swim_env.scene.block import Block
from swim_env.scene.checks import Triple, got, listed, one_of, real, vector

Floats = NDArray[np.float64]

PROFILE_NAMES: tuple[str, ...] = ("uniform", "ellipsoid", "fish")
"""Names that `Section.profile` may have."""

#: The profile that is given by a table.
_FISH = "fish"


def _check_table(value: object, field: str) -> tuple[Triple, ...]:
    items = listed(value)
    if items is None or len(items) < 3:
        raise SceneError(
            f"{field} must be a list of at least three rows [s/l, half width, half height], got "
            f"{got(value)}"
        )
    check = vector("", "s/l", "half width", "half height")
    rows = tuple(check(item, f"{field}[{i}]") for i, item in enumerate(items))
    for end, place in ((0, 0.0), (len(rows) - 1, 1.0)):
        if rows[end] != (place, 0.0, 0.0):
            raise SceneError(
                f"{field}[{end}] must be [{place:g}, 0, 0], as the widths vanish at both ends, got "
                f"{list(rows[end])}"
            )
    for i in range(1, len(rows)):
        if not rows[i][0] > rows[i - 1][0]:
            raise SceneError(
                f"{field}[{i}][0] must be above the s/l before it, {rows[i - 1][0]!r}, got "
                f"{rows[i][0]!r}"
            )
    for i, row in enumerate(rows[1:-1], start=1):
        for k in (1, 2):
            real("m", above=0.0)(row[k], f"{field}[{i}][{k}]")
    return rows


@dataclass(frozen=True)
class Section(Block, path="beam.section"):
    """The cross-section: an ellipse of semi-axes half_width along d1 and half_height along d2.

    Attributes
    ----------
    profile : str
        One of `PROFILE_NAMES`: the same ``uniform`` section everywhere; an ``ellipsoid``, whose
        semi-axes are those of the middle times sqrt(1 - (2s/l - 1)^2); a ``fish`` by a table.
    half_width, half_height : float or None
        Semi-axes [m], above 0, of the whole body or of its middle; None with a table.
    table : tuple of tuple of float, or None
        With ``fish`` alone: rows (s/l, half width [m], half height [m]), between which a monotone
        cubic runs (SciPy's PchipInterpolator). s/l increases from 0 to 1, where both are 0.
    """

    profile: Annotated[str, one_of(PROFILE_NAMES)] = "uniform"
    half_width: Annotated[float | None, real("m", above=0.0)] = None
    half_height: Annotated[float | None, real("m", above=0.0)] = None
    table: Annotated[tuple[Triple, ...] | None, _check_table] = None

    def __post_init__(self) -> None:
        """Check every field, and that the profile has what it needs and nothing else."""
        super().__post_init__()
        needs = {"half_width": "a number above 0 in m", "half_height": "a number above 0 in m"}
        unused = {"table": _FISH}
        if self.profile == _FISH:
            needs = {"table": "a list of rows [s/l, half width, half height]"}
            unused = dict.fromkeys(("half_width", "half_height"), "uniform or ellipsoid")
        for name, what in needs.items():
            if getattr(self, name) is None:
                raise SceneError(
                    f"beam.section.profile {self.profile} needs beam.section.{name}, {what}, "
                    "got null"
                )
        for name, profiles in unused.items():
            if getattr(self, name) is not None:
                raise SceneError(
                    f"beam.section.{name} has no meaning with beam.section.profile "
                    f"{self.profile}, only with {profiles}; it needs null, got "
                    f"{got(getattr(self, name))}"
                )

    def semi_axes(self, fraction: Floats) -> tuple[Floats, Floats]:
        """Half width and half height [m] at the places s/l = `fraction`, 0 to 1."""
        if self.table is not None:
            from scipy.interpolate import PchipInterpolator

            place, *widths = np.array(self.table).T
            width, height = (PchipInterpolator(place, one)(fraction) for one in widths)
            return width, height
        assert self.half_width is not None and self.half_height is not None
        share = np.ones_like(fraction)
        if self.profile == "ellipsoid":
            share = np.sqrt(np.maximum(0.0, 1.0 - (2.0 * fraction - 1.0) ** 2))
        return self.half_width * share, self.half_height * share
