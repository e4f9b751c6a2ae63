"""Train agents with stable-baselines3, one run for each seed, or continue interrupted runs."""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path
from typing import Any

from tqdm import tqdm

from swim_agents.commands import INTERRUPTED
from swim_agents.commands import command_line as cli
from swim_agents.files import check_file, writing
from swim_agents.learning.config import TrainingConfig, config_names, load_config
from swim_agents.tables import text_table
from swim_env import characterise
from swim_env.envs.geometry import geometry_of
from swim_env.errors import SwimError
from swim_env.files.names import file_name
from swim_env.recording import recording_file


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument(
        "config",
        metavar="CONFIG",
        nargs="?",
        default="ppo",
        help="what to learn and how; ppo unless given, which suits any body: "
        f"a shipped configuration ({', '.join(config_names())}) or the path of a YAML file",
    )
    parser.add_argument(
        "--scene",
        metavar="NAME",
        help="a shipped scene or the path of a scene file, instead of the configuration's own",
    )
    cli.add_overrides(parser, "configuration", "steps=500000 ppo.epochs=10 scene.beam.elements=18")
    parser.add_argument(
        "--seeds", type=int, nargs="+", default=[0], metavar="N", help="a run each; 0 unless given"
    )
    parser.add_argument(
        "--output",
        metavar="FOLDER",
        help="where the runs go, each into FOLDER/seed_N; results/train/NAME unless given",
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="continue from the last checkpoints; finished runs are left as they are, unless "
        "--set steps=N with more steps prolongs them",
    )
    parser.add_argument(
        "--device", default="cpu", help="of PyTorch: cpu (the default), cuda, auto ..."
    )
    parser.add_argument(
        "--threads",
        type=int,
        metavar="N",
        help="threads that step the batch; the results do not depend on it; all cores unless given",
    )
    parser.add_argument(
        "--record",
        metavar="FOLDER",
        help="write a recording for rerun of every evaluation's first episode, without the fluid, "
        "into FOLDER/RUN/evaluation-STEPS.rrd, where RUN is named after the run",
    )
    cli.add_options(parser, "json")


def main(options: argparse.Namespace) -> int:
    """Train one seed after another and print how they did."""
    if len(set(options.seeds)) < len(options.seeds):
        raise SwimError(f"--seeds must differ, got {' '.join(map(str, options.seeds))}")
    if options.threads is not None and options.threads < 1:
        raise SwimError(f"--threads must be at least 1, got {options.threads}")
    config = load_config(options.config, options.set, options.scene)
    base = Path(options.output or f"results/train/{file_name(config.name)}")
    try:
        runs = _train_all(options, config, base)
    except KeyboardInterrupt:
        print("interrupted; --resume continues from the last checkpoint", file=sys.stderr)
        return INTERRUPTED
    result = {"name": config.name, "runs": runs}
    print(f"runs are in {base}; the best agent of each in its folder agent", file=sys.stderr)
    cli.print_result(result, options.json, lambda: _table(runs, config))
    return 0


def _train_all(
    options: argparse.Namespace, config: TrainingConfig, base: Path
) -> list[dict[str, Any]]:
    """Train one seed after another, once it is clear that none of them will be refused."""
    from swim_agents.learning.trainer import check_run, train

    folders = {seed: base / f"seed_{seed}" for seed in options.seeds}
    settings: dict[str, Any] = {"resume": options.resume, "device": options.device}
    steps = dict.fromkeys(folders, config.steps)
    for seed, folder in folders.items():
        before = check_run(config, folder, seed, **settings)
        if before is not None and before["finished"]:
            print(
                f"seed {seed}: finished before, left as it is; more steps prolong it "
                "(--set steps=N)",
                file=sys.stderr,
            )
            steps[seed] = 0
    if options.record is not None:
        recording_file(Path(options.record) / "any.rrd", "any")
    for folder in [folder for seed, folder in folders.items() if steps[seed]]:
        with writing("the run's folder", folder, verb="make"):
            folder.mkdir(parents=True, exist_ok=True)
        check_file(folder / "run.json")
    geometry_of(config.scene).load()
    for advice in characterise(config.scene).advice:
        _say(f"advice: {advice}")
    runs = []
    bar = {"unit_scale": True, "mininterval": 0.5, "leave": True}
    for seed, folder in folders.items():
        label = f"{config.name} seed {seed}"
        with cli.progress_bar(steps[seed], "step", label, **bar) as progress:
            result = train(
                config,
                folder,
                seed,
                **settings,
                threads=options.threads,
                command=shlex.join(options.command_line),
                record=options.record,
                progress=progress,
                notice=_say,
            )
        runs.append({**result, "folder": str(folder)})
    return runs


def _say(text: str) -> None:
    """Show a line on stderr, above the progress bar."""
    tqdm.write(text, file=sys.stderr)


def _table(runs: list[dict[str, Any]], config: TrainingConfig) -> str:
    task = config.make_task()
    score, unit = "net_displacement_median", "BL"
    if not task.scored_by_displacement:
        score, unit = "return_mean", f"return, {task.unit}"
    if task.has_success:
        score, unit = "success_rate", "succeed"
    heads = ("seed", "steps", "seconds", f"last ({unit})", f"best ({unit})")
    rows = [
        (
            one["seed"],
            f"{one['steps']:,}",
            f"{one['seconds']:.0f}",
            *(f"{one[when][score]:.3f}" for when in ("last", "best")),
        )
        for one in runs
    ]
    return text_table([heads, *rows])
