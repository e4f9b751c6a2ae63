"""The method and the principle: constants of motion, order, swimming by torques alone."""

from __future__ import annotations

import math

from studies.paper.measures import heading_turn, way_ahead
from studies.paper.runs import NUMERALS
from studies.paper.statements.judges import Judge
from studies.paper.statements.limits import ENERGY, TREND
from studies.paper.verdicts import (
    DIFFER,
    UNDECIDED,
    Data,
    Finding,
    MissingError,
    Value,
    run_of,
    value_of,
    yes,
)


def _order(data: Data) -> Finding:
    orders = data["modes"].get("i", {}).get("orders")
    if orders is None:
        raise MissingError("no frequencies over N")
    errors = ", ".join(f"{one:.1e}" for one in orders["errors"])
    counts = ", ".join(str(n) for n in orders["elements"])
    # How far the order itself has settled.
    order = Value(orders["order"], abs(orders["order"] - orders["before"]))
    return Finding(
        f"first frequency of the beam alone at N = {counts}: off by {errors}; order {order.text()}",
        order.within(2.0, 0.1),
    )


def _momentum(data: Data) -> Finding:
    runs = [run_of(data, name) for name in NUMERALS]
    drift = max(run["momentum"]["drift"] for run in runs)
    share = max(run["momentum"]["share"] for run in runs)
    return Finding(
        f"largest drift of all twelve runs {drift:.1e}; {share:.1e} of its bound",
        yes(drift <= 1e-9 and share <= 1.0),
    )


def _energy(data: Data) -> Finding:
    runs = {name: run_of(data, name, 10.0)["energy"] for name in NUMERALS}
    finer = max(run_of(data, f"{name}_half", 10.0)["energy"]["unexplained"] for name in NUMERALS)
    unexplained, largest = max((one["unexplained"], name) for name, one in runs.items())
    trend, moved = max((abs(one["last"] - one["first"]), name) for name, one in runs.items())
    return Finding(
        f"off by at most {unexplained:.1e} of the largest energy ({largest}), {finer:.1e} with "
        f"half the step; the mean of the last quarter is {trend:.1e} from that of the first "
        f"({moved})",
        yes(max(unexplained, finer) <= ENERGY and trend <= TREND),
        "In driven runs the work of the torques is counted off; what is left stays bounded."
        + (
            " It does not shrink with the step: modes ring that neither step resolves."
            if finer >= unexplained
            else ""
        ),
    )


def _steps(data: Data) -> Finding:
    modes = data["modes"].get("i")
    if modes is None:
        raise MissingError("no natural frequencies of scene i")
    phase = 2.0 * math.pi * modes["highest"] * 0.01
    cut = sum(run_of(data, name)["halved"] for name in NUMERALS)
    return Finding(
        f"the highest mode of i, {modes['highest']:.0f} Hz, turns by {phase:.0f} rad in a step of "
        f"10 ms; all twelve runs came to their end with {cut} steps cut",
        UNDECIDED if phase > 2.0 and cut == 0 else DIFFER,
    )


def _locomotion(data: Data) -> Finding:
    ahead = value_of(data, "i", way_ahead)
    drift = run_of(data, "i")["momentum"]["drift"]
    return Finding(
        f"i: {ahead.text()} BL from rest, total momentum within {drift:.1e} of zero",
        ahead.size().above(0.0),
    )


def _alone(data: Data) -> Finding:
    run = run_of(data, "i_alone")
    moved = math.hypot(*run["displacement"])
    return Finding(
        f"i without fluid: moves by {moved:.1e} m, turns by {heading_turn(run):.1e}°",
        yes(moved <= 1e-9),
    )


JUDGES: dict[str, Judge] = {
    "order": _order,
    "momentum": _momentum,
    "energy": _energy,
    "steps": _steps,
    "locomotion": _locomotion,
    "alone": _alone,
}
