"""Verification, which asks whether a score survives a finer computation.

Near a resonance the paper's settings do not resolve the motion, and an optimiser will exploit that.
So a score counts only once it is found again with a quarter of the time step and three times the
panels on sides and ends, in space with panels on every shape instead of a simpler fluid model, in
two ways. The same torques are played with each of these refined by itself and with all of them, as
errors of opposite sign would cancel. And the policy plays the episode again where all is refined:
with feedback, it may well reach what its torques alone miss.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_agents.rollout import Rollout, score
from swim_env.errors import OptionError, SceneError, SimulationEndedError
from swim_env.physics.status import TERMINATION_REASONS as PHYSICS_REASONS
from swim_env.scene import Integrator, Scene, SpatialScene
from swim_env.scene.fluid import FLUID_TABLE

__all__ = [
    "FINE_PANELS",
    "SOURCES",
    "SOURCE_TOLERANCE",
    "SPATIAL_SOURCES",
    "TIME_STEP_DIVISOR",
    "TOLERANCE",
    "Verification",
    "check_rollout",
    "fine_scene",
    "finer_scenes",
    "part_of",
    "verify_rollout",
    "work_of",
    "work_of_check",
]

Array = NDArray[np.float64]
Progress = Callable[[float], object]

#: The finer computation: time step divided by this, panels per element at least as many and at
#: least twice the scene's.
TIME_STEP_DIVISOR, FINE_PANELS = 4, 12
#: What a score may change by, as a share of itself: with one source of error refined, and with all
#: of them, whether its torques are played again or the policy plays.
SOURCE_TOLERANCE, TOLERANCE = 0.05, 0.1
#: The sources of error. Without panels there is the time step alone, the centre line has no ends.
SOURCES = ("time_step", "panels", "ends")
#: Those in space, where panels on every shape are too slow to learn with.
SPATIAL_SOURCES = ("time_step", "model")
#: Models in space that stand for the one of panels on every shape.
_SIMPLER_MODELS, _FINE_MODEL = ("strip", "frozen"), "panels"
#: Models in the plane that solve for the panels of every shape.
_PANELS_OF_SHAPES = ("panels", "centreline")
#: Displacements below this (BL) are rounding, and agree with each other.
_NOTHING = 1e-9


@dataclass(frozen=True)
class Verification:
    """A score, compared with finer computations.

    What is `closed_...` is from the episode that the policy played in the finer scene, None where
    there is none.
    """

    #: The score, what its torques give in the finer scene, and what the policy gives there (BL).
    net_displacement: float
    fine_displacement: float
    closed_displacement: float | None
    #: By how much the net displacement changes as a share of itself, signed: each of the scene's
    #: SOURCES refined by itself, ``together``, and in the ``closed_loop`` if there is one; there it
    #: is the score that changes, which in some tasks is the return.
    changes: dict[str, float]
    #: Whether the score counts, see `verify_rollout`.
    verified: bool
    #: The largest changes allowed: of one source, and of the others.
    source_tolerance: float
    tolerance: float
    #: Of the finer scene (s); no panels where the scene has none, and in space.
    time_step: float
    panels_per_element: int | None
    #: `Trajectory.energy_drift` of the episode, the largest of its torques' finer computations, and
    #: that of the closed loop.
    energy_drift: float
    fine_energy_drift: float
    closed_energy_drift: float | None
    #: Why the episode or, if not, a finer computation of its torques was ended by the physics;
    #: empty where none was.
    termination_reason: str
    #: Why the closed loop ended early, empty where it did not; the task's own reasons count.
    closed_termination_reason: str | None
    #: How near the torques, played in the finer scene for as long as the episode lasted, and the
    #: policy come to the target (BL); None where there is none.
    fine_distance: float | None = None
    closed_distance: float | None = None
    #: Whether the policy succeeds in the finer scene, such as reaches the target; None where there
    #: is no success.
    closed_success: bool | None = None
    #: The sum of the rewards in the closed loop.
    closed_return: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and text, for JSON; a change that is infinite as null."""
        data = asdict(self)
        changes = {name: one if math.isfinite(one) else None for name, one in self.changes.items()}
        return {**data, "changes": changes}


class _Run(NamedTuple):
    """What is compared of an episode, or of its torques played again."""

    displacement: float
    energy_drift: float
    termination_reason: str
    #: How near it came to the target (BL), and whether it reached it, None where there is none.
    distance: float | None
    success: bool | None = None

    @property
    def broken(self) -> str:
        """Why the physics ended it, empty where it did not."""
        reason = self.termination_reason
        return reason if reason in PHYSICS_REASONS.values() else ""

    def is_sound(self, energy_tolerance: float) -> bool:
        """Return whether it came to its end, and its energy adds up."""
        return not self.broken and self.energy_drift <= energy_tolerance


def _refinements(scene: Scene) -> dict[str, dict[str, object]]:
    """Return what refines each source of a scene's error, and leaves the other ones alone."""
    integrator, fluid = scene.integrator, scene.fluid
    space = isinstance(scene, SpatialScene)
    found: dict[str, dict[str, object]] = {
        "time_step": {"integrator.time_step": integrator.time_step / TIME_STEP_DIVISOR}
    }
    if not space:
        found["time_step"]["integrator.tolerance"] = min(
            integrator.tolerance, max(integrator.tolerance / 100.0, Integrator().tolerance)
        )
    if space and fluid is not None and fluid.model in _SIMPLER_MODELS:
        found["model"] = {"fluid.model": _FINE_MODEL}
    if space or fluid is None or not FLUID_TABLE[fluid.model].panels:
        return found
    own = fluid.panels_per_element
    panels = max(FINE_PANELS, 2 * own)
    found["panels"] = {"fluid.panels_per_element": panels}
    if FLUID_TABLE[fluid.model].outline:
        # As a number: what is proportional to the sides' panels would be refined with them.
        ends = fluid.panels_per_end(scene.beam)
        found["panels"]["fluid.cap_panels"] = ends
        found["ends"] = {"fluid.cap_panels": math.ceil(ends * panels / own)}
    return found


def fine_scene(scene: Scene) -> Scene:
    """Return a scene with all of its discretisation refined but the elements, which act.

    That is the time step, the tolerance of its equations, and the panels on sides and ends of any
    model that has them, in proportion. What a model leaves out is no discretisation. In space it is
    the time step and the model: ``panels`` instead of ``strip`` and ``frozen``,
    with the scene's own rows and panels around. A policy can play it: actions and observations,
    their scales included, are those of the scene. It is a SceneError if a scene has so many panels
    that more are refused.
    """
    return list(finer_scenes(scene).values())[-1]


def finer_scenes(scene: Scene) -> dict[str, Scene]:
    """Return the scenes in which torques are played again; errors are those of `fine_scene`.

    For each of the scene's SOURCES that is the scene with nothing else refined, and last, where
    there are several, `fine_scene` under ``together``.
    """
    refined = _refinements(scene)
    if len(refined) > 1:
        everything: dict[str, object] = {}
        for changes in refined.values():
            everything |= changes
        refined["together"] = everything
    try:
        return {name: scene.replace(changes) for name, changes in refined.items()}
    except SceneError as error:
        raise SceneError(
            f"scene {scene.name} is too fine to be verified by a finer one: {error}"
        ) from None


def work_of(scene: Scene) -> float:
    """Return roughly how long a second of a scene takes to compute (s), to compare scenes by."""
    step = 1e-5
    if isinstance(scene, SpatialScene):
        step = 7e-5
        if scene.fluid is not None and scene.fluid.model == _FINE_MODEL:
            step += 3e-10 * scene.fluid.panels_in_all(scene.beam) ** 3
    elif scene.fluid is not None and scene.fluid.model in _PANELS_OF_SHAPES:
        panels = scene.beam.elements * scene.fluid.panels_per_element
        step += 2e-8 * panels**2 + 3e-11 * panels**3
    return step / scene.integrator.time_step


def work_of_check(scene: Scene) -> tuple[float, float]:
    """Return the same for the check of an episode: of its closed loop, and of its torques."""
    work = [work_of(one) for one in finer_scenes(scene).values()]
    return work[-1], sum(work)


def part_of(progress: Progress | None, share: float) -> Progress | None:
    """Return what reports the progress of a part that has this share of the work."""
    return None if progress is None else lambda done: progress(share * done)


def verify_rollout(
    rollout: Rollout,
    closed_loop: Rollout | None = None,
    tolerance: float = TOLERANCE,
    source_tolerance: float = SOURCE_TOLERANCE,
    progress: Progress | None = None,
) -> Verification:
    """Compare an episode with its torques, and its policy, in finer scenes.

    A displacement is verified if it changes by at most `source_tolerance` with any one source of
    error refined, and by at most `tolerance` with all of them refined and in the closed loop; a
    return, if it changes by at most `tolerance` in the closed loop. Where the task can succeed the
    closed loop must say the same of that, too. Of a target that alone counts, not how near it comes
    otherwise: torques without feedback miss what a policy hits. The energy of all that counts must
    add up to the scene's ``energy_tolerance``, and the physics must not have ended any of it: an
    episode that broke down proves nothing. Where a finer scene refuses the start, the episode ends
    there with the reason.

    Parameters
    ----------
    rollout : Rollout
        The episode.
    closed_loop : Rollout, optional
        The episode that its policy plays in the `fine_scene` from the same start. Without it, it is
        the torques alone that are verified, by their displacement in any task.
    tolerance, source_tolerance : float
        Shares of the score.
    progress : callable, optional
        Called with the share of the work that was done since its last call. Shares come to 1 where
        nothing ends early.

    Raises
    ------
    OptionError
        If the closed loop is of another scene, start or goal.
    SceneError
        If the scene cannot be refined.
    """
    scenes = finer_scenes(rollout.scene)
    fine = list(scenes.values())[-1]
    own, closed = _played(rollout), None
    if closed_loop is not None:
        _check_closed_loop(rollout, closed_loop, fine)
        closed = _played(closed_loop)
    replays = {}
    work = {name: work_of(scene) for name, scene in scenes.items()}
    for name, scene in scenes.items():
        report = part_of(progress, work[name] / sum(work.values()))
        if closed_loop is not None and scene == fine and _same_torques(rollout, closed_loop):
            replays[name] = _played(closed_loop)
            if report is not None:
                report(1.0)
        else:
            replays[name] = _replay(rollout, scene, report)
    together = list(replays.values())[-1]
    runs = {**replays, "together": together}
    if closed is not None:
        runs["closed_loop"] = closed
    changes = {name: _change(run.displacement, own.displacement) for name, run in runs.items()}
    if closed_loop is not None:
        changes["closed_loop"] = _change(closed_loop.score, rollout.score)

    task = rollout.task
    sources = SOURCES if fine.dimension == 2 else SPATIAL_SOURCES
    agrees, compared, counted = True, set(changes), [own, *runs.values()]
    if closed is not None:
        agrees = own.success == closed.success
        if task.ends_at_goal or not task.scored_by_displacement:
            counted = [own, closed]
            compared = set() if task.scored_by_displacement else {"closed_loop"}
    agrees = agrees and all(
        abs(changes[name]) <= (source_tolerance if name in sources else tolerance)
        for name in compared
    )
    limit = fine.integrator.energy_tolerance
    has_panels = fine.dimension == 2 and fine.fluid and FLUID_TABLE[fine.fluid.model].panels
    return Verification(
        net_displacement=own.displacement,
        fine_displacement=together.displacement,
        closed_displacement=closed and closed.displacement,
        changes=changes,
        verified=agrees and all(run.is_sound(limit) for run in counted),
        source_tolerance=source_tolerance,
        tolerance=tolerance,
        time_step=fine.integrator.time_step,
        panels_per_element=fine.fluid.panels_per_element if fine.fluid and has_panels else None,
        energy_drift=own.energy_drift,
        fine_energy_drift=max(run.energy_drift for run in replays.values()),
        closed_energy_drift=closed and closed.energy_drift,
        termination_reason=next((run.broken for run in (own, *replays.values()) if run.broken), ""),
        closed_termination_reason=closed and closed.termination_reason,
        fine_distance=together.distance,
        closed_distance=closed and closed.distance,
        closed_success=closed and closed.success,
        closed_return=None if closed_loop is None else float(closed_loop.rewards.sum()),
    )


def check_rollout(
    rollout: Rollout,
    play: Callable[[Scene, Progress | None], Rollout],
    progress: Progress | None = None,
) -> Verification:
    """Have a policy play its episode again in the `fine_scene`, and verify it by that as well.

    Parameters
    ----------
    rollout : Rollout
        The episode.
    play : callable
        Plays it in a scene, and calls what it is given with the number of actions since the last
        call.
    progress : callable, optional
        As for `verify_rollout`, with the work of playing.
    """
    work = work_of_check(rollout.scene)
    closed, again = (part_of(progress, one / sum(work)) for one in work)
    report = part_of(closed, 1.0 / rollout.scene.actions_per_episode)
    return verify_rollout(rollout, play(fine_scene(rollout.scene), report), progress=again)


def _check_closed_loop(rollout: Rollout, closed_loop: Rollout, fine: Scene) -> None:
    """Refuse an episode that is not the same one in the finer scene (OptionError)."""
    starts = ("coordinates", "velocity", "goal")
    differs = ["scene"] if closed_loop.scene != fine else []
    differs += ["task"] if closed_loop.task.name != rollout.task.name else []
    differs += [
        name
        for name in starts
        if not np.array_equal(getattr(rollout, name), getattr(closed_loop, name))
    ]
    if differs:
        raise OptionError(
            f"the closed loop must be played in the fine_scene of scene {rollout.scene.name}, from "
            f"the start and with the goal of the episode that it verifies: {differs[0]} differs"
        )


def _change(value: float, own: float) -> float:
    """Return by how much a value differs from the score, as a share of it."""
    gap = value - own
    if abs(gap) <= _NOTHING:
        return 0.0
    return gap / abs(own) if own else math.copysign(math.inf, gap)


def _distance(rollout: Rollout, path: Array) -> float | None:
    """Return how near a path (T, 2) (m) comes to an episode's target (BL), None without one."""
    if not rollout.task.has_target:
        return None
    return float(np.linalg.norm(path - rollout.goal, axis=1).min()) / rollout.scene.beam.length


def _played(rollout: Rollout) -> _Run:
    """Return an episode as it was played."""
    return _Run(
        rollout.net_displacement,
        float(rollout.info["energy_drift"]),
        rollout.info["termination_reason"],
        _distance(rollout, rollout.path),
        rollout.info.get("success"),
    )


def _replay(rollout: Rollout, scene: Scene, progress: Progress | None) -> _Run:
    """Play an episode's torques in another scene."""
    duration = rollout.steps * rollout.scene.integrator.time_step
    report = part_of(progress, scene.integrator.time_step / duration if rollout.steps else 0.0)
    try:
        run = rollout.simulate(scene, report)
    except SimulationEndedError as error:
        return _played(rollout.refused(scene, error.reason))
    return _Run(
        score(rollout, run.path[-1]),
        run.energy_drift,
        run.termination_reason,
        _distance(rollout, run.path),
    )


def _same_torques(rollout: Rollout, closed_loop: Rollout) -> bool:
    """Return whether a closed loop, as that of a wave, has played the torques again already."""
    lasted = [one.steps * one.scene.integrator.time_step for one in (rollout, closed_loop)]
    return math.isclose(*lasted) and np.array_equal(rollout.torques, closed_loop.torques)
