"""Checks of single values: each takes a value and the name of its field for messages.

A check returns the value in its stored form or raises a `SceneError`. A bool is not a number, a
number must be finite, and an integer may be written as a float (4.0). Numpy scalars and arrays
pass as the numbers and lists they hold.
"""

from __future__ import annotations

import difflib
import math
import numbers
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from swim_env.errors import OptionError, SceneError

T = TypeVar("T")
Pair = tuple[float, float]
Triple = tuple[float, float, float]
Check = Callable[[object, str], T]


def got(value: object) -> str:
    """Describe a refused value in a few words on one line."""
    if value is None:
        return "null"
    if isinstance(value, (bool, np.bool_)):
        return str(bool(value)).lower()
    if isinstance(value, str):
        return "text " + repr(value if len(value) <= 40 else value[:37] + "...")
    if isinstance(value, Mapping):
        return "a mapping"
    if isinstance(value, np.ndarray) and value.ndim:
        return f"a list of {len(value)}"
    if isinstance(value, (list, tuple)):
        return f"a list of {len(value)}"
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, int) and abs(value) >= 10**40:
        return "an integer of more than 40 digits"
    text = repr(value) if isinstance(value, (int, float, complex)) else type(value).__name__
    return text if len(text) <= 40 else text[:37] + "..."


def nearest(name: str, allowed: Iterable[str]) -> str:
    """Return `` (nearest: x)`` for the allowed name most like `name`, or an empty text."""
    close = difflib.get_close_matches(name, list(allowed), n=1, cutoff=0.5)
    return f" (nearest: {close[0]})" if close else ""


def scalar(value: object) -> object:
    """Return what an array without axes holds, anything else as it is."""
    return value[()] if isinstance(value, np.ndarray) and value.ndim == 0 else value


def is_number(value: object) -> bool:
    """Whether `value` is a real number; a bool is not."""
    return isinstance(value, numbers.Real) and not isinstance(value, (bool, np.bool_))


def whole(value: object) -> int | None:
    """Return a whole number as an int, also one that is written as a float; else None."""
    value = scalar(value)
    if isinstance(value, (bool, np.bool_)):
        return None
    if isinstance(value, (float, np.floating)):
        return int(value) if float(value).is_integer() else None
    try:
        return operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        return None


def real(
    unit: str = "",
    *,
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
) -> Check[float]:
    """Return a check for a finite number inside the bounds."""
    of, after = (f" in {unit}", f" {unit}") if unit else ("", "")

    def check(value: object, field: str) -> float:
        value = scalar(value)
        if not is_number(value):
            raise SceneError(f"{field} must be a number{of}, got {got(value)}")
        try:
            number = float(value)  # type: ignore[arg-type]
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise SceneError(f"{field} must be a finite number{of}, got {got(value)}")
        if above is not None and not number > above:
            raise SceneError(f"{field} must be above {above:g}{after}, got {got(value)}")
        if at_least is not None and not number >= at_least:
            raise SceneError(f"{field} must be at least {at_least:g}{after}, got {got(value)}")
        if at_most is not None and not number <= at_most:
            raise SceneError(f"{field} must be at most {at_most:g}{after}, got {got(value)}")
        return number

    return check


def integer(at_least: int, at_most: int) -> Check[int]:
    """Return a check for an integer inside the bounds."""

    def check(value: object, field: str) -> int:
        number = whole(value)
        if number is None:
            raise SceneError(f"{field} must be an integer, got {got(value)}")
        if number < at_least:
            raise SceneError(f"{field} must be at least {at_least}, got {got(value)}")
        if number > at_most:
            raise SceneError(f"{field} must be at most {at_most}, got {got(value)}")
        return number

    return check


def one_of(names: Sequence[str]) -> Check[str]:
    """Return a check for one of some names."""

    def check(value: object, field: str) -> str:
        if not isinstance(value, str) or value not in names:
            shown = repr(value) + nearest(value, names) if isinstance(value, str) else got(value)
            raise SceneError(f"{field} must be one of {', '.join(names)}, got {shown}")
        return value

    return check


def text(value: object, field: str) -> str:
    """Return a value if it is text."""
    if not isinstance(value, str):
        raise SceneError(f"{field} must be text, got {got(value)}")
    return value


def listed(value: object) -> list[Any] | None:
    """Return a list, tuple or array as a list of its items, anything else as None."""
    if isinstance(value, np.ndarray):
        return list(value) if value.ndim else None
    return list(value) if isinstance(value, (list, tuple)) else None


def reals(unit: str, *, at_least: float | None = None) -> Check[tuple[float, ...]]:
    """Return a check for a list of numbers, which becomes a tuple."""
    each = real(unit, at_least=at_least)

    def check(value: object, field: str) -> tuple[float, ...]:
        items = listed(value)
        if items is None:
            raise SceneError(f"{field} must be a list of numbers in {unit}, got {got(value)}")
        return tuple(each(item, f"{field}[{i}]") for i, item in enumerate(items))

    return check


def vector(unit: str, *components: str) -> Check[Any]:
    """Return a check for as many numbers as there are names of components, two or three."""
    each, count = real(unit), {2: "two", 3: "three"}[len(components)]
    of = f" in {unit}" if unit else ""

    def check(value: object, field: str) -> tuple[float, ...]:
        items = listed(value)
        if items is None or len(items) != len(components):
            raise SceneError(
                f"{field} must be {count} numbers [{', '.join(components)}]{of}, got {got(value)}"
            )
        return tuple(each(item, f"{field}[{i}]") for i, item in enumerate(items))

    return check


def pair(unit: str = "") -> Check[Pair]:
    """Return a check for two numbers (x, y)."""
    return vector(unit, "x", "y")


def one_or_many(check: Check[Any]) -> Check[Any]:
    """Return a check for what another checks, a list of numbers, or for a list of such lists."""

    def check_all(value: object, field: str) -> tuple[Any, ...]:
        items = listed(value)
        if items and all(listed(item) is not None for item in items):
            return tuple(check(item, f"{field}[{i}]") for i, item in enumerate(items))
        return tuple(check(value, field))

    return check_all


def one_value_per(what: str, value: Sequence[Any], count: int, field: str) -> None:
    """Refuse a list that does not have one entry for each joint or element."""
    if len(value) != count:
        raise SceneError(f"{field} must list one value per {what}, {count}, got {len(value)}")


def checked_option(check: Check[T], value: object, name: str) -> T:
    """Return an argument of an environment in its stored form, or raise OptionError."""
    try:
        return check(value, name)
    except SceneError as error:
        raise OptionError(error.problem) from None


def check_fields(mapping: object, field: str, allowed: Sequence[str]) -> dict[str, Any]:
    """Return a mapping as a dict if its keys are all among the allowed names."""
    where = field or "scene"
    if not isinstance(mapping, Mapping):
        raise SceneError(f"{where} must be a mapping of fields, got {got(mapping)}")
    for key in mapping:
        if key not in allowed:
            path = f"{field}.{key}" if field else f"{key}"
            known = f"; known fields: {', '.join(allowed)}" if allowed else "; it has no fields"
            raise SceneError(f"unknown field {path}{nearest(str(key), allowed)}{known}")
    return dict(mapping)
