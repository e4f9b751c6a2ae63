"""Record how policies swim, with the fluid around them, and look at it in rerun's viewer."""

from __future__ import annotations

import argparse
import math
import os
import shlex
import sys
from pathlib import Path
from typing import Any

from swim_agents.commands import command_line as cli
from swim_agents.commands import playing
from swim_agents.policies import load_policy, policy_label, policy_names, run_label
from swim_agents.tables import text_table
from swim_env import recording
from swim_env.analysis.energy import velocity_of_start
from swim_env.envs.geometry import geometry_of
from swim_env.envs.tasks import check_task, make_task
from swim_env.errors import SwimError
from swim_env.files.names import file_name
from swim_env.recording import Swimmer
from swim_env.scene import Scene
from swim_env.sim.replay import steps_of
from swim_env.sim.trajectory import Trajectory

#: The scene unless one is given.
_SCENE = "swimmer"
#: Options of what is played, and of the recording that is made of it.
_MAKING = (
    *("scene", "set", "policy", "compare_with", "trajectory", "duration", "task", "task_option"),
    *("seed", "noise", "output", "colour", "no_flow", "flow_rate", "frame_rate"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    cli.add_scene_arguments(parser, default=_SCENE, adopted=True)
    parser.add_argument(
        "--policy",
        action="append",
        default=[],
        metavar="NAME",
        help=f"{', '.join(policy_names())}, or the path of an agent, played as an episode; give it "
        "again for more swimmers side by side; the scene's prescribed torque unless given",
    )
    parser.add_argument(
        "--compare-with",
        metavar="NAME",
        help="one more policy beside it, such as paper_wave; beside the prescribed torque or a "
        "saved run it starts without noise unless --noise is given",
    )
    parser.add_argument(
        "--trajectory",
        metavar="FILE",
        help="record a saved run (.npz) instead of playing --scene with --set for --duration",
    )
    parser.add_argument(
        "--recording",
        metavar="FILE",
        help="look at a recording (.rrd) that exists instead of making one",
    )
    cli.add_options(parser, "duration", "task", "task-option", "seed", "noise")
    parser.add_argument(
        "--output",
        metavar="FILE",
        help="the recording, or the folder for it; results/recordings unless given",
    )
    parser.add_argument(
        "--colour",
        choices=tuple(recording.COLOURS),
        help="what the body's colours show: the joint torques, unless given, or the elastic "
        "bending moments",
    )
    parser.add_argument("--no-flow", action="store_true", help="leave the fluid out")
    parser.add_argument(
        "--flow-rate",
        type=float,
        metavar="HZ",
        help="frames of the fluid in a simulated second; half as many as of the body unless given",
    )
    parser.add_argument(
        "--frame-rate",
        type=float,
        metavar="HZ",
        help="frames of everything else; one in every control interval (50 a second on the shipped "
        "scenes), or about 10 in a period of a prescribed torque that is faster, unless given",
    )
    parser.add_argument("--view", action="store_true", help="open rerun's viewer with it")
    parser.add_argument(
        "--web",
        action="store_true",
        help="serve it and rerun's viewer to a browser on this machine, until Ctrl-C",
    )
    parser.add_argument(
        "--port",
        type=int,
        metavar="N",
        help=f"of --web's page; {recording.WEB_PORT} unless given, 0 takes any that is free",
    )
    parser.add_argument(
        "--picture",
        metavar="FILE",
        help="keep a picture (.png, .jpg) of rerun's viewer with it, no display needed",
    )
    parser.add_argument(
        "--at", type=float, metavar="S", help="time that the picture shows; half of it unless given"
    )


def main(options: argparse.Namespace) -> int:
    """Play and write a recording, or take one that exists, and show it."""
    _check(options)
    made, file, end = _existing(options) if options.recording else _new(options)
    if options.picture is not None:
        shown = 0.5 * end if options.at is None else options.at
        for complaint in recording.take_picture(file, options.picture, shown):
            print(f"rerun: {complaint}", file=sys.stderr)
    if options.view:
        advice = recording.open_viewer(file)
        if advice is not None:
            print(advice, file=sys.stderr)
    elif not options.json and not options.web and not options.recording:
        command = shlex.join([recording.typed_command(), str(file)])
        print(f"look at it with: {command}", file=sys.stderr)
    cli.print_result(made, options.json, lambda: _table(made))
    if options.web:
        sys.stdout.flush()
        with recording.web_viewer(file, _port(options)) as viewer:
            print(f"open {viewer.address} on this machine; Ctrl-C ends it", file=sys.stderr)
            viewer.wait()
    return 0


def _new(options: argparse.Namespace) -> tuple[dict[str, Any], Path, float]:
    """Play and write; return figures of the recording, its file and its end (s)."""
    file, swimmers = _swimmers(options)
    for swimmer in swimmers:
        playing.report_early_end(swimmer, swimmer.name)
    flow_rate = None if options.no_flow else options.flow_rate or recording.AUTO
    written = playing.record(
        file,
        swimmers,
        flow_rate=flow_rate,
        frame_rate=options.frame_rate,
        colour=options.colour or "torque",
    )
    end = max(float(swimmer.trajectory.time[-1]) for swimmer in swimmers)
    return written.to_dict(), Path(written.file), end


def _existing(options: argparse.Namespace) -> tuple[dict[str, Any], Path, float]:
    """Read; return figures of the recording, its file and its end (s)."""
    file = Path(options.recording)
    read = recording.read_recording(file)
    swimmers = read.swimmers.values()
    end = max(float(swimmer.time[-1]) for swimmer in swimmers)
    _check_time(options, end)
    figures = {
        "file": str(file),
        "bytes": file.stat().st_size,
        "frames": max(len(swimmer.time) for swimmer in swimmers),
        "flow_frames": max(len(swimmer.flow_time) for swimmer in swimmers),
        "schema": read.schema,
    }
    return figures, file, end


def _port(options: argparse.Namespace) -> int:
    return recording.WEB_PORT if options.port is None else int(options.port)


def _check(options: argparse.Namespace) -> None:
    """Refuse options that have no meaning together, before anything is played."""
    if options.web:
        recording.check_web(_port(options))
    else:
        cli.refuse(options, ("port",), "needs --web")
    if options.recording is not None:
        cli.refuse(options, _MAKING, "has no meaning with --recording")
        if not options.view and not options.web and options.picture is None:
            raise SwimError("--recording needs --view, --web or --picture")
    if options.trajectory is not None:
        cli.refuse(options, ("scene", "set", "duration"), "has no meaning with --trajectory")
    if not options.policy and not options.compare_with and not options.recording:
        cli.refuse(
            options, ("task", "task_option", "seed", "noise"), "needs --policy or --compare-with"
        )
    if options.task is not None:
        options.task = check_task(options.task)
    if options.no_flow:
        cli.refuse(options, ("flow_rate",), "has no meaning with --no-flow")
    for name in ("flow_rate", "frame_rate"):
        rate = getattr(options, name)
        if rate is not None and not 0.0 < rate < math.inf:
            raise SwimError(
                f"--{name.replace('_', '-')} must be above 0, a finite number, got {rate:g}"
            )
    if options.picture is None:
        cli.refuse(options, ("at",), "needs --picture")
    else:
        recording.check_picture(options.picture)
    if options.at is not None and not 0.0 <= options.at < math.inf:
        raise SwimError(f"--at must be a time of at least 0, got {options.at:g}")
    if options.trajectory is not None:
        problem = "has no meaning with --trajectory; --compare-with adds a policy"
        cli.refuse(options, ("policy",), problem)
    cli.check_places(
        [
            *(options.scene, options.trajectory, options.recording, options.compare_with),
            *options.policy,
        ],
        {"--picture": options.picture},
        {"--output": options.output},
    )


def _check_scene(options: argparse.Namespace, scene: Scene, end: float) -> None:
    """Refuse what has no meaning with a scene, or a run up to some time (s)."""
    if options.flow_rate is not None and not recording.has_flow(scene):
        raise SwimError(
            f"--flow-rate has no meaning: scene {scene.name} has no fluid"
            f"{'' if scene.dimension == 2 else ' of panels (panels, frozen)'}, so there is no flow "
            "to record"
        )
    _check_time(options, end)


def _check_time(options: argparse.Namespace, end: float) -> None:
    """Refuse a picture of a time after the end (s)."""
    if options.at is not None and options.at > end:
        raise SwimError(f"--at must be at most the run's end, {end:g} s, got {options.at:g}")


def _swimmers(options: argparse.Namespace) -> tuple[Path, list[Swimmer]]:
    """Play; return where the recording goes, and the swimmers in it."""
    place = options.output or "results/recordings"
    looks = {
        "colour": options.colour if options.colour == "moment" else None,
        "flow_rate": 0.0 if options.no_flow else options.flow_rate,
        "frame_rate": options.frame_rate,
        "noise": options.noise,
        "task_options": cli.task_options(options) or None,
    }
    others = [] if options.compare_with is None else [options.compare_with]
    if options.trajectory is None:
        cli.adopt(options, [*options.policy, *others], _SCENE)
    task, seed = options.task or "forward", options.seed or 0
    if options.trajectory is not None:
        saved = Trajectory.load(options.trajectory)
        scene = cli.played_scene(saved.scene, saved.duration if saved.steps else None)
        _check_scene(options, scene, float(saved.time[-1]))
        name = Path(options.trajectory).stem
        _load(options, scene, others)
        labels = [file_name(name, os.path.abspath(options.trajectory)), *map(policy_label, others)]
        label = run_label(saved.scene, labels, task, seed, **looks)
        file = recording.recording_file(place, label)
        planar = saved.scene.dimension == 2
        start = velocity_of_start(saved) if saved.steps and planar else None
        kept = Swimmer(name, saved, start_velocity=start)
        return file, [kept, *_play(options, scene, others)]
    scene = cli.scene_of(options)
    steps = steps_of(scene, options.duration)
    _check_scene(options, scene, steps * scene.integrator.time_step)
    policies = [*options.policy, *others]
    scene = cli.played_scene(scene, options.duration)
    _load(options, scene, policies)
    labels = [*([] if options.policy else [playing.PRESCRIBED]), *map(policy_label, policies)]
    file = recording.recording_file(place, run_label(scene, labels, task, seed, **looks))
    geometry_of(scene).load()
    swimmers = [] if options.policy else [playing.play_prescribed(scene, options.duration)[0]]
    return file, [*swimmers, *_play(options, scene, policies)]


def _load(options: argparse.Namespace, scene: Scene, policies: list[str]) -> None:
    """Refuse policies, and a task, that cannot be played, before anything is played."""
    task = options.task or "forward"
    if policies:
        make_task(task, scene, cli.task_options(options))
    for policy in policies:
        load_policy(policy, scene, options.seed, task)


def _play(options: argparse.Namespace, scene: Scene, policies: list[str]) -> list[Swimmer]:
    """Play policies as episodes from one start, the scene's own beside a run without noise."""
    task, seed, noise = options.task or "forward", options.seed or 0, options.noise
    if noise is None:
        noise = 1.0 if options.policy else 0.0
    return [
        playing.play_policy(
            scene, policy, task=task, seed=seed, noise=noise, task_options=cli.task_options(options)
        )[0]
        for policy in policies
    ]


def _table(made: dict[str, Any]) -> str:
    rows = [
        ("recording", made["file"]),
        ("size", f"{made['bytes'] / 1e6:.2f} MB"),
        ("frames", f"{made['frames']}, and {made['flow_frames']} of the fluid"),
        ("schema", str(made["schema"])),
    ]
    if "logging_seconds" in made:
        rows[3:3] = [
            ("logging", f"{made['logging_seconds']:.2f} s"),
            ("fluid", f"{made['flow_seconds']:.2f} s"),
        ]
    return text_table(rows, left=True)
