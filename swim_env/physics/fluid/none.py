"""Fluid model ``none``: no fluid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.layout import FluidConstants, FluidWork
from swim_env.physics.fluid.model import Model
from swim_env.physics.runtime.compile import inlined
from swim_env.physics.status import FINE

Array = NDArray[np.float64]


@inlined
def _added_mass(joint_angles: Array, fluid: FluidConstants, work: FluidWork, out: Array) -> int:
    out[:] = 0.0
    return FINE


@inlined
def _shape_force(motion: Array, fluid: FluidConstants, work: FluidWork, out: Array) -> None:
    out[:] = 0.0


MODEL = Model(_added_mass, _shape_force)
