"""Kirchhoff's equations for a straight body in its fluid: rigid masses and growth rate.

A straight body that moves along itself is unstable: it turns broadside on (Lamb, Hydrodynamics,
ch. 6). The masses come from the mass matrix of the straight discrete body.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["RigidMass", "growth_rate", "rigid_mass"]

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
    motion along the body at the speed U (m/s); not a number where that is negative. The mass is of
    body and fluid, ``rigid_mass(mass_matrix(Simulator(scene)))``.
    """
    square = mass.along * (mass.across - mass.along)
    square /= mass.across * mass.inertia - mass.coupling**2
    return speed * math.sqrt(square) if square >= 0.0 else math.nan
