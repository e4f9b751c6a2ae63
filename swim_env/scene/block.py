"""The base of blocks of settings: frozen dataclasses whose annotations say how fields are checked.

Scenes and training configurations are made of such blocks. A field's check is in its annotation::

    @dataclass(frozen=True)
    class Damping(Block, path="damping"):
        retardation_time: Annotated[float, real("s", above=0.0)]
"""

from __future__ import annotations

import functools
from dataclasses import MISSING, dataclass, fields
from types import NoneType
from typing import Annotated, Any, ClassVar, TypeVar, get_args, get_origin, get_type_hints

from swim_env.errors import SceneError
from swim_env.scene.checks import Check, check_fields, scalar

_Block = TypeVar("_Block", bound="Block")


@dataclass(frozen=True)
class Block:
    """A block of settings that checks its fields when it is made.

    A field annotated with ``Annotated[type, check]`` is checked and stored in its final form; None
    passes where the type allows it. A subclass that overrides `__post_init__` calls this one, and
    checks there what concerns several fields at once.

    Parameters
    ----------
    path : str
        The block's dotted name, for messages; of the subclass, not of its instances.
    """

    _path: ClassVar[str] = ""

    def __init_subclass__(cls, path: str = "", **options: Any) -> None:
        """Keep the name."""
        super().__init_subclass__(**options)
        cls._path = path

    def __post_init__(self) -> None:
        """Check every field that has a check and store it in its final form."""
        prefix = f"{self._path}." if self._path else ""
        # mypy takes the class for an instance of it.
        for name, check, optional in _checks(type(self)):  # type: ignore[arg-type]
            value = scalar(getattr(self, name))
            if value is not None or not optional:
                self._store(**{name: check(value, prefix + name)})

    def _store(self, **values: object) -> None:
        """Store checked values; only for use in ``__post_init__``."""
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def to_plain(self) -> dict[str, Any]:
        """Return mappings, lists and scalars from which `build_block` makes the same block."""
        return {spec.name: plain(getattr(self, spec.name)) for spec in fields(self)}


@functools.cache
def _checks(cls: type[Block]) -> tuple[tuple[str, Check[Any], bool], ...]:
    """Return the name, the check and whether None is allowed of a block's annotated fields."""
    hints = get_type_hints(cls, include_extras=True)
    found = []
    for spec in fields(cls):
        hint = hints[spec.name]
        if get_origin(hint) is Annotated:
            kind, check = get_args(hint)[:2]
            found.append((spec.name, check, NoneType in get_args(kind)))
    return tuple(found)


def field_paths(cls: type[Block], path: str) -> list[str]:
    """Return the dotted paths of a block's fields, and of the fields of blocks in it."""
    hints = get_type_hints(cls)
    found = []
    for spec in fields(cls):
        found.append(f"{path}.{spec.name}")
        kind = hints[spec.name]
        if isinstance(kind, type) and issubclass(kind, Block):
            found += field_paths(kind, found[-1])
    return found


def block(cls: type[_Block]) -> Check[_Block]:
    """Return a check for a block, or a mapping from which it is made."""
    return functools.partial(build_block, cls)


def build_block(cls: type[_Block], value: object, field: str) -> _Block:
    """Make a block from a mapping of its fields (or return a block as it is).

    Raises
    ------
    SceneError
        If a field is unknown, missing, of the wrong type or out of range.
    """
    if isinstance(value, cls):
        return value
    specs = fields(cls)
    given = check_fields(value, field, [spec.name for spec in specs])
    for spec in specs:
        if spec.default is spec.default_factory is MISSING and spec.name not in given:
            raise SceneError(f"{field}.{spec.name} is missing")
    return cls(**given)


def plain(value: object) -> Any:
    """Return a block or a value inside one as mappings, lists and scalars fit for YAML."""
    if isinstance(value, Block):
        return value.to_plain()
    if isinstance(value, tuple):
        return [plain(item) for item in value]
    return value
