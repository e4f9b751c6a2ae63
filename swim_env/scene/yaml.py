"""YAML text to plain values and back, dotted overrides, atomic text files.

Only safe YAML is read. Numbers follow YAML 1.2 (so ``1e-3`` is a number, ``010`` is ten, and
``yes`` is text), and a key given twice is an error.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import yaml

from swim_env.errors import SceneError
from swim_env.files.atomic import write_atomically
from swim_env.scene.checks import got

_FLOAT = re.compile(
    r"^[-+]?(?:(?:\.[0-9]+|[0-9]+\.[0-9]*)(?:[eE][-+]?[0-9]+)?|[0-9]+[eE][-+]?[0-9]+"
    r"|\.(?:inf|Inf|INF))$|^\.(?:nan|NaN|NAN)$"
)
_INT = re.compile(r"^[-+]?[0-9]+$")
_BOOL = re.compile(r"^(?:true|True|TRUE|false|False|FALSE)$")
_NULL = re.compile(r"^(?:~|null|Null|NULL|)$")


class _Loader(yaml.SafeLoader):
    """Safe loader with the scalars of YAML 1.2 and without repeated keys."""

    yaml_implicit_resolvers = {}  # filled below, shared with no other loader

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[object, object]:
        seen: set[object] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                raise yaml.constructor.ConstructorError(
                    None, None, "a field's name must be text", key_node.start_mark
                )
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"field '{key}' is given twice", key_node.start_mark
                )
            seen.add(key)
        return super().construct_mapping(node, deep=deep)

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Leave ``<<`` alone: it is a field's name like any other, and an unknown one."""


def _integer(loader: _Loader, node: yaml.ScalarNode) -> int:
    try:
        return int(loader.construct_scalar(node))
    except ValueError:  # Python refuses to convert more than 4300 digits
        raise yaml.constructor.ConstructorError(
            None, None, "an integer is too long to read", node.start_mark
        ) from None


_Loader.add_implicit_resolver("tag:yaml.org,2002:null", _NULL, ["~", "n", "N", ""])
_Loader.add_implicit_resolver("tag:yaml.org,2002:bool", _BOOL, list("tTfF"))
_Loader.add_implicit_resolver("tag:yaml.org,2002:int", _INT, list("-+0123456789"))
_Loader.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+.0123456789"))
_Loader.add_constructor("tag:yaml.org,2002:int", _integer)


class _Dumper(yaml.SafeDumper):
    """Safe dumper that quotes every text which the loader above would read as a number."""

    def ignore_aliases(self, data: object) -> bool:
        return True


_Dumper.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+.0123456789"))
_Dumper.add_implicit_resolver("tag:yaml.org,2002:int", _INT, list("-+0123456789"))


def _one_line(error: yaml.YAMLError) -> str:
    """Say in one line what the YAML reader objected to, and where."""
    if isinstance(error, yaml.MarkedYAMLError):
        mark = error.problem_mark or error.context_mark
        text = error.problem or error.context or "it cannot be read"
        text = " ".join(text.split())
        return f"line {mark.line + 1}: {text}" if mark is not None else text
    if isinstance(error, yaml.reader.ReaderError):
        return f"character {error.position + 1} is not allowed in YAML"
    return " ".join(str(error).split())


def parse_yaml(text: str, source: str | None = None) -> object:
    """Read one YAML document into mappings, lists, numbers, text, booleans and None.

    Raises
    ------
    SceneError
        If the text is not valid YAML or gives a key twice; the message has the line and the source.
    """
    try:
        return yaml.load(text, Loader=_Loader)  # a subclass of SafeLoader
    except yaml.YAMLError as error:
        raise SceneError(f"not valid YAML, {_one_line(error)}", source) from None
    except RecursionError:
        raise SceneError("not valid YAML: nested too deeply", source) from None
    except (ValueError, KeyError, AttributeError, TypeError):  # as for "!!float x"
        raise SceneError("not valid YAML: a tag (!!) does not fit its value", source) from None


def dump_yaml(data: Mapping[str, object]) -> str:
    """Write a mapping of plain values as YAML, in the order given, numbers at full precision."""
    text = yaml.dump(
        dict(data),
        Dumper=_Dumper,
        sort_keys=False,
        default_flow_style=None,
        allow_unicode=True,
        width=96,
    )
    return str(text)


def read_text(path: str | os.PathLike[str], source: str) -> str:
    """Read a UTF-8 text file, which messages call `source`.

    Raises
    ------
    SceneError
        If the file is missing, is a folder, or cannot be read as UTF-8.
    """
    try:
        return Path(path).read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        problem = f"the file must be UTF-8 text, byte {error.start} is not"
        raise SceneError(problem, source) from None
    except ValueError:  # a null character in the path
        raise SceneError("the file's name is not valid", repr(source)) from None
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise SceneError(f"cannot read the scene file: {reason}", source) from None


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a UTF-8 text file whole or not at all; an existing file is replaced.

    Raises
    ------
    SceneError
        If the file cannot be written; an existing one is untouched.
    """
    try:
        write_atomically(path, lambda file: file.write(text.encode("utf-8")))
    except ValueError:  # a null character in the path
        raise SceneError("the file's name is not valid", repr(os.fspath(path))) from None
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise SceneError(f"cannot write the scene file: {reason}", os.fspath(path)) from None


def parse_overrides(
    overrides: str | Iterable[str] | Mapping[str, object],
) -> dict[str, object]:
    """Turn ``block.field=value`` texts into a mapping from dotted path to value.

    Each value is read as YAML, so ``1e-3``, ``[1, 2]``, ``null`` and ``{until: 0.5, value: 1}``
    mean what they mean in a file. The last of several texts for the same path counts. A mapping is
    copied as it is.

    Raises
    ------
    SceneError
        If they are neither texts nor a mapping, or a text has no ``=``, no path, or a value that is
        not YAML.
    """
    if isinstance(overrides, Mapping):
        return dict(overrides)
    if not isinstance(overrides, Iterable):
        raise SceneError(
            f"overrides must be texts like beam.elements=27 or a mapping, got {got(overrides)}"
        )
    found: dict[str, object] = {}
    texts: Iterable[object] = [overrides] if isinstance(overrides, str) else overrides
    for text in texts:
        if not isinstance(text, str) or "=" not in text or not text.split("=", 1)[0].strip():
            raise SceneError(
                f"override {text!r} must read block.field=value, as in beam.elements=27"
            )
        path, value = (part.strip() for part in text.split("=", 1))
        try:
            parsed = parse_yaml(value)
        except SceneError as error:
            raise SceneError(f"override {text!r}: {error.problem}") from None
        found.pop(path, None)
        found[path] = parsed
    return found
