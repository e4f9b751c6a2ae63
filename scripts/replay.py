#!/usr/bin/env python
"""Play a scene's prescribed torque, or an episode of the environment, and say what came of it."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from swim_agents.commands.command_line import add_scene_arguments, progress_bar, run, scene_of
from swim_agents.policies import policy_names
from swim_agents.recording import swimmer_of
from swim_agents.replay import replay_episode

from swim_env.envs.assessment import load_assessment
from swim_env.envs.task import TASKS
from swim_env.errors import SwimError
from swim_env.physics.loading import load_kernels
from swim_env.plots import require_matplotlib
from swim_env.plots.results import check_result_folder, write_results
from swim_env.recording import Swimmer, recording_file, write_recording
from swim_env.scene import Scene
from swim_env.sim.replay import replay, steps_of
from swim_env.sim.simulator import Simulator


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    add_scene_arguments(parser, accuracy=True)
    parser.add_argument(
        "--duration",
        type=float,
        metavar="S",
        help="simulated time in seconds, rounded to whole steps or, with --env, actions; the "
        "scene's own unless given",
    )
    parser.add_argument(
        "--output",
        metavar="FOLDER",
        help="write summary.json, trajectory.npz, scene.yaml and path.png into this folder",
    )
    parser.add_argument(
        "--record",
        metavar="PLACE",
        help="write a recording for rerun, with the fluid, into this file (.rrd) or folder",
    )
    parser.add_argument("--json", action="store_true", help="end with the figures as one JSON line")
    episode = parser.add_argument_group("as an episode of the Gymnasium environment")
    episode.add_argument(
        "--env",
        action="store_true",
        help="play an episode: torques held over the control interval, a start with noise, rewards",
    )
    episode.add_argument(
        "--policy",
        metavar="NAME",
        help=f"who plays: {', '.join(policy_names())}, or the path of an agent; paper_wave unless "
        "given",
    )
    episode.add_argument("--task", help=f"{' or '.join(TASKS)}; forward unless given")
    episode.add_argument(
        "--seed", type=int, help="of the start's noise and of random torques; 0 unless given"
    )
    episode.add_argument(
        "--noise", type=float, metavar="X", help="factor on the start's noise; 1 unless given"
    )
    episode.add_argument(
        "--record-video", metavar="FOLDER", help="write a video of the episode into this folder"
    )
    return parser


def _check_episode_options(options: argparse.Namespace) -> None:
    """Refuse options that only an episode has where none was asked for, and the other way round."""
    if options.env and options.accuracy is not None:
        raise SwimError(
            "--accuracy chooses settings by the prescribed torque and has no meaning with --env"
        )
    for name in ("policy", "task", "seed", "noise", "record_video"):
        if getattr(options, name) is not None and not options.env:
            raise SwimError(f"--{name.replace('_', '-')} needs --env")


def _table(summary: dict[str, Any]) -> str:
    dx, dy = summary["displacement"]
    rows = [
        ("scene", summary["scene"]),
        ("simulated", f"{summary['duration']:g} s in {summary['steps']} steps"),
        ("wall time", f"{summary['wall_seconds']:.2f} s"),
        ("net displacement", f"({dx:+.6f}, {dy:+.6f}) m"),
        ("mean speed", f"{summary['mean_speed']:.6f} m/s"),
        ("heading change", f"{summary['heading_change']:+.6f} rad"),
        ("positive work", f"{summary['positive_work']:.4f} J"),
        (
            "energy drift",
            f"{summary['energy_drift']:.2e} of the largest energy, "
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
            ("along the goal", f"{summary['net_displacement']:+.6f} body lengths"),
        ]
    if "video" in summary:
        rows.append(("video", summary["video"]))
    if "recording" in summary:
        recording = summary["recording"]
        rows.append(("recording", f"{recording['file']}, {recording['bytes'] / 1e6:.2f} MB"))
    if summary["halved_steps"]:
        rows.append(("steps cut", f"{summary['halved_steps']}, into up to {summary['most_parts']}"))
    width = max(len(name) for name, _ in rows)
    lines = [f"{name:<{width}}  {value}" for name, value in rows]
    return "\n".join([*lines, *(f"warning: {text}" for text in summary["warnings"])])


def _play_episode(options: argparse.Namespace, scene: Scene) -> tuple[Swimmer, dict[str, Any]]:
    """Play what the options of an episode ask for."""
    if options.duration is not None:
        scene = scene.replace("episode.duration", options.duration)
    load_assessment()
    policy = options.policy or "paper_wave"
    with progress_bar(scene.actions_per_episode, "action", scene.name) as progress:
        rollout, trajectory, summary = replay_episode(
            scene,
            policy=policy,
            task=options.task or "forward",
            seed=options.seed or 0,
            noise=1.0 if options.noise is None else options.noise,
            video_folder=options.record_video,
            progress=progress,
        )
    return swimmer_of(Path(policy).name, rollout, trajectory), summary


def _record(swimmer: Swimmer, file: Path) -> dict[str, Any]:
    """Write the recording and return its figures."""
    duration = max(1, round(swimmer.trajectory.duration))
    with progress_bar(duration, "s", "fluid") as progress:
        return write_recording(file, [swimmer], progress=progress).to_dict()


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    options = _parser().parse_args(arguments)
    _check_episode_options(options)
    scene = scene_of(options)
    if options.output is not None:
        require_matplotlib()
        check_result_folder(options.output)
    steps = steps_of(scene, options.duration)
    record = None
    if options.record is not None:
        record = recording_file(options.record, scene.name)
    if options.env:
        swimmer, summary = _play_episode(options, scene)
        trajectory = swimmer.trajectory
    else:
        load_kernels()
        with progress_bar(steps, "step", scene.name) as progress:
            trajectory, summary = replay(scene, options.duration, progress)
        start = Simulator(scene).velocity()
        swimmer = Swimmer("prescribed", trajectory, start_velocity=start)
    if record is not None:
        summary["recording"] = _record(swimmer, record)
    if summary["termination_reason"]:
        print(
            f"the run ended early at t = {trajectory.time[-1]:g} s: "
            f"{summary['termination_reason']}",
            file=sys.stderr,
        )
    if options.output is not None:
        write_results(trajectory, summary, options.output)
    print(json.dumps(summary, allow_nan=False) if options.json else _table(summary))
    if options.output is not None:
        print(f"results are in {options.output}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
