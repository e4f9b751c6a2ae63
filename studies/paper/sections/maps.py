"""The maps of net speed: how many points hold, the fastest ones, and where the direction turns."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

from studies.paper.bars import STEPS, fine_error, with_bar
from studies.paper.maps import AGREEMENT, LARGEST_BEND, SMALLEST, is_verified
from studies.paper.measures import Fields
from studies.paper.verdicts import Data


def maps(data: Data, words: Callable[[Fields], str]) -> Fields | None:
    """Return what is said of both maps, each in words that have fields of their own."""
    if not data["maps"]:
        return None
    drive, body = (data["maps"].get(name, []) for name in ("drive", "body"))
    return {
        "agreement": AGREEMENT,
        "smallest": SMALLEST,
        "largest_bend": LARGEST_BEND,
        "drive": words({**_points(drive), **_along_drive(drive)}) if drive else None,
        "body": words({**_points(body), **_along_body(body)}) if body else None,
    }


def _points(rows: Sequence[Data]) -> Fields:
    """Return counts of points, the fastest ones, and what panels change."""
    points = [
        (point["speed"], _place(row, column), point)
        for row in rows
        for column, point in zip(row["columns"], row["points"], strict=True)
    ]
    good = [one for one in points if is_verified(one[2])]
    checked = [point for *_, point in points if point["checked"]]
    agreed = [point for point in checked if is_verified(point)]
    apart = sorted(
        abs(point["panels"] / point["speed"] - 1.0)
        for point in agreed
        if abs(point["speed"]) > SMALLEST
    )

    def with_its_bar(point: Data) -> str:
        """Return a speed with the bar of its step and of its panels, or of any panels."""
        bar = fine_error(point["coarse"] - point["speed"], STEPS, 2.0)
        if point["checked"] and point["panels"] is not None:
            bar += abs(point["panels"] - point["speed"])
        elif apart:
            bar += apart[-1] * abs(point["speed"])
        return with_bar(point["speed"], bar, "+")

    fields: Fields = {
        "points": len(points),
        "good": len(good),
        "checked": len(checked),
        "agreed": len(agreed),
        "backwards": sum(speed < -SMALLEST for speed, *_ in good),
    }
    for name, choose in (("best", max), ("worst", min)) if good else ():
        _, fields[f"{name}_place"], point = choose(good, key=lambda one: one[0])
        fields[name] = with_its_bar(point)
    if apart:
        fields |= {"panels_median": apart[len(apart) // 2], "panels_most": apart[-1]}
    return fields


def _place(row: Data, column: float) -> str:
    if row["map"] == "drive":
        return f"{row['frequency']:g} Hz, κ = {column / math.pi:.2f}π"
    return f"EI = {row['stiffness']:.3g} N m², l = {column:g} m"


def _along_drive(rows: Sequence[Data]) -> Fields:
    """Return at which frequencies the verified speed changes sign, at the paper's wave number."""
    columns = rows[0]["columns"]
    near = min(range(len(columns)), key=lambda j: abs(columns[j] - 2.0 * math.pi))
    line = [(x["frequency"], x["points"][near]) for x in sorted(rows, key=lambda x: x["frequency"])]
    resonance = f"the first natural frequency is {rows[0]['resonances'][0][0]:.2f} Hz"
    return {"line": "at κ = 2π", "resonance": resonance, **_reversal(line, "Hz")}


def _along_body(rows: Sequence[Data]) -> Fields:
    """Return at which lengths the verified speed changes sign, at the paper's stiffness."""
    row = min(rows, key=lambda row: abs(math.log(row["stiffness"] / 5.0)))
    first = [modes[0] for modes in row["resonances"]]
    crossing = [j for j in range(len(first) - 1) if first[j] >= 1.0 > first[j + 1]]
    words = "does not cross 1 Hz"
    if crossing:
        a, b = row["columns"][crossing[0] :][:2]
        words = f"falls below the drive's 1 Hz between {a:g} and {b:g} m"
    line = list(zip(row["columns"], row["points"], strict=True))
    at = f"at EI = {row['stiffness']:.3g} N m²"
    return {"line": at, "resonance": f"the first natural frequency {words}", **_reversal(line, "m")}


def _reversal(line: Sequence[tuple[float, Data]], unit: str) -> Fields:
    """Return between which neighbours on a line the verified speed changes sign."""
    known = [
        (place, point["speed"] > 0.0)
        for place, point in line
        if is_verified(point) and abs(point["speed"]) > SMALLEST
    ]
    changes = [f"{a:g} and {b:g} {unit}" for (a, x), (b, y) in pairwise(known) if x != y]
    one_direction = "one direction" if known and not changes else None
    return {"changes": ", ".join(changes) or None, "one_direction": one_direction}
