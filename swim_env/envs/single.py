"""The single environments: one body behind Gymnasium's `Env`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from swim_env.envs.assessment import END_CODE
from swim_env.envs.interface import (
    RENDER_MODES,
    Observation,
    Overrides,
    SceneLike,
    SharedInterface,
    action_space_of,
    checked_seed,
    observation_space_of,
    task_of,
)
from swim_env.envs.tasks import TARGET_BEARING, TARGET_DISTANCE, TARGET_RADIUS, TaskLike
from swim_env.errors import SimulationEndedError
from swim_env.sim.trajectory import TrajectoryBase


class SwimEnv(SharedInterface, gymnasium.Env[Observation, NDArray[Any]]):
    r"""An elastic beam in an ideal fluid swims by its joint torques.

    ``gymnasium.make("swim_env/KirchhoffSwimmer-v0", scene="swimmer")``

    Observations, rewards and ends below are those of the task ``forward``. Other tasks are chosen
    by ``task``: a shipped one or one of your own, see docs/environments/tasks.md.

    ## Actions
    ``Box(-1, 1, (N - 1,), float32)``: the torque at every joint from head to tail, as a share of
    the scene's ``actuation.torque_limit`` (N m). A positive torque turns the element behind the
    joint counter-clockwise and the one in front of it clockwise. It is held over the scene's
    ``episode.control_interval``, several time steps of the integrator. Values beyond 1 count as 1;
    float64 actions are used in full precision. Joints behind ``actuation.active_until`` stay
    without torque.

    ## Observations
    ``Box((2 (N - 1) + 5,), float32)``. Nothing depends on where the body is. Values are scaled to
    order one and, except sine and cosine, clipped to ±100.

    | index        | quantity                                               | unit of 1     |
    |--------------|--------------------------------------------------------|---------------|
    | 0 ... N-2    | joint angles, head to tail                             | 0.1 rad       |
    | N-1 ... 2N-3 | joint rates                                            | 0.1 rad / t   |
    | 2N-2         | sine of the goal's direction from the head's, + = left | 1             |
    | 2N-1         | its cosine                                             | 1             |
    | 2N           | velocity of the mean centre, forward                   | 0.002 BL / t  |
    | 2N+1         | the same, to the left                                  | 0.002 BL / t  |
    | 2N+2         | mean turning rate of the elements, counter-clockwise   | 0.02 rad / t  |

    with t the control interval: 5 rad/s, 0.1 BL/s and 1 rad/s at 0.02 s.
    The head's direction is opposite to the mean angle of the elements; forward and left are along
    it and at a right angle to it.

    ## Rewards
    The displacement of the centre of mass along the scene's ``episode.heading`` in body lengths
    (BL): an episode's rewards sum to its net displacement. Two terms may be added, both zero
    unless weighted: ``-effort_weight * mean(share**2) * seconds`` with the torques' share of the
    limit, averaged over all joints, and ``-heading_weight * (1 - cos(heading error)) * seconds``.
    ``info`` holds each term with its sign: ``reward_progress``, ``reward_effort``,
    ``reward_heading``.

    ## Start
    The scene's initial state with a little noise from the seed: joint angles off by up to
    ``episode.bend_noise``, the body turned by up to ``episode.heading_noise``, a rigid motion of
    up to ``episode.velocity_noise``, all uniform. ``reset(options=...)`` takes ``noise``, a factor
    on all of it (0 for none), and the fields of a scene's ``initial`` block (``joint_angles``,
    ``heading``, ``velocity``, ``turning_rate``, ``position`` ...), which are then exact.

    ## End
    Truncated when the scene's ``episode.duration`` is over, or after ``max_episode_steps``.
    Terminated when the physics cannot continue; ``info["termination_reason"]`` is then one of
    ``swim_env.TERMINATION_REASONS``, and empty otherwise.

    ## Info
    The same keys from ``reset`` and ``step``: ``time`` (s), ``position`` of the mean centre (m),
    ``progress`` since the start (BL), the reward's terms, ``heading_error`` (rad), ``work`` and
    ``positive_work`` of the last action (J), ``termination_reason``, and the same as a number,
    ``termination_code``, whose meaning ``swim_env.TERMINATION_CODES`` tells.

    Parameters
    ----------
    scene : Scene, str, os.PathLike or mapping
        The scene, a shipped name, the path of a scene file, or what `Scene.to_dict` returns.
    overrides : optional
        Changes to it, see `swim_env.load_scene`.
    render_mode : {"rgb_array", "human"}, optional
        Frames from `render`, or a window.
    effort_weight, heading_weight : float
        Weights of the optional rewards (BL/s), at least 0.
    max_episode_steps : int, optional
        Number of actions in an episode; by default those of the scene's duration. `gymnasium.make`
        passes on its own argument of that name, -1 for episodes without end.
    num_threads : int, optional
        As for `SwimVectorEnv`; one body is stepped by one thread, whatever it is.
    task : str, type or Task
        A shipped name (a key of `swim_env.TASKS`), ``module:Class``, ``FILE.py:Class``, a subclass
        of `swim_env.Task`, or a task of the scene.
    task_options : mapping, optional
        Arguments of the task's class beside the scene.

    Raises
    ------
    SceneError
        If there is no such scene, or its control interval is not a whole number of time steps.
    TaskError
        If what the task's methods return cannot be used.
    OptionError
        If another argument cannot be used.

    Notes
    -----
    Version 0: first version.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 50}
    np_random: np.random.Generator

    def __init__(
        self,
        scene: SceneLike = "swimmer",
        overrides: Overrides | None = None,
        render_mode: str | None = None,
        effort_weight: float = 0.0,
        heading_weight: float = 0.0,
        max_episode_steps: int | None = None,
        num_threads: int | None = None,
        task: TaskLike = "forward",
        task_options: Mapping[str, Any] | None = None,
    ) -> None:
        made = task_of(task, scene, overrides, task_options, effort_weight, heading_weight)
        self._set_up_episodes(made, render_mode, num_threads, limit=max_episode_steps)
        self.action_space = action_space_of(made.scene)
        self.observation_space = observation_space_of(made)  # type: ignore[assignment]

    @property
    def coordinates(self) -> NDArray[np.float64]:
        """Minimal coordinates (N + 2,): mean centre (m), angle of element 1, joint angles (rad)."""
        return np.array(self.episodes.bodies.coordinates[0], dtype=np.float64)

    @property
    def velocity(self) -> NDArray[np.float64]:
        """Velocity (N + 2,) of the mean centre (m/s), and turning rates of the elements (rad/s)."""
        return np.array(self.episodes.bodies.velocities[0], dtype=np.float64)

    @property
    def steps(self) -> int:
        """Number of time steps since the start."""
        return int(self.episodes.bodies.steps_taken[0])

    @property
    def torques(self) -> NDArray[np.float64]:
        """Torques of the last action, (N - 1,) (N m)."""
        return np.array(self.episodes.torques[0, 0], dtype=np.float64)

    @property
    def goal(self) -> NDArray[np.float64]:
        """The direction of the episode, a unit vector (2,), or its target (m)."""
        return np.array(self.episodes.goals[0], dtype=np.float64)

    def recorded(self) -> TrajectoryBase:
        """Return the episode's trajectory so far, of a scene with the effect recording.

        Raises
        ------
        OptionError
            If the scene has no recording.
        """
        return self.episodes.recorded(0)

    # ---- Gymnasium's methods -------------------------------------------------------------------

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode.

        Parameters
        ----------
        seed : int, optional
            Seed of the start's noise; without one the present generator continues.
        options : mapping, optional
            See `SwimEnv`.

        Raises
        ------
        gymnasium.error.Error
            If the seed is not a whole number of at least 0.
        OptionError
            If an option cannot be used.
        SimulationEndedError
            If the start cannot be simulated. After any of these errors the running episode can
            be continued as if `reset` had not been called.
        """
        plan = self.task.plan_start(options)
        seed = checked_seed(seed)
        before = deepcopy((self._np_random, self._np_random_seed))
        super().reset(seed=seed)
        try:
            self.episodes.start(0, self.np_random, plan)
        except SimulationEndedError:
            self._np_random, self._np_random_seed = before
            raise
        self._forget_frames()
        self._show()
        return self.episodes.observations[0].copy(), self.episodes.info(0)

    def step(self, action: NDArray[Any]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Hold an action over one control interval.

        Raises
        ------
        ActionError
            If the action is not N - 1 finite numbers; the state is as before.
        gymnasium.error.ResetNeeded
            Before the first reset.
        SimulationEndedError
            If the episode was terminated before.
        """
        self._need_reset("step")
        episodes = self.episodes
        if episodes.counters[0, END_CODE]:
            reason = episodes.info(0)["termination_reason"]
            meaning = f"{episodes.meanings[reason]}; call reset to start again"
            raise SimulationEndedError(reason, float(episodes.times[0]), meaning)
        episodes.take(action, True, episodes.all_members)
        episodes.play(episodes.all_members)
        self._show()
        _, code, time_is_up = episodes.counters[0].tolist()
        return (
            episodes.observations[0].copy(),
            float(episodes.rewards[0]),
            code > 0,
            time_is_up > 0,
            episodes.info(0),
        )

    def close(self) -> None:
        """Close the window, if there is one. Closing twice does no harm."""
        self._close_viewer()

    def _generators(self) -> list[np.random.Generator]:
        return [self.np_random]


class SwimTargetEnv(SwimEnv):
    r"""The same swimmer has to reach a point, for which it has to turn.

    ``gymnasium.make("swim_env/KirchhoffSwimmerTarget-v0")``

    As `SwimEnv`, with these differences:

    - The goal's direction in the observation is the direction to the point, and one more number at
      the end is the point's distance from the mean centre in body lengths.
    - The reward is the distance by which the mean centre came closer, in body lengths.
    - Reaching the point ends the episode: terminated, ``termination_reason`` is
      ``target_reached``, ``success`` and ``is_success`` are true.
    - Every start draws a point. ``reset(options={"target": (x, y)})`` sets it (m).
    - ``info`` has ``target`` (m), ``distance`` (BL), ``success`` and ``is_success`` as well.

    Parameters
    ----------
    scene, overrides, render_mode, effort_weight, heading_weight, max_episode_steps, num_threads
        As for `SwimEnv`.
    target_distance : pair of float
        Least and largest distance of the point at the start (BL).
    target_bearing : float
        Largest angle between the scene's heading and the direction to the point (rad), up to pi.
    target_radius : float
        How close the mean centre has to come (BL).

    Raises
    ------
    SceneError, OptionError
        As for `SwimEnv`.
    """

    def __init__(
        self,
        scene: SceneLike = "swimmer",
        overrides: Overrides | None = None,
        render_mode: str | None = None,
        effort_weight: float = 0.0,
        heading_weight: float = 0.0,
        target_distance: Sequence[float] = TARGET_DISTANCE,
        target_bearing: float = TARGET_BEARING,
        target_radius: float = TARGET_RADIUS,
        max_episode_steps: int | None = None,
        num_threads: int | None = None,
    ) -> None:
        options = {
            "target_distance": target_distance,
            "target_bearing": target_bearing,
            "target_radius": target_radius,
        }
        super().__init__(
            scene,
            overrides,
            render_mode,
            effort_weight,
            heading_weight,
            max_episode_steps,
            num_threads,
            task="target",
            task_options=options,
        )
