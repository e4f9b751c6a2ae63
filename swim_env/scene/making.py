"""Scenes out of mappings and files: their kind, their blocks, changes by dotted path, ``auto``."""

from __future__ import annotations

import functools
import os
from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from swim_env.errors import SceneError
from swim_env.scene.block import Block, build_block, field_paths, plain
from swim_env.scene.checks import check_fields, got, nearest, whole
from swim_env.scene.fluid import FLUID_TABLE, NO_FLUID
from swim_env.scene.library import read_scene_file

if TYPE_CHECKING:
    from swim_env.scene.scene import Scene

KINDS: dict[int, type[Scene]] = {}
"""The classes of scenes by their dimension; each enters itself."""

AUTO = "auto"
"""What some fields, and a scene's whole integrator, may be instead of a value."""

_TEXTS = ("name", "description")
#: Fields of an actuation that mean something to environments without a prescribed torque.
_WITHOUT_WAVE = {"torque_limit", "active_until", "axes"}
#: The integrator that learning needs, where a file leaves it to the body.
_LEARNING = {"scheme": "composed", "tolerance": 1e-4, "time_step": AUTO}
#: What a file that says nothing of them leaves to the body; and a fluid's panels per element and
#: an actuation's torque limit.
_LEFT_OUT = ("integrator.time_step", "episode.control_interval", "episode.duration")


def unresolved(cls: type[Scene], mapping: object) -> tuple[Scene, list[str]]:
    """Return a checked scene with placeholders for what is ``auto``, and the paths of that.

    Its class is the one of the mapping's dimension, which must be `cls` or based on it.
    """
    kind = cls
    if isinstance(mapping, Mapping):
        kind = _kind_of(cls, mapping.get("dimension", cls.dimension))
        for name, value in mapping.items():
            _check_meaning(kind, str(name))
            for key in value if isinstance(value, Mapping) else ():
                _check_meaning(kind, f"{name}.{key}")
    given = check_fields(mapping, "", ["dimension", *_TEXTS, *kind._blocks])
    given.pop("dimension", None)
    given, automatic = _without_auto(kind, given)
    for name, block in kind._blocks.items():
        if name in given:
            given[name] = _build(kind, name, block, given[name])
    return kind(**given), automatic


def _kind_of(cls: type[Scene], dimension: object) -> type[Scene]:
    """Return the class of scenes of a dimension."""
    allowed = {number: kind for number, kind in KINDS.items() if issubclass(kind, cls)}
    number = whole(dimension)
    if number not in allowed:
        shown = " or ".join(str(one) for one in allowed)
        raise SceneError(f"dimension must be {shown}, got {got(dimension)}")
    return allowed[number]


def _check_meaning(kind: type[Scene], path: str) -> None:
    """Refuse a field that only scenes of another dimension have."""
    if path not in _paths(kind.dimension) and any(path in _paths(one) for one in KINDS):
        raise elsewhere(kind, path)


@functools.cache
def _paths(dimension: int) -> list[str]:
    """Return the dotted paths of the blocks and fields of scenes of a dimension."""
    found = list(_TEXTS)
    for name, cls in KINDS[dimension]._blocks.items():
        found += [name, *field_paths(cls, name)]
    return found


def elsewhere(kind: type[Scene], path: str) -> SceneError:
    """Return the error of a field or block that only scenes of another dimension have."""
    others = [str(one) for one in KINDS if path in _paths(one)]
    return SceneError(
        f"{path} has no meaning in a scene of dimension {kind.dimension}, only in one of dimension "
        f"{' or '.join(others)}"
    )


def _known_path(kind: type[Scene], path: object) -> str:
    """Return a dotted path if it names a field or block of a scene."""
    known = _paths(kind.dimension)
    if path == "dimension":
        raise SceneError(
            "dimension cannot be changed, as the blocks of a scene of another dimension have other "
            "fields; load or make one of that dimension"
        )
    if path not in known:
        if any(path in _paths(one) for one in KINDS):
            raise elsewhere(kind, str(path))
        leaf = str(path).rpartition(".")[2]
        hint = nearest(str(path), known)
        same_leaf = [name for name in known if name.rpartition(".")[2] == leaf]
        if same_leaf:
            hint = f" (nearest: {same_leaf[0]})"
        blocks = ", ".join([*_TEXTS, *kind._blocks])
        raise SceneError(f"unknown field {path}{hint or f'; a scene has {blocks}'}")
    return str(path)


def _build(kind: type[Scene], name: str, cls: type[Block], value: object) -> object:
    """Make one block of a scene from its form in a file."""
    if not fields(cls):  # a block that is there or not
        if value is True:
            return cls()
        if value is None or value is False:
            raise SceneError(
                f"{name} must be {{}} or true, or left out to have none, got "
                + ("null" if value is None else "false")
            )
    if value is None and name in kind._optional:
        return None
    if name == "actuation" and isinstance(value, Mapping) and value:
        if value.keys() <= _WITHOUT_WAVE:
            value = {"amplitude": 0.0, **value}
    return build_block(cls, value, name)


# ---- changes -----------------------------------------------------------------------------------


def changed(
    kind: type[Scene], data: Mapping[str, Any], changes: Mapping[str, object]
) -> dict[str, Any]:
    """Return the fields of a scene with changes by dotted path."""
    data = dict(data)
    for key, new in changes.items():
        block, _, field = _known_path(kind, key).partition(".")
        if field:
            inner = {} if data.get(block) is None else data[block]
            if not isinstance(inner, Mapping):
                if inner == AUTO:
                    inner = _LEARNING
                else:
                    inner = plain(_build(kind, block, kind._blocks[block], inner))
            data[block] = _with(inner, field, new)
        elif new is None and block in kind._optional:
            data.pop(block, None)
        else:
            data[block] = new
    if changes.get("fluid.model") == NO_FLUID and "fluid.density" not in changes:
        data["fluid"].pop("density", None)
    return data


def _with(block: Mapping[str, Any], path: str, new: object) -> dict[str, Any]:
    """Return the fields of a block, one of which may be in a block inside it, with a new value."""
    name, _, rest = path.partition(".")
    if rest:
        inner = {} if block.get(name) is None else plain(block[name])
        if not isinstance(inner, Mapping):
            raise SceneError(f"{name} must be a mapping of fields, got {got(inner)}")
        new = _with(inner, rest, new)
    return {**block, name: new}


# ---- files, and what they leave to the body ----------------------------------------------------


def from_file(
    cls: type[Scene], path: str | os.PathLike[str], source: str, changes: Mapping[str, object]
) -> dict[str, Any]:
    """Return the fields of a file with changes; what it leaves out is left to the body.

    Errors of the file, without the changes, come first.
    """
    data = read_scene_file(path, source)
    try:
        plainly, _ = unresolved(cls, data)
        if changes:
            source = f"{source} with overrides"
            if plainly.has_period:  # changes are made to what is left to the body
                data = {"integrator": AUTO, **data}
            data = changed(type(plainly), data, changes)
            plainly, _ = unresolved(cls, data)
    except SceneError as error:
        raise error.located(source) from None
    if plainly.has_period:
        data = _left_to_the_body(data, changes, plainly)
    found: dict[str, Any] = data
    return found


def _left_to_the_body(
    data: Mapping[str, Any], changes: Mapping[str, object], scene: Scene
) -> dict[str, Any]:
    """Return the fields of a file, those of `scene`, with ``auto`` for what it leaves out.

    A block that is changed as a whole has its defaults, as in `Scene.replace`.
    """
    found = dict(data)
    if "integrator" not in found:
        found["integrator"] = AUTO
    paths = list(_LEFT_OUT)
    panels = "fluid.panels_per_element"
    if panels in scene._automatic and scene.fluid and FLUID_TABLE[scene.fluid.model].panels:
        paths.append(panels)
    if scene.actuation is not None:
        paths.append("actuation.torque_limit")
    for block, field in (path.split(".") for path in paths):
        inner = found.get(block) or {}
        if isinstance(inner, Mapping) and block not in changes:
            found[block] = {field: AUTO, **inner}
    return found


def _without_auto(kind: type[Scene], given: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Return the fields of a scene without those that are ``auto``, and the paths of these."""
    found = dict(given)
    automatic: list[str] = []
    integrator = found.get("integrator")
    if isinstance(integrator, str):
        if integrator != AUTO:
            raise SceneError(
                f"integrator must be a mapping of fields or {AUTO}, got {got(integrator)}"
            )
        found["integrator"] = _LEARNING
    for path in kind._automatic:
        block, field = path.split(".")
        inner = found.get(block)
        if isinstance(inner, Mapping) and isinstance(inner.get(field), str):
            if inner[field] != AUTO:
                number = "an integer" if field == "panels_per_element" else "a number"
                raise SceneError(f"{path} must be {number} or {AUTO}, got {got(inner[field])}")
            automatic.append(path)
            # A field without a default needs a number until it has its own.
            found[block] = {**inner, field: 4 if field == "panels_per_element" else 1.0}
    return found, automatic
