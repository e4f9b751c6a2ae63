"""Search for the travelling wave that swims farthest, check it, and keep it with its record."""

from __future__ import annotations

import argparse
import json
import math
import time

from swim_agents.commands import command_line as cli
from swim_agents.files import as_json, check_file
from swim_agents.tuning import check_candidates, search_wave
from swim_agents.verification import finer_scenes
from swim_env.errors import SwimError
from swim_env.files.atomic import write_atomically
from swim_env.plots import draw_wave_search, require_matplotlib, save_figure
from swim_env.sim.replay import steps_of

#: Options that are whole numbers: least value, default, help.
_NUMBERS = {
    "frequencies": (1, 40, "frequencies on the grid"),
    "wave_numbers": (1, 17, "wave numbers on the grid"),
    "generations": (1, 20, "of differential evolution"),
    "population": (8, 32, "of differential evolution"),
    "seed": (0, 0, "of differential evolution"),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    cli.add_scene_arguments(parser, default="swimmer")
    for name, (_, default, text) in _NUMBERS.items():
        option = f"--{name.replace('_', '-')}"
        parser.add_argument(option, type=int, default=default, metavar="N", help=text)
    parser.add_argument(
        "--output",
        metavar="FILE",
        required=True,
        help="where the record goes; the wave that ships is in swim_agents/tuned_wave.json",
    )
    parser.add_argument("--plot", metavar="FILE", help="draw the grid into this PNG file")


def main(options: argparse.Namespace) -> int:
    """Search, check the best waves and write the record."""
    for name, (least, *_) in _NUMBERS.items():
        if getattr(options, name) < least:
            raise SwimError(
                f"--{name.replace('_', '-')} must be at least {least}, got {getattr(options, name)}"
            )
    check_file(options.output)
    if options.plot is not None:
        require_matplotlib()
        check_file(options.plot)
    cli.check_places([options.scene], {"--output": options.output, "--plot": options.plot})
    scene = cli.scene_of(options)
    steps_of(scene)  # refuses an episode that is too long for any run

    start = time.perf_counter()
    total = options.frequencies * options.wave_numbers
    total += options.population * (options.generations + 1)
    with cli.progress_bar(total, "wave", "search") as progress:
        numbers = {name: getattr(options, name) for name in _NUMBERS}
        found = search_wave(scene, **numbers, progress=progress)
    seconds = math.ceil(len(finer_scenes(scene)) * scene.episode.duration)
    with cli.progress_bar(seconds, "s", "check") as bar:
        record = check_candidates(scene, found, bar)
    record["seconds"] = round(time.perf_counter() - start, 1)
    write_atomically(options.output, lambda file: file.write(as_json(record)))
    if options.plot is not None:
        save_figure(draw_wave_search(record), options.plot)
    if record["wave"] is None:
        raise SwimError(
            f"none of the {len(record['checked'])} best waves is verified; the record "
            f"is in {options.output}"
        )
    brief = {name: record[name] for name in record if name not in ("search", "scene_fields")}
    cli.print_result(brief, options.json, lambda: json.dumps(brief, indent=2, allow_nan=False))
    return 0
