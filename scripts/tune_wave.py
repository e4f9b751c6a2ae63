#!/usr/bin/env python
"""Search for the travelling wave that swims farthest, check it, and keep it with its record."""

from __future__ import annotations

import argparse
import json
import sys
import time
from typing import Any

from agents import play_episode, verify_rollout
from agents.baselines import WavePolicy, paper_wave
from agents.tuning import TUNED_WAVE_FILE, search_wave, wave_fields
from agents.verification import fine_scene
from swim_env import SwimEnv, SwimError, __version__
from swim_env.command_line import add_scene_arguments, progress_bar, run, scene_of
from swim_env.files import write_atomically
from swim_env.scene import Actuation


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    add_scene_arguments(parser, default="swimmer")
    parser.add_argument("--frequencies", type=int, default=40, help="frequencies on the grid")
    parser.add_argument("--wave-numbers", type=int, default=17, help="wave numbers on the grid")
    parser.add_argument("--generations", type=int, default=20, help="of differential evolution")
    parser.add_argument("--population", type=int, default=32, help="of differential evolution")
    parser.add_argument("--seed", type=int, default=0, help="of differential evolution")
    parser.add_argument(
        "--output", default=str(TUNED_WAVE_FILE), metavar="FILE", help="where the record goes"
    )
    parser.add_argument("--json", action="store_true", help="end with the result as one JSON line")
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    options = _parser().parse_args(arguments)
    for name in ("frequencies", "wave_numbers", "generations"):
        if getattr(options, name) < 1:
            raise SwimError(f"--{name.replace('_', '-')} must be at least 1")
    if options.population < 8:
        raise SwimError(f"--population must be at least 8, got {options.population}")
    scene = scene_of(options)
    start = time.perf_counter()
    total = options.frequencies * options.wave_numbers
    total += options.population * (options.generations + 1)
    with progress_bar(total, "wave", "search") as progress:
        record = search_wave(
            scene,
            options.frequencies,
            options.wave_numbers,
            options.generations,
            options.population,
            options.seed,
            progress,
        )
    env = SwimEnv(scene)
    paper = play_episode(env, paper_wave(scene), options={"noise": 0.0}).net_displacement
    checked: list[dict[str, Any]] = []
    for candidate in record.pop("candidates"):
        fields = wave_fields(scene, candidate)
        wave = Actuation(**fields, torque_limit=scene.torque_limit)
        rollout = play_episode(env, WavePolicy(scene, wave), options={"noise": 0.0})
        fine_steps = len(rollout.torques) * fine_scene(scene).steps_per_action
        with progress_bar(fine_steps, "step", "check") as bar:
            verification = verify_rollout(rollout, progress=bar)
        checked.append({"wave": fields, **verification.to_dict()})
        if verification.verified:
            break
    else:
        raise SwimError(f"none of the {len(checked)} best waves passes the trust check")
    result = {
        "wave": checked[-1]["wave"],
        "scene": scene.name,
        "objective": "net displacement along the scene's heading over one episode (BL), torques "
        "held over the control interval, no start noise",
        "net_displacement": checked[-1]["net_displacement"],
        "fine_displacement": checked[-1]["fine_displacement"],
        "paper_wave": paper,
        "ratio": checked[-1]["net_displacement"] / paper,
        "checked": checked,
        "seconds": round(time.perf_counter() - start, 1),
        "version": __version__,
        "search": record,
        "scene_fields": scene.to_dict(),
    }
    text = json.dumps(result, indent=1, allow_nan=False) + "\n"
    write_atomically(options.output, lambda file: file.write(text.encode()))
    brief = {key: value for key, value in result.items() if key not in ("search", "scene_fields")}
    if options.json:
        print(json.dumps(brief, allow_nan=False))
    else:
        print(json.dumps(brief, indent=2, allow_nan=False))
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
