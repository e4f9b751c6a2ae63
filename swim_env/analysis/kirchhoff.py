"""Kirchhoff's equations for a straight body in its fluid: rigid masses, growth rate, onset.

A straight body that moves along itself is unstable: it turns broadside on (Lamb, Hydrodynamics,
ch. 6). The masses come from the mass matrix of the straight discrete body, whose columns are the
momenta of unit velocities.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swim_env.sim.simulator import Simulator

__all__ = [
    "RigidMass",
    "growth_rate",
    "mass_matrix",
    "onset_by_kirchhoff",
    "rate_for_onset",
    "rigid_mass",
]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RigidMass:
    """Mass of a straight body and the fluid around it, as one rigid body (per metre of depth).

    Attributes
    ----------
    along, across : float
        m11 and m22 (kg).
    inertia : float
        About the centre, I (kg m^2).
    coupling : float
        g between moving across and turning (kg m).
    """

    along: float
    across: float
    inertia: float
    coupling: float


def mass_matrix(simulator: Simulator) -> Array:
    """Return the mass matrix of a simulator's straight body, with the fluid's added mass.

    Parameters
    ----------
    simulator : Simulator
        It is reset to its scene's start.

    Returns
    -------
    (N + 2, N + 2) array
        Momenta (kg m/s, kg m^2/s) of unit velocities (m/s, rad/s), in the order of
        `Simulator.velocity`.
    """
    n = simulator.elements + 2

    def momentum(velocity: Array) -> Array:
        simulator.reset_to(np.zeros(n), velocity)
        return np.frombuffer(simulator.snapshot().state)[n : 2 * n]

    # In a stream a body at rest has momentum: momenta are those relative to the stream.
    at_rest = momentum(np.zeros(n))
    matrix: Array = np.array([momentum(unit) - at_rest for unit in np.eye(n)])
    simulator.reset()
    symmetric: Array = 0.5 * (matrix + matrix.T)
    return symmetric


def rigid_mass(matrix: Array) -> RigidMass:
    """Return a straight body's masses as one rigid body, from its `mass_matrix`."""
    motions = np.zeros((3, len(matrix)))
    motions[0, 0] = motions[1, 1] = 1.0
    motions[2, 2:] = 1.0
    found = motions @ matrix @ motions.T
    return RigidMass(*(float(found[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (1, 2))))


def growth_rate(mass: RigidMass, speed: float) -> float:
    """Return the rate (1/s) at which a rigid straight body turns away from its line of motion.

    lambda^2 = U^2 m11 (m22 - m11)/(m22 I - g^2), from Kirchhoff's equations linearised about
    motion along the body (Lamb, Hydrodynamics, ch. 6); not a number where that is negative.

    Parameters
    ----------
    mass : RigidMass
        Of body and fluid, ``rigid_mass(mass_matrix(Simulator(scene)))``.
    speed : float
        U (m/s).
    """
    square = mass.along * (mass.across - mass.along)
    square /= mass.across * mass.inertia - mass.coupling**2
    return speed * math.sqrt(square) if square >= 0.0 else math.nan


def onset_by_kirchhoff(
    mass: RigidMass, speed: float, lateral: float, turning: float, length: float, share: float
) -> float:
    """Return when an end of a rigid straight body leaves its line, by the linearised equations.

    Parameters
    ----------
    mass : RigidMass
        Of body and fluid.
    speed, lateral : float
        Velocity of the centre along and across the body (m/s).
    turning : float
        Turning rate (rad/s).
    length : float
        l (m).
    share : float
        How far an end has to be away from its first y, as a share of the length.

    Returns
    -------
    float
        Time (s), infinite where it does not happen within 1000 s.
    """
    from scipy.linalg import expm

    # (y, theta, v, omega): y' = v + U theta, theta' = omega; Kirchhoff's equations for v and omega.
    system = np.zeros((4, 4))
    system[0, 1], system[0, 2], system[1, 3] = speed, 1.0, 1.0
    inertia = np.array([[mass.across, mass.coupling], [mass.coupling, mass.inertia]])
    forces = -speed * np.array([[0.0, mass.along], [mass.across - mass.along, mass.coupling]])
    system[2:, 2:] = np.linalg.solve(inertia, forces)
    start = np.array([0.0, 0.0, lateral, turning])
    ends = np.array([[1.0, 0.5 * length, 0.0, 0.0], [1.0, -0.5 * length, 0.0, 0.0]])
    step = 0.01
    once, state = expm(system * step), start
    for n in range(1, 100_001):
        state = once @ state
        if np.abs(ends @ state).max() > share * length:
            return n * step
    return math.inf


def rate_for_onset(
    mass: RigidMass, speed: float, lateral: float, length: float, share: float, time: float
) -> float:
    """Return the growth rate (1/s) with which a rigid straight body leaves its line at a time.

    The masses are kept, and the rotary inertia is the one that this takes.

    Parameters
    ----------
    mass : RigidMass
        Of body and fluid.
    speed, lateral, length, share
        As in `onset_by_kirchhoff`, of a start that does not turn.
    time : float
        When it leaves its line (s).
    """
    from scipy.optimize import brentq

    def late(factor: float) -> float:
        other = dataclasses.replace(mass, inertia=factor * mass.inertia)
        return onset_by_kirchhoff(other, speed, lateral, 0.0, length, share) - time

    factor = brentq(late, 1e-4, 1.0, xtol=1e-9)
    return growth_rate(dataclasses.replace(mass, inertia=factor * mass.inertia), speed)
