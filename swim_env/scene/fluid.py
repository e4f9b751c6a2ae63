"""The fluid around the body: which model of it, its density and its panels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

from swim_env.errors import SceneError
from swim_env.scene.block import Block
from swim_env.scene.body import MOST_ELEMENTS, Beam
from swim_env.scene.checks import got, integer, one_of, real


class FluidModel(NamedTuple):
    """What a scene has to know of a fluid model; all else is in `swim_env.physics.fluid`.

    Attributes
    ----------
    panels : bool
        Whether the body is cut into panels, if only once.
    needs_density : bool
        Whether it has to know the fluid's density.
    outline : bool
        Whether the panels are those of its closed outline, which needs a thickness.
    axial : bool
        Whether the end panels can have an added mass of their own.
    most_elements, why : int, str
        Largest `Beam.elements`, and where it is a limit of the model, the reason.
    field : str
        The field of `Fluid` that no other model reads, if there is one.
    """

    panels: bool = False
    needs_density: bool = True
    outline: bool = False
    axial: bool = False
    most_elements: int = MOST_ELEMENTS
    why: str = ""
    field: str = ""


NO_FLUID = "none"
"""The name of no fluid at all."""

FLUID_TABLE: dict[str, FluidModel] = {
    NO_FLUID: FluidModel(needs_density=False),
    "strip": FluidModel(field="added_mass_per_length"),
    "frozen": FluidModel(panels=True, outline=True),
    "expansion": FluidModel(
        panels=True, outline=True, most_elements=27, why="its tensor grows with their fourth power"
    ),
    "panels": FluidModel(panels=True, outline=True, axial=True),
    "centreline": FluidModel(panels=True, field="variant"),
}
"""The models by name, from the crudest to the full one; the last one is there for comparison with
the printed equations only."""

FLUID_MODEL_NAMES: tuple[str, ...] = tuple(FLUID_TABLE)
"""Names that `Fluid.model` may have."""

CENTRELINE_VARIANTS: tuple[str, ...] = (
    "consistent",
    "printed_factor",
    "arm_from_start",
    "printed_factor_arm_from_start",
)
"""Names that `Fluid.variant` may have."""

PROPORTIONAL = "proportional"
"""What `Fluid.cap_panels` may be instead of a number."""

MOST_PANELS = 1000
"""Largest `Fluid.panels_per_element` and `Fluid.cap_panels`."""

MOST_PANELS_IN_ALL = 5000
"""Largest number of panels of the whole outline: matrices of more do not fit into memory."""


def _check_panels(value: object, field: str) -> int:
    panels = integer(2, MOST_PANELS)(value, field)
    if panels % 2:
        raise SceneError(
            f"{field} must be even, as it counts both sides of an element, got {panels}"
        )
    return panels


def _check_caps(value: object, field: str) -> int | str:
    if isinstance(value, str):
        return one_of(("a whole number", PROPORTIONAL))(value, field)
    try:
        return integer(1, MOST_PANELS)(value, field)
    except SceneError as error:
        raise SceneError(f"{error.problem}; or {PROPORTIONAL}") from None


@dataclass(frozen=True)
class FluidBase(Block, path="fluid"):
    """A fluid around a body: its model and its density.

    Attributes
    ----------
    model : str
        Name of the model, one of a table.
    density : float or None
        Fluid density [kg/m^3], above 0; None with the model ``none``.
    """

    #: The models by name.
    _models: ClassVar[dict[str, FluidModel]]

    model: str = "panels"
    density: Annotated[float | None, real("kg/m^3", above=0.0)] = None

    @property
    def present(self) -> bool:
        """Whether there is any fluid, that is, the model is not ``none``."""
        return self.model != NO_FLUID

    def __post_init__(self) -> None:
        """Check every field, and that the model has a use for it."""
        super().__post_init__()
        if not self.present and self.density is not None:
            raise SceneError(
                f"fluid.density has no meaning with fluid.model {NO_FLUID}, which needs null, "
                f"got {got(self.density)}"
            )
        if self._models[self.model].needs_density and self.density is None:
            raise SceneError(
                f"fluid.model {self.model} needs fluid.density, a number above 0 in kg/m^3, "
                "got null"
            )
        for model, row in self._models.items():
            value = getattr(self, row.field) if row.field else None
            if value is not None and self.model != model:
                raise SceneError(
                    f"fluid.{row.field} has no meaning with fluid.model {self.model}, only with "
                    f"{model}; it needs null, got {got(value)}"
                )


@dataclass(frozen=True)
class Fluid(FluidBase, path="fluid"):
    """The fluid around the body: inviscid, irrotational, at rest far away.

    Attributes
    ----------
    model : str
        One of `FLUID_MODEL_NAMES`. ``none`` is the same as no fluid at all; ``strip`` gives every
        element the added mass of its own length; ``frozen`` takes the straight body's whatever the
        shape; ``expansion`` adds its second derivatives by the joint angles; ``panels`` evaluates
        every shape; ``centreline`` is the letter of the printed equations, for comparison only:
        sources on one side of the centre line.
    density : float or None
        Fluid density [kg/m^3, at unit depth], above 0; None with the model ``none``.
    panels_per_element : int
        Panels on both sides of an element together, or on its centre line; even, 2 to 1000.
    cap_panels : int or str
        Panels that close each end of the body, 1 to 1000; or ``proportional`` for as many as make
        them about a third as long as those of the sides, which refines the ends with the sides
        (one for the paper's body with 4 panels per element). Strips have no panels and leave both
        alone, the centre line has no ends.
    added_mass_per_length : float or None
        With the model ``strip`` alone: an element's added mass per length [kg/m], above 0; the
        mean value of a straight plate, pi/4 density length, where None.
    variant : str or None
        With the model ``centreline`` alone: one of `CENTRELINE_VARIANTS`, the boundary value of a
        turning element; ``consistent`` where None.
    """

    _models = FLUID_TABLE

    model: Annotated[str, one_of(FLUID_MODEL_NAMES)] = "panels"
    panels_per_element: Annotated[int, _check_panels] = 4
    cap_panels: Annotated[int | str, _check_caps] = 1
    added_mass_per_length: Annotated[float | None, real("kg/m", above=0.0)] = None
    variant: Annotated[str | None, one_of(CENTRELINE_VARIANTS)] = None

    def panels_per_end(self, beam: Beam) -> int:
        """Return the number of panels that close each end of a body."""
        if isinstance(self.cap_panels, str):
            on_a_side = 2.0 * beam.element_length / self.panels_per_element
            return max(1, round(2.0 * beam.half_thickness / (on_a_side / 3.0)))
        return self.cap_panels

    def check_body(self, beam: Beam) -> None:
        """Refuse a body that the model cannot be computed for.

        Raises
        ------
        SceneError
            If it is too thin or too thick for an outline, or has too many panels or elements.
        """
        model = FLUID_TABLE[self.model]
        limit = 0.25 * beam.length
        if model.outline and not 0.0 < beam.half_thickness < limit:
            raise SceneError(
                f"beam.half_thickness must be above 0 and below a quarter of the length, "
                f"{limit:.6g} m, for an outline of panels, got {beam.half_thickness!r}"
            )
        ends = self.panels_per_end(beam)
        # Panels resolve what is at least half their length away; the ends' and the sides of the
        # next element but one are two element lengths apart.
        needed = 1 + math.floor(0.5 * beam.half_thickness / beam.element_length * (1.0 + 1e-9))
        if model.outline and beam.elements > 2 and ends < needed:
            raise SceneError(
                f"fluid.cap_panels must be at least {needed}, or {PROPORTIONAL}, got {ends}: the "
                f"panels on ends of {2.0 * beam.half_thickness:.3g} m must be shorter than four "
                f"elements of {beam.element_length:.3g} m"
            )
        panels = beam.elements * self.panels_per_element + 2 * ends
        if model.panels and panels > MOST_PANELS_IN_ALL:
            raise SceneError(
                f"beam.elements times fluid.panels_per_element and the ends' panels must be "
                f"at most {MOST_PANELS_IN_ALL} panels, got {panels}"
            )
        if beam.elements > model.most_elements:
            raise SceneError(
                f"fluid.model {self.model} takes at most {model.most_elements} elements, as "
                f"{model.why}, got {beam.elements}; take panels"
            )
