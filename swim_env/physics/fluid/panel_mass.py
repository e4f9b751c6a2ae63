r"""Added mass of source panels, and its exact shape derivative by one adjoint.

The fluid enters the equations through the kinetic energy of the potential flow that the moving
body drives (11), a quadratic form of the elements' velocities along their normals and of their
turning rates, T_f = V^T A V / 2. With B the normal velocity of the boundary per unit motion, L the
panel lengths, G the normal influence and P the potential influence,

.. math:: A = -\rho\, \mathrm{sym}(B^T \mathrm{diag}(L)\, P\, G^{-1} B).

The motions are ordered V = (v_1 ... v_N, w_1 ... w_N) and, with the axial added mass of the ends,
(a_1, a_N). The models with panels share this, on the closed outline and on the centre line.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.layout import (
    FluidConstants,
    FluidWork,
    motion_count,
    padded_motions,
    unit_motion,
)
from swim_env.physics.fluid.outline import AXIAL, LATERAL, LENGTH, ROTARY
from swim_env.physics.fluid.sources import POTENTIAL, normal_influence, shape_gradient
from swim_env.physics.runtime.compile import kernel
from swim_env.physics.runtime.dense import (
    add_multiple,
    invert,
    invert_in_order,
    mat_vec,
    mat_vec_transposed,
    multiply,
)
from swim_env.physics.status import FINE, INFLUENCE_SINGULAR

Array = NDArray[np.float64]

#: The normal influence, times 2 pi, is eliminated without row exchanges while no pivot is below
#: this (its diagonal is pi). On bodies of a metre with half thicknesses from 1 to 60 mm, 2 to 12
#: panels an element and joints bent by up to a radian, pivots stayed above 0.2 and no entry grew
#: beyond 5; thinner bodies take the elimination with exchanges.
SMALLEST_PIVOT = 0.05

#: Beyond this condition (1-norm) an inverse of the normal influence is not taken: rounding would
#: have taken six digits and more of what is made with it. It grows like the inverse of the
#: thickness, 1.4e7 at a millionth of an element, and only bodies too thin for an elimination
#: without exchanges are asked for it.
LARGEST_CONDITION = 1e10


@kernel
def _part_end_of_chain(last: int, inverse: Array, layers: Array) -> None:
    """Make the panel that ends the chain neither a source nor a boundary."""
    for j in range(inverse.shape[1]):
        inverse[last, j] = 0.0
        inverse[j, last] = 0.0
        layers[POTENTIAL, last, j] = 0.0
    for i in range(last):
        layers[POTENTIAL, i, last] = 0.0
    inverse[last, last] = 1.0


@kernel
def largest_column_sum(count: int, matrix: Array) -> float:
    """Return the 1-norm of the first rows and columns, as many as count."""
    largest = 0.0
    for j in range(count):
        total = 0.0
        for i in range(count):
            total += abs(matrix[i, j])
        largest = max(largest, total)
    return largest


@kernel
def invert_influence(count: int, sources: int, work: FluidWork) -> int:
    """Invert the normal influence of the first panels, as many as count; 0 or a reason's code.

    All of a closed outline's are sources. The last panel of an open chain only ends it, see
    `swim_env.physics.fluid.centreline`.
    """
    for exchanged in range(2):
        normal_influence(work.outline.panels, count, work.layers, work.inverse)
        if sources < count:
            _part_end_of_chain(sources, work.inverse, work.layers)
        if exchanged == 0:
            if invert_in_order(work.inverse, SMALLEST_PIVOT):
                break
        else:
            before = largest_column_sum(count, work.inverse)
            if not invert(work.inverse, work.permutation):
                return INFLUENCE_SINGULAR
            condition = before * largest_column_sum(count, work.inverse)
            if not condition <= LARGEST_CONDITION:
                return INFLUENCE_SINGULAR
    return FINE


@kernel
def load_motions(count: int, fluid: FluidConstants, work: FluidWork) -> None:
    """Sum the potentials at the first panels, as many as count, into loads.

    B is zero but for two or three entries a panel.
    """
    elements = fluid.geometry.elements
    outline = work.outline
    panels = outline.panels
    work.loads[:] = 0.0
    for p in range(count):
        k = outline.element[p]
        length = panels[LENGTH, p]
        potential = work.layers[POTENTIAL, p]
        if panels[LATERAL, p] != 0.0:
            add_multiple(work.loads[k], potential, length * panels[LATERAL, p])
        add_multiple(work.loads[elements + k], potential, length * panels[ROTARY, p])
        if fluid.axial and panels[AXIAL, p] != 0.0:
            row = work.loads[unit_motion(k, AXIAL, fluid)]
            add_multiple(row, potential, length * panels[AXIAL, p])


@kernel
def solve_adjoints(fluid: FluidConstants, work: FluidWork) -> None:
    """Write the adjoint strengths, loads G^-1: what every source adds to the motions' impulses."""
    rows = padded_motions(fluid)
    multiply(work.loads, work.inverse, work.adjoints[:rows])


@kernel
def symmetric_mass(fluid: FluidConstants, work: FluidWork, out: Array) -> None:
    """Write A = -rho sym(product)."""
    half = -0.5 * fluid.density
    for a in range(motion_count(fluid)):
        for b in range(a + 1):
            value = half * (work.product[a, b] + work.product[b, a])
            out[a, b] = value
            out[b, a] = value


@kernel
def differentiate_panels(motion: Array, count: int, fluid: FluidConstants, work: FluidWork) -> None:
    """Differentiate -V^T A V/rho by what the panels are made of, into `work.gradient`.

    With sigma = G^-1 B V and mu = G^-T P^T diag(L) B V it needs no further solve. Rows of the
    gradient: the vertices' x and y, the direction, the length and the arm of every panel.
    """
    elements = fluid.geometry.elements
    outline = work.outline
    panels = outline.panels
    sigma, mu, phi = work.sigma, work.mu, work.phi
    velocity, weight, load = work.velocity, work.weight, work.load
    gradient = work.gradient
    for i in range(count):
        k = outline.element[i]
        normal = panels[LATERAL, i] * motion[k] + panels[ROTARY, i] * motion[elements + k]
        if fluid.axial and panels[AXIAL, i] != 0.0:
            normal += panels[AXIAL, i] * motion[unit_motion(k, AXIAL, fluid)]
        velocity[i] = normal
        weight[i] = normal * panels[LENGTH, i]
    mat_vec(work.inverse, velocity, sigma)
    mat_vec(work.layers[POTENTIAL], sigma, phi)
    motions = motion_count(fluid)
    mat_vec_transposed(work.loads[:motions], motion[:motions], load)
    mat_vec_transposed(work.adjoints[:motions], motion[:motions], mu)
    for i in range(count):
        # The length of a panel as the weight of its potential; on a side, the arm of the
        # collocation point in the boundary value v + w arm.
        turning = motion[elements + outline.element[i]]
        gradient[3, i] = velocity[i] * phi[i]
        gradient[4, i] = (panels[LENGTH, i] * phi[i] + mu[i]) * panels[LATERAL, i] * turning
    shape_gradient(panels, count, work.layers, weight, sigma, mu, load, work.scratch, gradient)
