#!/usr/bin/env python
"""Play scenes and policies and draw the gallery: paths, bending, torques, energy, work, learning.

FOLDER gets the pictures and gallery.json; the page is FOLDER.md beside it.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # studies are not installed

from swim_agents.commands.command_line import add_options, print_result, run, share_bar

from studies.gallery.page import check_gallery, make_gallery
from studies.gallery.runs import FULL, QUICK
from studies.store import page_of
from swim_env.envs.assessment import load_assessment
from swim_env.files.names import shown_name
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
    add_options(parser, "json")
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    options = _parser().parse_args(arguments)
    plan, quick = (QUICK, "_quick") if options.quick else (FULL, "")
    folder = options.output or f"results/gallery{quick}"
    command = ["python", "scripts/gallery.py", *(["--quick"] if quick else [])]
    if options.seed is not None:
        plan = replace(plan, seed=options.seed)
        command += ["--seed", str(options.seed)]
    command += ["--output", folder]
    require_matplotlib()
    check_gallery(folder)
    load_assessment()
    with share_bar("gallery") as progress:
        record = make_gallery(folder, plan, shown_name(shlex.join(command)), progress)
    lines = [
        f"{name:12s} {rows[-1]['net_displacement']:+.4f} body lengths for "
        f"{rows[-1]['positive_work']:.4g} J"
        for name, rows in record["policies"].items()
    ]
    print(f"the page is {page_of(folder)}", file=sys.stderr)
    print_result(record, options.json, lambda: "\n".join(lines))
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
