"""A fingerprint of the code that a kind of work hangs on, so that other code makes it anew."""

from __future__ import annotations

import ast
import functools
import hashlib
from pathlib import Path

# The same notion of what code is: without docstrings, comments and layout.
from studies.fingerprint import code_of

__all__ = ["code_digest"]

_ROOT = Path(__file__).parents[2]
#: Where each kind of work is done.
_BEGINS = {
    "run": "studies/paper/runs.py",
    "onset": "studies/paper/onset.py",
    "variant": "studies/paper/variants.py",
    "modes": "studies/paper/modes.py",
    "map": "studies/paper/maps.py",
}
#: Modules beside those of `studies.paper` that figures are made by.
_BESIDES = ("swim_env.analysis.kirchhoff", "swim_env.analysis.modes")
#: What starts and keeps the work, and has no part in the figures.
_PASSED_OVER = ("units",)


@functools.cache
def code_digest(kind: str, root: Path = _ROOT) -> str:
    """Return the fingerprint of a kind's module and of those that it imports from the study.

    The kernels have their own, `studies.stability.digest.kernel_digest`.

    Parameters
    ----------
    kind : str
        Of a `studies.paper.units.Unit`.
    root : Path
        The checkout.

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
        waiting += _imports(root / name)
    for name in sorted(seen):
        digest.update(name.encode())
        digest.update(code_of((root / name).read_text(encoding="utf-8")).encode())
    return digest.hexdigest()[:16]


def _imports(path: Path) -> list[str]:
    """Return the modules of the study that a module imports."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.ImportFrom) or node.module is None:
            continue
        folder, _, name = node.module.rpartition(".")
        if folder == "studies.paper" and name not in _PASSED_OVER:
            found.append(f"studies/paper/{name}.py")
        elif node.module in _BESIDES:
            found.append(f"{node.module.replace('.', '/')}.py")
    return found
