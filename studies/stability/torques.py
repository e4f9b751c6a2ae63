"""Torques for hard runs: functions of time, so that a run at half the step gets the same ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swim_env.scene import Scene

__all__ = ["Ramp", "SquareWave", "WhiteNoise"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WhiteNoise:
    """Independent uniform torques at every joint, new after every `held` seconds.

    Attributes
    ----------
    amplitude : float
        Largest torque (N m).
    seed : int
        Of the random numbers.
    held : float
        Time over which a torque is held (s).
    """

    amplitude: float
    seed: int
    held: float = 0.02

    def __call__(self, scene: Scene, times: Array) -> Array:
        """Return torques (T, N - 1) in N m at times (T,) in s."""
        joints = scene.beam.elements - 1
        out = np.empty((len(times), joints))
        for row, number in enumerate(np.floor(times / self.held + 1e-6).astype(np.int64)):
            rng = np.random.default_rng((self.seed, int(number)))
            out[row] = rng.uniform(-self.amplitude, self.amplitude, joints)
        return out


@dataclass(frozen=True)
class SquareWave:
    """The same torque at every joint, full one way and then full the other.

    Attributes
    ----------
    amplitude : float
        Torque (N m).
    period : float
        Time of both ways (s).
    """

    amplitude: float
    period: float = 0.4

    def __call__(self, scene: Scene, times: Array) -> Array:
        """Return torques (T, N - 1) in N m at times (T,) in s."""
        half = np.floor(2.0 * times / self.period + 1e-6)
        signs = np.where(half % 2 == 0, 1.0, -1.0)
        return self.amplitude * np.repeat(signs[:, None], scene.beam.elements - 1, axis=1)


@dataclass(frozen=True)
class Ramp:
    """The same torque at every joint, growing in proportion to time, or at one joint alone.

    Attributes
    ----------
    rate : float
        Growth (N m/s).
    joint : int, optional
        The only joint that has it.
    most : float
        The torque stays where it gets to this (N m).
    """

    rate: float
    joint: int | None = None
    most: float = np.inf

    def __call__(self, scene: Scene, times: Array) -> Array:
        """Return torques (T, N - 1) in N m at times (T,) in s."""
        joints = scene.beam.elements - 1
        size = np.minimum(self.rate * times, self.most)
        out = np.zeros((len(times), joints))
        if self.joint is None:
            out[:] = size[:, None]
        else:
            out[:, self.joint] = size
        return out
