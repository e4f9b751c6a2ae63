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

from swim_env.physics._compile import kernel, vector_kernel
from swim_env.physics.dense import dot, mat_vec, mat_vec_transposed
from swim_env.physics.elementary import atan2, log
from swim_env.physics.outline import CT, CX, CY, LENGTH, ST, X, Y

__all__ = ["LAYERS", "SHAPE_SCRATCH", "influence", "normal_influence_transposed", "shape_gradient"]

Array = NDArray[np.float64]


# Layers of the influence matrices: real and imaginary part of 1/(x_i - a_j) (1/m); both components
# of the velocity and the potential (m) at collocation point i due to a unit source strength on
# panel j, times 2 pi.
INVERSE_Z_X, INVERSE_Z_Y, VELOCITY_X, VELOCITY_Y, POTENTIAL = range(5)
LAYERS = 5
#: Rows of scratch space of `shape_gradient`.
SHAPE_SCRATCH = 13


@kernel
def _influence_row(
    i: int, panels: Array, inverse_square: float, half_log: Array, layers: Array
) -> None:
    count = panels.shape[1]
    cx = panels[CX, i]
    cy = panels[CY, i]
    for j in range(count):
        dx = cx - panels[X, j]
        dy = cy - panels[Y, j]
        square = dx * dx + dy * dy
        reciprocal = 1.0 / square
        layers[INVERSE_Z_X, i, j] = dx * reciprocal
        layers[INVERSE_Z_Y, i, j] = -dy * reciprocal
        half_log[j] = 0.5 * log(square * inverse_square)
    half_log[count] = half_log[0]
    for j in range(count):
        ct = panels[CT, j]
        st = panels[ST, j]
        length = panels[LENGTH, j]
        dx = cx - panels[X, j]
        dy = cy - panels[Y, j]
        along = dx * ct + dy * st
        across = dy * ct - dx * st
        # atan2 of the whole fraction: a plain arc tangent is wrong inside the circle that has
        # the panel as its diameter, where the subtended angle exceeds 90 degrees.
        angle = atan2(across * length, across * across + along * (along - length))
        ratio = half_log[j] - half_log[j + 1]
        layers[VELOCITY_X, i, j] = ratio * ct - angle * st
        layers[VELOCITY_Y, i, j] = ratio * st + angle * ct
        layers[POTENTIAL, i, j] = (
            along * half_log[j] - (along - length) * half_log[j + 1] - length + across * angle
        )
    # On the panel itself, approached from the fluid: the angle is -pi, G_ii = 1/2.
    layers[VELOCITY_X, i, i] = np.pi * panels[ST, i]
    layers[VELOCITY_Y, i, i] = -np.pi * panels[CT, i]
    layers[POTENTIAL, i, i] = panels[LENGTH, i] * (half_log[i] - 1.0)


@kernel
def influence(panels: Array, reference_length: float, half_log: Array, layers: Array) -> None:
    """Assemble the influence of every panel on every collocation point.

    Parameters
    ----------
    panels : (7 or more, M) array
        Rows X, Y, CX, CY, CT, ST, LENGTH of an outline (`swim_env.physics.outline`): panel j
        runs from vertex j to vertex j + 1.
    reference_length : float
        Length in whose units the logarithm of the potential is taken (m).
    half_log : (M + 1,) array
        Work space.
    layers : (LAYERS, M, M) array
        Overwritten with the influence matrices, see the layer names of this module.
    """
    inverse_square = 1.0 / (reference_length * reference_length)
    for i in range(panels.shape[1]):
        _influence_row(i, panels, inverse_square, half_log, layers)


@kernel
def normal_influence_transposed(panels: Array, layers: Array, out: Array) -> None:
    """Write the transpose of the normal influence G (M, M), times 2 pi, from the velocities."""
    for i in range(panels.shape[1]):
        nx = panels[ST, i]
        ny = -panels[CT, i]
        for j in range(panels.shape[1]):
            out[j, i] = nx * layers[VELOCITY_X, i, j] + ny * layers[VELOCITY_Y, i, j]


@vector_kernel
def shape_gradient(
    panels: Array,
    layers: Array,
    weight: Array,
    sigma: Array,
    mu: Array,
    scratch: Array,
    gradient: Array,
) -> None:
    r"""Differentiate :math:`\sum_{ij} w_i P_{ij} \sigma_j - \sum_{ij} \mu_i G_{ij} \sigma_j`.

    The derivative is exact and is given with respect to the position of every vertex (the
    collocation point being the middle of its panel) and to the direction that every panel has in
    the normal influence; how the directions hang on the shape, the caller knows best. It takes
    matrix-vector products with matrices that `influence` has stored, no logarithm and no angle:
    with z = x_i - a_j, dW = -i W dpsi + e^{-i psi} (dz_j/z_j - dz_{j+1}/z_{j+1}), and dP follows
    from W, z W and P.

    Parameters
    ----------
    panels, layers : arrays
        As `influence` took and left them.
    weight, sigma, mu : (M,) arrays
        The vectors of the form that is differentiated.
    scratch : (SHAPE_SCRATCH, M) array
        Work space.
    gradient : (3 or more, M) array
        Rows 0 to 2 are overwritten: derivative with respect to the vertices' x and y and to the
        panels' directions.
    """
    count = panels.shape[1]
    flow_x = scratch[0]
    flow_y = scratch[1]
    mat_vec(layers[VELOCITY_X], sigma, flow_x)
    mat_vec(layers[VELOCITY_Y], sigma, flow_y)
    column_p = scratch[2]
    mat_vec_transposed(layers[POTENTIAL], weight, column_p)

    # Column sums over collocation points: w W, w x W, mu n W and mu n/z in complex notation.
    column_x = scratch[3]
    column_y = scratch[4]
    moment_r = scratch[5]
    moment_i = scratch[6]
    normal_r = scratch[7]
    normal_i = scratch[8]
    vertex_r = scratch[9]
    vertex_i = scratch[10]
    scratch[3:11] = 0.0
    weight_sum = 0.0
    for i in range(count):
        w = weight[i]
        weight_sum += w
        wx = w * panels[CX, i]
        wy = w * panels[CY, i]
        nx = mu[i] * panels[ST, i]
        ny = -mu[i] * panels[CT, i]
        for j in range(count):
            ux = layers[VELOCITY_X, i, j]
            uy = layers[VELOCITY_Y, i, j]
            column_x[j] += w * ux
            column_y[j] += w * uy
            moment_r[j] += wx * ux + wy * uy
            moment_i[j] += wy * ux - wx * uy
            normal_r[j] += nx * ux + ny * uy
            normal_i[j] += ny * ux - nx * uy
        for j in range(count):
            zx = layers[INVERSE_Z_X, i, j]
            zy = layers[INVERSE_Z_Y, i, j]
            vertex_r[j] += nx * zx - ny * zy
            vertex_i[j] += nx * zy + ny * zx

    # kappa_j = sigma_j e^{-i psi_j} - sigma_{j-1} e^{-i psi_{j-1}} belongs to vertex j.
    kappa_r = scratch[11]
    kappa_i = scratch[12]
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
        # The collocation point moves in the potential and in the normal influence.
        row_x = layers[INVERSE_Z_X, i]
        row_y = layers[INVERSE_Z_Y, i]
        sum_r = dot(row_x, kappa_r) - dot(row_y, kappa_i)
        sum_i = dot(row_x, kappa_i) + dot(row_y, kappa_r)
        move_x = weight[i] * flow_x[i] - (nx * sum_r - ny * sum_i)
        move_y = weight[i] * flow_y[i] + (nx * sum_i + ny * sum_r)
        gradient[0, i] += 0.5 * move_x
        gradient[1, i] += 0.5 * move_y
        gradient[0, after] += 0.5 * move_x
        gradient[1, after] += 0.5 * move_y

        # Panel i as a source in the potential: first moment of grad ln over the panel,
        # M1 = e^{-i psi} (z W / L - 1) in complex notation, summed over collocation points.
        x = panels[X, i]
        y = panels[Y, i]
        inverse_length = 1.0 / panels[LENGTH, i]
        first_r = (moment_r[i] - x * column_x[i] - y * column_y[i]) * inverse_length - weight_sum
        first_i = (moment_i[i] - y * column_x[i] + x * column_y[i]) * inverse_length
        first_x = ct * first_r + st * first_i
        first_y = st * first_r - ct * first_i
        stretch = column_p[i] * inverse_length
        s = sigma[i]
        gradient[0, i] -= s * (column_x[i] - first_x + ct * stretch)
        gradient[1, i] -= s * (column_y[i] - first_y + st * stretch)
        gradient[0, after] -= s * (first_x - ct * stretch)
        gradient[1, after] -= s * (first_y - st * stretch)

        # Direction of panel i as a receiver (its normal turns) and as a source.
        gradient[2, i] = -mu[i] * (flow_x[i] * ct + flow_y[i] * st) - s * normal_i[i]
