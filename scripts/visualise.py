#!/usr/bin/env python
"""Record how policies swim, with the fluid around them, and look at it in rerun's viewer."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path

from swim_agents.commands.command_line import add_scene_arguments, progress_bar, run, scene_of
from swim_agents.policies import load_policy, policy_names
from swim_agents.recording import swimmer_of
from swim_agents.replay import replay_episode

from swim_env.analysis.energy import velocity_of_start
from swim_env.envs.assessment import load_assessment
from swim_env.envs.task import TASKS, check_task
from swim_env.errors import SwimError
from swim_env.recording import (
    COLOURS,
    FLOW_RATE,
    FRAME_RATE,
    Swimmer,
    WrittenRecording,
    check_picture,
    has_flow,
    open_viewer,
    recording_file,
    take_picture,
    typed_command,
    write_recording,
)
from swim_env.scene import Scene
from swim_env.sim.replay import replay, steps_of
from swim_env.sim.simulator import Simulator
from swim_env.sim.trajectory import Trajectory

#: What is swum unless somebody says what.
_SCENE = "swimmer"
#: What the scene's own torque is called where no policy was named.
_PRESCRIBED = "prescribed"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    add_scene_arguments(parser, default=_SCENE)
    parser.set_defaults(scene=None)
    parser.add_argument(
        "--policy",
        action="append",
        default=[],
        metavar="NAME",
        help=f"who swims, as an episode: {', '.join(policy_names())}, or the path of an agent; may "
        "be given again for more swimmers side by side; the scene's prescribed torque unless given",
    )
    parser.add_argument(
        "--compare-with", metavar="NAME", help="one more policy beside it, such as paper_wave"
    )
    parser.add_argument(
        "--trajectory",
        metavar="FILE",
        help="record a saved run (.npz) instead of playing --scene with --set for --duration",
    )
    parser.add_argument(
        "--duration", type=float, metavar="S", help="simulated time (s); the scene's unless given"
    )
    parser.add_argument(
        "--task", help=f"of the policies: {' or '.join(TASKS)}; forward unless given"
    )
    parser.add_argument("--seed", type=int, help="of the policies' starts; 0 unless given")
    parser.add_argument(
        "--noise",
        type=float,
        metavar="X",
        help="factor on the noise of the policies' starts; 1 unless given, and 0 beside the "
        "prescribed torque or a saved run",
    )
    parser.add_argument(
        "--output",
        metavar="FILE",
        help="the recording, or the folder for it; results/recordings unless given",
    )
    parser.add_argument(
        "--colour",
        choices=tuple(COLOURS),
        default="torque",
        help="what the body's colours show: the joint torques or the elastic bending moments",
    )
    parser.add_argument("--no-flow", action="store_true", help="leave the fluid out")
    parser.add_argument(
        "--flow-rate",
        type=float,
        metavar="HZ",
        help=f"frames of the fluid in a simulated second; {FLOW_RATE:g} unless given",
    )
    parser.add_argument(
        "--frame-rate",
        type=float,
        default=FRAME_RATE,
        metavar="HZ",
        help=f"frames of everything else; {FRAME_RATE:g} unless given",
    )
    parser.add_argument("--view", action="store_true", help="open rerun's viewer with it")
    parser.add_argument(
        "--picture",
        metavar="FILE",
        help="keep a picture (.png, .jpg) of rerun's viewer with it, no display needed",
    )
    parser.add_argument(
        "--at", type=float, metavar="S", help="time that the picture shows; half of it unless given"
    )
    parser.add_argument("--json", action="store_true", help="end with the figures as one JSON line")
    return parser


def _task_of(options: argparse.Namespace) -> str:
    return options.task or "forward"


def _check(options: argparse.Namespace) -> None:
    """Refuse what has no meaning before anything is played."""
    if options.trajectory is not None:
        for name, value in (
            ("scene", options.scene),
            ("set", options.overrides or None),
            ("duration", options.duration),
        ):
            if value is not None:
                raise SwimError(f"--{name} has no meaning with --trajectory")
    for name in ("task", "seed", "noise"):
        if getattr(options, name) is not None and not (options.policy or options.compare_with):
            raise SwimError(f"--{name} needs --policy or --compare-with")
    check_task(_task_of(options))
    if options.no_flow and options.flow_rate is not None:
        raise SwimError("--flow-rate has no meaning with --no-flow")
    for name in ("flow_rate", "frame_rate"):
        rate = getattr(options, name)
        if rate is not None and not 0.0 < rate <= 1e4:
            raise SwimError(
                f"--{name.replace('_', '-')} must be above 0 and at most 10000, got {rate:g}"
            )
    if options.at is not None and options.picture is None:
        raise SwimError("--at needs --picture")
    if options.picture is not None:
        check_picture(options.picture)
    if options.at is not None and not 0.0 <= options.at < math.inf:
        raise SwimError(f"--at must be a time of at least 0, got {options.at:g}")
    if options.trajectory is not None and options.policy:
        raise SwimError("--policy has no meaning with --trajectory; --compare-with adds a policy")


def _check_scene(options: argparse.Namespace, scene: Scene, end: float) -> None:
    """Refuse what has no meaning with a scene, or a run up to some time (s)."""
    if options.flow_rate is not None and not has_flow(scene):
        raise SwimError(
            f"--flow-rate has no meaning: scene {scene.name} has no fluid, so there is no flow to "
            "record"
        )
    if options.at is not None and options.at > end:
        raise SwimError(f"--at must be at most the run's end, {end:g} s, got {options.at:g}")


def _play(options: argparse.Namespace, scene: Scene, policies: list[str]) -> list[Swimmer]:
    """Play policies as episodes from the same start: the scene's own beside what has no noise."""
    task, seed = _task_of(options), options.seed or 0
    noise = options.noise
    if noise is None:
        noise = 1.0 if options.policy else 0.0
    for policy in policies:
        load_policy(policy, scene, seed, task)
    swimmers = []
    for policy in policies:
        with progress_bar(scene.actions_per_episode, "action", policy) as progress:
            rollout, trajectory, _ = replay_episode(
                scene, policy, task, seed, noise, progress=progress
            )
        swimmers.append(swimmer_of(Path(policy).name, rollout, trajectory))
    return swimmers


def _swimmers(options: argparse.Namespace) -> tuple[Path, list[Swimmer]]:
    """Return where the recording goes, and who is in it."""
    place = options.output or "results/recordings"
    others = [] if options.compare_with is None else [options.compare_with]
    if options.trajectory is not None:
        saved = Trajectory.load(options.trajectory)
        scene = saved.scene
        if saved.steps:
            scene = scene.replace("episode.duration", saved.duration)
        _check_scene(options, scene, float(saved.time[-1]))
        name = Path(options.trajectory).stem
        file = recording_file(place, f"{scene.name}-{name}")
        start = velocity_of_start(saved) if saved.steps else None
        kept = Swimmer(name, saved, start_velocity=start)
        return file, [kept, *_play(options, scene, others)]
    options.scene = options.scene or _SCENE
    scene = scene_of(options)
    steps = steps_of(scene, options.duration)
    _check_scene(options, scene, steps * scene.integrator.time_step)
    if options.duration is not None:
        scene = scene.replace("episode.duration", options.duration)
    policies = [*options.policy, *others]
    names = [Path(policy).name for policy in policies] or [_PRESCRIBED]
    file = recording_file(place, "-".join([scene.name, *names]))
    load_assessment()
    swimmers = []
    if not options.policy:
        with progress_bar(steps, "step", scene.name) as progress:
            trajectory, _ = replay(scene, options.duration, progress)
        start = Simulator(scene).velocity()
        swimmers.append(Swimmer(_PRESCRIBED, trajectory, start_velocity=start))
    return file, [*swimmers, *_play(options, scene, policies)]


def _table(written: WrittenRecording) -> str:
    rows = [
        ("recording", written.file),
        ("size", f"{written.size / 1e6:.2f} MB"),
        ("frames", f"{written.frames}, and {written.flow_frames} of the fluid"),
        ("logging", f"{written.logging_seconds:.2f} s"),
        ("fluid", f"{written.flow_seconds:.2f} s"),
        ("schema", str(written.schema)),
    ]
    return "\n".join(f"{name:<10} {value}" for name, value in rows)


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    options = _parser().parse_args(arguments)
    _check(options)
    file, swimmers = _swimmers(options)
    for swimmer in swimmers:
        if swimmer.trajectory.termination_reason:
            print(
                f"{swimmer.name} ended early at t = {swimmer.trajectory.time[-1]:g} s: "
                f"{swimmer.trajectory.termination_reason}",
                file=sys.stderr,
            )
    rate = None if options.no_flow else options.flow_rate or FLOW_RATE
    total = sum([swimmer.trajectory.duration for swimmer in swimmers])
    with progress_bar(max(1, round(total)), "s", "fluid") as progress:
        written = write_recording(
            file,
            swimmers,
            flow_rate=rate,
            frame_rate=options.frame_rate,
            colour=options.colour,
            progress=progress,
        )
    if options.picture is not None:
        longest = max(float(swimmer.trajectory.time[-1]) for swimmer in swimmers)
        shown = 0.5 * longest if options.at is None else options.at
        for complaint in take_picture(file, options.picture, shown):
            print(f"rerun: {complaint}", file=sys.stderr)
    print(json.dumps(written.to_dict(), allow_nan=False) if options.json else _table(written))
    if options.view:
        told = open_viewer(file)
        if told is not None:
            print(told, file=sys.stderr)
    elif not options.json:
        print(f"look at it with: {typed_command()} {written.file}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
