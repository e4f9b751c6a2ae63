"""The straight body: when it leaves its line, and how fast, beside the paper and Kirchhoff."""

from __future__ import annotations

from collections.abc import Mapping

from studies.paper.bars import STEPS, coarse_error, with_bar
from studies.paper.charts import STARTS
from studies.paper.onset import PAPER_TIMES, STIFFNESS, implied_rate
from studies.paper.sections.text import picture, seconds, table
from studies.paper.verdicts import Data, MissingError, onset_of, onset_time
from swim_env.analysis.kirchhoff import RigidMass, onset_by_kirchhoff, rate_for_onset

__all__ = ["section"]


def section(data: Data, pictures: Mapping[str, str]) -> str:
    """Return the section, nothing where its figures are missing."""
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
                        seconds(ours["expected"]),
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
        "The body moves along itself at 0.1 m/s, and the times are the first at which an end is 1 "
        f"% of the length off its line, at EI = {STIFFNESS[0]:g} N m²; they are interpolated "
        "between steps. The last column has the shortest and the longest over all EI played, up to "
        f"{STIFFNESS[-1]:g} N m². Kirchhoff's rate is that of a rigid body with the discrete "
        "body's own masses, λ² = U² m11 (m22 - m11)/(m22 I - g²): m11 along the body, m22 across "
        "it, I of rotation, and g between the last two. His time comes from the linear equations "
        "integrated from the same start. Bars are those of the step alone, as times are compared "
        "at the paper's number of panels.\n\n" + _print_of_slope(data) + table(heads, rows)
    )
    text += "\n" + picture(
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
        return "" if found is None else seconds(found["time"])
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
            f"**[0.1, 0] is {'an exact' if angle == 0.0 else 'no exact'} relative equilibrium of "
            f"the discrete equations**: {len(straight)} bodies are {exact} after "
            f"{straight[0]['duration']:g} s."
        )
    rated = [
        one for one in data["onset"] if one["rate"] is not None and one["perturbation"] == "epsilon"
    ]
    if rated:
        off = [one["rate"] / one["kirchhoff"] - 1.0 for one in rated]
        lines.append(
            f"**The growth is Kirchhoff's**: the {len(rated)} runs from 2.2e-16 m/s, which grow "
            f"over many decades, have his rate to {min(off):+.1e} to {max(off):+.1e}."
        )
    pairs = []
    for n, panels in ((3, 12), (9, 4), (27, 4)):
        slow, quick = (PAPER_TIMES[n, panels, kind] for kind in ("epsilon", "small"))
        pairs.append(f"{implied_rate(slow, quick):.2f} (N = {n})")
    lines.append(
        "**No single rate explains the paper's times.** A growth from 2.2e-16 and one from 1e-4 "
        f"are ln(1e-4/2.2e-16)/λ apart; the paper's pairs need λ = {', '.join(pairs)} 1/s. "
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
            "At N = 27 with 12 panels the start of 2.2e-16 m/s was played with panels at every "
            f"step for {len(apart)} stiffnesses and with the straight body's added mass for all; "
            f"where both were, their times are {max(apart):.2f} s apart at most."
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
