"""How the time of a step grows with the number of elements: the exponent of a power law."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np


def growth_of(cells: Iterable[Mapping[str, Any]], start: int = 1) -> list[dict[str, Any]]:
    """Fit how the time of a step grows, over beams of `start` elements and more.

    Returns for every ``fluid_model`` and ``panels_per_element`` with at least two beams both, and
    what `fit_growth` returns.
    """
    series: dict[tuple[str, int], dict[int, float]] = {}
    for cell in cells:
        if cell["elements"] >= start:
            points = series.setdefault((cell["fluid_model"], cell["panels_per_element"]), {})
            points[cell["elements"]] = cell["step"]["median"]
    return [
        {"fluid_model": model, "panels_per_element": panels, **fit_growth(points, points.values())}
        for (model, panels), points in series.items()
        if len(points) > 1
    ]


def fit_growth(elements: Iterable[int], microseconds: Iterable[float]) -> dict[str, Any]:
    """Fit time = c N^a by least squares of the logarithms, to at least two different N.

    Returns
    -------
    dict
        ``exponent`` a, ``microseconds_of_one`` c, the range ``elements_from`` and ``elements_to``,
        the number of ``points``, and ``largest_deviation`` of a point from the fit, as a share.
    """
    n = np.array(list(elements), dtype=np.float64)
    logarithm = np.log(np.array(list(microseconds), dtype=np.float64))
    exponent, offset = np.polyfit(np.log(n), logarithm, 1)
    deviation = np.expm1(np.abs(logarithm - offset - exponent * np.log(n)))
    return {
        "exponent": float(exponent),
        "microseconds_of_one": float(np.exp(offset)),
        "elements_from": int(n.min()),
        "elements_to": int(n.max()),
        "points": n.size,
        "largest_deviation": float(deviation.max()),
    }
