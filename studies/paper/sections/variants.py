"""Other readings of the print: the driven scenes and the instability under each of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from swim_agents.tables import markdown_table

from studies.paper.bars import STEPS, coarse_error, with_bar
from studies.paper.measures import (
    Fields,
    Run,
    heading_turn,
    run_with_bar,
    seconds,
    turn_per_way,
    way_ahead,
)
from studies.paper.onset import PAPER_BODIES, PAPER_TIMES
from studies.paper.runs import NUMERALS
from studies.paper.statements import STATEMENTS, find_all
from studies.paper.variants import VARIANTS
from studies.paper.verdicts import AGREE, Data

#: Statements about driven scenes, which any reading can be compared with.
_OF_DRIVEN = {
    one.key: one.says
    for one in STATEMENTS
    if one.group in ("orders", "paths") and one.key != "viii as i"
}
#: What is shown of every scene and reading.
_FIGURES: dict[str, tuple[Callable[[Run], float], str]] = {
    "ahead": (way_ahead, "+"),
    "speed": (lambda run: 1e3 * run["speed"], ""),
    "turn": (heading_turn, "+"),
    "curvature": (turn_per_way, "+"),
}


def variants(data: Data) -> Fields | None:
    """Return what is said of other readings."""
    known = {name: data["variants"][name] for name in VARIANTS if name in data["variants"]}
    if not known or "i" not in data["runs"]:
        return None
    scenes = [name for name in NUMERALS[:9] if name in data["runs"]]
    tables = {}
    for key, (pick, sign) in _FIGURES.items():
        rows = [["closed outline, panels", *(run_with_bar(data, n, pick, sign) for n in scenes)]]
        for name, found in known.items():
            rows.append([VARIANTS[name], *(_cell(found.get(n), pick, sign) for n in scenes)])
        tables[key] = markdown_table(["added mass", *scenes], rows)
    paper = [f"{PAPER_TIMES[*body, 'small']:g}" for body in PAPER_BODIES.values()]
    return {
        "duration": data["runs"]["i"]["duration"],
        **tables,
        **_steps(known),
        "verdicts": _judged_by_reading(data, known),
        "paper_times": ", ".join(paper),
        "rates": _rates(known),
        **_mirror(data),
    }


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


def _steps(known: Mapping[str, Data]) -> Fields:
    """Return how much the step matters to the displacements that are not in brackets."""
    changes = sorted(
        (abs(way_ahead(one["half"]) / way_ahead(one["base"]) - 1.0), scene, VARIANTS[name])
        for name, found in known.items()
        for scene, one in found.items()
        if scene in NUMERALS[:9] and _holds(one) and way_ahead(one["base"]) != 0.0
    )
    if not changes:
        return {}
    most, scene, reading = changes[-1]
    median = changes[len(changes) // 2][0]
    fields = {"step_median": median, "step_most": most}
    return {**fields, "step_scene": scene, "step_reading": reading}


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


def _rates(known: Mapping[str, Data]) -> str:
    """Return the table of the instability under each reading."""
    heads, rows = ["added mass"], []
    for scene, (n, _) in PAPER_BODIES.items():
        heads += [f"{scene}, N = {n}: rate (1/s)", "1 % after (s)"]
    for name, readings in known.items():
        cells = [VARIANTS[name]]
        for scene in PAPER_BODIES:
            found = readings.get(scene)
            rate = None if found is None else found["kirchhoff"]
            cells.append("" if rate is None else f"{rate:.4f}")
            cells.append("" if found is None else _left_with_bar(found))
        rows.append(cells)
    return markdown_table(heads, rows)


def _left_with_bar(found: Data) -> str:
    """Return the time of a reading's first deviation with the bar of the step."""
    base, half = (found[level].get("left") for level in ("base", "half"))
    if base is None or half is None:
        return seconds(base)
    return with_bar(base, coarse_error(half - base, STEPS), digits=3)


def _mirror(data: Data) -> Fields:
    """Return what is left of the sum of a path and that of the mirrored torques."""
    runs, variants = data["runs"], data["variants"]
    fields: Fields = {}
    for name, one, other in (
        ("", runs.get("i"), runs.get("i_mirrored")),
        ("centreline_", variants.get("consistent", {}).get("i"), variants.get("mirrored")),
    ):
        if one is not None and other is not None:
            # Readings have a run with half the step too.
            one, other = one.get("base", one), other.get("base", other)
            across = abs(one["displacement"][1] + other["displacement"][1])
            turned = abs(math.degrees(one["turn"] + other["turn"]))
            fields |= {f"{name}across": across, f"{name}turned": turned}
    return fields
