#!/usr/bin/env python
"""Measure what everything costs: the physics step, environments, start-up, training, the peers."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
import time
from pathlib import Path
from typing import Any

from swim_agents.commands.command_line import progress_bar, run

from studies.benchmark.effects import effect_pairs, measure_effects
from studies.benchmark.environments import Workload, swim_workloads
from studies.benchmark.growth import growth_of
from studies.benchmark.memory import measure_memory
from studies.benchmark.peers import peer_workloads
from studies.benchmark.report import check_report_folder, report_tables, write_report
from studies.benchmark.startup import measure_cold_start, measure_warm_start
from studies.benchmark.suite import (
    FULL,
    QUICK,
    SECTIONS,
    Extent,
    kernel_scenes,
    measure_kernel,
    measure_speeds,
)
from swim_env.envs.assessment import load_assessment
from swim_env.errors import SwimError
from swim_env.files.provenance import where_and_when
from swim_env.physics.runtime.threads import usable_threads
from swim_env.plots import require_matplotlib

MOST_ROUNDS = 1000
#: Growth is fitted over all beams, and over those from here on, where the panels dominate.
LARGE_BEAMS = 18


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--only",
        action="append",
        choices=SECTIONS,
        metavar="SECTION",
        help=f"measure this alone, repeatable: {', '.join(SECTIONS)}; peers come with the "
        "environments that they are compared to",
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help="fewer beams, rounds, steps and peers, no start with an empty cache: under a minute",
    )
    parser.add_argument(
        "--rounds",
        type=int,
        metavar="R",
        help=f"how often each thing is timed; {FULL.rounds} unless given, {QUICK.rounds} with "
        "--quick",
    )
    parser.add_argument(
        "--output",
        metavar="FOLDER",
        help="write benchmark.json, benchmark.md and benchmark.png into this folder",
    )
    parser.add_argument("--json", action="store_true", help="end with everything as one JSON line")
    return parser


def _check(options: argparse.Namespace) -> None:
    """Refuse what would be found wrong only after the measurements."""
    if options.rounds is not None and not 1 <= options.rounds <= MOST_ROUNDS:
        raise SwimError(f"--rounds must be between 1 and {MOST_ROUNDS}, got {options.rounds}")
    if options.output is not None:
        require_matplotlib()
        check_report_folder(options.output)
        above = Path(os.path.realpath(options.output)).parent
        while not above.exists():
            above = above.parent
        if not above.is_dir() or not os.access(above, os.W_OK):
            raise SwimError(f"cannot write a folder there: {options.output}")


def _measure_kernel(extent: Extent) -> dict[str, Any]:
    scenes = kernel_scenes(extent.elements, extent.panels)
    with progress_bar(len(scenes), "scene", "physics step") as progress:
        cells = measure_kernel(scenes, extent.rounds, progress)
    return {"kernel": cells, "growth": growth_of(cells) + growth_of(cells, LARGE_BEAMS)}


def _measure_effects(extent: Extent) -> dict[str, Any]:
    with progress_bar(len(effect_pairs()), "effect", "effects") as progress:
        return {"effects": measure_effects(extent.rounds, progress)}


def _prepare_peers(extent: Extent) -> tuple[dict[str, Workload], dict[str, str]]:
    """Return what is timed of the peers, and why others are missing."""
    total = 1 + len(extent.chain_variants) + len(extent.softenings)
    with progress_bar(total, "peer", "preparing the peers") as progress:
        return peer_workloads(
            variants=extent.chain_variants,
            softenings=extent.softenings,
            ways=extent.chain_ways,
            single_steps=extent.single_steps,
            batch_steps=extent.batch_steps,
            progress=progress,
        )


def _measure_environments(extent: Extent, peers: dict[str, Workload]) -> dict[str, Any]:
    """Time the environments, and the peers in the same rounds."""
    ours = swim_workloads(
        usable_threads(), single_steps=extent.single_steps, batch_steps=extent.batch_steps
    )
    with progress_bar(extent.rounds, "round", "environments") as progress:
        speeds, ratios = measure_speeds({**ours, **peers}, extent.rounds, progress)
    for name, speed in speeds.items():
        speed["peer"] = name in peers
    return {"speeds": speeds, "ratios": ratios}


def _measure_startup(extent: Extent) -> dict[str, Any]:
    with progress_bar(extent.starts + extent.cold_start, "start", "start-up") as progress:
        warm = measure_warm_start(extent.starts, progress)
        cold = measure_cold_start() if extent.cold_start else None
        progress(int(extent.cold_start))
    return {"startup": {"warm": warm, "cold": cold}}


def _measure_training(extent: Extent) -> dict[str, Any]:
    from swim_agents.learning.config import load_config

    from studies.benchmark.training_cost import CONFIGS, measure_training

    runs = {}
    for name in CONFIGS:
        config = load_config(name, extent.training.get(name))
        with progress_bar(int(extent.training_seconds), "s", f"training, {name}") as progress:
            runs[config.algorithm] = measure_training(
                config, seconds=extent.training_seconds, progress=progress
            )
    return {"training": runs}


def _measure(wanted: tuple[str, ...], optional: bool, extent: Extent) -> dict[str, Any]:
    """Measure sections; where `optional`, leave out those whose packages are not installed."""
    load_assessment()
    record: dict[str, Any] = {}
    skipped: dict[str, str] = {}
    if "kernel" in wanted:
        record |= _measure_kernel(extent)
    if "effects" in wanted:
        record |= _measure_effects(extent)
    peers: dict[str, Workload] = {}
    if "peers" in wanted:
        peers, skipped = _prepare_peers(extent)
        if not peers and not optional:
            raise SwimError("; ".join(skipped.values()))
    if "environments" in wanted or "peers" in wanted:
        record |= _measure_environments(extent, peers)
    if "environments" in wanted:
        record["memory"] = measure_memory(members=extent.memory_members)
    if "startup" in wanted:
        record |= _measure_startup(extent)
    if "training" in wanted:
        try:
            record |= _measure_training(extent)
        except ImportError as error:
            if not optional:
                raise
            skipped["training"] = str(error)
    return {**record, "skipped": skipped}


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    options = _parser().parse_args(arguments)
    _check(options)
    wanted = tuple(options.only or SECTIONS)
    extent = QUICK if options.quick else FULL
    extent = extent._replace(rounds=options.rounds or extent.rounds)
    given = sys.argv[1:] if arguments is None else arguments
    record: dict[str, Any] = {
        "command": shlex.join(["scripts/benchmark.py", *given]),
        **where_and_when(),
        # Other programs' share in the figures: the spread tells, and this.
        "load_average": list(os.getloadavg()) if hasattr(os, "getloadavg") else None,
        "quick": options.quick,
        "rounds": extent.rounds,
        "sections": list(wanted),
    }
    start = time.perf_counter()
    record |= _measure(wanted, options.only is None, extent)
    record["wall_seconds"] = round(time.perf_counter() - start, 1)
    if options.output is not None:
        write_report(record, options.output)
        print(f"results are in {options.output}", file=sys.stderr)
    print(json.dumps(record, allow_nan=False) if options.json else report_tables(record))
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
