"""Smoothing of actions along the body.

Noise that is independent at every joint hardly moves the bending modes, the less so the more joints
there are, so a learner that explores with it learns little. Smoothed, it bends the body, and so do
the actions that are learned.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.scene import Scene
from swim_env.scene.checks import real

Actions = NDArray[np.float32]

#: Check of a width (BL).
WIDTH = real(above=0.0, at_most=10.0)


class Smoothing:
    """Weighted sums of actions over neighbouring joints, with Gaussian weights, cut off at 1.

    The squares of a joint's weights sum to 1: independent noise keeps its size.

    Parameters
    ----------
    scene : Scene
        Whose actions they are: joints are evenly spaced between the ends of the body, and every
        axis of theirs is smoothed by itself.
    width : float or None
        Standard deviation of the weights (BL); None leaves actions as they are.
    """

    def __init__(self, scene: Scene, width: float | None) -> None:
        self._weights: Actions | None = None
        if width is not None:
            joints = scene.joints
            place = np.arange(joints) / (joints + 1)
            weights = np.exp(-0.5 * ((place[:, None] - place) / width) ** 2)
            weights /= np.linalg.norm(weights, axis=1, keepdims=True)
            axes = np.eye(len(scene.action_places) // joints)
            self._weights = np.kron(weights, axes).astype(np.float32)

    def __call__(self, actions: Actions) -> Actions:
        """Return smoothed actions, (n,) or (M, n), between -1 and 1."""
        if self._weights is None:
            return actions
        smooth: Actions = np.clip(actions @ self._weights.T, -1.0, 1.0)
        return smooth


class SmoothedPolicy:
    """A policy whose actions are smoothed, with the same `predict` call."""

    def __init__(self, policy: Any, smoothing: Smoothing) -> None:
        self._policy, self._smoothing = policy, smoothing
        self.observation_space = policy.observation_space

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[Actions, Any]:
        """Return smoothed actions, (n,) or (M, n), and no state."""
        actions, _ = self._policy.predict(observation, deterministic=deterministic)
        return self._smoothing(actions), None
