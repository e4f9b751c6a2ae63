"""Checks of single values: each returns the value in its stored form or names the field.

A bool is not a number, a number must be finite, and an integer field takes no float. Numpy
scalars and arrays pass as the numbers and lists they hold.
"""

from __future__ import annotations

import difflib
import math
import numbers
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from swim_env.errors import SceneError

Pair = tuple[float, float]


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


def is_number(value: object) -> bool:
    """Whether `value` is a real number; a bool is not."""
    return isinstance(value, numbers.Real) and not isinstance(value, (bool, np.bool_))


def _unit(unit: str) -> str:
    return f" in {unit}" if unit else ""


def check_real(
    value: object,
    field: str,
    unit: str = "",
    *,
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
) -> float:
    """Return `value` as a float if it is a finite number inside the bounds."""
    if not is_number(value):
        raise SceneError(f"{field} must be a number{_unit(unit)}, got {got(value)}")
    try:
        number = float(value)  # type: ignore[arg-type]
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise SceneError(f"{field} must be a finite number{_unit(unit)}, got {got(value)}")
    unit_after = f" {unit}" if unit else ""
    if above is not None and not number > above:
        raise SceneError(f"{field} must be above {above:g}{unit_after}, got {got(value)}")
    if at_least is not None and not number >= at_least:
        raise SceneError(f"{field} must be at least {at_least:g}{unit_after}, got {got(value)}")
    if at_most is not None and not number <= at_most:
        raise SceneError(f"{field} must be at most {at_most:g}{unit_after}, got {got(value)}")
    return number


def check_integer(value: object, field: str, at_least: int, at_most: int) -> int:
    """Return `value` as an int if it is an integer within the bounds."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, numbers.Integral):
        raise SceneError(f"{field} must be an integer, got {got(value)}")
    number = int(value)
    if number < at_least:
        raise SceneError(f"{field} must be at least {at_least}, got {got(value)}")
    if number > at_most:
        raise SceneError(f"{field} must be at most {at_most}, got {got(value)}")
    return number


def check_name(value: object, field: str, allowed: Sequence[str]) -> str:
    """Return `value` if it is one of the allowed names."""
    if not isinstance(value, str):
        raise SceneError(f"{field} must be one of {', '.join(allowed)}, got {got(value)}")
    if value not in allowed:
        raise SceneError(
            f"{field} must be one of {', '.join(allowed)}, got {value!r}{nearest(value, allowed)}"
        )
    return value


def check_text(value: object, field: str) -> str:
    """Return `value` if it is text."""
    if not isinstance(value, str):
        raise SceneError(f"{field} must be text, got {got(value)}")
    return value


def listed(value: object) -> list[Any] | None:
    """Return a list, tuple or array as a list of its items, anything else as None."""
    if isinstance(value, np.ndarray):
        return list(value) if value.ndim else None
    return list(value) if isinstance(value, (list, tuple)) else None


def check_reals(
    value: object, field: str, unit: str, *, at_least: float | None = None
) -> tuple[float, ...]:
    """Return a list of numbers as a tuple of floats."""
    items = listed(value)
    if items is None:
        raise SceneError(f"{field} must be a list of numbers{_unit(unit)}, got {got(value)}")
    return tuple(
        check_real(item, f"{field}[{i}]", unit, at_least=at_least) for i, item in enumerate(items)
    )


def check_pair(value: object, field: str, unit: str = "") -> Pair:
    """Return a list of two numbers as a tuple."""
    items = listed(value)
    if items is None or len(items) != 2:
        raise SceneError(f"{field} must be two numbers [x, y]{_unit(unit)}, got {got(value)}")
    x, y = check_reals(items, field, unit)
    return x, y


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
