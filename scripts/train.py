#!/usr/bin/env python
"""Train agents with stable-baselines3, one run for each seed; go on with runs that were cut off."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from swim_agents.commands.command_line import INTERRUPTED, run, training_bar
from swim_agents.learning.config import TrainingConfig, config_names, load_config

from swim_env.envs.assessment import load_assessment
from swim_env.errors import SwimError


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "config",
        metavar="CONFIG",
        help=f"a shipped configuration ({', '.join(config_names())}) or the path of a YAML file",
    )
    parser.add_argument(
        "--set",
        dest="overrides",
        action="extend",
        nargs="+",
        default=[],
        metavar="FIELD=VALUE",
        help="change fields of the configuration, for example steps=500000 ppo.epochs=10 "
        "scene.beam.elements=18",
    )
    parser.add_argument(
        "--seeds",
        type=int,
        nargs="+",
        default=[0],
        metavar="N",
        help="one run each; 0 unless given",
    )
    parser.add_argument(
        "--output",
        metavar="FOLDER",
        help="where the runs go, each into FOLDER/seed_N; results/train/NAME unless given",
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on from the last checkpoints; runs that are finished are left as they are",
    )
    parser.add_argument(
        "--device", default="cpu", help="of PyTorch: cpu (the default), cuda, auto ..."
    )
    parser.add_argument(
        "--threads",
        type=int,
        metavar="N",
        help="threads that step the batch, no influence on the results; all cores unless given",
    )
    parser.add_argument(
        "--record",
        metavar="FOLDER",
        help="write a recording for rerun of every evaluation's first episode, without the fluid, "
        "into FOLDER/seed_N/evaluation-STEPS.rrd",
    )
    parser.add_argument("--json", action="store_true", help="end with the runs as one JSON line")
    return parser


def _table(runs: list[dict[str, Any]], task: str) -> str:
    score = "success_rate" if task == "target" else "net_displacement_median"
    unit = "of the targets" if task == "target" else "BL"
    lines = [f"{'seed':>6} {'steps':>12} {'seconds':>9} {'last':>9} {'best':>9}  ({unit})"]
    for one in runs:
        lines.append(
            f"{one['seed']:>6} {one['steps']:>12,} {one['seconds']:>9.0f} "
            f"{one['last'][score]:>9.3f} {one['best'][score]:>9.3f}"
        )
    return "\n".join(lines)


def _train_all(
    options: argparse.Namespace, config: TrainingConfig, base: Path
) -> list[dict[str, Any]]:
    """Train one seed after another, once it is clear that none of them will be refused."""
    from swim_agents.learning.trainer import check_run, train

    finished = set()
    for seed in options.seeds:
        before = check_run(
            config, base / f"seed_{seed}", seed, resume=options.resume, device=options.device
        )
        if before is not None and before["finished"]:
            print(f"seed {seed}: finished before, left as it is", file=sys.stderr)
            finished.add(seed)
    load_assessment()
    command = shlex.join(["python", "scripts/train.py", *(options.arguments or sys.argv[1:])])
    runs = []
    for seed in options.seeds:
        label = f"{config.name} seed {seed}"
        steps = 0 if seed in finished else config.steps
        with training_bar(steps, label) as progress:
            told: Callable[[int, str], object] = progress
            result = train(
                config,
                base / f"seed_{seed}",
                seed,
                resume=options.resume,
                device=options.device,
                threads=options.threads,
                command=command,
                record=None if options.record is None else Path(options.record) / f"seed_{seed}",
                progress=told,
            )
        runs.append({**result, "folder": str(base / f"seed_{seed}")})
    return runs


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    options = _parser().parse_args(arguments)
    options.arguments = arguments
    if len(set(options.seeds)) < len(options.seeds):
        raise SwimError(f"--seeds must differ, got {' '.join(map(str, options.seeds))}")
    if options.threads is not None and options.threads < 1:
        raise SwimError(f"--threads must be at least 1, got {options.threads}")
    config = load_config(options.config, options.overrides)
    base = Path(options.output or f"results/train/{config.name}")
    try:
        runs = _train_all(options, config, base)
    except KeyboardInterrupt:
        print("interrupted; --resume goes on from the last checkpoint", file=sys.stderr)
        return INTERRUPTED
    if options.json:
        print(json.dumps({"name": config.name, "runs": runs}, allow_nan=False))
    else:
        print(_table(runs, config.task))
    print(f"runs are in {base}; the best agent of each in its folder agent", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
