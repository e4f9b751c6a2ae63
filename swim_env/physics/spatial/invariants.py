"""States in space seen from Python: centres, directors, the momentum map and the heading."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def directors_of(q: Array) -> tuple[Array, Array]:
    """Return directors and joints' rotation vectors of coordinates (..., 4 N + 3).

    Returns
    -------
    directors : (..., N, 3, 3) array
        R_k, with columns d1, d2, d3.
    joint_rotations : (..., N - 1, 3) array
        Rotation vectors (rad), of less than half a turn.
    """
    quaternions = q[..., 3:].reshape(*q.shape[:-1], -1, 4)
    w, v = quaternions[..., :1], quaternions[..., 1:]
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)
    turns = np.eye(3) + 2.0 * (w[..., None] * cross + cross @ cross)
    directors = np.empty_like(turns)
    directors[..., 0, :, :] = turns[..., 0, :, :]
    for k in range(1, turns.shape[-3]):
        directors[..., k, :, :] = directors[..., k - 1, :, :] @ turns[..., k, :, :]
    w, v = w[..., 1:, 0], v[..., 1:, :]
    size = np.linalg.norm(v, axis=-1)
    angle = 2.0 * np.arctan2(size, np.abs(w)) * np.where(w < 0.0, -1.0, 1.0)
    factor = np.divide(angle, size, out=np.full_like(size, 2.0), where=size > 0.0)
    return directors, factor[..., None] * v


def centres_of(mean: Array, directors: Array, element_length: float) -> Array:
    """Return the element centres (..., N, 3) (m) from their mean (..., 3) and directors (15)."""
    tangents = directors[..., 2]
    ahead = element_length * (np.cumsum(tangents, axis=-2) - 0.5 * tangents)
    return np.asarray(mean[..., None, :] + ahead - ahead.mean(axis=-2, keepdims=True))


def momentum_map(q: Array, p: Array) -> Array:
    """Return linear momentum and angular momentum about the origin of states, (..., 6).

    Parameters
    ----------
    q, p : (..., 4 N + 3), (..., 3 N + 3) arrays
        Coordinates and carried momenta, see `swim_env.physics.spatial.chain`.
    """
    linear = p[..., :3]
    spins = p[..., 3:].reshape(*p.shape[:-1], -1, 3).sum(axis=-2)
    return np.concatenate([linear, np.cross(q[..., :3], linear) + spins], axis=-1)


def heading_of(directors: Array) -> Array:
    """Return the body's rotation (..., 3, 3): the polar factor of mean directors (..., N, 3, 3)."""
    left, _, right = np.linalg.svd(directors.mean(axis=-3))
    left[..., -1] *= np.linalg.det(left @ right)[..., None]
    return np.asarray(left @ right)


def rotation_angle(rotation: Array) -> float:
    """Return the angle of a rotation (3, 3), 0 to pi (rad)."""
    axis = np.array([rotation[2, 1], rotation[0, 2], rotation[1, 0]])
    axis -= [rotation[1, 2], rotation[2, 0], rotation[0, 1]]
    return float(np.arctan2(np.linalg.norm(axis), np.trace(rotation) - 1.0))
