"""The constants of a spatial scene as kernels read them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swim_env.physics.runtime.references import reader
from swim_env.physics.solve.constants import SAMPLE_SCENE, SolverConstants
from swim_env.physics.spatial.chain import SpatialBeam
from swim_env.physics.spatial.layout import SpatialFluid
from swim_env.physics.spatial.panels.surface import Surface, no_surface


class SpatialConstants(NamedTuple):
    """All constants of a scene in space, which kernels read by reference."""

    beam: SpatialBeam
    fluid: SpatialFluid
    solver: SolverConstants
    surface: Surface


_ONES = np.ones((1, 3))
#: Constants of the types that all have.
SAMPLE_SPATIAL_SCENE = SpatialConstants(
    SpatialBeam(2, 0.5, np.ones(2), np.ones((2, 2)), _ONES, _ONES, _ONES),
    SpatialFluid(False, False, False, np.zeros(0), np.zeros(3)),
    SAMPLE_SCENE.solver,
    no_surface(2),
)
#: Returns the constants whose words a kernel is given.
spatial_constants_at = reader(lambda: SAMPLE_SPATIAL_SCENE)
