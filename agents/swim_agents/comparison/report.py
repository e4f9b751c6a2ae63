"""A contest's tables: text, Markdown and CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

__all__ = ["as_csv", "as_markdown", "as_text"]


def _number(value: float | None, form: str, missing: str = "-") -> str:
    return missing if value is None else format(value, form)


def _score_rows(record: dict[str, Any]) -> list[list[str]]:
    target = record["task"] == "target"
    head = ["policy", "net displacement (BL)", "finer computation (BL)", "verified"]
    head += ["to paper's wave", "to tuned wave", "speed (BL/s)", "BL per cycle"]
    head += ["positive work (J)", "cost of transport (J/(kg m))", "torque squared (N^2 m^2 s)"]
    rows = [head + (["targets reached", "the same, finer"] if target else [])]
    for name, one in record["policies"].items():
        middle = one["median"]
        row = [
            name,
            _number(middle["net_displacement"], ".3f"),
            _number(middle["fine_displacement"], ".3f"),
            f"{sum(one['verified'])} of {len(one['verified'])}",
            _number(one["ratio_to_paper_wave"], ".1f"),
            _number(one["ratio_to_tuned_wave"], ".2f"),
            _number(middle["speed"], ".3f"),
            _number(middle["displacement_per_cycle"], ".4f"),
            _number(middle["positive_work"], ".3g"),
            _number(middle["cost_of_transport"], ".3g"),
            _number(middle["torque_squared"], ".3g"),
        ]
        if target:
            row += [_number(one[f"{part}success_rate"], ".0%") for part in ("", "verified_")]
        rows.append(row)
    return rows


def _gait_rows(record: dict[str, Any]) -> list[list[str]]:
    rows = [
        [
            "policy",
            "bending (Hz)",
            "lag (rad/BL)",
            "travelling share",
            "torque: travelling share",
            "A (N m)",
            "f (rad/s)",
            "kappa (rad/BL)",
            "explained",
        ]
    ]
    for name, one in record["policies"].items():
        gait, wave = one["median"]["gait"], one["median"]["wave"] or {}
        rows.append(
            [
                name,
                _number(gait["frequency"], ".2f"),
                _number(gait["wave_number"], "+.2f"),
                _number(gait["travelling_share"], ".2f"),
                _number(gait["torque_travelling_share"], ".2f"),
                _number(wave.get("amplitude"), ".2f"),
                _number(wave.get("frequency"), ".2f"),
                _number(wave.get("wave_number"), "+.2f"),
                _number(wave.get("explained"), ".0%"),
            ]
        )
    return rows


def _spread_rows(record: dict[str, Any]) -> list[list[str]]:
    rows = [["trained with several seeds", "runs", "figure", "median", "least", "most"]]
    names = {
        "net_displacement": "net displacement (BL)",
        "fine_displacement": "finer computation (BL)",
        "ratio_to_paper_wave": "to paper's wave",
        "ratio_to_tuned_wave": "to tuned wave",
        "success_rate": "targets reached",
        "verified_success_rate": "the same, finer",
    }
    for group, found in record["groups"].items():
        for key, label in names.items():
            if key in found:
                spread = found[key]
                values = [f"{spread[part]:.3f}" for part in ("median", "min", "max")]
                rows.append([group, str(len(found["members"])), label, *values])
    return rows if len(rows) > 1 else []


def _tables(record: dict[str, Any]) -> list[list[list[str]]]:
    tables = [_score_rows(record), _gait_rows(record)]
    spread = _spread_rows(record)
    return [*tables, spread] if spread else tables


def _caption(record: dict[str, Any]) -> str:
    seeds = record["seeds"]
    tuned = "" if record["tuned_on"] is None else f"; the wave was tuned on {record['tuned_on']}"
    return (
        f"Scene {record['scene']}, task {record['task']}, {record['duration']:g} s, medians over "
        f"{len(seeds)} start{'s' if len(seeds) > 1 else ''} (seeds {_ranges(seeds)}){tuned}"
    )


def _ranges(seeds: Sequence[int]) -> str:
    if len(seeds) > 2 and list(seeds) == list(range(seeds[0], seeds[-1] + 1)):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(map(str, seeds[:12])) + (" ..." if len(seeds) > 12 else "")


def as_text(record: dict[str, Any]) -> str:
    """Return the tables for a terminal: a policy a column, so that they fit."""
    parts = [_caption(record)]
    for table in _tables(record):
        rows = table if "runs" in table[0] else [list(row) for row in zip(*table, strict=True)]
        widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
        lines = [
            "  ".join(
                cell.ljust(width) if i == 0 else cell.rjust(width)
                for i, (cell, width) in enumerate(zip(row, widths, strict=True))
            ).rstrip()
            for row in rows
        ]
        parts.append("\n".join(lines))
    return "\n\n".join(parts)


def as_markdown(record: dict[str, Any]) -> str:
    """Return a page with the tables and the pictures that `write_contest` puts beside it."""
    where = f"Commit {record['commit']}, {record['machine']['processor']}, {record['date']}."
    parts = [f"# {record['scene']}: policies compared", f"{_caption(record)}. {where}"]
    parts.append(
        "*Finer computation* is the trust check: the same torques played again at a quarter of "
        "the time step with 12 panels on every element; a score is verified when the two agree "
        f"within {record['tolerance']:.0%}. A target counts as reached in it where it comes within "
        f"{1.0 + record['tolerance']:.1f} of the target's radius. *A*, *f* and *kappa* are those "
        "of the travelling wave nearest to the torques, *explained* is its share of their mean "
        "square; *lag* is the slope "
        "of the bending's phase along the body, positive from head to tail; the *travelling share* "
        "is 0 for a standing and 1 for a travelling wave (complex orthogonal decomposition)."
    )
    for table in _tables(record):
        head, *rows = table
        lines = [" | ".join(row) for row in [head, ["---"] * len(head), *rows]]
        parts.append("\n".join(f"| {line} |" for line in lines))
    for name, text in (
        ("scores.png", "Net displacement of every start"),
        ("paths.png", "Paths and shapes"),
        ("gaits.png", "Torques and bending along the body over time"),
    ):
        parts.append(f"![{text}]({name})")
    return "\n\n".join(parts) + "\n"


def as_csv(record: dict[str, Any]) -> str:
    """Return a line for each policy and start, with all its figures."""
    names = [
        "net_displacement",
        "fine_displacement",
        "verified",
        "duration",
        "speed",
        "displacement_per_cycle",
        "positive_work",
        "cost_of_transport",
        "torque_squared",
        "heading_change",
        "energy_drift",
        "success",
        "fine_distance",
        "termination_reason",
    ]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["policy", "seed", *names])
    for policy, one in record["policies"].items():
        for i, seed in enumerate(record["seeds"]):
            row = [one[name][i] for name in names]
            writer.writerow([policy, seed, *("" if value is None else value for value in row)])
    return text.getvalue()
