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

from swim_env.physics.fluid.centreline import build_chain, chain_count, chain_gradient
from swim_env.physics.fluid.outline import (
    AXIAL,
    HEAD,
    LANES,
    LATERAL,
    LENGTH,
    NODE_ROWS,
    PANEL_ROWS,
    ROTARY,
    FluidGeometry,
    OutlineArrays,
    build_outline,
    first_end_panel,
    first_panel,
    gradient_to_element_angles,
    outline_status,
    padded,
    panel_count,
)
from swim_env.physics.fluid.panels import (
    LAYERS,
    POTENTIAL,
    SHAPE_SCRATCH,
    influence,
    normal_influence,
    shape_gradient,
)
from swim_env.physics.runtime.compile import entry_kernel, inlined, kernel, shared
from swim_env.physics.runtime.dense import (
    add_multiple,
    invert,
    invert_in_order,
    mat_vec,
    mat_vec_transposed,
    multiply,
)
from swim_env.physics.status import FINE, INFLUENCE_SINGULAR

__all__ = [
    "FLUID_MODELS",
    "FluidConstants",
    "FluidWork",
    "added_mass",
    "carve_fluid_work",
    "fluid_work_sizes",
    "depends_on_shape",
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
CONSTANT = 2
EXPANSION = 3
CENTRELINE = 4

#: Beyond this condition (1-norm) an inverse of the normal influence is not taken: rounding would
#: have taken six digits and more of what is made with it. It grows like the inverse of the
#: thickness, 1.4e7 at a millionth of an element, and only bodies too thin for an elimination
#: without exchanges are asked for it.
LARGEST_CONDITION = 1e10

#: Fluid models that a scene may name, from the crudest to the full one and the one that is there
#: for comparison only, and the code by which the kernels know them. Models whose added mass is
#: constant in the elements' frames differ only in their terms, see
#: `swim_env.physics.fluid.fluid_terms`.
#: A new model is one line here, a branch in `added_mass` and one in `shape_force`.
FLUID_MODELS: dict[str, int] = {
    "none": NO_FLUID,
    "strip": CONSTANT,
    "frozen": CONSTANT,
    "expansion": EXPANSION,
    "panels": PANELS,
    "centreline": CENTRELINE,
}


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
    terms : (T,) array
        Constants of the model, see `swim_env.physics.fluid.fluid_terms`: the lower triangle of A
        for a constant added mass, behind it those of the second derivatives for the expansion;
        factor and origin of the arm for the centre line; none otherwise.
    drag : float
        rho C/2, cross-flow drag per length and squared velocity (kg/m^2 per metre of depth); 0 for
        none.
    stream_x, stream_y : float
        Velocity of the uniform stream (m/s).
    """

    model: int
    geometry: FluidGeometry
    density: float
    axial: bool
    terms: Array = np.zeros(0)
    drag: float = 0.0
    stream_x: float = 0.0
    stream_y: float = 0.0


class FluidWork(NamedTuple):
    """Arrays that `added_mass` leaves behind for `shape_force`, and their scratch space.

    The numbers M of panels and K of motions are padded to multiples of LANES, with zeros in
    whatever is multiplied by something that is not.

    Attributes
    ----------
    outline : OutlineArrays
        The outline of M panels.
    layers : (LAYERS, M, M) array
        Influence matrices, see `swim_env.physics.fluid.panels`.
    inverse : (M, M) array
        Inverse of the normal influence, filled up with the identity.
    strengths : (M, K) array
        Source strengths per unit motion, G^-1 B.
    loads : (K, M) array
        B^T diag(L) P.
    product : (K, K) array
        B^T diag(L) P G^-1 B.
    vectors : (rows, M) array
        Scratch.
    half_log : (M + 1,) array
        Scratch.
    joint_gradient : (N + 1,) array
        Scratch; the joint angles in the expansion.
    joint_scratch : (K (K + 1) / 2,) array
        Scratch of the expansion, empty otherwise.
    permutation : (M,) int array
        Row exchanges of the inversion.
    """

    outline: OutlineArrays
    layers: Array
    inverse: Array
    strengths: Array
    loads: Array
    product: Array
    vectors: Array
    half_log: Array
    joint_gradient: Array
    joint_scratch: Array
    permutation: NDArray[np.int64]


# Rows of `FluidWork.vectors`: source strengths, adjoint strengths, potential, normal velocity, the
# same times the panels' lengths, and P^T of that; then the gradient by panel quantities; then
# scratch.
_SIGMA, _MU, _PHI, _VELOCITY, _WEIGHT, _LOAD, _GRADIENT = range(7)
_SHAPE = _GRADIENT + 5
_SCRATCH = _SHAPE + SHAPE_SCRATCH


@shared
def depends_on_shape(fluid: FluidConstants) -> bool:
    """Tell whether the model's added mass changes with the joint angles."""
    return fluid.model != NO_FLUID and fluid.model != CONSTANT


@shared
def motion_count(fluid: FluidConstants) -> int:
    """Return the number K of unit motions: 2 N, and 2 more with the axial effect."""
    return 2 * fluid.geometry.elements + (2 if fluid.axial else 0)


@shared
def fluid_work_sizes(fluid: FluidConstants) -> tuple[int, int]:
    """Return how many float64 and int64 numbers `carve_fluid_work` takes; multiples of LANES."""
    m = _padded_panels(fluid)
    n = fluid.geometry.elements
    k = padded(motion_count(fluid))
    floats = (
        (LAYERS + 1) * m * m
        + 2 * k * m
        + k * k
        + (PANEL_ROWS + _SCRATCH + 1) * m
        + LANES
        + padded((NODE_ROWS + 1) * (n + 1))
        + padded(_expansion_entries(fluid))
    )
    return floats, 2 * m


@shared
def _expansion_entries(fluid: FluidConstants) -> int:
    """Return the length of a triangle of A where the model is an expansion."""
    motions = motion_count(fluid)
    return motions * (motions + 1) // 2 if fluid.model == EXPANSION else 0


@shared
def _padded_panels(fluid: FluidConstants) -> int:
    if fluid.model == CENTRELINE:
        return padded(chain_count(fluid.geometry))
    return padded(panel_count(fluid.geometry)) if fluid.model == PANELS else 0


@shared
def carve_fluid_work(
    floats: Array, integers: NDArray[np.int64], fluid: FluidConstants
) -> FluidWork:
    """Lay the arrays of `FluidWork` into two flat buffers of the sizes of `fluid_work_sizes`.

    The buffers are zero at first: what pads them is never written.
    """
    m = _padded_panels(fluid)
    n = fluid.geometry.elements
    k = padded(motion_count(fluid))
    start = LAYERS * m * m
    layers = floats[:start].reshape((LAYERS, m, m))
    inverse = floats[start : start + m * m].reshape((m, m))
    start += m * m
    strengths = floats[start : start + m * k].reshape((m, k))
    start += m * k
    loads = floats[start : start + k * m].reshape((k, m))
    start += k * m
    product = floats[start : start + k * k].reshape((k, k))
    start += k * k
    panels = floats[start : start + PANEL_ROWS * m].reshape((PANEL_ROWS, m))
    start += PANEL_ROWS * m
    vectors = floats[start : start + _SCRATCH * m].reshape((_SCRATCH, m))
    start += _SCRATCH * m
    half_log = floats[start : start + m + 1]
    start += m + LANES
    nodes = floats[start : start + NODE_ROWS * (n + 1)].reshape((NODE_ROWS, n + 1))
    start += NODE_ROWS * (n + 1)
    return FluidWork(
        OutlineArrays(panels, nodes, integers[:m]),
        layers,
        inverse,
        strengths,
        loads,
        product,
        vectors,
        half_log,
        floats[start : start + n + 1],
        floats[start + n + 1 : start + n + 1 + _expansion_entries(fluid)],
        integers[m : 2 * m],
    )


@inlined
def _collect_motions(fluid: FluidConstants, work: FluidWork) -> None:
    """Sum panels into unit motions: B is zero but for two or three entries a panel."""
    elements = fluid.geometry.elements
    outline = work.outline
    panels = outline.panels
    count = panel_count(fluid.geometry)
    for i in range(count):
        for k in range(elements):
            lateral = 0.0
            rotary = 0.0
            for side in range(2):
                first = first_panel(fluid.geometry, k, side)
                for p in range(first, first + fluid.geometry.side_panels):
                    lateral += work.inverse[i, p] * panels[LATERAL, p]
                    rotary += work.inverse[i, p] * panels[ROTARY, p]
            work.strengths[i, k] = lateral
            work.strengths[i, elements + k] = rotary
        for end in range(2):
            k = 0 if end == HEAD else elements - 1
            first = first_end_panel(fluid.geometry, end)
            axial = 0.0
            for p in range(first, first + fluid.geometry.cap_panels):
                work.strengths[i, elements + k] += work.inverse[i, p] * panels[ROTARY, p]
                axial += work.inverse[i, p] * panels[AXIAL, p]
            if fluid.axial:
                work.strengths[i, 2 * elements + end] = axial
    work.loads[:] = 0.0
    for p in range(count):
        k = outline.element[p]
        length = panels[LENGTH, p]
        potential = work.layers[POTENTIAL, p]
        if panels[LATERAL, p] != 0.0:
            add_multiple(work.loads[k], potential, length * panels[LATERAL, p])
        add_multiple(work.loads[elements + k], potential, length * panels[ROTARY, p])
        if fluid.axial and panels[AXIAL, p] != 0.0:
            row = 2 * elements + (1 if k > 0 else 0)
            add_multiple(work.loads[row], potential, length * panels[AXIAL, p])


@inlined
def _collect_chain_motions(fluid: FluidConstants, work: FluidWork) -> None:
    """Sum the panels of the centre line into unit motions."""
    elements = fluid.geometry.elements
    side = fluid.geometry.side_panels
    panels = work.outline.panels
    work.loads[:] = 0.0
    for k in range(elements):
        first = (elements - 1 - k) * side
        for i in range(elements * side):
            lateral = 0.0
            rotary = 0.0
            for p in range(first, first + side):
                lateral += work.inverse[i, p] * panels[LATERAL, p]
                rotary += work.inverse[i, p] * panels[ROTARY, p]
            work.strengths[i, k] = lateral
            work.strengths[i, elements + k] = rotary
        for p in range(first, first + side):
            for i in range(elements * side):
                potential = panels[LENGTH, p] * work.layers[POTENTIAL, p, i]
                work.loads[k, i] += panels[LATERAL, p] * potential
                work.loads[elements + k, i] += panels[ROTARY, p] * potential


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
def _largest_column_sum(count: int, matrix: Array) -> float:
    """Return the 1-norm of the first rows and columns, as many as count."""
    largest = 0.0
    for j in range(count):
        total = 0.0
        for i in range(count):
            total += abs(matrix[i, j])
        largest = max(largest, total)
    return largest


@inlined
def _panel_added_mass(
    joint_angles: Array, fluid: FluidConstants, work: FluidWork, out: Array
) -> int:
    """Weigh a shape with panels on its outline, or on its centre line."""
    geometry = fluid.geometry
    outline = work.outline
    open_chain = fluid.model == CENTRELINE
    if open_chain:
        count = chain_count(geometry)
        factor, origin = fluid.terms[0], fluid.terms[1]
        status = build_chain(joint_angles, factor, origin, geometry, work.vectors, outline)
    else:
        count = panel_count(geometry)
        status = build_outline(joint_angles, geometry, outline)
        if status == FINE:
            status = outline_status(geometry, outline)
    if status != FINE:
        return status
    body_length = geometry.elements * geometry.element_length
    influence(outline.panels, count, body_length, work.half_log, work.layers)
    for exchanged in range(2):
        normal_influence(outline.panels, count, work.layers, work.inverse)
        if open_chain:
            _part_end_of_chain(count - 1, work.inverse, work.layers)
        if exchanged == 0:
            if invert_in_order(work.inverse, SMALLEST_PIVOT):
                break
        else:
            before = _largest_column_sum(count, work.inverse)
            if not invert(work.inverse, work.permutation):
                return INFLUENCE_SINGULAR
            condition = before * _largest_column_sum(count, work.inverse)
            if not condition <= LARGEST_CONDITION:
                return INFLUENCE_SINGULAR
    if open_chain:
        _collect_chain_motions(fluid, work)
    else:
        _collect_motions(fluid, work)
    motions = motion_count(fluid)
    multiply(work.loads, work.strengths, work.product[:motions])
    half = -0.5 * fluid.density
    for a in range(motions):
        for b in range(a + 1):
            value = half * (work.product[a, b] + work.product[b, a])
            out[a, b] = value
            out[b, a] = value
    return FINE


@inlined
def _panel_shape_force(motion: Array, fluid: FluidConstants, work: FluidWork, out: Array) -> None:
    """Differentiate by one adjoint, for the closed outline and for the centre line."""
    elements = fluid.geometry.elements
    outline = work.outline
    panels = outline.panels
    open_chain = fluid.model == CENTRELINE
    count = chain_count(fluid.geometry) if open_chain else panel_count(fluid.geometry)
    sigma = work.vectors[_SIGMA]
    mu = work.vectors[_MU]
    phi = work.vectors[_PHI]
    velocity = work.vectors[_VELOCITY]
    weight = work.vectors[_WEIGHT]
    load = work.vectors[_LOAD]
    gradient = work.vectors[_GRADIENT:_SHAPE]
    for i in range(count):
        k = outline.element[i]
        normal = panels[LATERAL, i] * motion[k] + panels[ROTARY, i] * motion[elements + k]
        if fluid.axial and panels[AXIAL, i] != 0.0:
            normal += panels[AXIAL, i] * motion[2 * elements + (1 if k > 0 else 0)]
        velocity[i] = normal
        weight[i] = normal * panels[LENGTH, i]
    mat_vec(work.inverse, velocity, sigma)
    mat_vec(work.layers[POTENTIAL], sigma, phi)
    mat_vec_transposed(work.layers[POTENTIAL], weight, load)
    mat_vec_transposed(work.inverse, load, mu)
    for i in range(count):
        # The length of a panel as the weight of its potential; on a side, the arm of the
        # collocation point in the boundary value v + w arm.
        turning = motion[elements + outline.element[i]]
        gradient[3, i] = velocity[i] * phi[i]
        gradient[4, i] = (panels[LENGTH, i] * phi[i] + mu[i]) * panels[LATERAL, i] * turning
    scratch = work.vectors[_SHAPE:]
    shape_gradient(panels, count, work.layers, weight, sigma, mu, load, scratch, gradient)
    if open_chain:
        chain_gradient(fluid.geometry, outline, gradient, out)
    else:
        gradient_to_element_angles(fluid.geometry, outline, gradient, work.joint_gradient, out)
    for k in range(elements):
        out[k] *= -0.5 * fluid.density


@inlined
def _constant_added_mass(fluid: FluidConstants, out: Array) -> None:
    entry = 0
    for a in range(motion_count(fluid)):
        for b in range(a + 1):
            out[a, b] = fluid.terms[entry]
            out[b, a] = fluid.terms[entry]
            entry += 1


@inlined
def _expanded_added_mass(
    joint_angles: Array, fluid: FluidConstants, work: FluidWork, out: Array
) -> None:
    """Sum A_0 + sum_ij a_i a_j A_ij / 2 over joints, and keep the angles for the shape force."""
    motions = motion_count(fluid)
    entries = motions * (motions + 1) // 2
    total = work.joint_scratch
    for entry in range(entries):
        total[entry] = fluid.terms[entry]
    start = entries
    for i in range(joint_angles.size):
        work.joint_gradient[i] = joint_angles[i]
        for j in range(i + 1):
            weight = joint_angles[i] * joint_angles[j] * (0.5 if i == j else 1.0)
            row = fluid.terms[start : start + entries]
            for entry in range(entries):
                total[entry] += weight * row[entry]
            start += entries
    entry = 0
    for a in range(motions):
        for b in range(a + 1):
            out[a, b] = total[entry]
            out[b, a] = total[entry]
            entry += 1


@inlined
def _expanded_shape_force(
    motion: Array, fluid: FluidConstants, work: FluidWork, out: Array
) -> None:
    """Differentiate V^T A V / 2: sum_j a_j V^T A_ij V / 2 for joint i, then by elements."""
    elements = fluid.geometry.elements
    motions = motion_count(fluid)
    entries = motions * (motions + 1) // 2
    squares = work.joint_scratch
    entry = 0
    for a in range(motions):
        for b in range(a + 1):
            squares[entry] = motion[a] * motion[b] * (0.5 if a == b else 1.0)
            entry += 1
    out[:] = 0.0
    angles = work.joint_gradient
    start = entries
    for i in range(elements - 1):
        for j in range(i + 1):
            row = fluid.terms[start : start + entries]
            energy = 0.0
            for entry in range(entries):
                energy += row[entry] * squares[entry]
            start += entries
            # A joint turns the element behind it against the one in front.
            out[i + 1] += angles[j] * energy
            out[i] -= angles[j] * energy
            if j < i:
                out[j + 1] += angles[i] * energy
                out[j] -= angles[i] * energy


@entry_kernel
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
    out : (K, K) array, or padded
        Overwritten: the symmetric added mass A (kg/m, kg, kg m per metre of depth for v-v, v-w
        and w-w entries, all times a length).

    Returns
    -------
    int
        0, or the code of the reason why there is none (see `swim_env.physics.status`).
    """
    if fluid.model == PANELS or fluid.model == CENTRELINE:
        return _panel_added_mass(joint_angles, fluid, work, out)
    if fluid.model == CONSTANT:
        _constant_added_mass(fluid, out)
    elif fluid.model == EXPANSION:
        _expanded_added_mass(joint_angles, fluid, work, out)
    else:
        out[:] = 0.0
    return FINE


@entry_kernel
def shape_force(motion: Array, fluid: FluidConstants, work: FluidWork, out: Array) -> None:
    """Differentiate V^T A V / 2 with respect to every element angle, V held.

    The derivative of the discrete A is exact and is obtained by one adjoint: with
    sigma = G^-1 B V and mu = G^-T P^T diag(L) B V it needs no further solve.

    Parameters
    ----------
    motion : (K,) array, or padded
        Unit-motion velocities V (or increments).
    fluid : FluidConstants
        Model and sizes.
    work : FluidWork
        As `added_mass` left it for this shape.
    out : (N,) array
        Overwritten: the derivative, in units of V^T A V.
    """
    if fluid.model == PANELS or fluid.model == CENTRELINE:
        _panel_shape_force(motion, fluid, work, out)
    elif fluid.model == EXPANSION:
        _expanded_shape_force(motion, fluid, work, out)
    else:
        out[:] = 0.0
