"""Choose the cheapest settings that compute a scene to a tolerance, and print the scene with them.

The settings (fluid model, panels, elements, time step, scheme) are chosen by playing the scene's
prescribed torque, for at most 20 s; the tolerance is a share of its net displacement.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict

from swim_agents.commands import command_line as cli
from swim_agents.files import check_file


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    cli.add_scene_arguments(parser)
    parser.add_argument(
        "--tolerance",
        type=float,
        required=True,
        metavar="X",
        help="largest relative error of the net displacement, 0.001 to 0.3",
    )
    parser.add_argument(
        "--keep-elements",
        action="store_true",
        help="keep the number of elements, as an agent for so many joints needs it",
    )
    cli.add_options(parser, "duration")
    parser.add_argument(
        "--output", metavar="FILE", help="write the scene into this YAML file; printed unless given"
    )


def main(options: argparse.Namespace) -> int:
    """Choose, and print or write the scene."""
    if options.output is not None:
        check_file(options.output)
    cli.check_places([options.scene], {"--output": options.output})
    scene = cli.scene_of(options)
    choice = cli.chosen(scene, options.tolerance, options.keep_elements, options.duration)
    text = f"{scene.description} Settings chosen {choice.reason}.".strip()
    found = choice.scene.replace("description", text)
    if options.output is not None:
        found.save(options.output)
        print(f"the scene is in {options.output}", file=sys.stderr)
    if options.json or options.output is None:
        figures = {name: value for name, value in vars(choice).items() if name != "scene"}
        result = {**figures, "settings": asdict(choice.settings), "scene": found.to_dict()}
        cli.print_result(result, options.json, lambda: found.to_yaml().rstrip())
    return 0
