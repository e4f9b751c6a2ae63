"""The limits that statements are compared with, and what several judges say alike."""

from __future__ import annotations

#: A path is curved where the heading turns by more than this in the run (degrees).
CURVED = 1.0
#: Semicircle, quadrant: a turn within this of the number (degrees).
TURN = 30.0
#: A time agrees with the paper's within this share; a simple law holds within it.
CLOSE = 0.1
#: Slow: at most this share of the speed it is compared with; much faster: at least this multiple.
SLOW, FAST = 0.5, 2.0
#: Bending in one half only: at most this share of the other half's.
UNBENT = 0.2
#: How far the energy may be off, and its mean may wander, as shares of the largest energy. Speed
#: goes as the square of the motion, as energy does: an error that is small beside a speed's own
#: error bar is one that nothing stated here could show. A fifth of the limit for trusting a run.
ENERGY, TREND = 0.01, 0.005
#: Why a wave does not turn a body in a mirror-symmetric fluid: the short form, for cells.
STRAIGHT = "Mirror symmetry (below the table)."
