"""Layout of the fluid's constants and of its work space."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.outline import (
    LATERAL,
    NODE_ROWS,
    PANEL_ROWS,
    ROTARY,
    FluidGeometry,
    OutlineArrays,
)
from swim_env.physics.fluid.sources import LAYERS, SHAPE_SCRATCH
from swim_env.physics.runtime.compile import shared
from swim_env.physics.runtime.views import LANES, MEASURE, matrix, padded, vector

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class FluidConstants(NamedTuple):
    """Constants of the fluid, from `swim_env.physics.fluid.models.fluid_constants`.

    Attributes
    ----------
    model : int
        Place of the model in the table `swim_env.physics.fluid.models.MODELS`.
    geometry : FluidGeometry
        How the beam is wrapped into panels.
    density : float
        rho (kg/m^3, unit depth).
    present : bool
        Whether there is a fluid.
    varies : bool
        Whether the model's added mass changes with the joint angles.
    panels : int
        Number M of the model's panels; 0 where it has none while it runs.
    squares : int
        Numbers of scratch space that the model takes per member.
    axial : bool
        Whether the ends' axial added mass is part of the model.
    terms : (T,) array
        Constants of the model, see its file.
    drag : float
        rho C/2, cross-flow drag per length and squared velocity (kg/m^2 per metre of depth); 0 for
        none.
    stream_x, stream_y : float
        Velocity of the uniform stream (m/s).
    """

    model: int
    geometry: FluidGeometry
    density: float
    present: bool
    varies: bool
    panels: int
    squares: int
    axial: bool
    terms: Array
    drag: float = 0.0
    stream_x: float = 0.0
    stream_y: float = 0.0


#: Constants of the types that all have.
SAMPLE = FluidConstants(
    0, FluidGeometry(2, 0.5, 0.01, 1, 1), 1.0, True, True, 1, 1, False, np.zeros(0), 0.0, 0.0, 0.0
)


@shared
def motion_count(fluid: FluidConstants) -> int:
    """Return the number K of unit motions: 2 N, and 2 more with the axial effect."""
    return 2 * fluid.geometry.elements + (2 if fluid.axial else 0)


@shared
def padded_motions(fluid: FluidConstants) -> int:
    """Return the number of motions with those that fill it up to a multiple of four, all zero."""
    return (motion_count(fluid) + 3) // 4 * 4


@shared
def unit_motion(element: int, axis: int, fluid: FluidConstants) -> int:
    """Return the place in V of an element's motion: LATERAL, along d1; ROTARY; or AXIAL, along d3.

    Only end elements move axially, and only with the axial effect: they alone have panels that face
    along d3. A motion that is not in the model has the place behind the last, which holds a zero in
    all vectors of motions.
    """
    elements = fluid.geometry.elements
    if axis == LATERAL:
        return element
    if axis == ROTARY:
        return elements + element
    if fluid.axial and element == 0:
        return 2 * elements
    if fluid.axial and element == elements - 1:
        return 2 * elements + 1
    return motion_count(fluid)


class FluidWork(NamedTuple):
    """Arrays that `added_mass` leaves behind for `shape_force`, and their scratch space.

    The numbers M of panels and K of motions are padded to multiples of LANES, with zeros in
    whatever is multiplied by something that is not.

    Attributes
    ----------
    outline : OutlineArrays
        The outline of M panels.
    layers : (LAYERS, M, M) array
        Influence matrices, see `swim_env.physics.fluid.sources`.
    inverse : (M, M) array
        Inverse of the normal influence, filled up with the identity.
    loads : (K, M) array
        B^T diag(L) P.
    adjoints : (K, M) array
        Adjoint strengths per unit motion, B^T diag(L) P G^-1.
    product : (K, K) array
        B^T diag(L) P G^-1 B.
    velocity, sigma, mu, phi, weight, load : (M,) arrays
        Of the shape force: normal velocity, source strengths, adjoint strengths, potential, the
        velocity times the panels' lengths, and P^T of that.
    gradient : (5, M) array
        Derivatives by what panels are made of.
    scratch : (SHAPE_SCRATCH, M) array
        Scratch of the shape gradient.
    half_log : (M + 1,) array
        Scratch of the influences.
    joint_gradient : (N + 1,) array
        Scratch; the joint angles in the expansion.
    squares : (S,) array
        Scratch of the model.
    permutation : (M,) int array
        Row exchanges of the inversion.
    """

    outline: OutlineArrays
    layers: Array
    inverse: Array
    loads: Array
    adjoints: Array
    product: Array
    velocity: Array
    sigma: Array
    mu: Array
    phi: Array
    weight: Array
    load: Array
    gradient: Array
    scratch: Array
    half_log: Array
    joint_gradient: Array
    squares: Array
    permutation: Integers


def fluid_views(floats: Array, integers: Integers, fluid: FluidConstants) -> tuple[FluidWork, int]:
    """Lay out a `FluidWork`; returns it and how many float64 numbers it takes.

    The buffers are zero at first: what pads them is never written.
    """
    m = padded(fluid.panels)
    n = fluid.geometry.elements
    k = padded(motion_count(fluid))
    layers, end = vector(floats, 0, LAYERS * m * m)
    inverse, end = matrix(floats, end, m, m)
    loads, end = matrix(floats, end, k, m)
    adjoints, end = matrix(floats, end, k, m)
    product, end = matrix(floats, end, k, k)
    panels, end = matrix(floats, end, PANEL_ROWS, m)
    rows, end = matrix(floats, end, 11 + SHAPE_SCRATCH, m)
    half_log, end = vector(floats, end, m + LANES)
    nodes, end = matrix(floats, end, NODE_ROWS, n + 1)
    joint_gradient, end = vector(floats, end, n + 1)
    squares, end = vector(floats, end, fluid.squares)
    work = FluidWork(
        OutlineArrays(panels, nodes, integers[:m]),
        layers.reshape((LAYERS, m, m)),
        inverse,
        loads,
        adjoints,
        product,
        rows[0],
        rows[1],
        rows[2],
        rows[3],
        rows[4],
        rows[5],
        rows[6:11],
        rows[11:],
        half_log,
        joint_gradient,
        squares,
        integers[m : 2 * m],
    )
    return work, end


def fluid_work_sizes(fluid: FluidConstants) -> tuple[int, int]:
    """Return how many float64 and int64 numbers of work space the fluid takes."""
    floats = int(fluid_views(MEASURE, MEASURE, fluid)[1])
    return floats, 2 * int(padded(fluid.panels))


def new_fluid_work(fluid: FluidConstants) -> FluidWork:
    """Return new work space."""
    floats, integers = fluid_work_sizes(fluid)
    return fluid_views(np.zeros(floats), np.zeros(integers, dtype=np.int64), fluid)[0]
