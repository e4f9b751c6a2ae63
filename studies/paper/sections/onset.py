"""The straight body: when it leaves its line, and how fast, compared with the paper's times."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping

from studies.paper.bars import STEPS, coarse_error, with_bar
from studies.paper.charts import STARTS
from studies.paper.onset import PAPER_BODIES, PAPER_TIMES, STIFFNESS, implied_rate
from studies.paper.sections.text import blocks, picture, seconds, table
from studies.paper.verdicts import Data, MissingError, onset_of, onset_time
from swim_env.analysis.kirchhoff import RigidMass, onset_by_kirchhoff, rate_for_onset

__all__ = ["section"]


def section(data: Data, pictures: Mapping[str, str]) -> str:
    """Return the section, nothing where its figures are missing."""
    bodies = itertools.product((3, 9, 27), (4, 12), STARTS)
    found = [one for body in bodies if (one := onset_of(data, *body)) is not None]
    if not found:
        return ""

    def paper(one: Data) -> float | None:
        return PAPER_TIMES.get((one["elements"], one["panels"], one["perturbation"]))

    def over_paper(one: Data) -> str:
        time, theirs = one["time"], paper(one)
        return "" if theirs is None or time is None else f"{time / theirs:.2f}"

    columns: dict[str, Callable[[Data], object]] = {
        "N": lambda one: one["elements"],
        "panels": lambda one: one["panels"],
        "start across": lambda one: STARTS[one["perturbation"]],
        "paper (s)": lambda one: "" if paper(one) is None else f"{paper(one):g}",
        "ours (s)": lambda one: _time_with_bar(data, one),
        "ours over paper": over_paper,
        "Kirchhoff (s)": lambda one: seconds(one["expected"]),
        "rate fitted (1/s)": lambda one: _rate_with_bar(data, one),
        "Kirchhoff's rate (1/s)": lambda one: f"{one['kirchhoff']:.4f}",
        "times over EI (s)": lambda one: _over_stiffness(data, one),
    }
    return blocks(
        "## Stability of the straight body",
        "The body moves along itself at 0.1 m/s, and the times are the first at which an end is 1 "
        f"% of the length off its line, at EI = {STIFFNESS[0]:g} N m²; they are interpolated "
        "between steps. The last column has the shortest and the longest over all EI played, up to "
        f"{STIFFNESS[-1]:g} N m². Kirchhoff's rate is that of a rigid body with the discrete "
        "body's own masses, λ² = U² m11 (m22 - m11)/(m22 I - g²): m11 along the body, m22 across "
        "it, I of rotation, and g between the last two. His time comes from the linear equations "
        "integrated from the same start. Bars are those of the step alone, as times are compared "
        "at the paper's number of panels.",
        _print_of_slope(data),
        table(columns, found),
        picture(
            pictures,
            "onset",
            "Onset of the instability: times (filled: ours, hollow: the paper's) and growth rates, "
            "each beside Kirchhoff's for the same number of panels.",
        ),
        *_findings(data),
    )


def _time_with_bar(data: Data, one: Data) -> str:
    try:
        time = onset_time(data, one["elements"], one["panels"], one["perturbation"])
    except MissingError:
        return seconds(one["time"])
    return "none" if time is None else with_bar(time.value, time.bar, digits=4)


def _rate_with_bar(data: Data, one: Data) -> str:
    if one["rate"] is None:
        return ""
    body = (one["elements"], one["panels"], one["perturbation"])
    for model in ("panels", "frozen"):
        base = onset_of(data, *body, model=model)
        half = onset_of(data, *body, step=0.005, model=model)
        if base and half and None not in (base["rate"], half["rate"]):
            return with_bar(one["rate"], coarse_error(half["rate"] - base["rate"], STEPS))
    return with_bar(one["rate"], None)


def _over_stiffness(data: Data, one: Data) -> str:
    same = ("elements", "panels", "perturbation", "step")
    times = [
        other["time"]
        for other in data["onset"]
        if other["time"] is not None and all(other[key] == one[key] for key in same)
    ]
    return "" if len(times) < 2 else f"{min(times):.2f} to {max(times):.2f}"


def _by_body(data: Data, found: Callable[[RigidMass, tuple[int, int]], str]) -> str:
    """Return what the rigid masses of x, xi and xii give with their elements and panels."""
    parts = []
    for name, body in PAPER_BODIES.items():
        modes = data["modes"].get(name)
        if modes is not None and "along" in modes:
            keys = ("along", "across", "inertia", "coupling")
            parts.append(found(RigidMass(*(modes[key] for key in keys)), body))
    return ", ".join(parts)


def _print_of_slope(data: Data) -> str:
    """Say how the third start was read, and what the other reading would give."""

    def found(mass: RigidMass, body: tuple[int, int]) -> str:
        # (3.5 - x/0.01) 1e-5: at the centre, x = 1/2, and its slope.
        time = onset_by_kirchhoff(mass, 0.1, -4.65e-4, -1e-3, 1.0, 0.01)
        return f"{time:.2f} s (paper {PAPER_TIMES[*body, 'sloped']:g})"

    text = (
        "The third start is printed as (3.5 - x/Δt) 1e-5, x over the time step. That is read as "
        "x/dl, a place counted in elements from the head, each at its centre, as s/Δl is in the "
        "caption of the paper's Fig. 6; so this start is another motion for every N."
    )
    times = _by_body(data, found)
    if times:
        text += (
            f" Taken to the letter, with Δt = 0.01, Kirchhoff's equations give {times} "
            "at N = 3, 9, 27: nearer, and nearly the same for every N, which the paper's are not."
        )
    return text


def _findings(data: Data) -> list[str]:
    found = []
    straight = [one for one in data["onset"] if one["perturbation"] == "none"]
    if straight:
        angle = max(one["largest_angle"] for one in straight)
        exact = "bit for bit straight" if angle == 0.0 else f"straight to {angle:.1e} rad"
        found.append(
            f"**[0.1, 0] is {'an exact' if angle == 0.0 else 'no exact'} relative equilibrium of "
            f"the discrete equations**: {len(straight)} bodies are {exact} after "
            f"{straight[0]['duration']:g} s."
        )
    off = [
        one["rate"] / one["kirchhoff"] - 1.0
        for one in data["onset"]
        if one["rate"] is not None and one["perturbation"] == "epsilon"
    ]
    if off:
        found.append(
            f"**The growth is Kirchhoff's**: the {len(off)} runs from 2.2e-16 m/s, which grow "
            f"over many decades, have his rate to {min(off):+.1e} to {max(off):+.1e}."
        )
    pairs = [
        f"{implied_rate(*(PAPER_TIMES[*body, kind] for kind in ('epsilon', 'small'))):.2f} "
        f"(N = {body[0]})"
        for body in PAPER_BODIES.values()
    ]
    text = (
        "**No single rate explains the paper's times.** A growth from 2.2e-16 and one from 1e-4 "
        f"are ln(1e-4/2.2e-16)/λ apart; the paper's pairs need λ = {', '.join(pairs)} 1/s."
    )
    alone = _by_body(
        data,
        lambda mass, body: (
            f"{rate_for_onset(mass, 0.1, 1e-4, 1.0, 0.01, _small(body)):.2f} (N = {body[0]})"
        ),
    )
    if alone:
        text += (
            " The times for 1e-4 alone would need, with the same masses and a smaller rotary "
            f"inertia, λ = {alone} 1/s."
        )
    found.append(text)
    apart = []
    for one in data["onset"]:
        if one["model"] == "frozen" and one["elements"] == 27:
            other = onset_of(data, 27, 12, "epsilon", stiffness=one["stiffness"])
            if other is not None and None not in (one["time"], other["time"]):
                apart.append(abs(one["time"] - other["time"]))
    if apart:
        found.append(
            "At N = 27 with 12 panels the start of 2.2e-16 m/s was played with panels at every "
            f"step for {len(apart)} stiffnesses and with the straight body's added mass for all; "
            f"where both were, their times are {max(apart):.2f} s apart at most."
        )
    return found


def _small(body: tuple[int, int]) -> float:
    return PAPER_TIMES[*body, "small"]
