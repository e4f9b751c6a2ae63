"""Policies that learn nothing: the paper's wave, the tuned wave, no torque, random torques.

Each has the `predict` call of a model of stable-baselines3, for one observation or a batch, and
depends on nothing but the clock, which is passed on in `state` as for a recurrent model.
"""

from __future__ import annotations

import os
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_agents.fit import TUNED_FIELDS, difference
from swim_agents.tuned_wave import find_tuned_wave, load_tuned_wave, wave_on
from swim_env.errors import OptionError
from swim_env.scene import Actuation, Scene

__all__ = [
    "POLICY_NAMES",
    "Policy",
    "RandomPolicy",
    "WavePolicy",
    "ZeroPolicy",
    "paper_wave",
    "tuned_wave",
]

Array = NDArray[np.float64]

#: Names that `load_policy` knows.
POLICY_NAMES = ("paper_wave", "tuned_wave", "zero", "random")


class Policy(Protocol):
    """A policy: anything with the `predict` call that models of stable-baselines3 have."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Return actions, and the state to pass to the next call.

        Parameters
        ----------
        observation : (n,) or (M, n) array_like
            One observation or a batch.
        state : optional
            What the last call returned; None at the start.
        episode_start : (M,) array_like of bool, optional
            Members that have just been reset.
        deterministic : bool
            Whether to leave exploration out.

        Returns
        -------
        actions : (N - 1,) or (M, N - 1) array
            Actions in [-1, 1].
        state : object
            For the next call.
        """
        ...


class _Baseline:
    """What the policies here share: the shapes of a scene, and the clock."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.joints = scene.beam.elements - 1

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = False,
    ) -> tuple[Array, Any]:
        """Return actions, (N - 1,) or (M, N - 1), and the clock.

        The clock counts the actions since each member's start, (M,) int64; as times are whole
        multiples of the control interval, they carry no rounding of their own. What does not fit
        the scene is an OptionError.
        """
        shape = np.shape(observation)
        if len(shape) not in (1, 2):
            raise OptionError(f"observation must have shape (n,) or (M, n), got {shape}")
        members = 1 if len(shape) == 1 else shape[0]
        clock = np.zeros(members, dtype=np.int64) if state is None else np.array(state)
        if clock.shape != (members,) or clock.dtype.kind != "i":
            raise OptionError(
                f"state must be whole numbers of shape ({members},), got {clock.dtype} of shape "
                f"{clock.shape}"
            )
        if episode_start is not None:
            clock[np.broadcast_to(np.asarray(episode_start, dtype=np.bool_), clock.shape)] = 0
        actions = self._actions(clock)
        return (actions[0] if len(shape) == 1 else actions), clock + 1

    def check(self, scene: Scene, task: str | None = None) -> None:
        """Refuse a scene for which these actions would mean something else (OptionError)."""
        found = difference(self.scene, scene, self._fields, "its own scene")
        if found:
            raise OptionError(
                f"this {type(self).__name__} was made for scene {self.scene.name} and cannot "
                f"play scene {scene.name}: {found}; make one for it"
            )

    #: What `check` compares.
    _fields: tuple[str, ...] = ("beam.elements",)

    def _actions(self, clock: NDArray[np.int64]) -> Array:
        """Return the actions of members that have taken so many, (M, N - 1)."""
        raise NotImplementedError


class WavePolicy(_Baseline):
    """A travelling wave of torque, tau = A cos(f t - kappa s/l + phase), held over each action.

    Parameters
    ----------
    scene : Scene
        Gives the joints' places, the torque limit and the control interval.
    wave : Actuation
        The wave. Where its torques are beyond the scene's limit, they are cut off, and what is
        played is no longer a cosine.
    tuned_on : Scene, optional
        The scene that the wave was tuned on. `check` then refuses another body, fluid or damping;
        any other wave may play any body of this length and number of elements.
    """

    _fields = ("beam.elements", "beam.length", "torque_limit", "episode.control_interval")

    def __init__(self, scene: Scene, wave: Actuation, tuned_on: Scene | None = None) -> None:
        super().__init__(scene)
        self.wave = wave
        self.tuned_on = tuned_on

    def check(self, scene: Scene, task: str | None = None) -> None:
        """Refuse a scene for which these actions, or a tuned wave, would mean something else."""
        super().check(scene, task)
        tuned_on = scene if self.tuned_on is None else self.tuned_on
        found = difference(tuned_on, scene, TUNED_FIELDS, "tuning")
        if found:
            raise OptionError(
                f"the wave was tuned on scene {tuned_on.name} and cannot play scene {scene.name}: "
                f"{found}; `swim-env tune` finds the scene's own"
            )

    def _actions(self, clock: NDArray[np.int64]) -> Array:
        times = clock * self.scene.episode.control_interval
        torques = self.wave.torques(times, self.scene.beam)
        return np.clip(torques / self.scene.torque_limit, -1.0, 1.0)


class ZeroPolicy(_Baseline):
    """No torque at all."""

    def _actions(self, clock: NDArray[np.int64]) -> Array:
        return np.zeros((len(clock), self.joints))


class RandomPolicy(_Baseline):
    """Actions drawn uniformly from [-1, 1], independent of each other.

    They follow from the seed, the member and the clock alone, so an episode that is played again
    with the same policy is the same.

    Parameters
    ----------
    scene : Scene
        Gives the number of joints.
    seed : int, optional
        Seed of the numbers, a whole number of at least 0 (else it is an OptionError).
    """

    def __init__(self, scene: Scene, seed: int | None = None) -> None:
        super().__init__(scene)
        try:
            # Not the stream that an environment draws its start from with the same seed.
            self._key = np.random.SeedSequence(seed).generate_state(4).tolist()
        except (TypeError, ValueError):
            raise OptionError(
                f"seed must be a whole number of at least 0, or None, got {seed!r}"
            ) from None

    def _actions(self, clock: NDArray[np.int64]) -> Array:
        generators = (
            np.random.default_rng([*self._key, member, now])
            for member, now in enumerate(clock.tolist())
        )
        return np.stack([one.uniform(-1.0, 1.0, self.joints) for one in generators])


def paper_wave(scene: Scene) -> WavePolicy:
    """Return the wave that the scene prescribes, no torque where it prescribes none.

    In the shipped scenes it is the paper's own.
    """
    return WavePolicy(scene, scene.actuation or Actuation(amplitude=0.0))


def tuned_wave(scene: Scene, path: str | os.PathLike[str] | None = None) -> WavePolicy:
    """Return the wave that swims farthest, as `swim-env tune` found it.

    It is read from a file if one is given, else from beside the scene's own file, else it is that
    of scene swimmer. On a scene with another body, fluid or damping its `check` refuses to play.
    """
    record = find_tuned_wave(scene) if path is None else load_tuned_wave(path)
    return WavePolicy(scene, wave_on(scene, **record["wave"]), record["scene_fields"])
