"""The page: statements, figures and verdicts side by side, every number of ours from the data."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from swim_env.kirchhoff import RigidMass, onset_by_kirchhoff, rate_for_onset
from swim_env.paper.bars import (
    PANELS,
    STEPS,
    bar_of,
    coarse_error,
    fine_error,
    with_bar,
)
from swim_env.paper.charts import STARTS
from swim_env.paper.constants import RESOLVED
from swim_env.paper.judges import SYMMETRY
from swim_env.paper.maps import AGREEMENT, LARGEST_BEND, SMALLEST, is_verified
from swim_env.paper.onset import PAPER_TIMES, STIFFNESS, implied_rate
from swim_env.paper.runs import NUMERALS
from swim_env.paper.statements import STATEMENTS, Statement, find_all
from swim_env.paper.variants import VARIANTS
from swim_env.paper.verdicts import (
    AGREE,
    DIFFER,
    NOT_MEASURED,
    UNDECIDED,
    Finding,
    MissingError,
    onset_of,
    onset_time,
)

__all__ = ["make_page"]

Data = Mapping[str, Any]

_CAPTIONS = {
    "fig3": "Fig. 3: the torque at every joint of scene i, from head (dark) to tail; l is the "
    "body's length.",
    "fig4": "Fig. 4: scenes i, ii, iii. Both directors stand at every element's centre.",
    "fig5": "Fig. 5: scenes iv and v.",
    "fig6": "Fig. 6: scenes vi and vii.",
    "fig7": "Fig. 7: scenes viii and ix.",
    "fig8": "Fig. 8: scenes x, xi and xii.",
}
#: Of Figs. 4 to 7.
_SAME_PHASE = " All shapes are at the same phase of the drive, that of t = 0."


def make_page(
    data: Data, pictures: Mapping[str, str], command: str, written: str | None = None
) -> str:
    """Return the page as Markdown.

    Parameters
    ----------
    data : mapping
        Of `swim_env.paper.suite.collect`, and nothing else: a number of ours that is not in it is
        not on the page.
    pictures : mapping
        Paths of the pictures that were drawn, relative to the page, by name.
    command : str
        What made it.
    written : str, optional
        The commit of the code that writes the page, which may be newer than that of the figures.
    """
    findings = find_all(data)
    parts = [
        _head(data, command, written),
        _short(data, findings),
        _statements(findings),
        _scenes(data, pictures),
        _stability(data, pictures),
        _variants(data, pictures),
        _constants(data, pictures),
        _maps(data, pictures),
        _discussion(data, findings),
        _settings(data, written),
    ]
    return "\n".join(part for part in parts if part)


def _table(heads: Sequence[str], rows: Iterable[Iterable[object]]) -> str:
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    for row in rows:
        # A bar in a cell would end it.
        cells = [str(cell).replace("|", "\\|") for cell in row]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _picture(pictures: Mapping[str, str], name: str, caption: str) -> str:
    return f"![{caption}]({pictures[name]})\n\n*{caption}*\n" if name in pictures else ""


def _short_commit(commit: str) -> str:
    return commit[:10] + ("+" if commit.endswith("+") else "")


def _commits(data: Data) -> str:
    return ", ".join(_short_commit(one) for one in data["commits"]) or "none"


def _head(data: Data, command: str, written: str | None) -> str:
    missing = data["units"] - data["done"]
    note = f" **{missing} of them are missing.**" if missing else ""
    return (
        "# The paper, side by side\n\n"
        "S. Leyendecker & E. Kanso, *Locomotion of a submerged Cosserat beam*, DETC2009-87198: "
        "what it states, what this project measures, and whether the two agree.\n\n"
        f"Made by `{command}`: figures computed at commit {_commits(data)} on "
        f"{', '.join(data['dates']) or 'no day'}, page written by commit "
        f"{_short_commit(written) if written else 'unknown'}. There are {data['units']} units of "
        f"work, one data file each.{note} Numbers of ours are read from those files; "
        "those of the paper are marked as such.\n\n"
        "`±` is an error bar. Step and panels are both of first order, so the paper's settings are "
        "off by twice the change that half the time step makes, plus one and a half times the "
        "change that three times the panels make, with ends to match. "
        "The number of elements is the paper's, and not in the bar. A number without a bar is "
        "exact, or an error itself, or a count.\n"
    )


def _short(data: Data, findings: Sequence[tuple[Statement, Finding]]) -> str:
    counts = Counter(finding.verdict for _, finding in findings)
    shown = ", ".join(
        f"{counts[verdict]} {verdict}"
        for verdict in (AGREE, DIFFER, UNDECIDED, NOT_MEASURED)
        if counts[verdict]
    )
    differ = [statement.says for statement, finding in findings if finding.verdict == DIFFER]
    text = f"## In short\n\n{len(findings)} statements: {shown}.\n"
    if differ:
        text += "\nWhat differs:\n\n" + "".join(f"* {says}\n" for says in differ)
    return text


def _statements(findings: Sequence[tuple[Statement, Finding]]) -> str:
    rows = [
        (
            f"{statement.where}: {statement.says}",
            finding.measured,
            f"**{finding.verdict}**" if finding.verdict != AGREE else finding.verdict,
            statement.criterion,
            finding.why,
        )
        for statement, finding in findings
    ]
    heads = ("the paper (in other words)", "ours", "verdict", "agrees if", "why")
    return (
        "## Statement by statement\n\nBL is a body length. Left and right of a turn or a curve are "
        "the swimmer's own, as seen by one who swims along; swimming *to the left*, towards -x, is "
        "the left of the figures, and head first. A turn is that of the mean element angle between "
        "the means of the first and of the last second, to the left where it is positive.\n\n"
        "One rule gives all verdicts: a figure **agrees** where its whole error bar meets the "
        "criterion, **differs** where none of it does, and is **undecided** where the bar spans "
        "the limit.\n\n" + _table(heads, rows) + f"\nMirror symmetry: {SYMMETRY}\n"
    )


# ---- the twelve scenes -------------------------------------------------------------------------


def _with_bar(data: Data, numeral: str, pick: Any, sign: str = "", digits: int = 6) -> str:
    """Return a figure of a run with its bar as text; an empty one where there is no run."""
    runs = [data["runs"].get(f"{numeral}{level}") for level in ("", "_half", "_fine")]
    values = [None if run is None or run["end"] else pick(run) for run in runs]
    if values[0] is None:
        return "ended early" if runs[0] is not None and runs[0]["end"] else ""
    return with_bar(values[0], bar_of(*values), sign, digits)


def _scenes(data: Data, pictures: Mapping[str, str]) -> str:
    rows = []
    for name in NUMERALS:
        run = data["runs"].get(name)
        if run is None:
            continue
        modes = data["modes"].get(name)
        rows.append(
            (
                name,
                _with_bar(data, name, lambda r: -r["displacement"][0] / r["length"], "+"),
                _with_bar(data, name, lambda r: r["displacement"][1] / r["length"], "+"),
                _with_bar(data, name, lambda r: 1e3 * r["speed"]),
                _with_bar(data, name, lambda r: math.degrees(r["turn"]), "+"),
                _with_bar(data, name, lambda r: math.degrees(r["curvature"]), "+"),
                _with_bar(data, name, lambda r: max(r["bends"])),
                "" if modes is None else _frequencies(modes),
                _with_bar(data, name, _power),
            )
        )
    if not rows:
        return ""
    heads = (
        "scene",
        "head first (BL)",
        "to its right, +y (BL)",
        "net speed (mm/s)",
        "turn (°), left +",
        "turn per way (°/m)",
        "largest joint angle (rad)",
        "natural frequencies (Hz)",
        f"mean positive power below {RESOLVED:g} Hz (W)",
    )
    duration = max(data["runs"][row[0]]["duration"] for row in rows)
    text = (
        f"## The twelve scenes, {duration:g} s\n\n"
        "Displacements and turns are between the means of the first and of the last second. The "
        "body lies along +x and swims head first towards -x, to the left in the paper's "
        "figures. Natural frequencies are those of the straight body in its fluid, with the bar of "
        "the panels alone.\n\n"
    )
    text += _table(heads, rows)
    for name, caption in _CAPTIONS.items():
        phase = _SAME_PHASE if name in ("fig4", "fig5", "fig6", "fig7") else ""
        shown = _picture(pictures, name, caption + phase)
        text += "\n" + shown if shown else ""
    return text


def _power(run: Data) -> float | None:
    """Return the mean positive power on the resolved motion (W), None where it was not measured."""
    internal = run.get("internal")
    return None if internal is None else float(internal["power"])


def _frequencies(modes: Data) -> str:
    """Return the first two natural frequencies with the bar of the panels."""
    pairs = list(zip(modes["frequencies"], modes.get("fine", []), strict=False))[:2]
    return ", ".join(with_bar(f, coarse_error(fine - f, PANELS)) for f, fine in pairs)


# ---- stability ---------------------------------------------------------------------------------


def _stability(data: Data, pictures: Mapping[str, str]) -> str:
    rows = []
    for n in (3, 9, 27):
        for panels in (4, 12):
            for kind, name in STARTS.items():
                ours = onset_of(data, n, panels, kind)
                if ours is None:
                    continue
                paper = PAPER_TIMES.get((n, panels, kind))
                rows.append(
                    (
                        n,
                        panels,
                        name,
                        "" if paper is None else f"{paper:g}",
                        _time_with_bar(data, n, panels, kind),
                        ""
                        if paper is None or ours["time"] is None
                        else f"{ours['time'] / paper:.2f}",
                        _seconds(ours["expected"]),
                        _rate_with_bar(data, n, panels, kind),
                        f"{ours['kirchhoff']:.4f}",
                        _over_stiffness(data, n, panels, kind),
                    )
                )
    if not rows:
        return ""
    heads = (
        "N",
        "panels",
        "start across",
        "paper (s)",
        "ours (s)",
        "ours over paper",
        "Kirchhoff (s)",
        "rate fitted (1/s)",
        "Kirchhoff's rate (1/s)",
        "times over EI (s)",
    )
    text = (
        "## Stability of the straight body\n\n"
        "At 0.1 m/s along itself, first time that an end is 1 % of the length off its line, "
        "at EI = "
        f"{STIFFNESS[0]:g}; the last column has the extremes over all EI played up to "
        f"{STIFFNESS[-1]:g} N m². Kirchhoff's rate and time are those of a rigid body with "
        "the discrete "
        "body's own masses: λ² = U² m11 (m22 - m11)/(m22 I - g²), and the linear equations "
        "integrated "
        "from the same start. Times lie between steps. Bars are those of the step: panels are "
        "given, as the paper's times are compared at its panels.\n\n"
        + _print_of_slope(data)
        + _table(heads, rows)
    )
    text += "\n" + _picture(
        pictures,
        "onset",
        "Onset of the instability: times (filled: ours, hollow: the paper's) and growth rates, "
        "each beside Kirchhoff's for the same number of panels.",
    )
    return text + "\n" + _findings_of_stability(data)


def _time_with_bar(data: Data, n: int, panels: int, kind: str) -> str:
    try:
        time = onset_time(data, n, panels, kind)
    except MissingError:
        found = onset_of(data, n, panels, kind)
        return "" if found is None else _seconds(found["time"])
    return "none" if time is None else with_bar(time.value, time.bar, digits=4)


def _rate_with_bar(data: Data, n: int, panels: int, kind: str) -> str:
    ours = onset_of(data, n, panels, kind)
    if ours is None or ours["rate"] is None:
        return ""
    for model in ("panels", "frozen"):
        base = onset_of(data, n, panels, kind, model=model)
        half = onset_of(data, n, panels, kind, step=0.005, model=model)
        if base and half and None not in (base["rate"], half["rate"]):
            return with_bar(ours["rate"], coarse_error(half["rate"] - base["rate"], STEPS))
    return with_bar(ours["rate"], None)


def _rigid_mass(modes: Data) -> RigidMass:
    return RigidMass(modes["along"], modes["across"], modes["inertia"], modes["coupling"])


def _print_of_slope(data: Data) -> str:
    """Say how the third start was read, and what the other reading would give."""
    parts = []
    for name, n, panels in (("x", 3, 12), ("xi", 9, 4), ("xii", 27, 4)):
        modes = data["modes"].get(name)
        if modes is None or "along" not in modes:
            continue
        # (3.5 - x/0.01) 1e-5: at the centre, x = 1/2, and its slope.
        time = onset_by_kirchhoff(_rigid_mass(modes), 0.1, -4.65e-4, -1e-3, 1.0, 0.01)
        parts.append(f"{time:.2f} s (paper {PAPER_TIMES[n, panels, 'sloped']:g})")
    text = (
        "The third start is printed as (3.5 - x/Δt) 1e-5, x over the time step. That is read as "
        "x/dl, a place counted in elements from the head, each at its centre, as s/Δl is in the "
        "caption of the paper's Fig. 6; so this start is another motion for every N. "
    )
    if parts:
        text += (
            f"Taken to the letter, with Δt = 0.01, Kirchhoff's equations give {', '.join(parts)} "
            "at N = 3, 9, 27: nearer, and nearly the same for every N, which the paper's are not. "
        )
    return text.rstrip() + "\n\n"


def _seconds(value: float | None) -> str:
    return "none" if value is None else f"{value:.2f}"


def _number(value: float | None, form: str) -> str:
    return "" if value is None else f"{value:{form}}"


def _over_stiffness(data: Data, n: int, panels: int, kind: str) -> str:
    times = [
        one["time"]
        for one in data["onset"]
        if (one["elements"], one["panels"], one["perturbation"]) == (n, panels, kind)
        and one["step"] == 0.01
        and one["time"] is not None
    ]
    return "" if len(times) < 2 else f"{min(times):.2f} to {max(times):.2f}"


def _findings_of_stability(data: Data) -> str:
    lines = []
    straight = [one for one in data["onset"] if one["perturbation"] == "none"]
    if straight:
        angle = max(one["largest_angle"] for one in straight)
        exact = "bit for bit straight" if angle == 0.0 else f"straight to {angle:.1e} rad"
        lines.append(
            f"**[0.1, 0] is {'an exact' if angle == 0.0 else 'no exact'} relative equilibrium "
            "of the "
            f"discrete equations**: {len(straight)} bodies are {exact} after "
            f"{straight[0]['duration']:g} s."
        )
    rated = [
        one for one in data["onset"] if one["rate"] is not None and one["perturbation"] == "epsilon"
    ]
    if rated:
        off = [one["rate"] / one["kirchhoff"] - 1.0 for one in rated]
        lines.append(
            f"**The growth is Kirchhoff's**: the {len(rated)} runs from 2.2e-16 m/s, which "
            "grow over "
            f"many decades, have his rate to {min(off):+.1e} to {max(off):+.1e}."
        )
    pairs = []
    for n, panels in ((3, 12), (9, 4), (27, 4)):
        slow, quick = (PAPER_TIMES[n, panels, kind] for kind in ("epsilon", "small"))
        pairs.append(f"{implied_rate(slow, quick):.2f} (N = {n})")
    lines.append(
        "**No single rate explains the paper's times.** A growth from 2.2e-16 and one from "
        "1e-4 are "
        f"ln(1e-4/2.2e-16)/λ apart; the paper's pairs need λ = {', '.join(pairs)} 1/s. "
        + _alone_needs(data)
    )
    same = [
        (one, onset_of(data, 27, 12, "epsilon", stiffness=one["stiffness"]))
        for one in data["onset"]
        if one["model"] == "frozen" and one["elements"] == 27
    ]
    apart = [
        abs(one["time"] - other["time"])
        for one, other in same
        if other is not None and None not in (one["time"], other["time"])
    ]
    if apart:
        lines.append(
            "At N = 27 with 12 panels the start of 2.2e-16 m/s was played with panels at "
            "every step "
            f"for {len(apart)} stiffnesses and with the straight body's added mass for all; where "
            f"both were, their times are {max(apart):.2f} s apart at most."
        )
    return "\n\n".join(lines) + "\n"


def _alone_needs(data: Data) -> str:
    """Say which rates the paper's times for 1e-4 need alone, by the rigid body's equations."""
    parts = []
    for name, n, panels in (("x", 3, 12), ("xi", 9, 4), ("xii", 27, 4)):
        modes = data["modes"].get(name)
        if modes is None:
            continue
        rate = rate_for_onset(
            _rigid_mass(modes), 0.1, 1e-4, 1.0, 0.01, PAPER_TIMES[n, panels, "small"]
        )
        parts.append(f"{rate:.2f} (N = {n})")
    if not parts:
        return ""
    return (
        "The times for 1e-4 alone would need, with the same masses and a smaller rotary inertia, "
        f"λ = {', '.join(parts)} 1/s."
    )


# ---- variants ----------------------------------------------------------------------------------


def _variants(data: Data, pictures: Mapping[str, str]) -> str:
    known = [name for name in VARIANTS if name in data["variants"]]
    if not known or "i" not in data["runs"]:
        return ""
    scenes = [name for name in NUMERALS[:9] if name in data["runs"]]
    ours = {name: data["runs"][name] for name in scenes}

    def rows(pick: Any, sign: str = "") -> list[list[str]]:
        table = [["closed outline, panels", *(_with_bar(data, n, pick, sign) for n in scenes)]]
        for name in known:
            found = data["variants"][name]
            table.append([VARIANTS[name], *(_cell(found.get(n), pick, sign) for n in scenes)])
        return table

    heads = ["added mass", *scenes]
    duration = ours["i"]["duration"]
    text = (
        "## Other readings of the print\n\n"
        "The paper's (27) to (29), read to the letter, put sources on one side of the "
        "centreline, and "
        "(28) has a factor 1/2 and leaves open where its s begins. Each reading is played on the "
        f"driven scenes for {duration:g} s, again with half the step: bars of the readings are "
        "those of the step, that of the closed outline counts its panels too. In brackets: the "
        "energy of one of the two runs does not add up to 5 %.\n\n"
        "Displacement head first (body lengths):\n\n"
        + _table(heads, rows(_ahead, "+"))
        + "\nSpeed, net (mm/s):\n\n"
        + _table(heads, rows(lambda run: 1e3 * run["speed"]))
        + "\nTurn of the heading (°, left positive):\n\n"
        + _table(heads, rows(lambda run: math.degrees(run["turn"]), "+"))
        + "\nCurvature, turn per way (°/m, left positive):\n\n"
        + _table(heads, rows(lambda run: math.degrees(run["curvature"]), "+"))
    )
    text += "\n" + _picture(
        pictures, "variants", "Direction, speed and turn of the driven scenes by reading."
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
        return _seconds(base)
    return with_bar(base, coarse_error(half - base, STEPS), digits=3)


def _step_words(data: Data, known: Sequence[str]) -> str:
    """Say how much the step matters to the displacements that are not in brackets."""
    changes = [
        (abs(_ahead(one["half"]) / _ahead(one["base"]) - 1.0), scene, name)
        for name in known
        for scene, one in data["variants"][name].items()
        if scene in NUMERALS[:9]
        and not any(one[level]["end"] for level in ("base", "half"))
        and all(one[level]["energy"]["trusted"] for level in ("base", "half"))
        and _ahead(one["base"]) != 0.0
    ]
    if not changes:
        return ""
    most, scene, name = max(changes)
    middle = sorted(change for change, *_ in changes)[len(changes) // 2]
    return (
        f"Half the step changes these displacements by {middle:.1%} in the median and by "
        f"{most:.0%} at "
        f"most (scene {scene}, {VARIANTS[name]}).\n"
    )


def _ahead(run: Data) -> float:
    return -float(run["displacement"][0]) / float(run["length"])


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
        "(error "
        "bars of the step alone, but for the first column). A reading that turns to a stated "
        "side by less "
        "than the criterion's degree differs here too:\n\n" + _table(heads, rows)
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
        + _table(heads, rows)
    )


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
        "Mirrored torques (scene i half a period later) should give the mirrored path. What "
        "is left "
        f"of the sum of both: closed outline {ours[0]:.1e} m across and {ours[1]:.1e}° of turn, "
        f"centreline sources {theirs[0]:.1e} m and {theirs[1]:.2g}°.\n"
    )


# ---- what is kept ------------------------------------------------------------------------------


def _constants(data: Data, pictures: Mapping[str, str]) -> str:
    rows = []
    for name in NUMERALS:
        run = data["runs"].get(name)
        if run is None:
            continue
        energy, momentum = run["energy"], run["momentum"]
        rows.append(
            (
                name,
                f"{momentum['drift']:.1e}",
                f"{momentum['bound']:.1e}",
                _with_bar(data, name, lambda run: run["energy"]["largest"]),
                f"{energy['unexplained']:.1e}" + _at_half(data, name),
                f"{energy['first']:+.1e}, {energy['last']:+.1e}",
                *(
                    _with_bar(data, name, lambda run, key=key: run["energy"][key])
                    for key in ("work", "positive_work")
                ),
                "" if energy["positive_work"] == 0.0 else _with_bar(data, name, _transport),
            )
        )
    if not rows:
        return ""
    heads = (
        "scene",
        "momentum drift",
        "its bound",
        "largest energy (J)",
        "unexplained (at half the step)",
        "mean of first and last quarter",
        "net work (J)",
        "positive work (J)",
        f"positive work below {RESOLVED:g} Hz per way (J/m)",
    )
    text = (
        "## What is kept, and what it costs\n\n"
        "Momentum drift: max |J_n - J_0| in kg m/s and kg m²/s; its bound is 10 tolerances of "
        "Newton's method plus 1e-15 n times the size of its terms. Energy: H - H(0) - work, as a "
        "share of the largest H. These are errors and so have no bar; that of the energy at half "
        "the step stands beside it. Positive work counts every swing of the modes that ring "
        "undamped, which the steps do not resolve: its bar is often as large as itself. What the "
        f"torques spend on the motion below {RESOLVED:g} Hz alone is known, and stands last, and "
        "in the table of scenes as a power.\n\n" + _table(heads, rows)
    )
    text += "\n" + _picture(
        pictures, "constants", "Energy that the work does not explain, and the drift of momentum."
    )
    return text + "\n" + _internal(data, pictures)


def _at_half(data: Data, name: str) -> str:
    half = data["runs"].get(f"{name}_half")
    return "" if half is None or half["end"] else f" ({half['energy']['unexplained']:.1e})"


def _transport(run: Data) -> float | None:
    """Return what the torques spend on the resolved motion per way (J/m)."""
    power, speed = _power(run), float(run["speed"])
    return None if power is None or speed == 0.0 else power / speed


def _internal(data: Data, pictures: Mapping[str, str]) -> str:
    rows = []
    peaks = []
    for name in NUMERALS:
        found = data["runs"].get(name, {}).get("internal")
        if found is None:
            continue

        def largest(run: Data, key: str) -> float:
            return float(max(run["internal"][key]))

        half = data["runs"].get(f"{name}_half", {}).get("internal")
        if half is not None and found["peak_shear"] > 0.0:
            peaks.append(half["peak_shear"] / found["peak_shear"])
        rows.append(
            (
                name,
                *(
                    _with_bar(data, name, lambda run, key=key: largest(run, key))
                    for key in ("shear", "axial", "elastic", "total")
                ),
                f"{1 + found['total'].index(max(found['total']))} of {len(found['total'])}",
                ", ".join(f"{found['above'][key]:.0%}" for key in ("shear", "axial", "total")),
                _with_bar(data, name, lambda run: 1e3 * largest(run, "strain")),
            )
        )
    if not rows:
        return ""
    heads = (
        "scene",
        "force across (N)",
        "force along (N)",
        "spring's moment (N m)",
        "sum of moments (N m)",
        "at joint",
        f"variance above {RESOLVED:g} Hz: across, along, sum",
        "largest strain at the skin (1e-3)",
    )
    text = (
        "### Forces and moments along the beam\n\n"
        "The paper names stresses and strains, and the energy needed for locomotion, as what "
        "the model "
        "is for. Forces come from each element's momentum balance, the fluid's impulse on its own "
        "panels included, so they hold for the discrete body whatever the multipliers are; "
        "moments are "
        "those of torque and spring (all per metre of depth). The undamped beam rings, and steps "
        f"of 10 ms resolve motions up to {RESOLVED:g} Hz (2π f dt = 0.5). What is stated is the "
        "root mean square of each series below that frequency, at the joint where it is largest; "
        "the share of the variance above it is what these runs cannot tell. "
    )
    if peaks:
        text += (
            "Largest instantaneous forces are not stated: half the step makes them "
            f"{min(peaks):.1f} to {max(peaks):.1f} times as large. "
        )
    text += (
        "The strain is the half thickness times the largest curvature of the run, from the shapes "
        "and not filtered.\n\n"
    )
    return (
        text
        + _table(heads, rows)
        + "\n"
        + _picture(
            pictures,
            "internal",
            f"Moments and forces along the beam below {RESOLVED:g} Hz, scenes i and v: root mean "
            "squares of the run with error bars, and the sum of moments in the last second but "
            "one.",
        )
    )


# ---- maps --------------------------------------------------------------------------------------


def _maps(data: Data, pictures: Mapping[str, str]) -> str:
    if not data["maps"]:
        return ""
    lines = [
        "## A wider map than the paper's\n",
        "Net speed head first, with 1 ms of Kelvin-Voigt damping (scene `swimmer`; undamped, a "
        "displacement at resonance has no limit to converge to). Computed with the straight "
        "body's added "
        "mass from fine panels and the second-order scheme. Every point is played with two "
        "steps, and "
        "some with panels at every step; a point is **verified** where all of them agree within "
        f"{AGREEMENT:.0%} or {SMALLEST:g} BL/s, the energy adds up, and joints bend by less than "
        f"{LARGEST_BEND:g} rad unless panels confirm it. Others are grey. Speeds are those of half "
        "the step. Their bars count a third of the change that the step makes, as the scheme is of "
        "second order, and the change that panels make, or the largest one where a point was not "
        "played with them.\n",
    ]
    for name, words in (("drive", "frequency x wave number"), ("body", "stiffness x length")):
        rows = data["maps"].get(name, [])
        if rows:
            lines.append(f"* **{words}**: {_map_words(name, rows)}\n")
    lines.append(
        _picture(
            pictures,
            "maps",
            "Net speed over drive and body. Orange: head first; purple: tail first; grey: not "
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


# ---- the end -----------------------------------------------------------------------------------


def _discussion(data: Data, findings: Sequence[tuple[Statement, Finding]]) -> str:
    by_key = {statement.key: finding for statement, finding in findings}
    lines = ["## What can be had, and from what"]

    def held(group: str) -> str:
        found = [by_key[key] for key in GROUPS[group]]
        count = sum(finding.verdict == AGREE for finding in found)
        return f"{count} of {len(found)} statements hold."

    lines.append(
        f"**Directions, orders of speeds and bends** of Figs. 4 to 7: {held('orders')} Ours are "
        "from the closed outline with the paper's parameters; by reading of the print they are "
        "counted above. Distances are not stated in the text and so not compared."
    )
    lines.append(
        f"**Straight and curved paths**: {held('paths')} {_curve_words(data)} With a "
        "mirror-symmetric "
        "fluid a wave turns the body only if the motion breaks the symmetry, which none of ours "
        "does, so curves that a model shows in these scenes "
        "measure how lopsided it is."
    )
    lines.append(
        f"**Times of onset**: {held('times')} {_rate_words(data)} The paper's times cannot be had "
        "from any reading tried."
    )
    lines.append(
        f"**What the onset does not hang on**, and the equilibrium itself: {held('onset')} An "
        "unstable equilibrium that stiffness and panels do not change can be had."
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
            turn = math.degrees(run["turn"])
            if abs(turn) > abs(largest.get(side, (0.0, ""))[0]):
                largest[side] = (turn, scene)
    ours = {
        scene: math.degrees(data["runs"][scene]["turn"])
        for scene in NUMERALS[:9]
        if scene in data["runs"]
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
        f" At the largest curvature of iv among them ({VARIANTS[most]}) a semicircle takes "
        f"{math.pi / abs(run['curvature']):.0f} m of way, and it covers {run['way']:.2f} m."
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


def _settings(data: Data, written: str | None) -> str:
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
        "the bar of the step alone; at N = 27 with 12 panels the one of 2.2e-16 m/s is from runs "
        "with the straight body's added mass.\n\n"
    )
    if rows:
        text += _table(heads, rows) + "\n"
    page = _short_commit(written) if written else "unknown"
    return text + (
        f"{data['done']} files of figures were there, computed at commit {_commits(data)}; this "
        f"page was written by commit {page}. `make paper` makes them and this page; no number of "
        "ours was written by hand.\n"
    )
