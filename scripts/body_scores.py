#!/usr/bin/env python
"""Tune a wave and train an agent, with the settings that ship, on eight unlike bodies.

The bodies are those of studies/bodies. Runs go into a folder each and are continued if it is there.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

from swim_agents.commands.command_line import add_options, print_result, progress_bar, run
from swim_agents.files import check_file, write_json
from swim_agents.learning.config import load_config
from swim_agents.learning.trainer import train
from swim_agents.policies import load_policy
from swim_agents.rollout import play_episode
from swim_agents.tables import text_table
from swim_agents.tuning import search_wave

from swim_env import SwimEnv, load_scene, natural_frequencies
from swim_env.files.provenance import where_and_when

BODIES = Path(__file__).parents[1] / "studies" / "bodies"
#: Seed of the start from which the trained agent is judged; no training draws it.
_SEED = 2_000_000


def measure(file: Path, config: str, folder: Path, progress: Any) -> dict[str, Any]:
    """Return a body's row: its period, what wave and agent reach, and in how many seconds."""
    scene = load_scene(file)
    begin = time.perf_counter()
    best = search_wave(scene)["candidates"][0]
    tuned = time.perf_counter()
    settings = load_config(config, scene=file)
    record = train(settings, folder / file.stem, resume=True, progress=progress)
    played = play_episode(SwimEnv(scene), load_policy(folder / file.stem, scene), _SEED)
    return {
        "body": file.stem,
        "about": scene.description,
        "elements": scene.beam.elements,
        "period": 1.0 / natural_frequencies(scene, 1)[0],
        "tuned_wave": best["net_displacement"],
        "seconds_to_tune": round(tuned - begin, 1),
        "agent": played.net_displacement,
        "seconds_to_train": record["seconds"],
        "steps": record["steps"],
        "energy_drift": played.info["energy_drift"],
        "ended_early": played.info["termination_reason"],
    }


def _table(rows: list[dict[str, Any]]) -> str:
    """Return the rows as text."""
    heads = ("body", "N", "T1 (s)", "wave (BL)", "agent (BL)", "ratio", "energy", "tune, train (s)")
    cells = [
        (
            row["body"],
            str(row["elements"]),
            f"{row['period']:.3g}",
            f"{row['tuned_wave']:.2f}",
            f"{row['agent']:.2f}",
            f"{row['agent'] / row['tuned_wave']:.2f}",
            f"{row['energy_drift']:.1%}",
            f"{row['seconds_to_tune']:.0f}, {row['seconds_to_train']:.0f}",
        )
        for row in rows
    ]
    return text_table([heads, *cells])


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    names = sorted(file.stem for file in BODIES.glob("*.yaml"))
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bodies", nargs="+", choices=names, default=names, metavar="NAME")
    parser.add_argument("--config", default="ppo", help="ppo unless given, or sac")
    parser.add_argument(
        "--runs", metavar="FOLDER", default="results/bodies", help="where the runs go"
    )
    parser.add_argument("--output", metavar="FILE", help="write the rows into this JSON file")
    add_options(parser, "json")
    options = parser.parse_args(arguments)
    if options.output is not None:
        check_file(options.output)
    rows = []
    for name in options.bodies:
        file = BODIES / f"{name}.yaml"
        steps = load_config(options.config, scene=file).steps
        with progress_bar(steps, "step", name, unit_scale=True) as progress:
            rows.append(measure(file, options.config, Path(options.runs), progress))
        if options.output is not None:
            write_json(
                options.output, {"config": options.config, **where_and_when(), "bodies": rows}
            )
    print_result({"bodies": rows}, options.json, lambda: _table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
