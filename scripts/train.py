#!/usr/bin/env python
"""Train agents, or continue interrupted runs. As `swim-env train`."""

import sys

from swim_agents.commands.command_line import run
from swim_agents.commands.main import command

main = command("train")

if __name__ == "__main__":
    sys.exit(run(main))
