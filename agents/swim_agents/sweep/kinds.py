"""The commands that a sweep can run: how they are called, and which figures they return."""

from __future__ import annotations

import argparse
import importlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from swim_agents.commands import command_line as cli
from swim_agents.learning.config import load_config
from swim_env.errors import SettingsError
from swim_env.scene import Scene, load_scene
from swim_env.scene.checks import got

#: Options that the sweep gives itself, or has another place for.
OWN_OPTIONS = {"set", "json", "output", "resume"}


class SweepError(SettingsError):
    """A sweep's file cannot be used."""


class Kind(NamedTuple):
    """A command as a run of a sweep.

    Parameters
    ----------
    output : callable
        Returns the arguments that put results into a run's folder, and continue a run there.
    resolve : callable
        Returns the scene, and the settings in full as text, or refuses them with a SwimError.
    figures : callable
        Returns the figures of a run from the JSON that the command prints.
    leading : str, optional
        The option that is given without its name.
    """

    output: Callable[[Path], list[str]]
    resolve: Callable[[argparse.Namespace], tuple[Scene, str]]
    figures: Callable[[dict[str, Any]], dict[str, Any]] = dict
    leading: str | None = None


def _scene(options: argparse.Namespace) -> tuple[Scene, str]:
    scene = load_scene(options.scene, options.set)
    return scene, scene.to_yaml()


def _config(options: argparse.Namespace) -> tuple[Scene, str]:
    if len(options.seeds) > 1:
        raise SweepError("seeds of a run must be one; give several as {grid: [0, 1, 2]}")
    config = load_config(options.config, options.set, options.scene)
    return config.scene, config.to_yaml()


KINDS = {
    # Its files are quicker made again, for the few that are looked at, than kept for all.
    "replay": Kind(lambda folder: [], _scene),
    "tune": Kind(lambda folder: ["--output", str(folder / "tuned.tuned_wave.json")], _scene),
    "optimise": Kind(
        lambda folder: ["--output", str(folder / "gait.optimal_gait.json")],
        _scene,
        lambda result: {name: one for name, one in result.items() if not isinstance(one, dict)},
    ),
    "train": Kind(
        lambda folder: ["--output", str(folder), "--resume"],
        _config,
        lambda result: dict(result["runs"][0]),
        leading="config",
    ),
}


class _Parser(argparse.ArgumentParser):
    """A parser whose complaints are errors of a sweep."""

    def error(self, message: str) -> NoReturn:
        raise SweepError(f"{self.prog}: {message}")


def command_line(kind: str, options: Mapping[str, Any], fields: Mapping[str, Any]) -> list[str]:
    """Return the command line of a run behind the command's name.

    Parameters
    ----------
    kind : str
        A key of KINDS.
    options : mapping
        The command's options by name; true for one without a value, false or null to leave it out.
    fields : mapping
        Changes for ``--set``.
    """
    leading: list[str] = []
    line: list[str] = []
    for name, value in options.items():
        if name == KINDS[kind].leading:
            leading.append(str(value))
        elif value is True:
            line.append(f"--{name}")
        elif isinstance(value, list):
            line += [f"--{name}", *map(str, value)]
        elif isinstance(value, Mapping):
            raise SweepError(f"{name} must be one value, or what differs, got {got(value)}")
        elif value is not None and value is not False:
            line += [f"--{name}={value}"]
    if fields:
        # JSON is YAML on one line.
        line += ["--set", *(f"{path}={json.dumps(value)}" for path, value in fields.items())]
    return [*leading, *line]


def resolved(kind: str, arguments: list[str]) -> tuple[Scene, str]:
    """Return the scene of a run, and all its settings in full as text.

    Raises
    ------
    SweepError
        If the command does not know an option.
    SwimError
        If it refuses a scene or a configuration.
    """
    module = importlib.import_module(f"swim_agents.commands.{kind}")
    parser = _Parser(prog=kind, allow_abbrev=False)
    module.add_arguments(parser)
    options = parser.parse_args(arguments)
    cli.check_numbers(options)
    return KINDS[kind].resolve(options)
