"""A sweep's file: which command to run, and what differs from run to run.

.. code-block:: yaml

    run: replay                # a command: see `swim_agents.sweep.kinds.KINDS`
    options:                   # its options, by their names
      scene: paper_i
      duration: 5
    set:                       # fields, as for its option --set
      fluid.model: frozen
      beam.length: {grid: [0.5, 1.0]}
      beam.bending_stiffness: {log_uniform: [0.1, 10]}
    samples: 20                # random draws, each with every point of the grid
    seed: 0                    # of the draws

Any value of ``options`` and ``set`` may differ: ``grid`` lists the values that are tried with those
of all other grids; ``choice`` (of a list), ``uniform``, ``log_uniform`` and ``integers`` (from one
bound to another, both included) are drawn. Sample i is drawn alike whatever their number, so more
samples or points add runs and leave those that were done.
"""

from __future__ import annotations

import itertools
import json
import math
import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swim_agents.sweep.kinds import KINDS, OWN_OPTIONS, SweepError, command_line, resolved
from swim_env.errors import SceneError, SwimError
from swim_env.files.names import file_name
from swim_env.scene import Scene
from swim_env.scene.checks import check_fields, got, integer, one_of, real
from swim_env.scene.yaml import parse_yaml, read_text

_FIELDS = ("name", "description", "run", "options", "set", "samples", "seed")
#: Ways to draw, with the least value of a bound that they need.
_BOUNDS = {"uniform": None, "log_uniform": 0.0, "integers": None}
_WAYS = ("grid", "choice", *_BOUNDS)


@dataclass(frozen=True)
class Run:
    """One run of a sweep."""

    #: Of its folder: what differs, and a digest of all its settings.
    name: str
    #: A key of KINDS.
    kind: str
    #: The command line behind the command's name, without where results go.
    arguments: tuple[str, ...]
    #: What differs from run to run, by option or field.
    values: Mapping[str, Any]
    #: The scene or the configuration in full, or why there is none.
    settings: str


@dataclass(frozen=True)
class Sweep:
    """All runs of a sweep, in the order of its table."""

    name: str
    runs: tuple[Run, ...]
    #: Of the first run that has one.
    scene: Scene


def load_sweep(path: str | os.PathLike[str]) -> Sweep:
    """Read a sweep's file and check the command line of every run.

    Raises
    ------
    SweepError
        If the file cannot be read or used, two runs are the same, or no run has settings that its
        command takes. Single runs that have not are kept: they fail, and the table says why.
    """
    source = os.fspath(path)
    try:
        data = parse_yaml(read_text(path, source), source)
        given = {"samples": 1, "seed": 0, **check_fields(data, "", _FIELDS)}
        kind = one_of(tuple(KINDS))(given.get("run"), "run")
        samples = integer(1, 1_000_000)(given["samples"], "samples")
        seed = integer(0, 2**62)(given["seed"], "seed")
        blocks = [_mapping(given, name) for name in ("options", "set")]
        for name in OWN_OPTIONS & blocks[0].keys():
            raise SweepError(f"options.{name} is for the sweep to give")
        twice = blocks[0].keys() & blocks[1].keys()
        if twice:
            raise SweepError(f"{min(twice)} is among the options and among the fields of set")
        options = {name: _placed(value, Path(path).parent) for name, value in blocks[0].items()}
        points = _points({**options, **blocks[1]}, samples, seed)
        runs, scene = _runs(kind, points, options, blocks[1])
    except SceneError as error:
        problem = error.problem.replace("the scene file", "the sweep")
        raise SweepError(problem, error.source or source) from None
    except SweepError as error:
        raise error.located(source) from None
    (name, count), *_ = Counter(run.name for run in runs).most_common(1)
    if count > 1:
        raise SweepError(f"two runs are the same: {name}", source)
    return Sweep(file_name(str(given.get("name", Path(path).stem))), tuple(runs), scene)


def _mapping(given: Mapping[str, Any], name: str) -> dict[str, Any]:
    block = given.get(name) or {}
    if not isinstance(block, dict):
        raise SweepError(f"{name} must be a mapping, got {got(block)}")
    return block


def _runs(
    kind: str,
    points: list[dict[str, Any]],
    options: Mapping[str, Any],
    fields: Mapping[str, Any],
) -> tuple[list[Run], Scene]:
    """Return the runs, and the scene of the first one whose settings can be used."""
    differing = [name for name, value in {**options, **fields}.items() if _way(value)]
    runs: list[Run] = []
    first, refusal = None, ""
    for point in points:
        given = ({name: point[name] for name in block} for block in (options, fields))
        arguments = command_line(kind, *given)
        try:
            scene, settings = resolved(kind, arguments)
            first = first or scene
        except SweepError:
            raise
        except SwimError as error:
            settings = str(error)
            refusal = refusal or settings
        values = {name: point[name] for name in differing}
        parts = (f"{name.rpartition('.')[2]}={_short(value)}" for name, value in values.items())
        label = file_name(" ".join(parts), json.dumps([kind, arguments, settings]))
        runs.append(Run(label, kind, tuple(arguments), values, settings))
    if first is None:
        raise SweepError(f"no run can be made: {refusal}")
    return runs, first


def _short(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _way(value: object) -> str | None:
    """Return how a value differs from run to run, None for one that does not."""
    if isinstance(value, Mapping) and len(value) == 1 and set(value) <= set(_WAYS):
        return str(next(iter(value)))
    return None


def _placed(value: Any, folder: Path) -> Any:
    """Return an option with the paths in it, which are relative to the sweep's file, made whole."""
    way = _way(value)
    if way is not None and isinstance(value[way], list):
        return {way: [_placed(one, folder) for one in value[way]]}
    if isinstance(value, str):
        file, code, kind = value.partition(".py:")
        file += ".py" if code else ""
        if Path(file).name != Path(file).stem or len(Path(file).parts) > 1:
            if (folder / file).exists():
                return os.path.abspath(folder / file) + (f":{kind}" if code else "")
    return value


def _points(values: Mapping[str, Any], samples: int, seed: int) -> list[dict[str, Any]]:
    """Return what differs, for each run."""
    grids = {name: value["grid"] for name, value in values.items() if _way(value) == "grid"}
    drawn = {name: value for name, value in values.items() if _way(value) not in (None, "grid")}
    for name, listed in grids.items():
        if not isinstance(listed, list) or not listed:
            raise SweepError(f"{name}: grid must be a list of values, got {got(listed)}")
    if samples > 1 and not drawn:
        raise SweepError("samples has no meaning where nothing is drawn")
    points = []
    for corner in itertools.product(*grids.values()):
        for number in range(samples):
            random = np.random.default_rng([seed, number])
            draws = {name: _draw(name, value, random) for name, value in drawn.items()}
            point = {**dict(zip(grids, corner, strict=True)), **draws}
            points.append({name: point.get(name, value) for name, value in values.items()})
    return points


def _draw(name: str, value: Mapping[str, Any], random: np.random.Generator) -> Any:
    ((way, given),) = value.items()
    if not isinstance(given, list) or len(given) < 1 or (way in _BOUNDS and len(given) != 2):
        what = "two bounds" if way in _BOUNDS else "values"
        raise SweepError(f"{name}: {way} must be a list of {what}, got {got(given)}")
    if way == "choice":
        return given[int(random.integers(len(given)))]
    check = integer(-(2**53), 2**53) if way == "integers" else real(above=_BOUNDS[way])
    low, high = (check(bound, f"{name}: {way}") for bound in given)
    if not low <= high:
        raise SweepError(f"{name}: {way} must go from the lower bound to the higher, got {given}")
    if way == "integers":
        return int(random.integers(int(low), int(high), endpoint=True))
    if way == "uniform":
        return float(random.uniform(low, high))
    return math.exp(random.uniform(math.log(low), math.log(high)))
