"""How fast the swimmers of Figs. 4 to 7 are, and how they bend."""

from __future__ import annotations

import math

from studies.paper.judges.criteria import CLOSE, RANK, SLOW, UNBENT
from studies.paper.measures import largest_bend, net_speed, way_ahead
from studies.paper.verdicts import (
    Data,
    Finding,
    MissingError,
    Value,
    above,
    all_of,
    at_most,
    larger,
    listed,
    ratio_of,
    run_of,
    value_of,
)

__all__ = [
    "head_matters",
    "i_fastest",
    "ii_bends_less",
    "iii_slower_still",
    "ix_slow",
    "nontrivial",
    "v_much_faster",
    "vi_bends_behind",
    "vi_slow",
    "vii_bends_in_front",
    "vii_faster",
    "viii_slows",
]


def nontrivial(data: Data) -> Finding:
    """Judge whether the speeds of i, ii and iii break the simple law of a small bend."""
    # Where a body bends as torque over stiffness and swims as the square of its bend, twice the
    # stiffness and half the torque each leave a quarter of the speed.
    ratios = {name: ratio_of(data, name, "i", net_speed) for name in ("ii", "iii")}
    off = {name: Value(abs(4.0 * one.value - 1.0), 4.0 * one.bar) for name, one in ratios.items()}
    verdicts = [above(one, CLOSE) for one in off.values()]
    return Finding(
        "speed over that of i " + listed(ratios, "{}") + "; (torque over stiffness)² "
        "would give 0.25",
        max(verdicts, key=RANK.index),
        "Among these three, well below resonance, one simple law holds nearly. Beyond it, "
        "dependence on length, stiffness and frequency is anything but simple: v, and the maps.",
    )


def i_fastest(data: Data) -> Finding:
    """Judge whether i is faster than ii and iii."""
    values = {name: value_of(data, name, net_speed, 10.0) for name in ("i", "ii", "iii")}
    return Finding(
        listed(values, "{} BL/s"),
        all_of(larger(values["i"], values[name]) for name in ("ii", "iii")),
    )


def ii_bends_less(data: Data) -> Finding:
    """Judge whether the stiffer ii bends less than i and is slower."""
    bends = {name: value_of(data, name, largest_bend, 10.0) for name in ("i", "ii")}
    speeds = {name: value_of(data, name, net_speed, 10.0) for name in ("i", "ii")}
    return Finding(
        "largest joint angle " + listed(bends, "{} rad") + "; speed " + listed(speeds, "{} BL/s"),
        all_of(larger(one["i"], one["ii"]) for one in (bends, speeds)),
    )


def iii_slower_still(data: Data) -> Finding:
    """Judge whether iii is slower than ii."""
    values = {name: value_of(data, name, net_speed, 10.0) for name in ("ii", "iii")}
    ratio = ratio_of(data, "iii", "ii", net_speed)
    return Finding(
        listed(values, "{} BL/s") + f"; iii over ii {ratio.text()}",
        at_most(ratio, 1.0),
        "Far below resonance the bend goes as torque over stiffness and the speed as its square, "
        "so half the torque and twice the stiffness should do nearly the same; what is left is how "
        "far each drive is from its resonance, which is nearer for the softer beam.",
    )


def v_much_faster(data: Data) -> Finding:
    """Judge whether v is much faster than iii."""
    values = {
        name: value_of(data, name, lambda run: float(run["speed"]), 10.0) for name in ("iii", "v")
    }
    ratio = ratio_of(data, "v", "iii", lambda run: float(run["speed"]))
    why = "By speed alone: ours swims tail first." if way_ahead(run_of(data, "v")) < 0.0 else ""
    modes = data["modes"].get("v")
    if modes is not None:
        first = modes["frequencies"][0]
        why += f" Its first natural frequency, {first:.2f} Hz, is near the drive's 1 Hz, undamped."
    return Finding(
        f"{listed(values, '{} m/s')}; ratio {ratio.text()}",
        above(ratio, 1.0 / SLOW),
        why,
    )


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
    values = {name: value_of(data, name, net_speed, 10.0) for name in ("i", "vi")}
    ratio = ratio_of(data, "vi", "i", net_speed)
    return Finding(f"{listed(values, '{} BL/s')}; ratio {ratio.text()}", at_most(ratio, SLOW))


def vii_faster(data: Data) -> Finding:
    """Judge whether vii is faster than vi."""
    values = {name: value_of(data, name, net_speed, 10.0) for name in ("vi", "vii")}
    return Finding(listed(values, "{} BL/s"), larger(values["vii"], values["vi"]))


def head_matters(data: Data) -> Finding:
    """Judge whether those that bend their head are faster than vi, which cannot."""
    shares = {name: _share_in_front(data, name) for name in ("i", "vii")}
    speeds = {name: value_of(data, name, net_speed, 10.0) for name in ("i", "vi", "vii")}
    verdicts = [above(one, UNBENT) for one in shares.values()]
    verdicts += [larger(speeds[name], speeds["vi"]) for name in ("i", "vii")]
    try:
        other = value_of(data, "vi_reversed", net_speed, 10.0)
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


def ix_slow(data: Data) -> Finding:
    """Judge whether ix is slow beside i, and swims to the left."""
    values = {name: value_of(data, name, net_speed, 10.0) for name in ("i", "ix")}
    ahead = value_of(data, "ix", way_ahead, 10.0)
    ratio = ratio_of(data, "ix", "i", net_speed)
    return Finding(
        f"{listed(values, '{} BL/s')}; ratio {ratio.text()}; to the left {ahead.text()} BL",
        all_of([at_most(ratio, SLOW), above(ahead, 0.0)]),
    )
