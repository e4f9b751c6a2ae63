"""Playing episodes, one or many side by side, and what is needed to replay them."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from swim_agents.baselines import Policy
from swim_env.envs.episodes import Episodes
from swim_env.envs.single import SwimEnv
from swim_env.envs.tasks import Start, Task
from swim_env.envs.vector import SwimVectorEnv
from swim_env.errors import OptionError, SimulationEndedError
from swim_env.scene import Scene
from swim_env.sim.simulator import Simulator
from swim_env.sim.trajectory import Trajectory

if TYPE_CHECKING:
    from swim_env.recording import Swimmer

__all__ = ["Rollout", "play_episode", "play_episodes", "score"]

Array = NDArray[np.float64]

#: A net displacement (BL) that nothing is compared with: multiples of it say nothing.
_NOWHERE = 1e-3


@dataclass(frozen=True, eq=False)
class Rollout:
    """An episode of T actions.

    Vectors have D = 2 components in the plane and 3 in space.

    Attributes
    ----------
    scene : Scene
        The scene.
    seed : int or None
        Seed of the start.
    coordinates, velocity : (N + 2,) arrays, in space (4 N + 3,) and (3 N + 3,)
        The start, as for `Simulator.reset_to`.
    goal : (D,) array
        The goal at the start: a direction, or a point (m).
    task : Task
        What it was about.
    drawn : dict
        What the task has drawn of its own state at the start.
    torques : (T, N - 1) array, in space (T, N - 1, 3)
        Torques held over each control interval (N m).
    steps : int
        Time steps that were taken; fewer than the torques cover where the episode ended within an
        action.
    rewards : (T,) array
        Rewards.
    path : (T + 1, D) array
        Mean element centre after each action (m).
    info : dict
        The last info.
    terminated, truncated : bool
        How it ended.
    """

    scene: Scene
    seed: int | None
    coordinates: Array
    velocity: Array
    goal: Array
    task: Task
    drawn: dict[str, Any]
    torques: Array
    steps: int
    rewards: Array
    path: Array
    info: dict[str, Any]
    terminated: bool
    truncated: bool

    @property
    def goal_is_point(self) -> bool:
        """Whether the goal is a point."""
        return self.task.goal_is_point

    @property
    def score(self) -> float:
        """The score, `Task.score_name`: the net displacement, or the sum of the rewards."""
        if self.task.scored_by_displacement:
            return self.net_displacement
        return float(self.rewards.sum())

    @property
    def net_displacement(self) -> float:
        """Net displacement along the task's `displacement_aim`, or towards it (BL)."""
        return score(self, self.path[-1])

    def simulate(
        self, scene: Scene | None = None, progress: Callable[[int], object] | None = None
    ) -> Trajectory:
        """Play the torques again in the simulator, each for as long as it was held.

        In the same scene, which is the default, the motion is the episode's to the bit; another one
        with the same body and control interval may have a smaller time step, for example.
        `progress` is called with the number of steps taken since its last call.

        Raises
        ------
        OptionError
            If the body or the control interval is another one.
        """
        played = self.scene if scene is None else scene
        for field in ("beam", "episode.control_interval"):
            own, other = (operator.attrgetter(field)(one) for one in (self.scene, played))
            if own != other:
                raise OptionError(
                    f"an episode of scene {self.scene.name} cannot be played again in scene "
                    f"{played.name}: {field} differs"
                )
        simulator = Simulator(played)
        simulator.reset_to(self.coordinates, self.velocity)
        hold = played.steps_per_action
        steps = self.steps * hold // self.scene.steps_per_action
        return simulator.rollout(np.repeat(self.torques, hold, axis=0)[:steps], progress)

    def refused(self, scene: Scene, reason: str) -> Rollout:
        """Return the episode of another scene in which this start cannot be simulated.

        It ends for this reason, one of `swim_env.TERMINATION_REASONS`, before the first action.
        """
        return replace(
            self,
            scene=scene,
            torques=self.torques[:0],
            steps=0,
            rewards=self.rewards[:0],
            path=self.path[:1],
            info={
                **dict.fromkeys(self.info.keys() & {"success", "is_success"}, False),
                "termination_reason": reason,
                "energy_drift": 0.0,
            },
            terminated=True,
            truncated=False,
        )

    def swimmer(self, name: str, trajectory: Trajectory | None = None) -> Swimmer:
        """Return the episode for a recording.

        Its torques are played again unless its motion is given (another scene's is an
        OptionError).
        """
        from swim_env.recording import Swimmer

        return Swimmer(
            name,
            self.simulate() if trajectory is None else self.own(trajectory),
            self.rewards,
            self.task.displacement_aim(self.goal),
            self.task.radius if self.task.has_target else None,
            # With it the energy is split between body and fluid, which is for the plane only.
            self.velocity if self.scene.dimension == 2 else None,
        )

    def own(self, trajectory: Trajectory) -> Trajectory:
        """Return a trajectory if it can be this episode's, else raise OptionError."""
        if trajectory.scene != self.scene or trajectory.steps != self.steps:
            raise OptionError(
                f"a trajectory of {trajectory.steps} steps of scene {trajectory.scene.name} is not "
                f"that of an episode of {self.steps} steps of scene {self.scene.name}, or the "
                "scenes differ"
            )
        return trajectory


def score(rollout: Rollout, position: Array) -> float:
    """Return how far a position is from the start along the task's aim, or towards it (BL)."""
    start, length = rollout.path[0], rollout.scene.beam.length
    aim = rollout.task.displacement_aim(rollout.goal)
    if rollout.task.has_target:
        before, after = (float(np.hypot.reduce(aim - at)) for at in (start, position))
        return (before - after) / length
    return float((position - start) @ aim) / length


def ratio(value: float | None, base: float | None) -> float | None:
    """Return a net displacement over another one (BL), None where that got nowhere or backwards."""
    if value is None or base is None or base < _NOWHERE:
        return None
    return value / base


class _EpisodeLog:
    """What is kept of a member's episode while it is played, from its reset on."""

    def __init__(self, episodes: Episodes, member: int, seed: int | None, position: Array) -> None:
        self._episodes, self._member = episodes, member
        self._start: dict[str, Any] = {
            "scene": episodes.task.scene,
            "seed": seed,
            "coordinates": episodes.bodies.coordinates[member].copy(),
            "velocity": episodes.bodies.velocities[member].copy(),
            "goal": episodes.goals[member].copy(),
            "task": episodes.task,
            "drawn": episodes.drawn(member),
        }
        self._torques: list[Array] = []
        self._rewards: list[float] = []
        self._path = [position.copy()]

    def add(self, reward: Any, position: Array) -> None:
        """Keep an action that was played, with its reward and the mean centre after it (m)."""
        self._torques.append(self._episodes.torques[self._member, 0].copy())
        self._rewards.append(float(reward))
        self._path.append(position.copy())

    def rollout(self, info: dict[str, Any], terminated: bool, truncated: bool) -> Rollout:
        """Return the episode, which has just ended."""
        return Rollout(
            **self._start,
            torques=np.array(self._torques),
            steps=int(self._episodes.bodies.steps_taken[self._member]),
            rewards=np.array(self._rewards),
            path=np.array(self._path),
            info=info,
            terminated=bool(terminated),
            truncated=bool(truncated),
        )


def play_episode(
    env: gymnasium.Env[Any, Any],
    policy: Policy,
    seed: int | None = None,
    options: Mapping[str, Any] | None = None,
    deterministic: bool = True,
    progress: Callable[[int], object] | None = None,
    any_scene: bool = False,
) -> Rollout:
    """Play one episode.

    Parameters
    ----------
    env : gymnasium.Env
        A `SwimEnv` (another one is an OptionError), with or without wrappers that leave
        observations and actions alone.
    policy : Policy
        The policy.
    seed, options : optional
        For the reset.
    deterministic : bool
        Whether to leave exploration out.
    progress : callable, optional
        Called with 1 after every action.
    any_scene : bool
        Whether to play a policy on a scene that it was not made for. Otherwise its `check`, where
        it has one, refuses another body, torque limit or control interval, and for a tuned wave
        another fluid or damping.
    """
    swimmer = env.unwrapped
    if not isinstance(swimmer, SwimEnv):
        raise OptionError(f"play_episode needs a SwimEnv, got {type(swimmer).__name__}")
    if not any_scene:
        check_policy(policy, swimmer.task)
    observation, info = env.reset(seed=seed, options=None if options is None else dict(options))
    log = _EpisodeLog(swimmer.episodes, 0, seed, info["position"])
    state: Any = None
    terminated = truncated = False
    start = np.ones(1, dtype=np.bool_)
    while not (terminated or truncated):
        action, state = policy.predict(observation, state, start, deterministic)
        observation, reward, terminated, truncated, info = env.step(action)
        start = np.zeros(1, dtype=np.bool_)
        log.add(reward, info["position"])
        if progress is not None:
            progress(1)
    return log.rollout(info, terminated, truncated)


def check_policy(policy: Policy, task: Task) -> None:
    """Let a policy refuse a scene or a task that it was not made for, where it has a `check`."""
    check = getattr(policy, "check", None)
    if check is not None:
        check(task.scene, task.name)


def _check_starts(starts: Sequence[Rollout], task: Task, count: int) -> None:
    """Refuse starts (OptionError) of another number, kind of goal or body than a batch's."""
    if len(starts) != count:
        raise OptionError(f"starts must be {count} episodes, one for each seed, got {len(starts)}")
    for number, start in enumerate(starts):
        if start.goal_is_point != task.goal_is_point:
            goals = ["a direction", "a point"]
            raise OptionError(
                f"starts[{number}] must be an episode whose goal is {goals[task.goal_is_point]}, "
                f"got one whose goal is {goals[start.goal_is_point]}"
            )
        if start.scene.beam != task.scene.beam:
            raise OptionError(
                f"starts[{number}], an episode of scene {start.scene.name}, cannot begin in scene "
                f"{task.scene.name}: beam differs"
            )


def _begin_like(episodes: Episodes, member: int, start: Rollout) -> str:
    """Put a member where an episode began, or return why it cannot be simulated there."""
    try:
        state = episodes.bodies.prepared(member, start.coordinates, start.velocity)
    except SimulationEndedError as error:
        return error.reason
    begun = Start(start.coordinates, start.velocity, start.goal, start.drawn)
    episodes.begin(member, begun, state)
    return ""


def play_episodes(
    env: SwimVectorEnv,
    policy: Policy,
    seeds: Sequence[int],
    options: Mapping[str, Any] | None = None,
    deterministic: bool = True,
    progress: Callable[[int], object] | None = None,
    any_scene: bool = False,
    starts: Sequence[Rollout] | None = None,
) -> list[Rollout]:
    """Play one episode for each seed, in a batch of as many members and mode NEXT_STEP.

    Arguments and errors are those of `play_episode`; progress counts the batch's actions. With the
    same actions an episode is bit for bit the one that `play_episode` plays. The actions of a
    network can differ from those in the last digit, since a product of matrices may round otherwise
    for a batch.

    With `starts`, the episodes of these seeds in another scene, each begins exactly as that one
    did, whatever the options and what this scene would draw; one whose pose the physics refuses
    here is its `Rollout.refused`. It is an OptionError if they are not as many as the seeds, or of
    another task or body.
    """
    if not isinstance(env, SwimVectorEnv):
        raise OptionError(f"play_episodes needs a SwimVectorEnv, got {type(env).__name__}")
    if not any_scene:
        check_policy(policy, env.task)
    count = len(seeds)
    if env.num_envs != count or env.autoreset_mode is not AutoresetMode.NEXT_STEP:
        raise OptionError(
            f"play_episodes needs a batch of {count} members in mode NextStep, got "
            f"{env.num_envs} in mode {env.autoreset_mode.value}"
        )
    if starts is not None:
        _check_starts(starts, env.task, count)
        options = {"noise": 0.0}  # what is drawn with noise may be refused
    observations, infos = env.reset(
        seed=list(seeds), options=None if options is None else dict(options)
    )
    episodes = env.episodes
    ended: dict[int, Rollout] = {}
    if starts is not None:
        for member, start in enumerate(starts):
            reason = _begin_like(episodes, member, start)
            if reason:
                ended[member] = start.refused(env.task.scene, reason)
        observations, *_, infos = episodes.results()
    logs = [
        _EpisodeLog(episodes, member, int(seed), infos["position"][member])
        for member, seed in enumerate(seeds)
    ]
    state: Any = None
    beginning = np.ones(count, dtype=np.bool_)
    while len(ended) < count:
        actions, state = policy.predict(observations, state, beginning, deterministic)
        observations, rewards, terminated, truncated, infos = env.step(actions)
        beginning = np.zeros(count, dtype=np.bool_)
        for member, log in enumerate(logs):
            if member in ended:
                continue
            log.add(rewards[member], infos["position"][member])
            ends = terminated[member], truncated[member]
            if any(ends):
                ended[member] = log.rollout(episodes.info(member), *ends)
        if progress is not None:
            progress(1)
    return [ended[member] for member in range(count)]
