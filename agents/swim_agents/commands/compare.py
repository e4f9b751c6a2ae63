"""Play agents and baselines from the same starts, check every score, and compare the gaits."""

from __future__ import annotations

import argparse
import sys

from swim_agents.commands import command_line as cli
from swim_agents.commands.playing import record
from swim_agents.comparison.contest import (
    FIRST_SEED,
    REFERENCES,
    checked_seeds,
    entries_of,
    hold_contest,
)
from swim_agents.comparison.report import SPATIAL_CONTEST_FILES, as_text, write_contest
from swim_agents.policies import policy_label, policy_names, run_label
from swim_env.envs.geometry import geometry_of
from swim_env.envs.tasks import check_task, make_task
from swim_env.files.folders import check_folder
from swim_env.plots import require_matplotlib
from swim_env.recording import recording_file
from swim_env.sim.replay import steps_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument(
        "--policies",
        nargs="+",
        metavar="POLICY",
        default=["ppo_forward", "sac_forward"],
        help=f"names ({', '.join(policy_names())}) or paths: an agent's folder, a training run, "
        "several runs (a folder with seed_0, seed_1 ...), a model file; ppo_forward sac_forward "
        "unless given. A scene's own wave, paper_wave, takes part, and tuned_wave on the body "
        "it was tuned on",
    )
    cli.add_scene_arguments(parser, default="swimmer", adopted=True)
    cli.add_options(parser, "task", "task-option", "duration", "noise", "record")
    parser.set_defaults(noise=1.0)
    parser.add_argument(
        "--seeds",
        type=int,
        nargs="+",
        default=list(range(FIRST_SEED, FIRST_SEED + 10)),
        metavar="N",
        help=f"of the starts; {FIRST_SEED} to {FIRST_SEED + 9} unless given, from a range that no "
        "training (with seed 0: starts 0, 1 ...) and no evaluation draws from",
    )
    parser.add_argument(
        "--trust",
        action="store_true",
        help="unpickle model files without an agent.json, which runs code in them",
    )
    parser.add_argument(
        "--output",
        metavar="FOLDER",
        help="write comparison.json, .csv, .md and pictures into this folder",
    )


def main(options: argparse.Namespace) -> int:
    """Hold the contest, print its tables and write what was asked for."""
    cli.check_places(
        [options.scene, *options.policies],
        {"--output": options.output},
        {"--record": options.record},
    )
    cli.adopt(options, options.policies)
    options.task = check_task(options.task)
    seeds = checked_seeds(options.seeds)
    scene = cli.scene_of(options)
    scene = cli.played_scene(scene, options.duration)
    scene.actions_per_episode  # noqa: B018  refuses a duration before anything is played
    steps_of(scene)
    task_options = cli.task_options(options)
    make_task(options.task, scene, task_options)
    if options.output is not None:
        require_matplotlib()
        check_folder(options.output, SPATIAL_CONTEST_FILES)
    entries = entries_of(options.policies, scene, options.task, options.trust)
    why = {
        "paper_wave": "as the scene prescribes no torque",
        "tuned_wave": "which was tuned to another body or fluid; `swim-env tune` finds the scene's",
    }
    there = {entry.name for entry in entries}
    for left_out in (name for name in REFERENCES if name not in there):
        print(f"without {left_out}, {why[left_out]}", file=sys.stderr)
    file = None
    if options.record is not None:
        labels = [policy_label(one) for one in dict.fromkeys(options.policies)]
        noise = None if options.noise == 1.0 else options.noise
        label = run_label(
            scene,
            labels,
            options.task,
            seeds[0],
            noise=noise,
            contest=True,
            task_options=task_options or None,
        )
        file = recording_file(options.record, label)
    geometry_of(scene).load()
    with cli.share_bar("comparison") as progress:
        contest = hold_contest(
            scene, entries, seeds, options.task, options.noise, task_options, progress=progress
        )
    if options.output is not None:
        write_contest(contest, options.output)
    if file is not None:
        print(f"the recording is {record(file, contest.swimmers()).file}", file=sys.stderr)
    if options.output is not None:
        print(f"results are in {options.output}", file=sys.stderr)
    cli.print_result(contest.record, options.json, lambda: as_text(contest.record))
    return 0
