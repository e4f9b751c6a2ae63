"""What a task's methods see of bodies in space."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swim_env.envs.tasks.moment import Moment

Array = NDArray[np.float64]


class SpatialMoment(Moment):
    """Members in space; see `Moment` for what is not said here.

    Vectors have three components, and torques are (m, N - 1, 3) about (pitch, yaw, roll).

    Attributes
    ----------
    coordinates, previous : (m, 4 N + 60) arrays
        Mean centre (m) and quaternions, see `swim_env.physics.spatial.chain`, then the body's
        `frame` and scratch, now and before the action.
    """

    @cached_property
    def frame(self) -> Array:
        """The body's frame, (m, 3, 3): unit vectors forward, left and up in its columns."""
        return self._frame(self.coordinates)

    @property
    def heading(self) -> Array:
        """Bodies in space have no heading angle; see `ahead` and `frame`."""
        raise AttributeError("bodies in space have no heading angle; see ahead and frame")

    @cached_property
    def ahead(self) -> Array:
        """The head's direction, (m, 3) unit vectors."""
        return self.frame[..., 0]

    @cached_property
    def turning_rate(self) -> Array:
        """Turning rates about the body's own axes (forward, left, up), (m, 3) (rad/s).

        The mean over the action, or the start's.
        """
        if self.start:
            rates = self._of(self._arrays.velocities)[:, 3:]
            spin = rates.reshape(len(rates), -1, 3).mean(axis=1)
            return self.in_body(spin)
        before, now = self._frame(self.previous), self.frame
        turn = np.einsum("mji,mjk->mik", before, now)
        axis = np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], axis=-1)
        axis -= np.stack([turn[:, 1, 2], turn[:, 2, 0], turn[:, 0, 1]], axis=-1)
        size = np.linalg.norm(axis, axis=1)
        angle = np.arctan2(size, np.trace(turn, axis1=1, axis2=2) - 1.0)
        factor = np.divide(angle, size, out=np.full_like(size, 0.5), where=size > 0.0)
        rates = axis * (factor / self._some_seconds)[:, None]
        return np.asarray(rates)

    def in_body(self, vectors: Array) -> Array:
        """Return the components (forward, left, up) of vectors in space, (m, 3)."""
        seen: Array = np.einsum("mji,mj->mi", self.frame, vectors)
        return seen

    def seen_direction(self, way: Array) -> tuple[Array, Array]:
        """Return how directions `in_body` are observed, and their `heading_error`."""
        forward, left, up = way.T
        return way.copy(), np.arctan2(np.hypot(left, up), forward)

    def _frame(self, kept: Array) -> Array:
        at = 4 * self.scene.beam.elements + 3
        return kept[:, at : at + 9].reshape(-1, 3, 3)
