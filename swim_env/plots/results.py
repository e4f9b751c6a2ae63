"""The folder that keeps a replayed run: summary, trajectory, scene and picture."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from swim_env.files.folders import write_folder
from swim_env.plots.stills import draw_path
from swim_env.plots.style import save_figure
from swim_env.sim.trajectory import Trajectory

__all__ = ["RESULT_FILES", "write_results"]

#: What a result folder holds.
RESULT_FILES = ("summary.json", "trajectory.npz", "scene.yaml", "path.png")


def write_results(
    trajectory: Trajectory, summary: dict[str, Any], folder: str | os.PathLike[str]
) -> None:
    """Write summary, trajectory, scene and picture into a folder, all of them or none.

    It is a SwimError if the folder holds other files, or cannot be written.
    """

    def write(ready: Path) -> None:
        text = json.dumps(summary, indent=2, allow_nan=False)
        (ready / "summary.json").write_text(text + "\n", encoding="utf-8")
        trajectory.save(ready / "trajectory.npz")
        trajectory.scene.save(ready / "scene.yaml")
        save_figure(draw_path(trajectory), ready / "path.png")

    write_folder(folder, RESULT_FILES, write)
