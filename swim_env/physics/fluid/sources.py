r"""Constant-strength source panels on a closed polygon (Hess & Smith; Katz & Plotkin ch. 11).

Every edge of the polygon is a panel, with one collocation point at its middle. The outline runs
counter-clockwise, so the normal into the fluid of a panel with tangent (ct, st) is (st, -ct).

With the complex position z_ij = x_i - a_j of collocation point i seen from the first vertex a_j of
panel j, the potential and the velocity of a unit source strength on panel j are

.. math::
    2 \pi P_{ij} &= \mathrm{Re}\{e^{-i\psi_j}
        [z_{ij} \log z_{ij} - z_{i,j+1} \log z_{i,j+1}]\} - L_j, \\
    2 \pi W_{ij} &= e^{-i\psi_j} \log(z_{ij} / z_{i,j+1}),  \qquad W = u_x - i u_y,

where the logarithm is taken of lengths in units of a reference length. All matrices of this
module carry the factor 2 pi; it drops out of P G^-1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.outline import CT, CX, CY, LENGTH, ST, X, Y
from swim_env.physics.runtime.compile import (
    entry_kernel,
    kernel,
    row_kernel,
    use_widest_registers,
    vector_kernel,
)
from swim_env.physics.runtime.dense import multiply
from swim_env.physics.runtime.elementary import atan2, log

Array = NDArray[np.float64]


# Layers of the influence matrices: real and imaginary part of 1/(x_i - a_j) (1/m); both components
# of the velocity and the potential (m) at collocation point i due to a unit source strength on
# panel j, times 2 pi.
INVERSE_Z_X, INVERSE_Z_Y, VELOCITY_X, VELOCITY_Y, POTENTIAL = range(5)
LAYERS = 5
#: Rows of scratch space of `shape_gradient`.
SHAPE_SCRATCH = 20


@row_kernel
def _write_row(
    cx: float,
    cy: float,
    x: Array,
    y: Array,
    tangent_x: Array,
    tangent_y: Array,
    lengths: Array,
    inverse_square: float,
    half_log: Array,
    inverse_z_x: Array,
    inverse_z_y: Array,
    velocity_x: Array,
    velocity_y: Array,
    potential: Array,
) -> None:
    """Write what every panel does at the point (cx, cy), as if it were on none of them."""
    use_widest_registers()
    # The compiler sees a multiple of the vector registers' width: no loop over a rest follows.
    count = (x.size >> 3) << 3
    for j in range(count):
        dx = cx - x[j]
        dy = cy - y[j]
        square = dx * dx + dy * dy
        reciprocal = 1.0 / square
        inverse_z_x[j] = dx * reciprocal
        inverse_z_y[j] = -dy * reciprocal
        half_log[j] = 0.5 * log(square * inverse_square)
    half_log[count] = half_log[0]
    for j in range(count):
        ct = tangent_x[j]
        st = tangent_y[j]
        length = lengths[j]
        dx = cx - x[j]
        dy = cy - y[j]
        along = dx * ct + dy * st
        across = dy * ct - dx * st
        # atan2 of the whole fraction: a plain arc tangent is wrong inside the circle that has
        # the panel as its diameter, where the subtended angle exceeds 90 degrees.
        angle = atan2(across * length, across * across + along * (along - length))
        ratio = half_log[j] - half_log[j + 1]
        velocity_x[j] = ratio * ct - angle * st
        velocity_y[j] = ratio * st + angle * ct
        potential[j] = (
            along * half_log[j] - (along - length) * half_log[j + 1] - length + across * angle
        )


@kernel
def influence_row(
    i: int, panels: Array, inverse_square: float, half_log: Array, layers: Array
) -> None:
    """Write row i of the layers: what a unit source on every panel does at one point.

    Parameters
    ----------
    i : int
        Panel whose collocation point it is, and the row that is written.
    inverse_square : float
        1 over the reference length squared (1/m^2).
    panels, half_log, layers
        As for `influence`; of the layers row i is overwritten.
    """
    _write_row(
        panels[CX, i],
        panels[CY, i],
        panels[X],
        panels[Y],
        panels[CT],
        panels[ST],
        panels[LENGTH],
        inverse_square,
        half_log,
        layers[INVERSE_Z_X, i],
        layers[INVERSE_Z_Y, i],
        layers[VELOCITY_X, i],
        layers[VELOCITY_Y, i],
        layers[POTENTIAL, i],
    )
    # On the panel itself, approached from the fluid: the angle is -pi, G_ii = 1/2.
    layers[VELOCITY_X, i, i] = np.pi * panels[ST, i]
    layers[VELOCITY_Y, i, i] = -np.pi * panels[CT, i]
    layers[POTENTIAL, i, i] = panels[LENGTH, i] * (half_log[i] - 1.0)


@entry_kernel
def influence(
    panels: Array, count: int, reference_length: float, half_log: Array, layers: Array
) -> None:
    """Assemble the influence of every panel on every collocation point.

    Parameters
    ----------
    panels : (7 or more, M') array
        Rows X, Y, CX, CY, CT, ST, LENGTH of an outline (`swim_env.physics.fluid.outline`): panel j
        runs from vertex j to vertex j + 1. M' is a multiple of 8; panels beyond the outline's M
        have no length and lie at vertex 0.
    count : int
        M.
    reference_length : float
        Length in whose units the logarithm of the potential is taken (m).
    half_log : (M' + 1,) array
        Work space.
    layers : (LAYERS, M', M') array
        The first M rows are overwritten with the influence matrices, see the layer names of this
        module; columns beyond M become zero, the potential's up to rounding, but for 1/z, where
        they repeat column 0.
    """
    inverse_square = 1.0 / (reference_length * reference_length)
    for i in range(count):
        influence_row(i, panels, inverse_square, half_log, layers)


@row_kernel
def _sum_of(a: float, first: Array, b: float, second: Array, out: Array) -> None:
    """Write a first + b second, of padded rows."""
    for j in range((out.size >> 3) << 3):
        out[j] = a * first[j] + b * second[j]


@entry_kernel
def normal_influence(panels: Array, count: int, layers: Array, out: Array) -> None:
    """Write the normal influence G, times 2 pi, from the velocities.

    Parameters
    ----------
    panels, count, layers
        As `influence` took and left them.
    out : (M', M') array
        Overwritten with G, filled up with rows of the identity.
    """
    for i in range(count):
        _sum_of(panels[ST, i], layers[VELOCITY_X, i], -panels[CT, i], layers[VELOCITY_Y, i], out[i])
    for i in range(count, out.shape[0]):
        out[i] = 0.0
        out[i, i] = 1.0


@vector_kernel
def _row_products(
    i: int, layers: Array, sigma: Array, kappa_r: Array, kappa_i: Array
) -> tuple[float, float, float, float]:
    """Return both components of the velocity at point i, and the sum over kappa_j/z_ij."""
    flow_x = 0.0
    flow_y = 0.0
    sum_r = 0.0
    sum_i = 0.0
    for j in range((sigma.size >> 3) << 3):
        flow_x += layers[VELOCITY_X, i, j] * sigma[j]
        flow_y += layers[VELOCITY_Y, i, j] * sigma[j]
        zx = layers[INVERSE_Z_X, i, j]
        zy = layers[INVERSE_Z_Y, i, j]
        sum_r += zx * kappa_r[j] - zy * kappa_i[j]
        sum_i += zx * kappa_i[j] + zy * kappa_r[j]
    return flow_x, flow_y, sum_r, sum_i


@vector_kernel
def _add_inverse_distances(
    nx: float, ny: float, row_x: Array, row_y: Array, vertex_r: Array, vertex_i: Array
) -> None:
    for j in range((row_x.size >> 3) << 3):
        vertex_r[j] += nx * row_x[j] - ny * row_y[j]
        vertex_i[j] += nx * row_y[j] + ny * row_x[j]


@kernel
def shape_gradient(
    panels: Array,
    count: int,
    layers: Array,
    weight: Array,
    sigma: Array,
    mu: Array,
    column_p: Array,
    scratch: Array,
    gradient: Array,
) -> None:
    r"""Differentiate :math:`\sum_{ij} w_i P_{ij} \sigma_j - \sum_{ij} \mu_i G_{ij} \sigma_j`.

    The derivative is exact and is given with respect to the position of every vertex (the
    collocation point being the middle of its panel) and to the direction that every panel has in
    the normal influence; how the directions depend on the shape, the caller knows. It takes
    matrix-vector products with matrices that `influence` has stored, no logarithm and no angle:
    with z = x_i - a_j, dW = -i W dpsi + e^{-i psi} (dz_j/z_j - dz_{j+1}/z_{j+1}), and dP follows
    from W, z W and P.

    Parameters
    ----------
    panels, count, layers
        As `influence` took and left them.
    weight, sigma, mu : (M',) arrays
        The vectors of the form that is differentiated, zero beyond M.
    column_p : (M',) array
        The transposed potential influence times `weight`.
    scratch : (SHAPE_SCRATCH, M') array
        Work space.
    gradient : (3 or more, M') array
        Rows 0 to 2 are overwritten: derivative with respect to the vertices' x and y and to the
        panels' directions.
    """
    # Sums over collocation points: w W, w x W and mu n W in complex notation. They are products of
    # the velocities' two components with four rows of factors each.
    factors_x = scratch[0:4]
    factors_y = scratch[4:8]
    columns_x = scratch[8:12]
    columns_y = scratch[12:16]
    kappa_r = scratch[16]
    kappa_i = scratch[17]
    vertex_r = scratch[18]
    vertex_i = scratch[19]
    weight_sum = 0.0
    scratch[0:8] = 0.0
    scratch[16:20] = 0.0
    for i in range(count):
        w = weight[i]
        weight_sum += w
        wx = w * panels[CX, i]
        wy = w * panels[CY, i]
        nx = mu[i] * panels[ST, i]
        ny = -mu[i] * panels[CT, i]
        factors_x[0, i] = w
        factors_x[1, i] = wx
        factors_x[2, i] = wy
        factors_x[3, i] = ny
        factors_y[0, i] = w
        factors_y[1, i] = wy
        factors_y[2, i] = -wx
        factors_y[3, i] = -nx
        _add_inverse_distances(
            nx, ny, layers[INVERSE_Z_X, i], layers[INVERSE_Z_Y, i], vertex_r, vertex_i
        )
    multiply(factors_x, layers[VELOCITY_X], columns_x)
    multiply(factors_y, layers[VELOCITY_Y], columns_y)

    # kappa_j = sigma_j e^{-i psi_j} - sigma_{j-1} e^{-i psi_{j-1}} belongs to vertex j.
    for j in range(count):
        before = j - 1 if j > 0 else count - 1
        kappa_r[j] = sigma[j] * panels[CT, j] - sigma[before] * panels[CT, before]
        kappa_i[j] = sigma[before] * panels[ST, before] - sigma[j] * panels[ST, j]
        # Vertex j of every panel in the normal influence.
        gradient[0, j] = kappa_r[j] * vertex_r[j] - kappa_i[j] * vertex_i[j]
        gradient[1, j] = -(kappa_r[j] * vertex_i[j] + kappa_i[j] * vertex_r[j])

    for i in range(count):
        after = i + 1 if i + 1 < count else 0
        ct = panels[CT, i]
        st = panels[ST, i]
        nx = mu[i] * st
        ny = -mu[i] * ct
        flow_x, flow_y, sum_r, sum_i = _row_products(i, layers, sigma, kappa_r, kappa_i)
        # The collocation point moves in the potential and in the normal influence.
        move_x = weight[i] * flow_x - (nx * sum_r - ny * sum_i)
        move_y = weight[i] * flow_y + (nx * sum_i + ny * sum_r)
        gradient[0, i] += 0.5 * move_x
        gradient[1, i] += 0.5 * move_y
        gradient[0, after] += 0.5 * move_x
        gradient[1, after] += 0.5 * move_y

        # Panel i as a source in the potential: first moment of grad ln over the panel,
        # M1 = e^{-i psi} (z W / L - 1) in complex notation, summed over collocation points.
        x = panels[X, i]
        y = panels[Y, i]
        inverse_length = 1.0 / panels[LENGTH, i]
        column_x = columns_x[0, i]
        column_y = columns_y[0, i]
        moment_r = columns_x[1, i] + columns_y[1, i]
        moment_i = columns_x[2, i] + columns_y[2, i]
        normal_i = columns_x[3, i] + columns_y[3, i]
        first_r = (moment_r - x * column_x - y * column_y) * inverse_length - weight_sum
        first_i = (moment_i - y * column_x + x * column_y) * inverse_length
        first_x = ct * first_r + st * first_i
        first_y = st * first_r - ct * first_i
        stretch = column_p[i] * inverse_length
        s = sigma[i]
        gradient[0, i] -= s * (column_x - first_x + ct * stretch)
        gradient[1, i] -= s * (column_y - first_y + st * stretch)
        gradient[0, after] -= s * (first_x - ct * stretch)
        gradient[1, after] -= s * (first_y - st * stretch)

        # Direction of panel i as a receiver (its normal turns) and as a source.
        gradient[2, i] = -mu[i] * (flow_x * ct + flow_y * st) - s * normal_i
