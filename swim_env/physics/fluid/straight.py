"""Panels' added mass of the straight body and of shapes near it, for models that start from it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SwimError
from swim_env.physics.fluid.layout import motion_count, new_fluid_work
from swim_env.physics.fluid.outline import FluidGeometry
from swim_env.physics.runtime.references import Referenced
from swim_env.physics.runtime.views import padded
from swim_env.physics.status import FINE, TERMINATION_REASONS, describe

Array = NDArray[np.float64]


class NearlyStraight:
    """The panels' added mass of shapes of one body that are hardly bent."""

    def __init__(self, geometry: FluidGeometry, density: float) -> None:
        # Imported here: the table of models holds those that start from these shapes.
        from swim_env.physics.fluid import models

        self._added_mass = models.added_mass
        fluid = models.fluid_constants("panels", geometry, density)
        self._fluid, self._work = Referenced(fluid), Referenced(new_fluid_work(fluid))
        self._size = int(motion_count(fluid))

    def added_mass(self, joint_angles: Array) -> Array:
        """Return A (2 N, 2 N) of a shape with these joint angles (rad).

        Raises
        ------
        SwimError
            If panels give none.
        """
        out = np.zeros((padded(self._size), padded(self._size)))
        status = self._added_mass(joint_angles, self._fluid, self._work, out)
        if status != FINE:
            raise SwimError(
                f"panels give no added mass of the body with joint angles up to "
                f"{float(np.abs(joint_angles).max(initial=0.0)):.2g} rad: "
                f"{describe(TERMINATION_REASONS[status])}"
            )
        return out[: self._size, : self._size]
