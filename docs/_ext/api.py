"""Pages of the API: one for every public name, written from ``__all__`` before the site is read.

A name that several modules offer has its page where most users import it, the first module of
MODULES; the others link to it.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
import textwrap
from pathlib import Path
from types import ModuleType
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer
from sphinx.roles import XRefRole
from sphinx.util.nodes import make_refnode

#: Modules with pages, by title of their group. A tuple names what is public in a module without
#: ``__all__``.
GROUPS: dict[str, dict[str, tuple[str, ...]]] = {
    "Environments, scenes and simulation": {
        "swim_env": (),
        "swim_env.scene": (),
        "swim_env.envs.spatial": (
            *("SwimEnv3D", "SwimTargetEnv3D", "SwimVectorEnv3D", "SwimTargetVectorEnv3D"),
        ),
        "swim_env.envs.tasks": (),
        "swim_env.physics": (),
    },
    "Gradients": {"swim_env.gradients": (), "swim_env.gradients.objectives": ("objective_of",)},
    "Analysis, accuracy, pictures and recordings": {
        "swim_env.accuracy": (),
        "swim_env.analysis.body_surface": (),
        "swim_env.analysis.characteristics": (),
        "swim_env.analysis.continuous": (),
        "swim_env.analysis.energy": (),
        "swim_env.analysis.flow": (),
        "swim_env.analysis.modes": (),
        "swim_env.analysis.pose": (),
        "swim_env.analysis.spatial_energy": (),
        "swim_env.analysis.spatial_flow": (),
        "swim_env.plots": (),
        "swim_env.recording": (),
    },
    "Policies, training and comparison": {
        "swim_agents": (),
        "swim_agents.baselines": (),
        "swim_agents.policies": (),
        "swim_agents.rollout": (),
        "swim_agents.verification": (),
        "swim_agents.tuned_wave": (),
        "swim_agents.tuning": (),
        "swim_agents.optimal_gait": (),
        "swim_agents.optimising": (),
        "swim_agents.fit": (),
        "swim_agents.replay": (),
        "swim_agents.vec_env": (),
        "swim_agents.rllib": (),
        "swim_agents.files": (),
        "swim_agents.commands.main": (),
        "swim_agents.comparison.contest": ("Contest", "Entry", "entries_of", "hold_contest"),
        "swim_agents.comparison.gait": (
            *("Gait", "OrthogonalModes", "WaveFit", "analyse_gait", "dominant_frequency"),
            *("fit_wave", "orthogonal_modes", "phase_lags"),
        ),
        "swim_agents.comparison.performance": (),
        "swim_agents.comparison.report": (),
        "swim_agents.comparison.spatial_gait": (),
        "swim_agents.learning.config": (
            *("ConfigError", "TrainingConfig", "config_names", "load_config"),
        ),
        "swim_agents.learning.settings": (
            *("Evaluations", "Network", "PPOSettings", "SACSettings"),
        ),
        "swim_agents.learning.trainer": (),
        "swim_agents.learning.environment": (),
        "swim_agents.learning.checkpoints": (),
        "swim_agents.learning.logs": (),
        "swim_agents.learning.saved": ("AgentError", "AgentPolicy", "load_agent", "save_agent"),
        "swim_agents.learning.shipping": (),
    },
}
MODULES = {name: given for group in GROUPS.values() for name, given in group.items()}
#: Packages whose ``__init__`` says what is public of all their modules, or that are internal.
COVERED = (
    *("swim_env.plots", "swim_env.recording", "swim_env.accuracy", "swim_env.envs.geometry"),
    "swim_env.envs.render",
)
#: Docstrings of environments are Markdown, as Gymnasium's are.
MARKDOWN = re.compile(r"^## ", re.MULTILINE)


def public_modules() -> set[str]:
    """Return every module that says what is public in it, except those that COVERED speaks for."""
    found = set()
    for top in ("swim_env", "swim_agents"):
        package = importlib.import_module(top)
        for one in (top, *(m.name for m in pkgutil.walk_packages(package.__path__, f"{top}."))):
            covered = any(one.startswith(f"{package}.") for package in COVERED)
            covered |= one == "swim_env.envs.geometry"
            if not covered and hasattr(importlib.import_module(one), "__all__"):
                found.add(one)
    return found


def names_of(module: ModuleType) -> list[str]:
    """Return the public names of a module, classes and functions before constants."""
    names = MODULES[module.__name__] or module.__all__
    kinds = {name: getattr(module, name) for name in names if name != "__version__"}
    return sorted(kinds, key=lambda name: (kind_of(kinds[name]) == "data", name.lower()))


def kind_of(thing: Any) -> str:
    """Return what Sphinx calls a thing."""
    if inspect.isclass(thing):
        return "exception" if issubclass(thing, BaseException) else "class"
    return "function" if inspect.isroutine(thing) else "data"


def constant(module: str, name: str) -> str:
    """Return what the source says of a constant, beside or above it, wherever it is defined."""
    while True:
        found = ModuleAnalyzer.for_module(module).find_attr_docs().get(("", name))
        if found:
            return "\n".join(found)
        source = inspect.getsource(importlib.import_module(module))
        origin = re.search(rf"from (\S+) import (?:\([^)]*|[^(\n]*)\b{name}\b", source)
        if origin is None:
            return ""
        module = origin[1]


def page_of(module: str, name: str, thing: Any) -> tuple[str, str]:
    """Return the ending and the text of a name's page."""
    kind, full = kind_of(thing), f"{module}.{name}"
    title = f"{name}\n{'=' * len(name)}\n\n`{module} <{module}.html>`__\n\n"
    if kind == "data":
        value = textwrap.shorten(repr(thing), 400, placeholder=" ...")
        body = textwrap.indent(f"{constant(module, name)}\n\nValue: ``{value}``", "   ")
        return "rst", f":orphan:\n\n{title}.. py:data:: {full}\n\n{body}\n"
    options = "\n   :members:\n   :exclude-members: np_random\n   :inherited-members: {}".format(
        "Env,VectorEnv,VecEnv,Wrapper,VectorWrapper,Exception,tuple,dict,Generic,Protocol,object"
    )
    directive = f".. auto{kind}:: {full}{options if kind == 'class' else ''}\n"
    text = inspect.getdoc(thing) or ""
    if not MARKDOWN.search(text):
        return "rst", f":orphan:\n\n{title}{directive}"
    prose = re.split(r"\n(?=[A-Z]\w+\n---)", text)[0]
    return (
        "md",
        f"---\norphan: true\n---\n\n# {name}\n\n{prose}\n\n```{{eval-rst}}\n{directive}```\n",
    )


def write_pages(app: Sphinx) -> None:
    """Write the pages of the API; what has not changed keeps its time."""
    missing = public_modules() - MODULES.keys()
    if missing:
        raise RuntimeError(f"docs/_ext/api.py must name the public modules {', '.join(missing)}")
    folder = Path(app.srcdir) / "reference" / "api"
    pages, home = {}, {}
    index = ["# API", "", "Every public name has a page, made from its docstring."]
    for title, modules in GROUPS.items():
        index += ["", f"## {title}", "", "| module | what it holds |", "|---|---|"]
        for name in modules:
            module = importlib.import_module(name)
            summary = (module.__doc__ or "").split("\n\n")[0].replace("\n", " ")
            index.append(f"| [{name}]({name}.md) | {summary} |")
            rows = []
            for public in names_of(module):
                thing = getattr(module, public)
                key = id(thing) if kind_of(thing) != "data" else (id(thing), public)
                if key not in home:
                    home[key] = f"{name}.{public}"
                    ending, text = page_of(name, public, thing)
                    pages[f"{home[key]}.{ending}"] = text
                rows.append(
                    f"* - {{doc}}`{public} <{home[key]}>`\n  - {summary_of(thing, name, public)}"
                )
            body = "\n".join(rows)
            pages[f"{name}.md"] = (
                f"# {name}\n\n```{{py:module}} {name}\n```\n\n{summary}\n\n"
                f"```{{list-table}}\n:widths: 35 65\n\n{body}\n```\n"
            )
        index += ["", "```{toctree}", ":hidden:", "", *modules, "```"]
    pages["index.md"] = "\n".join([*index, ""])
    folder.mkdir(parents=True, exist_ok=True)
    for file in folder.iterdir():
        if file.name not in pages:
            file.unlink()
    for file_name, text in pages.items():
        file = folder / file_name
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")


def summary_of(thing: Any, module: str, name: str) -> str:
    """Return the first sentence on a name, for a table."""
    text = constant(module, name) if kind_of(thing) == "data" else inspect.getdoc(thing) or ""
    first = text.strip().split("\n\n")[0].replace("\n", " ")
    return re.split(r"(?<=[a-z)\]`])\. ", first)[0].rstrip(".").replace("``", "`")


def shorten(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Drop the Markdown of a docstring, which its page shows; keep bars as they are."""
    text = "\n".join(lines)
    if what == "class" and MARKDOWN.search(text):
        parts = re.split(r"\n(?=[A-Z]\w+\n---)", text, maxsplit=1)
        lines[:] = parts[1].split("\n") if len(parts) == 2 else []
    # Bars are absolute values here, and would be names of substitutions.
    parts = "\n".join(lines).split("``")
    parts[::2] = [part.replace("|", r"\|") for part in parts[::2]]
    lines[:] = "``".join(parts).split("\n")


class Name(XRefRole):
    """What is between single backticks: a link where the API knows it, else as it is."""

    def __init__(self) -> None:
        super().__init__(innernodeclass=nodes.literal)

    def process_link(
        self, env: Any, refnode: nodes.Element, explicit: bool, title: str, target: str
    ) -> tuple[str, str]:
        """Let `find_name` look it up."""
        refnode["refdomain"], refnode["reftype"] = "", "name"
        return title, target.rstrip("()")


def find_name(app: Sphinx, env: Any, node: nodes.Element, content: nodes.Element) -> nodes.Node:
    """Return a link to the one name of the API that ends like this, or the text alone."""
    if node.get("reftype") != "name":
        return None  # type: ignore[return-value]
    target, known = node["reftarget"], env.domaindata["py"]["objects"]
    found = [target] if target in known else [n for n in known if n.endswith(f".{target}")]
    if len(found) > 1:  # rather the class than an attribute of its name
        found = [name for name in found if known[name].objtype in ("class", "function")]
    if len(found) != 1:
        return content
    entry = known[found[0]]
    builder = app.builder
    return make_refnode(builder, node["refdoc"], entry.docname, entry.node_id, content)


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages before the sources are listed."""
    app.add_role("name", Name())
    app.connect("missing-reference", find_name)
    app.connect("builder-inited", write_pages, priority=100)
    app.connect("autodoc-process-docstring", shorten, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
