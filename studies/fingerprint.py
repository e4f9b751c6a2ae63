"""Fingerprints of code and of settings: comments may change, code may not.

Stored results carry a fingerprint of what decides them. Where it differs from that of the present
code, the results are computed anew.
"""

from __future__ import annotations

import ast
import functools
import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path

__all__ = ["code_of", "files_digest", "kernel_digest", "text_digest", "with_imports"]

#: The checkout.
ROOT = Path(__file__).parents[1]
#: Files among the kernels' that no step calls.
_NO_KERNELS = ("loading.py",)


def text_digest(*texts: str) -> str:
    """Return the fingerprint of texts: 16 hexadecimal digits."""
    digest = hashlib.sha256()
    for text in texts:
        digest.update(text.encode())
    return digest.hexdigest()[:16]


def code_of(source: str) -> str:
    """Return a program's text without docstrings, comments and layout."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if not isinstance(body, list) or not body:
            continue
        first = body[0]
        if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
            node.body = body[1:] or [ast.Pass()]  # type: ignore[attr-defined]
    return ast.unparse(tree)


def files_digest(files: Iterable[Path], root: Path = ROOT) -> str:
    """Return the fingerprint of the code in Python files and of their places below a folder."""
    texts: list[str] = []
    for place, path in sorted((path.relative_to(root).as_posix(), path) for path in files):
        texts += [place, code_of(path.read_text(encoding="utf-8"))]
    return text_digest(*texts)


@functools.cache
def kernel_digest(root: Path = ROOT) -> str:
    """Return the fingerprint of all code of a checkout that decides what a step computes.

    That is everything in ``swim_env/physics``, at any depth, and the batch that calls it.
    """
    kernels = (root / "swim_env" / "physics").rglob("*.py")
    files = [path for path in kernels if path.name not in _NO_KERNELS]
    return files_digest([*files, root / "swim_env" / "sim" / "batch.py"], root)


def with_imports(
    module: str, follow: Sequence[str], leave: Sequence[str] = (), root: Path = ROOT
) -> set[Path]:
    """Return a module's file and those of the modules that it imports, directly or not.

    Parameters
    ----------
    module : str
        Its dotted name.
    follow, leave : sequence of str
        Packages and modules whose imports count, and those among them that do not.
    root : Path
        The checkout.
    """
    found: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        path = root / f"{name.replace('.', '/')}.py"
        wanted = _is_within(name, follow) and not _is_within(name, leave)
        if name in found or not (wanted or name == module) or not path.is_file():
            continue
        found[name] = path
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            # Names that are imported may be modules or not.
            if isinstance(node, ast.Import):
                waiting += [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module is not None:
                waiting += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return set(found.values())


def _is_within(name: str, packages: Sequence[str]) -> bool:
    return any(name == one or name.startswith(f"{one}.") for one in packages)
