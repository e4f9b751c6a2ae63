"""The folder that keeps what came of a contest."""

from __future__ import annotations

import json
import os
from pathlib import Path

from swim_agents.comparison.contest import Contest
from swim_agents.comparison.report import as_csv, as_markdown
from swim_env.files.folders import check_folder, write_folder
from swim_env.plots import draw_gaits, draw_paths, draw_scores, save_figure

__all__ = ["CONTEST_FILES", "check_contest_folder", "write_contest"]

#: What the folder holds.
CONTEST_FILES = (
    "comparison.json",
    "comparison.csv",
    "comparison.md",
    "scores.png",
    "paths.png",
    "gaits.png",
)


def check_contest_folder(folder: str | os.PathLike[str]) -> None:
    """Refuse a folder that holds anything but an earlier comparison.

    Raises
    ------
    SwimError
        If it does, or if the path is a file.
    """
    check_folder(folder, CONTEST_FILES)


def write_contest(contest: Contest, folder: str | os.PathLike[str]) -> None:
    """Write record, tables and pictures into a folder, all of them or none.

    Raises
    ------
    SwimError
        If the folder holds other files, or cannot be written.
    """
    record = contest.record
    first = {name: runs[0] for name, runs in contest.trajectories.items()}
    gaits = {name: record["policies"][name]["gait"][0] for name in first}
    goals = None
    if contest.task == "target":
        goals = {name: rollouts[0].goal for name, rollouts in contest.rollouts.items()}

    def write(ready: Path) -> None:
        text = json.dumps(record, indent=1, allow_nan=False)
        (ready / "comparison.json").write_text(text + "\n", encoding="utf-8")
        (ready / "comparison.csv").write_text(as_csv(record), encoding="utf-8")
        (ready / "comparison.md").write_text(as_markdown(record), encoding="utf-8")
        save_figure(draw_scores(record), ready / "scores.png")
        save_figure(draw_paths(first, goals), ready / "paths.png")
        save_figure(draw_gaits(first, gaits), ready / "gaits.png")

    write_folder(folder, CONTEST_FILES, write)
