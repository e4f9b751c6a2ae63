"""The prescribed torque that drives the body."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.scene.block import Block
from swim_env.scene.body import Chain
from swim_env.scene.checks import real

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Wave(Block, path="actuation"):
    """A wave of torque that travels along the body.

    Attributes
    ----------
    amplitude : float
        Torque amplitude A [N m]; 0 in a scene that gives `torque_limit` or `active_until` alone,
        which are for environments.
    frequency : float
        Angular frequency f [rad/s]; the paper's 2 pi unless given.
    wave_number : float
        Wave number kappa [rad per body length]; the paper's 2 pi unless given.
    torque_limit : float
        Torque of an environment's action of 1 [N m], above 0. It does not limit the amplitude.
    phase : float
        Phase [rad].
    end_time : float or None
        Time from which on all torques are zero [s], at least 0; None for never.
    active_until : float
        Joints with s/l above this get no torque, in (0, 1].
    """

    amplitude: Annotated[float, real("N m")]
    frequency: Annotated[float, real("rad/s")] = 2.0 * math.pi
    wave_number: Annotated[float, real("rad per body length")] = 2.0 * math.pi
    torque_limit: Annotated[float, real("N m", above=0.0)] = 1.0
    phase: Annotated[float, real("rad")] = 0.0
    end_time: Annotated[float | None, real("s", at_least=0.0)] = None
    active_until: Annotated[float, real(above=0.0, at_most=1.0)] = 1.0

    def travelling(self, shape: np.ufunc, times: ArrayLike, beam: Chain) -> Floats:
        """Return A shape(f t - kappa s/l + phase) at the joints, (T, N-1) [N m].

        It is zero from `end_time` on and at joints with s/l above `active_until`.
        """
        moments = np.atleast_1d(np.asarray(times, dtype=np.float64))
        place = beam.joint_fractions
        angle = self.frequency * moments[:, None] - self.wave_number * place + self.phase
        active = np.broadcast_to(place <= self.active_until, angle.shape)
        if self.end_time is not None:
            active = active & (moments < self.end_time)[:, None]
        return np.where(active, self.amplitude * shape(angle), 0.0)


@dataclass(frozen=True)
class Actuation(Wave, path="actuation"):
    """The prescribed torque: a wave that travels along the body, see `Wave` for its fields."""

    def torques(self, times: ArrayLike, beam: Chain) -> Floats:
        """Joint torques tau = A cos(f t - kappa s/l + phase) at given times.

        Parameters
        ----------
        times : array_like
            Times [s], shape (T,). For an exact end, compute them as step number times time step
            and not by summing.
        beam : Chain
            The body whose joints are driven.

        Returns
        -------
        numpy.ndarray
            Torques [N m], shape (T, N-1): positive turns the element behind the joint
            counter-clockwise and the one before it clockwise. Zero from `end_time` on and at
            joints with s/l above `active_until`.
        """
        return self.travelling(np.cos, times, beam)
