"""The maps of net speed: how many points hold, the fastest ones, and where the direction turns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from studies.paper.bars import STEPS, fine_error, with_bar
from studies.paper.maps import AGREEMENT, LARGEST_BEND, SMALLEST, is_verified
from studies.paper.sections.text import blocks, picture
from studies.paper.verdicts import Data

__all__ = ["section"]


def section(data: Data, pictures: Mapping[str, str]) -> str:
    """Return the section, nothing where its figures are missing."""
    if not data["maps"]:
        return ""
    names = {"drive": "frequency x wave number", "body": "stiffness x length"}
    return blocks(
        "## A wider map than the paper's",
        "Net speed head first, with 1 ms of Kelvin-Voigt damping (scene `swimmer`; undamped, a "
        "displacement at resonance has no limit to converge to). Computed with the straight body's "
        "added mass from fine panels and the second-order scheme. Every point is played with two "
        "steps, and some with panels at every step; a point is **verified** where all of them "
        f"agree within {AGREEMENT:.0%} or {SMALLEST:g} BL/s, the energy adds up, and joints bend "
        f"by less than {LARGEST_BEND:g} rad unless panels confirm it. Others are grey. Speeds are "
        "those of half the step. Their bars count a third of the change that the step makes, as "
        "the scheme is of second order, and the change that panels make, or the largest one where "
        "a point was not played with them.",
        *(
            f"* **{words}**: {_map_words(name, data['maps'][name])}"
            for name, words in names.items()
            if data["maps"].get(name)
        ),
        picture(
            pictures,
            "maps",
            "Net speed over drive and body. Orange: head first; blue: tail first; grey: not "
            "verified. Lines are natural frequencies of the straight body.",
        ),
    )


def _map_words(name: str, rows: Sequence[Data]) -> str:
    points = [
        (row, column, point)
        for row in rows
        for column, point in zip(row["columns"], row["points"], strict=True)
    ]
    good = [one for one in points if is_verified(one[2])]
    checked = [point for *_, point in points if point["checked"]]
    agreed = [point for point in checked if is_verified(point)]
    text = (
        f"{len(points)} points, {len(good)} verified; {len(checked)} of them were played with "
        f"panels, {len(agreed)} of which are verified."
    )
    if not good:
        return text
    apart = sorted(
        abs(point["panels"] / point["speed"] - 1.0)
        for point in agreed
        if abs(point["speed"]) > SMALLEST
    )

    def shown(one: tuple[Data, float, Data]) -> tuple[str, str]:
        """Return a point's speed, with the bar of its step and of its panels, and its place."""
        row, column, point = one
        bar = fine_error(point["coarse"] - point["speed"], STEPS, 2.0)
        if point["checked"] and point["panels"] is not None:
            bar += abs(point["panels"] - point["speed"])
        elif apart:
            bar += apart[-1] * abs(point["speed"])
        place = (
            f"EI = {row['stiffness']:.3g} N m², l = {column:g} m"
            if name == "body"
            else (f"{row['frequency']:g} Hz, κ = {column / math.pi:.2f}π")
        )
        return with_bar(point["speed"], bar, "+"), place

    (best, there), (worst, other) = (
        shown(choose(good, key=lambda one: one[2]["speed"])) for choose in (max, min)
    )
    backwards = sum(point["speed"] < -SMALLEST for *_, point in good)
    text += (
        f" Fastest head first {best} BL/s ({there}), fastest tail first {worst} ({other}); "
        f"{backwards} verified points swim tail first."
    )
    if apart:
        text += (
            f" With panels at every step the speed changes by {apart[len(apart) // 2]:.1%} in the "
            f"median and {apart[-1]:.0%} at most, where it was checked and verified."
        )
    reversal = _reversal_by_drive(rows) if name == "drive" else _reversal_by_body(rows)
    return f"{text} {reversal}"


def _reversal_by_drive(rows: Sequence[Data]) -> str:
    """Say at which frequencies the verified speed changes sign, at the paper's wave number."""
    line = []
    for row in sorted(rows, key=lambda row: row["frequency"]):
        near = min(
            zip(row["columns"], row["points"], strict=True),
            key=lambda pair: abs(pair[0] - 2.0 * math.pi),
        )
        line.append((row["frequency"], near[1]))
    side = f"the first natural frequency is {rows[0]['resonances'][0][0]:.2f} Hz"
    return _reversal(line, "Hz", "at κ = 2π", side)


def _reversal_by_body(rows: Sequence[Data]) -> str:
    """Say at which lengths the verified speed changes sign, at the paper's stiffness."""
    row = min(rows, key=lambda row: abs(math.log(row["stiffness"] / 5.0)))
    first = [modes[0] for modes in row["resonances"]]
    crossing = [j for j in range(len(first) - 1) if first[j] >= 1.0 > first[j + 1]]
    side = "the first natural frequency does not cross 1 Hz"
    if crossing:
        a, b = row["columns"][crossing[0] :][:2]
        side = f"the first natural frequency falls below the drive's 1 Hz between {a:g} and {b:g} m"
    line = list(zip(row["columns"], row["points"], strict=True))
    return _reversal(line, "m", f"at EI = {row['stiffness']:.3g} N m²", side)


def _reversal(line: Sequence[tuple[float, Data]], unit: str, at: str, side: str) -> str:
    """Say between which neighbours on a line the verified speed changes sign."""
    known = [
        (place, point["speed"] > 0.0)
        for place, point in line
        if is_verified(point) and abs(point["speed"]) > SMALLEST
    ]
    changes = [
        f"{a[0]:g} and {b[0]:g} {unit}"
        for a, b in zip(known, known[1:], strict=False)
        if a[1] != b[1]
    ]
    if not changes:
        return f"Along the line {at} verified points keep one direction; {side}."
    return (
        f"Along the line {at} the direction reverses between {', '.join(changes)} "
        f"(verified neighbours); {side}."
    )
