"""A fingerprint of the code that a kind of work hangs on, so that other code makes it anew."""

from __future__ import annotations

import ast
import functools
import hashlib
from pathlib import Path

# The same notion of what code is: without docstrings, comments and layout.
from swim_env.stability.digest import code_of

__all__ = ["code_digest"]

_PACKAGE = Path(__file__).parents[1]
#: Where each kind of work is done.
_BEGINS = {
    "run": "paper/runs.py",
    "onset": "paper/onset.py",
    "variant": "paper/variants.py",
    "modes": "paper/modes.py",
    "map": "paper/maps.py",
}
#: Modules beside those of `swim_env.paper` that figures are made by.
_BESIDES = ("kirchhoff",)
#: What starts and keeps the work, and has no part in the figures.
_PASSED_OVER = ("units",)


@functools.cache
def code_digest(kind: str, package: Path = _PACKAGE) -> str:
    """Return the fingerprint of a kind's module and of those that it imports from the study.

    The kernels have their own, `swim_env.stability.digest.kernel_digest`.

    Parameters
    ----------
    kind : str
        Of a `swim_env.paper.units.Unit`.
    package : Path
        The folder of `swim_env`.

    Returns
    -------
    str
        16 hexadecimal digits.
    """
    digest = hashlib.sha256()
    seen: set[str] = set()
    waiting = [_BEGINS[kind]]
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        waiting += _imports(package / name)
    for name in sorted(seen):
        digest.update(name.encode())
        digest.update(code_of((package / name).read_text(encoding="utf-8")).encode())
    return digest.hexdigest()[:16]


def _imports(path: Path) -> list[str]:
    """Return the modules of the study that a module imports."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.ImportFrom) or node.module is None:
            continue
        folder, _, name = node.module.removeprefix("swim_env.").rpartition(".")
        if folder == "paper" and name not in _PASSED_OVER:
            found.append(f"paper/{name}.py")
        elif not folder and name in _BESIDES:
            found.append(f"{name}.py")
    return found
