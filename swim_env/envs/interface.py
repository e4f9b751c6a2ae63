"""The Gymnasium interface shared by both environments: spaces, seeds, snapshots, rendering."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from swim_env.envs.assessment import OBSERVATION_LIMIT
from swim_env.envs.episodes import EnvSnapshot, Episodes
from swim_env.envs.task import Task
from swim_env.errors import OptionError
from swim_env.scene import Scene
from swim_env.scene.checks import nearest

Observation = NDArray[np.float32]
RENDER_MODES = ("rgb_array", "human")

SceneLike = Scene | str | os.PathLike[str]
Overrides = str | Iterable[str] | Mapping[str, object]


def action_space_of(task: Task) -> gymnasium.spaces.Box:
    """Return the space of actions, (N - 1,) in [-1, 1]."""
    joints = task.scene.beam.elements - 1
    return gymnasium.spaces.Box(-1.0, 1.0, (joints,), np.float32)


def observation_space_of(task: Task) -> gymnasium.spaces.Box:
    """Return the space of observations; see `SwimEnv`."""
    high = np.full(task.observation_size, OBSERVATION_LIMIT, dtype=np.float32)
    at = 2 * (task.scene.beam.elements - 1)
    high[at : at + 2] = 1.0
    low = -high
    if task.goal_is_point:
        low[-1] = 0.0
    return gymnasium.spaces.Box(low, high, dtype=np.float32)


def checked_render_mode(mode: str | None) -> str | None:
    """Return a render mode, or raise OptionError if there is no such mode."""
    if mode is not None and mode not in RENDER_MODES:
        hint = nearest(str(mode), RENDER_MODES)
        raise OptionError(
            f"unknown render_mode {mode!r}{hint}; modes: {', '.join(RENDER_MODES)}, or None"
        )
    return mode


def checked_seed(seed: int | np.integer[Any] | None, where: str = "") -> int | None:
    """Return a seed that Gymnasium takes; `where` begins the message if it does not.

    Raises
    ------
    gymnasium.error.Error
        If it is not a whole number of at least 0.
    """
    if isinstance(seed, bool):
        raise gymnasium.error.Error(f"{where}Seed must be a whole number of at least 0, got {seed}")
    if seed is not None:
        if isinstance(seed, np.integer):
            seed = int(seed)
        try:
            seeding.np_random(seed)
        except gymnasium.error.Error as error:
            raise gymnasium.error.Error(f"{where}{error}") from None
    return seed


class SharedInterface:
    """What `SwimEnv` and `SwimVectorEnv` have in common.

    Attributes
    ----------
    task : Task
        What the episodes are about.
    episodes : Episodes
        The episodes and the bodies in them.
    render_mode : str or None
        See `SwimEnv`.
    metadata : dict
        Render modes, and frames per second: a frame lasts one control interval.
    """

    metadata: dict[str, Any]
    render_mode: str | None

    def _set_up_episodes(
        self, task: Task, render_mode: str | None, *, count: int = 1, limit: int | None = None
    ) -> None:
        self.render_mode = checked_render_mode(render_mode)
        self.task = task
        self.episodes = Episodes(task, count, limit)
        rate = max(1, round(1.0 / task.scene.episode.control_interval))
        self.metadata = {"render_modes": list(RENDER_MODES), "render_fps": rate}
        self._viewer: Any = None

    @property
    def scene(self) -> Scene:
        """The scene."""
        return self.task.scene

    def render(self) -> Any:
        """Return a frame, (height, width, 3) uint8, or a batch's tuple of them, or show a window.

        The camera and the trail follow what was rendered since the last reset, and rendering
        changes nothing of the episode. In "human" mode `reset` and `step` render by themselves,
        the window keeps to real time, and nothing is shown where there is no display or once the
        window was closed. Of a batch the window shows member 0; for all members in one window,
        wrap an "rgb_array" environment in `gymnasium.wrappers.vector.HumanRendering`, which needs
        opencv.

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before the first reset.
        SwimError
            If a package that drawing needs is not installed.
        """
        if self.render_mode is None:
            _warn_of_no_render_mode(self)
            return None
        self._need_reset("render")
        if self._viewer is None:
            # Most environments are never rendered.
            from swim_env.envs.render.live import EpisodesViewer

            self._viewer = EpisodesViewer(self.episodes, self.metadata["render_fps"])
        if self.render_mode == "human":
            return self._viewer.show()
        return self._own(self._viewer.frames())

    def snapshot(self) -> EnvSnapshot:
        """Return the complete state: bodies, episodes and random numbers to come.

        Raises
        ------
        SwimError
            If a batch was not reset before.
        """
        return self.episodes.snapshot(self._generators())

    def restore(self, snapshot: EnvSnapshot) -> Observation:
        """Go back to a snapshot; what follows is bit for bit what followed then.

        Returns
        -------
        (n,) or (M, n) array of float32
            The observation at that moment, of a batch those of all members.

        Raises
        ------
        SwimError
            If the snapshot belongs to another scene, task or number of members, or if a batch was
            not reset before.
        """
        self.episodes.restore(snapshot, self._generators())
        self._forget_frames()
        observations: Observation = self._own(self.episodes.observations.copy())
        return observations

    def _generators(self) -> list[np.random.Generator]:
        """Return the members' random number generators."""
        raise NotImplementedError

    def _own(self, values: Any) -> Any:
        """Return all members' values of a batch, the only one's of a single environment."""
        return values if isinstance(self, gymnasium.vector.VectorEnv) else values[0]

    def _need_reset(self, before: str) -> None:
        if not self.episodes.is_reset:
            raise gymnasium.error.ResetNeeded(f"call reset before {before}")

    def _show(self) -> None:
        if self.render_mode == "human":
            self.render()

    def _forget_frames(self, member: int | None = None) -> None:
        if self._viewer is not None:
            self._viewer.forget(member)

    def _close_viewer(self) -> None:
        if self._viewer is not None:
            self._viewer.close()
            self._viewer = None


def _warn_of_no_render_mode(env: Any) -> None:
    """Warn as Gymnasium's own environments do of `render` without a mode."""
    how = f"{type(env).__name__}(render_mode='rgb_array')"
    if env.spec is not None:
        make = "make" if isinstance(env, gymnasium.Env) else "make_vec"
        how = f"gymnasium.{make}({env.spec.id!r}, render_mode='rgb_array')"
    gymnasium.logger.warn(f"render was called without a render mode; give one, as in {how}")
