"""The state at time zero: pose and velocity of every element."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SceneError
from swim_env.scene.block import Block
from swim_env.scene.body import Beam
from swim_env.scene.checks import (
    Check,
    Pair,
    listed,
    one_or_many,
    one_value_per,
    pair,
    real,
    reals,
)

Floats = NDArray[np.float64]


def _one_or_many(unit: str) -> Check[float | tuple[float, ...]]:
    def check(value: object, field: str) -> float | tuple[float, ...]:
        return real(unit)(value, field) if listed(value) is None else reals(unit)(value, field)

    return check


@dataclass(frozen=True)
class Initial(Block, path="initial"):
    """The state at time zero. By default straight along +x, head at the origin, at rest.

    Attributes
    ----------
    position : tuple of float
        The head's end node (x, y) [m].
    heading : float
        Angle of element 1 [rad].
    joint_angles : float or tuple of float
        Angle of each element relative to the one before it [rad]: one value for all joints or
        one for each of the N - 1.
    velocity : tuple of float, or tuple of such pairs
        Velocity (x, y) [m/s] of all element centres, or one pair for each of the N.
    velocity_slope : float
        Lateral velocity added per x [1/s]: a centre at (x, y) gets (0, slope x) more.
    turning_rate : float, tuple of float, or None
        Angular velocity of all elements or of each of the N [rad/s]; None for `velocity_slope`.
    """

    position: Annotated[Pair, pair("m")] = (0.0, 0.0)
    heading: Annotated[float, real("rad")] = 0.0
    joint_angles: Annotated[float | tuple[float, ...], _one_or_many("rad")] = 0.0
    velocity: Annotated[Pair | tuple[Pair, ...], one_or_many(pair("m/s"))] = (0.0, 0.0)
    velocity_slope: Annotated[float, real("1/s")] = 0.0
    turning_rate: Annotated[float | tuple[float, ...] | None, _one_or_many("rad/s")] = None

    def check_sizes(self, beam: Beam) -> None:
        """Refuse lists that do not fit the beam's number of elements."""
        count = beam.elements
        if isinstance(self.joint_angles, tuple):
            one_value_per("joint", self.joint_angles, count - 1, "initial.joint_angles")
        if isinstance(self.velocity[0], tuple):
            one_value_per("element", self.velocity, count, "initial.velocity")
        if isinstance(self.turning_rate, tuple):
            one_value_per("element", self.turning_rate, count, "initial.turning_rate")

    def pose(self, beam: Beam) -> tuple[Floats, Floats]:
        """Element centres and angles at time zero.

        Parameters
        ----------
        beam : Beam
            The body.

        Returns
        -------
        centres : numpy.ndarray
            Centres r^k [m], shape (N, 2).
        angles : numpy.ndarray
            Angles th_k from +x [rad], shape (N,).
        """
        self.check_sizes(beam)
        angles = np.full(beam.elements, self.heading, dtype=np.float64)
        angles[1:] += np.cumsum(np.broadcast_to(self.joint_angles, beam.elements - 1))
        tangents = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        ends = np.cumsum(tangents, axis=0) * beam.element_length
        return ends - 0.5 * beam.element_length * tangents + np.array(self.position), angles

    def velocities(self, beam: Beam) -> tuple[Floats, Floats]:
        """Velocities of the element centres and turning rates at time zero.

        Parameters
        ----------
        beam : Beam
            The body.

        Returns
        -------
        centre_velocities : numpy.ndarray
            Velocities of the centres [m/s], shape (N, 2).
        turning_rates : numpy.ndarray
            Angular velocities of the elements [rad/s], shape (N,).
        """
        centres, _ = self.pose(beam)
        moving = np.empty((beam.elements, 2))
        moving[:] = self.velocity
        moving[:, 1] += self.velocity_slope * centres[:, 0]
        rate = self.velocity_slope if self.turning_rate is None else self.turning_rate
        return moving, np.array(np.broadcast_to(rate, beam.elements), dtype=np.float64)

    def check_inextensible(self, beam: Beam) -> None:
        """Refuse velocities that would pull neighbouring elements apart, equation (15).

        The node shared by elements k-1 and k must have one velocity: the centres' velocities
        may differ only by dl/2 (thdot_k d1^k + thdot_{k-1} d1^{k-1}), up to 1e-9 of the largest
        speed.
        """
        with np.errstate(over="ignore", invalid="ignore"):  # gaps that are not finite are refused
            _, angles = self.pose(beam)
            moving, rates = self.velocities(beam)
            normals = np.stack([-np.sin(angles), np.cos(angles)], axis=1)
            swing = 0.5 * beam.element_length * rates[:, None] * normals
            gaps = np.hypot(*(np.diff(moving, axis=0) - swing[1:] - swing[:-1]).T)
        scale = max(float(np.abs(moving).max()), float(np.abs(swing).max()))
        wrong = np.flatnonzero(~(gaps <= 1e-9 * scale))
        if wrong.size:
            joint = int(wrong[0])
            raise SceneError(
                f"initial.velocity, velocity_slope and turning_rate break inextensibility (15) at "
                f"the joint of elements {joint + 1} and {joint + 2}: the velocities of their "
                f"common node differ by {gaps[joint]:.3g} m/s, must be equal"
            )
