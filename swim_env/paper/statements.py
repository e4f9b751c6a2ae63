"""What the paper states, what is measured of it, and by which criterion the two agree or differ.

Each statement is a short paraphrase with its place, and a function that reads the data and returns
a finding. Criteria are fixed here and stated on the page; the paper's own numbers are the only
ones that are written down. Where two figures are compared, their error bars count: what is closer
than both together is undecided.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from swim_env.paper.onset import LATERAL, PAPER_TIMES
from swim_env.paper.runs import NUMERALS, bar_of, bar_text, number_text

__all__ = [
    "AGREE",
    "DIFFER",
    "NOT_MEASURED",
    "STATEMENTS",
    "SYMMETRY",
    "UNDECIDED",
    "Finding",
    "Statement",
    "find_all",
    "onset_of",
]

Data = Mapping[str, Any]

AGREE, DIFFER, UNDECIDED, NOT_MEASURED = "agree", "differ", "undecided", "not measured"

#: A path is curved where the heading turns by more than this in the run (degrees).
CURVED = 1.0
#: Semicircle, quadrant: a turn within this of the number (degrees).
_TURN = 30.0
#: A time agrees with the paper's within this share.
_TIME = 0.1
#: Slow: at most this share of the speed it is compared with; much faster: its inverse at least.
_SLOW = 0.5


class _Missing(Exception):
    """The data do not hold what a statement needs."""


@dataclass(frozen=True)
class Finding:
    """What came of a statement.

    Attributes
    ----------
    measured : str
        Our figures in words, with error bars.
    verdict : str
        One of AGREE, DIFFER, UNDECIDED and NOT_MEASURED.
    why : str
        The reason, where it is known.
    """

    measured: str
    verdict: str
    why: str = ""


@dataclass(frozen=True)
class Statement:
    """A sentence of the paper that states a result.

    Attributes
    ----------
    key : str
        Short name.
    where : str
        Section and paragraph, or figure.
    says : str
        What it says, in few words.
    criterion : str
        When the two agree.
    judge : callable
        From the data to a `Finding`.
    """

    key: str
    where: str
    says: str
    criterion: str
    judge: Callable[[Data], Finding]


def find_all(data: Data) -> list[tuple[Statement, Finding]]:
    """Return every statement with what the data say of it; missing data are said to be missing."""
    found = []
    for statement in STATEMENTS:
        try:
            finding = statement.judge(data)
        except _Missing as error:
            finding = Finding(str(error), NOT_MEASURED)
        found.append((statement, finding))
    return found


# ---- reading the data --------------------------------------------------------------------------


def _run(data: Data, name: str, least: float = 2.0) -> Data:
    """Return a run's figures; one that is missing, ended early or is too short is refused."""
    run: Data | None = data["runs"].get(name)
    if run is None:
        raise _Missing(f"no run {name}")
    if run["end"]:
        raise _Missing(f"run {name} ended early: {run['end']}")
    if run["duration"] < least - 1e-9:
        raise _Missing(f"run {name} lasts {run['duration']:g} s, this needs {least:g}")
    return run


@dataclass(frozen=True)
class _Value:
    """A figure and its error bar, in one unit."""

    value: float
    bar: float

    def text(self, form: str = ".4f") -> str:
        return f"{number_text(self.value, form)} ± {bar_text(self.bar)}"


def _value(data: Data, numeral: str, pick: Callable[[Data], float], least: float = 2.0) -> _Value:
    """Return a figure of a run with its error bar, from half the step and from fine panels."""
    value = pick(_run(data, numeral, least))
    others: list[float | None] = []
    for level in ("half", "fine"):
        try:
            others.append(pick(_run(data, f"{numeral}_{level}", least)))
        except _Missing:
            others.append(None)
    bar = bar_of(value, *others)
    if bar is None:
        raise _Missing(f"no finer runs of {numeral}")
    return _Value(value, bar)


def _speed(run: Data) -> float:
    """Return the net speed in body lengths a second."""
    return float(run["speed"]) / float(run["length"])


def _ahead(run: Data) -> float:
    """Return the displacement head first, to the left (body lengths)."""
    return -float(run["displacement"][0]) / float(run["length"])


def _turn(run: Data) -> float:
    """Return the turn of the heading (degrees), to the left where it is positive."""
    return math.degrees(run["turn"])


def _bend(run: Data) -> float:
    return float(max(run["bends"]))


def _order(a: _Value, b: _Value) -> int:
    """Return 1 where a is larger beyond both error bars, -1 where b is, otherwise 0."""
    if abs(a.value - b.value) <= a.bar + b.bar:
        return 0
    return 1 if a.value > b.value else -1


def _ratio(data: Data, over: str, under: str, pick: Callable[[Data], float]) -> _Value:
    """Return the ratio of a figure in two runs, with its own error bar.

    What step and panels do to both alike cancels, so it is known better than either.
    """
    values = []
    for level in ("", "_half", "_fine"):
        divisor = pick(_run(data, f"{under}{level}", 10.0))
        if divisor == 0.0:
            raise _Missing(f"{under} does not move")
        values.append(pick(_run(data, f"{over}{level}", 10.0)) / divisor)
    bar = bar_of(*values)
    assert bar is not None
    return _Value(values[0], bar)


def _against(ratio: _Value, limit: float, above: bool) -> str:
    """Return the verdict on a ratio that should be above or below a limit."""
    if abs(ratio.value - limit) <= ratio.bar:
        return UNDECIDED
    return _yes((ratio.value > limit) == above)


def _all_of(orders: list[int]) -> str:
    """Return the verdict where every order must be 1."""
    if any(order < 0 for order in orders):
        return DIFFER
    return AGREE if all(orders) else UNDECIDED


def _yes(holds: bool) -> str:
    return AGREE if holds else DIFFER


# ---- the method --------------------------------------------------------------------------------

_TABLE = [*NUMERALS]


def _momentum(data: Data) -> Finding:
    runs = [_run(data, name) for name in _TABLE]
    drift = max(run["momentum"]["drift"] for run in runs)
    share = max(run["momentum"]["share"] for run in runs)
    return Finding(
        f"largest drift of all twelve {drift:.1e}; {share:.1e} of its bound",
        _yes(drift <= 1e-9 and share <= 1.0),
        "What a step leaves of its residual is carried into the next, so momentum is kept to "
        "round-off whatever the tolerance of Newton's method.",
    )


def _energy(data: Data) -> Finding:
    runs = {name: _run(data, name, 10.0) for name in _TABLE}
    largest = max(runs, key=lambda name: runs[name]["energy"]["unexplained"])
    trends = {
        name: abs(run["energy"]["last"] - run["energy"]["first"]) for name, run in runs.items()
    }
    trend = max(trends, key=lambda name: trends[name])
    unexplained = runs[largest]["energy"]["unexplained"]
    return Finding(
        f"off by at most {unexplained:.1e} of the largest energy ({largest}); the mean of the last "
        f"quarter is {trends[trend]:.1e} from that of the first ({trend})",
        _yes(unexplained <= 0.05 and trends[trend] <= 0.01),
        "In driven runs the work of the torques is counted off; what is left stays bounded, and "
        "wanders in vi and vii.",
    )


def _large_steps(data: Data) -> Finding:
    modes = data["modes"].get("i")
    if modes is None:
        raise _Missing("no natural frequencies of scene i")
    runs = [_run(data, name) for name in _TABLE]
    phase = 2.0 * math.pi * modes["highest"] * 0.01
    cut = sum(run["halved"] for run in runs)
    return Finding(
        f"the highest mode of i, {modes['highest']:.0f} Hz, turns by {phase:.0f} rad in a step of "
        f"10 ms; all twelve runs came to their end with {cut} steps cut",
        UNDECIDED if phase > 2.0 and cut == 0 else DIFFER,
        "That our steps are large is measured, the comparison is not: a potential taken at the "
        "last node alone is a leapfrog scheme, unstable above 2 rad, and was not run.",
    )


# ---- Fig. 4 ------------------------------------------------------------------------------------


def _left(names: tuple[str, ...]) -> Callable[[Data], Finding]:
    def judge(data: Data) -> Finding:
        values = {name: _value(data, name, _ahead, 10.0) for name in names}
        least = min(one.value - one.bar for one in values.values())
        most = max(one.value + one.bar for one in values.values())
        verdict = AGREE if least > 0.0 else DIFFER if most < 0.0 else UNDECIDED
        if any(one.value + one.bar < 0.0 for one in values.values()):
            verdict = DIFFER
        return Finding(_listed(values, "{} BL"), verdict)

    return judge


def _listed(values: Mapping[str, _Value], form: str, digits: str = ".3f") -> str:
    return "; ".join(
        f"{name}: " + form.format(value.text(digits)) for name, value in values.items()
    )


def _curves(names: tuple[str, ...], side: int) -> Callable[[Data], Finding]:
    """Judge whether paths curve to a side, 1 for the left and -1 for the right."""

    def judge(data: Data) -> Finding:
        values = {name: _value(data, name, _turn, 90.0) for name in names}
        right = [side * one.value > max(CURVED, one.bar) for one in values.values()]
        return Finding(
            "turn of the heading (left positive) " + _listed(values, "{}°"),
            _yes(all(right)),
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


def _i_fastest(data: Data) -> Finding:
    values = {name: _value(data, name, _speed, 10.0) for name in ("i", "ii", "iii")}
    orders = [_order(values["i"], values[name]) for name in ("ii", "iii")]
    return Finding(_listed(values, "{} BL/s", ".5f"), _all_of(orders))


def _ii_bends_less(data: Data) -> Finding:
    bends = {name: _value(data, name, _bend, 10.0) for name in ("i", "ii")}
    speeds = {name: _value(data, name, _speed, 10.0) for name in ("i", "ii")}
    orders = [_order(bends["i"], bends["ii"]), _order(speeds["i"], speeds["ii"])]
    return Finding(
        "largest joint angle "
        + _listed(bends, "{} rad")
        + "; speed "
        + _listed(speeds, "{} BL/s", ".5f"),
        _all_of(orders),
    )


def _iii_slower_still(data: Data) -> Finding:
    values = {name: _value(data, name, _speed, 10.0) for name in ("ii", "iii")}
    ratio = _ratio(data, "iii", "ii", _speed)
    return Finding(
        _listed(values, "{} BL/s", ".6f") + f"; iii over ii {ratio.text('.3f')}",
        _against(ratio, 1.0, above=False),
        "Far below resonance the bend goes as torque over stiffness and the speed as its "
        "square, so "
        "half the torque and twice the stiffness should do nearly the same; what is left is how "
        "far each drive is from its resonance, which is nearer for the softer beam.",
    )


# ---- Fig. 5 ------------------------------------------------------------------------------------


def _turns_by(name: str, wanted: float) -> Callable[[Data], Finding]:
    def judge(data: Data) -> Finding:
        turn = _value(data, name, _turn, 90.0)
        why = _STRAIGHT if abs(turn.value) < CURVED else ""
        return Finding(
            f"{name}: {turn.text('.3f')}° (left positive), paper about {wanted:+.0f}°",
            _yes(abs(abs(turn.value) - abs(wanted)) <= _TURN and turn.value * wanted >= 0.0),
            why,
        )

    return judge


def _semicircle(data: Data) -> Finding:
    turn = _value(data, "iv", _turn, 90.0)
    return Finding(
        f"iv: {turn.text('.3f')}°, paper about 180° either way",
        _yes(abs(abs(turn.value) - 180.0) <= _TURN),
        _STRAIGHT if abs(turn.value) < CURVED else "",
    )


def _less_stable(data: Data) -> Finding:
    values = {name: _value(data, name, lambda run: abs(_turn(run)), 90.0) for name in ("i", "iv")}
    larger = _order(values["iv"], values["i"])
    verdict = AGREE if larger > 0 and values["iv"].value > CURVED else DIFFER
    return Finding(
        "turn " + _listed(values, "{}°"),
        verdict,
        "Three elements make the outline coarse and not lopsided; both paths are straight.",
    )


def _v_quadrant(data: Data) -> Finding:
    finding = _turns_by("v", -90.0)(data)
    ahead = _value(data, "v", _ahead, 90.0)
    way = "head first" if ahead.value > 0.0 else "tail first"
    modes = data["modes"].get("v")
    why = finding.why
    if modes is not None:
        first = modes["frequencies"][0]
        side = "above" if first < 1.0 else "below"
        why += f" Its first natural frequency is {first:.2f} Hz: the drive of 1 Hz lies {side} it."
    return Finding(
        f"{finding.measured}; it swims {way}, {ahead.text('.3f')} BL", finding.verdict, why
    )


def _v_much_faster(data: Data) -> Finding:
    values = {
        name: _value(data, name, lambda run: float(run["speed"]), 10.0) for name in ("iii", "v")
    }
    ratio = _ratio(data, "v", "iii", lambda run: float(run["speed"]))
    return Finding(
        f"{_listed(values, '{} m/s', '.5f')}; ratio {ratio.text('.1f')}",
        _against(ratio, 1.0 / _SLOW, above=True),
        "By speed alone: ours swims tail first. It is near resonance (0.93 Hz against 1 Hz) and "
        "undamped.",
    )


# ---- Fig. 6 ------------------------------------------------------------------------------------


def _halves(run: Data) -> tuple[float, float]:
    """Return the largest joint angles of the front and of the rear half (rad)."""
    bends = run["bends"]
    middle = len(bends) // 2
    return max(bends[:middle]), max(bends[middle:])


def _share_in_front(data: Data, name: str) -> _Value:
    def pick(run: Data) -> float:
        front, rear = _halves(run)
        return front / rear

    return _value(data, name, pick, 10.0)


def _vi_bends_behind(data: Data) -> Finding:
    share = _share_in_front(data, "vi")
    return Finding(
        f"largest joint angle of the front half {share.text('.3f')} of the rear half's",
        _yes(share.value + share.bar <= 0.2) if share.bar < 0.2 else UNDECIDED,
    )


def _vii_bends_in_front(data: Data) -> Finding:
    share = _share_in_front(data, "vii")
    return Finding(
        f"largest joint angle of the front half {share.text('.3f')} of the rear half's",
        _yes(share.value - share.bar > 0.2),
    )


def _vi_slow(data: Data) -> Finding:
    values = {name: _value(data, name, _speed, 10.0) for name in ("i", "vi")}
    ratio = _ratio(data, "vi", "i", _speed)
    return Finding(
        f"{_listed(values, '{} BL/s', '.5f')}; ratio {ratio.text('.2f')}",
        _against(ratio, _SLOW, above=False),
    )


def _vii_faster(data: Data) -> Finding:
    values = {name: _value(data, name, _speed, 10.0) for name in ("vi", "vii")}
    return Finding(
        _listed(values, "{} BL/s", ".5f"), _all_of([_order(values["vii"], values["vi"])])
    )


# ---- Fig. 7 ------------------------------------------------------------------------------------


def _viii_as_i(data: Data) -> Finding:
    first, stopped = _run(data, "i", 10.0), _run(data, "viii", 10.0)
    upto = min(50, len(first["path"]), len(stopped["path"]))
    apart = max(
        math.dist(a, b) for a, b in zip(first["path"][:upto], stopped["path"][:upto], strict=True)
    )
    return Finding(
        f"paths of i and viii are at most {apart:.1e} m apart over {upto} s",
        _yes(apart <= 1e-9),
    )


def _speed_between(run: Data, first: int, last: int) -> float:
    a, b = run["path"][first], run["path"][last]
    return math.dist(a, b) / (last - first) / float(run["length"])


def _viii_slows(data: Data) -> Finding:
    before = _value(data, "viii", lambda run: _speed_between(run, 0, 48), 90.0)
    after = _value(data, "viii", lambda run: _speed_between(run, 52, len(run["path"]) - 1), 90.0)
    ratio = after.value / before.value
    return Finding(
        f"{before.text('.5f')} BL/s before 50 s, {after.text('.6f')} after; ratio {ratio:.1e}",
        _yes(ratio <= 0.1),
        "Total momentum is zero and nothing is left behind in the fluid: a body that stops "
        "deforming stops. What still rings of the undamped modes moves it a little.",
    )


def _viii_tighter(data: Data) -> Finding:
    def turned(run: Data) -> float:
        return math.degrees(run["heading"][-1] - run["heading"][51])

    after = _value(data, "viii", turned, 90.0)
    return Finding(
        f"heading turns by {after.text('.3f')}° after 50 s",
        _yes(abs(after.value) > max(CURVED, after.bar)),
        "With no total momentum the body moves only while its shape changes; what still rings is "
        "small and to and fro, and its mean neither travels nor turns.",
    )


def _ix_slow(data: Data) -> Finding:
    values = {name: _value(data, name, _speed, 10.0) for name in ("i", "ix")}
    ahead = _value(data, "ix", _ahead, 10.0)
    ratio = _ratio(data, "ix", "i", _speed)
    return Finding(
        f"{_listed(values, '{} BL/s', '.5f')}; ratio "
        f"{ratio.text('.2f')}; to the left {ahead.text('.3f')} BL",
        _against(ratio, _SLOW, above=False) if ahead.value > ahead.bar else DIFFER,
    )


def _ix_straight(data: Data) -> Finding:
    turn = _value(data, "ix", _turn, 90.0)
    return Finding(f"turn {turn.text('.3f')}°", _yes(abs(turn.value) + turn.bar <= CURVED))


# ---- the passive body --------------------------------------------------------------------------


def onset_of(
    data: Data,
    elements: int,
    panels: int,
    kind: str,
    stiffness: float = 5.0,
    step: float = 0.01,
    model: str = "panels",
) -> Data | None:
    """Return the run of the stability study with these settings, None where there is none."""
    wanted = (elements, panels, kind, stiffness, step, model)
    for one in data["onset"]:
        found = (one["elements"], one["panels"], one["perturbation"], one["stiffness"])
        if (*found, one["step"], one["model"]) == wanted:
            match: Data = one
            return match
    return None


def _needed(data: Data, elements: int, panels: int, kind: str, **settings: Any) -> Data:
    found = onset_of(data, elements, panels, kind, **settings)
    if found is None:
        raise _Missing(f"no onset of N = {elements}, {panels} panels, {kind}")
    return found


def _equilibrium(data: Data) -> Finding:
    runs = [one for one in data["onset"] if one["perturbation"] == "none"]
    if not {(3, 12), (9, 4)} <= {(one["elements"], one["panels"]) for one in runs}:
        raise _Missing("no runs at [0.1, 0]")
    angle = max(one["largest_angle"] for one in runs)
    offset = max(one["largest_offset"] for one in runs)
    ended = any(one["end"] for one in runs)
    return Finding(
        f"{len(runs)} bodies: largest angle {angle:.1e} rad, largest offset of an end "
        f"{offset:.1e} m in {runs[0]['duration']:g} s",
        _yes(not ended and offset <= 0.01 and angle <= 0.01),
        "Exactly straight to the last bit: it is a relative equilibrium of the discrete equations."
        if angle == 0.0
        else "",
    )


_KINDS = {"epsilon": "2.2e-16", "small": "1e-4", "sloped": "sloped"}


def _times(elements: int, panels: int) -> Callable[[Data], Finding]:
    def judge(data: Data) -> Finding:
        parts, close = [], []
        for kind, name in _KINDS.items():
            ours = _needed(data, elements, panels, kind)["time"]
            paper = PAPER_TIMES[elements, panels, kind]
            shown = "none" if ours is None else f"{ours:.2f} s"
            parts.append(f"{name}: {shown} (paper {paper:g})")
            close.append(ours is not None and abs(ours - paper) <= _TIME * paper)
        rate = _needed(data, elements, panels, "epsilon")
        return Finding(
            "; ".join(parts),
            _yes(all(close)),
            f"Ours grow at {rate['rate']:.4f} 1/s, Kirchhoff's equations at "
            f"{rate['kirchhoff']:.4f}; the paper's own times need several rates at once "
            "(Stability).",
        )

    return judge


def _panels_matter(elements: int, earlier: bool) -> Callable[[Data], Finding]:
    def judge(data: Data) -> Finding:
        parts, signs, shares = [], [], []
        for kind, name in _KINDS.items():
            few = _needed(data, elements, 4, kind)["time"]
            many = _needed(data, elements, 12, kind)["time"]
            if few is None or many is None:
                raise _Missing(f"no onset within the run, {name}")
            shares.append(abs(many / few - 1.0))
            signs.append(many < few)
            parts.append(f"{name}: {few:.2f} and {many:.2f} s")
        rates = [_needed(data, elements, panels, "small")["kirchhoff"] for panels in (4, 12)]
        verdict = _yes(max(shares) <= 0.02 and (all(signs) or not earlier))
        why = (
            f"Kirchhoff's rate with the body's own masses is {rates[0]:.4f} and {rates[1]:.4f} 1/s."
        )
        return Finding(f"4 and 12 panels: {'; '.join(parts)}", verdict, why)

    return judge


def _stiffness(data: Data) -> Finding:
    groups: dict[tuple[Any, ...], list[float | None]] = {}
    for one in data["onset"]:
        if one["perturbation"] != "none" and one["step"] == 0.01:
            key = (one["elements"], one["panels"], one["perturbation"])
            groups.setdefault(key, []).append(one["time"])
    spreads = {}
    for key, times in groups.items():
        known = [time for time in times if time is not None]
        if len(times) > 1:
            whole = len(known) == len(times)
            spreads[key] = (max(known) - min(known)) / min(known) if whole else math.inf
    if not spreads:
        raise _Missing("one stiffness alone")
    worst = max(spreads, key=lambda key: spreads[key])
    return Finding(
        f"over {len(spreads)} bodies and starts the time varies by at most {spreads[worst]:.1e} of "
        f"itself (N = {worst[0]}, {worst[1]} panels, {worst[2]})",
        _yes(spreads[worst] <= 0.01),
        "The body stays straight, and a straight body has nothing to spring back.",
    )


def _delayed(data: Data) -> Finding:
    times = {}
    for elements, panels in ((3, 12), (9, 4), (27, 4)):
        base = _needed(data, elements, panels, "small")
        times[elements] = base["time"]
    if None in times.values():
        raise _Missing("no onset within the run")
    low, high = min(times.values()), max(times.values())
    return Finding(
        "; ".join(f"N = {n}: {time:.2f} s" for n, time in times.items()),
        _yes(times[3] < 0.95 * times[9] and times[9] < 0.95 * times[27]),
        f"The onset is the rigid body's, whose masses hardly hang on N: the times are "
        f"{high - low:.2f} s apart.",
    )


def _x_turns(data: Data) -> Finding:
    run = _run(data, "x", 10.0)
    at_ten = math.degrees(run["angle"][10])
    late = next((n for n, a in enumerate(run["angle"]) if abs(math.degrees(a)) > 150.0), None)
    shown = "not in this run" if late is None else f"past 150° after {late} s"
    return Finding(
        f"turned by {at_ten:.2f}° at t = 10 s; {shown}",
        _yes(abs(abs(at_ten) - 180.0) <= _TURN),
        "The same fate, later: the growth is that of Kirchhoff's equations, several times slower "
        "than the paper's.",
    )


def _xi_as_xii(data: Data) -> Finding:
    one, other = _run(data, "xi", 10.0), _run(data, "xii", 10.0)
    turns = [abs(math.degrees(a - b)) for a, b in zip(one["angle"], other["angle"], strict=True)]
    apart = max(math.dist(a, b) for a, b in zip(one["path"], other["path"], strict=True))
    return Finding(
        f"headings at most {max(turns):.2f}° and centres at most {apart:.3f} m apart in "
        f"{one['duration']:g} s",
        _yes(max(turns) <= 10.0 and apart <= 0.1),
    )


# ---- conclusions -------------------------------------------------------------------------------


def _net_locomotion(data: Data) -> Finding:
    ahead = _value(data, "i", _ahead, 10.0)
    momentum = _run(data, "i")["momentum"]["drift"]
    return Finding(
        f"i: {ahead.text('.4f')} BL from rest, total momentum within {momentum:.1e} of zero",
        _yes(abs(ahead.value) > 10.0 * ahead.bar),
    )


def _alone(data: Data) -> Finding:
    run = _run(data, "i_alone")
    moved = math.hypot(*run["displacement"])
    return Finding(
        f"i without fluid: moves by {moved:.1e} m, turns by {_turn(run):.1e}°",
        _yes(moved <= 1e-9),
        "Torques are internal: without a fluid the centre of mass stays.",
    )


def _spatial_order(data: Data) -> Finding:
    orders = data["modes"].get("i", {}).get("orders")
    if orders is None:
        raise _Missing("no frequencies over N")
    errors = ", ".join(f"{one:.1e}" for one in orders["errors"])
    counts = ", ".join(str(n) for n in orders["elements"])
    return Finding(
        f"first frequency of the beam alone at N = {counts}: off by {errors}; order "
        f"{orders['order']:.2f}",
        _yes(abs(orders["order"] - 2.0) <= 0.1),
    )


_S6 = "section 6"

STATEMENTS: tuple[Statement, ...] = (
    Statement(
        "order",
        "section 4",
        "the strains at the middle make the beam converge quadratically",
        "order of the first bending frequency 2.0 ± 0.1",
        _spatial_order,
    ),
    Statement(
        "momentum",
        f"{_S6}, method",
        "linear and angular momentum maps kept, to the 1e-9 of Newton's iteration",
        "max |J_n - J_0| ≤ 1e-9 and within 10 tolerances + 1e-15 n terms, all twelve runs",
        _momentum,
    ),
    Statement(
        "energy",
        f"{_S6}, method",
        "total energy oscillates with small amplitude, none is gained or lost numerically",
        "unexplained at most 5 % of the largest, means of first and last quarter within 1 %",
        _energy,
    ),
    Statement(
        "steps",
        f"{_S6}, method",
        "the strain energy at the midpoint allows much larger steps than at the last node",
        "ω dt of the highest mode above 2, the limit of the other, and runs that last",
        _large_steps,
    ),
    Statement(
        "i-iii left",
        f"{_S6}, Fig. 4",
        "i, ii and iii swim to the left",
        "net displacement head first beyond its error bar",
        _left(("i", "ii", "iii")),
    ),
    Statement(
        "i-iii curve",
        f"{_S6}, Fig. 4",
        "i, ii and iii curve slightly to the right",
        f"heading turns right by more than {CURVED:g}° and its error bar",
        _curves(("i", "ii", "iii"), -1),
    ),
    Statement(
        "i fastest",
        f"{_S6}, Fig. 4",
        "i is faster than ii and iii",
        "speeds apart by more than both error bars",
        _i_fastest,
    ),
    Statement(
        "ii slower",
        f"{_S6}, Fig. 4",
        "ii, twice as stiff, bends less and is slower",
        "both apart by more than their error bars",
        _ii_bends_less,
    ),
    Statement(
        "iii slower",
        f"{_S6}, Fig. 4",
        "iii, with half the torque, is even slower",
        "ratio of the speeds below 1 by more than its error bar",
        _iii_slower_still,
    ),
    Statement(
        "iv less stable",
        f"{_S6}, Fig. 5",
        "the coarse iv moves less stably than i, which curves only slightly",
        f"iv turns more than i and more than {CURVED:g}°",
        _less_stable,
    ),
    Statement(
        "iv semicircle",
        f"{_S6}, Fig. 5",
        "iv passes through a semicircle in 100 s",
        f"turn of 180° ± {_TURN:g}°",
        _semicircle,
    ),
    Statement(
        "v quadrant",
        f"{_S6}, Fig. 5",
        "v turns to the right through a quadrant instead of moving forward",
        f"turn of -90° ± {_TURN:g}°",
        _v_quadrant,
    ),
    Statement(
        "v faster",
        f"{_S6}, Fig. 5",
        "v moves much faster than iii",
        f"at least {1 / _SLOW:g} times as fast",
        _v_much_faster,
    ),
    Statement(
        "vi-vii left",
        f"{_S6}, Fig. 6",
        "vi and vii move to the left",
        "net displacement head first beyond its error bar",
        _left(("vi", "vii")),
    ),
    Statement(
        "vi-vii curve",
        f"{_S6}, Fig. 6",
        "vi and vii curve slightly to the left, unlike i and ii",
        f"heading turns left by more than {CURVED:g}° and its error bar",
        _curves(("vi", "vii"), 1),
    ),
    Statement(
        "vi bends",
        f"{_S6}, Fig. 6",
        "vi bends in its rear half only",
        "front half at most a fifth of the rear half",
        _vi_bends_behind,
    ),
    Statement(
        "vi slow",
        f"{_S6}, Fig. 6",
        "vi is very slow",
        f"at most {_SLOW:g} of the speed of i",
        _vi_slow,
    ),
    Statement(
        "vii faster",
        f"{_S6}, Fig. 6",
        "vii is faster than vi",
        "speeds apart by more than both error bars",
        _vii_faster,
    ),
    Statement(
        "vii bends",
        f"{_S6}, Fig. 6",
        "vii bends its head too",
        "front half more than a fifth of the rear half",
        _vii_bends_in_front,
    ),
    Statement(
        "viii as i",
        f"{_S6}, Fig. 7",
        "until 50 s viii moves as i",
        "paths within 1e-9 m",
        _viii_as_i,
    ),
    Statement(
        "viii slows",
        f"{_S6}, Fig. 7",
        "without torques, after 50 s, viii slows down rapidly",
        "mean speed after 52 s at most a tenth of that before",
        _viii_slows,
    ),
    Statement(
        "viii tighter",
        f"{_S6}, Fig. 7",
        "without torques viii moves into a tighter curve",
        f"heading turns by more than {CURVED:g}° after 50 s",
        _viii_tighter,
    ),
    Statement(
        "ix slow",
        f"{_S6}, Fig. 7",
        "ix moves slowly to the left",
        f"at most {_SLOW:g} of the speed of i, to the left",
        _ix_slow,
    ),
    Statement(
        "ix straight",
        f"{_S6}, Fig. 7",
        "ix moves on an almost straight path",
        f"turn at most {CURVED:g}°",
        _ix_straight,
    ),
    Statement(
        "equilibrium",
        f"{_S6}, passive",
        "[0.1, 0] is a relative equilibrium; N = 3 and 9 swim stably for 100 s",
        "ends within 1 % of the length of their line",
        _equilibrium,
    ),
    *(
        Statement(
            f"times {elements} {panels}",
            f"{_S6}, passive",
            f"first deviations of 1 %, N = {elements}, {panels} panels",
            f"each within {_TIME:.0%}",
            _times(elements, panels),
        )
        for elements, panels in ((3, 12), (9, 4), (9, 12), (27, 4))
    ),
    Statement(
        "12 panels",
        f"{_S6}, passive",
        "with 12 panels N = 9 is unstable slightly earlier",
        "earlier for all three starts, by at most 2 %",
        _panels_matter(9, True),
    ),
    Statement(
        "27 panels",
        f"{_S6}, passive",
        "at N = 27 the number of panels hardly matters",
        "times within 2 %",
        _panels_matter(27, False),
    ),
    Statement(
        "stiffness",
        f"{_S6}, passive",
        "nothing changes with EI from 5 to 1e4",
        "times within 1 %",
        _stiffness,
    ),
    Statement(
        "x turns",
        f"{_S6}, Fig. 8",
        "x has rotated by almost 180° at t = 10",
        f"180° ± {_TURN:g}°",
        _x_turns,
    ),
    Statement(
        "xi as xii",
        f"{_S6}, Fig. 8",
        "xi and xii do not differ significantly",
        "headings within 10°, centres within 0.1 m",
        _xi_as_xii,
    ),
    Statement(
        "delayed",
        f"{_S6}, Fig. 8",
        "proper discretisation may delay the onset",
        "each threefold N is later by 5 % or more (start 1e-4)",
        _delayed,
    ),
    Statement(
        "locomotion",
        "section 7",
        "joint torques alone make the submerged beam swim",
        "net displacement ten times its error bar",
        _net_locomotion,
    ),
    Statement(
        "alone",
        "section 7",
        "without the fluid they turn it at most",
        "centre within 1e-9 m",
        _alone,
    ),
)

assert len({statement.key for statement in STATEMENTS}) == len(STATEMENTS)
assert set(LATERAL) == set(_KINDS)
