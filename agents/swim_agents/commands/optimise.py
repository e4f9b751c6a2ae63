"""Find the torques that are best on a scene, by exact gradients of whole episodes."""

from __future__ import annotations

import argparse
import functools
import hashlib
import json
import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from swim_agents.baselines import tuned_wave
from swim_agents.commands import command_line as cli
from swim_agents.files import check_file, write_json
from swim_agents.optimal_gait import GAIT_SUFFIX, GOALS, OptimalGait, gait_file
from swim_agents.optimising import Problem, Result, search_gait
from swim_agents.rollout import Rollout, play_episode
from swim_agents.tuned_wave import find_tuned_wave
from swim_agents.verification import Progress, check_rollout
from swim_env import SwimEnv, SwimEnv3D, __version__, natural_frequencies
from swim_env.errors import OptionError, SceneError, SwimError
from swim_env.files.provenance import where_and_when
from swim_env.gradients.tape import Tape
from swim_env.scene import Scene, scene_names

#: Changes with what a search minimises: an interrupted one of another kind is not continued.
_SEARCH = 2
#: Share of --at-least that an efficient gait must reach.
_NEAR = 0.95


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    cli.add_scene_arguments(parser, default="swimmer")
    parser.add_argument(
        "--for",
        dest="goal",
        choices=GOALS,
        default=GOALS[0],
        help="what is best; efficiency is the displacement --at-least, or nearly, for the least "
        "positive work",
    )
    parser.add_argument(
        "--minutes", type=float, default=3.0, metavar="M", help="time to search; 3 unless given"
    )
    parser.add_argument(
        "--free", action="store_true", help="torques need not repeat from period to period"
    )
    parser.add_argument(
        "--design",
        action="store_true",
        help="vary the stiffness of every joint, too, up to "
        "fourfold; the body that is best goes into a scene's file beside the record",
    )
    parser.add_argument(
        "--at-least",
        type=float,
        metavar="BL",
        help="displacement in the episode that an "
        "efficient gait aims at, and comes to at least 0.95 of; that of the scene's own tuned "
        "wave unless given",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the guesses")
    parser.add_argument(
        "--verify",
        action="store_true",
        help="check the gait with finer steps and panels, and "
        "fail if its score changes by more than an agent's may",
    )
    parser.add_argument(
        "--output",
        metavar="FILE",
        help=f"where the record goes, a name that ends with "
        f"{GAIT_SUFFIX}; unless given it lies beside the scene's file, where optimal_{GOALS[0]} "
        "and so on are looked for",
    )


def main(options: argparse.Namespace) -> int:
    """Search and write the record; a search that was interrupted goes on where it was."""
    if not 0.0 < options.minutes < 1e4:
        raise SwimError(f"--minutes must be above 0, got {options.minutes}")
    output = _output(options)
    check_file(output)
    body = None
    if options.design:
        ending = f".{options.goal}{GAIT_SUFFIX}"
        if not output.endswith(ending):
            raise SwimError(f"--output of a design must end with {ending}, got {output}")
        body = Path(f"{output.removesuffix(ending)}.yaml")
        if body.exists():
            raise SwimError(f"{body} exists, and would be the design's body; name another --output")
    cli.check_places([options.scene], {"--output": output})
    scene = cli.scene_of(options)
    if not scene.has_period:
        raise SceneError(f"scene {scene.name} has joints without stiffness, and no modes to try")
    at_least = 0.0
    if options.goal == "efficiency":
        at_least = _tuned(scene) if options.at_least is None else options.at_least
    asked = (options.goal, options.free, options.design, at_least, options.seed)
    sought = [scene.to_dict(), *asked, _SEARCH]
    log = Path(f"{output}.part")
    head = hashlib.sha256(json.dumps(sought).encode()).hexdigest()
    known = _read(log, head)
    Tape.of(scene)  # refuses a scene, and compiles before the time counts
    begin = time.perf_counter()

    def keep(number: int, period: int, result: Result) -> None:
        known[number] = period, result
        entries = {
            str(one): [period, found.unknowns.tolist(), found.value, found.done]
            for one, (period, found) in sorted(known.items())
        }
        write_json(log, {"sought": head, "found": entries})

    with cli.progress_bar(round(60.0 * options.minutes), "s", "search") as progress:
        problem, result = search_gait(
            *(
                scene,
                options.goal,
                natural_frequencies(scene, min(2, scene.joints), scene.axes[:1]),
            ),
            seconds=60.0 * options.minutes,
            design=options.design,
            free=options.free,
            at_least=at_least,
            seed=options.seed,
            known=dict(known),
            keep=_seldom(keep),
            progress=progress,
        )
    own = problem.scene_of(result.unknowns)
    gait = OptimalGait(own, problem.table(result.unknowns), own)
    record = _record(own, problem, gait, result, options)
    record["seconds"] = round(time.perf_counter() - begin, 1)
    if options.verify and not record["verification"]["verified"]:
        # What is there already stays.
        write_json(f"{output}.unverified", record)
        raise SwimError(f"the gait is not verified; its record is in {output}.unverified")
    if body is not None:
        own.save(body)
    write_json(output, record)
    log.unlink(missing_ok=True)
    brief = {name: record[name] for name in record if name not in ("actions", "scene_fields")}
    cli.print_result(brief, options.json, lambda: _text(record, output))
    return 0


def _tuned(scene: Scene) -> float:
    """Return how far the scene's tuned wave swims in the episode (BL)."""
    record = find_tuned_wave(scene)
    same = record["scene_fields"].episode.duration == scene.episode.duration
    try:
        tuned_wave(scene).check(scene)
    except OptionError:
        same = False
    if not same:
        raise SwimError(
            f"scene {scene.name} has no tuned wave for this episode; give the displacement that an "
            "efficient gait must reach by --at-least, in body lengths"
        )
    return float(record["net_displacement"])


def _output(options: argparse.Namespace) -> str:
    """Return where the record goes."""
    if options.output is not None:
        if not str(options.output).endswith(GAIT_SUFFIX):
            raise SwimError(f"--output must end with {GAIT_SUFFIX}, got {options.output}")
        return str(options.output)
    if options.scene in scene_names() or options.set or options.design:
        raise SwimError(
            "name the record's file with --output: only a scene's file as it is has one beside it"
        )
    return os.fspath(gait_file(options.scene, options.goal))


def _read(log: Path, head: str) -> dict[int, tuple[int, Result]]:
    """Return what an interrupted search of the same gait has found."""
    try:
        data = json.loads(log.read_text(encoding="utf-8"))
        if data["sought"] != head:
            return {}
        return {
            int(number): (period, Result(np.array(unknowns), value, done=done))
            for number, (period, unknowns, value, done) in data["found"].items()
        }
    except (OSError, ValueError, TypeError, KeyError):
        return {}


def _seldom(keep: Any, every: float = 5.0) -> Any:
    """Return what calls `keep` at most every few seconds for one guess, and when one is done."""
    last: dict[int, float] = {}

    def call(number: int, period: int, result: Result) -> None:
        now = time.monotonic()
        if result.done or now - last.get(number, -every) >= every:
            last[number] = now
            keep(number, period, result)

    return call


def check_gait(record: dict[str, Any], minutes: float) -> None:
    """Refuse a gait that does not do what it is for (SwimError)."""
    moved, at_least = record["net_displacement"], record["at_least"]
    least = 0.0 if at_least is None else _NEAR * at_least
    if record["goal"] == "turn":
        wanted, done, unit = 0.0, record["heading_change"], "rad"
    else:
        wanted, done, unit = least, moved, "BL"
    if not done > wanted:
        raise SwimError(
            f"after {minutes:g} minutes the best gait for {record['goal']} comes to {done:.3g} "
            f"{unit}, and must come to more than {wanted:.3g}: too little time, or too much asked; "
            "the same command with more --minutes goes on from there"
        )


def _episode(gait: OptimalGait, scene: Scene, progress: Progress | None = None) -> Rollout:
    """Play an episode from the scene's own start."""
    env: Any = (SwimEnv if scene.dimension == 2 else SwimEnv3D)(scene)
    return play_episode(env, gait, options={"noise": 0.0}, progress=progress)


def _record(
    scene: Scene, problem: Problem, gait: OptimalGait, result: Result, options: argparse.Namespace
) -> dict[str, Any]:
    """Play the gait as a policy and return all that there is to know of it."""
    rollout = _episode(gait, scene)
    run = rollout.simulate()
    summary = run.summary()
    record: dict[str, Any] = {
        "goal": options.goal,
        "scene": scene.name,
        "settings": {name: getattr(options, name) for name in ("minutes", "free", "design")},
        "at_least": problem.at_least or None,
        "net_displacement": rollout.net_displacement,
        "heading_change": summary["heading_change"],
        "positive_work": summary["positive_work"],
        "efficiency": rollout.net_displacement / max(summary["positive_work"], 1e-300),
        "energy_drift": summary["energy_drift"],
        "termination_reason": summary["termination_reason"],
        "period": problem.period * scene.episode.control_interval,
        "evaluations": result.evaluations,
        "seed": options.seed,
        "version": __version__,
        **where_and_when(),
    }
    check_gait(record, options.minutes)
    if options.verify:
        with cli.share_bar("check") as bar:
            play = functools.partial(_episode, gait)
            record["verification"] = check_rollout(rollout, play, bar).to_dict()
    return record | {"actions": gait.table.tolist(), "scene_fields": scene.to_dict()}


def _text(record: dict[str, Any], output: str) -> str:
    """Return the result as text."""
    checked = "" if "verification" not in record else ", verified with finer steps and panels"
    return "\n".join(
        [
            f"optimal gait of scene {record['scene']} for {record['goal']}: "
            f"{record['net_displacement']:.3f} BL in an episode{checked}",
            f"{record['positive_work']:.3g} J of positive work ({record['efficiency']:.3g} BL/J), "
            f"turned by {record['heading_change']:.3g} rad, a period of {record['period']:.3g} s",
            f"found in {record['seconds']} s with {record['evaluations']} gradients in the last "
            f"search, kept in {output}",
        ]
    )
