"""The paper's sentences that state a result, and the criteria by which ours agree or differ.

Each statement is a short paraphrase with its place, and a function of `studies.paper.judges` that
reads the data and returns a finding. One rule holds for all (`studies.paper.verdicts`): where an
error bar spans the criterion's limit, the statement is undecided.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from studies.paper.judges import method, onset, paths, speeds
from studies.paper.judges.criteria import CLOSE, CURVED, ENERGY, SLOW, TREND, TURN
from studies.paper.verdicts import NOT_MEASURED, Data, Finding, MissingError

__all__ = ["STATEMENTS", "Statement", "find_all"]


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
        except MissingError as error:
            finding = Finding(str(error), NOT_MEASURED)
        found.append((statement, finding))
    return found


_S6 = "section 6"

STATEMENTS: tuple[Statement, ...] = (
    Statement(
        "order",
        "section 4",
        "the strains at the middle make the beam converge quadratically",
        "order of the first bending frequency within 0.1 of 2",
        method.spatial_order,
    ),
    Statement(
        "momentum",
        f"{_S6}, method",
        "linear and angular momentum maps kept, to the 1e-9 of Newton's iteration",
        "max |J_n - J_0| ≤ 1e-9 and within 10 tolerances + 1e-15 n terms, all twelve runs",
        method.momentum,
    ),
    Statement(
        "energy",
        f"{_S6}, method",
        "total energy oscillates with small amplitude, none is gained or lost numerically",
        f"unexplained at most {ENERGY:.0%} of the largest, with half the step too, and means of "
        f"first and last quarter within {TREND:.1%}: less than a speed's error bar",
        method.energy,
    ),
    Statement(
        "steps",
        f"{_S6}, method",
        "the strain energy at the midpoint allows much larger steps than at the last node",
        "ω dt of the highest mode above 2, the limit of the other, and runs that last",
        method.large_steps,
    ),
    Statement(
        "i-iii left",
        f"{_S6}, Fig. 4",
        "i, ii and iii swim to the left",
        "net displacement is head first",
        paths.swims_left(("i", "ii", "iii")),
    ),
    Statement(
        "i-iii curve",
        f"{_S6}, Fig. 4",
        "i, ii and iii curve slightly to the right",
        f"heading turns right by more than {CURVED:g}°",
        paths.curves(("i", "ii", "iii"), -1),
    ),
    Statement(
        "i-iii alike",
        f"{_S6}, Fig. 4",
        "i, ii and iii show the same qualitative motion",
        f"they swim one way, and all turn to one side by more than {CURVED:g}° or none does",
        paths.same_motion,
    ),
    Statement(
        "nontrivial",
        f"{_S6}, Fig. 4",
        "path and speed depend in a nontrivial way on the beam's parameters and the loading",
        f"a speed of ii or iii is more than {CLOSE:.0%} off the simple law, (torque / stiffness)²",
        speeds.nontrivial,
    ),
    Statement(
        "i fastest",
        f"{_S6}, Fig. 4",
        "i is faster than ii and iii",
        "the speed is larger",
        speeds.i_fastest,
    ),
    Statement(
        "ii slower",
        f"{_S6}, Fig. 4",
        "ii, twice as stiff, bends less and is slower",
        "both are smaller",
        speeds.ii_bends_less,
    ),
    Statement(
        "iii slower",
        f"{_S6}, Fig. 4",
        "iii, with half the torque, is even slower",
        "ratio of the speeds below 1",
        speeds.iii_slower_still,
    ),
    Statement(
        "iv less stable",
        f"{_S6}, Fig. 5",
        "the coarse iv moves less stably than i, which curves only slightly",
        f"iv turns more than i and more than {CURVED:g}°",
        paths.less_stable,
    ),
    Statement(
        "iv semicircle",
        f"{_S6}, Fig. 5",
        "iv passes through a semicircle in 100 s",
        f"turn within {TURN:g}° of 180°",
        paths.semicircle,
    ),
    Statement(
        "v quadrant",
        f"{_S6}, Fig. 5",
        "v turns to the right through a quadrant instead of moving forward",
        f"turn within {TURN:g}° of -90°",
        paths.v_quadrant,
    ),
    Statement(
        "v unlike iii",
        f"{_S6}, Fig. 5",
        "v, twice as long as iii, moves in a qualitatively different way",
        f"it swims the other way, or turns by {TURN:g}° more",
        paths.v_unlike_iii,
    ),
    Statement(
        "v faster",
        f"{_S6}, Fig. 5",
        "v moves much faster than iii",
        f"at least {1 / SLOW:g} times as fast",
        speeds.v_much_faster,
    ),
    Statement(
        "vi-vii left",
        f"{_S6}, Fig. 6",
        "vi and vii move to the left",
        "net displacement is head first",
        paths.swims_left(("vi", "vii")),
    ),
    Statement(
        "vi-vii curve",
        f"{_S6}, Fig. 6",
        "vi and vii curve slightly to the left, unlike i and ii",
        f"heading turns left by more than {CURVED:g}°",
        paths.curves(("vi", "vii"), 1),
    ),
    Statement(
        "vi bends",
        f"{_S6}, Fig. 6",
        "vi bends in its rear half only",
        "front half at most a fifth of the rear half",
        speeds.vi_bends_behind,
    ),
    Statement(
        "vi slow",
        f"{_S6}, Fig. 6",
        "vi is very slow",
        f"at most {SLOW:g} of the speed of i",
        speeds.vi_slow,
    ),
    Statement(
        "vii faster",
        f"{_S6}, Fig. 6",
        "vii is faster than vi",
        "the speed is larger",
        speeds.vii_faster,
    ),
    Statement(
        "vii bends",
        f"{_S6}, Fig. 6",
        "vii bends its head too",
        "front half more than a fifth of the rear half",
        speeds.vii_bends_in_front,
    ),
    Statement(
        "head matters",
        f"{_S6}, Fig. 6",
        "being able to bend the head may be important for fast swimming",
        "i and vii bend their front half by more than a fifth of the rear half, and are faster "
        "than vi",
        speeds.head_matters,
    ),
    Statement(
        "viii as i",
        f"{_S6}, Fig. 7",
        "until 50 s viii moves as i",
        "paths within 1e-9 m",
        paths.viii_as_i,
    ),
    Statement(
        "viii slows",
        f"{_S6}, Fig. 7",
        "without torques, after 50 s, viii slows down rapidly",
        "mean speed after 52 s at most a tenth of that before",
        speeds.viii_slows,
    ),
    Statement(
        "viii tighter",
        f"{_S6}, Fig. 7",
        "without torques viii moves into a tighter curve",
        f"heading turns by more than {CURVED:g}° after 50 s",
        paths.viii_tighter,
    ),
    Statement(
        "ix slow",
        f"{_S6}, Fig. 7",
        "ix moves slowly to the left",
        f"at most {SLOW:g} of the speed of i, to the left",
        speeds.ix_slow,
    ),
    Statement(
        "ix straight",
        f"{_S6}, Fig. 7",
        "ix moves on an almost straight path",
        f"turn at most {CURVED:g}°",
        paths.ix_straight,
    ),
    Statement(
        "equilibrium",
        f"{_S6}, passive",
        "[0.1, 0] is a relative equilibrium; N = 3 and 9 swim stably for 100 s",
        "ends within 1 % of the length of their line",
        onset.equilibrium,
    ),
    *(
        Statement(
            f"times {elements} {panels}",
            f"{_S6}, passive",
            f"first deviations of 1 %, N = {elements}, {panels} panels",
            f"each within {CLOSE:.0%}",
            onset.times(elements, panels),
        )
        for elements, panels in ((3, 12), (9, 4), (9, 12), (27, 4))
    ),
    Statement(
        "12 panels",
        f"{_S6}, passive",
        "with 12 panels N = 9 is unstable slightly earlier",
        "earlier for all three starts, by at most 2 %",
        onset.panels_matter(9, True),
    ),
    Statement(
        "27 panels",
        f"{_S6}, passive",
        "at N = 27 the number of panels hardly matters",
        "times within 2 %",
        onset.panels_matter(27, False),
    ),
    Statement(
        "stiffness",
        f"{_S6}, passive",
        "nothing changes with EI from 5 to 1e4",
        "times within 1 %",
        onset.stiffness,
    ),
    Statement(
        "x turns",
        f"{_S6}, Fig. 8",
        "x has rotated by almost 180° at t = 10",
        f"within {TURN:g}° of 180°",
        onset.x_turns,
    ),
    Statement(
        "coarse unstable",
        f"{_S6}, Fig. 8",
        "the coarse beam x is very unstable",
        "its onset comes in at most half the time of those at N = 9 and 27 (start 1e-4)",
        onset.coarse_unstable,
    ),
    Statement(
        "xi as xii",
        f"{_S6}, Fig. 8",
        "xi and xii do not differ significantly",
        "headings within 10°, centres within 0.1 m",
        onset.xi_as_xii,
    ),
    Statement(
        "delayed",
        f"{_S6}, Fig. 8",
        "proper discretisation may delay the onset",
        "the onset is later by 5 % or more with every threefold N (start 1e-4)",
        onset.delayed,
    ),
    Statement(
        "locomotion",
        "section 7",
        "joint torques alone make the submerged beam swim",
        "the net displacement is not zero",
        method.net_locomotion,
    ),
    Statement(
        "alone",
        "section 7",
        "without the fluid they can at most turn it",
        "centre within 1e-9 m",
        method.alone,
    ),
)

assert len({statement.key for statement in STATEMENTS}) == len(STATEMENTS)
