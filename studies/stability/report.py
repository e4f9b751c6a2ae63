"""The stored results of the hard cases, as tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from swim_env.files.tables import markdown_table

__all__ = ["failures_of", "stability_tables"]

Record = Mapping[str, Any]


def failures_of(results: Record) -> list[str]:
    """Return in words everything that was not right."""
    found = [
        f"{run['case']}, {run['label']}: {text}"
        for run in results["runs"]
        for text in run["failures"]
    ]
    found += [text for one in results["onsets"] for text in _wrong_onset(one)]
    return found + list(results["drawn"]["failures"])


def _wrong_onset(one: Record) -> list[str]:
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


def stability_tables(results: Record) -> str:
    """Return the results as Markdown: a table of the cases, and one of their runs."""
    machine = results["machine"]
    parts = [
        f"Measured {results['date']} at commit {results['commit']}, kernels {results['kernels']}, "
        f"on {machine['processor']}, {machine['cores']} cores."
    ]
    failures = failures_of(results)
    if failures:
        parts.append("## Not right\n\n" + "\n".join(f"- {text}" for text in failures))
    parts += [
        "## Cases\n\n" + _cases(results["runs"]),
        _drawn(results["drawn"]),
        _onsets(results["onsets"]),
        "## Runs\n\n" + _runs(results["runs"]),
    ]
    return "\n\n".join(filter(None, parts)) + "\n"


def _cases(runs: Sequence[Record]) -> str:
    rows = []
    for case in dict.fromkeys(run["case"] for run in runs):
        some = [run for run in runs if run["case"] == case]
        ends = Counter(run["reason"] for run in some if run["reason"])
        compared = [run for run in some if run["agreement"] is not None]
        row = {
            "case": case,
            "runs": len(some),
            "to the end": sum(not run["reason"] for run in some),
            "explicit ends": ", ".join(
                f"{count} {reason}" for reason, count in sorted(ends.items())
            )
            or "none",
            "energy flagged": sum(not run["trusted"] for run in some),
            "displacement agrees with half the step": (
                f"{sum(run['claimed'] for run in compared)} of {len(compared)}"
            ),
            "largest residual": f"{max(run['residual'] for run in some):.0e}",
            "momentum drift / bound": f"{max(run['momentum'] for run in some):.1e}",
            "most parts of a step": max(run["most_parts"] for run in some),
            "slowest step (ms)": f"{1e3 * max(run['slowest'] for run in some):.0f}",
            "not right": sum(bool(run["failures"]) for run in some),
        }
        rows.append(row)
    return _table(rows)


def _drawn(drawn: Record) -> str:
    if not drawn["count"]:
        return ""
    rows = [
        {"end": reason or "to the end", "runs": count, "share": f"{count / drawn['count']:.1%}"}
        for reason, count in sorted(drawn["ends"].items(), key=lambda item: -item[1])
    ]
    return (
        f"## Drawn at random\n\n{drawn['count']:,} short runs; {len(drawn['failures'])} not right, "
        f"{drawn['untrusted']:,} flagged for their energy, slowest step "
        f"{1e3 * drawn['slowest']:.0f} ms.\n\n{_table(rows)}"
    )


def _onsets(onsets: Sequence[Record]) -> str:
    if not onsets:
        return ""
    rows = [
        {
            "N": one["elements"],
            "EI (N m²)": f"{one['stiffness']:g}",
            "Kirchhoff's rate (1/s)": f"{one['kirchhoff']:.4f}",
            "measured rate / Kirchhoff's": f"{one['rate']:.4f}",
            "angle after 60 s, left alone (rad)": f"{one['alone']:.1e}",
            "angle after 60 s, 1e-16 m/s aside (rad)": f"{one['tiny']:.1e}",
        }
        for one in onsets
    ]
    return f"## The straight body's instability at 0.1 m/s\n\n{_table(rows)}"


def _runs(runs: Sequence[Record]) -> str:
    rows = [
        {
            "case": run["case"],
            "run": run["label"],
            "end": run["reason"] or "to the end",
            "steps": f"{run['steps']:,} of {run['wanted']:,}",
            "energy drift": f"{run['energy_drift']:.1e}{'' if run['trusted'] else ' (flagged)'}",
            "momentum drift / bound": f"{run['momentum']:.1e}",
            "steps cut (most parts)": f"{run['cut_steps']:,} ({run['most_parts']})",
            "distance from half the step": (
                "" if run["agreement"] is None else f"{run['agreement']:.1e}"
            ),
        }
        for run in runs
    ]
    return _table(rows)


def _table(rows: Sequence[Mapping[str, object]]) -> str:
    return markdown_table(list(rows[0]), [row.values() for row in rows]) if rows else "none"
