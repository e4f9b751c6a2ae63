"""The driven scenes i to ix of Figs. 4 to 7: where they go, how fast they are, how they bend."""

from __future__ import annotations

import math

from studies.paper.measures import Run, heading_turn, largest_bend, net_speed, way_ahead
from studies.paper.statements.statement import (
    CLOSE,
    CURVED,
    SLOW,
    STRAIGHT,
    TURN,
    UNBENT,
    Chapter,
    Judge,
)
from studies.paper.verdicts import (
    AGREE,
    Data,
    Finding,
    MissingError,
    Value,
    above,
    all_of,
    at_least_one_of,
    at_most,
    larger,
    listed,
    ratio_of,
    run_of,
    value_of,
    values_of,
    within,
    yes,
)

__all__ = ["FIG4", "FIG5", "FIG6", "FIG7"]

FIG4, FIG5, FIG6, FIG7 = (Chapter(f"section 6, Fig. {number}") for number in (4, 5, 6, 7))
#: Shorter runs (s) say nothing of paths that the paper shows over 100 s.
_WHOLE = 90.0


# ---- judges that several statements share ------------------------------------------------------


def _swims_left(*names: str) -> Judge:
    def judge(data: Data) -> Finding:
        values = values_of(data, names, way_ahead)
        return Finding(listed(values, "{} BL"), all_of(above(one, 0.0) for one in values.values()))

    return judge


def _curves(side: int, *names: str) -> Judge:
    """Judge whether paths curve to a side, 1 for the left and -1 for the right."""

    def judge(data: Data) -> Finding:
        values = values_of(data, names, heading_turn, _WHOLE)
        return Finding(
            "turn of the heading (left positive) " + listed(values, "{}°"),
            all_of(above(Value(side * one.value, one.bar), CURVED) for one in values.values()),
            STRAIGHT,
        )

    return judge


def _fastest(first: str, *names: str) -> Judge:
    def judge(data: Data) -> Finding:
        values = values_of(data, names, net_speed)
        others = [one for name, one in values.items() if name != first]
        return Finding(
            listed(values, "{} BL/s"), all_of(larger(values[first], one) for one in others)
        )

    return judge


def _share_in_front(run: Run) -> float:
    """Return the largest joint angle of the front half, as a share of the rear half's."""
    middle = len(run["bends"]) // 2
    return float(max(run["bends"][:middle]) / max(run["bends"][middle:]))


def _bends_in_front(name: str, much: bool) -> Judge:
    def judge(data: Data) -> Finding:
        share = value_of(data, name, _share_in_front)
        return Finding(
            f"largest joint angle of the front half {share.text()} of the rear half's",
            above(share, UNBENT) if much else at_most(share, UNBENT),
        )

    return judge


def _size_of_turn(run: Run) -> float:
    return abs(heading_turn(run))


def _resonance(data: Data) -> float | None:
    """Return the first natural frequency of v (Hz)."""
    modes = data["modes"].get("v")
    return None if modes is None else modes["frequencies"][0]


# ---- Fig. 4 ------------------------------------------------------------------------------------

FIG4.states(
    "i-iii left", "orders", "i, ii and iii swim to the left", "net displacement is head first"
)(_swims_left("i", "ii", "iii"))

FIG4.states(
    "i-iii curve",
    "paths",
    "i, ii and iii curve slightly to the right",
    f"heading turns right by more than {CURVED:g}°",
)(_curves(-1, "i", "ii", "iii"))


@FIG4.states(
    "i-iii alike",
    "orders",
    "i, ii and iii show the same qualitative motion",
    f"they swim one way, and all turn to one side by more than {CURVED:g}° or none does",
)
def _alike(data: Data) -> Finding:
    names = ("i", "ii", "iii")
    ways = values_of(data, names, way_ahead, _WHOLE)
    turns = values_of(data, names, heading_turn, _WHOLE)
    first = math.copysign(1.0, ways["i"].value)
    side = math.copysign(1.0, turns["i"].value)
    one_way = [above(Value(first * one.value, one.bar), 0.0) for one in ways.values()]
    curved = all_of(above(Value(side * one.value, one.bar), CURVED) for one in turns.values())
    straight = all_of(at_most(one.size(), CURVED) for one in turns.values())
    return Finding(
        f"head first {listed(ways, '{} BL')}; turn {listed(turns, '{}°')}",
        all_of([*one_way, at_least_one_of([curved, straight])]),
        "One motion, but a straight one: whether it curves is the row above."
        if straight == AGREE
        else "",
    )


@FIG4.states(
    "nontrivial",
    "orders",
    "path and speed depend in a nontrivial way on the beam's parameters and the loading",
    f"a speed of ii or iii is more than {CLOSE:.0%} off the simple law, (torque / stiffness)²",
)
def _nontrivial(data: Data) -> Finding:
    # Where a body bends as torque over stiffness and swims as the square of its bend, twice the
    # stiffness and half the torque each leave a quarter of the speed.
    ratios = {name: ratio_of(data, name, "i", net_speed) for name in ("ii", "iii")}
    off = [Value(abs(4.0 * one.value - 1.0), 4.0 * one.bar) for one in ratios.values()]
    return Finding(
        "speed over that of i " + listed(ratios, "{}") + "; (torque over stiffness)² "
        "would give 0.25",
        at_least_one_of(above(one, CLOSE) for one in off),
        "Among these three, well below resonance, one simple law holds nearly. Beyond it, "
        "dependence on length, stiffness and frequency is anything but simple: v, and the maps.",
    )


FIG4.states("i fastest", "orders", "i is faster than ii and iii", "the speed is larger")(
    _fastest("i", "i", "ii", "iii")
)


@FIG4.states(
    "ii slower", "orders", "ii, twice as stiff, bends less and is slower", "both are smaller"
)
def _ii_slower(data: Data) -> Finding:
    bends, speeds = (values_of(data, ("i", "ii"), pick) for pick in (largest_bend, net_speed))
    return Finding(
        "largest joint angle " + listed(bends, "{} rad") + "; speed " + listed(speeds, "{} BL/s"),
        all_of(larger(one["i"], one["ii"]) for one in (bends, speeds)),
    )


@FIG4.states(
    "iii slower",
    "orders",
    "iii, with half the torque, is even slower",
    "ratio of the speeds below 1",
)
def _iii_slower(data: Data) -> Finding:
    values = values_of(data, ("ii", "iii"), net_speed)
    ratio = ratio_of(data, "iii", "ii", net_speed)
    return Finding(
        listed(values, "{} BL/s") + f"; iii over ii {ratio.text()}",
        at_most(ratio, 1.0),
        "Far below resonance the bend goes as torque over stiffness and the speed as its square, "
        "so half the torque and twice the stiffness should do nearly the same; what is left is how "
        "far each drive is from its resonance, which is nearer for the softer beam.",
    )


# ---- Fig. 5 ------------------------------------------------------------------------------------


@FIG5.states(
    "iv less stable",
    "paths",
    "the coarse iv moves less stably than i, which curves only slightly",
    f"iv turns more than i and more than {CURVED:g}°",
)
def _less_stable(data: Data) -> Finding:
    values = values_of(data, ("i", "iv"), _size_of_turn, _WHOLE)
    return Finding(
        "turn " + listed(values, "{}°"),
        all_of([larger(values["iv"], values["i"]), above(values["iv"], CURVED)]),
        "Three elements make the outline coarse and not lopsided; both paths are straight.",
    )


@FIG5.states(
    "iv semicircle",
    "paths",
    "iv passes through a semicircle in 100 s",
    f"turn within {TURN:g}° of 180°",
)
def _semicircle(data: Data) -> Finding:
    turn = value_of(data, "iv", heading_turn, _WHOLE)
    return Finding(
        f"iv: {turn.text()}°, paper about 180° either way",
        within(turn.size(), 180.0, TURN),
        STRAIGHT if abs(turn.value) < CURVED else "",
    )


@FIG5.states(
    "v quadrant",
    "paths",
    "v turns to the right through a quadrant instead of moving forward",
    f"turn within {TURN:g}° of -90°",
)
def _quadrant(data: Data) -> Finding:
    turn, ahead = (value_of(data, "v", pick, _WHOLE) for pick in (heading_turn, way_ahead))
    way = "head first" if ahead.value > 0.0 else "tail first"
    why = STRAIGHT if abs(turn.value) < CURVED else ""
    first = _resonance(data)
    if first is not None:
        side = "above" if first < 1.0 else "below"
        why += f" Its first natural frequency is {first:.2f} Hz: the drive of 1 Hz lies {side} it."
    return Finding(
        f"v: {turn.text()}° (left positive), paper about -90°; it swims {way}, {ahead.text()} BL",
        within(turn, -90.0, TURN),
        why,
    )


@FIG5.states(
    "v unlike iii",
    "orders",
    "v, twice as long as iii, moves in a qualitatively different way",
    f"it swims the other way, or turns by {TURN:g}° more",
)
def _unlike(data: Data) -> Finding:
    ways, turns = (
        values_of(data, ("iii", "v"), pick, _WHOLE) for pick in (way_ahead, _size_of_turn)
    )
    forward = math.copysign(1.0, ways["iii"].value)
    turning = larger(turns["v"], Value(turns["iii"].value + TURN, turns["iii"].bar))
    other_way = above(Value(-forward * ways["v"].value, ways["v"].bar), 0.0)
    return Finding(
        f"head first {listed(ways, '{} BL')}; turn {listed(turns, '{}°')}",
        at_least_one_of([turning, other_way]),
        "Different in another way: straight, and tail first. The turn is the row above."
        if other_way == AGREE
        else "",
    )


@FIG5.states(
    "v faster", "orders", "v moves much faster than iii", f"at least {1 / SLOW:g} times as fast"
)
def _much_faster(data: Data) -> Finding:
    def speed(run: Run) -> float:
        return float(run["speed"])

    values, ratio = values_of(data, ("iii", "v"), speed), ratio_of(data, "v", "iii", speed)
    why = "By speed alone: ours swims tail first." if way_ahead(run_of(data, "v")) < 0.0 else ""
    first = _resonance(data)
    if first is not None:
        why += f" Its first natural frequency, {first:.2f} Hz, is near the drive's 1 Hz, undamped."
    return Finding(
        f"{listed(values, '{} m/s')}; ratio {ratio.text()}", above(ratio, 1.0 / SLOW), why
    )


# ---- Fig. 6 ------------------------------------------------------------------------------------

FIG6.states(
    "vi-vii left", "orders", "vi and vii move to the left", "net displacement is head first"
)(_swims_left("vi", "vii"))

FIG6.states(
    "vi-vii curve",
    "paths",
    "vi and vii curve slightly to the left, unlike i and ii",
    f"heading turns left by more than {CURVED:g}°",
)(_curves(1, "vi", "vii"))

FIG6.states(
    "vi bends",
    "orders",
    "vi bends in its rear half only",
    "front half at most a fifth of the rear half",
)(_bends_in_front("vi", much=False))


@FIG6.states("vi slow", "orders", "vi is very slow", f"at most {SLOW:g} of the speed of i")
def _vi_slow(data: Data) -> Finding:
    values, ratio = values_of(data, ("i", "vi"), net_speed), ratio_of(data, "vi", "i", net_speed)
    return Finding(f"{listed(values, '{} BL/s')}; ratio {ratio.text()}", at_most(ratio, SLOW))


FIG6.states("vii faster", "orders", "vii is faster than vi", "the speed is larger")(
    _fastest("vii", "vi", "vii")
)

FIG6.states(
    "vii bends", "orders", "vii bends its head too", "front half more than a fifth of the rear half"
)(_bends_in_front("vii", much=True))


@FIG6.states(
    "head matters",
    "orders",
    "being able to bend the head may be important for fast swimming",
    "i and vii bend their front half by more than a fifth of the rear half, and are faster than vi",
)
def _head_matters(data: Data) -> Finding:
    shares = values_of(data, ("i", "vii"), _share_in_front)
    speeds = values_of(data, ("i", "vi", "vii"), net_speed)
    verdicts = [above(one, UNBENT) for one in shares.values()]
    verdicts += [larger(speeds[name], speeds["vi"]) for name in ("i", "vii")]
    try:
        other = value_of(data, "vi_reversed", net_speed)
        why = (
            f"A stiff tail in place of the stiff head (EI = 5, then 50) leaves "
            f"{other.text()} BL/s: it is a stiff half that costs speed, whichever it is."
        )
    except MissingError:
        why = ""
    return Finding(
        f"bends of front over rear half {listed(shares, '{}')}; speed {listed(speeds, '{} BL/s')}",
        all_of(verdicts),
        why,
    )


# ---- Fig. 7 ------------------------------------------------------------------------------------


@FIG7.states("viii as i", "orders", "until 50 s viii moves as i", "paths within 1e-9 m")
def _as_i(data: Data) -> Finding:
    first, stopped = run_of(data, "i", 10.0)["path"], run_of(data, "viii", 10.0)["path"]
    upto = min(50, len(first), len(stopped))
    apart = max(math.dist(a, b) for a, b in zip(first[:upto], stopped[:upto], strict=True))
    return Finding(
        f"paths of i and viii are at most {apart:.1e} m apart over {upto} s", yes(apart <= 1e-9)
    )


@FIG7.states(
    "viii slows",
    "orders",
    "without torques, after 50 s, viii slows down rapidly",
    "mean speed after 52 s at most a tenth of that before",
)
def _slows(data: Data) -> Finding:
    def speed(run: Run, first: int, last: int) -> float:
        way = math.dist(run["path"][first], run["path"][last])
        return way / (last - first) / float(run["length"])

    def before(run: Run) -> float:
        return speed(run, 0, 48)

    def after(run: Run) -> float:
        return speed(run, 52, len(run["path"]) - 1)

    if before(run_of(data, "viii", _WHOLE)) == 0.0:
        raise MissingError("viii does not move")
    moving, stopped = (value_of(data, "viii", pick, _WHOLE) for pick in (before, after))
    ratio = value_of(data, "viii", lambda run: after(run) / before(run), _WHOLE)
    return Finding(
        f"{moving.text()} BL/s before 50 s, {stopped.text()} after; ratio "
        f"{ratio.value:.1e} ± {ratio.bar:.0e}",
        at_most(ratio, 0.1),
        "Total momentum is zero and nothing is left behind in the fluid: a body that stops "
        "deforming stops. What still rings of the undamped modes moves it a little.",
    )


@FIG7.states(
    "viii tighter",
    "paths",
    "without torques viii moves into a tighter curve",
    f"heading turns by more than {CURVED:g}° after 50 s",
)
def _tighter(data: Data) -> Finding:
    after = value_of(
        data, "viii", lambda run: math.degrees(run["heading"][-1] - run["heading"][51]), _WHOLE
    )
    return Finding(
        f"heading turns by {after.text()}° after 50 s",
        above(after.size(), CURVED),
        "With no total momentum the body moves only while its shape changes; what still rings is "
        "small and to and fro, and its mean neither travels nor turns.",
    )


@FIG7.states(
    "ix slow",
    "orders",
    "ix moves slowly to the left",
    f"at most {SLOW:g} of the speed of i, to the left",
)
def _ix_slow(data: Data) -> Finding:
    values, ratio = values_of(data, ("i", "ix"), net_speed), ratio_of(data, "ix", "i", net_speed)
    ahead = value_of(data, "ix", way_ahead)
    return Finding(
        f"{listed(values, '{} BL/s')}; ratio {ratio.text()}; to the left {ahead.text()} BL",
        all_of([at_most(ratio, SLOW), above(ahead, 0.0)]),
    )


@FIG7.states(
    "ix straight", "paths", "ix moves on an almost straight path", f"turn at most {CURVED:g}°"
)
def _straight(data: Data) -> Finding:
    turn = value_of(data, "ix", heading_turn, _WHOLE)
    return Finding(f"turn {turn.text()}°", at_most(turn.size(), CURVED))
