"""Fluid model ``panels``: source panels on the closed outline of every shape (see panel_mass)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.layout import FluidConstants, FluidWork
from swim_env.physics.fluid.model import Costs, Model
from swim_env.physics.fluid.outline import (
    build_outline,
    gradient_to_element_angles,
    outline_status,
    panel_count,
)
from swim_env.physics.fluid.panel_mass import differentiate_panels, invert_influence, sum_added_mass
from swim_env.physics.fluid.sources import influence
from swim_env.physics.runtime.compile import inlined
from swim_env.physics.status import FINE

Array = NDArray[np.float64]


@inlined
def _added_mass(joint_angles: Array, fluid: FluidConstants, work: FluidWork, out: Array) -> int:
    geometry = fluid.geometry
    outline = work.outline
    count = panel_count(geometry)
    status = build_outline(joint_angles, geometry, outline)
    if status == FINE:
        status = outline_status(geometry, outline)
    if status != FINE:
        return status
    body_length = geometry.elements * geometry.element_length
    influence(outline.panels, count, body_length, work.half_log, work.layers)
    status = invert_influence(count, False, fluid, work)
    if status != FINE:
        return status
    sum_added_mass(count, fluid, work, out)
    return FINE


@inlined
def _shape_force(motion: Array, fluid: FluidConstants, work: FluidWork, out: Array) -> None:
    """Differentiate the discrete A exactly, by one adjoint."""
    differentiate_panels(motion, panel_count(fluid.geometry), fluid, work)
    gradient_to_element_angles(
        fluid.geometry, work.outline, work.gradient, work.joint_gradient, out
    )
    for k in range(fluid.geometry.elements):
        out[k] *= -0.5 * fluid.density


def panel_costs(elements: int, panels: int) -> Costs:
    """Return the rough costs of a model with panels (s)."""
    return 4e-6 + 2e-9 * panels**2 + 9e-12 * panels**3, 6e-6 + 1e-8 * panels**2 + 8e-11 * panels**3


MODEL = Model(_added_mass, _shape_force, varies=True, panels=panel_count, costs=panel_costs)
