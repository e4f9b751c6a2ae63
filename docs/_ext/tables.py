"""Tables of what the code and the stored results know, written before the site is read.

Pages take them in from ``docs/_generated``, so that no figure is typed twice.
"""

from __future__ import annotations

import argparse
import importlib
import json
from pathlib import Path
from statistics import median
from typing import Any

import gymnasium
from sphinx.application import Sphinx
from swim_agents.commands.main import COMMANDS

from swim_env import load_scene, scene_names
from swim_env.envs.registration import FORWARD_3D_ID, FORWARD_ID, TARGET_3D_ID, TARGET_ID
from swim_env.envs.tasks.layout import layout_of
from swim_env.physics.status import TERMINATION_REASONS, describe

ROOT = Path(__file__).resolve().parents[2]
PAGES = {
    "forward": FORWARD_ID,
    "target": TARGET_ID,
    "forward_3d": FORWARD_3D_ID,
    "target_3d": TARGET_3D_ID,
}


def table(head: list[str], rows: list[list[str]]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines) + "\n"


def at_a_glance(name: str) -> str:
    """Return the sizes of an environment with its usual scene, and what it observes."""
    env: Any = gymnasium.make(name).unwrapped
    scene, episode = env.scene, env.scene.episode
    parts, first, rows = layout_of(env.task).parts, 0, []
    for part, size in parts.items():
        rows.append([f"{first} … {first + size - 1}" if size > 1 else str(first), f"`{part}`"])
        first += size
    actions = round(episode.duration / episode.control_interval)
    glance = [
        ["usual scene", f"`{scene.name}`, {scene.beam.elements} elements"],
        ["actions", f"`{env.action_space}`"],
        ["observations", f"`Box(({first},), float32)`"],
        ["an action lasts", f"{episode.control_interval:g} s"],
        ["time limit", f"{episode.duration:g} s, {actions} actions"],
    ]
    title = f"\nWhat is observed, on `{scene.name}`:\n\n"
    return table(["", f"`{name}`"], glance) + title + table(["index", "part"], rows)


def scores() -> str:
    """Return what the shipped policies reach, from the stored comparison."""
    stored = json.loads((ROOT / "docs/comparison/comparison.json").read_text(encoding="utf-8"))
    rows = []
    for name, figures in stored["policies"].items():
        fine, verified = figures["closed_displacement"], figures["verified"]
        score = median(figures["net_displacement"])
        ratio = stored["ratios"][name]["tuned_wave"]
        rows.append(
            [f"`{name}`", f"{score:.2f}", f"{median(fine):.2f}", f"{ratio:.2f}"]
            + [f"{sum(verified)} of {len(verified)}"]
        )
    head = ["policy", "score (BL)", "recomputed finer (BL)", "times the tuned wave", "verified"]
    return table(head, rows)


def ends() -> str:
    """Return the physical reasons why a run can end."""
    rows = [
        [f"[`{reason}`](#{reason})", str(code), describe(reason).split(";")[0]]
        for code, reason in TERMINATION_REASONS.items()
        if reason
    ]
    return table(["reason", "code", "what happened"], rows)


def scenes() -> str:
    """Return the shipped scenes with their descriptions."""
    rows = []
    for name in scene_names():
        scene = load_scene(name)
        rows.append([f"`{name}`", str(scene.dimension), " ".join(scene.description.split())])
    return table(["scene", "dimensions", "what it is"], rows)


def commands() -> str:
    """Return the help of every subcommand."""
    parts = []
    for name, about in COMMANDS.items():
        module = importlib.import_module(f"swim_agents.commands.{name.replace('-', '_')}")
        parser = argparse.ArgumentParser(prog=f"swim-env {name}", description=module.__doc__)
        parser.formatter_class = lambda prog: argparse.HelpFormatter(prog, width=96)
        module.add_arguments(parser)
        parts.append(f"## {name}\n\n{about.capitalize()}.\n\n```text\n{parser.format_help()}```\n")
    return "\n".join(parts)


def write_tables(app: Sphinx) -> None:
    """Write every table into the folder that pages include them from."""
    folder = Path(app.srcdir) / "_generated"
    folder.mkdir(exist_ok=True)
    texts = {f"{page}.md": at_a_glance(name) for page, name in PAGES.items()}
    texts |= {"scores.md": scores(), "ends.md": ends()}
    texts |= {"scenes.md": scenes(), "commands.md": commands()}
    for name, text in texts.items():
        file = folder / name
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the tables before the sources are listed."""
    app.connect("builder-inited", write_tables, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
