"""The method and the principle: constants of motion, order, swimming by torques alone."""

from __future__ import annotations

import math

from studies.paper.judges.criteria import ENERGY, TREND
from studies.paper.measures import heading_turn, way_ahead
from studies.paper.runs import NUMERALS
from studies.paper.verdicts import (
    DIFFER,
    UNDECIDED,
    Data,
    Finding,
    MissingError,
    Value,
    above,
    run_of,
    value_of,
    within,
    yes,
)

__all__ = ["alone", "energy", "large_steps", "momentum", "net_locomotion", "spatial_order"]


def momentum(data: Data) -> Finding:
    """Judge whether the momentum maps are kept to the paper's tolerance, in all twelve runs."""
    runs = [run_of(data, name) for name in NUMERALS]
    drift = max(run["momentum"]["drift"] for run in runs)
    share = max(run["momentum"]["share"] for run in runs)
    return Finding(
        f"largest drift of all twelve runs {drift:.1e}; {share:.1e} of its bound",
        yes(drift <= 1e-9 and share <= 1.0),
        "What a step leaves of its residual is carried into the next, so momentum is kept to "
        "round-off whatever the tolerance of Newton's method.",
    )


def energy(data: Data) -> Finding:
    """Judge whether the energy's error stays small and goes nowhere."""
    runs = {name: run_of(data, name, 10.0) for name in NUMERALS}
    halves = [run_of(data, f"{name}_half", 10.0) for name in NUMERALS]
    largest = max(runs, key=lambda name: runs[name]["energy"]["unexplained"])
    trends = {
        name: abs(run["energy"]["last"] - run["energy"]["first"]) for name, run in runs.items()
    }
    trend = max(trends, key=lambda name: trends[name])
    unexplained = runs[largest]["energy"]["unexplained"]
    finer = max(run["energy"]["unexplained"] for run in halves)
    return Finding(
        f"off by at most {unexplained:.1e} of the largest energy ({largest}), {finer:.1e} with "
        f"half the step; the mean of the last quarter is {trends[trend]:.1e} from that of the "
        f"first ({trend})",
        yes(max(unexplained, finer) <= ENERGY and trends[trend] <= TREND),
        "In driven runs the work of the torques is counted off; what is left stays bounded."
        + (
            " It does not shrink with the step: modes ring that neither step resolves."
            if finer >= unexplained
            else ""
        ),
    )


def large_steps(data: Data) -> Finding:
    """Judge whether our steps are large for the beam's highest mode."""
    modes = data["modes"].get("i")
    if modes is None:
        raise MissingError("no natural frequencies of scene i")
    runs = [run_of(data, name) for name in NUMERALS]
    phase = 2.0 * math.pi * modes["highest"] * 0.01
    cut = sum(run["halved"] for run in runs)
    return Finding(
        f"the highest mode of i, {modes['highest']:.0f} Hz, turns by {phase:.0f} rad in a step of "
        f"10 ms; all twelve runs came to their end with {cut} steps cut",
        UNDECIDED if phase > 2.0 and cut == 0 else DIFFER,
        "That our steps are large is measured, the comparison is not: a potential taken at the "
        "last node alone is a leapfrog scheme, unstable above 2 rad, and was not run.",
    )


def spatial_order(data: Data) -> Finding:
    """Judge the order at which the beam's first bending frequency converges."""
    orders = data["modes"].get("i", {}).get("orders")
    if orders is None:
        raise MissingError("no frequencies over N")
    errors = ", ".join(f"{one:.1e}" for one in orders["errors"])
    counts = ", ".join(str(n) for n in orders["elements"])
    # How far the order itself has settled.
    order = Value(orders["order"], abs(orders["order"] - orders["before"]))
    return Finding(
        f"first frequency of the beam alone at N = {counts}: off by {errors}; order {order.text()}",
        within(order, 2.0, 0.1),
    )


def net_locomotion(data: Data) -> Finding:
    """Judge whether i gets anywhere from rest."""
    ahead = value_of(data, "i", way_ahead, 10.0)
    drift = run_of(data, "i")["momentum"]["drift"]
    return Finding(
        f"i: {ahead.text()} BL from rest, total momentum within {drift:.1e} of zero",
        above(Value(abs(ahead.value), ahead.bar), 0.0),
    )


def alone(data: Data) -> Finding:
    """Judge whether i stays where it is without a fluid."""
    run = run_of(data, "i_alone")
    moved = math.hypot(*run["displacement"])
    return Finding(
        f"i without fluid: moves by {moved:.1e} m, turns by {heading_turn(run):.1e}°",
        yes(moved <= 1e-9),
        "Torques are internal: without a fluid the centre of mass stays.",
    )
