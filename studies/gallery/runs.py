"""What the gallery shows: the runs, played anew, and the stored curves of training."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from swim_agents.baselines import Policy
from swim_agents.comparison.contest import FIRST_SEED, REFERENCES
from swim_agents.learning.logs import read_log
from swim_agents.policies import PRETRAINED_FOLDER, load_policy
from swim_agents.rollout import Rollout, play_episode
from swim_agents.verification import check_rollout, work_of, work_of_check

from swim_env.envs.single import SwimEnv, SwimTargetEnv
from swim_env.errors import OptionError
from swim_env.physics.runtime.threads import usable_threads
from swim_env.scene import Scene, load_scene
from swim_env.sim.replay import replay
from swim_env.sim.trajectory import Trajectory

Curve = dict[str, list[float]]
#: Called with the simulated seconds since the last call.
Progress = Callable[[float], object]

SCENE = "swimmer"
#: The policies that swim forward, each shown at rising strength.
FORWARD = (*REFERENCES, "ppo_forward", "sac_forward")
TARGET = "ppo_target"
#: Scenes whose prescribed torques, or none, are played as in the paper's Figs. 4 and 8.
PAPER_SCENES = ("paper_i", "paper_xi")
#: Runs of other training seeds than the shipped agents', kept for the page about training.
_TRIED = Path(__file__).parents[2] / "docs" / "training" / "tried"


@dataclass(frozen=True)
class Plan:
    """How much is played."""

    #: Of the start's noise and of the target.
    seed: int = FIRST_SEED
    #: Of an episode (s), the scene's own where it is None, and of the paper's scenes (s).
    duration: float | None = None
    paper_duration: float = 100.0
    #: Factors on the torques of the runs of rising strength, the last of them 1.
    strengths: tuple[float, ...] = (0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 1.0)

    def __post_init__(self) -> None:
        """Refuse what cannot be played."""
        if self.seed < 0:
            raise OptionError(f"the seed must be a whole number of at least 0, got {self.seed}")

    def scene(self) -> Scene:
        """Return the scene that the policies play."""
        scene = load_scene(SCENE)
        if self.duration is not None:
            scene = scene.replace("episode.duration", self.duration)
        return scene

    def work(self) -> float:
        """Return roughly how long `play_all` takes on one core (s)."""
        scene = self.scene()
        each = work_of(scene) + sum(work_of_check(scene))
        episodes = work_of(scene) + each * len(FORWARD) * len(self.strengths)
        paper = sum(work_of(load_scene(name)) for name in PAPER_SCENES)
        return self.paper_duration * paper + scene.episode.duration * episodes


FULL = Plan()
QUICK = Plan(duration=1.2, paper_duration=4.0, strengths=(0.5, 1.0))


class Episode(NamedTuple):
    """A policy's episode, and the same motion with energy and work.

    The net displacement of its torques computed finer (BL), and whether it is verified, see
    `swim_agents.verify_rollout`, are None if unchecked.
    """

    rollout: Rollout
    trajectory: Trajectory
    fine_displacement: float | None = None
    verified: bool | None = None


class Runs(NamedTuple):
    """Everything that was played.

    The paper's scenes; of each policy that swims forward an episode for each strength of the plan;
    and the episode of the agent that swims to a target.
    """

    plan: Plan
    paper: dict[str, Trajectory]
    strengths: dict[str, list[Episode]]
    target: Episode

    @property
    def forward(self) -> dict[str, Episode]:
        """Of each policy that swims forward the episode at full strength."""
        return {name: episodes[-1] for name, episodes in self.strengths.items()}


class _Weaker:
    """A policy whose torques are a share of another's."""

    def __init__(self, policy: Policy, share: float) -> None:
        self._policy, self._share = policy, share

    def predict(self, *arguments: Any, **named: Any) -> tuple[NDArray[Any], Any]:
        """Return the share of the other's actions, and its state."""
        actions, state = self._policy.predict(*arguments, **named)
        return self._share * np.asarray(actions), state


def play_all(plan: Plan, progress: Progress) -> Runs:
    """Play everything that the gallery shows; progress is in shares of the work."""
    lock, total = threading.Lock(), plan.work()

    def every(work: float) -> Progress:
        """Return the progress of steps that take so long (s)."""

        def advance(steps: float) -> None:
            with lock:
                progress(steps * work / total)

        return advance

    def play(env: SwimEnv, policy: Policy, report: Progress | None = None) -> Rollout:
        with closing(env):
            work = work_of(env.scene) * env.scene.episode.control_interval
            return play_episode(env, policy, plan.seed, progress=report or every(work))

    def check(policy: Policy, rollout: Rollout) -> Episode:
        def again(finer: Scene, report: Progress | None) -> Rollout:
            return play(SwimEnv(finer), policy, report)

        work = sum(work_of_check(rollout.scene)) * rollout.scene.episode.duration
        found = check_rollout(rollout, again, every(work))
        return Episode(rollout, rollout.simulate(), found.fine_displacement, found.verified)

    paper = {}
    for name in PAPER_SCENES:
        driven = load_scene(name)
        report = every(work_of(driven) * driven.integrator.time_step)
        paper[name], _ = replay(driven, plan.paper_duration, report)
    scene = plan.scene()
    weaker: dict[str, list[_Weaker]] = {}
    rollouts: dict[str, list[Rollout]] = {}
    for name in FORWARD:
        policy = load_policy(name, scene, plan.seed, "forward")
        weaker[name] = [_Weaker(policy, share) for share in plan.strengths]
        rollouts[name] = [play(SwimEnv(scene), one) for one in weaker[name]]
    aiming = load_policy(TARGET, scene, plan.seed, "target")
    target = play(SwimTargetEnv(scene), aiming)
    # The kernels release the interpreter's lock.
    with ThreadPoolExecutor(usable_threads()) as pool:
        strengths = {
            name: list(pool.map(check, weaker[name], some)) for name, some in rollouts.items()
        }
    return Runs(plan, paper, strengths, Episode(target, target.simulate()))


def stored_curves() -> tuple[dict[str, list[Curve]], dict[str, list[Curve]]]:
    """Return the evaluations of the shipped agents' trainings and of their other seeds.

    For each agent, forward and with a target, that is the columns of its runs'
    ``evaluations.csv``; the other seeds are there only in a checkout.
    """

    def curves(name: str) -> list[Curve]:
        others = sorted(_TRIED.glob(f"{name}_seed_*/evaluations.csv"))
        return [read_log(path) for path in (PRETRAINED_FOLDER / name / "evaluations.csv", *others)]

    forward = {name: curves(name) for name in FORWARD if name not in REFERENCES}
    return forward, {TARGET: curves(TARGET)}
