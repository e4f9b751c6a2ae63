"""Figures of one run as statements, page and pictures give them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

#: The figures of `studies.paper.runs.run_figures`.
Run = Mapping[str, Any]


def net_speed(run: Run) -> float:
    """Return the net speed in body lengths a second."""
    return float(run["speed"]) / float(run["length"])


def way_ahead(run: Run) -> float:
    """Return the displacement head first, to the left (body lengths)."""
    return -float(run["displacement"][0]) / float(run["length"])


def heading_turn(run: Run) -> float:
    """Return the turn of the heading (degrees), to the swimmer's left where it is positive."""
    return math.degrees(run["turn"])


def turn_per_way(run: Run) -> float:
    """Return the turn per way (degrees a metre), to the swimmer's left where it is positive."""
    return math.degrees(run["curvature"])


def largest_bend(run: Run) -> float:
    """Return the largest joint angle of the run (rad)."""
    return float(max(run["bends"]))


def mean_power(run: Run) -> float | None:
    """Return the mean positive power on the resolved motion (W), None where it was not measured."""
    internal = run.get("internal")
    return None if internal is None else float(internal["power"])


def transport_cost(run: Run) -> float | None:
    """Return what the torques spend on the resolved motion per way (J/m)."""
    power, speed = mean_power(run), float(run["speed"])
    return None if power is None or speed == 0.0 else power / speed
