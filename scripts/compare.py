#!/usr/bin/env python
"""Compare agents and baselines from the same starts. As `swim-env compare`."""

import sys

from swim_agents.commands.command_line import run
from swim_agents.commands.main import command

main = command("compare")

if __name__ == "__main__":
    sys.exit(run(main))
