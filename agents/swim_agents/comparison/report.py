"""A contest's tables (text, Markdown and CSV) and the folder that keeps them with its pictures."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from swim_agents import files
from swim_agents.comparison.contest import Contest
from swim_agents.comparison.performance import Performance
from swim_agents.tables import markdown_table, text_table
from swim_env.files.folders import write_folder
from swim_env.plots import draw_bending, draw_gaits, draw_paths, draw_scores, save_figure

__all__ = [
    "CONTEST_FILES",
    "SPATIAL_CONTEST_FILES",
    "as_csv",
    "as_markdown",
    "as_text",
    "write_contest",
]

#: What a contest's folder holds, in the plane and in space.
CONTEST_FILES = (
    "comparison.json",
    "comparison.csv",
    "comparison.md",
    "scores.png",
    "paths.png",
    "gaits.png",
)
SPATIAL_CONTEST_FILES = (*CONTEST_FILES, "bending.png")

#: Columns of the tables: head, place of the figure in a policy's record, format.
_SCORES = (
    ("net displacement (BL)", "median.net_displacement", ".3f"),
    ("closed loop, finer (BL)", "median.closed_displacement", ".3f"),
    ("torques again, finer (BL)", "median.fine_displacement", ".3f"),
    ("verified", "verified", ""),
    ("to paper's wave", "ratio_to_paper_wave", ".1f"),
    ("to tuned wave", "ratio_to_tuned_wave", ".2f"),
    ("speed (BL/s)", "median.speed", ".3f"),
    ("BL per cycle", "median.displacement_per_cycle", ".4f"),
    ("positive work (J)", "median.positive_work", ".3g"),
    ("cost of transport (J/(kg m))", "median.cost_of_transport", ".3g"),
    ("torque squared (N^2 m^2 s)", "median.torque_squared", ".3g"),
)
#: The same where the score is no displacement.
_RETURNS = (
    ("{score}", "median.score", ".3f"),
    ("closed loop, finer", "median.closed_score", ".3f"),
    *_SCORES[3:4],
    *_SCORES[8:],
)
#: More of them where the task can succeed; torques are judged by a target alone.
_SUCCESSES = (
    ("succeeded", "success_rate", ".0%"),
    ("the same, finer", "verified_success_rate", ".0%"),
    ("torques again, finer", "replayed_success_rate", ".0%"),
)
#: What has no spread over training seeds.
_ONCE = ("verified", *(place for _, place, _ in _SCORES[6:]))
_CHANGES = (
    ("largest change by a finer step", "largest_change.time_step", "+.1%"),
    ("by finer panels", "largest_change.panels", "+.1%"),
    ("by finer ends", "largest_change.ends", "+.1%"),
    ("by all together", "largest_change.together", "+.1%"),
    ("in the closed loop", "largest_change.closed_loop", "+.1%"),
)
_SPATIAL_CHANGES = (
    _CHANGES[0],
    ("by panels on every shape", "largest_change.model", "+.1%"),
    *_CHANGES[3:],
)
_GAITS = (
    ("bending (Hz)", "median.gait.frequency", ".2f"),
    ("lag (rad/BL)", "median.gait.wave_number", "+.2f"),
    ("travelling share", "median.gait.travelling_share", ".2f"),
    ("torque: travelling share", "median.gait.torque_travelling_share", ".2f"),
    ("A (N m)", "median.wave.amplitude", ".2f"),
    ("f (rad/s)", "median.wave.frequency", ".2f"),
    ("kappa (rad/BL)", "median.wave.wave_number", "+.2f"),
    ("explained", "median.wave.explained", ".0%"),
)
_SPATIAL_GAITS = (
    ("bending (Hz)", "median.gait.frequency", ".2f"),
    ("plane from yaw (rad)", "median.gait.body.angle", "+.2f"),
    ("minor to major axis", "median.gait.body.ratio", ".2f"),
    ("whirl", "median.gait.body.whirl", "+.2f"),
    ("handedness", "median.gait.handedness", "+.2f"),
    ("torsion (rad/BL)", "median.gait.torsion", ".3f"),
    ("roll rate (rad/s)", "median.gait.roll_rate", "+.3f"),
    ("its deviation (rad/s)", "median.gait.roll_swing", ".3f"),
    ("head first (BL/s)", "median.gait.forward_speed", "+.3f"),
)
_AXES = tuple(
    column
    for axis in ("yaw", "pitch", "roll")
    for column in (
        (f"{axis}: rms (rad)", f"median.gait.{axis}_rms", ".3f"),
        (f"{axis}: lag (rad/BL)", f"median.gait.{axis}.wave_number", "+.2f"),
        (f"{axis}: travelling share", f"median.gait.{axis}.travelling_share", ".2f"),
        (f"{axis}: A (N m)", f"median.wave.{axis}.amplitude", ".2f"),
        (f"{axis}: explained", f"median.wave.{axis}.explained", ".0%"),
    )
)
#: What the tables in space say beside those of the plane.
_SPATIAL_WORDS = (
    " The bending of all joints, yaw and pitch, has an ellipse: its *plane* is that of the major "
    "axis, 0 for lateral and pi/2 for dorsoventral bending; its *minor* axis over the *major* one "
    "is 0 in a plane. The *whirl* is 1 where bending turns in a circle from yaw to pitch, which is "
    "right-handed about the head's direction, and -1 the other way; the *handedness* is 1 for "
    "right-handed and -1 for left-handed helices along the body, and both are 0 in a plane. The "
    "*roll rate* is that of the body about its axis from head to tail."
)


def _scores(record: dict[str, Any]) -> tuple[tuple[str, str, str], ...]:
    """Return the columns of the scores."""
    chosen = _SCORES if record["score"].startswith("net displacement") else _RETURNS
    columns = tuple((head.format(**record), *rest) for head, *rest in chosen)
    succeeds = any(one["success_rate"] is not None for one in record["policies"].values())
    return columns + (_SUCCESSES if succeeds else ())  # type: ignore[return-value]


def _rows(record: dict[str, Any], columns: Sequence[tuple[str, str, str]]) -> list[list[str]]:
    rows = [["policy", *(name for name, _, _ in columns)]]
    for policy, one in record["policies"].items():
        rows.append([policy, *(_cell(one, place, form) for _, place, form in columns)])
    return rows


def _cell(value: Any, place: str, form: str) -> str:
    for name in place.split("."):
        value = None if value is None else value[name]
    if isinstance(value, list):
        return f"{sum(value)} of {len(value)}"
    return "-" if value is None else format(value, form)


def _spread_rows(record: dict[str, Any]) -> list[list[str]]:
    rows = [["trained with several seeds", "runs", "figure", "median", "least", "most"]]
    shown = [one for one in _scores(record) if one[1] not in _ONCE]
    for group, found in record["groups"].items():
        for label, place, _ in shown:
            key = place.removeprefix("median.")
            if key in found:
                spread = found[key]
                values = [f"{spread[part]:.3f}" for part in ("median", "min", "max")]
                rows.append([group, str(len(found["members"])), label, *values])
    return rows


def _tables(record: dict[str, Any]) -> list[list[list[str]]]:
    beside = (_SPATIAL_CHANGES, _SPATIAL_GAITS, _AXES) if _in_space(record) else (_CHANGES, _GAITS)
    tables = [_rows(record, columns) for columns in (_scores(record), *beside)]
    tables.append(_spread_rows(record))
    return [table for table in tables if len(table) > 1]


def _in_space(record: dict[str, Any]) -> bool:
    return "dimension" in record["scene_fields"]


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
        parts.append(text_table(table if "runs" in table[0] else zip(*table, strict=True)))
    return "\n\n".join(parts)


def as_markdown(record: dict[str, Any]) -> str:
    """Return a page with the tables and the pictures that `write_contest` puts beside it."""
    where = f"Commit {record['commit']}, {record['machine']['processor']}, {record['date']}."
    space = _in_space(record)
    finer, alone = "three times the panels on sides and ends", "the step, the panels or the ends"
    if space:
        finer, alone = "panels on every shape", "the step or the fluid's model"
    parts = [f"# {record['scene']}: policies compared", f"{_caption(record)}. {where}"]
    parts.append(
        f"*Finer* computations verify a score, at a quarter of the time step and with {finer}: in "
        "the *closed loop* the policy plays the episode once more, and its *torques* are played "
        "*again*, without feedback. A displacement is verified when it changes by at most "
        f"{record['tolerance']:.0%} in both, and by at most {record['source_tolerance']:.0%} with "
        f"{alone} refined alone; "
        f"a return, when it changes by at most {record['tolerance']:.0%} in the closed loop; a "
        "success, when the closed loop has it as well (the torques alone reach a target within "
        f"{1.0 + record['tolerance']:.1f} of its radius). Changes are shares of the score, the "
        "largest of all starts. *A*, *f* and *kappa* are those "
        "of the travelling wave nearest to the torques, *explained* is its share of their mean "
        "square; *lag* is the slope "
        "of the bending's phase along the body, positive from head to tail; the *travelling share* "
        "is 0 for a standing and 1 for a travelling wave (complex orthogonal decomposition)."
        + (_SPATIAL_WORDS if space else "")
    )
    for table in _tables(record):
        parts.append(markdown_table(table[0], table[1:]))
    pictures = {
        "scores.png": "Net displacement of every start",
        "paths.png": "Paths and shapes",
        "gaits.png": "Torques and bending along the body over time",
    }
    if space:
        pictures["bending.png"] = "Planes of bending along the body"
    for name, text in pictures.items():
        parts.append(f"![{text}]({name})")
    return "\n\n".join(parts) + "\n"


def as_csv(record: dict[str, Any]) -> str:
    """Return a line for each policy and start, with all its figures."""
    names = [one.name for one in fields(Performance) if one.name not in ("seed", "gait")]
    rows = [["policy", "seed", *names]]
    for policy, one in record["policies"].items():
        for i, seed in enumerate(record["seeds"]):
            rows.append([policy, seed, *(one[name][i] for name in names)])
    return files.as_csv(rows)


def write_contest(contest: Contest, folder: str | os.PathLike[str]) -> None:
    """Write record, tables and pictures into a folder, all of them or none.

    It is a SwimError if the folder holds other files, or cannot be written.
    """
    record = contest.record
    first: dict[str, Any] = {name: runs[0] for name, runs in contest.trajectories.items()}
    gaits = {name: record["policies"][name]["gait"][0] for name in first}
    goals = None
    if all(rollouts[0].task.has_target for rollouts in contest.rollouts.values()):
        goals = {name: rollouts[0].goal for name, rollouts in contest.rollouts.items()}

    def write(ready: Path) -> None:
        (ready / "comparison.json").write_bytes(files.as_json(record))
        (ready / "comparison.csv").write_text(as_csv(record), encoding="utf-8")
        (ready / "comparison.md").write_text(as_markdown(record), encoding="utf-8")
        save_figure(draw_scores(record), ready / "scores.png")
        save_figure(draw_paths(first, goals), ready / "paths.png")
        save_figure(draw_gaits(first, gaits), ready / "gaits.png")
        if contest.scene.dimension == 3:
            save_figure(draw_bending(first, gaits), ready / "bending.png")

    write_folder(folder, SPATIAL_CONTEST_FILES, write)
