"""Fluid model ``frozen``: the straight body's full matrix from panels, in the elements' frames."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.constant import constant_added_mass, no_shape_force, triangle_of
from swim_env.physics.fluid.model import Model
from swim_env.physics.fluid.outline import FluidGeometry
from swim_env.physics.fluid.straight import NearlyStraight
from swim_env.scene import Fluid

Array = NDArray[np.float64]


@lru_cache(maxsize=32)
def _triangle(geometry: FluidGeometry, density: float) -> Array:
    shapes = NearlyStraight(geometry, density)
    terms = triangle_of(shapes.added_mass(np.zeros(geometry.elements - 1)))
    terms.flags.writeable = False
    return terms


def _terms(fluid: Fluid, geometry: FluidGeometry) -> Array:
    return _triangle(geometry, fluid.density or 0.0)


MODEL = Model(constant_added_mass, no_shape_force, terms=_terms)
