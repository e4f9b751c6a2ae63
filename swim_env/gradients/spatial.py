"""Runs in space that are recorded for their gradients."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import OptionError
from swim_env.gradients.objectives import Slopes, Stretch
from swim_env.gradients.tape import Tape
from swim_env.physics.gradients.loading import load_spatial_gradients
from swim_env.physics.gradients.spatial_sweep import (
    new_spatial_sweep,
    pull_back_spatial,
    push_forward_spatial,
)
from swim_env.physics.spatial.invariants import directors_of
from swim_env.scene import Scene

Array = NDArray[np.float64]


class SpatialTape(Tape):
    """A `Tape` of a scene in space. The basis of momenta is that of rotations in its axes."""

    _pull_back: Any = staticmethod(pull_back_spatial)
    _push_forward: Any = staticmethod(push_forward_spatial)

    def _check(self, scene: Scene) -> None:
        if scene.fluid is not None and scene.fluid.model == "panels":
            raise OptionError(
                f"in space there are no gradients with the fluid model panels of {scene.name}; "
                "take frozen or strip"
            )

    def _new_sweep(self) -> Any:
        load_spatial_gradients()
        self._options = ()
        return new_spatial_sweep(self.scene.beam.elements)

    def joints(self, coordinates: Array) -> Array:
        """Return the joints' rotation vectors (S + 1, N - 1, 3) of coordinates."""
        return directors_of(coordinates)[1]

    def rates(self, stretch: Stretch, slopes: Slopes) -> tuple[Array, Array]:
        """Return derivatives by coordinates and momenta in the basis of momenta."""
        p = np.zeros_like(stretch.momenta)
        if slopes.momenta is not None:
            p += slopes.momenta
        q = np.zeros_like(p)
        turns = q[:, 3:].reshape(len(q), -1, 3)
        quaternions = _quaternions(stretch.coordinates)
        directors, angles = directors_of(stretch.coordinates)
        if slopes.coordinates is not None:
            q[:, :3] += slopes.coordinates[:, :3]
            given = _quaternions(np.asarray(slopes.coordinates))
            turns[:, 0] += 0.5 * _product(given[:, 0], _conjugate(quaternions[:, 0]))[..., 1:]
            local = 0.5 * _product(_conjugate(quaternions[:, 1:]), given[:, 1:])[..., 1:]
            _add_between(directors, local, turns)
        if slopes.joints is not None:
            _add_between(directors, _inverse_left(angles, np.asarray(slopes.joints)), turns)
        return q, p

    def by_coordinates(self, by_turns: Array, coordinates: Array) -> Array:
        """Return a derivative by coordinates, along unit quaternions."""
        units = np.eye(coordinates.size)
        return np.array([self.turns_of(one, coordinates) @ by_turns for one in units])

    def turns_of(self, change: Array, coordinates: Array) -> Array:
        """Return a change of coordinates in the basis of momenta."""
        quaternions, given = _quaternions(coordinates), _quaternions(np.asarray(change))
        directors, _ = directors_of(coordinates)
        turns = np.empty((len(quaternions), 3))
        turns[0] = 2.0 * _product(given[0], _conjugate(quaternions[0]))[1:]
        local = 2.0 * _product(_conjugate(quaternions[1:]), given[1:])[:, 1:]
        for k in range(1, len(turns)):
            turns[k] = turns[k - 1] + directors[k] @ local[k - 1]
        return np.asarray(np.concatenate([change[:3], turns.ravel()]))

    def moved(self, turns: Array) -> Array:
        """Return the start's coordinates after rotations of the elements in the axes of space."""
        coordinates: Array = self.start[0].copy()
        coordinates[:3] += turns[:3]
        quaternions = _quaternions(coordinates)
        absolute = quaternions.copy()
        for k in range(1, len(absolute)):
            absolute[k] = _product(absolute[k - 1], absolute[k])
        omega = turns[3:].reshape(-1, 3)
        angle = np.linalg.norm(omega, axis=1)
        rotation = np.concatenate(
            [np.cos(0.5 * angle)[:, None], 0.5 * np.sinc(0.5 * angle / np.pi)[:, None] * omega],
            axis=1,
        )
        absolute = _product(rotation, absolute)
        quaternions[0] = absolute[0]
        quaternions[1:] = _product(_conjugate(absolute[:-1]), absolute[1:])
        return coordinates


def _quaternions(coordinates: Array) -> Array:
    """Return the quaternions (..., N, 4) of coordinates, a view where it can be one."""
    return coordinates[..., 3:].reshape(*coordinates.shape[:-1], -1, 4)


def _conjugate(quaternions: Array) -> Array:
    return np.asarray(quaternions * np.array([1.0, -1.0, -1.0, -1.0]))


def _product(a: Array, b: Array) -> Array:
    """Return the products (..., 4) of quaternions."""
    scalar = a[..., :1] * b[..., :1] - (a[..., 1:] * b[..., 1:]).sum(axis=-1, keepdims=True)
    vector = a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + np.cross(a[..., 1:], b[..., 1:])
    return np.concatenate([scalar, vector], axis=-1)


def _inverse_left(theta: Array, vectors: Array) -> Array:
    """Return J_l(theta)^-1 v of rotation vectors and vectors, (..., 3)."""
    square = (theta**2).sum(axis=-1, keepdims=True)
    half = 0.5 * np.sqrt(np.maximum(square, 1e-300))
    with np.errstate(invalid="ignore", divide="ignore"):
        curving = (1.0 - half / np.tan(half)) / square
    curving = np.where(square < 1e-4, 1.0 / 12.0 + square / 720.0, curving)
    turned = np.cross(theta, vectors)
    return np.asarray(vectors - 0.5 * turned + curving * np.cross(theta, turned))


def _add_between(directors: Array, local: Array, turns: Array) -> None:
    """Add what belongs to joints, in the axes behind them, to the rotations on either side."""
    turned = np.einsum("...kij,...kj->...ki", directors[..., 1:, :, :], local)
    turns[..., 1:, :] += turned
    turns[..., :-1, :] -= turned
