"""Where the swimmers of Figs. 4 to 7 go, and whether they turn."""

from __future__ import annotations

import math
from collections.abc import Callable

from studies.paper.judges.criteria import CURVED, RANK, STRAIGHT, TURN
from studies.paper.measures import heading_turn, way_ahead
from studies.paper.verdicts import (
    AGREE,
    Data,
    Finding,
    Value,
    above,
    all_of,
    at_most,
    larger,
    listed,
    run_of,
    value_of,
    within,
    yes,
)

__all__ = [
    "curves",
    "ix_straight",
    "less_stable",
    "same_motion",
    "semicircle",
    "swims_left",
    "v_quadrant",
    "v_unlike_iii",
    "viii_as_i",
    "viii_tighter",
]


def swims_left(names: tuple[str, ...]) -> Callable[[Data], Finding]:
    """Judge whether swimmers move head first, to the left."""

    def judge(data: Data) -> Finding:
        values = {name: value_of(data, name, way_ahead, 10.0) for name in names}
        return Finding(listed(values, "{} BL"), all_of(above(one, 0.0) for one in values.values()))

    return judge


def curves(names: tuple[str, ...], side: int) -> Callable[[Data], Finding]:
    """Judge whether paths curve to a side, 1 for the left and -1 for the right."""

    def judge(data: Data) -> Finding:
        values = {name: value_of(data, name, heading_turn, 90.0) for name in names}
        return Finding(
            "turn of the heading (left positive) " + listed(values, "{}°"),
            all_of(above(Value(side * one.value, one.bar), CURVED) for one in values.values()),
            STRAIGHT,
        )

    return judge


def same_motion(data: Data) -> Finding:
    """Judge whether i, ii and iii swim one way and curve alike, or not at all."""
    names = ("i", "ii", "iii")
    ways = {name: value_of(data, name, way_ahead, 90.0) for name in names}
    turns = {name: value_of(data, name, heading_turn, 90.0) for name in names}
    first = math.copysign(1.0, ways["i"].value)
    side = math.copysign(1.0, turns["i"].value)
    verdicts = [above(Value(first * one.value, one.bar), 0.0) for one in ways.values()]
    curved = [above(Value(side * one.value, one.bar), CURVED) for one in turns.values()]
    straight = [at_most(Value(abs(one.value), one.bar), CURVED) for one in turns.values()]
    verdicts.append(max(all_of(curved), all_of(straight), key=RANK.index))
    return Finding(
        f"head first {listed(ways, '{} BL')}; turn {listed(turns, '{}°')}",
        all_of(verdicts),
        "One motion, but a straight one: whether it curves is the row above."
        if all_of(straight) == AGREE
        else "",
    )


def _turns_by(data: Data, name: str, wanted: float) -> Finding:
    turn = value_of(data, name, heading_turn, 90.0)
    return Finding(
        f"{name}: {turn.text()}° (left positive), paper about {wanted:+.0f}°",
        within(turn, wanted, TURN),
        STRAIGHT if abs(turn.value) < CURVED else "",
    )


def semicircle(data: Data) -> Finding:
    """Judge whether iv turns by a semicircle to either side."""
    turn = value_of(data, "iv", heading_turn, 90.0)
    return Finding(
        f"iv: {turn.text()}°, paper about 180° either way",
        within(Value(abs(turn.value), turn.bar), 180.0, TURN),
        STRAIGHT if abs(turn.value) < CURVED else "",
    )


def less_stable(data: Data) -> Finding:
    """Judge whether the coarse iv turns more than i."""
    values = {
        name: value_of(data, name, lambda run: abs(heading_turn(run)), 90.0) for name in ("i", "iv")
    }
    return Finding(
        "turn " + listed(values, "{}°"),
        all_of([larger(values["iv"], values["i"]), above(values["iv"], CURVED)]),
        "Three elements make the outline coarse and not lopsided; both paths are straight.",
    )


def v_quadrant(data: Data) -> Finding:
    """Judge whether v turns by a quadrant to the right."""
    finding = _turns_by(data, "v", -90.0)
    ahead = value_of(data, "v", way_ahead, 90.0)
    way = "head first" if ahead.value > 0.0 else "tail first"
    modes = data["modes"].get("v")
    why = finding.why
    if modes is not None:
        first = modes["frequencies"][0]
        side = "above" if first < 1.0 else "below"
        why += f" Its first natural frequency is {first:.2f} Hz: the drive of 1 Hz lies {side} it."
    return Finding(f"{finding.measured}; it swims {way}, {ahead.text()} BL", finding.verdict, why)


def v_unlike_iii(data: Data) -> Finding:
    """Judge whether v swims another way than iii, or turns far more."""
    ways = {name: value_of(data, name, way_ahead, 90.0) for name in ("iii", "v")}
    turns = {
        name: value_of(data, name, lambda run: abs(heading_turn(run)), 90.0)
        for name in ("iii", "v")
    }
    forward = math.copysign(1.0, ways["iii"].value)
    turning = larger(turns["v"], Value(turns["iii"].value + TURN, turns["iii"].bar))
    other_way = above(Value(-forward * ways["v"].value, ways["v"].bar), 0.0)
    backwards = other_way == AGREE
    return Finding(
        f"head first {listed(ways, '{} BL')}; turn {listed(turns, '{}°')}",
        max(turning, other_way, key=RANK.index),
        "Different in another way: straight, and tail first. The turn is the row above."
        if backwards
        else "",
    )


def viii_as_i(data: Data) -> Finding:
    """Judge whether viii moves as i while it has its torques."""
    first, stopped = run_of(data, "i", 10.0), run_of(data, "viii", 10.0)
    upto = min(50, len(first["path"]), len(stopped["path"]))
    apart = max(
        math.dist(a, b) for a, b in zip(first["path"][:upto], stopped["path"][:upto], strict=True)
    )
    return Finding(
        f"paths of i and viii are at most {apart:.1e} m apart over {upto} s",
        yes(apart <= 1e-9),
    )


def viii_tighter(data: Data) -> Finding:
    """Judge whether viii turns after its torques have stopped."""

    def turned(run: Data) -> float:
        return math.degrees(run["heading"][-1] - run["heading"][51])

    after = value_of(data, "viii", turned, 90.0)
    return Finding(
        f"heading turns by {after.text()}° after 50 s",
        above(Value(abs(after.value), after.bar), CURVED),
        "With no total momentum the body moves only while its shape changes; what still rings is "
        "small and to and fro, and its mean neither travels nor turns.",
    )


def ix_straight(data: Data) -> Finding:
    """Judge whether the path of ix is straight."""
    turn = value_of(data, "ix", heading_turn, 90.0)
    return Finding(f"turn {turn.text()}°", at_most(Value(abs(turn.value), turn.bar), CURVED))
