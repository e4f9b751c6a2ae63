#!/usr/bin/env python
"""Time this checkout against another one, step for step in the same minutes."""

from __future__ import annotations

import argparse
import json
import sys

from swim_agents.commands.command_line import add_options, progress_bar, run

from studies.benchmark.checkouts import EASY_SCENES, compare_checkouts
from swim_env.errors import SwimError


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "before", metavar="FOLDER", help="the other checkout, for example a worktree of a tag"
    )
    parser.add_argument("--rounds", type=int, default=101, metavar="NUMBER")
    add_options(parser, "json")
    options = parser.parse_args(arguments)
    if options.rounds < 1:
        raise SwimError(f"--rounds must be at least 1, got {options.rounds}")
    with progress_bar(len(EASY_SCENES) * options.rounds, "round", "in turn") as progress:
        found = compare_checkouts(options.before, options.rounds, progress)
    if options.json:
        print(json.dumps(found))
        return 0
    print("scene        before (us)  after (us)  after/before (quartiles)   of the smallest")
    for name, one in found.items():
        paired = one["ratio"]
        print(
            f"{name:<12} {one['before']['median']:11.1f} {one['after']['median']:11.1f}  "
            f"{paired['median']:.3f} ({paired['low']:.3f} to {paired['high']:.3f})     "
            f"{one['ratio_of_smallest']:.3f}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
