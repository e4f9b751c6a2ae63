"""Policies on the same scene and the same starts, with every score checked."""

from __future__ import annotations

import math
import operator
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from swim_agents.baselines import Policy, tuned_wave
from swim_agents.comparison.gait import Gait
from swim_agents.comparison.performance import Performance, measure_performance
from swim_agents.comparison.spatial_gait import Ellipse, SpatialGait, plane_angle
from swim_agents.policies import load_policy, policy_names, runs_in
from swim_agents.rollout import Rollout, check_policy, play_episodes, ratio
from swim_agents.tuned_wave import find_tuned_wave
from swim_agents.verification import (
    SOURCE_TOLERANCE,
    SOURCES,
    TOLERANCE,
    fine_scene,
    part_of,
    verify_rollout,
    work_of,
    work_of_check,
)
from swim_env import __version__
from swim_env.envs.tasks import NOISE, Task, check_task, make_task
from swim_env.envs.vector import SwimVectorEnv
from swim_env.errors import OptionError, SimulationEndedError
from swim_env.files.names import shown_name
from swim_env.files.provenance import where_and_when
from swim_env.physics.runtime.threads import usable_threads
from swim_env.recording import Swimmer
from swim_env.scene import AXIS_NAMES, Scene
from swim_env.scene.checks import checked_option
from swim_env.sim.trajectory import Trajectory

#: The policies that every score is compared with, where a scene has them, see `references_on`.
REFERENCES = ("paper_wave", "tuned_wave")

#: Scores are taken from starts with this seed and those after it: trainings draw theirs from below
#: the evaluations' seeds, which begin at 1,000,000.
FIRST_SEED = 2_000_000

#: The score and what verifies it, each with what its ratios are called.
_DISPLACEMENTS = {
    "net_displacement": "",
    "fine_displacement": "fine_",
    "closed_displacement": "closed_",
}
#: Those of them, and of the score, whose medians have a spread over training seeds.
_MEDIANS = ("score", "closed_score", *_DISPLACEMENTS)
#: Figures of a `Performance` that are summed up by their medians.
_FIGURES = (
    "score",
    "closed_score",
    "net_displacement",
    "fine_displacement",
    "closed_displacement",
    "speed",
    "displacement_per_cycle",
    "positive_work",
    "cost_of_transport",
    "torque_squared",
    "heading_change",
    "energy_drift",
)
_GAIT_FIGURES = tuple(spec.name for spec in fields(Gait) if spec.type == "float")
_SPATIAL_FIGURES = tuple(spec.name for spec in fields(SpatialGait) if spec.type == "float")
_ELLIPSE_FIGURES = tuple(spec.name for spec in fields(Ellipse))
#: Figures whose spread over training seeds is given; of displacements it is that of the medians.
_SPREADS = (
    *_MEDIANS,
    "verified_share",
    *(f"{prefix}ratio_to_{one}" for prefix in _DISPLACEMENTS.values() for one in REFERENCES),
    "success_rate",
    "verified_success_rate",
    "replayed_success_rate",
)
#: Changes of a score of which the largest is given.
_CHANGES = (*SOURCES, "model", "together", "closed_loop")


@dataclass(frozen=True, eq=False)
class Entry:
    """One policy in a contest."""

    #: Its name in the tables.
    name: str
    #: The same for agents that differ in nothing but their training seed.
    group: str
    policy: Policy
    #: For an agent what ``agent.json`` says of its training, else empty.
    about: dict[str, Any]
    #: The name or path that it was loaded from.
    source: str = ""


@dataclass(frozen=True, eq=False)
class Contest:
    """The result of a contest."""

    scene: Scene
    #: The task's name.
    task: str
    #: Of the starts.
    seeds: tuple[int, ...]
    #: For each entry one for each seed.
    performances: dict[str, list[Performance]]
    #: For each entry its first `keep` episodes.
    rollouts: dict[str, list[Rollout]]
    trajectories: dict[str, list[Trajectory]]
    #: All figures as plain values; see `hold_contest`.
    record: dict[str, Any]

    def swimmers(self) -> list[Swimmer]:
        """Return the first episode of every entry for a recording, the references last."""
        names = [name for name in self.rollouts if name not in REFERENCES]
        names += [name for name in REFERENCES if name in self.rollouts]
        return [self.rollouts[name][0].swimmer(name, self.trajectories[name][0]) for name in names]


def references_on(scene: Scene) -> list[str]:
    """Return the REFERENCES that a scene has: a prescribed wave, and one tuned to its body."""
    found = list(REFERENCES)
    if scene.actuation is None:
        found.remove("paper_wave")
    try:
        tuned_wave(scene).check(scene)
    except OptionError:
        found.remove("tuned_wave")
    return found


def entries_of(
    names: Sequence[str], scene: Scene, task: str = "forward", trust: bool = False
) -> list[Entry]:
    """Load the policies of a contest, with the `references_on` the scene in front.

    Arguments and errors are those of `load_policy`. A folder with runs ``seed_0``, ``seed_1`` ...
    stands for all of them, which then form one group.
    """
    found: list[Entry] = []
    for name in dict.fromkeys([*references_on(scene), *names]):
        runs: list[Path | None] = []
        if name not in policy_names():
            runs += runs_in(name)
        for path in runs or [None]:
            policy = load_policy(name if path is None else path, scene, 0, task, trust)
            about = dict(getattr(policy, "description", {}))
            label, group = _labels(name, path, policy)
            others = [entry for entry in found if entry.source != name]
            while any(group == entry.group or label == entry.name for entry in others):
                label, group = label.replace(group, f"{group}'", 1), f"{group}'"
            found.append(Entry(label, group, policy, dict(about.get("training", {})), name))
    return found


def _labels(name: str, run: Path | None, policy: Policy) -> tuple[str, str]:
    """Return the names of a policy and its group: of an agent its own name, and its run."""
    known = shown_name(str(getattr(policy, "name", name)))
    if run is not None:
        return f"{known}/{shown_name(run.name)}", known
    place = Path(name)
    place = place.parent if place.name in ("agent", "final_agent") else place
    label = f"{known}/{shown_name(place.name)}" if place.name.startswith("seed_") else known
    return label, label


def checked_seeds(seeds: Sequence[int]) -> list[int]:
    """Return seeds of starts as plain numbers; OptionError unless they differ and are usable."""
    try:
        found = [operator.index(seed) for seed in seeds if not isinstance(seed, bool)]
    except TypeError:
        found = []
    if not found or len(set(found)) < len(seeds) or min(found) < 0:
        raise OptionError(f"seeds must be different whole numbers of at least 0, got {list(seeds)}")
    return found


def hold_contest(
    scene: Scene,
    entries: Sequence[Entry],
    seeds: Sequence[int],
    task: str = "forward",
    noise: float = 1.0,
    environment: Mapping[str, Any] | None = None,
    keep: int = 1,
    threads: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> Contest:
    """Play policies from the same starts, and check every score.

    Parameters
    ----------
    scene : Scene
        The scene; its episode gives the duration.
    entries : sequence of Entry
        The policies; where the score is a displacement along a direction, the `references_on` the
        scene must be among them.
    seeds : sequence of int
        Of the starts and of what tasks draw, such as targets; all different.
    task : str
        As for `swim_env.envs.tasks.find_task`.
    noise : float
        Factor on the start's noise.
    environment : mapping, optional
        Arguments of the task, such as ``target_radius``.
    keep : int
        Episodes of each entry that are kept for pictures.
    threads : int, optional
        As many as numba uses unless given.
    progress : callable, optional
        Called with the share of the work that was done since the last call; shares come to 1.

    Returns
    -------
    Contest
        Its record holds ``scene``, ``task``, ``seeds``, ``duration``, ``tolerance``,
        ``source_tolerance``; in ``policies`` for each entry lists over seeds (``net_displacement``,
        ``fine_displacement`` of the torques and ``closed_displacement`` of the policy in the finer
        scene, ``verified`` and the other figures of a `Performance`), medians under ``median``, the
        changes that are largest over the seeds under ``largest_change``, ``ratio_to_paper_wave``
        and ``ratio_to_tuned_wave`` of the medians with the same in the finer scene under
        ``fine_ratio_to_...`` and ``closed_ratio_to_...`` (None without that wave),
        ``success_rate``, ``verified_success_rate`` (what the policy also reaches in the finer
        scene), ``replayed_success_rate`` (what its torques reach there, up to TOLERANCE of the
        target's radius outside of it) and the ``training``; ``net_displacement`` and ``ratios``
        again by entry; in ``groups`` the spread over training seeds; version, machine, commit.

    Raises
    ------
    OptionError, AgentError
        If the seeds or the task cannot be used, a reference is missing, or a policy was made for
        another scene or task.
    """
    seeds = checked_seeds(seeds)
    noise = checked_option(NOISE, noise, "the noise")
    count = len(seeds)
    task = check_task(task)
    made = make_task(task, scene, environment)
    for entry in entries:
        check_policy(entry.policy, made)
    names = [entry.name for entry in entries]
    if len(set(names)) < len(names):
        raise OptionError(f"entries must have different names, got {', '.join(names)}")
    needed = references_on(scene)
    missing = [name for name in needed if name not in names]
    if missing and _is_a_race(made):
        raise OptionError(f"every contest needs {' and '.join(needed)}, {missing[0]} is missing")
    if not names:
        raise OptionError("a contest needs at least one policy")
    workers = threads or usable_threads()
    performances: dict[str, list[Performance]] = {}
    kept: dict[str, list[Rollout]] = {}
    trajectories: dict[str, list[Trajectory]] = {}
    fine = fine_scene(scene)
    # Of an entry: its episodes, its closed loops, and its torques played again.
    work = work_of(scene), *work_of_check(scene)
    episodes, closed, again = (one / sum(work) / len(entries) for one in work)
    lock, stopped = threading.Lock(), threading.Event()
    reported = 0.0

    def report(share: float) -> None:
        nonlocal reported
        if stopped.is_set():
            raise KeyboardInterrupt
        if progress is not None:
            with lock:
                reported += share
                progress(share)

    def make(played: Scene) -> SwimVectorEnv:
        return SwimVectorEnv(
            count,
            played,
            autoreset_mode=AutoresetMode.NEXT_STEP,
            num_threads=workers,
            task=task,
            task_options=environment,
        )

    def play(
        env: SwimVectorEnv, policy: Policy, share: float, starts: Sequence[Rollout] | None = None
    ) -> list[Rollout]:
        advance = part_of(report, share / scene.actions_per_episode)
        options = {"noise": noise}
        return play_episodes(env, policy, seeds, options, progress=advance, starts=starts)

    def assess(rollout: Rollout, closed_loop: Rollout) -> tuple[Performance, Trajectory]:
        trajectory = rollout.simulate()
        verification = verify_rollout(rollout, closed_loop, progress=part_of(report, again / count))
        return measure_performance(rollout, trajectory, verification), trajectory

    with ExitStack() as stack:
        env = stack.enter_context(closing(make(scene)))
        try:
            finer = stack.enter_context(closing(make(fine)))
        except SimulationEndedError as error:  # not even the scene's own start
            finer, reason = None, error.reason
        for number, entry in enumerate(entries, start=1):
            rollouts = play(env, entry.policy, episodes)
            if finer is None:
                closed_loops = [one.refused(fine, reason) for one in rollouts]
            else:
                closed_loops = play(finer, entry.policy, closed, rollouts)
            # The kernels release the interpreter's lock.
            with ThreadPoolExecutor(workers) as pool:
                try:
                    assessed = list(pool.map(assess, rollouts, closed_loops))
                except BaseException:
                    stopped.set()  # what still plays would hold up the end
                    raise
            left_out = number / len(entries) - reported
            if left_out > 1e-9:
                report(left_out)
            performances[entry.name] = [performance for performance, _ in assessed]
            kept[entry.name] = rollouts[:keep]
            trajectories[entry.name] = [trajectory for _, trajectory in assessed[:keep]]
    settings = {"noise": noise, "environment": dict(environment or {})}
    if made.ends_at_goal and made.has_target:
        settings["target_radius"] = made.radius
    record = _record(made, entries, seeds, settings, performances)
    return Contest(scene, task, tuple(seeds), performances, kept, trajectories, record)


def _is_a_race(task: Task) -> bool:
    """Return whether who gets farther is better: waves then have scores that mean something."""
    return task.scored_by_displacement and not task.has_target


def _record(
    task: Task,
    entries: Sequence[Entry],
    seeds: Sequence[int],
    settings: dict[str, Any],
    performances: dict[str, list[Performance]],
) -> dict[str, Any]:
    in_space = task.scene.dimension == 3
    policies = {
        entry.name: {
            **_summary(performances[entry.name], settings.get("target_radius"), in_space),
            "training": entry.about,
        }
        for entry in entries
    }
    for kind, prefix in _DISPLACEMENTS.items():
        for reference in REFERENCES:
            # Waves aim at no target: being so many times as near to it as they are means nothing.
            there = _is_a_race(task) and reference in policies
            base = policies[reference]["median"][kind] if there else None
            for one in policies.values():
                one[f"{prefix}ratio_to_{reference}"] = ratio(one["median"][kind], base)
    scene = task.scene
    return {
        "scene": scene.name,
        "task": task.name,
        "score": task.score_name,
        "duration": scene.episode.duration,
        **settings,
        # Where the tuned wave comes from, if it takes part.
        "tuned_on": str(find_tuned_wave(scene)["scene"]) if "tuned_wave" in policies else None,
        "seeds": list(seeds),
        "tolerance": TOLERANCE,
        "source_tolerance": SOURCE_TOLERANCE,
        "net_displacement": {name: one["net_displacement"] for name, one in policies.items()},
        "ratios": {
            name: {reference: one[f"ratio_to_{reference}"] for reference in REFERENCES}
            for name, one in policies.items()
        },
        "policies": policies,
        "groups": _groups(entries, policies),
        "version": __version__,
        **where_and_when(),
        "scene_fields": scene.to_dict(),
    }


def _median(values: Sequence[float | None], missing: float | None = None) -> float | None:
    """Return the median of what is known; None where that is nothing or infinite."""
    known = [missing if value is None else value for value in values]
    numbers = [value for value in known if value is not None]
    median = float(np.median(numbers)) if numbers else math.inf
    return median if math.isfinite(median) else None


def _largest(changes: Sequence[float | None]) -> float | None:
    """Return the change that is largest either way; None where there is none or it is infinite."""
    largest = max((one for one in changes if one is not None), key=abs, default=math.inf)
    return largest if math.isfinite(largest) else None


def _summary(
    performances: Sequence[Performance], radius: float | None, in_space: bool = False
) -> dict[str, Any]:
    """Return lists over seeds, and their medians."""
    rows = [performance.to_dict() for performance in performances]
    data: dict[str, Any] = {name: [row[name] for row in rows] for name in rows[0]}
    # A start that gets nowhere has an infinite cost, which counts.
    missing = {"cost_of_transport": math.inf}
    data["median"] = {name: _median(data[name], missing.get(name)) for name in _FIGURES}
    swimming = [row for row in rows if row["gait"] is not None]
    swimming.sort(key=lambda row: row["net_displacement"])
    gaits = [row["gait"] for row in swimming]
    # Medians of phases mean nothing; the wave is that of the episode in the (lower) middle.
    middle = gaits[(len(gaits) - 1) // 2] if gaits else None
    if in_space:
        data["median"]["gait"] = _spatial_medians(gaits)
        about = {axis: middle and middle[axis] for axis in AXIS_NAMES}
        data["median"]["wave"] = {axis: one and one["wave"] for axis, one in about.items()}
    else:
        data["median"]["gait"] = _medians(gaits, _GAIT_FIGURES)
        data["median"]["wave"] = middle and middle["wave"]
    data["largest_change"] = {
        name: _largest([getattr(one, f"{name}_change") for one in performances])
        for name in _CHANGES
    }
    data["verified_share"] = float(np.mean(data["verified"]))
    successes = [row["success"] for row in rows]
    data["success_rate"] = None if successes[0] is None else float(np.mean(successes))
    data["verified_success_rate"] = data["replayed_success_rate"] = None
    if data["success_rate"] is not None:
        sure = [row["success"] and row["verified"] for row in rows]
        data["verified_success_rate"] = float(np.mean(sure))
    if radius is not None:
        reach = (1.0 + TOLERANCE) * radius
        blind = [row["success"] and row["fine_distance"] <= reach for row in rows]
        data["replayed_success_rate"] = float(np.mean(blind))
    return data


def _medians(rows: Sequence[dict[str, Any]], names: Sequence[str]) -> dict[str, float | None]:
    return {name: _median([row[name] for row in rows]) for name in names}


def _spatial_medians(gaits: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the medians of gaits in space: of all, about each axis, and of the body's ellipse."""
    found: dict[str, Any] = dict(_medians(gaits, _SPATIAL_FIGURES))
    for axis in AXIS_NAMES:
        about = [gait[axis] for gait in gaits if gait[axis] is not None]
        found[axis] = _medians(about, _GAIT_FIGURES)
    ellipses = [gait["body"] for gait in gaits]
    found["body"] = _medians(ellipses, _ELLIPSE_FIGURES)
    if ellipses:
        # Planes are the same after half a turn: of their angles it is the one around their mean.
        angles = np.array([one["angle"] for one in ellipses])
        middle = plane_angle(np.exp(2j * angles).sum())
        away = np.median([plane_angle(np.exp(2j * (angle - middle))) for angle in angles])
        found["body"]["angle"] = plane_angle(np.exp(2j * (middle + away)))
    return found


def _groups(entries: Sequence[Entry], policies: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Return the spread over training seeds of groups with more than one member."""
    groups: dict[str, Any] = {}
    for group in dict.fromkeys(entry.group for entry in entries):
        members = [entry.name for entry in entries if entry.group == group]
        if len(members) < 2:
            continue
        found: dict[str, Any] = {"members": members}
        for key in _SPREADS:
            inside = key in _MEDIANS
            values = [policies[m]["median"][key] if inside else policies[m][key] for m in members]
            known = [value for value in values if value is not None]
            if known and all(map(math.isfinite, known)):
                middle = float(np.median(known))
                found[key] = {"median": middle, "min": min(known), "max": max(known)}
        groups[group] = found
    return groups
