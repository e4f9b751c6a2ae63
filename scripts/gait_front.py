#!/usr/bin/env python
"""Hold agents, waves and optimal gaits against each other: displacement and what it takes.

Every policy plays an episode from the scene's own start, without noise.

    scripts/gait_front.py ppo_forward tuned_wave build/*.optimal_gait.json --output docs/optimal
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # studies are not installed

from swim_agents import load_policy
from swim_agents.commands.command_line import add_options, print_result, run
from swim_agents.files import write_json
from swim_agents.optimal_gait import GAIT_SUFFIX
from swim_agents.rollout import play_episode
from swim_agents.tables import text_table

from studies.gallery.pictures import draw_pareto
from swim_env import Scene, SwimEnv, Trajectory, load_scene
from swim_env.errors import SwimError
from swim_env.files.provenance import where_and_when
from swim_env.plots import require_matplotlib, save_figure


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("policies", nargs="+", metavar="POLICY", help="a name, or a gait's file")
    parser.add_argument("--scene", default="swimmer", help="swimmer unless given")
    parser.add_argument(
        "--output", metavar="FOLDER", help="write front.json, front.md and front.png into it"
    )
    add_options(parser, "json")
    return parser


def measure(policy: str, scene: Scene) -> tuple[dict[str, Any], Trajectory]:
    """Return how far a policy swims (BL), with how much work (J), and its run."""
    rollout = play_episode(SwimEnv(scene), load_policy(policy, scene), options={"noise": 0.0})
    run: Any = rollout.simulate()
    summary = run.summary()
    spent = summary["positive_work"]
    row = {
        "policy": Path(policy).name.removesuffix(GAIT_SUFFIX),
        "displacement": rollout.net_displacement,
        "positive_work": spent,
        "efficiency": rollout.net_displacement / spent if spent else None,
        "energy_drift": summary["energy_drift"],
        "termination_reason": summary["termination_reason"],
    }
    return row, run


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    options = _parser().parse_args(arguments)
    scene = load_scene(options.scene)
    if scene.dimension != 2:
        raise SwimError(f"the front is that of planar gaits, {scene.name} is in space")
    if options.output is not None:
        require_matplotlib()
    found = [measure(policy, scene) for policy in options.policies]
    found.sort(key=lambda one: -one[0]["displacement"])
    rows = [row for row, _ in found]
    heads = ("policy", "displacement (BL)", "positive work (J)", "efficiency (BL/J)")
    cells = [
        (
            row["policy"],
            f"{row['displacement']:.3f}",
            f"{row['positive_work']:.1f}",
            "-" if row["efficiency"] is None else f"{row['efficiency']:.4f}",
        )
        for row in rows
    ]
    if options.output is not None:
        folder = Path(options.output)
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / "front.json", {"rows": rows, **where_and_when()})
        lines = ["| " + " | ".join(line) + " |" for line in (heads, ("---",) * 4, *cells)]
        (folder / "front.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
        runs = {row["policy"]: [run] for row, run in found}
        save_figure(draw_pareto(runs), folder / "front.png")
    print_result({"rows": rows}, options.json, lambda: text_table([heads, *cells]))
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
