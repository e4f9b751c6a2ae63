"""Other readings of the print: the driven scenes and the instability under each of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from studies.paper.bars import STEPS, coarse_error, with_bar
from studies.paper.measures import heading_turn, turn_per_way, way_ahead
from studies.paper.onset import PAPER_TIMES
from studies.paper.runs import NUMERALS
from studies.paper.sections.text import picture, run_with_bar, seconds, table
from studies.paper.statements import STATEMENTS, find_all
from studies.paper.variants import VARIANTS
from studies.paper.verdicts import AGREE, Data, Finding

__all__ = ["section"]

#: Statements about driven scenes, which any reading can be held against.
_OF_DRIVEN = (
    "i-iii left",
    "i-iii curve",
    "i-iii alike",
    "nontrivial",
    "i fastest",
    "ii slower",
    "iii slower",
    "iv less stable",
    "iv semicircle",
    "v quadrant",
    "v unlike iii",
    "v faster",
    "vi-vii left",
    "vi-vii curve",
    "vi bends",
    "vi slow",
    "vii faster",
    "vii bends",
    "head matters",
    "viii slows",
    "viii tighter",
    "ix slow",
    "ix straight",
)


def section(data: Data, pictures: Mapping[str, str]) -> str:
    """Return the section, nothing where its figures are missing."""
    known = [name for name in VARIANTS if name in data["variants"]]
    if not known or "i" not in data["runs"]:
        return ""
    scenes = [name for name in NUMERALS[:9] if name in data["runs"]]
    ours = {name: data["runs"][name] for name in scenes}

    def rows(pick: Any, sign: str = "") -> list[list[str]]:
        lines = [["closed outline, panels", *(run_with_bar(data, n, pick, sign) for n in scenes)]]
        for name in known:
            found = data["variants"][name]
            lines.append([VARIANTS[name], *(_cell(found.get(n), pick, sign) for n in scenes)])
        return lines

    heads = ["added mass", *scenes]
    duration = ours["i"]["duration"]
    text = (
        "## Other readings of the print\n\n"
        "The paper's equations (27) to (29), read to the letter, put sources on one side of the "
        "centreline, and (28) has a factor 1/2 and leaves open where its s begins. Each reading is "
        f"played on the driven scenes for {duration:g} s, and once more with half the step: bars "
        "of the readings are those of the step, that of the closed outline counts its panels too. "
        "Figures in brackets: in one of the two runs the energy does not add up within 5 %.\n\n"
        "Displacement head first (body lengths):\n\n"
        + table(heads, rows(way_ahead, "+"))
        + "\nSpeed, net (mm/s):\n\n"
        + table(heads, rows(lambda run: 1e3 * run["speed"]))
        + "\nTurn of the heading (°, left positive):\n\n"
        + table(heads, rows(heading_turn, "+"))
        + "\nCurvature, turn per way (°/m, left positive):\n\n"
        + table(heads, rows(turn_per_way, "+"))
    )
    text += "\n" + picture(
        pictures, "variants", "Displacement and turn of the driven scenes by reading."
    )
    text += "\n" + _step_words(data, known) + "\n" + _judged_by_reading(data, known)
    return text + "\n" + _variant_rates(data, known) + "\n" + _mirror(data)


def _cell(found: Data | None, pick: Any, sign: str) -> str:
    """Return a figure of a reading with the bar of the step."""
    if found is None:
        return ""
    base, half = found["base"], found["half"]
    if base["end"]:
        return str(base["end"])
    if half["end"]:
        return f"({with_bar(pick(base), None, sign)})"
    text = with_bar(pick(base), coarse_error(pick(half) - pick(base), STEPS), sign)
    both = base["energy"]["trusted"] and half["energy"]["trusted"]
    return text if both else f"({text})"


def _left_with_bar(found: Data) -> str:
    """Return the time of a reading's first deviation with the bar of the step."""
    base, half = (found[level].get("left") for level in ("base", "half"))
    if base is None or half is None:
        return seconds(base)
    return with_bar(base, coarse_error(half - base, STEPS), digits=3)


def _step_words(data: Data, known: Sequence[str]) -> str:
    """Say how much the step matters to the displacements that are not in brackets."""
    changes = [
        (abs(way_ahead(one["half"]) / way_ahead(one["base"]) - 1.0), scene, name)
        for name in known
        for scene, one in data["variants"][name].items()
        if scene in NUMERALS[:9]
        and not any(one[level]["end"] for level in ("base", "half"))
        and all(one[level]["energy"]["trusted"] for level in ("base", "half"))
        and way_ahead(one["base"]) != 0.0
    ]
    if not changes:
        return ""
    most, scene, name = max(changes)
    middle = sorted(change for change, *_ in changes)[len(changes) // 2]
    return (
        f"Half the step changes these displacements by {middle:.1%} in the median and by "
        f"{most:.0%} at most (scene {scene}, {VARIANTS[name]}).\n"
    )


def _by_reading(data: Data, variant: str) -> dict[str, Finding]:
    """Return what comes of the statements where a reading takes the place of the closed outline."""
    runs: dict[str, Any] = {}
    for name, found in data["variants"][variant].items():
        # No finer panels: the error bar is that of the time step.
        runs |= {name: found["base"], f"{name}_half": found["half"], f"{name}_fine": found["base"]}
    instead = {**data, "runs": runs, "modes": {}}
    return {statement.key: finding for statement, finding in find_all(instead)}


def _judged_by_reading(data: Data, known: Sequence[str]) -> str:
    says = {statement.key: statement.says for statement in STATEMENTS}
    ours = {statement.key: finding for statement, finding in find_all(data)}
    columns = [ours, *(_by_reading(data, name) for name in known)]
    rows = [[says[key], *(found[key].verdict for found in columns)] for key in _OF_DRIVEN]
    counts = [sum(found[key].verdict == AGREE for key in _OF_DRIVEN) for found in columns]
    rows.append([f"**agree, of {len(_OF_DRIVEN)}**", *(f"**{count}**" for count in counts)])
    heads = ["statement", "closed outline, panels", *(VARIANTS[name] for name in known)]
    return (
        "The statements about driven scenes held against every reading, by the same criteria "
        "(error bars of the step alone, but for the first column). A reading that turns to a "
        "stated side by less than the criterion's degree differs here too:\n\n" + table(heads, rows)
    )


def _variant_rates(data: Data, known: Sequence[str]) -> str:
    rows = []
    for name in known:
        cells: list[object] = [VARIANTS[name]]
        for scene in ("x", "xi", "xii"):
            found = data["variants"][name].get(scene)
            if found is None:
                cells += ["", ""]
                continue
            cells += [_number(found["kirchhoff"], ".4f"), _left_with_bar(found)]
        rows.append(cells)
    heads = ["added mass"]
    for scene, n in (("x", 3), ("xi", 9), ("xii", 27)):
        heads += [f"{scene}, N = {n}: rate (1/s)", "1 % after (s)"]
    paper = ", ".join(
        f"{PAPER_TIMES[k]:g}" for k in ((3, 12, "small"), (9, 4, "small"), (27, 4, "small"))
    )
    return (
        f"The instability under each reading, start 1e-4 m/s (the paper: {paper} s):\n\n"
        + table(heads, rows)
    )


def _number(value: float | None, form: str) -> str:
    return "" if value is None else f"{value:{form}}"


def _mirror(data: Data) -> str:
    run, mirrored = data["runs"].get("i"), data["runs"].get("i_mirrored")
    other = data["variants"].get("mirrored")
    one_sided = data["variants"].get("consistent", {}).get("i")
    if None in (run, mirrored, other, one_sided):
        return ""
    assert run is not None and mirrored is not None and other is not None
    assert one_sided is not None

    def sums(a: Data, b: Data) -> tuple[float, float]:
        turn = math.degrees(a["turn"] + b["turn"])
        return abs(a["displacement"][1] + b["displacement"][1]), abs(turn)

    ours, theirs = sums(run, mirrored), sums(one_sided["base"], other["base"])
    return (
        "Mirrored torques (scene i half a period later) should give the mirrored path. What is "
        f"left of the sum of both: closed outline {ours[0]:.1e} m across and {ours[1]:.1e}° of "
        f"turn, centreline sources {theirs[0]:.1e} m and {theirs[1]:.2g}°.\n"
    )
