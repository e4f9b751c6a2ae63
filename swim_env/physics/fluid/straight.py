"""Panels' added mass of the straight body and of shapes near it, for models that start from it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SwimError
from swim_env.physics.fluid.layout import (
    FluidConstants,
    fluid_views,
    fluid_work_sizes,
    motion_count,
)
from swim_env.physics.fluid.outline import FluidGeometry, panel_count
from swim_env.physics.fluid.panels import panel_added_mass
from swim_env.physics.runtime.views import padded
from swim_env.physics.status import FINE, TERMINATION_REASONS

Array = NDArray[np.float64]


class NearlyStraight:
    """The panels' added mass of shapes of one body that are hardly bent."""

    def __init__(self, geometry: FluidGeometry, density: float) -> None:
        panels = int(panel_count(geometry))
        self._fluid = FluidConstants(
            0, geometry, density, True, True, panels, 0, False, np.zeros(0)
        )
        floats, integers = fluid_work_sizes(self._fluid)
        self._work, _ = fluid_views(
            np.zeros(floats), np.zeros(integers, dtype=np.int64), self._fluid
        )
        self._size = int(motion_count(self._fluid))

    def added_mass(self, joint_angles: Array) -> Array:
        """Return A (2 N, 2 N) of a shape with these joint angles (rad).

        Raises
        ------
        SwimError
            If panels give none.
        """
        out = np.zeros((padded(self._size), padded(self._size)))
        status = panel_added_mass(joint_angles, self._fluid, self._work, out)
        if status != FINE:
            raise SwimError(
                "panels give no added mass of the straight body, or of one that is hardly bent: "
                f"{TERMINATION_REASONS[status]}"
            )
        return out[: self._size, : self._size]
