"""Fluid model ``panels``: source panels on the closed outline of every shape (see panel_mass)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.layout import FluidConstants, FluidWork, motion_count, unit_motion
from swim_env.physics.fluid.model import Costs, Model
from swim_env.physics.fluid.outline import (
    ABOVE,
    AXIAL,
    BELOW,
    HEAD,
    LATERAL,
    ROTARY,
    build_outline,
    first_end_panel,
    first_panel,
    gradient_to_element_angles,
    outline_status,
    panel_count,
)
from swim_env.physics.fluid.panel_mass import (
    differentiate_panels,
    invert_influence,
    load_motions,
    solve_adjoints,
    symmetric_mass,
)
from swim_env.physics.fluid.sources import influence
from swim_env.physics.runtime.compile import inlined
from swim_env.physics.runtime.linking import linked_kernel
from swim_env.physics.status import FINE

Array = NDArray[np.float64]


@inlined
def _sum_motions(fluid: FluidConstants, work: FluidWork) -> None:
    """Multiply the adjoint strengths by B: sum them over the panels of every motion."""
    geometry = fluid.geometry
    elements = geometry.elements
    sides = geometry.side_panels
    lateral_of, rotary_of = work.outline.panels[LATERAL], work.outline.panels[ROTARY]
    axial_of = work.outline.panels[AXIAL]
    for a in range(motion_count(fluid)):
        row = work.adjoints[a]
        product = work.product[a]
        for k in range(elements):
            below = first_panel(geometry, k, BELOW)
            above = first_panel(geometry, k, ABOVE)
            lateral = 0.0
            rotary = 0.0
            for p in range(below, below + sides):
                lateral += row[p] * lateral_of[p]
                rotary += row[p] * rotary_of[p]
            for p in range(above, above + sides):
                lateral += row[p] * lateral_of[p]
                rotary += row[p] * rotary_of[p]
            product[k] = lateral
            product[elements + k] = rotary
        for end in range(2):
            k = 0 if end == HEAD else elements - 1
            first = first_end_panel(geometry, end)
            axial = 0.0
            for p in range(first, first + geometry.cap_panels):
                product[elements + k] += row[p] * rotary_of[p]
                axial += row[p] * axial_of[p]
            if fluid.axial:
                product[unit_motion(k, AXIAL, fluid)] = axial


@linked_kernel
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
    status = invert_influence(count, count, work)
    if status != FINE:
        return status
    load_motions(count, fluid, work)
    solve_adjoints(fluid, work)
    _sum_motions(fluid, work)
    symmetric_mass(fluid, work, out)
    return FINE


@linked_kernel
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
