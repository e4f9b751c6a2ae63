"""The page's ends: the verdicts; what can be reproduced, and the settings of the runs."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence

from studies.paper.measures import Fields, heading_turn, table
from studies.paper.runs import NUMERALS
from studies.paper.statements import Statement
from studies.paper.variants import VARIANTS
from studies.paper.verdicts import AGREE, DIFFER, NOT_MEASURED, UNDECIDED, Data, Finding
from studies.store import short_commit

#: Of `studies.paper.statements.find_all`.
Findings = Sequence[tuple[Statement, Finding]]
#: Readings whose sources are on one side of the centreline.
_ONE_SIDED = [name for name in VARIANTS if name not in ("frozen", "halved")]


def opening(data: Data, findings: Findings, command: str, written: str | None) -> Fields:
    """Return where the numbers come from, the verdicts in short, and statement by statement."""
    counts = Counter(finding.verdict for _, finding in findings)
    order = (AGREE, DIFFER, UNDECIDED, NOT_MEASURED)
    differ = [f"* {statement.says}" for statement, found in findings if found.verdict == DIFFER]
    columns: dict[str, Callable[[tuple[Statement, Finding]], object]] = {
        "the paper (in other words)": lambda one: f"{one[0].where}: {one[0].says}",
        "ours": lambda one: one[1].measured,
        "verdict": lambda one: AGREE if one[1].verdict == AGREE else f"**{one[1].verdict}**",
        "agrees if": lambda one: one[0].criterion,
        "why": lambda one: one[1].why,
    }
    return {
        "command": command,
        "commits": _commits(data),
        "dates": ", ".join(data["dates"]) or "no day",
        "written": short_commit(written),
        "units": data["units"],
        "missing": data["units"] - data["done"] or None,
        "statements": len(findings),
        "counts": ", ".join(f"{counts[verdict]} {verdict}" for verdict in order if counts[verdict]),
        "differ": "What differs:\n\n" + "\n".join(differ) if differ else None,
        "table": table(columns, findings),
    }


def discussion(data: Data, findings: Findings, written: str | None) -> Fields:
    """Return what of the paper can be reproduced, group by group, and the settings."""
    groups: dict[str, list[bool]] = {}
    for statement, finding in findings:
        groups.setdefault(statement.group, []).append(finding.verdict == AGREE)
    found = [data["variants"].get(name, {}).get(x) for name in VARIANTS for x in NUMERALS[9:]]
    rates = [one["kirchhoff"] for one in found if one and one["kirchhoff"] is not None]
    return {
        **{name: f"{sum(held)} of {len(held)}" for name, held in groups.items()},
        **_curves(data),
        "rate_low": min(rates, default=None),
        "rate_high": max(rates, default=None),
        "settings": _settings(data["settings"]),
        "done": data["done"],
        "commits": _commits(data),
        "written": short_commit(written),
    }


def _commits(data: Data) -> str:
    return ", ".join(short_commit(one) for one in data["commits"]) or "none"


def _curves(data: Data) -> Fields:
    """Return how far the closed outline turns, and the readings with sources on one side."""
    fields: Fields = {}
    ours = [(heading_turn(data["runs"][x]), x) for x in NUMERALS[:9] if x in data["runs"]]
    if ours:
        fields["outline_turn"], fields["outline_scene"] = max(ours, key=lambda one: abs(one[0]))
    runs = [
        (found["base"], scene, name)
        for name in _ONE_SIDED
        for scene, found in data["variants"].get(name, {}).items()
        if scene in NUMERALS[:9] and not found["base"]["end"]
    ]
    turns = [(heading_turn(run), scene) for run, scene, _ in runs if run["energy"]["trusted"]]
    if turns:
        turn, scene = max(turns, key=lambda one: abs(one[0]))
        fields |= {"centreline_turn": abs(turn), "centreline_scene": scene}
        fields["centreline_side"] = "right" if turn < 0.0 else "left"
    # How far iv would have to swim for a semicircle, where it curves most.
    fours = [(abs(run["curvature"]), run["way"], name) for run, x, name in runs if x == "iv"]
    curvature, way, name = max(fours, default=(0.0, 0.0, ""))
    if curvature != 0.0:
        fields |= {"iv_reading": VARIANTS[name], "iv_semicircle": math.pi / curvature}
        fields["iv_way"] = way
    return fields


def _settings(known: Data) -> str | None:
    """Return the table of what the runs were computed with."""

    def of(form: str, level: str = "") -> Callable[[str], str]:
        """Return how a run's settings are shown, where it is there."""
        return lambda name: form.format(**known[name + level]) if name + level in known else ""

    columns: dict[str, Callable[[str], object]] = {
        "scene": str,
        "elements": of("{elements}"),
        "step (ms)": of("{step:g}"),
        "panels an element": of("{panels}"),
        "at each end": of("{caps}"),
        "tolerance": of("{tolerance:g}"),
        "finer: step (ms)": of("{step:g}", "_half"),
        "finer: panels an element, at each end": of("{panels}, {caps}", "_fine"),
    }
    names = [name for name in NUMERALS if name in known]
    return table(columns, names) if names else None
