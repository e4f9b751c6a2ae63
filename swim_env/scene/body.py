"""The swimming body: a beam, and the laws by which its bending stiffness may vary along it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SceneError
from swim_env.scene.block import Block, build_block
from swim_env.scene.checks import check_fields, got, integer, is_number, listed, real, reals

Floats = NDArray[np.float64]

MOST_ELEMENTS = 1000
"""Largest `Beam.elements`."""

_PIECES = "beam.bending_stiffness.pieces"


@dataclass(frozen=True)
class StiffnessPiece(Block, path=_PIECES):
    """A stretch of constant bending stiffness, ending before `until`.

    Attributes
    ----------
    until : float
        End of the stretch as s/l, in (0, 1]; a joint exactly there belongs to the next one.
    value : float
        Bending stiffness EI on the stretch [N m^2], at least 0.
    """

    until: Annotated[float, real(above=0.0, at_most=1.0)]
    value: Annotated[float, real("N m^2", at_least=0.0)]


def _check_pieces(value: object, field: str) -> tuple[StiffnessPiece, ...]:
    """Return stretches that increase and end at the tail."""
    items = listed(value)
    if not items:
        raise SceneError(f"{field} must be a list of {{until: s/l, value: EI}}, got {got(value)}")
    pieces = tuple(_check_piece(item, f"{field}[{i}]") for i, item in enumerate(items))
    for i, (left, right) in enumerate(zip(pieces, pieces[1:], strict=False)):
        if not right.until > left.until:
            raise SceneError(
                f"{field}[{i + 1}].until must be above the one before it, {left.until!r}, "
                f"got {right.until!r}"
            )
    if pieces[-1].until != 1.0:
        raise SceneError(
            f"{field}[{len(pieces) - 1}].until must be 1.0, the tail, as the last one, "
            f"got {pieces[-1].until!r}"
        )
    return pieces


def _check_piece(item: object, field: str) -> StiffnessPiece:
    try:
        return build_block(StiffnessPiece, item, field)
    except SceneError as error:  # a piece does not know its place in the list
        raise SceneError(error.problem.replace(f"{_PIECES}.", f"{field}.", 1)) from None


@dataclass(frozen=True)
class PiecewiseStiffness(Block, path="beam.bending_stiffness"):
    """Bending stiffness that is constant on stretches of the body.

    Attributes
    ----------
    pieces : tuple of StiffnessPiece
        The stretches from head to tail; `until` [s/l] increases and ends at 1.
    """

    pieces: Annotated[tuple[StiffnessPiece, ...], _check_pieces]

    def at(self, fraction: Floats) -> Floats:
        """Bending stiffness [N m^2] at the places s/l = `fraction`."""
        ends = np.array([piece.until for piece in self.pieces])
        values = np.array([piece.value for piece in self.pieces])
        return values[np.searchsorted(ends[:-1], fraction, side="right")]


@dataclass(frozen=True)
class LinearStiffness(Block, path="beam.bending_stiffness.linear"):
    """Bending stiffness that varies linearly along the body, EI = head + (tail - head) s/l.

    Attributes
    ----------
    head : float
        Bending stiffness at the head, s = 0 [N m^2], at least 0.
    tail : float
        Bending stiffness at the tail, s = l [N m^2], at least 0.
    """

    head: Annotated[float, real("N m^2", at_least=0.0)]
    tail: Annotated[float, real("N m^2", at_least=0.0)]

    def at(self, fraction: Floats) -> Floats:
        """Bending stiffness [N m^2] at the places s/l = `fraction`."""
        return np.asarray(self.head + (self.tail - self.head) * fraction, dtype=np.float64)

    def to_plain(self) -> dict[str, object]:
        """Return the form that a beam takes: ``{linear: {head, tail}}``."""
        return {"linear": super().to_plain()}


Stiffness = float | tuple[float, ...] | PiecewiseStiffness | LinearStiffness


def _check_stiffness(value: object, field: str) -> Stiffness:
    """Return any of the four ways to give EI in its stored form."""
    if isinstance(value, (PiecewiseStiffness, LinearStiffness)):
        return value
    if isinstance(value, Mapping):
        given = check_fields(value, field, ["pieces", "linear"])
        if set(given) == {"pieces"}:
            return PiecewiseStiffness(given["pieces"])
        if set(given) == {"linear"}:
            return build_block(LinearStiffness, given["linear"], f"{field}.linear")
        raise SceneError(f"{field} must have either pieces or linear, got {len(given)} of them")
    if listed(value) is not None:
        return reals("N m^2", at_least=0.0)(value, field)
    if value is None:
        return 0.0
    if is_number(value):
        return real("N m^2", at_least=0.0)(value, field)
    raise SceneError(
        f"{field} must be a number in N m^2, a list of them, pieces or linear, got {got(value)}"
    )


@dataclass(frozen=True)
class Beam(Block, path="beam"):
    """The elastic body: a chain of equal rigid elements with bending springs at the joints.

    Attributes
    ----------
    length : float
        Length l [m], above 0.
    elements : int
        Number of elements N, 2 to 1000.
    half_thickness : float
        Half the thickness in the plane of motion [m], at least 0. Only the fluid sees it; with a
        fluid of panels it must be above 0 and below a quarter of the length. It limits how far the
        body may bend: the inner side of every element keeps a tenth of its length.
    line_density : float
        Mass per length rho_B A [kg/m], above 0.
    rotary_inertia : float
        Rotary inertia per length rho_B I_1 [kg m], at least 0.
    bending_stiffness : float, tuple of float, PiecewiseStiffness or LinearStiffness
        Bending stiffness EI [N m^2], at least 0: one value, one value for each of the N - 1
        joints, or a law in s/l, which means the same at every N. Lists and mappings, as YAML
        has them, are converted. The effect is absent at 0 or null.
    """

    length: Annotated[float, real("m", above=0.0)] = 1.0
    elements: Annotated[int, integer(2, MOST_ELEMENTS)] = 9
    half_thickness: Annotated[float, real("m", at_least=0.0)] = 0.01
    line_density: Annotated[float, real("kg/m", above=0.0)] = 0.31
    rotary_inertia: Annotated[float, real("kg m", at_least=0.0)] = 7.8e-6
    bending_stiffness: Annotated[Stiffness, _check_stiffness] = 5.0

    def __post_init__(self) -> None:
        """Check every field, and that a list of stiffnesses has one for each joint."""
        super().__post_init__()
        law = self.bending_stiffness
        if isinstance(law, tuple) and len(law) != self.elements - 1:
            raise SceneError(
                f"beam.bending_stiffness must list one value per joint, {self.elements - 1} for "
                f"beam.elements = {self.elements}, got {len(law)}"
            )

    @property
    def element_length(self) -> float:
        """Length of one element, dl = l/N [m]."""
        return self.length / self.elements

    @property
    def joint_fractions(self) -> Floats:
        """Places of the joints as s/l, (N-1,): (k-1)/N for the joint of elements k-1 and k."""
        return np.arange(1, self.elements, dtype=np.float64) / self.elements

    def stiffness_at_joints(self) -> Floats:
        """Bending stiffness at the joints, from head to tail.

        Returns
        -------
        numpy.ndarray
            EI [N m^2], shape (N-1,), float64; entry k-2 belongs to the joint between elements
            k-1 and k, at s = (k-1) dl.
        """
        law = self.bending_stiffness
        if isinstance(law, (PiecewiseStiffness, LinearStiffness)):
            return law.at(self.joint_fractions)
        if isinstance(law, tuple):
            return np.array(law, dtype=np.float64)
        return np.full(self.elements - 1, law, dtype=np.float64)
