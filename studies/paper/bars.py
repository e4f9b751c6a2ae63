"""Error bars from finer runs, and numbers as text with as many digits as their bars allow."""

from __future__ import annotations

import math

import numpy as np

#: How many times finer the runs are that error bars come from.
STEPS, PANELS = 2.0, 3.0


def coarse_error(change: float, ratio: float, order: float = 1.0) -> float:
    """Return how far a coarse figure is from its limit, from the change by refining it once.

    Where the error is c h^p, the ``change`` from h to h/r is c h^p (1 - r^-p), r the ``ratio`` and
    p the ``order``: the coarse figure is off by the change over (1 - r^-p). For p = 1 that is twice
    the change where steps are halved, and 1.5 times the change where panels are cut in three.
    """
    return abs(change) / (1.0 - float(ratio**-order))


def fine_error(change: float, ratio: float, order: float = 1.0) -> float:
    """Return how far the finer one of two figures is from the limit; see `coarse_error`."""
    return abs(change) / (float(ratio**order) - 1.0)


def bar_of(value: float | None, half: float | None, fine: float | None) -> float | None:
    """Return how far a figure of the paper's settings may be from the limit of fine ones.

    The scheme and the panels are both of first order: twice the change that half the step makes,
    plus 1.5 times the change that three times the panels make. The number of elements is the
    paper's and not covered. None where a part of it is missing.
    """
    if value is None or half is None or fine is None:
        return None
    return coarse_error(half - value, STEPS) + coarse_error(fine - value, PANELS)


def number_text(value: float, form: str) -> str:
    """Return a number as text, without a minus before a zero."""
    text = f"{value:{form}}"
    if float(text) == 0.0:
        text = text.replace("-", "+" if "+" in form else "")
    return text


def bar_text(bar: float) -> str:
    """Return an error bar with one digit."""
    if bar == 0.0 or not 1e-5 <= bar < 1e4:
        return f"{bar:.0e}" if bar else "0"
    return np.format_float_positional(float(f"{bar:.1g}"), trim="-")


def with_bar(value: float, bar: float | None, sign: str = "", digits: int = 6) -> str:
    """Return a number and its bar, down to the bar's digit, with so many decimals at most.

    Where there is no bar, four digits are shown; ``sign`` is ``+`` to show that of positive ones.
    """
    if bar is None:
        return number_text(value, f"{sign}.4g")
    shown = bar_text(bar)
    if bar == 0.0:
        return f"{number_text(value, f'{sign}.4g')} ± {shown}"
    # Where the bar is smaller than anybody asks for, the value ends before it.
    places = min(max(0, -math.floor(math.log10(float(shown)))), digits)
    return f"{number_text(value, f'{sign}.{places}f')} ± {shown}"
