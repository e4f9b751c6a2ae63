#!/usr/bin/env python
"""Play a scene's prescribed torque and say what came of it."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from swim_env.command_line import add_scene_arguments, progress_bar, run, scene_of
from swim_env.physics.loading import load_kernels
from swim_env.replay import check_result_folder, replay, steps_of, write_results
from swim_env.viewer import require_matplotlib


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    add_scene_arguments(parser)
    parser.add_argument(
        "--duration",
        type=float,
        metavar="S",
        help="simulated time in seconds, rounded to whole steps; the scene's own unless given",
    )
    parser.add_argument(
        "--output",
        metavar="FOLDER",
        help="write summary.json, trajectory.npz, scene.yaml and path.png into this folder",
    )
    parser.add_argument("--json", action="store_true", help="end with the figures as one JSON line")
    return parser


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
        ("energy drift", f"{summary['energy_drift']:.2e} of the largest energy"),
        ("momentum drift", f"{summary['momentum_drift']:.2e}"),
        ("largest residual", f"{summary['max_residual']:.2e}"),
        ("Newton corrections", f"{summary['newton_iterations_mean']:.2f} a step"),
    ]
    if summary["halved_steps"]:
        rows.append(("steps cut", f"{summary['halved_steps']}, into up to {summary['most_parts']}"))
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {value}" for name, value in rows)


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    options = _parser().parse_args(arguments)
    scene = scene_of(options)
    if options.output is not None:
        require_matplotlib()
        check_result_folder(options.output)
    steps = steps_of(scene, options.duration)
    load_kernels()
    with progress_bar(steps, "step", scene.name) as progress:
        trajectory, summary = replay(scene, options.duration, progress)
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
