#!/usr/bin/env python
"""Search for the travelling wave that swims farthest. As `swim-env tune`."""

import sys

from swim_agents.commands.command_line import run
from swim_agents.commands.main import command

main = command("tune")

if __name__ == "__main__":
    sys.exit(run(main))
