r"""Added mass of a bent beam in ideal fluid, its exact shape derivative, and the fluid models.

The fluid enters the equations through the kinetic energy of the potential flow that the moving
body drives (11), a quadratic form of the elements' velocities along their normals and of their
turning rates, T_f = V^T A V / 2. With B the normal velocity of the boundary per unit motion, L the
panel lengths, G the normal influence and P the potential influence,

.. math:: A = -\rho\, \mathrm{sym}(B^T \mathrm{diag}(L)\, P\, G^{-1} B).

The motions are ordered V = (v_1 ... v_N, w_1 ... w_N) and, with the axial added mass of the ends,
(a_1, a_N): only the end elements have panels that move along their normal when the element moves
along d3.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics._compile import kernel, vector_kernel
from swim_env.physics.dense import (
    dot,
    invert,
    invert_in_order,
    mat_vec,
    mat_vec_transposed,
    matrix_view,
)
from swim_env.physics.outline import (
    AXIAL,
    LATERAL,
    LENGTH,
    NODE_ROWS,
    PANEL_ROWS,
    ROTARY,
    FluidGeometry,
    OutlineArrays,
    build_outline,
    gradient_to_element_angles,
    outline_status,
    panel_count,
)
from swim_env.physics.panels import (
    LAYERS,
    POTENTIAL,
    SHAPE_SCRATCH,
    influence,
    normal_influence_transposed,
    shape_gradient,
)
from swim_env.physics.status import FINE, INFLUENCE_SINGULAR

__all__ = [
    "FLUID_MODELS",
    "FluidConstants",
    "FluidWork",
    "added_mass",
    "carve_fluid_work",
    "fluid_work_sizes",
    "motion_count",
    "shape_force",
]

Array = NDArray[np.float64]

#: The normal influence, times 2 pi, is eliminated without row exchanges while no pivot is below
#: this (its diagonal is pi). On bodies of a metre with half thicknesses from 1 to 60 mm, 2 to 12
#: panels an element and joints bent by up to a radian, pivots stayed above 0.2 and no entry grew
#: beyond 5; thinner bodies take the elimination with exchanges.
SMALLEST_PIVOT = 0.05

NO_FLUID = 0
PANELS = 1

#: Fluid models that a scene may name, and the code by which the kernels know them. A new model is
#: one line here, a branch in `added_mass` and one in `shape_force`.
FLUID_MODELS: dict[str, int] = {"none": NO_FLUID, "panels": PANELS}


class FluidConstants(NamedTuple):
    """What a scene says of the fluid.

    Attributes
    ----------
    model : int
        A code of FLUID_MODELS.
    geometry : FluidGeometry
        How the beam is wrapped into panels.
    density : float
        rho (kg/m^3, unit depth).
    axial : bool
        Whether the ends' axial added mass is part of the model.
    """

    model: int
    geometry: FluidGeometry
    density: float
    axial: bool


class FluidWork(NamedTuple):
    """Arrays that `added_mass` leaves behind for `shape_force`, and their scratch space.

    Attributes
    ----------
    outline : OutlineArrays
        The outline of M panels.
    layers : (LAYERS, M, M) array
        Influence matrices, see `swim_env.physics.panels`.
    inverse_transposed : (M, M) array
        Inverse of the transposed normal influence.
    sources, loads : (K, M) arrays
        Source strengths per unit motion, transposed G^-1 B, and B^T diag(L) P.
    vectors : (rows, M) array
        Scratch.
    half_log : (M + 1,) array
        Scratch.
    joint_gradient : (N + 1,) array
        Scratch.
    permutation : (M,) int array
        Row exchanges of the inversion.
    """

    outline: OutlineArrays
    layers: Array
    inverse_transposed: Array
    sources: Array
    loads: Array
    vectors: Array
    half_log: Array
    joint_gradient: Array
    permutation: NDArray[np.int64]


# Rows of `FluidWork.vectors`: source strengths, adjoint strengths, potential, panel-weighted
# normal velocity and B^T diag(L) P V; then the gradient by panel quantities; then scratch.
_SIGMA, _MU, _PHI, _WEIGHT, _LOAD, _GRADIENT = range(6)
_SHAPE = _GRADIENT + 5
_SCRATCH = _SHAPE + SHAPE_SCRATCH


@kernel
def motion_count(fluid: FluidConstants) -> int:
    """Return the number K of unit motions: 2 N, and 2 more with the axial effect."""
    return 2 * fluid.geometry.elements + (2 if fluid.axial else 0)


@kernel
def fluid_work_sizes(fluid: FluidConstants) -> tuple[int, int]:
    """Return how many float64 and int64 numbers `carve_fluid_work` takes."""
    m = 0 if fluid.model == NO_FLUID else panel_count(fluid.geometry)
    n = fluid.geometry.elements
    floats = (
        (LAYERS + 1) * m * m
        + (2 * motion_count(fluid) + PANEL_ROWS + _SCRATCH) * m
        + (NODE_ROWS + 1) * (n + 1)
        + m
        + 1
    )
    return floats, 2 * m


@kernel
def carve_fluid_work(
    floats: Array, integers: NDArray[np.int64], fluid: FluidConstants
) -> FluidWork:
    """Lay the arrays of `FluidWork` into two flat buffers of the sizes of `fluid_work_sizes`."""
    m = 0 if fluid.model == NO_FLUID else panel_count(fluid.geometry)
    n = fluid.geometry.elements
    k = motion_count(fluid)
    start = LAYERS * m * m
    layers = floats[:start].reshape((LAYERS, m, m))
    inverse = matrix_view(floats, start, m, m)
    start += m * m
    sources = matrix_view(floats, start, k, m)
    start += k * m
    loads = matrix_view(floats, start, k, m)
    start += k * m
    panels = matrix_view(floats, start, PANEL_ROWS, m)
    start += PANEL_ROWS * m
    vectors = matrix_view(floats, start, _SCRATCH, m)
    start += _SCRATCH * m
    nodes = matrix_view(floats, start, NODE_ROWS, n + 1)
    start += NODE_ROWS * (n + 1)
    return FluidWork(
        OutlineArrays(panels, nodes, integers[:m]),
        layers,
        inverse,
        sources,
        loads,
        vectors,
        floats[start + n + 1 : start + n + m + 2],
        floats[start : start + n + 1],
        integers[m : 2 * m],
    )


@vector_kernel
def _add_multiple(target: Array, source: Array, factor: float) -> None:
    for j in range(target.size):
        target[j] += factor * source[j]


@kernel
def _collect_motions(fluid: FluidConstants, work: FluidWork) -> None:
    """Sum panels into unit motions: B is zero but for two or three entries a panel."""
    elements = fluid.geometry.elements
    outline = work.outline
    work.sources[:] = 0.0
    work.loads[:] = 0.0
    for p in range(outline.element.size):
        k = outline.element[p]
        length = outline.panels[LENGTH, p]
        for motion in range(3):
            if motion == 0:
                factor = outline.panels[LATERAL, p]
                row = k
            elif motion == 1:
                factor = outline.panels[ROTARY, p]
                row = elements + k
            else:
                if not fluid.axial:
                    continue
                factor = outline.panels[AXIAL, p]
                row = 2 * elements + (1 if k > 0 else 0)
            if factor != 0.0:
                _add_multiple(work.sources[row], work.inverse_transposed[p], factor)
                _add_multiple(work.loads[row], work.layers[POTENTIAL, p], factor * length)


@kernel
def _panel_added_mass(
    joint_angles: Array, fluid: FluidConstants, work: FluidWork, out: Array
) -> int:
    geometry = fluid.geometry
    outline = work.outline
    status = build_outline(joint_angles, geometry, outline)
    if status != FINE:
        return status
    status = outline_status(geometry, outline)
    if status != FINE:
        return status
    body_length = geometry.elements * geometry.element_length
    influence(outline.panels, body_length, work.half_log, work.layers)
    normal_influence_transposed(outline.panels, work.layers, work.inverse_transposed)
    if not invert_in_order(work.inverse_transposed, SMALLEST_PIVOT):
        normal_influence_transposed(outline.panels, work.layers, work.inverse_transposed)
        if not invert(work.inverse_transposed, work.permutation):
            return INFLUENCE_SINGULAR
    _collect_motions(fluid, work)
    half = -0.5 * fluid.density
    for a in range(out.shape[0]):
        for b in range(a + 1):
            value = half * (
                dot(work.loads[a], work.sources[b]) + dot(work.loads[b], work.sources[a])
            )
            out[a, b] = value
            out[b, a] = value
    return FINE


@kernel
def _panel_shape_force(motion: Array, fluid: FluidConstants, work: FluidWork, out: Array) -> None:
    elements = fluid.geometry.elements
    outline = work.outline
    panels = outline.panels
    sigma = work.vectors[_SIGMA]
    mu = work.vectors[_MU]
    phi = work.vectors[_PHI]
    weight = work.vectors[_WEIGHT]
    load = work.vectors[_LOAD]
    gradient = work.vectors[_GRADIENT:_SHAPE]
    mat_vec_transposed(work.sources, motion, sigma)
    mat_vec_transposed(work.loads, motion, load)
    mat_vec(work.inverse_transposed, load, mu)
    mat_vec(work.layers[POTENTIAL], sigma, phi)
    for i in range(panels.shape[1]):
        k = outline.element[i]
        turning = motion[elements + k]
        normal_velocity = panels[LATERAL, i] * motion[k] + panels[ROTARY, i] * turning
        if fluid.axial and panels[AXIAL, i] != 0.0:
            normal_velocity += panels[AXIAL, i] * motion[2 * elements + (1 if k > 0 else 0)]
        weight[i] = normal_velocity * panels[LENGTH, i]
        # The length of a panel as the weight of its potential; on a side, the arm of the
        # collocation point in the boundary value v + w arm.
        gradient[3, i] = normal_velocity * phi[i]
        gradient[4, i] = (panels[LENGTH, i] * phi[i] + mu[i]) * panels[LATERAL, i] * turning
    shape_gradient(panels, work.layers, weight, sigma, mu, work.vectors[_SHAPE:], gradient)
    gradient_to_element_angles(fluid.geometry, outline, gradient, work.joint_gradient, out)
    for k in range(elements):
        out[k] *= -0.5 * fluid.density


@kernel
def added_mass(joint_angles: Array, fluid: FluidConstants, work: FluidWork, out: Array) -> int:
    """Evaluate the added mass of a shape with the scene's fluid model.

    Parameters
    ----------
    joint_angles : (N - 1,) array
        theta_{k+1} - theta_k (rad).
    fluid : FluidConstants
        Model and sizes.
    work : FluidWork
        Overwritten; `shape_force` reads it.
    out : (K, K) array
        Overwritten: the symmetric added mass A (kg/m, kg, kg m per metre of depth for v-v, v-w
        and w-w entries, all times a length).

    Returns
    -------
    int
        0, or the code of the reason why there is none (see `swim_env.physics.status`).
    """
    if fluid.model == PANELS:
        return _panel_added_mass(joint_angles, fluid, work, out)
    out[:] = 0.0
    return FINE


@kernel
def shape_force(motion: Array, fluid: FluidConstants, work: FluidWork, out: Array) -> None:
    """Differentiate V^T A V / 2 with respect to every element angle, V held.

    The derivative of the discrete A is exact and is obtained by one adjoint: with
    sigma = G^-1 B V and mu = G^-T P^T diag(L) B V it needs no further solve.

    Parameters
    ----------
    motion : (K,) array
        Unit-motion velocities V (or increments).
    fluid : FluidConstants
        Model and sizes.
    work : FluidWork
        As `added_mass` left it for this shape.
    out : (N,) array
        Overwritten: the derivative, in units of V^T A V.
    """
    if fluid.model == PANELS:
        _panel_shape_force(motion, fluid, work, out)
    else:
        out[:] = 0.0
