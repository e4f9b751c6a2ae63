"""The limits that statements are held against, and what several judges say alike.

They are stated with every statement in `studies.paper.statements`.
"""

from __future__ import annotations

from studies.paper.verdicts import AGREE, DIFFER, UNDECIDED

__all__ = [
    "CLOSE",
    "CURVED",
    "ENERGY",
    "RANK",
    "SLOW",
    "STRAIGHT",
    "SYMMETRY",
    "TREND",
    "TURN",
    "UNBENT",
]

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
#: Why a wave does not turn a body in a mirror-symmetric fluid, as long as its motion is symmetric.
SYMMETRY = (
    "The wave half a period later is its own mirror image. Where the motion is so too, the two "
    "halves turn the body by opposite angles: no steady curve to either side. The runs bear that "
    "out; symmetry alone does not rule out a start that breaks it, or a pair of mirrored cycles. "
    "One-sided sources on the centreline have no such symmetry."
)
#: The short form of it, for cells.
STRAIGHT = "Mirror symmetry (below the table)."
#: From the worst to the best.
RANK = [DIFFER, UNDECIDED, AGREE]
