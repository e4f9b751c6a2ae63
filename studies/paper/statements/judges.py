"""Judges, which read the data and return a finding, in the forms that several statements share."""

from __future__ import annotations

from collections.abc import Callable

from studies.paper.measures import Run, net_speed
from studies.paper.runs import NUMERALS
from studies.paper.verdicts import Data, Finding, Value, all_of, listed, ratio_of, values_of

#: From the data to a finding.
Judge = Callable[[Data], Finding]
#: Shorter runs (s) say nothing of paths that the paper shows over 100 s.
WHOLE = 90.0


def compared(
    names: str,
    pick: Callable[[Run], float],
    words: str,
    rule: Callable[..., str],
    least: float = 10.0,
    before: str = "",
) -> Judge:
    """Return a judge of the same figure of one or several runs, each shown by ``words``.

    The rule takes the figures in the order of the names.
    """

    def judge(data: Data) -> Finding:
        values = values_of(data, names.split(), pick, least)
        several = len(values) > 1
        shown = listed(values, words) if several else words.format(values[names].text())
        return Finding(before + shown, rule(*values.values()))

    return judge


def in_ratio(over: str, under: str, rule: Callable[[Value], str], words: str = "ratio") -> Judge:
    """Return a judge of the ratio of two net speeds."""

    def judge(data: Data) -> Finding:
        names = sorted((over, under), key=NUMERALS.index)
        speeds, ratio = values_of(data, names, net_speed), ratio_of(data, over, under, net_speed)
        return Finding(f"{listed(speeds, '{} BL/s')}; {words} {ratio.text()}", rule(ratio))

    return judge


def each(rule: Callable[[Value], str]) -> Callable[..., str]:
    """Return the rule that all figures follow a rule."""
    return lambda *values: all_of(rule(one) for one in values)
