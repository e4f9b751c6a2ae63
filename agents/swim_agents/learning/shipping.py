"""Turning a training run into an agent that ships: its files, its curve, its scores."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swim_agents.files import as_json
from swim_agents.learning.config import config_names, load_config
from swim_agents.learning.logs import read_log
from swim_agents.learning.saved import load_agent
from swim_agents.learning.trainer import run_status
from swim_env.errors import SwimError
from swim_env.files.folders import write_folder
from swim_env.plots import draw_training, save_figure

__all__ = ["SHIPPED_FILES", "command_of", "scores_of", "ship_agent"]

#: What the folder of an agent that ships holds.
SHIPPED_FILES = (
    "agent.json",
    "model.zip",
    "config.yaml",
    "evaluations.csv",
    "progress.csv",
    "training.png",
    "scores.json",
)

#: What scores say of the contest that they are from.
_ABOUT = (
    *("scene", "task", "duration", "noise", "environment", "seeds"),
    *("tolerance", "source_tolerance", "commit", "machine", "versions", "date"),
)


def command_of(run: str | os.PathLike[str]) -> str:
    """Return the command that repeats a run: with a shipped configuration, or what was typed."""
    place = Path(run)
    status = run_status(place)
    if status is None:
        raise SwimError(f"no training run there ({place})")
    kept = _settings(place / "config.yaml")
    name = str(status["name"])
    if name in config_names() and _settings(name) == kept:
        return f"swim-env train {name} --seeds {status['seed']}"
    return str(status["command"])


def _settings(config: str | os.PathLike[str]) -> dict[str, Any]:
    """Return all of a configuration that decides a run."""
    data = load_config(config).to_dict()
    del data["description"], data["scene"]["description"]
    return data


def scores_of(record: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return an agent's part of a contest's record, without the gait of every single start."""
    one = {key: value for key, value in record["policies"][name].items() if key != "training"}
    one.pop("gait", None)
    one["durations"] = one.pop("duration")
    return {**{key: record[key] for key in _ABOUT}, **one}


def ship_agent(
    run: str | os.PathLike[str], folder: str | os.PathLike[str], scores: Mapping[str, Any]
) -> None:
    """Write the folder of an agent that ships, whole or not at all.

    It is the best agent of a finished training run (else SwimError), with `scores_of` a contest.
    """
    place = Path(run)
    status = run_status(place)
    if status is None or not status["finished"]:
        raise SwimError(f"only a finished training run can ship ({place})")
    agent = load_agent(place / "agent")
    description = {**agent.description, "name": Path(folder).name}
    description["training"] = {
        **description["training"],
        "command": command_of(place),
        "run_steps": status["steps"],
        "run_seconds": status["seconds"],
    }
    for one in description["training"].get("resumed", []):
        one.pop("command", None)  # what was typed names folders of the machine
    curve = read_log(place / "evaluations.csv")

    def write(ready: Path) -> None:
        for name in ("config.yaml", "evaluations.csv", "progress.csv"):
            shutil.copyfile(place / name, ready / name)
        shutil.copyfile(place / "agent" / "model.zip", ready / "model.zip")
        (ready / "agent.json").write_bytes(as_json(description))
        (ready / "scores.json").write_bytes(as_json(dict(scores)))
        figure = draw_training({str(status["name"]): [curve]}, description["task"])
        save_figure(figure, ready / "training.png")

    write_folder(folder, SHIPPED_FILES, write)
