"""Fluid model ``strip``: every element carries the added mass of its own length alone.

The added mass is diag(m' dl, m' dl^3/12) per element; m' is by default the plate's mean value
rho pi l/4, the added mass rho pi l^2/4 of a straight plate spread over its length.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.constant import constant_added_mass, no_shape_force, triangle_of
from swim_env.physics.fluid.model import Model
from swim_env.physics.fluid.outline import FluidGeometry
from swim_env.scene import Fluid

Array = NDArray[np.float64]


def plate_added_mass(density: float, length: float) -> float:
    """Return rho pi l/4, the mean added mass per length of a straight plate (kg/m)."""
    return 0.25 * math.pi * density * length


def _terms(fluid: Fluid, geometry: FluidGeometry) -> Array:
    n, dl = geometry.elements, geometry.element_length
    per_length = fluid.added_mass_per_length
    if per_length is None:
        per_length = plate_added_mass(fluid.density or 0.0, n * dl)
    lateral = np.full(n, per_length * dl)
    rotary = np.full(n, per_length * dl**3 / 12.0)
    return triangle_of(np.diag(np.concatenate([lateral, rotary])))


MODEL = Model(constant_added_mass, no_shape_force, terms=_terms)
