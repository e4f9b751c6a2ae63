"""The console command: finds the subcommand, and imports nothing for any other."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version

__all__ = ["COMMANDS", "command", "main"]

#: The subcommands, each a module of this package, and what they do.
COMMANDS = {
    "replay": "play a scene's prescribed torque, or an episode of the environment",
    "train": "train agents, or continue interrupted runs",
    "compare": "compare agents and baselines from the same starts, with every score checked",
    "visualise": "record how policies swim, and look at it in rerun's viewer",
    "characterise": "show a body's masses and frequencies, and what would keep it from swimming",
    "tune": "search for the travelling wave that swims farthest",
    "optimise": "find the torques that are best, by exact gradients of whole episodes",
    "accuracy": "choose the cheapest settings that compute a scene to a tolerance",
    "sweep": "do many runs of a command that differ in settings, here or on a cluster",
    "warm-up": "compile the kernels, for images and clusters",
}


def command(name: str, prog: str | None = None) -> Callable[[list[str] | None], int]:
    """Return a subcommand as a function of the command line (`sys.argv` unless given).

    Parameters
    ----------
    name : str
        A key of COMMANDS.
    prog : str, optional
        The program's name in help and usage; the script's unless given.
    """

    def run_command(arguments: list[str] | None = None) -> int:
        from swim_agents.commands.command_line import check_numbers
        from swim_env.scene.checks import nearest

        module = importlib.import_module(f"swim_agents.commands.{name.replace('-', '_')}")
        given = sys.argv[1:] if arguments is None else list(arguments)
        parser = argparse.ArgumentParser(prog=prog, description=module.__doc__, allow_abbrev=False)
        module.add_arguments(parser)
        parser.set_defaults(command_line=["swim-env", name, *given])
        options, unknown = parser.parse_known_args(given)
        if unknown:
            first = unknown[0].partition("=")[0]
            if not first.startswith("-"):
                parser.error(f"unexpected argument {first}; --help lists what there is")
            known = [one for action in parser._actions for one in action.option_strings]
            parser.error(f"unknown option {first}{nearest(first, known)}; --help lists all")
        check_numbers(options)
        return int(module.main(options))

    return run_command


def main(arguments: list[str] | None = None) -> int:
    """Run ``swim-env`` and return its exit code."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    parser = argparse.ArgumentParser(
        prog="swim-env", description="An elastic beam that swims in an ideal fluid."
    )
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for name, about in COMMANDS.items():
        commands.add_parser(name, help=about)
    asked = given[:1] == ["--version"]
    if not asked and (not given or given[0] not in COMMANDS):
        parser.parse_args(given)  # exits: help, version or a usage error
    from swim_agents.commands.command_line import run

    if asked:
        return run(_print_version, given[1:])
    return run(command(given[0], f"swim-env {given[0]}"), given[1:])


def _print_version(_: list[str] | None) -> int:
    print(f"swim-env {_version()}")
    return 0


def _version() -> str:
    """Return the version; a checkout that is not installed has to import the library for it."""
    try:
        return version("swim-env")
    except PackageNotFoundError:
        from swim_env import __version__

        return __version__
