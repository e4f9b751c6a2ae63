"""Other readings of the print: the driven scenes and the instability under each of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from studies.paper.bars import STEPS, coarse_error, with_bar
from studies.paper.measures import Run, heading_turn, turn_per_way, way_ahead
from studies.paper.onset import PAPER_BODIES, PAPER_TIMES
from studies.paper.runs import NUMERALS
from studies.paper.sections.text import blocks, picture, run_with_bar, seconds
from studies.paper.statements import STATEMENTS, find_all
from studies.paper.variants import VARIANTS
from studies.paper.verdicts import AGREE, Data
from swim_env.files.tables import markdown_table

__all__ = ["section"]

#: Statements about driven scenes, which any reading can be compared with.
_OF_DRIVEN = {
    one.key: one.says
    for one in STATEMENTS
    if one.group in ("orders", "paths") and one.key != "viii as i"
}
#: What is shown of every scene and reading.
_FIGURES: dict[str, tuple[Callable[[Run], float], str]] = {
    "Displacement head first (body lengths):": (way_ahead, "+"),
    "Speed, net (mm/s):": (lambda run: 1e3 * run["speed"], ""),
    "Turn of the heading (°, left positive):": (heading_turn, "+"),
    "Curvature, turn per way (°/m, left positive):": (turn_per_way, "+"),
}


def section(data: Data, pictures: Mapping[str, str]) -> str:
    """Return the section, nothing where its figures are missing."""
    known = {name: data["variants"][name] for name in VARIANTS if name in data["variants"]}
    if not known or "i" not in data["runs"]:
        return ""
    scenes = [name for name in NUMERALS[:9] if name in data["runs"]]
    tables = []
    for words, (pick, sign) in _FIGURES.items():
        rows = [["closed outline, panels", *(run_with_bar(data, n, pick, sign) for n in scenes)]]
        for name, found in known.items():
            rows.append([VARIANTS[name], *(_cell(found.get(n), pick, sign) for n in scenes)])
        tables += [words, markdown_table(["added mass", *scenes], rows)]
    return blocks(
        "## Other readings of the print",
        "The paper's equations (27) to (29), read to the letter, put sources on one side of the "
        "centreline, and (28) has a factor 1/2 and leaves open where its s begins. Each reading is "
        f"played on the driven scenes for {data['runs']['i']['duration']:g} s, and once more with "
        "half the step: bars of the readings are those of the step, that of the closed outline "
        "counts its panels too. Figures in brackets: in one of the two runs the energy does not "
        "add up within 5 %.",
        *tables,
        picture(pictures, "variants", "Displacement and turn of the driven scenes by reading."),
        _step_words(known),
        "The statements about driven scenes held against every reading, by the same criteria "
        "(error bars of the step alone, but for the first column). A reading that turns to a "
        "stated side by less than the criterion's degree differs here too:",
        _judged_by_reading(data, known),
        *_rates(known),
        _mirror(data),
    )


def _holds(found: Data) -> bool:
    """Tell whether both runs of a scene came to their end and their energy adds up."""
    return all(not found[x]["end"] and found[x]["energy"]["trusted"] for x in ("base", "half"))


def _cell(found: Data | None, pick: Callable[[Run], float], sign: str) -> str:
    """Return a figure of a reading with the bar of the step."""
    if found is None:
        return ""
    base, half = found["base"], found["half"]
    if base["end"]:
        return str(base["end"])
    bar = None if half["end"] else coarse_error(pick(half) - pick(base), STEPS)
    text = with_bar(pick(base), bar, sign)
    return text if _holds(found) else f"({text})"


def _step_words(known: Mapping[str, Data]) -> str:
    """Say how much the step matters to the displacements that are not in brackets."""
    changes = sorted(
        (abs(way_ahead(one["half"]) / way_ahead(one["base"]) - 1.0), scene, name)
        for name, found in known.items()
        for scene, one in found.items()
        if scene in NUMERALS[:9] and _holds(one) and way_ahead(one["base"]) != 0.0
    )
    if not changes:
        return ""
    most, scene, name = changes[-1]
    return (
        f"Half the step changes these displacements by {changes[len(changes) // 2][0]:.1%} in the "
        f"median and by {most:.0%} at most (scene {scene}, {VARIANTS[name]})."
    )


def _judged_by_reading(data: Data, known: Mapping[str, Data]) -> str:
    columns = [data]
    for found in known.values():
        runs: dict[str, Data] = {}
        for name, one in found.items():
            # No finer panels: the error bar is that of the time step.
            runs |= {name: one["base"], f"{name}_half": one["half"], f"{name}_fine": one["base"]}
        columns.append({**data, "runs": runs, "modes": {}})
    verdicts = [{one.key: finding.verdict for one, finding in find_all(x)} for x in columns]
    rows = [[says, *(found[key] for found in verdicts)] for key, says in _OF_DRIVEN.items()]
    counts = [sum(found[key] == AGREE for key in _OF_DRIVEN) for found in verdicts]
    rows.append([f"**agree, of {len(_OF_DRIVEN)}**", *(f"**{count}**" for count in counts)])
    heads = ["statement", "closed outline, panels", *(VARIANTS[name] for name in known)]
    return markdown_table(heads, rows)


def _rates(known: Mapping[str, Data]) -> Sequence[str]:
    """Return the instability under each reading: what the table shows, and the table."""
    heads, rows = ["added mass"], []
    for scene, (n, _) in PAPER_BODIES.items():
        heads += [f"{scene}, N = {n}: rate (1/s)", "1 % after (s)"]
    for name, readings in known.items():
        cells = [VARIANTS[name]]
        for scene in PAPER_BODIES:
            found = readings.get(scene)
            if found is None:
                cells += ["", ""]
                continue
            rate = found["kirchhoff"]
            cells += ["" if rate is None else f"{rate:.4f}", _left_with_bar(found)]
        rows.append(cells)
    paper = ", ".join(f"{PAPER_TIMES[*body, 'small']:g}" for body in PAPER_BODIES.values())
    words = f"The instability under each reading, start 1e-4 m/s (the paper: {paper} s):"
    return words, markdown_table(heads, rows)


def _left_with_bar(found: Data) -> str:
    """Return the time of a reading's first deviation with the bar of the step."""
    base, half = (found[level].get("left") for level in ("base", "half"))
    if base is None or half is None:
        return seconds(base)
    return with_bar(base, coarse_error(half - base, STEPS), digits=3)


def _mirror(data: Data) -> str:
    runs, variants = data["runs"], data["variants"]
    pairs = [
        (runs.get("i"), runs.get("i_mirrored")),
        (variants.get("consistent", {}).get("i"), variants.get("mirrored")),
    ]
    sums = []
    for one, other in pairs:
        if one is None or other is None:
            return ""
        # Readings have a run with half the step too.
        one, other = one.get("base", one), other.get("base", other)
        across = abs(one["displacement"][1] + other["displacement"][1])
        sums.append((across, abs(math.degrees(one["turn"] + other["turn"]))))
    ours, theirs = sums
    return (
        "Mirrored torques (scene i half a period later) should give the mirrored path. What is "
        f"left of the sum of both: closed outline {ours[0]:.1e} m across and {ours[1]:.1e}° of "
        f"turn, centreline sources {theirs[0]:.1e} m and {theirs[1]:.2g}°."
    )
