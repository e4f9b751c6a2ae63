"""The Gymnasium interface shared by both environments: spaces, seeds, snapshots, rendering."""

from __future__ import annotations

import copy
import enum
import importlib
import os
import sys
from collections.abc import Iterable, Mapping
from types import NoneType
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from swim_env.envs.episodes import EnvSnapshot, Episodes, whole_number
from swim_env.envs.tasks import Task, TaskLike, make_task
from swim_env.errors import OptionError
from swim_env.scene import Scene, load_scene
from swim_env.scene.block import plain
from swim_env.scene.checks import got, nearest, whole

Observation = NDArray[np.float32]
RENDER_MODES = ("rgb_array", "human")

#: Largest number of threads.
MOST_THREADS = 1_000

#: Scenes of environments for which none is given, in the plane and in space.
DEFAULT_SCENES = ("swimmer", "eel_3d")

SceneLike = Scene | str | os.PathLike[str] | Mapping[str, Any]
Overrides = str | Iterable[str] | Mapping[str, object]


def action_space_of(scene: Scene) -> gymnasium.spaces.Box:
    """Return the space of actions, (n,) in [-1, 1], see `Scene.action_limits`."""
    return gymnasium.spaces.Box(-1.0, 1.0, scene.action_limits.shape, np.float32)


def observation_space_of(task: Task) -> gymnasium.spaces.Box:
    """Return the space of observations; see `SwimEnv`. It may be a TaskError."""
    low, high = task.layout.bounds()
    return gymnasium.spaces.Box(low, high, dtype=np.float32)


def task_of(
    task: TaskLike,
    scene: SceneLike,
    overrides: Overrides | None,
    options: Mapping[str, Any] | None,
    effort_weight: float,
    heading_weight: float,
) -> Task:
    """Return the task of an environment's arguments.

    A task that is made already brings its scene, unless another one than the default is given.
    """
    if isinstance(task, Task) and scene in DEFAULT_SCENES and overrides is None:
        scene = task.scene
    weights = {"effort_weight": effort_weight, "heading_weight": heading_weight}
    given = {name: one for name, one in weights.items() if type(one) not in (int, float) or one}
    if given and isinstance(options, (Mapping, NoneType)):
        options = {**(options or {}), **given}
    return make_task(task, load_scene(scene, overrides), options)


def checked_render_mode(mode: object) -> str | None:
    """Return a render mode that can be used.

    A mode that there is not is an OptionError, and Pillow that frames lack a SwimError.
    """
    if mode is None:
        return None
    if not isinstance(mode, str) or mode not in RENDER_MODES:
        hint = nearest(str(mode), RENDER_MODES)
        shown = got(mode) if isinstance(mode, np.ndarray) else repr(mode)
        raise OptionError(
            f"unknown render_mode {shown}{hint}; modes: {', '.join(RENDER_MODES)}, or None"
        )
    if mode == "rgb_array":
        importlib.import_module("swim_env.envs.render.drawing")
    return mode


def checked_seed(seed: int | np.integer[Any] | None, where: str = "") -> int | None:
    """Return a seed that Gymnasium takes; `where` begins the message if it does not.

    Raises
    ------
    gymnasium.error.Error
        If it is not a whole number of at least 0.
    """
    if seed is None:
        return None
    number = whole(seed)
    if number is None or number < 0:
        raise gymnasium.error.Error(
            f"{where}Seed must be a whole number of at least 0, got {got(seed)}"
        )
    return number


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
        Render modes, and frames per second: a frame lasts one control interval, in real time where
        that makes 1 to 240 frames a second; else there are 50, slower or faster than the body.
    """

    metadata: dict[str, Any]
    render_mode: str | None
    _spec: EnvSpec | None = None
    # Also where the constructor failed: gymnasium closes a batch when it is deleted.
    _viewer: Any = None

    def _set_up_episodes(
        self,
        task: Task,
        render_mode: str | None,
        num_threads: int | None,
        *,
        count: int = 1,
        limit: int | None = None,
    ) -> None:
        self.num_threads = (
            None if num_threads is None else whole_number(num_threads, "num_threads", MOST_THREADS)
        )
        self.render_mode = checked_render_mode(render_mode)
        self.task = task
        self.episodes = Episodes(task, count, limit)
        rate = round(1.0 / task.scene.episode.control_interval)
        if not 1 <= rate <= 240:
            rate = 50
        self.metadata = {"render_modes": list(RENDER_MODES), "render_fps": rate}

    @property
    def scene(self) -> Scene:
        """The scene."""
        return self.task.scene

    @property
    def spec(self) -> EnvSpec | None:
        """What Gymnasium made the environment of, as plain values; None without Gymnasium.

        Its ``max_episode_steps`` is the number of actions that an episode has; where that is the
        scene's own, ``kwargs`` has None for it. One that is set with such a number changes the
        episodes to it.
        """
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None:
            if not isinstance(spec, EnvSpec):
                raise OptionError(f"spec must be an EnvSpec of Gymnasium or None, got {got(spec)}")
            # What `make_vec` was given goes to the environment alone, beside a spec's own number.
            limit = spec.kwargs.get("max_episode_steps")
            of_another_scene = limit is None and "max_episode_steps" in spec.kwargs
            if not limit and not of_another_scene:
                limit = spec.max_episode_steps
            limit = limit or _limit_of_make(self.episodes, of_another_scene)
            if limit is not None:
                self.episodes.set_limit(limit)
            spec = copy.copy(spec)
            spec.max_episode_steps = self.episodes.limit
            spec.kwargs = _plain_arguments(spec.kwargs, self.scene)
            if self.episodes.limit_is_the_scenes:
                spec.kwargs["max_episode_steps"] = None
        self._spec = spec

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

        The number of actions in an episode is then the snapshot's, in later episodes too.

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
        if self._spec is not None and self._spec.max_episode_steps != self.episodes.limit:
            self._spec.max_episode_steps = self.episodes.limit
            self._spec.kwargs.pop("max_episode_steps", None)
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


def _limit_of_make(episodes: Episodes, of_another_scene: bool) -> int | None:
    """Return the limit that `gymnasium.make` has for the environment whose spec it is setting.

    It keeps the limit to itself and puts a `TimeLimit` around the environment, which can end an
    episode sooner than the environment does, but not later. What a spec tells of the scene that it
    was made for is refused if it is not so of the present one.
    """
    frame = sys._getframe(2)
    if frame.f_code is not gymnasium.envs.registration.make.__code__:
        return None
    given: int | None = frame.f_locals.get("max_episode_steps")
    registered = frame.f_locals.get("env_spec")
    if given is not None or registered is None:
        return given
    told: int | None = registered.max_episode_steps
    if not of_another_scene:
        return told
    if told not in (None, episodes.limit):
        raise OptionError(
            f"the spec has {told} actions in an episode, the number of the scene it was made for, "
            f"and scene {episodes.task.scene.name} has {episodes.limit} now: make it with "
            f"max_episode_steps={episodes.limit} (or the number that you want) as well"
        )
    return None


def _plain_arguments(arguments: Mapping[str, Any], scene: Scene) -> dict[str, Any]:
    """Return arguments of an environment as JSON has them, a scene that is no name in full."""
    found = dict(arguments)
    found.pop("max_episode_steps", None)  # the spec has it itself
    named = isinstance(found.get("scene", ""), str)
    if not named or not isinstance(found.get("overrides", ""), (str, list, Mapping, NoneType)):
        found["scene"] = scene
        found.pop("overrides", None)
    return {name: _as_json(value) for name, value in found.items()}


def _as_json(value: Any) -> Any:
    """Return a value of an argument as JSON has it, as far as it is one that can be used."""
    if isinstance(value, Scene):
        return value.to_dict()
    if isinstance(value, type) and issubclass(value, Task):
        return value.name
    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, Mapping):
        return {name: _as_json(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_as_json(item) for item in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    return plain(value)


def _warn_of_no_render_mode(env: Any) -> None:
    """Warn as Gymnasium's own environments do of `render` without a mode."""
    how = f"{type(env).__name__}(render_mode='rgb_array')"
    if env.spec is not None:
        make = "make" if isinstance(env, gymnasium.Env) else "make_vec"
        how = f"gymnasium.{make}({env.spec.id!r}, render_mode='rgb_array')"
    gymnasium.logger.warn(f"render was called without a render mode; give one, as in {how}")
