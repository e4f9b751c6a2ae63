"""Search for the travelling wave that swims farthest, and keep it beside the scene."""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import math
import os
import time
from pathlib import Path

from swim_agents.commands import command_line as cli
from swim_agents.files import check_file, write_json
from swim_agents.tuned_wave import LATERAL, SPATIAL_WAVES, SUFFIX, check_wave, wave_file
from swim_agents.tuning import (
    Point,
    actions_to_play,
    check_candidates,
    record_of,
    search_wave,
)
from swim_env.envs.assessment import load_assessment
from swim_env.errors import SwimError
from swim_env.files.atomic import write_atomically
from swim_env.plots import draw_wave_search, require_matplotlib, save_figure
from swim_env.scene import Scene, scene_names
from swim_env.sim.replay import steps_of

#: Options that are whole numbers: least value, default, help.
_NUMBERS = {
    "frequencies": (1, None, "an even grid of so many frequencies, 40 with --plot"),
    "wave_numbers": (1, None, "an even grid of so many wave numbers, 17 with --plot"),
    "generations": (0, 5, "of the search from the best of the grid, 5 unless given"),
    "population": (8, 24, "waves of a generation, 24 unless given"),
    "seed": (0, 0, "of the search"),
}
#: The grid of a picture, where no other is given.
_PICTURE = {"frequencies": 40, "wave_numbers": 17}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    cli.add_scene_arguments(parser, default="swimmer")
    for name, (_, default, text) in _NUMBERS.items():
        option = f"--{name.replace('_', '-')}"
        parser.add_argument(option, type=int, default=default, metavar="N", help=text)
    parser.add_argument(
        "--wave",
        choices=tuple(SPATIAL_WAVES),
        default=LATERAL,
        help=f"which wave of a scene in three dimensions, {LATERAL} unless given; others have "
        "their name in the record's",
    )
    parser.add_argument(
        "--verify",
        action="store_true",
        help="check the best waves with finer steps and panels, from the best one down until one "
        "is confirmed; takes several times as long. In three dimensions it is the best one alone, "
        "with panels on every shape, which takes some minutes",
    )
    parser.add_argument(
        "--output",
        metavar="FILE",
        help="where the record goes; unless given it lies beside the scene's file, where "
        f"tuned_wave is looked for. If its name ends with {SUFFIX}, it can be played as a policy",
    )
    parser.add_argument("--plot", metavar="FILE", help="draw the grid into this PNG file")


def main(options: argparse.Namespace) -> int:
    """Search and write the record; a search that was interrupted goes on where it was."""
    for name, (least, *_) in _NUMBERS.items():
        value = getattr(options, name)
        if value is not None and value < least:
            raise SwimError(f"--{name.replace('_', '-')} must be at least {least}, got {value}")
    output = _output(options)
    check_file(output)
    if options.plot is not None:
        require_matplotlib()
        check_file(options.plot)
    cli.check_places([options.scene], {"--output": output, "--plot": options.plot})
    scene = cli.scene_of(options)
    check_wave(scene, options.wave)
    steps_of(scene)  # refuses an episode that is too long for any run

    start = time.perf_counter()
    load_assessment()
    numbers = {name: getattr(options, name) for name in _NUMBERS}
    if options.plot is not None:  # the usual grid is too uneven for a picture
        numbers |= {name: numbers[name] or size for name, size in _PICTURE.items()}
    sizes = {name: value for name, value in numbers.items() if name != "seed"}
    progress_file = Path(f"{output}.part")
    known = _read_known(progress_file, scene, options.wave)
    total = actions_to_play(scene, **sizes, wave=options.wave)
    with (
        cli.progress_bar(total, "action", "search", unit_scale=True) as progress,
        open(progress_file, "a", encoding="utf-8") as log,
    ):

        def keep(found: dict[Point, float]) -> None:
            log.writelines(json.dumps([*point, value]) + "\n" for point, value in found.items())
            log.flush()

        found = search_wave(
            scene, **numbers, progress=progress, known=known, keep=keep, wave=options.wave
        )
    checked = []
    if options.verify:
        with cli.share_bar("check") as bar:
            checked = check_candidates(scene, found, bar)
    record = record_of(scene, found, checked)
    record["seconds"] = round(time.perf_counter() - start, 1)
    write_json(output, record)
    progress_file.unlink(missing_ok=True)
    if options.plot is not None:
        save_figure(draw_wave_search(record), options.plot)
    if record["wave"] is None:
        why = f"none of the {len(checked)} best waves is verified" if checked else "no wave swims"
        raise SwimError(f"{why}; the record is in {output}")
    brief = {name: record[name] for name in record if name not in ("search", "scene_fields")}
    cli.print_result(brief, options.json, lambda: _text(record, output))
    return 0


def _output(options: argparse.Namespace) -> str:
    """Return where the record goes."""
    if options.output is not None:
        return str(options.output)
    if options.scene in scene_names():
        raise SwimError(
            f"scene {options.scene} ships with the package: name the record's file with --output"
        )
    if options.set:
        raise SwimError(
            "beside a scene's file lies the wave of the scene as it is there: name another file "
            "with --output, or leave out --set"
        )
    return os.fspath(wave_file(options.scene, options.wave))


def _read_known(file: Path, scene: Scene, wave: str) -> dict[Point, float]:
    """Return what an interrupted search of this wave has found, and begin its log otherwise."""
    sought = scene.to_yaml() + wave
    head = json.dumps(hashlib.sha256(sought.encode("utf-8")).hexdigest())
    try:
        first, *lines = file.read_text(encoding="utf-8").splitlines()
        if first == head:
            known: dict[Point, float] = {}
            for line in lines:
                with contextlib.suppress(ValueError):  # a line that a kill has cut short
                    *wave, actions, value = json.loads(line)
                    known[*wave, actions] = value
            return known
    except (OSError, ValueError, TypeError):  # there is none, or it is none
        pass
    write_atomically(file, lambda log: log.write(f"{head}\n".encode()))
    return {}


def _text(record: dict[str, object], output: str) -> str:
    """Return the result as text."""
    wave = record["wave"]
    assert isinstance(wave, dict)
    hertz = wave["frequency"] / (2.0 * math.pi)
    pitch = wave.get("pitch_amplitude")
    amplitude = f"{wave['amplitude']:.4g} N m" + (f" (pitch {pitch:.4g} N m)" if pitch else "")
    lines = [
        f"tuned wave of scene {record['scene']}: {record['net_displacement']:.3f} BL in an episode"
        + ("" if record["checked"] else " (not verified)"),
        f"amplitude {amplitude}, {hertz:.4g} Hz, wave number "
        f"{wave['wave_number']:.4g} rad per body length, phase {wave['phase']:.3g} rad",
        f"found in {record['seconds']} s, kept in {output}",
    ]
    return "\n".join(lines)
