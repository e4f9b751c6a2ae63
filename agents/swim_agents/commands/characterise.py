"""Show a body's masses, natural frequencies and bend, and what would keep it from swimming."""

from __future__ import annotations

import argparse

from swim_agents.commands import command_line as cli


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    cli.add_scene_arguments(parser)


def main(options: argparse.Namespace) -> int:
    """Print the figures and the advice."""
    from swim_env import characterise

    found = characterise(cli.scene_of(options))
    cli.print_result(found.to_dict(), options.json, lambda: str(found))
    return 0
