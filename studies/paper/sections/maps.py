"""Net speed over drive and body, where it is verified."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from studies.paper.bars import STEPS, fine_error, with_bar
from studies.paper.maps import AGREEMENT, LARGEST_BEND, SMALLEST, is_verified
from studies.paper.sections.text import picture
from studies.paper.verdicts import Data

__all__ = ["section"]


def section(data: Data, pictures: Mapping[str, str]) -> str:
    """Return the section, nothing where its figures are missing."""
    if not data["maps"]:
        return ""
    lines = [
        "## A wider map than the paper's\n",
        "Net speed head first, with 1 ms of Kelvin-Voigt damping (scene `swimmer`; undamped, a "
        "displacement at resonance has no limit to converge to). Computed with the straight body's "
        "added mass from fine panels and the second-order scheme. Every point is played with two "
        "steps, and some with panels at every step; a point is **verified** where all of them "
        f"agree within {AGREEMENT:.0%} or {SMALLEST:g} BL/s, the energy adds up, and joints bend "
        f"by less than {LARGEST_BEND:g} rad unless panels confirm it. Others are grey. Speeds are "
        "those of half the step. Their bars count a third of the change that the step makes, as "
        "the scheme is of second order, and the change that panels make, or the largest one where "
        "a point was not played with them.\n",
    ]
    for name, words in (("drive", "frequency x wave number"), ("body", "stiffness x length")):
        rows = data["maps"].get(name, [])
        if rows:
            lines.append(f"* **{words}**: {_map_words(name, rows)}\n")
    lines.append(
        picture(
            pictures,
            "maps",
            "Net speed over drive and body. Orange: head first; blue: tail first; grey: not "
            "verified. Lines are natural frequencies of the straight body.",
        )
    )
    return "\n".join(lines)


def _map_words(name: str, rows: Sequence[Data]) -> str:
    points = [
        (row, column, point)
        for row in rows
        for column, point in zip(row["columns"], row["points"], strict=True)
    ]
    good = [one for one in points if is_verified(one[2])]
    checked = [one for one in points if one[2]["checked"]]
    agreed = [one for one in checked if is_verified(one[2])]
    text = (
        f"{len(points)} points, {len(good)} verified; {len(checked)} of them were played with "
        "panels, "
        f"{len(agreed)} of which are verified."
    )
    if not good:
        return text
    apart = sorted(
        abs(one[2]["panels"] / one[2]["speed"] - 1.0)
        for one in agreed
        if abs(one[2]["speed"]) > SMALLEST
    )
    best, worst = (choose(good, key=lambda one: one[2]["speed"]) for choose in (max, min))
    backwards = sum(one[2]["speed"] < -SMALLEST for one in good)
    text += (
        f" Fastest head first {_speed_text(best[2], apart)} BL/s ({_place(name, best)}), fastest "
        "tail first "
        f"{_speed_text(worst[2], apart)} ({_place(name, worst)}); {backwards} verified points swim "
        "tail first."
    )
    if apart:
        text += (
            f" With panels at every step the speed changes by {apart[len(apart) // 2]:.1%} in the "
            f"median and {apart[-1]:.0%} at most, where it was checked and verified."
        )
    return text + " " + _reversal(name, rows)


def _speed_text(point: Data, apart: Sequence[float]) -> str:
    """Return a speed with its bar: the step's, and what panels change here, or at most anywhere."""
    speed = point["speed"]
    bar = fine_error(point["coarse"] - speed, STEPS, 2.0)
    if point["checked"] and point["panels"] is not None:
        bar += abs(point["panels"] - speed)
    elif apart:
        bar += apart[-1] * abs(speed)
    return with_bar(speed, bar, "+")


def _place(name: str, one: tuple[Data, float, Data]) -> str:
    row, column, _ = one
    if name == "drive":
        return f"{row['frequency']:g} Hz, κ = {column / math.pi:.2f}π"
    return f"EI = {row['stiffness']:.3g} N m², l = {column:g} m"


def _reversal(name: str, rows: Sequence[Data]) -> str:
    """Say where the verified speed changes sign along the paper's line of the map."""
    line: list[tuple[float, float]] = []
    if name == "drive":
        for row in sorted(rows, key=lambda row: row["frequency"]):
            near = min(
                range(len(row["columns"])), key=lambda j: abs(row["columns"][j] - 2 * math.pi)
            )
            line.append((row["frequency"], _signed(row["points"][near])))
        unit, at, resonance = "Hz", "at κ = 2π", rows[0]["resonances"][0][0]
        side = f"the first natural frequency is {resonance:.2f} Hz"
    else:
        row = min(rows, key=lambda row: abs(math.log(row["stiffness"] / 5.0)))
        line = [(c, _signed(p)) for c, p in zip(row["columns"], row["points"], strict=True)]
        unit, at = "m", f"at EI = {row['stiffness']:.3g} N m²"
        crossing = [
            (row["columns"][j], row["columns"][j + 1])
            for j in range(len(row["columns"]) - 1)
            if row["resonances"][j][0] >= 1.0 > row["resonances"][j + 1][0]
        ]
        side = (
            "the first natural frequency falls below the drive's 1 Hz between "
            f"{crossing[0][0]:g} and "
            f"{crossing[0][1]:g} m"
            if crossing
            else "the first natural frequency does not cross 1 Hz"
        )
    known = [(x, s) for x, s in line if s != 0.0]
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


def _signed(point: Data) -> float:
    if not is_verified(point) or abs(point["speed"]) <= SMALLEST:
        return 0.0
    return math.copysign(1.0, point["speed"])
