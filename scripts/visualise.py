#!/usr/bin/env python
"""Record how policies swim, and look at it in rerun's viewer. As `swim-env visualise`."""

import sys

from swim_agents.commands.command_line import run
from swim_agents.commands.main import command

main = command("visualise")

if __name__ == "__main__":
    sys.exit(run(main))
