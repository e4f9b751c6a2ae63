"""A fingerprint of the code that stability was measured with: comments may change, code may not."""

from __future__ import annotations

import ast
import hashlib
from pathlib import Path

__all__ = ["code_of", "kernel_digest"]

_PACKAGE = Path(__file__).parents[2] / "swim_env"
#: Files of the kernels' folder that no step calls.
_PASSED_OVER = ("loading.py",)
#: Files beside the kernels' that decide what a step computes.
_BESIDES = ("sim/batch.py",)


def kernel_digest() -> str:
    """Return the fingerprint of the kernels' sources, docstrings, comments and layout left out."""
    digest = hashlib.sha256()
    kernels = sorted((_PACKAGE / "physics").rglob("*.py"))
    files = [path for path in kernels if path.name not in _PASSED_OVER]
    for path in [*files, *(_PACKAGE / name for name in _BESIDES)]:
        digest.update(path.name.encode())
        digest.update(code_of(path.read_text(encoding="utf-8")).encode())
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
