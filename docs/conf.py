"""How Sphinx builds the site: ``make docs``."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from sphinx.application import Sphinx

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "docs" / "_ext"), str(ROOT), str(ROOT / "agents")]

from swim_env import __version__  # noqa: E402

project = "swim-env"
author = copyright = "the swim-env developers"
version = release = __version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "api",
    "mathml",
    "tables",
]
exclude_patterns = [
    "_ext",
    "_generated",
    # Raw tables of the studies: the reports link to them as files.
    "accuracy/*.md",
    "benchmark/*.md",
    "stability/*.md",
]
# A name between single backticks is a link where the API knows it (_ext/api.py).
default_role = "name"
nitpicky = True
suppress_warnings = ["myst.xref_missing.external"]

autodoc_typehints = "none"
autodoc_inherit_docstrings = False
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autosummary_generate = False
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False

myst_enable_extensions = ["attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_execution_show_tb = True
nb_output_stderr = "remove"
nb_render_markdown_format = "myst"


def link_files(app: Sphinx, page: str, source: list[str]) -> None:
    """Let pages link to raw tables and to the tests, Markdown that is no page of the site."""
    raw = r"\]\((\.\./(?:accuracy|benchmark|stability|\.\./tests)/[\w/]+\.md)\)"
    source[0] = re.sub(raw, r"](path:\1)", source[0])


def setup(app: Sphinx) -> None:
    """Connect what this file adds."""
    app.connect("source-read", link_files)


html_theme = "furo"
html_title = f"swim-env {version}"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False
