r"""Formulas as MathML, which browsers draw by themselves: no script, no server, no font to load.

docutils converts them when the site is built, so a formula that is not valid is a warning, and with
``-W`` an error. ``\tag{7}`` puts a number beside a displayed formula.
"""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from docutils.utils.math import MathError, latex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging

LOG = logging.getLogger(__name__)
TAG = re.compile(r"\\tag\{([^}]*)\}")


def convert(node: nodes.Element, displayed: bool) -> str:
    """Return a formula as MathML; a warning, and the formula's text, where it is not valid."""
    text = TAG.sub("", node.astext()).strip()
    if displayed and r"\\" in text and r"\begin" not in text:
        text = rf"\begin{{aligned}}{text}\end{{aligned}}"
    try:
        return str(latex2mathml.tex2mathml(text, as_block=displayed))
    except MathError as error:
        LOG.warning("cannot convert the formula %r: %s", text, error, location=node)
        return f"<code>{nodes.unescape(text)}</code>"


def visit_inline(visitor: Any, node: nodes.math) -> None:
    """Write a formula in a line."""
    visitor.body.append(convert(node, displayed=False))
    raise nodes.SkipNode


def visit_displayed(visitor: Any, node: nodes.math_block) -> None:
    """Write a displayed formula, with its number where it has one."""
    number = TAG.search(node.astext())
    label = f'<span class="equation-number">({number[1]})</span>' if number else ""
    visitor.body.append(f'<div class="equation">{convert(node, displayed=True)}{label}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Make this the way in which HTML shows formulas."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_displayed, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
