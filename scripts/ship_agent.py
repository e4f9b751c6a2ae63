#!/usr/bin/env python
"""Score the best agent of a training run on unseen starts, and put it among those that ship."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from swim_agents.commands.command_line import add_options, print_result, run, share_bar
from swim_agents.comparison.contest import FIRST_SEED, entries_of, hold_contest
from swim_agents.learning.saved import load_agent
from swim_agents.learning.shipping import SHIPPED_FILES, scores_of, ship_agent
from swim_agents.policies import PRETRAINED_FOLDER

from swim_env.envs.geometry import geometry_of
from swim_env.errors import SwimError
from swim_env.files.folders import check_folder
from swim_env.files.names import file_name
from swim_env.plots import require_matplotlib
from swim_env.scene import Scene


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", metavar="RUN", help="folder of a finished training run")
    parser.add_argument("--name", help="of the agent; the run's own unless given")
    parser.add_argument(
        "--starts",
        type=int,
        default=20,
        metavar="N",
        help=f"number of starts to score it on: seeds from {FIRST_SEED}, which no training draws",
    )
    parser.add_argument(
        "--output",
        metavar="FOLDER",
        help="where the agent's folder goes; agents/pretrained unless given",
    )
    add_options(parser, "json")
    return parser


def _line(name: str, scores: dict[str, Any]) -> str:
    middle = scores["median"]
    text = (
        f"{name}: {middle['net_displacement']:.3f} BL (finer {middle['closed_displacement']:.3f})"
    )
    text += f", {sum(scores['verified'])} of {len(scores['verified'])} starts verified"
    if scores["success_rate"] is None:
        return text
    shares = scores["success_rate"], scores["verified_success_rate"]
    return f"{text}, {shares[0]:.0%} of the targets reached ({shares[1]:.0%} finer)"


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    options = _parser().parse_args(arguments)
    require_matplotlib()
    if options.starts < 1:
        raise SwimError(f"--starts must be at least 1, got {options.starts}")
    about = load_agent(Path(options.run) / "agent").description
    name = file_name(options.name or str(about["name"]))
    folder = Path(options.output or PRETRAINED_FOLDER) / name
    check_folder(folder, SHIPPED_FILES)
    scene, task = Scene.from_dict(about["scene"]), str(about["task"])
    entries = entries_of([str(Path(options.run) / "agent")], scene, task)
    if task == "target":
        entries = entries[-1:]  # waves aim at nothing
    geometry_of(scene).load()
    with share_bar("score") as progress:
        contest = hold_contest(
            scene,
            entries,
            range(FIRST_SEED, FIRST_SEED + options.starts),
            task,
            environment=about["environment"],
            progress=progress,
        )
    scores = scores_of(contest.record, entries[-1].name)
    ship_agent(options.run, folder, scores)
    print(f"the agent is in {folder}", file=sys.stderr)
    print_result(scores, options.json, lambda: _line(name, scores))
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
