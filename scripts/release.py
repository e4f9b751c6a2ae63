#!/usr/bin/env python
"""List the stored studies under docs: which are stale, what renews them and how long it takes.

A study is stale where the code that decides its results has changed since: the kernels, and where a
study keeps more than their fingerprint, its own code and scenes.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # studies are not installed

from swim_agents.commands.command_line import run
from swim_agents.tables import text_table

from studies.fingerprint import ROOT
from studies.release import STORED

HEADS = ("study", "state", "command", "duration")


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print the list as one JSON line")
    options = parser.parse_args(arguments)
    found = []
    for one in STORED:
        problem = one.problem(ROOT / "docs" / one.place)
        state = f"stale: {problem}" if problem else "current"
        found.append((f"docs/{one.place}", state, one.command, one.duration))
    if options.json:
        print(json.dumps({"studies": [dict(zip(HEADS, row, strict=True)) for row in found]}))
    else:
        print(text_table([HEADS, *found]))
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
