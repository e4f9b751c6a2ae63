#!/usr/bin/env python
"""Let agents and baselines swim from the same starts, check every score, and compare the gaits."""

from __future__ import annotations

import argparse
import json
import sys

from swim_agents.commands.command_line import add_scene_arguments, progress_bar, run, scene_of
from swim_agents.comparison.contest import FIRST_SEED, entries_of, hold_contest, steps_to_play
from swim_agents.comparison.files import check_contest_folder, write_contest
from swim_agents.comparison.report import as_text
from swim_agents.policies import policy_names

from swim_env.envs.assessment import load_assessment
from swim_env.envs.task import TASKS, check_task
from swim_env.plots import require_matplotlib
from swim_env.recording import recording_file, write_recording


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--policies",
        nargs="+",
        metavar="POLICY",
        default=["ppo_forward", "sac_forward"],
        help=f"names ({', '.join(policy_names())}) or paths: an agent's folder, a training run, "
        "several runs (a folder with seed_0, seed_1 ...), a model file; ppo_forward sac_forward "
        "unless given. paper_wave and tuned_wave always take part",
    )
    add_scene_arguments(parser, default="swimmer")
    parser.add_argument(
        "--task", default="forward", help=f"{' or '.join(TASKS)}; forward unless given"
    )
    parser.add_argument(
        "--duration", type=float, metavar="S", help="of an episode; the scene's unless given"
    )
    parser.add_argument(
        "--seeds",
        type=int,
        nargs="+",
        default=list(range(FIRST_SEED, FIRST_SEED + 10)),
        metavar="N",
        help=f"of the starts; {FIRST_SEED} to {FIRST_SEED + 9} unless given, from a range that no "
        "training and no evaluation draws from, while a training with seed 0 begins with starts 0, "
        "1 ...",
    )
    parser.add_argument(
        "--noise", type=float, default=1.0, metavar="X", help="factor on the start's noise"
    )
    parser.add_argument(
        "--trust",
        action="store_true",
        help="unpickle model files that come without an agent.json, which runs code in them",
    )
    parser.add_argument(
        "--output",
        metavar="FOLDER",
        help="write comparison.json, .csv, .md and pictures into this folder",
    )
    parser.add_argument(
        "--record",
        metavar="PLACE",
        help="write a recording for rerun, everybody's first start side by side on one time line, "
        "into this file (.rrd) or folder",
    )
    parser.add_argument("--json", action="store_true", help="end with the figures as one JSON line")
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    options = _parser().parse_args(arguments)
    check_task(options.task)
    scene = scene_of(options)
    if options.duration is not None:
        scene = scene.replace("episode.duration", options.duration)
    if options.output is not None:
        require_matplotlib()
        check_contest_folder(options.output)
    file = None
    if options.record is not None:
        file = recording_file(options.record, f"{scene.name}-{options.task}")
    entries = entries_of(options.policies, scene, options.task, options.trust)
    load_assessment()
    total = steps_to_play(scene, len(entries), len(options.seeds))
    with progress_bar(total, "s", "simulated") as progress:
        contest = hold_contest(
            scene, entries, options.seeds, options.task, options.noise, progress=progress
        )
    if options.output is not None:
        write_contest(contest, options.output)
    if file is not None:
        swimmers = contest.swimmers()
        seconds = sum([swimmer.trajectory.duration for swimmer in swimmers])
        with progress_bar(max(1, round(seconds)), "s", "fluid") as progress:
            recording = write_recording(file, swimmers, progress=progress)
        print(f"the recording is {recording.file}", file=sys.stderr)
    print(json.dumps(contest.record, allow_nan=False) if options.json else as_text(contest.record))
    if options.output is not None:
        print(f"results are in {options.output}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
