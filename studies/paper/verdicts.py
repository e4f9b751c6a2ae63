"""Verdicts, figures with their error bars, and the one rule that turns these into those.

A figure agrees with a limit where its whole bar does, differs where none of it does, and is
undecided where the bar spans the limit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from studies.paper.bars import STEPS, bar_of, coarse_error, with_bar

#: Of `studies.paper.suite.collect`.
Data = Mapping[str, Any]

#: What follows the name of a run: its own settings, half the step, and fine panels.
LEVELS = ("", "_half", "_fine")

AGREE, DIFFER, UNDECIDED, NOT_MEASURED = "agree", "differ", "undecided", "not measured"


class MissingError(Exception):
    """The data do not hold what a statement needs."""


@dataclass(frozen=True)
class Finding:
    """What was found about a statement."""

    #: Our figures in words, with error bars.
    measured: str
    #: One of AGREE, DIFFER, UNDECIDED and NOT_MEASURED.
    verdict: str
    #: The reason, where it is known.
    why: str = ""


@dataclass(frozen=True)
class Value:
    """A figure and its error bar, in one unit."""

    value: float
    bar: float

    def text(self) -> str:
        """Return both as text, down to the bar's digit."""
        return with_bar(self.value, self.bar, digits=7)

    def size(self) -> Value:
        """Return the figure without its sign."""
        return Value(abs(self.value), self.bar)

    def times(self, side: float) -> Value:
        """Return the figure with its sign kept or turned, by 1 or -1."""
        return Value(side * self.value, self.bar)

    def over(self, other: Value) -> Value:
        """Return the ratio to another figure, whose bar is independent of this one's."""
        ratio = self.value / other.value
        shares = abs(self.bar / self.value) if self.value else 0.0
        return Value(ratio, abs(ratio) * (shares + abs(other.bar / other.value)))

    def above(self, limit: float) -> str:
        """Return the verdict on a figure that should be above a limit: the one rule for all."""
        if self.value - self.bar > limit:
            return AGREE
        return DIFFER if self.value + self.bar <= limit else UNDECIDED

    def at_most(self, limit: float) -> str:
        """Return the verdict on a figure that should not be above a limit."""
        return {AGREE: DIFFER, DIFFER: AGREE, UNDECIDED: UNDECIDED}[self.above(limit)]

    def within(self, target: float, tolerance: float) -> str:
        """Return the verdict on a figure that should be as near to another as a tolerance."""
        return Value(abs(self.value - target), self.bar).at_most(tolerance)

    def larger_than(self, other: Value) -> str:
        """Return the verdict on a figure that should be larger than another."""
        return Value(self.value - other.value, self.bar + other.bar).above(0.0)


def all_of(verdicts: Iterable[str]) -> str:
    """Return the verdict on several parts: one that differs decides, then one that is undecided."""
    found = set(verdicts)
    return next(one for one in (DIFFER, UNDECIDED, AGREE) if one in found)


def at_least_one_of(verdicts: Iterable[str]) -> str:
    """Return the verdict on alternatives: one that agrees decides, then one that is undecided."""
    found = set(verdicts)
    return next(one for one in (AGREE, UNDECIDED, DIFFER) if one in found)


def yes(holds: bool) -> str:
    """Return the verdict on what is exact, or is an error itself: it has no bar."""
    return AGREE if holds else DIFFER


# ---- figures of the data -----------------------------------------------------------------------


def run_of(data: Data, name: str, least: float = 2.0) -> Data:
    """Return a run's figures; MissingError if there is none, or it ended before ``least`` (s)."""
    run: Data | None = data["runs"].get(name)
    if run is None:
        raise MissingError(f"no run {name}")
    if run["end"]:
        raise MissingError(f"run {name} ended early: {run['end']}")
    if run["duration"] < least - 1e-9:
        raise MissingError(f"run {name} lasts {run['duration']:g} s, this needs {least:g}")
    return run


def value_of(data: Data, name: str, pick: Callable[[Data], float], least: float = 10.0) -> Value:
    """Return a figure of a run with its error bar, from half the step and from fine panels."""
    value = pick(run_of(data, name, least))
    try:
        bar = bar_of(value, *(pick(run_of(data, name + level, least)) for level in LEVELS[1:]))
    except MissingError:
        raise MissingError(f"no finer runs of {name}") from None
    return Value(value, bar or 0.0)


def values_of(
    data: Data, names: Iterable[str], pick: Callable[[Data], float], least: float = 10.0
) -> dict[str, Value]:
    """Return a figure of several runs by name; see `value_of`."""
    return {name: value_of(data, name, pick, least) for name in names}


def ratio_of(data: Data, over: str, under: str, pick: Callable[[Data], float]) -> Value:
    """Return the ratio of a figure in two runs, with its own error bar.

    What step and panels do to both alike cancels, so it is known better than either.
    """
    values = []
    for level in LEVELS:
        divisor = pick(run_of(data, f"{under}{level}", 10.0))
        if divisor == 0.0:
            raise MissingError(f"{under} does not move")
        values.append(pick(run_of(data, f"{over}{level}", 10.0)) / divisor)
    return Value(values[0], bar_of(*values) or 0.0)


def listed(values: Mapping[str, Value], form: str) -> str:
    """Return figures by name as one text."""
    return "; ".join(f"{name}: " + form.format(value.text()) for name, value in values.items())


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
    keys = ("elements", "panels", "perturbation", "stiffness", "step", "model")
    return next((one for one in data["onset"] if tuple(one[key] for key in keys) == wanted), None)


def onset_time(data: Data, elements: int, panels: int, kind: str) -> Value | None:
    """Return the time of the first deviation (s) with the bar of the step, None if there is none.

    Panels are given, not converged to: the paper's times are compared at the paper's panels. It is
    a MissingError if it was not computed, or not with half the step.
    """
    body = f"N = {elements}, {panels} panels, {kind}"
    found = onset_of(data, elements, panels, kind)
    if found is None:
        raise MissingError(f"no onset of {body}")
    pairs = onset_pairs(data, elements, panels, kind)
    if not pairs:
        raise MissingError(f"no half step of {body}")
    if found["time"] is None:
        return None
    base, half = pairs[0]
    if None in (base["time"], half["time"]):
        raise MissingError(f"no onset with half the step, N = {elements}, {panels}, {kind}")
    return Value(found["time"], coarse_error(half["time"] - base["time"], STEPS))


def onset_pairs(data: Data, elements: int, panels: int, kind: str) -> list[tuple[Data, Data]]:
    """Return runs that have another one with half the step beside them, by panels or frozen."""
    found = []
    for model in ("panels", "frozen"):
        base = onset_of(data, elements, panels, kind, model=model)
        half = onset_of(data, elements, panels, kind, step=0.005, model=model)
        if base is not None and half is not None:
            found.append((base, half))
    return found
