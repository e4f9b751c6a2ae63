"""From the data to a finding, for every statement of the paper.

Criteria are fixed here, and stated in `swim_env.paper.statements`; the paper's own numbers are the
only ones that are written down.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from swim_env.paper.bars import bar_of
from swim_env.paper.onset import LATERAL, PAPER_TIMES
from swim_env.paper.runs import NUMERALS
from swim_env.paper.verdicts import (
    AGREE,
    DIFFER,
    UNDECIDED,
    Data,
    Finding,
    MissingError,
    Value,
    above,
    all_of,
    at_most,
    larger,
    listed,
    onset_of,
    onset_time,
    ratio_of,
    run_of,
    value_of,
    within,
    yes,
)

#: A path is curved where the heading turns by more than this in the run (degrees).
CURVED = 1.0
#: Semicircle, quadrant: a turn within this of the number (degrees).
TURN = 30.0
#: A time agrees with the paper's within this share; a simple law holds within it.
CLOSE = 0.1
#: Slow: at most this share of the speed it is compared with; much faster: its inverse at least.
SLOW = 0.5
#: Bending in one half only: at most this share of the other half's.
UNBENT = 0.2
#: What the energy may be off, and its mean may wander, as shares of the largest energy. Speed goes
#: as the square of the motion, as energy does: an error that is small beside a speed's own error
#: bar is one that nothing stated here could show. A fifth of what a run is trusted with.
ENERGY, TREND = 0.01, 0.005


def _speed(run: Data) -> float:
    """Return the net speed in body lengths a second."""
    return float(run["speed"]) / float(run["length"])


def _ahead(run: Data) -> float:
    """Return the displacement head first, to the left (body lengths)."""
    return -float(run["displacement"][0]) / float(run["length"])


def _turn(run: Data) -> float:
    """Return the turn of the heading (degrees), to the swimmer's left where it is positive."""
    return math.degrees(run["turn"])


def _bend(run: Data) -> float:
    return float(max(run["bends"]))


# ---- the method --------------------------------------------------------------------------------

_TABLE = [*NUMERALS]


def momentum(data: Data) -> Finding:
    """Judge whether the momentum maps are kept to the paper's tolerance, in all twelve runs."""
    runs = [run_of(data, name) for name in _TABLE]
    drift = max(run["momentum"]["drift"] for run in runs)
    share = max(run["momentum"]["share"] for run in runs)
    return Finding(
        f"largest drift of all twelve {drift:.1e}; {share:.1e} of its bound",
        yes(drift <= 1e-9 and share <= 1.0),
        "What a step leaves of its residual is carried into the next, so momentum is kept to "
        "round-off whatever the tolerance of Newton's method.",
    )


def energy(data: Data) -> Finding:
    """Judge whether the energy's error stays small and goes nowhere."""
    runs = {name: run_of(data, name, 10.0) for name in _TABLE}
    halves = [run_of(data, f"{name}_half", 10.0) for name in _TABLE]
    largest = max(runs, key=lambda name: runs[name]["energy"]["unexplained"])
    trends = {
        name: abs(run["energy"]["last"] - run["energy"]["first"]) for name, run in runs.items()
    }
    trend = max(trends, key=lambda name: trends[name])
    unexplained = runs[largest]["energy"]["unexplained"]
    finer = max(run["energy"]["unexplained"] for run in halves)
    return Finding(
        f"off by at most {unexplained:.1e} of the largest energy ({largest}), {finer:.1e} with "
        f"half the step; the mean of the last quarter is {trends[trend]:.1e} from that of the "
        f"first ({trend})",
        yes(max(unexplained, finer) <= ENERGY and trends[trend] <= TREND),
        "In driven runs the work of the torques is counted off; what is left stays bounded."
        + (
            " It does not shrink with the step: modes ring that neither step resolves."
            if finer >= unexplained
            else ""
        ),
    )


def large_steps(data: Data) -> Finding:
    """Judge whether our steps are large for the beam's highest mode."""
    modes = data["modes"].get("i")
    if modes is None:
        raise MissingError("no natural frequencies of scene i")
    runs = [run_of(data, name) for name in _TABLE]
    phase = 2.0 * math.pi * modes["highest"] * 0.01
    cut = sum(run["halved"] for run in runs)
    return Finding(
        f"the highest mode of i, {modes['highest']:.0f} Hz, turns by {phase:.0f} rad in a step of "
        f"10 ms; all twelve runs came to their end with {cut} steps cut",
        UNDECIDED if phase > 2.0 and cut == 0 else DIFFER,
        "That our steps are large is measured, the comparison is not: a potential taken at the "
        "last node alone is a leapfrog scheme, unstable above 2 rad, and was not run.",
    )


def spatial_order(data: Data) -> Finding:
    """Judge the order at which the beam's first bending frequency converges."""
    orders = data["modes"].get("i", {}).get("orders")
    if orders is None:
        raise MissingError("no frequencies over N")
    errors = ", ".join(f"{one:.1e}" for one in orders["errors"])
    counts = ", ".join(str(n) for n in orders["elements"])
    # How far the order itself has settled.
    order = Value(orders["order"], abs(orders["order"] - orders["before"]))
    return Finding(
        f"first frequency of the beam alone at N = {counts}: off by {errors}; order {order.text()}",
        within(order, 2.0, 0.1),
    )


# ---- Fig. 4 ------------------------------------------------------------------------------------


def swims_left(names: tuple[str, ...]) -> Callable[[Data], Finding]:
    """Judge whether swimmers move head first, to the left."""

    def judge(data: Data) -> Finding:
        values = {name: value_of(data, name, _ahead, 10.0) for name in names}
        return Finding(listed(values, "{} BL"), all_of(above(one, 0.0) for one in values.values()))

    return judge


def curves(names: tuple[str, ...], side: int) -> Callable[[Data], Finding]:
    """Judge whether paths curve to a side, 1 for the left and -1 for the right."""

    def judge(data: Data) -> Finding:
        values = {name: value_of(data, name, _turn, 90.0) for name in names}
        return Finding(
            "turn of the heading (left positive) " + listed(values, "{}°"),
            all_of(above(Value(side * one.value, one.bar), CURVED) for one in values.values()),
            _STRAIGHT,
        )

    return judge


#: The short form of it, for cells.
_STRAIGHT = "Mirror symmetry (below the table)."
#: Why a wave does not turn a body in a mirror-symmetric fluid, as long as its motion is symmetric.
SYMMETRY = (
    "The wave half a period later is its own mirror image. Where the motion is so too, the two "
    "halves turn the body by opposite angles: no steady curve to either side. The runs bear that "
    "out; symmetry alone does not rule out a start that breaks it, or a pair of mirrored cycles. "
    "One-sided sources on the centreline have no such symmetry."
)


def same_motion(data: Data) -> Finding:
    """Judge whether i, ii and iii swim one way and curve alike, or not at all."""
    names = ("i", "ii", "iii")
    ways = {name: value_of(data, name, _ahead, 90.0) for name in names}
    turns = {name: value_of(data, name, _turn, 90.0) for name in names}
    first = math.copysign(1.0, ways["i"].value)
    side = math.copysign(1.0, turns["i"].value)
    verdicts = [above(Value(first * one.value, one.bar), 0.0) for one in ways.values()]
    curved = [above(Value(side * one.value, one.bar), CURVED) for one in turns.values()]
    straight = [at_most(Value(abs(one.value), one.bar), CURVED) for one in turns.values()]
    verdicts.append(max(all_of(curved), all_of(straight), key=_RANK.index))
    return Finding(
        f"head first {listed(ways, '{} BL')}; turn {listed(turns, '{}°')}",
        all_of(verdicts),
        "One motion, but a straight one: whether it curves is the row above."
        if all_of(straight) == AGREE
        else "",
    )


#: From the worst to the best.
_RANK = [DIFFER, UNDECIDED, AGREE]


def nontrivial(data: Data) -> Finding:
    """Judge whether the speeds of i, ii and iii break the simple law of a small bend."""
    # Where a body bends as torque over stiffness and swims as the square of its bend, twice the
    # stiffness and half the torque each leave a quarter of the speed.
    ratios = {name: ratio_of(data, name, "i", _speed) for name in ("ii", "iii")}
    off = {name: Value(abs(4.0 * one.value - 1.0), 4.0 * one.bar) for name, one in ratios.items()}
    verdicts = [above(one, CLOSE) for one in off.values()]
    return Finding(
        "speed over that of i " + listed(ratios, "{}") + "; (torque over stiffness)² "
        "would give 0.25",
        max(verdicts, key=_RANK.index),
        "Among these three, well below resonance, one simple law holds nearly. Beyond it, "
        "dependence on length, stiffness and frequency is anything but simple: v, and the maps.",
    )


def i_fastest(data: Data) -> Finding:
    """Judge whether i is faster than ii and iii."""
    values = {name: value_of(data, name, _speed, 10.0) for name in ("i", "ii", "iii")}
    return Finding(
        listed(values, "{} BL/s"),
        all_of(larger(values["i"], values[name]) for name in ("ii", "iii")),
    )


def ii_bends_less(data: Data) -> Finding:
    """Judge whether the stiffer ii bends less than i and is slower."""
    bends = {name: value_of(data, name, _bend, 10.0) for name in ("i", "ii")}
    speeds = {name: value_of(data, name, _speed, 10.0) for name in ("i", "ii")}
    return Finding(
        "largest joint angle " + listed(bends, "{} rad") + "; speed " + listed(speeds, "{} BL/s"),
        all_of(larger(one["i"], one["ii"]) for one in (bends, speeds)),
    )


def iii_slower_still(data: Data) -> Finding:
    """Judge whether iii is slower than ii."""
    values = {name: value_of(data, name, _speed, 10.0) for name in ("ii", "iii")}
    ratio = ratio_of(data, "iii", "ii", _speed)
    return Finding(
        listed(values, "{} BL/s") + f"; iii over ii {ratio.text()}",
        at_most(ratio, 1.0),
        "Far below resonance the bend goes as torque over stiffness and the speed as its square, "
        "so half the torque and twice the stiffness should do nearly the same; what is left is how "
        "far each drive is from its resonance, which is nearer for the softer beam.",
    )


# ---- Fig. 5 ------------------------------------------------------------------------------------


def _turns_by(data: Data, name: str, wanted: float) -> Finding:
    turn = value_of(data, name, _turn, 90.0)
    return Finding(
        f"{name}: {turn.text()}° (left positive), paper about {wanted:+.0f}°",
        within(turn, wanted, TURN),
        _STRAIGHT if abs(turn.value) < CURVED else "",
    )


def semicircle(data: Data) -> Finding:
    """Judge whether iv turns by a semicircle to either side."""
    turn = value_of(data, "iv", _turn, 90.0)
    return Finding(
        f"iv: {turn.text()}°, paper about 180° either way",
        within(Value(abs(turn.value), turn.bar), 180.0, TURN),
        _STRAIGHT if abs(turn.value) < CURVED else "",
    )


def less_stable(data: Data) -> Finding:
    """Judge whether the coarse iv turns more than i."""
    values = {name: value_of(data, name, lambda run: abs(_turn(run)), 90.0) for name in ("i", "iv")}
    return Finding(
        "turn " + listed(values, "{}°"),
        all_of([larger(values["iv"], values["i"]), above(values["iv"], CURVED)]),
        "Three elements make the outline coarse and not lopsided; both paths are straight.",
    )


def v_quadrant(data: Data) -> Finding:
    """Judge whether v turns by a quadrant to the right."""
    finding = _turns_by(data, "v", -90.0)
    ahead = value_of(data, "v", _ahead, 90.0)
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
    ways = {name: value_of(data, name, _ahead, 90.0) for name in ("iii", "v")}
    turns = {name: value_of(data, name, lambda run: abs(_turn(run)), 90.0) for name in ("iii", "v")}
    forward = math.copysign(1.0, ways["iii"].value)
    turning = larger(turns["v"], Value(turns["iii"].value + TURN, turns["iii"].bar))
    other_way = above(Value(-forward * ways["v"].value, ways["v"].bar), 0.0)
    backwards = other_way == AGREE
    return Finding(
        f"head first {listed(ways, '{} BL')}; turn {listed(turns, '{}°')}",
        max(turning, other_way, key=_RANK.index),
        "Different in another way: straight, and tail first. The turn is the row above."
        if backwards
        else "",
    )


def v_much_faster(data: Data) -> Finding:
    """Judge whether v is much faster than iii."""
    values = {
        name: value_of(data, name, lambda run: float(run["speed"]), 10.0) for name in ("iii", "v")
    }
    ratio = ratio_of(data, "v", "iii", lambda run: float(run["speed"]))
    why = "By speed alone: ours swims tail first." if _ahead(run_of(data, "v")) < 0.0 else ""
    modes = data["modes"].get("v")
    if modes is not None:
        first = modes["frequencies"][0]
        why += f" Its first natural frequency, {first:.2f} Hz, is near the drive's 1 Hz, undamped."
    return Finding(
        f"{listed(values, '{} m/s')}; ratio {ratio.text()}",
        above(ratio, 1.0 / SLOW),
        why,
    )


# ---- Fig. 6 ------------------------------------------------------------------------------------


def _share_in_front(data: Data, name: str) -> Value:
    """Return the largest joint angle of the front half, as a share of the rear half's."""

    def pick(run: Data) -> float:
        bends = run["bends"]
        middle = len(bends) // 2
        return float(max(bends[:middle]) / max(bends[middle:]))

    return value_of(data, name, pick, 10.0)


def vi_bends_behind(data: Data) -> Finding:
    """Judge whether vi bends in its rear half alone."""
    share = _share_in_front(data, "vi")
    return Finding(
        f"largest joint angle of the front half {share.text()} of the rear half's",
        at_most(share, UNBENT),
    )


def vii_bends_in_front(data: Data) -> Finding:
    """Judge whether vii bends its front half too."""
    share = _share_in_front(data, "vii")
    return Finding(
        f"largest joint angle of the front half {share.text()} of the rear half's",
        above(share, UNBENT),
    )


def vi_slow(data: Data) -> Finding:
    """Judge whether vi is slow beside i."""
    values = {name: value_of(data, name, _speed, 10.0) for name in ("i", "vi")}
    ratio = ratio_of(data, "vi", "i", _speed)
    return Finding(f"{listed(values, '{} BL/s')}; ratio {ratio.text()}", at_most(ratio, SLOW))


def vii_faster(data: Data) -> Finding:
    """Judge whether vii is faster than vi."""
    values = {name: value_of(data, name, _speed, 10.0) for name in ("vi", "vii")}
    return Finding(listed(values, "{} BL/s"), larger(values["vii"], values["vi"]))


def head_matters(data: Data) -> Finding:
    """Judge whether those that bend their head are faster than vi, which cannot."""
    shares = {name: _share_in_front(data, name) for name in ("i", "vii")}
    speeds = {name: value_of(data, name, _speed, 10.0) for name in ("i", "vi", "vii")}
    verdicts = [above(one, UNBENT) for one in shares.values()]
    verdicts += [larger(speeds[name], speeds["vi"]) for name in ("i", "vii")]
    try:
        other = value_of(data, "vi_reversed", _speed, 10.0)
        why = (
            f"A stiff tail in place of the stiff head (EI = 5, then 50) leaves "
            f"{other.text()} BL/s: it is a stiff half that costs speed, whichever it is."
        )
    except MissingError:
        why = ""
    return Finding(
        "bends of front over rear half "
        + listed(shares, "{}")
        + "; speed "
        + listed(speeds, "{} BL/s"),
        all_of(verdicts),
        why,
    )


# ---- Fig. 7 ------------------------------------------------------------------------------------


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


def _speed_between(run: Data, first: int, last: int) -> float:
    a, b = run["path"][first], run["path"][last]
    return math.dist(a, b) / (last - first) / float(run["length"])


def viii_slows(data: Data) -> Finding:
    """Judge whether viii stops once its torques do."""

    def before(run: Data) -> float:
        return _speed_between(run, 0, 48)

    def after(run: Data) -> float:
        return _speed_between(run, 52, len(run["path"]) - 1)

    if before(run_of(data, "viii", 90.0)) == 0.0:
        raise MissingError("viii does not move")
    speeds = [value_of(data, "viii", pick, 90.0) for pick in (before, after)]
    ratio = value_of(data, "viii", lambda run: after(run) / before(run), 90.0)
    return Finding(
        f"{speeds[0].text()} BL/s before 50 s, {speeds[1].text()} after; ratio "
        f"{ratio.value:.1e} ± {ratio.bar:.0e}",
        at_most(ratio, 0.1),
        "Total momentum is zero and nothing is left behind in the fluid: a body that stops "
        "deforming stops. What still rings of the undamped modes moves it a little.",
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


def ix_slow(data: Data) -> Finding:
    """Judge whether ix is slow beside i, and swims to the left."""
    values = {name: value_of(data, name, _speed, 10.0) for name in ("i", "ix")}
    ahead = value_of(data, "ix", _ahead, 10.0)
    ratio = ratio_of(data, "ix", "i", _speed)
    return Finding(
        f"{listed(values, '{} BL/s')}; ratio {ratio.text()}; to the left {ahead.text()} BL",
        all_of([at_most(ratio, SLOW), above(ahead, 0.0)]),
    )


def ix_straight(data: Data) -> Finding:
    """Judge whether the path of ix is straight."""
    turn = value_of(data, "ix", _turn, 90.0)
    return Finding(f"turn {turn.text()}°", at_most(Value(abs(turn.value), turn.bar), CURVED))


# ---- the passive body --------------------------------------------------------------------------


def equilibrium(data: Data) -> Finding:
    """Judge whether the straight body stays straight at [0.1, 0]."""
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


#: The starts as they are called on the page.
KINDS = {"epsilon": "2.2e-16", "small": "1e-4", "sloped": "sloped"}


def _time(data: Data, elements: int, panels: int, kind: str) -> Value:
    time = onset_time(data, elements, panels, kind)
    if time is None:
        raise MissingError(f"no onset within the run, N = {elements}, {KINDS[kind]}")
    return time


def times(elements: int, panels: int) -> Callable[[Data], Finding]:
    """Judge the times of first deviations against the paper's."""

    def judge(data: Data) -> Finding:
        parts, verdicts = [], []
        for kind, name in KINDS.items():
            ours = onset_time(data, elements, panels, kind)
            paper = PAPER_TIMES[elements, panels, kind]
            shown = "none" if ours is None else f"{ours.text()} s"
            parts.append(f"{name}: {shown} (paper {paper:g})")
            verdicts.append(DIFFER if ours is None else within(ours, paper, CLOSE * paper))
        found = onset_of(data, elements, panels, "epsilon")
        assert found is not None
        rate = "not at all" if found["rate"] is None else f"at {found['rate']:.4f} 1/s"
        return Finding(
            "; ".join(parts),
            all_of(verdicts),
            f"Ours grow {rate}, Kirchhoff's equations at {found['kirchhoff']:.4f}; the paper's "
            "own times need several rates at once (Stability).",
        )

    return judge


def panels_matter(elements: int, earlier: bool) -> Callable[[Data], Finding]:
    """Judge how little 12 panels in place of 4 change the times, and whether they are earlier."""

    def judge(data: Data) -> Finding:
        parts, verdicts = [], []
        for kind, name in KINDS.items():
            few, many = (_time(data, elements, panels, kind) for panels in (4, 12))
            verdicts.append(within(many.over(few), 1.0, 0.02))
            if earlier:
                verdicts.append(larger(few, many))
            parts.append(f"{name}: {few.text()} and {many.text()} s")
        rates = []
        for panels in (4, 12):
            found = onset_of(data, elements, panels, "small")
            assert found is not None
            rates.append(found["kirchhoff"])
        why = (
            f"Kirchhoff's rate with the body's own masses is {rates[0]:.4f} and {rates[1]:.4f} 1/s."
        )
        return Finding(f"4 and 12 panels: {'; '.join(parts)}", all_of(verdicts), why)

    return judge


def stiffness(data: Data) -> Finding:
    """Judge whether the times hang on the stiffness."""
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
        f"{worst[1]} panels, {KINDS[worst[2]]})",
        all_of(at_most(one, 0.01) for one in spreads.values()),
        "The body stays straight, and a straight body has nothing to spring back.",
    )


#: The settings of the paper's three discretisations.
_PAPERS = ((3, 12), (9, 4), (27, 4))


def _small_times(data: Data) -> dict[int, Value]:
    return {n: _time(data, n, panels, "small") for n, panels in _PAPERS}


def coarse_unstable(data: Data) -> Finding:
    """Judge whether the coarse body leaves its line much sooner than the finer ones."""
    found = _small_times(data)
    ratios = {f"N = {n}": found[3].over(found[n]) for n in (9, 27)}
    return Finding(
        "; ".join(f"N = {n}: {one.text()} s" for n, one in found.items())
        + "; that of N = 3 over that of "
        + listed(ratios, "{}"),
        all_of(at_most(one, 0.5) for one in ratios.values()),
        "No body is more unstable for being coarse here: a straight row of any number of elements "
        "is one rigid body to the fluid.",
    )


def delayed(data: Data) -> Finding:
    """Judge whether finer bodies leave their line later."""
    found = _small_times(data)
    sloped = [_time(data, n, panels, "sloped") for n, panels in _PAPERS]
    low, high = (choose(one.value for one in found.values()) for choose in (min, max))
    paper = ", ".join(f"{PAPER_TIMES[n, panels, 'sloped']:g}" for n, panels in _PAPERS)
    return Finding(
        "; ".join(f"N = {n}: {one.text()} s" for n, one in found.items()),
        all_of(above(found[b].over(found[a]), 1.05) for a, b in ((3, 9), (9, 27))),
        f"The onset is the rigid body's, whose masses hardly hang on N: the times are "
        f"{high - low:.2f} s apart. The sloped start says nothing of N, as it counts x in elements "
        "and so is another motion for every N: "
        + ", ".join(f"{one.value:.1f}" for one in sloped)
        + f" s in ours, {paper} s in the paper, neither in one direction.",
    )


def x_turns(data: Data) -> Finding:
    """Judge how far x has turned at 10 s."""
    turn = value_of(data, "x", lambda run: math.degrees(run["angle"][10]), 10.0)
    run = run_of(data, "x", 10.0)
    late = next((n for n, a in enumerate(run["angle"]) if abs(math.degrees(a)) > 150.0), None)
    shown = "not in this run" if late is None else f"past 150° after {late} s"
    return Finding(
        f"turned by {turn.text()}° at t = 10 s; {shown}",
        within(Value(abs(turn.value), turn.bar), 180.0, TURN),
        "The same fate, later: the growth is that of Kirchhoff's equations, several times slower "
        "than the paper's.",
    )


def xi_as_xii(data: Data) -> Finding:
    """Judge whether xi and xii move alike."""

    def apart(level: str) -> tuple[float, float]:
        one, other = (run_of(data, f"{name}{level}", 10.0) for name in ("xi", "xii"))
        turns = [
            abs(math.degrees(a - b)) for a, b in zip(one["angle"], other["angle"], strict=True)
        ]
        places = (math.dist(a, b) for a, b in zip(one["path"], other["path"], strict=True))
        return max(turns), max(places)

    # What step and panels do to both alike cancels here too.
    levels = [apart(level) for level in ("", "_half", "_fine")]
    turn, way = (Value(levels[0][i], bar_of(*(one[i] for one in levels)) or 0.0) for i in (0, 1))
    duration = run_of(data, "xi")["duration"]
    return Finding(
        f"headings at most {turn.text()}° and centres at most {way.text()} m apart in "
        f"{duration:g} s",
        all_of([at_most(turn, 10.0), at_most(way, 0.1)]),
    )


# ---- conclusions -------------------------------------------------------------------------------


def net_locomotion(data: Data) -> Finding:
    """Judge whether i gets anywhere from rest."""
    ahead = value_of(data, "i", _ahead, 10.0)
    drift = run_of(data, "i")["momentum"]["drift"]
    return Finding(
        f"i: {ahead.text()} BL from rest, total momentum within {drift:.1e} of zero",
        above(Value(abs(ahead.value), ahead.bar), 0.0),
    )


def alone(data: Data) -> Finding:
    """Judge whether i stays where it is without a fluid."""
    run = run_of(data, "i_alone")
    moved = math.hypot(*run["displacement"])
    return Finding(
        f"i without fluid: moves by {moved:.1e} m, turns by {_turn(run):.1e}°",
        yes(moved <= 1e-9),
        "Torques are internal: without a fluid the centre of mass stays.",
    )


assert set(LATERAL) == set(KINDS)
