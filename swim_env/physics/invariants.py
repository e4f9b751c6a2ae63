"""What is conserved and what is spent: momentum map, energy balance, work."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def momentum_map(q: Array, p: Array) -> Array:
    """Return the discrete momentum map of states.

    Parameters
    ----------
    q : (..., N + 2) array
        Minimal coordinates: mean centre (m), angle of element 1 and joint angles (rad).
    p : (..., N + 2) array
        Carried momenta, conjugate to the mean centre and to the element angles.

    Returns
    -------
    (..., 3) array
        Linear momentum (kg m/s) and angular momentum about the origin (kg m^2/s), per metre of
        depth. Translating the beam moves c alone; turning it about the origin turns every element
        and swings c, so the angular momentum is sum_k p_theta_k + c x p_c.
    """
    angular = p[..., 2:].sum(axis=-1) + q[..., 0] * p[..., 1] - q[..., 1] * p[..., 0]
    return np.stack([p[..., 0], p[..., 1], angular], axis=-1)


def unexplained_momentum(momentum: Array, impulse: Array) -> Array:
    """Return J_n - J_0 - impulses of a trajectory, (T + 1, 3).

    Parameters
    ----------
    momentum : (T + 1, 3) array
        The momentum map.
    impulse : (T, 3) array
        Impulse from outside in every step, zero in a fluid that is at rest and ideal.
    """
    change: Array = momentum - momentum[0]
    change[1:] -= np.cumsum(impulse, axis=0)
    return change


def momentum_drift(momentum: Array, impulse: Array) -> float:
    """Return max_n |J_n - J_0 - impulses|; parameters as `unexplained_momentum`."""
    return float(np.max(np.linalg.norm(unexplained_momentum(momentum, impulse), axis=-1)))


def unexplained_energy(energy: Array, work: Array, dissipated: Array) -> Array:
    """Return H_n - H_0 - work + dissipated of a trajectory, (T + 1,) (J).

    Parameters
    ----------
    energy : (T + 1,) array
        H(q_n, p_n) (J).
    work, dissipated : (T,) arrays
        Work of the torques and loss to damping and drag in every step (J).
    """
    balance: Array = energy - energy[0]
    balance[1:] -= np.cumsum(work - dissipated)
    return balance


def energy_through(energy: Array, dissipated: Array) -> float:
    """Return the energy that went through a run, max_n H_n + dissipated (J).

    A composed step that does not resolve its motion may book a negative loss, which counts as none.
    Parameters as `unexplained_energy`.
    """
    return float(np.max(energy) + np.sum(np.maximum(dissipated, 0.0)))


def energy_drift(energy: Array, work: Array, dissipated: Array) -> float:
    """Return the largest unexplained energy as a share of that which went through the run.

    That is max_n |H_n - H_0 - work + dissipated| / (max_n H + dissipated): for a steady gait both
    grow alike, so the share does not depend on how long it is watched. Parameters as
    `unexplained_energy`; 0 where there is no energy.
    """
    left = float(np.max(np.abs(unexplained_energy(energy, work, dissipated))))
    through = energy_through(energy, dissipated)
    if left == 0.0:
        return 0.0
    return left / through if through > 0.0 and math.isfinite(left / through) else math.inf
