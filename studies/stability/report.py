"""The stored results of the hard cases, as tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from swim_agents.tables import markdown_table

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
    rate, alone, tiny = one["rate"], one["alone"], one["tiny"]
    checks = {
        f"its rate is {rate:.3f} of Kirchhoff's": abs(rate - 1.0) <= 0.02,
        # Less than what 1e-16 m/s aside grow to: round-off at most.
        f"left alone it turned by {alone:.1e} rad": alone <= 0.1 * tiny,
        f"1e-16 m/s aside turned it by {tiny:.1e} rad": 1e-12 < tiny < 1e-10,
    }
    return [f"{label}: {text}" for text, right in checks.items() if not right]


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
    runs, drawn, onsets = results["runs"], results["drawn"], results["onsets"]
    cases: dict[str, list[Record]] = {}
    for run in runs:
        cases.setdefault(run["case"], []).append(run)
    parts.append("## Cases\n\n" + _table(map(_case, cases.values())))
    if drawn["count"]:
        ends = sorted(drawn["ends"].items(), key=lambda item: -item[1])
        parts.append(
            f"## Drawn at random\n\n{drawn['count']:,} short runs; {len(drawn['failures'])} not "
            f"right, {drawn['untrusted']:,} flagged for their energy, slowest step "
            f"{1e3 * drawn['slowest']:.0f} ms."
        )
        parts.append(_table(_end(reason, count, drawn["count"]) for reason, count in ends))
    if onsets:
        table = _table(map(_onset, onsets))
        parts.append(f"## The straight body's instability at 0.1 m/s\n\n{table}")
    parts.append("## Runs\n\n" + _table(map(_run, runs)))
    return "\n\n".join(parts) + "\n"


def _case(runs: Sequence[Record]) -> Record:
    ends = Counter(run["reason"] for run in runs if run["reason"])
    explicit = ", ".join(f"{count} {reason}" for reason, count in sorted(ends.items()))
    compared = [run["claimed"] for run in runs if run["agreement"] is not None]
    return {
        "case": runs[0]["case"],
        "runs": len(runs),
        "to the end": sum(not run["reason"] for run in runs),
        "explicit ends": explicit or "none",
        "energy flagged": sum(not run["trusted"] for run in runs),
        "displacement agrees with half the step": f"{sum(compared)} of {len(compared)}",
        "largest residual": f"{max(run['residual'] for run in runs):.0e}",
        "momentum drift / bound": f"{max(run['momentum'] for run in runs):.1e}",
        "most parts of a step": max(run["most_parts"] for run in runs),
        "slowest step (ms)": f"{1e3 * max(run['slowest'] for run in runs):.0f}",
        "not right": sum(bool(run["failures"]) for run in runs),
    }


def _end(reason: str, count: int, of: int) -> Record:
    return {"end": reason or "to the end", "runs": count, "share": f"{count / of:.1%}"}


def _onset(one: Record) -> Record:
    return {
        "N": one["elements"],
        "EI (N m²)": f"{one['stiffness']:g}",
        "Kirchhoff's rate (1/s)": f"{one['kirchhoff']:.4f}",
        "measured rate / Kirchhoff's": f"{one['rate']:.4f}",
        "angle after 60 s, left alone (rad)": f"{one['alone']:.1e}",
        "angle after 60 s, 1e-16 m/s aside (rad)": f"{one['tiny']:.1e}",
    }


def _run(run: Record) -> Record:
    distance = run["agreement"]
    return {
        "case": run["case"],
        "run": run["label"],
        "end": run["reason"] or "to the end",
        "steps": f"{run['steps']:,} of {run['wanted']:,}",
        "energy drift": f"{run['energy_drift']:.1e}{'' if run['trusted'] else ' (flagged)'}",
        "momentum drift / bound": f"{run['momentum']:.1e}",
        "steps cut (most parts)": f"{run['cut_steps']:,} ({run['most_parts']})",
        "distance from half the step": "" if distance is None else f"{distance:.1e}",
    }


def _table(rows: Iterable[Record]) -> str:
    rows = list(rows)
    return markdown_table(list(rows[0]), [row.values() for row in rows]) if rows else "none"
