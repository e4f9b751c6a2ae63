"""The passive body of Fig. 8: when it leaves its line, and what that depends on."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

from studies.paper.bars import bar_of
from studies.paper.onset import LATERAL, PAPER_BODIES, PAPER_TIMES
from studies.paper.statements.judges import Judge
from studies.paper.statements.limits import CLOSE, TURN
from studies.paper.verdicts import (
    DIFFER,
    LEVELS,
    Data,
    Finding,
    MissingError,
    Value,
    all_of,
    listed,
    onset_of,
    onset_time,
    run_of,
    value_of,
    yes,
)

#: The starts as they are called on the page.
_STARTS = dict(zip(LATERAL, ("2.2e-16", "1e-4", "sloped"), strict=True))


def _time(data: Data, elements: int, panels: int, kind: str) -> Value:
    time = onset_time(data, elements, panels, kind)
    if time is None:
        raise MissingError(f"no onset within the run, N = {elements}, {_STARTS[kind]}")
    return time


def _times(data: Data, kind: str) -> dict[int, Value]:
    """Return the times of the paper's three bodies by their number of elements."""
    return {n: _time(data, n, panels, kind) for n, panels in PAPER_BODIES.values()}


def _equilibrium(data: Data) -> Finding:
    runs = [one for one in data["onset"] if one["perturbation"] == "none"]
    if not {(3, 12), (9, 4)} <= {(one["elements"], one["panels"]) for one in runs}:
        raise MissingError("no runs at [0.1, 0]")
    angle = max(one["largest_angle"] for one in runs)
    offset = max(one["largest_offset"] for one in runs)
    ended = any(one["end"] for one in runs)
    return Finding(
        f"{len(runs)} bodies: largest angle {angle:.1e} rad, largest offset of an end "
        f"{offset:.1e} m in {runs[0]['duration']:g} s",
        yes(not ended and offset <= 0.01 and angle <= 0.01),
        "Exactly straight to the last bit: it is a relative equilibrium of the discrete equations."
        if angle == 0.0
        else "",
    )


def _as_the_papers(elements: int, panels: int, data: Data) -> Finding:
    parts, verdicts = [], []
    for kind, name in _STARTS.items():
        ours = onset_time(data, elements, panels, kind)
        paper = PAPER_TIMES[elements, panels, kind]
        shown = "none" if ours is None else f"{ours.text()} s"
        parts.append(f"{name}: {shown} (paper {paper:g})")
        verdicts.append(DIFFER if ours is None else ours.within(paper, CLOSE * paper))
    found = onset_of(data, elements, panels, "epsilon")
    assert found is not None
    rate = "not at all" if found["rate"] is None else f"at {found['rate']:.4f} 1/s"
    return Finding(
        "; ".join(parts),
        all_of(verdicts),
        f"Ours grow {rate}, Kirchhoff's equations at {found['kirchhoff']:.4f}; the paper's own "
        "times need several rates at once (Stability).",
    )


def _panels_matter(elements: int, earlier: bool, data: Data) -> Finding:
    """Judge how little 12 panels in place of 4 change the times, and whether they are earlier."""
    parts, verdicts = [], []
    for kind, name in _STARTS.items():
        few, many = (_time(data, elements, panels, kind) for panels in (4, 12))
        verdicts.append(many.over(few).within(1.0, 0.02))
        if earlier:
            verdicts.append(few.larger_than(many))
        parts.append(f"{name}: {few.text()} and {many.text()} s")
    found = [onset_of(data, elements, panels, "small") for panels in (4, 12)]
    rates = " and ".join(f"{one['kirchhoff']:.4f}" for one in found if one is not None)
    return Finding(
        f"4 and 12 panels: {'; '.join(parts)}",
        all_of(verdicts),
        f"Kirchhoff's rate with the body's own masses is {rates} 1/s.",
    )


def _stiffness(data: Data) -> Finding:
    groups: dict[tuple[Any, ...], list[float | None]] = {}
    for one in data["onset"]:
        if one["perturbation"] != "none" and one["step"] == 0.01:
            key = (one["elements"], one["panels"], one["perturbation"])
            groups.setdefault(key, []).append(one["time"])
    spreads = {}
    for key, found in groups.items():
        known = [time for time in found if time is not None]
        if len(found) < 2:
            continue
        if len(known) < len(found):
            spreads[key] = Value(math.inf, 0.0)
            continue
        # Both ends of the spread have the bar of the step.
        bar = 2.0 * _time(data, *key).bar / min(known)
        spreads[key] = Value((max(known) - min(known)) / min(known), bar)
    if not spreads:
        raise MissingError("no second stiffness")
    worst = max(spreads, key=lambda key: spreads[key].value)
    return Finding(
        f"over {len(spreads)} bodies and starts the time varies by at most "
        f"{spreads[worst].value:.1e} ± {spreads[worst].bar:.0e} of itself (N = {worst[0]}, "
        f"{worst[1]} panels, {_STARTS[worst[2]]})",
        all_of(one.at_most(0.01) for one in spreads.values()),
    )


def _x_turns(data: Data) -> Finding:
    turn = value_of(data, "x", lambda run: math.degrees(run["angle"][10]))
    angles = run_of(data, "x", 10.0)["angle"]
    late = next((n for n, angle in enumerate(angles) if abs(math.degrees(angle)) > 150.0), None)
    shown = "not in this run" if late is None else f"past 150° after {late} s"
    return Finding(
        f"turned by {turn.text()}° at t = 10 s; {shown}",
        turn.size().within(180.0, TURN),
    )


def _coarse_unstable(data: Data) -> Finding:
    found = _times(data, "small")
    ratios = {f"N = 3 over N = {n}": found[3].over(found[n]) for n in (9, 27)}
    return Finding(
        "; ".join(f"N = {n}: {one.text()} s" for n, one in found.items())
        + "; "
        + listed(ratios, "{}"),
        all_of(one.at_most(0.5) for one in ratios.values()),
    )


def _alike(data: Data) -> Finding:
    def apart(level: str) -> tuple[float, float]:
        one, other = (run_of(data, f"{name}{level}", 10.0) for name in ("xi", "xii"))
        angles, paths = (zip(one[x], other[x], strict=True) for x in ("angle", "path"))
        turn = max(abs(math.degrees(a - b)) for a, b in angles)
        return turn, max(math.dist(a, b) for a, b in paths)

    # What step and panels do to both alike cancels here too.
    levels = [apart(level) for level in LEVELS]
    turn, way = (Value(levels[0][i], bar_of(*(one[i] for one in levels)) or 0.0) for i in (0, 1))
    duration = run_of(data, "xi")["duration"]
    return Finding(
        f"headings at most {turn.text()}° and centres at most {way.text()} m apart in "
        f"{duration:g} s",
        all_of([turn.at_most(10.0), way.at_most(0.1)]),
    )


def _delayed(data: Data) -> Finding:
    found, sloped = (_times(data, kind) for kind in ("small", "sloped"))
    low, high = (choose(one.value for one in found.values()) for choose in (min, max))
    ours = ", ".join(f"{one.value:.1f}" for one in sloped.values())
    paper = ", ".join(f"{PAPER_TIMES[*body, 'sloped']:g}" for body in PAPER_BODIES.values())
    return Finding(
        "; ".join(f"N = {n}: {one.text()} s" for n, one in found.items()),
        all_of(found[b].over(found[a]).above(1.05) for a, b in ((3, 9), (9, 27))),
        f"The onset is the rigid body's, whose masses hardly depend on N: the times are "
        f"{high - low:.2f} s apart. The sloped start says nothing of N, as it counts x in elements "
        f"and so is another motion for every N: {ours} s in ours, {paper} s in the paper, neither "
        "in one direction.",
    )


JUDGES: dict[str, Judge] = {
    "equilibrium": _equilibrium,
    **{
        f"times {n} {panels}": partial(_as_the_papers, n, panels)
        for n, panels in ((3, 12), (9, 4), (9, 12), (27, 4))
    },
    "12 panels": partial(_panels_matter, 9, True),
    "27 panels": partial(_panels_matter, 27, False),
    "stiffness": _stiffness,
    "x turns": _x_turns,
    "coarse unstable": _coarse_unstable,
    "xi as xii": _alike,
    "delayed": _delayed,
}
