"""The straight body: when it leaves its line, and how fast, compared with the paper's times."""

from __future__ import annotations

import itertools
from collections.abc import Callable

from studies.kirchhoff import RigidMass
from studies.paper.bars import STEPS, coarse_error, with_bar
from studies.paper.charts import STARTS
from studies.paper.measures import Fields, seconds, table
from studies.paper.onset import (
    PAPER_BODIES,
    PAPER_TIMES,
    STIFFNESS,
    implied_rate,
    onset_by_kirchhoff,
    rate_for_onset,
)
from studies.paper.verdicts import Data, MissingError, onset_of, onset_pairs, onset_time


def onset(data: Data) -> Fields | None:
    """Return what is said of the straight body's stability."""
    bodies = itertools.product((3, 9, 27), (4, 12), STARTS)
    found = [one for body in bodies if (one := onset_of(data, *body)) is not None]
    if not found:
        return None

    def paper(one: Data, form: str, of_ours: bool = False) -> str:
        """Return the paper's time, or how many of it ours is."""
        theirs = PAPER_TIMES.get((one["elements"], one["panels"], one["perturbation"]))
        if theirs is None or (of_ours and one["time"] is None):
            return ""
        return f"{one['time'] / theirs if of_ours else theirs:{form}}"

    columns: dict[str, Callable[[Data], object]] = {
        "N": lambda one: one["elements"],
        "panels": lambda one: one["panels"],
        "start across": lambda one: STARTS[one["perturbation"]],
        "paper (s)": lambda one: paper(one, "g"),
        "ours (s)": lambda one: _time_with_bar(data, one),
        "ours over paper": lambda one: paper(one, ".2f", of_ours=True),
        "Kirchhoff (s)": lambda one: seconds(one["expected"]),
        "rate fitted (1/s)": lambda one: _rate_with_bar(data, one),
        "Kirchhoff's rate (1/s)": lambda one: f"{one['kirchhoff']:.4f}",
        "times over EI (s)": lambda one: _over_stiffness(data, one),
    }

    def implied(body: tuple[int, int]) -> str:
        slow, quick = (PAPER_TIMES[*body, kind] for kind in ("epsilon", "small"))
        return f"{implied_rate(slow, quick):.2f} (N = {body[0]})"

    def to_the_letter(mass: RigidMass, body: tuple[int, int]) -> str:
        # (3.5 - x/0.01) 1e-5: at the centre, x = 1/2, and its slope.
        time = onset_by_kirchhoff(mass, 0.1, -4.65e-4, -1e-3, 1.0, 0.01)
        return f"{time:.2f} s (paper {PAPER_TIMES[*body, 'sloped']:g})"

    def alone(mass: RigidMass, body: tuple[int, int]) -> str:
        rate = rate_for_onset(mass, 0.1, 1e-4, 1.0, 0.01, PAPER_TIMES[*body, "small"])
        return f"{rate:.2f} (N = {body[0]})"

    return {
        "softest": STIFFNESS[0],
        "stiffest": STIFFNESS[-1],
        "slope_to_the_letter": _by_body(data, to_the_letter),
        "table": table(columns, found),
        **_findings(data),
        "pairs_need": ", ".join(implied(body) for body in PAPER_BODIES.values()),
        "alone_need": _by_body(data, alone),
    }


def _time_with_bar(data: Data, one: Data) -> str:
    try:
        time = onset_time(data, one["elements"], one["panels"], one["perturbation"])
    except MissingError:
        return seconds(one["time"])
    return "none" if time is None else with_bar(time.value, time.bar, digits=4)


def _rate_with_bar(data: Data, one: Data) -> str:
    if one["rate"] is None:
        return ""
    pairs = onset_pairs(data, one["elements"], one["panels"], one["perturbation"])
    rates = [(base["rate"], half["rate"]) for base, half in pairs]
    bars = [coarse_error(half - base, STEPS) for base, half in rates if None not in (base, half)]
    return with_bar(one["rate"], bars[0] if bars else None)


def _over_stiffness(data: Data, one: Data) -> str:
    same = ("elements", "panels", "perturbation", "step")
    times = [
        other["time"]
        for other in data["onset"]
        if other["time"] is not None and all(other[key] == one[key] for key in same)
    ]
    return "" if len(times) < 2 else f"{min(times):.2f} to {max(times):.2f}"


def _by_body(data: Data, found: Callable[[RigidMass, tuple[int, int]], str]) -> str | None:
    """Return what the rigid masses of x, xi and xii give with their elements and panels."""
    keys = ("along", "across", "inertia", "coupling")
    parts = [
        found(RigidMass(*(data["modes"][name][key] for key in keys)), body)
        for name, body in PAPER_BODIES.items()
        if "along" in data["modes"].get(name, {})
    ]
    return ", ".join(parts) or None


def _findings(data: Data) -> Fields:
    """Return how straight bodies stay, how well rates agree, and what frozen masses change."""
    fields: Fields = {}
    straight = [one for one in data["onset"] if one["perturbation"] == "none"]
    if straight:
        angle = max(one["largest_angle"] for one in straight)
        fields |= {
            "equilibrium": "an exact" if angle == 0.0 else "no exact",
            "straight": "bit for bit straight" if angle == 0.0 else f"straight to {angle:.1e} rad",
            "straight_bodies": len(straight),
            "straight_time": straight[0]["duration"],
        }
    off = [
        one["rate"] / one["kirchhoff"] - 1.0
        for one in data["onset"]
        if one["rate"] is not None and one["perturbation"] == "epsilon"
    ]
    if off:
        fields |= {"rates": len(off), "rate_low": min(off), "rate_high": max(off)}
    frozen = [one for one in data["onset"] if one["model"] == "frozen" and one["elements"] == 27]
    pairs = [(x, onset_of(data, 27, 12, "epsilon", stiffness=x["stiffness"])) for x in frozen]
    both = [(x["time"], y["time"]) for x, y in pairs if y is not None]
    apart = [abs(one - other) for one, other in both if None not in (one, other)]
    if apart:
        fields |= {"frozen_checks": len(apart), "frozen_apart": max(apart)}
    return fields
