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

__all__ = ["influence", "normal_influence_transposed", "shape_gradient"]

Array = NDArray[np.float64]


@kernel
def _influence_row(
    i: int,
    x: Array,
    y: Array,
    cx: float,
    cy: float,
    ct: Array,
    st: Array,
    panel_length: Array,
    inverse_square: float,
    half_log: Array,
    inverse_z_x: Array,
    inverse_z_y: Array,
    velocity_x: Array,
    velocity_y: Array,
    potential: Array,
) -> None:
    panels = ct.size
    for j in range(panels):
        dx = cx - x[j]
        dy = cy - y[j]
        square = dx * dx + dy * dy
        reciprocal = 1.0 / square
        inverse_z_x[j] = dx * reciprocal
        inverse_z_y[j] = -dy * reciprocal
        half_log[j] = 0.5 * log(square * inverse_square)
    half_log[panels] = half_log[0]
    for j in range(panels):
        dx = cx - x[j]
        dy = cy - y[j]
        length = panel_length[j]
        along = dx * ct[j] + dy * st[j]
        across = dy * ct[j] - dx * st[j]
        # atan2 of the whole fraction: a plain arc tangent is wrong inside the circle that has
        # the panel as its diameter, where the subtended angle exceeds 90 degrees.
        angle = atan2(across * length, across * across + along * (along - length))
        ratio = half_log[j] - half_log[j + 1]
        velocity_x[j] = ratio * ct[j] - angle * st[j]
        velocity_y[j] = ratio * st[j] + angle * ct[j]
        potential[j] = (
            along * half_log[j] - (along - length) * half_log[j + 1] - length + across * angle
        )
    # On the panel itself, approached from the fluid: the angle is -pi, G_ii = 1/2.
    velocity_x[i] = np.pi * st[i]
    velocity_y[i] = -np.pi * ct[i]
    potential[i] = panel_length[i] * (half_log[i] - 1.0)


@kernel
def influence(
    x: Array,
    y: Array,
    cx: Array,
    cy: Array,
    ct: Array,
    st: Array,
    panel_length: Array,
    reference_length: float,
    half_log: Array,
    inverse_z_x: Array,
    inverse_z_y: Array,
    velocity_x: Array,
    velocity_y: Array,
    potential: Array,
) -> None:
    """Assemble the influence of every panel on every collocation point.

    Parameters
    ----------
    x, y : (M,) arrays
        Vertices, panel j running from vertex j to vertex j + 1 (m).
    cx, cy : (M,) arrays
        Collocation points (m).
    ct, st, panel_length : (M,) arrays
        Unit tangents and lengths (m) of the panels.
    reference_length : float
        Length in whose units the logarithm of the potential is taken (m).
    half_log : (M + 1,) array
        Work space.
    inverse_z_x, inverse_z_y, velocity_x, velocity_y, potential : (M, M) arrays
        Overwritten: real and imaginary part of 1/(x_i - a_j) (1/m), both components of the
        velocity (times 2 pi) and the potential (m, times 2 pi) at collocation point i due to a
        unit source strength on panel j.
    """
    inverse_square = 1.0 / (reference_length * reference_length)
    for i in range(cx.size):
        _influence_row(
            i,
            x,
            y,
            cx[i],
            cy[i],
            ct,
            st,
            panel_length,
            inverse_square,
            half_log,
            inverse_z_x[i],
            inverse_z_y[i],
            velocity_x[i],
            velocity_y[i],
            potential[i],
        )


@kernel
def normal_influence_transposed(
    ct: Array, st: Array, velocity_x: Array, velocity_y: Array, out: Array
) -> None:
    """Write the transpose of the normal influence G (M, M), times 2 pi, from the velocities."""
    panels = ct.size
    for i in range(panels):
        nx = st[i]
        ny = -ct[i]
        for j in range(panels):
            out[j, i] = nx * velocity_x[i, j] + ny * velocity_y[i, j]


@vector_kernel
def shape_gradient(
    x: Array,
    y: Array,
    cx: Array,
    cy: Array,
    ct: Array,
    st: Array,
    inverse_z_x: Array,
    inverse_z_y: Array,
    velocity_x: Array,
    velocity_y: Array,
    potential: Array,
    panel_length: Array,
    weight: Array,
    sigma: Array,
    mu: Array,
    scratch: Array,
    gradient_x: Array,
    gradient_y: Array,
    gradient_turn: Array,
) -> None:
    r"""Differentiate :math:`\sum_{ij} w_i P_{ij} \sigma_j - \sum_{ij} \mu_i G_{ij} \sigma_j`.

    The derivative is exact and is given with respect to the position of every vertex (the
    collocation point being the middle of its panel) and to the direction that every panel has in
    the normal influence; how the directions hang on the shape, the caller knows best. It takes matrix-vector products with matrices that `influence` has stored, no
    logarithm and no angle: with z = x_i - a_j, dW = -i W dpsi + e^{-i psi} (dz_j/z_j -
    dz_{j+1}/z_{j+1}), and dP follows from W, z W and P.

    Parameters
    ----------
    x, y, cx, cy, ct, st : (M,) arrays
        The outline, as in `influence`.
    inverse_z_x, inverse_z_y, velocity_x, velocity_y, potential : (M, M) arrays
        As `influence` left them.
    panel_length : (M,) array
        Panel lengths (m).
    weight, sigma, mu : (M,) arrays
        The vectors of the form that is differentiated.
    scratch : (17, M) array
        Work space.
    gradient_x, gradient_y, gradient_turn : (M,) arrays
        Overwritten: derivative with respect to vertex positions and panel directions.
    """
    panels = x.size
    flow_x = scratch[0]
    flow_y = scratch[1]
    mat_vec(velocity_x, sigma, flow_x)
    mat_vec(velocity_y, sigma, flow_y)

    # Column sums with the weights of the potential: w, w x and w y.
    weight_cx = scratch[2]
    weight_cy = scratch[3]
    normal_x = scratch[4]
    normal_y = scratch[5]
    for i in range(panels):
        weight_cx[i] = weight[i] * cx[i]
        weight_cy[i] = weight[i] * cy[i]
        normal_x[i] = mu[i] * st[i]
        normal_y[i] = -mu[i] * ct[i]
    column_p = scratch[6]
    column_x = scratch[7]
    column_y = scratch[8]
    mat_vec_transposed(potential, weight, column_p)
    for j in range(panels):
        column_x[j] = 0.0
        column_y[j] = 0.0
    moment_r = scratch[9]
    moment_i = scratch[10]
    normal_r = scratch[11]
    normal_i = scratch[12]
    vertex_r = scratch[13]
    vertex_i = scratch[14]
    for j in range(panels):
        moment_r[j] = 0.0
        moment_i[j] = 0.0
        normal_r[j] = 0.0
        normal_i[j] = 0.0
        vertex_r[j] = 0.0
        vertex_i[j] = 0.0
    for i in range(panels):
        w = weight[i]
        wx = weight_cx[i]
        wy = weight_cy[i]
        nx = normal_x[i]
        ny = normal_y[i]
        for j in range(panels):
            ux = velocity_x[i, j]
            uy = velocity_y[i, j]
            zx = inverse_z_x[i, j]
            zy = inverse_z_y[i, j]
            column_x[j] += w * ux
            column_y[j] += w * uy
            # (wx + i wy)(ux - i uy)
            moment_r[j] += wx * ux + wy * uy
            moment_i[j] += wy * ux - wx * uy
            # (nx + i ny)(ux - i uy) and (nx + i ny)/z
            normal_r[j] += nx * ux + ny * uy
            normal_i[j] += ny * ux - nx * uy
            vertex_r[j] += nx * zx - ny * zy
            vertex_i[j] += nx * zy + ny * zx

    # kappa_j = sigma_j e^{-i psi_j} - sigma_{j-1} e^{-i psi_{j-1}} belongs to vertex j.
    kappa_r = scratch[15]
    kappa_i = scratch[16]
    for j in range(panels):
        before = j - 1 if j > 0 else panels - 1
        kappa_r[j] = sigma[j] * ct[j] - sigma[before] * ct[before]
        kappa_i[j] = -(sigma[j] * st[j] - sigma[before] * st[before])
        # Vertex j of every panel in the normal influence.
        gradient_x[j] = kappa_r[j] * vertex_r[j] - kappa_i[j] * vertex_i[j]
        gradient_y[j] = -(kappa_r[j] * vertex_i[j] + kappa_i[j] * vertex_r[j])

    weight_sum = 0.0
    for i in range(panels):
        weight_sum += weight[i]
    for i in range(panels):
        after = i + 1 if i + 1 < panels else 0
        # The collocation point moves in the potential ...
        move_x = weight[i] * flow_x[i]
        move_y = weight[i] * flow_y[i]
        # ... and in the normal influence.
        sum_r = dot(inverse_z_x[i], kappa_r) - dot(inverse_z_y[i], kappa_i)
        sum_i = dot(inverse_z_x[i], kappa_i) + dot(inverse_z_y[i], kappa_r)
        move_x -= normal_x[i] * sum_r - normal_y[i] * sum_i
        move_y += normal_x[i] * sum_i + normal_y[i] * sum_r
        gradient_x[i] += 0.5 * move_x
        gradient_y[i] += 0.5 * move_y
        gradient_x[after] += 0.5 * move_x
        gradient_y[after] += 0.5 * move_y

        # Panel i as a source in the potential: first moment of grad ln over the panel,
        # M1 = e^{-i psi} (z W / L - 1) in complex notation, summed over collocation points.
        zw_r = moment_r[i] - (x[i] * column_x[i] + y[i] * column_y[i])
        zw_i = moment_i[i] - (y[i] * column_x[i] - x[i] * column_y[i])
        inverse_length = 1.0 / panel_length[i]
        first_r = zw_r * inverse_length - weight_sum
        first_i = zw_i * inverse_length
        first_x = ct[i] * first_r + st[i] * first_i
        first_y = -(ct[i] * first_i - st[i] * first_r)
        stretch = column_p[i] * inverse_length
        s = sigma[i]
        gradient_x[i] -= s * (column_x[i] - first_x + ct[i] * stretch)
        gradient_y[i] -= s * (column_y[i] - first_y + st[i] * stretch)
        gradient_x[after] -= s * (first_x - ct[i] * stretch)
        gradient_y[after] -= s * (first_y - st[i] * stretch)

        # Direction of panel i as a receiver (its normal turns) and as a source.
        tangential = flow_x[i] * ct[i] + flow_y[i] * st[i]
        gradient_turn[i] = -mu[i] * tangential - s * normal_i[i]
