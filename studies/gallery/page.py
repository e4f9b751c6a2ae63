"""The gallery's pictures, and the page that shows them: the words of ``page.md``, filled in."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swim_agents.comparison.performance import measure_gait
from swim_agents.tables import markdown_table

from studies.gallery.pictures import draw_learning, draw_pareto
from studies.gallery.runs import (
    FULL,
    PAPER_SCENES,
    TARGET,
    Episode,
    Plan,
    Progress,
    Runs,
    play_all,
    stored_curves,
)
from studies.store import page_of
from swim_env import plots
from swim_env.envs.tasks import TARGET_RADIUS
from swim_env.errors import SwimError
from swim_env.files.atomic import write_atomically
from swim_env.files.folders import check_folder, write_folder
from swim_env.files.provenance import where_and_when

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: The wave and the agent whose energy budgets are shown.
_BUDGETS = ("tuned_wave", "ppo_forward")

#: The page, with fields. A paragraph is left out where one of its fields is None.
_PAGE = Path(__file__).with_name("page.md").read_text(encoding="utf-8")

#: What the folder holds: the pictures of the page, and the figures.
GALLERY_FILES = (*re.findall(r"{folder}/(.+)\)", _PAGE), "gallery.json")


def check_gallery(folder: str | os.PathLike[str]) -> None:
    """Refuse a folder that holds anything but an earlier gallery, and a page that is a folder."""
    check_folder(folder, GALLERY_FILES)
    page = page_of(folder)
    if page.is_dir():
        raise SwimError(f"the page goes into a file, this is a folder ({page})")


def make_gallery(
    folder: str | os.PathLike[str], plan: Plan, command: str, progress: Progress
) -> dict[str, Any]:
    """Play everything, draw it, and write pictures and page, all of them or none.

    Pictures and ``gallery.json`` go into the folder, the page beside it, with its name. It says
    what command made it.

    Returns
    -------
    dict
        ``command``, ``scene``, ``seed``, ``duration`` and ``paper_duration`` (s), ``strengths``;
        the scene's ``energy_tolerance``; ``policies`` with, for each strength,
        ``net_displacement`` and ``fine_displacement`` (BL), ``verified``, ``positive_work`` (J),
        ``energy_drift``; ``target`` and ``paper`` with the figures of these runs; ``pictures`` with
        their sizes (bytes); machine, versions and commit.
    """
    check_gallery(folder)
    runs = play_all(plan, progress)
    figures = _draw(runs)
    record = _record(runs, command)

    def write(ready: Path) -> None:
        for name, figure in figures.items():
            plots.save_figure(figure, ready / name)
            record["pictures"][name] = (ready / name).stat().st_size
        text = json.dumps(record, indent=1, allow_nan=False)
        (ready / "gallery.json").write_text(text + "\n", encoding="utf-8")

    write_folder(folder, GALLERY_FILES, write)
    page = page_of(folder)
    text = _page(record, page.stem)
    write_atomically(page, lambda file: file.write(text.encode("utf-8")))
    return record


def _draw(runs: Runs) -> dict[str, Figure]:
    """Draw all pictures, by their files."""
    episodes, strengths = runs.forward, runs.strengths.items()
    full = {name: episode.trajectory for name, episode in episodes.items()}
    gaits = {name: measure_gait(one.rollout, one.trajectory) for name, one in episodes.items()}
    target, wave = runs.target.rollout, episodes["tuned_wave"].rollout
    radius = TARGET_RADIUS * target.scene.beam.length
    return {
        "paths.png": plots.draw_paths(full),
        "path_ppo_forward.png": plots.draw_path(full["ppo_forward"], 9, "ppo_forward"),
        "path_ppo_target.png": plots.draw_path(
            runs.target.trajectory, name=TARGET, target=target.goal, radius=radius
        ),
        **{f"path_{name}.png": plots.draw_path(runs.paper[name], 11) for name in PAPER_SCENES},
        "kymograph.png": plots.draw_kymographs(full),
        "torques.png": plots.draw_torques(full),
        "gaits.png": plots.draw_gaits(
            full, {name: gait and gait.to_dict() for name, gait in gaits.items()}
        ),
        "energy.png": plots.draw_energy(
            {name: full[name] for name in _BUDGETS},
            {name: episodes[name].rollout.velocity for name in _BUDGETS},
        ),
        "pareto.png": draw_pareto(
            {name: [one.trajectory for one in some] for name, some in strengths},
            {name: [bool(one.verified) for one in some] for name, some in strengths},
        ),
        "training.png": draw_learning(*stored_curves(), ("tuned_wave", wave.net_displacement)),
    }


def _record(runs: Runs, command: str) -> dict[str, Any]:
    plan, target = runs.plan, runs.target.rollout
    return {
        "command": command,
        "scene": target.scene.name,
        "seed": plan.seed,
        "duration": target.scene.episode.duration,
        "paper_duration": plan.paper_duration,
        "strengths": list(plan.strengths),
        "policies": {
            name: [_figures(*one) for one in zip(plan.strengths, episodes, strict=True)]
            for name, episodes in runs.strengths.items()
        },
        "energy_tolerance": target.scene.integrator.energy_tolerance,
        "target": {
            "policy": TARGET,
            "reached": bool(target.info.get("success", False)),
            "duration": runs.target.trajectory.duration,
            "net_displacement": target.net_displacement,
        },
        "paper": {name: run.summary() for name, run in runs.paper.items()},
        "pictures": {},
        **where_and_when(),
    }


def _figures(strength: float, episode: Episode) -> dict[str, Any]:
    return {
        "strength": strength,
        "net_displacement": episode.rollout.net_displacement,
        "fine_displacement": episode.fine_displacement,
        "verified": episode.verified,
        "positive_work": float(episode.trajectory.positive_work.sum()),
        "energy_drift": episode.trajectory.energy_drift,
    }


def _page(record: Mapping[str, Any], folder: str) -> str:
    """Return the page, in Markdown."""
    commit, tolerance = record["commit"] or "unknown", record["energy_tolerance"]
    last = {f"`{name}`": rows[-1] for name, rows in record["policies"].items()}
    rows = [
        {
            "policy at full strength": name,
            "positive work": f"{row['positive_work']:.3g} J",
            "energy not explained": f"{100.0 * row['energy_drift']:.1f} % of what went through",
            "verified": "yes" if row["verified"] else "no",
        }
        for name, row in last.items()
    ]
    fields = {
        **record,
        "folder": folder,
        "commit": commit[:10] + ("+" if commit.endswith("+") else ""),
        "strengths": ", ".join(f"{share:g}" for share in record["strengths"]),
        "table": markdown_table(list(rows[0]), [row.values() for row in rows]),
        "tolerance": 100.0 * tolerance,
        "short": "" if record["paper_duration"] < FULL.paper_duration else None,
        "reached": "reached" if record["target"]["reached"] else "not reached",
    }
    paragraphs = [
        paragraph.format_map(fields)
        for paragraph in _PAGE.split("\n\n")
        if not any(f"{{{name}}}" in paragraph for name, value in fields.items() if value is None)
    ]
    return "\n\n".join(paragraphs)
