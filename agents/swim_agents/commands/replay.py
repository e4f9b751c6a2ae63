"""Play a scene's prescribed torque, or an episode of the environment, and print its figures."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from swim_agents.commands import command_line as cli
from swim_agents.commands.playing import (
    PRESCRIBED,
    play_policy,
    play_prescribed,
    record,
    report_early_end,
)
from swim_agents.policies import load_policy, policy_label, policy_names, run_label
from swim_agents.tables import text_table
from swim_env.envs.geometry import geometry_of
from swim_env.envs.tasks import check_task, make_task
from swim_env.errors import SwimError
from swim_env.files.folders import check_folder
from swim_env.physics.loading import load_kernels
from swim_env.plots import require_matplotlib
from swim_env.plots.results import RESULT_FILES, write_results
from swim_env.recording import recording_file
from swim_env.scene import load_scene
from swim_env.sim.replay import steps_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    cli.add_scene_arguments(parser, accuracy=True)
    cli.add_options(parser, "duration", "record")
    parser.add_argument(
        "--output",
        metavar="FOLDER",
        help="write summary.json, trajectory.npz, scene.yaml and path.png into this folder",
    )
    parser.add_argument(
        "--env",
        action="store_true",
        help="play an episode of the Gymnasium environment, which has the options below: torques "
        "held over the control interval, a start with noise, rewards",
    )
    parser.add_argument(
        "--policy",
        metavar="NAME",
        help=f"{', '.join(policy_names())}, or the path of an agent; paper_wave unless given",
    )
    cli.add_options(parser, "task", "task-option", "seed", "noise")
    parser.add_argument(
        "--record-video", metavar="FOLDER", help="write a video of the episode into this folder"
    )


def main(options: argparse.Namespace) -> int:
    """Play, print the figures and write what was asked for."""
    if options.env and options.accuracy is not None:
        raise SwimError(
            "--accuracy chooses settings by the prescribed torque and has no meaning with --env"
        )
    if not options.env:
        cli.refuse(
            options,
            ("policy", "task", "task_option", "seed", "noise", "record_video"),
            "needs --env",
        )
    cli.check_places(
        [options.scene, options.policy],
        {"--output": options.output},
        {"--record": options.record, "--record-video": options.record_video},
    )
    scene = load_scene(options.scene, options.set)
    steps_of(scene, options.duration)  # refuses a duration before anything is played
    if options.output is not None:
        require_matplotlib()
        check_folder(options.output, RESULT_FILES)
    task_options = cli.task_options(options)
    policy, task = options.policy or "paper_wave", options.task or "forward"
    if options.env:
        task = check_task(task)
        make_task(task, scene, task_options)
        load_policy(policy, scene, options.seed, task)
    file = None
    if options.record is not None:
        label = run_label(
            cli.played_scene(scene, options.duration),
            [policy_label(policy) if options.env else PRESCRIBED],
            task,
            options.seed or 0,
            noise=None if options.noise == 1.0 else options.noise,
            accuracy=options.accuracy,
            task_options=task_options or None,
        )
        file = recording_file(options.record, label)
    scene = cli.scene_of(options)  # now that nothing is wrong, as choosing settings takes a while
    if options.env:
        geometry_of(scene).load()
        swimmer, summary = play_policy(
            cli.played_scene(scene, options.duration),
            policy,
            task=task,
            seed=options.seed or 0,
            noise=1.0 if options.noise is None else options.noise,
            video_folder=options.record_video,
            task_options=task_options,
        )
    else:
        if scene.dimension == 2:
            load_kernels()
        swimmer, summary = play_prescribed(scene, options.duration)
    if file is not None:
        summary["recording"] = record(file, [swimmer]).to_dict()
    report_early_end(swimmer, "the run")
    if options.output is not None:
        write_results(swimmer.trajectory, summary, options.output)
    if options.output is not None:
        print(f"results are in {options.output}", file=sys.stderr)
    cli.print_result(summary, options.json, lambda: _table(summary))
    return 0


def _table(summary: dict[str, Any]) -> str:
    net = ", ".join(f"{part:+.6f}" for part in summary["displacement"])
    rows = [
        ("scene", summary["scene"]),
        ("simulated", f"{summary['duration']:g} s in {summary['steps']} steps"),
        ("wall time", f"{summary['wall_seconds']:.2f} s"),
        ("net displacement", f"({net}) m"),
        ("mean speed", f"{summary['mean_speed']:.6f} m/s"),
        ("heading change", f"{summary['heading_change']:+.6f} rad"),
        ("positive work", f"{summary['positive_work']:.4f} J"),
        (
            "energy drift",
            f"{summary['energy_drift']:.2e} of what went through, "
            f"{summary['energy_tolerance']:g} allowed",
        ),
        ("momentum drift", f"{summary['momentum_drift']:.2e}"),
        ("largest residual", f"{summary['max_residual']:.2e}"),
        ("Newton corrections", f"{summary['newton_iterations_mean']:.2f} a step"),
    ]
    if "policy" in summary:
        rows += [
            ("policy", f"{summary['policy']}, seed {summary['seed']}, noise {summary['noise']:g}"),
            ("actions", f"{summary['actions']}, each for {summary['control_interval']:g} s"),
            ("sum of rewards", f"{summary['return']:+.6f}"),
            ("as the task counts it", f"{summary['net_displacement']:+.6f} body lengths"),
        ]
    if "video" in summary:
        rows.append(("video", summary["video"]))
    if "recording" in summary:
        recording = summary["recording"]
        rows.append(("recording", f"{recording['file']}, {recording['bytes'] / 1e6:.2f} MB"))
    if summary["halved_steps"]:
        rows.append(("steps cut", f"{summary['halved_steps']}, into up to {summary['most_parts']}"))
    return "\n".join(
        [text_table(rows, left=True), *(f"warning: {text}" for text in summary["warnings"])]
    )
