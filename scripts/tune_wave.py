#!/usr/bin/env python
"""Search for the travelling wave that swims farthest, check it, and keep it with its record."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path

from swim_agents.commands.command_line import add_scene_arguments, progress_bar, run, scene_of
from swim_agents.tuning import check_candidates, search_wave
from swim_agents.verification import fine_scene

from swim_env.errors import SwimError
from swim_env.files.atomic import write_atomically
from swim_env.plots import draw_wave_search, require_matplotlib, save_figure


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    add_scene_arguments(parser, default="swimmer")
    parser.add_argument("--frequencies", type=int, default=40, help="frequencies on the grid")
    parser.add_argument("--wave-numbers", type=int, default=17, help="wave numbers on the grid")
    parser.add_argument("--generations", type=int, default=20, help="of differential evolution")
    parser.add_argument("--population", type=int, default=32, help="of differential evolution")
    parser.add_argument("--seed", type=int, default=0, help="of differential evolution")
    parser.add_argument(
        "--output",
        metavar="FILE",
        required=True,
        help="where the record goes; the wave that ships stands in agents/tuned_wave.json",
    )
    parser.add_argument("--plot", metavar="FILE", help="draw the grid into this PNG file")
    parser.add_argument("--json", action="store_true", help="end with the result as one JSON line")
    return parser


def _check(options: argparse.Namespace) -> None:
    """Refuse what would be found wrong only after the search."""
    for name in ("frequencies", "wave_numbers", "generations"):
        if getattr(options, name) < 1:
            raise SwimError(f"--{name.replace('_', '-')} must be at least 1")
    if options.population < 8:
        raise SwimError(f"--population must be at least 8, got {options.population}")
    if options.seed < 0:
        raise SwimError(f"--seed must be at least 0, got {options.seed}")
    if options.plot is not None:
        require_matplotlib()
    for file in (options.output, options.plot):
        if file is not None:
            folder = Path(file).resolve().parent
            if not folder.is_dir() or not os.access(folder, os.W_OK) or Path(file).is_dir():
                raise SwimError(f"cannot write a file there: {file}")


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    options = _parser().parse_args(arguments)
    _check(options)
    scene = scene_of(options)

    start = time.perf_counter()
    total = options.frequencies * options.wave_numbers
    total += options.population * (options.generations + 1)
    with progress_bar(total, "wave", "search") as progress:
        found = search_wave(
            scene,
            options.frequencies,
            options.wave_numbers,
            options.generations,
            options.population,
            options.seed,
            progress,
        )
    fine = fine_scene(scene)
    with progress_bar(fine.actions_per_episode * fine.steps_per_action, "step", "check") as bar:
        record = check_candidates(scene, found, bar)
    record["seconds"] = round(time.perf_counter() - start, 1)
    text = json.dumps(record, indent=1, allow_nan=False) + "\n"
    write_atomically(options.output, lambda file: file.write(text.encode()))
    if options.plot is not None:
        save_figure(draw_wave_search(record), options.plot)
    if record["wave"] is None:
        raise SwimError(
            f"none of the {len(record['checked'])} best waves passes the trust check; the record "
            f"is in {options.output}"
        )
    brief = {name: record[name] for name in record if name not in ("search", "scene_fields")}
    print(json.dumps(brief, indent=None if options.json else 2, allow_nan=False))
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
