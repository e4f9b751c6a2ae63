#!/usr/bin/env python
"""Time this checkout against another one, step for step in the same minutes."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # studies are not installed

from swim_agents.commands.command_line import add_options, progress_bar, run
from swim_agents.tables import text_table

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
    heads = ("scene", "before (us)", "after (us)", "after/before (quartiles)", "of the smallest")
    rows = [
        (
            name,
            *(f"{one[when]['median']:.1f}" for when in ("before", "after")),
            "{median:.3f} ({low:.3f} to {high:.3f})".format_map(one["ratio"]),
            f"{one['ratio_of_smallest']:.3f}",
        )
        for name, one in found.items()
    ]
    print(text_table([heads, *rows]))
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
