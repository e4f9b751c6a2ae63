"""Judges, which read the data and return a finding, in the forms that several statements share."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from studies.paper.measures import Run, net_speed
from studies.paper.runs import NUMERALS
from studies.paper.verdicts import (
    Data,
    Finding,
    Value,
    all_of,
    listed,
    ratio_of,
    value_of,
    values_of,
)

#: From the data to a finding.
Judge = Callable[[Data], Finding]
#: Shorter runs (s) say nothing of paths that the paper shows over 100 s.
WHOLE = 90.0


def measured(
    name: str,
    pick: Callable[[Run], float],
    words: str,
    rule: Callable[[Value], str],
    least: float = 10.0,
) -> Judge:
    """Return a judge of one figure of a run, which ``words`` shows in the place of ``{}``."""

    def judge(data: Data) -> Finding:
        value = value_of(data, name, pick, least)
        return Finding(words.format(value.text()), rule(value))

    return judge


def compared(
    names: str,
    pick: Callable[[Run], float],
    words: str,
    rule: Callable[[Mapping[str, Value]], str],
    least: float = 10.0,
    before: str = "",
) -> Judge:
    """Return a judge of the same figure of several runs, each shown by ``words``."""

    def judge(data: Data) -> Finding:
        values = values_of(data, names.split(), pick, least)
        return Finding(before + listed(values, words), rule(values))

    return judge


def in_ratio(over: str, under: str, rule: Callable[[Value], str], words: str = "ratio") -> Judge:
    """Return a judge of the ratio of two net speeds."""

    def judge(data: Data) -> Finding:
        names = sorted((over, under), key=NUMERALS.index)
        speeds, ratio = values_of(data, names, net_speed), ratio_of(data, over, under, net_speed)
        return Finding(f"{listed(speeds, '{} BL/s')}; {words} {ratio.text()}", rule(ratio))

    return judge


def each(rule: Callable[[Value], str]) -> Callable[[Mapping[str, Value]], str]:
    """Return the rule that all figures follow a rule."""
    return lambda values: all_of(rule(one) for one in values.values())
