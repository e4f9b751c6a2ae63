"""The page's end: what of the paper can be reproduced, from what, and the settings of the runs."""

from __future__ import annotations

import math
from collections.abc import Sequence

from studies.paper.measures import heading_turn
from studies.paper.runs import NUMERALS
from studies.paper.sections.text import commits, short_commit, table
from studies.paper.statements import Statement
from studies.paper.variants import VARIANTS
from studies.paper.verdicts import AGREE, Data, Finding

__all__ = ["GROUPS", "discussion", "settings"]

#: Which statements each paragraph of the end speaks of; every one is in one of them.
GROUPS: dict[str, tuple[str, ...]] = {
    "orders": (
        "i-iii left",
        "i-iii alike",
        "nontrivial",
        "i fastest",
        "ii slower",
        "iii slower",
        "v unlike iii",
        "v faster",
        "vi-vii left",
        "vi bends",
        "vi slow",
        "vii faster",
        "vii bends",
        "head matters",
        "viii as i",
        "viii slows",
        "ix slow",
    ),
    "paths": (
        "i-iii curve",
        "iv less stable",
        "iv semicircle",
        "v quadrant",
        "vi-vii curve",
        "viii tighter",
        "ix straight",
    ),
    "times": (
        "times 3 12",
        "times 9 4",
        "times 9 12",
        "times 27 4",
        "x turns",
        "coarse unstable",
        "delayed",
    ),
    "onset": ("equilibrium", "12 panels", "27 panels", "stiffness", "xi as xii"),
    "method": ("order", "momentum", "energy", "steps", "locomotion", "alone"),
}


def discussion(data: Data, findings: Sequence[tuple[Statement, Finding]]) -> str:
    """Return what of the paper can be reproduced, group by group, counted by the verdicts."""
    by_key = {statement.key: finding for statement, finding in findings}
    lines = ["## What can be reproduced, and from what"]

    def held(group: str) -> str:
        found = [by_key[key] for key in GROUPS[group]]
        count = sum(finding.verdict == AGREE for finding in found)
        return f"{count} of {len(found)} statements hold."

    lines.append(
        f"**Directions, orders of speeds and bends** of Figs. 4 to 7: {held('orders')} Ours are "
        "from the closed outline with the paper's parameters; counts for the other readings of the "
        "print stand above. Distances are not stated in the text and so not compared."
    )
    lines.append(
        f"**Straight and curved paths**: {held('paths')} {_curve_words(data)} With a "
        "mirror-symmetric fluid a wave turns the body only if the motion breaks the symmetry, "
        "which none of ours does, so curves that a model shows in these scenes measure how "
        "lopsided it is."
    )
    lines.append(
        f"**Times of onset**: {held('times')} {_rate_words(data)} No reading tried gives the "
        "paper's times."
    )
    lines.append(
        f"**What the onset does not depend on**, and the equilibrium itself: {held('onset')} An "
        "unstable equilibrium that stiffness and panels hardly change is reproduced."
    )
    lines.append(
        f"**The method and the principle**, from constants of motion to swimming by torques alone: "
        f"{held('method')}"
    )
    lines.append(
        "No parameter was fitted to the paper's figures: its Table 1, the half thickness that its "
        "line density and rotary inertia imply, and the corrections of the print in "
        "[physics.md](physics.md) are all that enter. What is not covered: the paper's figures are "
        "known as described in its text, so shapes are not overlaid on it."
    )
    return "\n\n".join(lines) + "\n"


def _curve_words(data: Data) -> str:
    largest: dict[str, tuple[float, str]] = {}
    for name in VARIANTS:
        for scene in NUMERALS[:9]:
            run = data["variants"].get(name, {}).get(scene, {}).get("base")
            if run is None or run["end"] or not run["energy"]["trusted"]:
                continue
            side = "outline" if name in ("frozen", "halved") else "centreline"
            turn = heading_turn(run)
            if abs(turn) > abs(largest.get(side, (0.0, ""))[0]):
                largest[side] = (turn, scene)
    ours = {
        scene: heading_turn(data["runs"][scene]) for scene in NUMERALS[:9] if scene in data["runs"]
    }
    text = ""
    if ours:
        most = max(ours, key=lambda scene: abs(ours[scene]))
        text = f"The closed outline turns by {ours[most]:+.2f}° at most (scene {most})."
    if "centreline" in largest:
        turn, scene = largest["centreline"]
        side = "right" if turn < 0.0 else "left"
        text += (
            f" Sources on one side of the centreline do curve, most of all to the {side} by "
            f"{abs(turn):.2f}° (scene {scene}): some lopsidedness, and far from the semicircle and "
            "the quadrant of Fig. 5."
        )
    return text + _semicircle_words(data)


def _semicircle_words(data: Data) -> str:
    """Say how far iv would have to swim for a semicircle, where it curves most."""
    runs = {
        name: data["variants"].get(name, {}).get("iv", {}).get("base")
        for name in VARIANTS
        if name not in ("frozen", "halved")
    }
    known = {
        name: run
        for name, run in runs.items()
        if run is not None and not run["end"] and run["curvature"] != 0.0
    }
    if not known:
        return ""
    most = max(known, key=lambda name: abs(known[name]["curvature"]))
    run = known[most]
    return (
        f" At the largest curvature of iv among them ({VARIANTS[most]}) a semicircle would take "
        f"{math.pi / abs(run['curvature']):.0f} m of path, and iv covers {run['way']:.2f} m."
    )


def _rate_words(data: Data) -> str:
    rates = [
        found[scene]["kirchhoff"]
        for name, found in data["variants"].items()
        if name in VARIANTS
        for scene in ("x", "xi", "xii")
        if scene in found and found[scene]["kirchhoff"] is not None
    ]
    if not rates:
        return ""
    return (
        f"Over all readings the straight body's rate lies between {min(rates):.3f} and "
        f"{max(rates):.3f} 1/s."
    )


def settings(data: Data, written: str | None) -> str:
    """Return what the runs were computed with."""
    rows = []
    for name in NUMERALS:
        base, half, fine = (data["settings"].get(f"{name}{x}") for x in ("", "_half", "_fine"))
        if base is None:
            continue
        rows.append(
            (
                name,
                base["elements"],
                f"{1e3 * base['time_step']:g}",
                base["panels"],
                base["caps"],
                f"{base['tolerance']:g}",
                "" if half is None else f"{1e3 * half['time_step']:g}",
                "" if fine is None else f"{fine['panels']}, {fine['caps']}",
            )
        )
    heads = (
        "scene",
        "elements",
        "step (ms)",
        "panels an element",
        "at each end",
        "tolerance",
        "finer: step (ms)",
        "finer: panels an element, at each end",
    )
    text = (
        "## Settings\n\n"
        "Table 1's scenes as they ship (`configs/scenes/paper_*.yaml`). Times of onset have "
        "the bar of the step alone; at N = 27 with 12 panels the bar for the start of 2.2e-16 "
        "m/s is from runs with the straight body's added mass.\n\n"
    )
    if rows:
        text += table(heads, rows) + "\n"
    page = short_commit(written) if written else "unknown"
    return text + (
        f"{data['done']} files of figures were there, computed at commit {commits(data)}; this "
        f"page was written by commit {page}. `make paper` makes them and this page; no number of "
        "ours was written by hand.\n"
    )
