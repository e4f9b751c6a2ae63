"""The stored results of the hard cases, as tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

__all__ = ["failures_of", "stability_tables"]


def failures_of(results: Mapping[str, Any]) -> list[str]:
    """Return in words everything that was not right."""
    found = [
        f"{run['case']}, {run['label']}: {text}"
        for run in results["runs"]
        for text in run["failures"]
    ]
    found += [text for one in results["onsets"] for text in _wrong_onset(one)]
    return found + list(results["drawn"]["failures"])


def _wrong_onset(one: Mapping[str, Any]) -> list[str]:
    """Return what is not right with how a straight body left its line."""
    label = f"straight body, N = {one['elements']}, EI {one['stiffness']:g}"
    found = []
    if not abs(one["rate"] - 1.0) <= 0.02:
        found.append(f"{label}: its rate is {one['rate']:.3f} of Kirchhoff's")
    # Less than what 1e-16 m/s aside grow to: round-off at most.
    if not one["alone"] <= 0.1 * one["tiny"]:
        found.append(f"{label}: left alone it turned by {one['alone']:.1e} rad")
    if not 1e-12 < one["tiny"] < 1e-10:
        found.append(f"{label}: 1e-16 m/s aside turned it by {one['tiny']:.1e} rad")
    return found


def stability_tables(results: Mapping[str, Any]) -> str:
    """Return the results as Markdown: a table of the cases, and one of their runs."""
    runs = list(results["runs"])
    parts = [
        _origin(results),
        "## Cases\n",
        _cases(runs),
        _drawn(results["drawn"]),
        _onsets(results["onsets"]),
        "## Runs\n",
        _runs(runs),
    ]
    failures = failures_of(results)
    if failures:
        parts.insert(1, "## Not right\n\n" + "".join(f"- {text}\n" for text in failures))
    return "\n".join(part for part in parts if part)


def _origin(results: Mapping[str, Any]) -> str:
    machine = results["machine"]
    return (
        f"Measured {results['date']} at commit {results['commit']}, kernels {results['kernels']}, "
        f"on {machine['processor']}, {machine['cores']} cores.\n"
    )


def _table(heads: tuple[str, ...], rows: Iterable[Iterable[object]]) -> str:
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    lines += [f"| {' | '.join(str(cell) for cell in row)} |" for row in rows]
    return "\n".join(lines) + "\n"


def _cases(runs: list[dict[str, Any]]) -> str:
    rows = []
    for case in dict.fromkeys(run["case"] for run in runs):
        some = [run for run in runs if run["case"] == case]
        ends = Counter(run["reason"] for run in some if run["reason"])
        compared = [run for run in some if run["agreement"] is not None]
        rows.append(
            (
                case,
                len(some),
                f"{sum(not run['reason'] for run in some)}",
                ", ".join(f"{count} {reason}" for reason, count in sorted(ends.items())) or "none",
                sum(not run["trusted"] for run in some),
                f"{sum(run['claimed'] for run in compared)} of {len(compared)}",
                f"{max(run['residual'] for run in some):.0e}",
                f"{max(run['momentum'] for run in some):.1e}",
                max(run["most_parts"] for run in some),
                f"{1e3 * max(run['slowest'] for run in some):.0f}",
                sum(bool(run["failures"]) for run in some),
            )
        )
    heads = (
        "case",
        "runs",
        "to the end",
        "explicit ends",
        "energy flagged",
        "displacement agrees with half the step",
        "largest residual",
        "momentum drift / bound",
        "most parts of a step",
        "slowest step (ms)",
        "not right",
    )
    return _table(heads, rows)


def _drawn(drawn: Mapping[str, Any]) -> str:
    if not drawn["count"]:
        return ""
    rows = [
        (reason or "to the end", count, f"{count / drawn['count']:.1%}")
        for reason, count in sorted(drawn["ends"].items(), key=lambda item: -item[1])
    ]
    return (
        f"## Drawn at random\n\n{drawn['count']:,} short runs; {len(drawn['failures'])} not right, "
        f"{drawn['untrusted']:,} flagged for their energy, slowest step "
        f"{1e3 * drawn['slowest']:.0f} ms.\n\n" + _table(("end", "runs", "share"), rows)
    )


def _onsets(onsets: list[dict[str, Any]]) -> str:
    if not onsets:
        return ""
    rows = [
        (
            one["elements"],
            f"{one['stiffness']:g}",
            f"{one['kirchhoff']:.4f}",
            f"{one['rate']:.4f}",
            f"{one['alone']:.1e}",
            f"{one['tiny']:.1e}",
        )
        for one in onsets
    ]
    heads = (
        "N",
        "EI (N m²)",
        "Kirchhoff's rate (1/s)",
        "measured rate / Kirchhoff's",
        "angle after 60 s, left alone (rad)",
        "angle after 60 s, 1e-16 m/s aside (rad)",
    )
    return "## The straight body's instability at 0.1 m/s\n\n" + _table(heads, rows)


def _runs(runs: list[dict[str, Any]]) -> str:
    rows = [
        (
            run["case"],
            run["label"],
            run["reason"] or "to the end",
            f"{run['steps']:,} of {run['wanted']:,}",
            f"{run['energy_drift']:.1e}" + ("" if run["trusted"] else " (flagged)"),
            f"{run['momentum']:.1e}",
            f"{run['cut_steps']:,} ({run['most_parts']})",
            "" if run["agreement"] is None else f"{run['agreement']:.1e}",
        )
        for run in runs
    ]
    heads = (
        "case",
        "run",
        "end",
        "steps",
        "energy drift",
        "momentum drift / bound",
        "steps cut (most parts)",
        "distance from half the step",
    )
    return _table(heads, rows)
