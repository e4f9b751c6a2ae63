"""What the single and the batched environment have in common on Gymnasium's side."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from swim_env.envs.assessment import OBSERVATION_LIMIT
from swim_env.envs.episodes import Episodes, EpisodesSnapshot
from swim_env.envs.task import Task
from swim_env.errors import OptionError, SwimError
from swim_env.scene import Scene
from swim_env.scene.checks import nearest

__all__ = [
    "RENDER_MODES",
    "EnvSnapshot",
    "Observation",
    "Overrides",
    "SceneLike",
    "action_space_of",
    "checked_render_mode",
    "checked_seed",
    "checked_snapshot",
    "metadata_of",
    "new_viewer",
    "observation_space_of",
    "warn_of_no_render_mode",
]

Observation = NDArray[np.float32]
RENDER_MODES = ("rgb_array", "human")

SceneLike = Scene | str | os.PathLike[str]
Overrides = str | Iterable[str] | Mapping[str, object]


@dataclass(frozen=True)
class EnvSnapshot:
    """An environment's complete state; a restored one continues bit for bit.

    Attributes
    ----------
    episodes : EpisodesSnapshot
        The episode and the random numbers to come.
    is_reset : bool
        Whether there was an episode.
    """

    episodes: EpisodesSnapshot
    is_reset: bool


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
    """Return a render mode that there is.

    Raises
    ------
    OptionError
        If there is no such mode.
    """
    if mode is not None and mode not in RENDER_MODES:
        hint = nearest(str(mode), RENDER_MODES)
        raise OptionError(
            f"unknown render_mode {mode!r}{hint}; modes: {', '.join(RENDER_MODES)}, or None"
        )
    return mode


def checked_snapshot(snapshot: object) -> EnvSnapshot:
    """Return what was made by `snapshot`.

    Raises
    ------
    SwimError
        If it is anything else.
    """
    if not isinstance(snapshot, EnvSnapshot):
        raise SwimError(f"restore needs what snapshot returned, got {type(snapshot).__name__}")
    return snapshot


def new_viewer(episodes: Episodes, metadata: Mapping[str, Any]) -> Any:
    """Return what shows episodes; imported here, since most environments are never rendered."""
    from swim_env.envs.render.live import EpisodesViewer

    return EpisodesViewer(episodes, metadata["render_fps"])


def warn_of_no_render_mode(
    env: gymnasium.Env[Any, Any] | gymnasium.vector.VectorEnv[Any, Any, Any],
) -> None:
    """Warn as Gymnasium's own environments do of `render` without a mode."""
    how = f"{type(env).__name__}(render_mode='rgb_array')"
    if env.spec is not None:
        make = "make" if isinstance(env, gymnasium.Env) else "make_vec"
        how = f"gymnasium.{make}({env.spec.id!r}, render_mode='rgb_array')"
    gymnasium.logger.warn(f"render was called without a render mode; give one, as in {how}")


def checked_seed(seed: int | None, where: str = "") -> int | None:
    """Return a seed that Gymnasium takes; `where` begins the message if it does not.

    Raises
    ------
    gymnasium.error.Error
        If it is not a whole number of at least 0.
    """
    if isinstance(seed, bool):
        raise gymnasium.error.Error(f"{where}Seed must be a whole number of at least 0, got {seed}")
    if seed is not None:
        try:
            seeding.np_random(seed)
        except gymnasium.error.Error as error:
            raise gymnasium.error.Error(f"{where}{error}") from None
    return seed


def metadata_of(task: Task) -> dict[str, Any]:
    """Return an environment's metadata; a frame stands for one control interval."""
    interval = task.scene.episode.control_interval
    return {"render_modes": list(RENDER_MODES), "render_fps": max(1, round(1.0 / interval))}
