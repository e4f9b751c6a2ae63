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
from swim_agents.policies import PRETRAINED_FOLDER, pretrained_names

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


def starts(record: dict[str, Any]) -> str:
    """Return the sentence that says which starts the figures of a record are of."""
    seeds, one = record["seeds"], len(record["seeds"]) == 1
    which = f"one start (seed {seeds[0]})" if one else ""
    which = which or f"{len(seeds)} starts (seeds {seeds[0]} to {seeds[-1]})"
    return f"{which}, {record['duration']:g} s; no training draws these seeds."


def record_of(agent: str) -> dict[str, Any]:
    """Return what a shipped agent's own record says."""
    file = PRETRAINED_FOLDER / agent / "scores.json"
    record: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return record


def scores() -> str:
    """Return what the shipped policies reach in the plane, from the stored comparison."""
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
    return f"Medians over {starts(stored)}\n\n" + table(head, rows)


def scores_in_space() -> str:
    """Return how far the shipped agents swim in space, from their own records."""
    rows, seen = [], set()
    for name in pretrained_names():
        record = record_of(name)
        if record["task"] != "forward" or load_scene(record["scene"]).dimension != 3:
            continue
        verified, middle = record["verified"], record["median"]
        seen.add(f"Figures of {starts(record)}")
        rows.append(
            [f"`{name}`", f"`{record['scene']}`", f"{middle['net_displacement']:.2f}"]
            + [f"{middle['closed_displacement']:.2f}", f"{record['ratio_to_tuned_wave']:.2f}"]
            + [f"{sum(verified)} of {len(verified)}"]
        )
    head = ["agent", "scene", "score (BL)", "recomputed finer (BL)", "times the tuned wave"]
    (lead,) = seen
    return f"{lead}\n\n" + table([*head, "verified"], rows)


def targets(agent: str) -> str:
    """Return how many targets a shipped agent reaches, from its own record."""
    record = record_of(agent)
    reached, finer = sum(record["success"]), sum(record["closed_success"])
    count = len(record["seeds"])
    text = f"`{agent}` reaches {reached} of {count} targets, {finer} in the finer computation"
    return f"{text}; {starts(record)}\n"


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
    texts |= {"scores.md": scores(), "scores_3d.md": scores_in_space(), "ends.md": ends()}
    texts |= {f"scores_{name}.md": targets(f"ppo_{name}") for name in ("target", "target_3d")}
    texts |= {"scenes.md": scenes(), "commands.md": commands()}
    for name, text in texts.items():
        file = folder / name
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the tables before the sources are listed."""
    app.connect("builder-inited", write_tables, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
