#!/usr/bin/env python
"""Play scenes and policies and draw the gallery: paths, bending, torques, energy, work, learning.

FOLDER gets the pictures and gallery.json; the page is FOLDER.md beside it.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import replace

from swim_agents.commands.command_line import progress_bar, run

from studies.gallery.page import check_gallery, make_gallery
from studies.gallery.runs import FULL, QUICK
from swim_env.envs.assessment import load_assessment
from swim_env.files.folders import page_of
from swim_env.plots import require_matplotlib


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--output",
        metavar="FOLDER",
        help="where the pictures go; results/gallery unless given, results/gallery_quick with "
        "--quick",
    )
    parser.add_argument("--quick", action="store_true", help="short runs, in a quarter of a minute")
    parser.add_argument(
        "--seed",
        type=int,
        metavar="N",
        help=f"of the start's noise and of the target; {FULL.seed} unless given",
    )
    parser.add_argument("--json", action="store_true", help="end with the figures as one JSON line")
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    options = _parser().parse_args(arguments)
    plan = QUICK if options.quick else FULL
    command = "python scripts/gallery.py"
    if options.quick:
        command += " --quick"
    if options.seed is not None:
        plan = replace(plan, seed=options.seed)
        command += f" --seed {options.seed}"
    folder = options.output or ("results/gallery_quick" if options.quick else "results/gallery")
    command += f" --output {folder}"
    require_matplotlib()
    check_gallery(folder)
    load_assessment()
    with progress_bar(math.ceil(plan.seconds()), "s", "simulated") as progress:
        record = make_gallery(folder, plan, command, progress)
    if options.json:
        print(json.dumps(record, allow_nan=False))
    else:
        for name, rows in record["policies"].items():
            reached, work = rows[-1]["net_displacement"], rows[-1]["positive_work"]
            print(f"{name:12s} {reached:+.4f} body lengths for {work:.4g} J")
    print(f"the page is {page_of(folder)}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
