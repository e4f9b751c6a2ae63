#!/usr/bin/env python
"""Measure what settings of a learning scene cost, and how much each source of error changes scores.

The torques of agents are played again with every candidate, and with each of its sources of error
refined by itself; then the agents play, with the candidate and with all of it refined.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from typing import Any

import numpy as np
from swim_agents.commands.command_line import add_options, print_result, progress_bar, run
from swim_agents.comparison.contest import FIRST_SEED
from swim_agents.policies import load_policy
from swim_agents.rollout import Rollout, play_episode, score
from swim_agents.tables import text_table
from swim_agents.verification import fine_scene, finer_scenes

from swim_env import SwimEnv
from swim_env.scene import Scene, load_scene

#: Scheme, steps in an action, tolerance, panels per element and on each end.
CANDIDATES = (
    ("paper", 4, 1e-10, 4, 1),
    ("paper", 4, 1e-4, 4, 1),
    ("composed", 2, 1e-4, 4, 2),
    ("composed", 3, 1e-4, 4, 2),
    ("composed", 4, 1e-4, 4, 2),
)
_SETTINGS = ("scheme", "steps", "tolerance", "panels", "ends")
#: Elements that take the place of one; odd, so that joints stay where they are.
_FINER = 3


def _scene(base: Scene, scheme: str, steps: int, tolerance: float, panels: int, ends: int) -> Scene:
    """Return a scene with a candidate's settings."""
    return base.replace(
        {
            "integrator.scheme": scheme,
            "integrator.time_step": base.episode.control_interval / steps,
            "integrator.tolerance": tolerance,
            "fluid.panels_per_element": panels,
            "fluid.cap_panels": ends,
        }
    )


def _with_more_elements(episode: Rollout, panels: int) -> Rollout:
    """Return an episode on a beam of more elements, the moment of each old joint around it."""
    elements = episode.scene.beam.elements
    finer = elements * _FINER
    old = np.rint(np.arange(1, finer) / _FINER).astype(int) - 1
    driven = (old >= 0) & (old < elements - 1)
    old = np.clip(old, 0, elements - 2)
    coordinates, velocity = (np.empty(finer + 2) for _ in range(2))
    coordinates[:3], velocity[:2] = episode.coordinates[:3], episode.velocity[:2]
    coordinates[3:] = np.where(driven, episode.coordinates[3:][old] / _FINER, 0.0)
    velocity[2:] = np.repeat(episode.velocity[2:], _FINER)
    return replace(
        episode,
        scene=episode.scene.replace(
            {"beam.elements": finer, "fluid.panels_per_element": panels // _FINER}
        ),
        coordinates=coordinates,
        velocity=velocity,
        torques=np.where(driven, episode.torques[:, old], 0.0),
    )


def _elements_change(episode: Rollout, scene: Scene) -> float:
    """Return what more elements change a score by, as a share, at equal lengths of panels."""
    panels = 2 * _FINER
    own = replace(episode, scene=scene.replace({"fluid.panels_per_element": panels}))
    finer = _with_more_elements(own, panels)
    ends = [score(one, one.simulate().path[-1]) for one in (own, finer)]
    return ends[1] / ends[0] - 1.0


def measure(agents: list[str], starts: int, progress: Any) -> list[dict[str, Any]]:
    """Return a row for every candidate: its settings, cost and largest changes of scores."""
    base = load_scene("swimmer")
    played = [(load_policy(name, base), FIRST_SEED + i) for name in agents for i in range(starts)]
    episodes = [play_episode(SwimEnv(base), policy, seed) for policy, seed in played]
    rows = []
    for candidate in CANDIDATES:
        scene = _scene(base, *candidate)
        seconds, drifts = [], []
        changes: dict[str, list[float]] = {}
        for episode, (policy, seed) in zip(episodes, played, strict=True):
            one = replace(episode, scene=scene, steps=len(episode.torques) * scene.steps_per_action)
            begin = time.perf_counter()
            run = one.simulate()
            seconds.append((time.perf_counter() - begin) / len(one.torques))
            drifts.append(run.energy_drift)
            own = score(one, run.path[-1])
            for source, finer in finer_scenes(scene).items():
                change = score(one, one.simulate(finer).path[-1]) / own - 1.0
                changes.setdefault(source, []).append(change)
            changes.setdefault("elements", []).append(_elements_change(one, scene))
            ends = [
                play_episode(SwimEnv(scene_played), policy, seed).net_displacement
                for scene_played in (scene, fine_scene(scene))
            ]
            changes.setdefault("closed_loop", []).append(ends[1] / ends[0] - 1.0)
            progress(1)
        rows.append(
            {
                "setting": dict(zip(_SETTINGS, candidate, strict=True)),
                "microseconds": 1e6 * float(np.median(seconds)),
                "energy_drift": max(drifts),
                "changes": {source: max(values, key=abs) for source, values in changes.items()},
            }
        )
    return rows


def _table(rows: list[dict[str, Any]]) -> str:
    """Return the rows as text, costs as multiples of the first."""
    first = rows[0]["microseconds"]
    sources = ("time_step", "panels", "ends", "elements", "together", "closed_loop")
    cells = [
        [
            *map(str, row["setting"].values()),
            f"{row['microseconds'] / first:.2f}",
            *(f"{row['changes'][source]:+.1%}" for source in sources),
            f"{row['energy_drift']:.1%}",
        ]
        for row in rows
    ]
    return text_table([[*_SETTINGS, "cost", *sources, "energy"], *cells])


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--agents", nargs="+", metavar="POLICY", default=["ppo_forward", "sac_forward"]
    )
    parser.add_argument("--starts", type=int, default=2, metavar="N", help="of each; 2 by default")
    add_options(parser, "json")
    options = parser.parse_args(arguments)
    total = len(CANDIDATES) * len(options.agents) * options.starts
    with progress_bar(total, "run", "settings") as progress:
        rows = measure(options.agents, options.starts, progress)
    print_result({"rows": rows}, options.json, lambda: _table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
