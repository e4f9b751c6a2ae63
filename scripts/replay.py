#!/usr/bin/env python
"""Play a scene's prescribed torque, or an episode of the environment. As `swim-env replay`."""

import sys

from swim_agents.commands.command_line import run
from swim_agents.commands.main import command

main = command("replay")

if __name__ == "__main__":
    sys.exit(run(main))
