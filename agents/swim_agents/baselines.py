"""Policies that learn nothing: the paper's wave, the tuned wave, no torque, random torques.

Each has the `predict` call of a model of stable-baselines3, for one observation or a batch, and
depends on nothing but the clock, which is passed on in `state` as for a recurrent model.
"""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_agents.fit import TUNED_FIELDS, difference
from swim_agents.tuned_wave import (
    LATERAL,
    SPATIAL_WAVES,
    actuation_of,
    find_tuned_wave,
    load_tuned_wave,
    wave_of_share,
    wave_on,
)
from swim_env.errors import OptionError
from swim_env.scene import WAVE_AXES, Actuation, Scene, SpatialScene

__all__ = [
    "POLICY_NAMES",
    "SPATIAL_POLICY_NAMES",
    "Policy",
    "RandomPolicy",
    "WavePolicy",
    "ZeroPolicy",
    "paper_wave",
    "spatial_wave",
    "tuned_wave",
]

Array = NDArray[np.float64]

#: Names that `load_policy` knows.
POLICY_NAMES = ("paper_wave", "tuned_wave", "zero", "random")
#: Those that only scenes in space have, and their waves: prescribed ones, and tuned ones beside
#: ``tuned_wave``, which is the lateral one.
PRESCRIBED_WAVES = {
    "lateral_wave": "lateral",
    "dorsoventral_wave": "dorsoventral",
    "helical_wave_right": "helical_right",
    "helical_wave_left": "helical_left",
}
TUNED_WAVES = {f"tuned_{wave}": wave for wave in SPATIAL_WAVES if wave != LATERAL}
SPATIAL_POLICY_NAMES = (*PRESCRIBED_WAVES, *TUNED_WAVES)


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
        actions : (n,) or (M, n) array
            Actions in [-1, 1], as many as `Scene.action_limits`.
        state : object
            For the next call.
        """
        ...


class _Baseline:
    """What the policies here share: the shapes of a scene, and the clock."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.actions = scene.action_places.size

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = False,
    ) -> tuple[Array, Any]:
        """Return actions, (n,) or (M, n), and the clock.

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
    _fields: tuple[str, ...] = ("dimension", "beam.elements", "axes")

    def _actions(self, clock: NDArray[np.int64]) -> Array:
        """Return the actions of members that have taken so many, (M, n)."""
        raise NotImplementedError


class WavePolicy(_Baseline):
    """A travelling wave of torque, tau = A cos(f t - kappa s/l + phase), held over each action.

    In space it has the axes of its `SpatialActuation.wave`.

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

    _fields = (
        *_Baseline._fields,
        "beam.length",
        "torque_limit",
        "episode.control_interval",
    )

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
        return np.clip(self.scene.actions_of(torques), -1.0, 1.0)


class ZeroPolicy(_Baseline):
    """No torque at all."""

    def _actions(self, clock: NDArray[np.int64]) -> Array:
        return np.zeros((len(clock), self.actions))


class RandomPolicy(_Baseline):
    """Actions drawn uniformly from [-1, 1], independent of each other.

    They follow from the seed, the member and the clock alone, so an episode that is played again
    with the same policy is the same.

    Parameters
    ----------
    scene : Scene
        Gives the number of actions.
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
        return np.stack([one.uniform(-1.0, 1.0, self.actions) for one in generators])


def paper_wave(scene: Scene) -> WavePolicy:
    """Return the wave that the scene prescribes, no torque where it prescribes none.

    In the shipped scenes it is the paper's own.
    """
    return WavePolicy(scene, actuation_of(scene))


def spatial_wave(scene: Scene, wave: str) -> WavePolicy:
    """Return the wave that a scene in space prescribes, about other axes.

    Frequency, wave number and phase are the prescribed ones. The amplitude is the same share of the
    limit of each axis that the wave drives: that of the prescribed amplitude in the limit of its
    own first axis.

    Parameters
    ----------
    scene : Scene
        The scene.
    wave : str
        ``lateral``, ``dorsoventral``, ``helical_right`` or ``helical_left``.

    Raises
    ------
    OptionError
        If the scene is planar, or does not actuate the axes of the wave.
    """
    if not isinstance(scene, SpatialScene):
        raise OptionError(
            f"a {wave} wave needs a scene of dimension 3, got {scene.name} of dimension 2; its "
            "own wave is paper_wave"
        )
    prescribed = actuation_of(scene)
    own = scene.axes.index(WAVE_AXES[prescribed.wave][0]) if prescribed.amplitude else 0
    share = prescribed.amplitude / scene.torque_limit[own]
    return WavePolicy(scene, replace(prescribed, **wave_of_share(scene, wave, share)))


def tuned_wave(
    scene: Scene, path: str | os.PathLike[str] | None = None, wave: str = LATERAL
) -> WavePolicy:
    """Return the wave that swims farthest, as `swim-env tune` found it.

    It is read from a file if one is given, else from beside the scene's own file, else it is one
    that ships: the scene's, or that of scene swimmer. In space it is the lateral one unless another
    one is named. On a scene with another body, fluid or damping its `check` refuses to play.
    """
    record = find_tuned_wave(scene, wave) if path is None else load_tuned_wave(path)
    return WavePolicy(scene, wave_on(scene, **record["wave"]), record["scene_fields"])
