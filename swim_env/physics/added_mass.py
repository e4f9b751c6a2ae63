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
    mat_vec,
    mat_vec_transposed,
    matrix_view,
)
from swim_env.physics.outline import (
    FluidGeometry,
    OutlineArrays,
    build_outline,
    gradient_to_element_angles,
    outline_status,
    panel_count,
)
from swim_env.physics.panels import influence, normal_influence_transposed, shape_gradient
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
    inverse_z_x, inverse_z_y, velocity_x, velocity_y, potential : (M, M) arrays
        Influence matrices, see `swim_env.physics.panels.influence`.
    inverse_transposed : (M, M) array
        Inverse of the transposed normal influence.
    sources : (K, M) array
        Source strengths per unit motion, transposed G^-1 B.
    loads : (K, M) array
        B^T diag(L) P.
    vectors : (24, M + 1) array
        Scratch.
    joint_gradient : (N + 1,) array
        Scratch.
    permutation : (M,) int array
        Row exchanges of the inversion.
    """

    outline: OutlineArrays
    inverse_z_x: Array
    inverse_z_y: Array
    velocity_x: Array
    velocity_y: Array
    potential: Array
    inverse_transposed: Array
    sources: Array
    loads: Array
    vectors: Array
    joint_gradient: Array
    permutation: NDArray[np.int64]


_OUTLINE_VECTORS = 11
_SCRATCH_VECTORS = 27


@kernel
def motion_count(fluid: FluidConstants) -> int:
    """Return the number K of unit motions: 2 N, and 2 more with the axial effect."""
    return 2 * fluid.geometry.elements + (2 if fluid.axial else 0)


def fluid_work_sizes(fluid: FluidConstants) -> tuple[int, int]:
    """Return how many float64 and int64 numbers `carve_fluid_work` takes."""
    if fluid.model == NO_FLUID:
        return 0, 0
    panels = int(panel_count(fluid.geometry))
    elements = fluid.geometry.elements
    motions = int(motion_count(fluid))
    floats = (
        6 * panels * panels
        + 2 * motions * panels
        + _OUTLINE_VECTORS * panels
        + _SCRATCH_VECTORS * (panels + 1)
        + elements
        + 4 * (elements + 1)
    )
    return floats, 2 * panels


@kernel
def carve_fluid_work(
    floats: Array, integers: NDArray[np.int64], fluid: FluidConstants
) -> FluidWork:
    """Lay the arrays of `FluidWork` into two flat buffers of the sizes of `fluid_work_sizes`."""
    m = panel_count(fluid.geometry)
    n = fluid.geometry.elements
    k = motion_count(fluid)
    square = m * m
    start = 6 * square
    sources = matrix_view(floats, start, k, m)
    start += k * m
    loads = matrix_view(floats, start, k, m)
    start += k * m
    rows = matrix_view(floats, start, _OUTLINE_VECTORS, m)
    start += _OUTLINE_VECTORS * m
    vectors = matrix_view(floats, start, _SCRATCH_VECTORS, m + 1)
    start += _SCRATCH_VECTORS * (m + 1)
    angle = floats[start : start + n]
    start += n
    nodes = matrix_view(floats, start, 4, n + 1)
    outline = OutlineArrays(
        angle,
        nodes[0],
        nodes[1],
        nodes[2],
        rows[0],
        rows[1],
        rows[2],
        rows[3],
        rows[4],
        rows[5],
        rows[6],
        rows[7],
        rows[8],
        rows[9],
        rows[10],
        integers[:m],
    )
    return FluidWork(
        outline,
        matrix_view(floats, 0, m, m),
        matrix_view(floats, square, m, m),
        matrix_view(floats, 2 * square, m, m),
        matrix_view(floats, 3 * square, m, m),
        matrix_view(floats, 4 * square, m, m),
        matrix_view(floats, 5 * square, m, m),
        sources,
        loads,
        vectors,
        nodes[3],
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
    for p in range(outline.length.size):
        k = outline.element[p]
        length = outline.length[p]
        for motion in range(3):
            if motion == 0:
                factor = outline.lateral[p]
                row = k
            elif motion == 1:
                factor = outline.rotary[p]
                row = elements + k
            else:
                if not fluid.axial:
                    continue
                factor = outline.axial[p]
                row = 2 * elements + (1 if k > 0 else 0)
            if factor != 0.0:
                _add_multiple(work.sources[row], work.inverse_transposed[p], factor)
                _add_multiple(work.loads[row], work.potential[p], factor * length)


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
    influence(
        outline.x,
        outline.y,
        outline.cx,
        outline.cy,
        outline.ct,
        outline.st,
        outline.length,
        geometry.elements * geometry.element_length,
        work.vectors[0],
        work.inverse_z_x,
        work.inverse_z_y,
        work.velocity_x,
        work.velocity_y,
        work.potential,
    )
    normal_influence_transposed(
        outline.ct, outline.st, work.velocity_x, work.velocity_y, work.inverse_transposed
    )
    if not invert(work.inverse_transposed, work.permutation):
        return INFLUENCE_SINGULAR
    _collect_motions(fluid, work)
    motions = out.shape[0]
    half = -0.5 * fluid.density
    for a in range(motions):
        for b in range(a + 1):
            value = half * (
                dot(work.loads[a], work.sources[b]) + dot(work.loads[b], work.sources[a])
            )
            out[a, b] = value
            out[b, a] = value
    return FINE


@kernel
def _panel_shape_force(
    motion: Array, fluid: FluidConstants, work: FluidWork, out: Array
) -> None:
    geometry = fluid.geometry
    elements = geometry.elements
    outline = work.outline
    panels = outline.length.size
    vectors = work.vectors
    sigma = vectors[0, :panels]
    mu = vectors[1, :panels]
    phi = vectors[2, :panels]
    weight = vectors[3, :panels]
    gradient_x = vectors[4, :panels]
    gradient_y = vectors[5, :panels]
    gradient_turn = vectors[6, :panels]
    gradient_length = vectors[7, :panels]
    gradient_arm = vectors[8, :panels]
    load = vectors[9, :panels]
    mat_vec_transposed(work.sources, motion, sigma)
    mat_vec_transposed(work.loads, motion, load)
    mat_vec(work.inverse_transposed, load, mu)
    mat_vec(work.potential, sigma, phi)
    for i in range(panels):
        k = outline.element[i]
        turning = motion[elements + k]
        normal_velocity = outline.lateral[i] * motion[k] + outline.rotary[i] * turning
        if fluid.axial and outline.axial[i] != 0.0:
            normal_velocity += outline.axial[i] * motion[2 * elements + (1 if k > 0 else 0)]
        weight[i] = normal_velocity * outline.length[i]
        gradient_length[i] = normal_velocity * phi[i]
        gradient_arm[i] = (outline.length[i] * phi[i] + mu[i]) * outline.lateral[i] * turning
    shape_gradient(
        outline.x,
        outline.y,
        outline.cx,
        outline.cy,
        outline.ct,
        outline.st,
        work.inverse_z_x,
        work.inverse_z_y,
        work.velocity_x,
        work.velocity_y,
        work.potential,
        outline.length,
        weight,
        sigma,
        mu,
        vectors[10:27, :panels],
        gradient_x,
        gradient_y,
        gradient_turn,
    )
    gradient_to_element_angles(
        geometry,
        outline,
        gradient_x,
        gradient_y,
        gradient_turn,
        gradient_length,
        gradient_arm,
        work.joint_gradient,
        out,
    )
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
