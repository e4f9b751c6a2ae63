"""The page's end: what of the paper can be reproduced, from what, and the settings of the runs."""

from __future__ import annotations

import math
from collections.abc import Callable

from studies.paper.measures import heading_turn
from studies.paper.runs import NUMERALS
from studies.paper.sections.opening import Findings
from studies.paper.sections.text import blocks, commits, short_commit, table
from studies.paper.variants import VARIANTS
from studies.paper.verdicts import AGREE, Data

__all__ = ["discussion", "settings"]

#: Readings whose sources are on one side of the centreline.
_ONE_SIDED = [name for name in VARIANTS if name not in ("frozen", "halved")]


def discussion(data: Data, findings: Findings) -> str:
    """Return what of the paper can be reproduced, group by group, counted by the verdicts."""

    def held(group: str) -> str:
        found = [finding.verdict == AGREE for one, finding in findings if one.group == group]
        return f"{sum(found)} of {len(found)} statements hold."

    return blocks(
        "## What can be reproduced, and from what",
        f"**Directions, orders of speeds and bends** of Figs. 4 to 7: {held('orders')} Ours are "
        "from the closed outline with the paper's parameters; counts for the other readings of the "
        "print stand above. Distances are not stated in the text and so not compared.",
        f"**Straight and curved paths**: {held('paths')} {_curve_words(data)} With a "
        "mirror-symmetric fluid a wave turns the body only if the motion breaks the symmetry, "
        "which none of ours does, so curves that a model shows in these scenes measure how "
        "lopsided it is.",
        f"**Times of onset**: {held('times')} {_rate_words(data)} No reading tried gives the "
        "paper's times.",
        f"**What the onset does not depend on**, and the equilibrium itself: {held('onset')} An "
        "unstable equilibrium that stiffness and panels hardly change is reproduced.",
        "**The method and the principle**, from constants of motion to swimming by torques alone: "
        f"{held('method')}",
        "No parameter was fitted to the paper's figures: its Table 1, the half thickness that its "
        "line density and rotary inertia imply, and the corrections of the print in "
        "[physics.md](physics.md) are all that enter. What is not covered: the paper's figures are "
        "known as described in its text, so shapes are not overlaid on it.",
    )


def _bases(data: Data, variant: str) -> dict[str, Data]:
    """Return the runs of the driven scenes with a reading, those that came to their end."""
    found = data["variants"].get(variant, {})
    runs = {scene: found[scene]["base"] for scene in NUMERALS[:9] if scene in found}
    return {scene: run for scene, run in runs.items() if not run["end"]}


def _curve_words(data: Data) -> str:
    text = ""
    ours = {
        scene: heading_turn(data["runs"][scene]) for scene in NUMERALS[:9] if scene in data["runs"]
    }
    if ours:
        most = max(ours, key=lambda scene: abs(ours[scene]))
        text = f"The closed outline turns by {ours[most]:+.2f}° at most (scene {most})."
    turns = [
        (heading_turn(run), scene)
        for name in _ONE_SIDED
        for scene, run in _bases(data, name).items()
        if run["energy"]["trusted"]
    ]
    if turns:
        turn, scene = max(turns, key=lambda one: abs(one[0]))
        side = "right" if turn < 0.0 else "left"
        text += (
            f" Sources on one side of the centreline do curve, most of all to the {side} by "
            f"{abs(turn):.2f}° (scene {scene}): some lopsidedness, and far from the semicircle and "
            "the quadrant of Fig. 5."
        )
    # How far iv would have to swim for a semicircle, where it curves most.
    known = [(_bases(data, name).get("iv"), name) for name in _ONE_SIDED]
    fours = [(run, name) for run, name in known if run is not None and run["curvature"] != 0.0]
    if fours:
        run, most = max(fours, key=lambda one: abs(one[0]["curvature"]))
        text += (
            f" At the largest curvature of iv among them ({VARIANTS[most]}) a semicircle would "
            f"take {math.pi / abs(run['curvature']):.0f} m of path, and iv covers "
            f"{run['way']:.2f} m."
        )
    return text


def _rate_words(data: Data) -> str:
    found = [data["variants"].get(name, {}).get(x) for name in VARIANTS for x in NUMERALS[9:]]
    rates = [one["kirchhoff"] for one in found if one and one["kirchhoff"] is not None]
    if not rates:
        return ""
    return (
        f"Over all readings the straight body's rate lies between {min(rates):.3f} and "
        f"{max(rates):.3f} 1/s."
    )


def settings(data: Data, written: str | None) -> str:
    """Return what the runs were computed with."""
    known = data["settings"]

    def of(key: str, level: str = "", form: str = "", factor: float = 1) -> Callable[[str], str]:
        return lambda name: (
            f"{factor * known[name + level][key]:{form}}" if name + level in known else ""
        )

    panels, caps = of("panels", "_fine"), of("caps", "_fine")
    columns: dict[str, Callable[[str], object]] = {
        "scene": str,
        "elements": of("elements"),
        "step (ms)": of("time_step", form="g", factor=1e3),
        "panels an element": of("panels"),
        "at each end": of("caps"),
        "tolerance": of("tolerance", form="g"),
        "finer: step (ms)": of("time_step", "_half", "g", 1e3),
        "finer: panels an element, at each end": lambda name: (
            f"{panels(name)}, {caps(name)}" if f"{name}_fine" in known else ""
        ),
    }
    names = [name for name in NUMERALS if name in known]
    return blocks(
        "## Settings",
        "Table 1's scenes as they ship (`configs/scenes/paper_*.yaml`). Times of onset have "
        "the bar of the step alone; at N = 27 with 12 panels the bar for the start of 2.2e-16 "
        "m/s is from runs with the straight body's added mass.",
        table(columns, names) if names else "",
        f"{data['done']} records of figures were there, computed at commit {commits(data)}; this "
        f"page was written by commit {short_commit(written)}. `make paper` makes them and this "
        "page; no number of ours was written by hand.",
    )
