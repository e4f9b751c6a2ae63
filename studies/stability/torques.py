"""Torques for hard runs: functions of time, so that a run at half the step gets the same ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swim_env.scene import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WhiteNoise:
    """Independent uniform torques up to `amplitude` (N m), each held for `held` seconds."""

    amplitude: float
    seed: int
    held: float = 0.02

    def __call__(self, scene: Scene, times: Array) -> Array:
        """Return torques (T, N - 1) in N m at times (T,) in s."""
        out = np.empty((len(times), scene.beam.elements - 1))
        for row, number in enumerate(np.floor(times / self.held + 1e-6).astype(np.int64)):
            rng = np.random.default_rng((self.seed, int(number)))
            out[row] = rng.uniform(-self.amplitude, self.amplitude, out.shape[1])
        return out


@dataclass(frozen=True)
class SquareWave:
    """The same torque (N m) at every joint, full one way and then full the other; `period` in s."""

    amplitude: float
    period: float = 0.4

    def __call__(self, scene: Scene, times: Array) -> Array:
        """Return torques (T, N - 1) in N m at times (T,) in s."""
        half = np.floor(2.0 * times / self.period + 1e-6)
        signs = np.where(half % 2 == 0, 1.0, -1.0)
        return self.amplitude * np.repeat(signs[:, None], scene.beam.elements - 1, axis=1)


@dataclass(frozen=True)
class Ramp:
    """A torque that grows by `rate` (N m/s) up to `most` (N m), at every joint or at one alone."""

    rate: float
    joint: int | None = None
    most: float = np.inf

    def __call__(self, scene: Scene, times: Array) -> Array:
        """Return torques (T, N - 1) in N m at times (T,) in s."""
        out = np.zeros((len(times), scene.beam.elements - 1))
        joints = slice(None) if self.joint is None else slice(self.joint, self.joint + 1)
        out[:, joints] = np.minimum(self.rate * times, self.most)[:, None]
        return out
