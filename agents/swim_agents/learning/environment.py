"""Builds the batched environment of a training run."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from swim_agents.learning.config import TrainingConfig
from swim_agents.learning.smoothing import Smoothing
from swim_agents.vec_env import SwimVecEnv
from swim_env.envs.episodes import EnvSnapshot
from swim_env.envs.vector import SwimVectorEnv

# After swim_agents.vec_env, which says in one line what is missing where this is not installed.
from stable_baselines3.common.running_mean_std import RunningMeanStd  # isort: skip
from stable_baselines3.common.vec_env import VecEnvWrapper, VecMonitor  # isort: skip

__all__ = ["TrainingEnv", "make_batch", "make_training_env"]

#: What a running standard deviation consists of; and what is added to its square, so that the
#: first rewards, before it is known, are not divided by nothing.
_SPREAD = ("mean", "var", "count")
_SMALL = 1e-8


def make_batch(
    config: TrainingConfig,
    members: int,
    threads: int | None = None,
    mode: AutoresetMode = AutoresetMode.SAME_STEP,
) -> SwimVectorEnv:
    """Make a batch of a configuration's scene and task."""
    return SwimVectorEnv(
        members,
        config.scene,
        autoreset_mode=mode,
        num_threads=threads,
        task=config.task,
        task_options=config.environment,
    )


class TrainingEnv(VecEnvWrapper):  # type: ignore[misc]
    """A batch with rewards scaled and actions smoothed for the learner, whose state can be saved.

    Episode statistics in the infos are those of the unscaled rewards.

    Without a `reward_scale` rewards are divided by the running standard deviation of the return
    with that discount, which is the scale of what a critic has to learn.
    """

    def __init__(
        self,
        venv: VecMonitor,
        reward_scale: float | None = None,
        discount: float = 0.99,
        action_smoothing: float | None = None,
    ) -> None:
        super().__init__(venv)
        self.reward_scale = reward_scale
        self.discount = discount
        self.smoothing = Smoothing(self.batch.scene, action_smoothing)
        self._spread = RunningMeanStd(shape=())
        self._returns = np.zeros(self.num_envs)

    @property
    def batch(self) -> SwimVectorEnv:
        """The batched environment inside."""
        env: SwimVectorEnv = self.venv.venv.batch
        return env

    def reset(self) -> NDArray[np.float32]:
        """Start all members; returns observations, (M, n)."""
        observations: NDArray[np.float32] = self.venv.reset()
        self._returns[:] = 0.0
        return observations

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Keep actions, (M, N - 1), smoothed, for `step_wait`."""
        self.venv.step_async(self.smoothing(actions))

    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Return what the batch returns, the rewards scaled."""
        observations, rewards, dones, infos = self.venv.step_wait()
        return observations, rewards * np.float32(self._scale(rewards, dones)), dones, infos

    def _scale(self, rewards: NDArray[np.float32], dones: NDArray[np.bool_]) -> float:
        if self.reward_scale is not None:
            return self.reward_scale
        self._returns = self._returns * self.discount + rewards
        self._spread.update(self._returns)
        self._returns[dones] = 0.0
        return 1.0 / float(np.sqrt(self._spread.var + _SMALL))

    def state(self) -> dict[str, Any]:
        """Return everything the episodes need to continue, as arrays and plain values."""
        snapshot = self.batch.snapshot()
        return {
            "arrays": snapshot.arrays,
            "randoms": snapshot.randoms,
            "returns": self.venv.episode_returns.copy(),
            "lengths": self.venv.episode_lengths.copy(),
            "count": self.venv.episode_count,
            "discounted_returns": self._returns.copy(),
            "spread": [float(getattr(self._spread, name)) for name in _SPREAD],
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        self.venv.reset()  # gives every member a generator, whose state is then replaced
        task = self.batch.episodes.task.identity
        self.batch.restore(EnvSnapshot(task, state["arrays"], state["randoms"]))
        self.venv.episode_returns = state["returns"].copy()
        self.venv.episode_lengths = state["lengths"].copy()
        self.venv.episode_count = state["count"]
        self._returns = state["discounted_returns"].copy()
        for name, value in zip(_SPREAD, state["spread"], strict=True):
            setattr(self._spread, name, np.float64(value))


def make_training_env(config: TrainingConfig, seed: int, threads: int | None = None) -> TrainingEnv:
    """Make the batch that a training run plays in; the results do not depend on the threads.

    Member i is seeded with ``seed * members + i``, so runs with different seeds share no start.
    """
    venv = SwimVecEnv(make_batch(config, config.members, threads))
    venv.seed(seed * config.members)
    return TrainingEnv(
        VecMonitor(venv), config.reward_scale, config.discount, config.action_smoothing
    )
