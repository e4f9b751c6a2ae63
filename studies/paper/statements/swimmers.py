"""The driven scenes i to ix of Figs. 4 to 7: where they go, how fast they are, how they bend."""

from __future__ import annotations

import math
from contextlib import suppress

from studies.paper.measures import Run, heading_turn, largest_bend, net_speed, way_ahead
from studies.paper.statements.judges import WHOLE, Judge, compared, each, in_ratio
from studies.paper.statements.limits import CLOSE, CURVED, FAST, SLOW, STRAIGHT, TURN, UNBENT
from studies.paper.verdicts import (
    AGREE,
    Data,
    Finding,
    MissingError,
    Value,
    all_of,
    at_least_one_of,
    listed,
    ratio_of,
    run_of,
    value_of,
    values_of,
    yes,
)


def _speed(run: Run) -> float:
    return float(run["speed"])


def _size_of_turn(run: Run) -> float:
    return abs(heading_turn(run))


def _share_in_front(run: Run) -> float:
    """Return the largest joint angle of the front half, as a share of the rear half's."""
    middle = len(run["bends"]) // 2
    return float(max(run["bends"][:middle]) / max(run["bends"][middle:]))


def _with_resonance(data: Data, why: str, words: str) -> str:
    """Return a reason, and what the first natural frequency of v (Hz) has to do with it."""
    if "v" not in data["modes"]:
        return why
    first = data["modes"]["v"]["frequencies"][0]
    return why + words.format(first, side="above" if first < 1.0 else "below")


def _is_ahead(way: Value) -> str:
    return way.above(0.0)


def _alike(data: Data) -> Finding:
    names = ("i", "ii", "iii")
    ways, turns = (values_of(data, names, pick, WHOLE) for pick in (way_ahead, heading_turn))
    first = math.copysign(1.0, ways["i"].value)
    side = math.copysign(1.0, turns["i"].value)
    one_way = [one.times(first).above(0.0) for one in ways.values()]
    curved = all_of(one.times(side).above(CURVED) for one in turns.values())
    straight = all_of(one.size().at_most(CURVED) for one in turns.values())
    return Finding(
        f"head first {listed(ways, '{} BL')}; turn {listed(turns, '{}°')}",
        all_of([*one_way, at_least_one_of([curved, straight])]),
        "One motion, but a straight one: whether it curves is the row above."
        if straight == AGREE
        else "",
    )


def _nontrivial(data: Data) -> Finding:
    # Where a body bends as torque over stiffness and swims as the square of its bend, twice the
    # stiffness and half the torque each leave a quarter of the speed.
    ratios = {name: ratio_of(data, name, "i", net_speed) for name in ("ii", "iii")}
    off = [Value(abs(4.0 * one.value - 1.0), 4.0 * one.bar) for one in ratios.values()]
    return Finding(
        f"speed over that of i {listed(ratios, '{}')}; (torque over stiffness)² would give 0.25",
        at_least_one_of(one.above(CLOSE) for one in off),
    )


def _ii_slower(data: Data) -> Finding:
    bends, speeds = (values_of(data, ("i", "ii"), pick) for pick in (largest_bend, net_speed))
    return Finding(
        f"largest joint angle {listed(bends, '{} rad')}; speed {listed(speeds, '{} BL/s')}",
        all_of(one["i"].larger_than(one["ii"]) for one in (bends, speeds)),
    )


def _semicircle(data: Data) -> Finding:
    turn = value_of(data, "iv", heading_turn, WHOLE)
    return Finding(
        f"iv: {turn.text()}°, paper about 180° either way",
        turn.size().within(180.0, TURN),
        STRAIGHT if abs(turn.value) < CURVED else "",
    )


def _quadrant(data: Data) -> Finding:
    turn, ahead = (value_of(data, "v", pick, WHOLE) for pick in (heading_turn, way_ahead))
    way = "head first" if ahead.value > 0.0 else "tail first"
    why = STRAIGHT if abs(turn.value) < CURVED else ""
    words = " Its first natural frequency is {:.2f} Hz: the drive of 1 Hz lies {side} it."
    return Finding(
        f"v: {turn.text()}° (left positive), paper about -90°; it swims {way}, {ahead.text()} BL",
        turn.within(-90.0, TURN),
        _with_resonance(data, why, words),
    )


def _unlike(data: Data) -> Finding:
    names = ("iii", "v")
    ways, turns = (values_of(data, names, pick, WHOLE) for pick in (way_ahead, _size_of_turn))
    forward = math.copysign(1.0, ways["iii"].value)
    turning = turns["v"].larger_than(Value(turns["iii"].value + TURN, turns["iii"].bar))
    other_way = ways["v"].times(-forward).above(0.0)
    return Finding(
        f"head first {listed(ways, '{} BL')}; turn {listed(turns, '{}°')}",
        at_least_one_of([turning, other_way]),
        "Different in another way: straight, and tail first. The turn is the row above."
        if other_way == AGREE
        else "",
    )


def _much_faster(data: Data) -> Finding:
    values, ratio = values_of(data, ("iii", "v"), _speed), ratio_of(data, "v", "iii", _speed)
    why = "By speed alone: ours swims tail first." if way_ahead(run_of(data, "v")) < 0.0 else ""
    words = " Its first natural frequency, {:.2f} Hz, is near the drive's 1 Hz, undamped."
    why = _with_resonance(data, why, words)
    return Finding(f"{listed(values, '{} m/s')}; ratio {ratio.text()}", ratio.above(FAST), why)


def _head_matters(data: Data) -> Finding:
    shares = values_of(data, ("i", "vii"), _share_in_front)
    speeds = values_of(data, ("i", "vi", "vii"), net_speed)
    verdicts = [one.above(UNBENT) for one in shares.values()]
    verdicts += [speeds[name].larger_than(speeds["vi"]) for name in ("i", "vii")]
    why = ""
    with suppress(MissingError):
        why = (
            "A stiff tail in place of the stiff head (EI = 5, then 50) leaves "
            f"{value_of(data, 'vi_reversed', net_speed).text()} BL/s: it is a stiff half that "
            "costs speed, whichever it is."
        )
    return Finding(
        f"bends of front over rear half {listed(shares, '{}')}; speed {listed(speeds, '{} BL/s')}",
        all_of(verdicts),
        why,
    )


def _as_i(data: Data) -> Finding:
    first, stopped = run_of(data, "i", 10.0)["path"], run_of(data, "viii", 10.0)["path"]
    upto = min(50, len(first), len(stopped))
    apart = max(math.dist(a, b) for a, b in zip(first[:upto], stopped[:upto], strict=True))
    return Finding(
        f"paths of i and viii are at most {apart:.1e} m apart over {upto} s", yes(apart <= 1e-9)
    )


def _slows(data: Data) -> Finding:
    def speed(run: Run, first: int, last: int) -> float:
        way = math.dist(run["path"][first], run["path"][last])
        return way / (last - first) / float(run["length"])

    def before(run: Run) -> float:
        return speed(run, 0, 48)

    def after(run: Run) -> float:
        return speed(run, 52, len(run["path"]) - 1)

    if before(run_of(data, "viii", WHOLE)) == 0.0:
        raise MissingError("viii does not move")
    moving, stopped = (value_of(data, "viii", pick, WHOLE) for pick in (before, after))
    ratio = value_of(data, "viii", lambda run: after(run) / before(run), WHOLE)
    return Finding(
        f"{moving.text()} BL/s before 50 s, {stopped.text()} after; ratio "
        f"{ratio.value:.1e} ± {ratio.bar:.0e}",
        ratio.at_most(0.1),
    )


def _ix_slow(data: Data) -> Finding:
    slow = in_ratio("ix", "i", lambda ratio: ratio.at_most(SLOW))(data)
    ahead = value_of(data, "ix", way_ahead)
    return Finding(
        f"{slow.measured}; to the left {ahead.text()} BL",
        all_of([slow.verdict, ahead.above(0.0)]),
    )


def _curves(names: str, side: float) -> Judge:
    """Judge whether paths curve to a side, 1 for the left and -1 for the right."""
    rule = each(lambda turn: turn.times(side).above(CURVED))
    before = "turn of the heading (left positive) "
    return compared(names, heading_turn, "{}°", rule, WHOLE, before)


_FRONT = "largest joint angle of the front half {} of the rear half's"

JUDGES: dict[str, Judge] = {
    "i-iii left": compared("i ii iii", way_ahead, "{} BL", each(_is_ahead)),
    "i-iii curve": _curves("i ii iii", -1.0),
    "i-iii alike": _alike,
    "nontrivial": _nontrivial,
    "i fastest": compared(
        "i ii iii",
        net_speed,
        "{} BL/s",
        lambda first, *others: all_of(first.larger_than(other) for other in others),
    ),
    "ii slower": _ii_slower,
    "iii slower": in_ratio("iii", "ii", lambda ratio: ratio.at_most(1.0), "iii over ii"),
    "iv less stable": compared(
        "i iv",
        _size_of_turn,
        "{}°",
        lambda i, iv: all_of([iv.larger_than(i), iv.above(CURVED)]),
        WHOLE,
        "turn ",
    ),
    "iv semicircle": _semicircle,
    "v quadrant": _quadrant,
    "v unlike iii": _unlike,
    "v faster": _much_faster,
    "vi-vii left": compared("vi vii", way_ahead, "{} BL", each(_is_ahead)),
    "vi-vii curve": _curves("vi vii", 1.0),
    "vi bends": compared("vi", _share_in_front, _FRONT, lambda share: share.at_most(UNBENT)),
    "vi slow": in_ratio("vi", "i", lambda ratio: ratio.at_most(SLOW)),
    "vii faster": compared("vi vii", net_speed, "{} BL/s", lambda vi, vii: vii.larger_than(vi)),
    "vii bends": compared("vii", _share_in_front, _FRONT, lambda share: share.above(UNBENT)),
    "head matters": _head_matters,
    "viii as i": _as_i,
    "viii slows": _slows,
    "viii tighter": compared(
        "viii",
        lambda run: math.degrees(run["heading"][-1] - run["heading"][51]),
        "heading turns by {}° after 50 s",
        lambda turn: turn.size().above(CURVED),
        WHOLE,
    ),
    "ix slow": _ix_slow,
    "ix straight": compared(
        "ix", heading_turn, "turn {}°", lambda turn: turn.size().at_most(CURVED), WHOLE
    ),
}
