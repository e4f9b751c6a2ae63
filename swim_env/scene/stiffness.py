"""The laws by which a body's stiffness may vary along it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SceneError
from swim_env.scene.block import Block, build_block
from swim_env.scene.checks import check_fields, got, is_number, listed, real, reals

Floats = NDArray[np.float64]

#: Where laws are in a planar scene.
_FIELD = "beam.bending_stiffness"
_PIECES = f"{_FIELD}.pieces"


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
class PiecewiseStiffness(Block, path=_FIELD):
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
class LinearStiffness(Block, path=f"{_FIELD}.linear"):
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


def check_stiffness(value: object, field: str) -> Stiffness:
    """Return any of the four ways to give a stiffness in its stored form."""
    if isinstance(value, (PiecewiseStiffness, LinearStiffness)):
        return value
    if isinstance(value, Mapping):
        given = check_fields(value, field, ["pieces", "linear"])
        if len(given) != 1:
            raise SceneError(f"{field} must have either pieces or linear, got {len(given)} of them")
        try:
            if "pieces" in given:
                return PiecewiseStiffness(given["pieces"])
            return build_block(LinearStiffness, given["linear"], f"{field}.linear")
        except SceneError as error:  # a law does not know whose it is
            raise SceneError(error.problem.replace(_FIELD, field, 1)) from None
    if listed(value) is not None:
        return reals("N m^2", at_least=0.0)(value, field)
    if value is None:
        return 0.0
    if is_number(value):
        return real("N m^2", at_least=0.0)(value, field)
    raise SceneError(
        f"{field} must be a number in N m^2, a list of them, pieces or linear, got {got(value)}"
    )


def check_one_per_joint(law: Stiffness, elements: int, field: str) -> None:
    """Refuse a list of stiffnesses that does not have one for each joint."""
    if isinstance(law, tuple) and len(law) != elements - 1:
        raise SceneError(
            f"{field} must list one value per joint, {elements - 1} for "
            f"beam.elements = {elements}, got {len(law)}"
        )


def stiffness_at(law: Stiffness, fraction: Floats) -> Floats:
    """Stiffness [N m^2] at the joints, whose places are s/l = `fraction`."""
    if isinstance(law, (PiecewiseStiffness, LinearStiffness)):
        return law.at(fraction)
    return np.array(np.broadcast_to(law, fraction.shape), dtype=np.float64)
