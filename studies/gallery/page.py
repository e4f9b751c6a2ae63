"""The gallery's pictures, and the page that shows them with what they were made of."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swim_agents.comparison.performance import measure_gait

from studies.gallery.pictures import draw_learning, draw_pareto
from studies.gallery.runs import (
    FULL,
    PAPER_SCENES,
    TARGET,
    Plan,
    Progress,
    Runs,
    play_all,
    stored_curves,
    table,
)
from swim_env import plots
from swim_env.envs.task import TARGET_RADIUS
from swim_env.errors import SwimError
from swim_env.files.atomic import write_atomically
from swim_env.files.folders import check_folder, page_of, write_folder
from swim_env.files.provenance import where_and_when
from swim_env.files.tables import markdown_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["GALLERY_FILES", "check_gallery", "make_gallery"]

#: The wave and the agent whose energy budgets are shown.
_BUDGETS = ("tuned_wave", "ppo_forward")

#: Pictures by file, each with its heading, the function that draws it, and what is to be seen.
_PICTURES: dict[str, tuple[str, str, str]] = {
    "paths.png": (
        "Where they went, in which shapes",
        "draw_paths",
        "All start at the same place with the same noise. Below, shapes over the last 0.2 s on top "
        "of each other.",
    ),
    "path_ppo_forward.png": (
        "Shapes along the path: an agent that swims forward",
        "draw_path",
        "Centre line and directors at equal intervals of time, as in the paper's Figs. 4 to 8.",
    ),
    "path_ppo_target.png": (
        "Shapes along the path: an agent that swims to a target",
        "draw_path",
        "It has to turn; an episode ends when the mean centre is in the circle.",
    ),
    "path_paper_i.png": (
        "Shapes along the path: the paper's scene i (its Fig. 4)",
        "draw_path",
        "The travelling wave of torque barely swims. The shapes cover their own track, so they are "
        "moved apart, as the paper does.",
    ),
    "path_paper_xi.png": (
        "Shapes along the path: the paper's scene xi (its Fig. 8)",
        "draw_path",
        "No torque: the straight body, which sets out tail first, leaves its line by itself, turns "
        "around and goes on head first.",
    ),
    "kymograph.png": (
        "Curvature along the body over time",
        "draw_kymographs",
        "One colour scale for all, so the paper's wave is nearly white: it hardly bends the body. "
        "Its stripes lean, a wave that travels; those of the tuned wave and of the agents stand, "
        "with a lag towards the tail.",
    ),
    "torques.png": (
        "Torques of the joints over time",
        "draw_torques",
        "The waves are cosines: the paper's travels from head to tail, the tuned one from tail to "
        "head. Both agents drive the front half against the rear half: PPO's nearly always at the "
        "limit, SAC's a little below it, with steps between.",
    ),
    "gaits.png": (
        "Torque, bending and its phase",
        "draw_gaits",
        "Each map of joint angles has its own scale. Right, by how much the bending of each joint "
        "lags behind the first.",
    ),
    "energy.png": (
        "Energy budget",
        "draw_energy",
        "Most of the kinetic energy is the fluid's. Work goes in, damping takes it; what is not "
        "explained, the integrator's error, stands below.",
    ),
    "pareto.png": (
        "How far for how much work",
        "draw_pareto",
        "Every policy with its torques times {strengths}. Dotted lines join equal work per body "
        "length; runs that end behind their start are left out. Hollow points are not on the "
        "front: played again at a quarter of the time step with 12 panels on every element, their "
        "displacement is another one.",
    ),
    "training.png": (
        "Learning",
        "draw_learning",
        "From the stored evaluations of the shipped agents' trainings and of their other seeds, "
        "without exploration (docs/training.md). These are not trained anew.",
    ),
}

#: What the folder holds.
GALLERY_FILES = (*_PICTURES, "gallery.json")


def check_gallery(folder: str | os.PathLike[str]) -> None:
    """Refuse a folder that holds anything but an earlier gallery.

    Raises
    ------
    SwimError
        If it does, or if the path is a file, or the page beside it a folder.
    """
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

    Raises
    ------
    SwimError
        If the folder holds other files, or something cannot be written.
    """
    check_gallery(folder)
    runs = play_all(plan, progress)
    figures = _draw(runs)
    record = _record(runs, plan, command)

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
    episodes = runs.forward
    full = {name: episode.trajectory for name, episode in episodes.items()}
    gaits = {}
    for name, episode in episodes.items():
        gait = measure_gait(episode.rollout, episode.trajectory)
        gaits[name] = None if gait is None else gait.to_dict()
    budgets = {name: full[name] for name in _BUDGETS}
    starts = {name: episodes[name].rollout.velocity for name in _BUDGETS}
    target = runs.target.rollout
    radius = TARGET_RADIUS * target.scene.beam.length
    forward, aiming = stored_curves()
    return {
        "paths.png": plots.draw_paths(full),
        "path_ppo_forward.png": plots.draw_path(full["ppo_forward"], 9, "ppo_forward"),
        "path_ppo_target.png": plots.draw_path(
            runs.target.trajectory, name=TARGET, target=target.goal, radius=radius
        ),
        **{f"path_{name}.png": plots.draw_path(runs.paper[name], 11) for name in PAPER_SCENES},
        "kymograph.png": plots.draw_kymographs(full),
        "torques.png": plots.draw_torques(full),
        "gaits.png": plots.draw_gaits(full, gaits),
        "energy.png": plots.draw_energy(budgets, starts),
        "pareto.png": draw_pareto(
            {name: [one.trajectory for one in some] for name, some in runs.strengths.items()},
            {name: [bool(one.verified) for one in some] for name, some in runs.strengths.items()},
        ),
        "training.png": draw_learning(
            forward, aiming, ("tuned_wave", episodes["tuned_wave"].rollout.net_displacement)
        ),
    }


def _record(runs: Runs, plan: Plan, command: str) -> dict[str, Any]:
    target = runs.target.rollout
    return {
        "command": command,
        "scene": target.scene.name,
        "seed": plan.seed,
        "duration": target.scene.episode.duration,
        "paper_duration": plan.paper_duration,
        "strengths": list(plan.strengths),
        "policies": table(runs),
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


def _page(record: Mapping[str, Any], folder: str) -> str:
    """Return the page, in Markdown."""
    machine, commit = record["machine"], record["commit"] or "unknown"
    settings = (
        f"Scene `{record['scene']}`, {record['duration']:g} s from the start with seed "
        f"{record['seed']}; the paper's scenes for {record['paper_duration']:g} s. Commit "
        f"{commit[:10]}{'+' if commit.endswith('+') else ''}, {record['date']}, "
        f"{machine['processor']}, {machine['cores']} cores."
    )
    parts = [
        "# Gallery",
        "Everything here is made by one command, from runs that are played anew:",
        f"```sh\n{record['command']}\n```",
        settings,
        "Colours are the same for a policy in every picture; blue and orange are below and above "
        "zero, white is zero. BL: body length. The functions are those of `swim_env.plots`, and "
        "`draw_pareto` and `draw_learning` of `studies.gallery.pictures`; they take trajectories "
        "and return matplotlib figures. What accuracy costs is drawn in docs/accuracy.md, speed in "
        "docs/speed.md, the paper's figures in docs/paper.md.",
        markdown_table(
            (
                "policy at full strength",
                "net displacement",
                "computed finer",
                "positive work",
                "energy not explained",
            ),
            [_row(name, rows[-1]) for name, rows in record["policies"].items()],
        ),
    ]
    tolerance = record["energy_tolerance"]
    beyond = [
        f"`{name}`"
        for name, rows in record["policies"].items()
        if not rows[-1]["energy_drift"] <= tolerance
    ]
    if beyond:
        parts.append(
            f"The scene warns beyond {100.0 * tolerance:g} % of energy that is not explained, as "
            f"for {', '.join(beyond)}; whether the displacement can be trusted, the column "
            "*computed finer* says: the same torques at a quarter of the time step with 12 panels "
            "on every element."
        )
    if record["paper_duration"] < FULL.paper_duration:
        parts.append(
            "These runs are short, to see that everything works: what the captions tell of bodies "
            "is to be seen in the full gallery only."
        )
    for name, (heading, function, text) in _PICTURES.items():
        shares = ", ".join(f"{share:g}" for share in record["strengths"])
        caption = text.replace("{strengths}", shares)
        if name == "path_ppo_target.png":
            target = record["target"]
            end = "reached" if target["reached"] else "not reached"
            caption += f" The target was {end}, after {target['duration']:g} s."
        parts += [f"## {heading}", f"![{heading}]({folder}/{name})", f"{caption} `{function}`"]
    return "\n\n".join(parts) + "\n"


def _row(name: str, row: Mapping[str, Any]) -> tuple[str, ...]:
    check = "" if row["verified"] else ", disagrees"
    return (
        f"`{name}`",
        f"{row['net_displacement']:.3f} BL",
        f"{row['fine_displacement']:.3f} BL{check}",
        f"{row['positive_work']:.3g} J",
        f"{100.0 * row['energy_drift']:.1f} % of the largest",
    )
