r"""Fluid model ``centreline``: sources on the centre line alone, as (27) to (29) are printed.

Every element carries constant-strength panels on its own line, with the normal d1 and the fluid on
that side of it only. Such an open sheet has a net flux, so its added mass depends on the length in
whose units the logarithm is taken (the body's), and a mirrored motion does not have the mirrored
effect: this model is here to show what the printed equations say, not to be used.

The chain runs from tail to head, so that the panels' normal (st, -ct) is d1, and ends with one more
panel that continues it: it carries the last vertex, and is neither a source nor a boundary.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.contact import touches_itself
from swim_env.physics.fluid.layout import FluidConstants, FluidWork
from swim_env.physics.fluid.model import Model
from swim_env.physics.fluid.outline import (
    ANGLE,
    ARM,
    AXIAL,
    CT,
    CX,
    CY,
    LATERAL,
    LENGTH,
    NODE_X,
    NODE_Y,
    ROTARY,
    ST,
    FluidGeometry,
    OutlineArrays,
    X,
    Y,
)
from swim_env.physics.fluid.panel_mass import (
    differentiate_panels,
    invert_influence,
    load_motions,
    solve_adjoints,
    symmetric_mass,
)
from swim_env.physics.fluid.panels import panel_costs
from swim_env.physics.fluid.sources import influence
from swim_env.physics.runtime.compile import inlined, kernel, shared
from swim_env.physics.runtime.linking import linked_kernel
from swim_env.physics.status import FINE, UNDER_RESOLVED_GAP
from swim_env.scene import Fluid

Array = NDArray[np.float64]

#: Boundary values of a turning element, w b: factor of the arm, and where the arm is measured from
#: along the element, in element lengths from its centre. The paper prints the factor 1/2 (28) and
#: leaves open where its s begins.
VARIANTS: dict[str, tuple[float, float]] = {
    "consistent": (1.0, 0.0),
    "printed_factor": (0.5, 0.0),
    "arm_from_start": (1.0, -0.5),
    "printed_factor_arm_from_start": (0.5, -0.5),
}


@shared
def _chain_count(geometry: FluidGeometry) -> int:
    """Return the number of panels of the chain, the one that only ends it included."""
    return geometry.elements * geometry.side_panels + 1


@kernel
def _build_chain(
    joint_angles: Array,
    factor: float,
    origin: float,
    geometry: FluidGeometry,
    scratch: Array,
    out: OutlineArrays,
) -> int:
    """Lay panels on the centre line, in the frame of element 1.

    Parameters
    ----------
    joint_angles : (N - 1,) array
        theta_{k+1} - theta_k (rad).
    factor, origin : float
        A row of VARIANTS.
    geometry : FluidGeometry
        Sizes; `side_panels` is the number of panels on an element.
    scratch : (4, N or more) array
        Overwritten.
    out : OutlineArrays
        Overwritten.

    Returns
    -------
    int
        FINE, or UNDER_RESOLVED_GAP where elements are closer to each other than half a panel.
    """
    elements = geometry.elements
    dl = geometry.element_length
    side = geometry.side_panels
    panel = dl / side
    out.nodes[ANGLE, 0] = 0.0
    out.nodes[NODE_X, 0] = 0.0
    out.nodes[NODE_Y, 0] = 0.0
    for k in range(elements):
        if k > 0:
            out.nodes[ANGLE, k] = out.nodes[ANGLE, k - 1] + joint_angles[k - 1]
        ct = np.cos(out.nodes[ANGLE, k])
        st = np.sin(out.nodes[ANGLE, k])
        scratch[0, k] = ct
        scratch[1, k] = st
        out.nodes[NODE_X, k + 1] = out.nodes[NODE_X, k] + dl * ct
        out.nodes[NODE_Y, k + 1] = out.nodes[NODE_Y, k] + dl * st
    if touches_itself(elements, scratch[0:2], 0.25 * panel, dl, scratch[2:4]):
        return UNDER_RESOLVED_GAP
    last = elements * side
    for i in range(out.element.size):
        out.panels[:, i] = 0.0
        out.panels[CT, i] = 1.0
        out.element[i] = 0
    for i in range(last + 1):
        # The panel that ends the chain continues it in front of the head.
        k = elements - 1 - i // side if i < last else 0
        behind = 0.5 * dl - (i % side) * panel if i < last else -0.5 * dl
        ct = scratch[0, k]
        st = scratch[1, k]
        start_x = out.nodes[NODE_X, k] + ct * (behind + 0.5 * dl)
        start_y = out.nodes[NODE_Y, k] + st * (behind + 0.5 * dl)
        out.panels[X, i] = start_x
        out.panels[Y, i] = start_y
        out.panels[CX, i] = start_x - 0.5 * panel * ct
        out.panels[CY, i] = start_y - 0.5 * panel * st
        out.panels[CT, i] = -ct
        out.panels[ST, i] = -st
        out.panels[LENGTH, i] = panel
        out.element[i] = k
        if i < last:
            arm = behind - 0.5 * panel
            out.panels[ARM, i] = arm
            out.panels[LATERAL, i] = 1.0
            out.panels[ROTARY, i] = factor * (arm - origin * dl)
            out.panels[AXIAL, i] = 0.0
    for i in range(last + 1, out.element.size):
        out.panels[X, i] = out.panels[X, 0]
        out.panels[Y, i] = out.panels[Y, 0]
    return FINE


@kernel
def _chain_gradient(
    geometry: FluidGeometry, outline: OutlineArrays, gradient: Array, out: Array
) -> None:
    """Turn derivatives with respect to panels into derivatives with respect to element angles.

    Parameters
    ----------
    geometry, outline : FluidGeometry, OutlineArrays
        The chain that the derivatives belong to.
    gradient : (3 or more, M or more) array
        Derivative with respect to the vertices' x and y, and to the direction of every panel.
    out : (N,) array
        Overwritten: derivative with respect to theta_k.
    """
    elements = geometry.elements
    side = geometry.side_panels
    dl = geometry.element_length
    # From tail to head, as for the closed outline: force and moment, about the node in front of an
    # element, of everything behind it.
    force_x = 0.0
    force_y = 0.0
    moment = 0.0
    behind = 0.0
    for back in range(elements):
        k = elements - 1 - back
        ct = np.cos(outline.nodes[ANGLE, k])
        st = np.sin(outline.nodes[ANGLE, k])
        moment += dl * (ct * force_y - st * force_x)
        for i in range(back * side, (back + 1) * side):
            gx = gradient[0, i]
            gy = gradient[1, i]
            force_x += gx
            force_y += gy
            dx = outline.panels[X, i] - outline.nodes[NODE_X, k]
            dy = outline.panels[Y, i] - outline.nodes[NODE_Y, k]
            moment += dx * gy - dy * gx + gradient[2, i]
        # Turning the whole chain changes nothing.
        joint = moment if k > 0 else 0.0
        out[k] = joint - behind
        behind = joint


@inlined
def _sum_chain_motions(fluid: FluidConstants, work: FluidWork) -> None:
    """Multiply the adjoint strengths by B."""
    elements = fluid.geometry.elements
    side = fluid.geometry.side_panels
    panels = work.outline.panels
    for a in range(2 * elements):
        for k in range(elements):
            lateral = 0.0
            rotary = 0.0
            first = (elements - 1 - k) * side
            for p in range(first, first + side):
                lateral += work.adjoints[a, p] * panels[LATERAL, p]
                rotary += work.adjoints[a, p] * panels[ROTARY, p]
            work.product[a, k] = lateral
            work.product[a, elements + k] = rotary


@linked_kernel
def _added_mass(joint_angles: Array, fluid: FluidConstants, work: FluidWork, out: Array) -> int:
    geometry = fluid.geometry
    outline = work.outline
    count = _chain_count(geometry)
    factor, origin = fluid.terms[0], fluid.terms[1]
    status = _build_chain(joint_angles, factor, origin, geometry, work.scratch, outline)
    if status != FINE:
        return status
    body_length = geometry.elements * geometry.element_length
    influence(outline.panels, count, body_length, work.half_log, work.layers)
    status = invert_influence(count, count - 1, work)
    if status != FINE:
        return status
    load_motions(count, fluid, work)
    solve_adjoints(fluid, work)
    _sum_chain_motions(fluid, work)
    symmetric_mass(fluid, work, out)
    return FINE


@linked_kernel
def _shape_force(motion: Array, fluid: FluidConstants, work: FluidWork, out: Array) -> None:
    differentiate_panels(motion, _chain_count(fluid.geometry), fluid, work)
    _chain_gradient(fluid.geometry, work.outline, work.gradient, out)
    for k in range(fluid.geometry.elements):
        out[k] *= -0.5 * fluid.density


def _terms(fluid: Fluid, geometry: FluidGeometry) -> Array:
    return np.array(VARIANTS[fluid.variant or "consistent"])


# On the centre line there is one side.
MODEL = Model(
    _added_mass,
    _shape_force,
    varies=True,
    terms=_terms,
    panels=_chain_count,
    costs=panel_costs,
    sides=1,
)
