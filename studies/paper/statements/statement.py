"""What a statement is, the limits that statements are compared with, and what several say alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from studies.paper.verdicts import Data, Finding

__all__ = ["Chapter", "Judge", "Statement"]

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
#: How far the energy may be off, and its mean may wander, as shares of the largest energy. Speed
#: goes as the square of the motion, as energy does: an error that is small beside a speed's own
#: error bar is one that nothing stated here could show. A fifth of the limit for trusting a run.
ENERGY, TREND = 0.01, 0.005
#: Why a wave does not turn a body in a mirror-symmetric fluid, as long as its motion is symmetric.
SYMMETRY = (
    "The wave half a period later is its own mirror image. Where the motion is so too, the two "
    "halves turn the body by opposite angles: no steady curve to either side. The runs bear that "
    "out; symmetry alone does not rule out a start that breaks it, or a pair of mirrored cycles. "
    "One-sided sources on the centreline have no such symmetry."
)
#: The short form of it, for cells.
STRAIGHT = "Mirror symmetry (below the table)."

#: From the data to a finding.
Judge = Callable[[Data], Finding]


@dataclass(frozen=True)
class Statement:
    """A sentence of the paper that states a result."""

    #: Short name.
    key: str
    #: Section, and paragraph or figure.
    where: str
    #: The paragraph of the page's end that counts it: orders, paths, times, onset or method.
    group: str
    #: What it says, in few words.
    says: str
    #: When the two agree.
    criterion: str
    judge: Judge


class Chapter(list[Statement]):
    """Statements of one part of the paper, in its order."""

    def __init__(self, where: str) -> None:
        super().__init__()
        self.where = where

    def states(self, key: str, group: str, says: str, criterion: str) -> Callable[[Judge], Judge]:
        """Add a statement, whose judge is the function that this decorates; see `Statement`."""

        def keep(judge: Judge) -> Judge:
            self.append(Statement(key, self.where, group, says, criterion, judge))
            return judge

        return keep
