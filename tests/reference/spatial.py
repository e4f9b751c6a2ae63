r"""The discrete Lagrangian of a beam in space, in redundant coordinates; only what it says.

Coordinates are q = (r, d1, d2, d3) of every element, (..., N, 4, 3), leading axes being many poses
at once. With dq = q_{n+1} - q_n, m, I1 and I2 an element's share of (18) and
V = (d_i . dr, vect skew(R_n^T dR)) of every element,

.. math::
    L_d = \frac{1}{2 h} \Big(\sum m |dr|^2 + I_1 |dd_1|^2 + I_2 |dd_2|^2 + V^T A V\Big)
          - h W(q_n, q_{n+1}).

The added mass A is constant in the elements' frames. Derivatives are taken by complex steps, along
any directions in the redundant coordinates: along those that the constraints leave free the step
equations are those in minimal coordinates. SI units. Nothing is shared with the package but the
scenes' fields.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from swim_env import Scene

Array = NDArray[np.float64]
#: Real, or complex where a derivative is taken.
Numbers = NDArray[Any]

_TINY = 1e-100
#: Coefficients of arcsin(s)/s in powers of s^2.
_ARCSINE = [1.0]
for _n in range(1, 12):
    _ARCSINE.append(_ARCSINE[-1] * (2 * _n - 1) ** 2 / (2 * _n * (2 * _n + 1)))
#: The matrices of e_i x.
_GENERATORS = np.zeros((3, 3, 3))
for _i in range(3):
    _GENERATORS[_i, (_i + 2) % 3, (_i + 1) % 3] = 1.0
    _GENERATORS[_i, (_i + 1) % 3, (_i + 2) % 3] = -1.0


# ---- rotations -----------------------------------------------------------------------------------


def hat(vectors: Numbers) -> Numbers:
    """Return the matrices of v x, (..., 3, 3)."""
    return np.asarray(np.einsum("...i,ijk->...jk", vectors, _GENERATORS))


def vect_skew(matrices: Numbers) -> Numbers:
    """Return ((Q32 - Q23)/2, (Q13 - Q31)/2, (Q21 - Q12)/2), (..., 3)."""
    return np.asarray(0.5 * np.einsum("...jk,ijk->...i", matrices, _GENERATORS))


def exp(vectors: Array) -> Array:
    """Return the rotations (..., 3, 3) of rotation vectors (rad), by Rodrigues' formula."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    cross = hat(vectors)
    half = np.sinc(0.5 * angle / np.pi)
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * half**2 * cross @ cross)


def log(matrices: Numbers) -> Numbers:
    """Return rotation vectors (..., 3) (rad) below pi; complex if the matrices are."""
    vectors = vect_skew(matrices)
    cosine = 0.5 * (np.trace(matrices, axis1=-2, axis2=-1) - 1.0)
    square = (vectors * vectors).sum(axis=-1)
    near = (np.abs(square) < 0.04) & (cosine.real > 0.0)
    small = np.where(near, square, 0.0)
    series = sum(c * small**n for n, c in enumerate(_ARCSINE))
    sine = np.sqrt(np.where(near, 0.25, square))
    angle = np.arctan2(sine.real, cosine.real)
    if np.iscomplexobj(matrices):
        size = np.where(near, 1.0, sine.real**2 + cosine.real**2)
        angle = angle + 1j * (cosine.real * sine.imag - sine.real * cosine.imag) / size
    return np.asarray(np.where(near, series, angle / sine)[..., None] * vectors)


# ---- poses ---------------------------------------------------------------------------------------


def directors_of(q: Numbers) -> Numbers:
    """Return R = [d1 d2 d3], (..., N, 3, 3), of q."""
    return np.swapaxes(q[..., 1:, :], -1, -2)


def along_chain(mean: Numbers, d3: Numbers, dl: float) -> Numbers:
    """Return centres (..., N, 3) by (15), or what else is linear in d3 and their mean."""
    r = np.zeros_like(d3)
    r[..., 1:, :] = np.cumsum(0.5 * dl * (d3[..., :-1, :] + d3[..., 1:, :]), axis=-2)
    return np.asarray(r + (mean - r.mean(axis=-2))[..., None, :])


def pose(mean: Array, directors: Array, dl: float) -> Array:
    """Return q of a mean centre (m) and the directors of all elements."""
    r = along_chain(mean, directors[..., 2], dl)
    return np.concatenate([r[..., None, :], np.swapaxes(directors, -1, -2)], axis=-2)


def free_motions(q: Array, dl: float) -> Array:
    """Return the changes of q that keep (2) and (15), (3 N + 3, N, 4, 3).

    They are unit motions of the mean centre, then unit turns of each element about the axes of
    space.
    """
    n = len(q)
    change = np.zeros((3 * n + 3, n, 4, 3))
    change[:3, :, 0] = np.eye(3)[:, None]
    for k in range(n):
        turned = change[3 + 3 * k : 6 + 3 * k]
        turned[:, k, 1:] = q[k, 1:] @ np.swapaxes(_GENERATORS, -1, -2)
        turned[:, :, 0] = along_chain(np.zeros(3), turned[:, :, 3], dl)
    return change


def joint_matrices(q: Numbers) -> Numbers:
    """Return Q_j = R_j^T R_{j+1}, (..., N - 1, 3, 3)."""
    return np.asarray(np.einsum("...kix,...kjx->...kij", q[..., :-1, 1:, :], q[..., 1:, 1:, :]))


# ---- a scene's body ------------------------------------------------------------------------------


class Body(NamedTuple):
    """The constants of a scene."""

    dl: float  # m
    inertia: Array  # m, I1, I2 of every element, (N, 3), kg and kg m^2
    stiffness: Array  # EI1/dl, EI2/dl, GJ/dl of every joint, (N - 1, 3), N m
    damping: Array  # the same times t_kv, N m s
    rest: Array  # dl K0, (N - 1, 3)
    added: Array  # A, (6 N, 6 N)
    joint_angle: bool

    @classmethod
    def of(cls, scene: Scene, added: Array | None = None) -> Body:
        """Return those of a scene; a frozen fluid's matrix has to be given."""
        beam, fluid, damping = scene.beam, scene.fluid, scene.damping
        n, dl = beam.elements, beam.length / beam.elements
        s, weights, b, a = sections(scene)
        density = fluid.density if beam.density is None else beam.density
        area, quarter = density * np.pi * a * b, 0.25 * density * np.pi * a * b
        given = (beam.line_density, beam.rotary_inertia_1, beam.rotary_inertia_2)
        shares = [
            weights @ profile if value is None else np.full(n, dl * value)
            for value, profile in zip(
                given, (area.T, (quarter * b**2).T, (quarter * a**2).T), strict=True
            )
        ]
        stiffness = np.zeros((n - 1, 3))
        fields = ("dorsoventral_stiffness", "lateral_stiffness", "torsional_stiffness")
        for i, name in enumerate(fields):
            stiffness[:, i] = np.asarray(getattr(beam, name)) / dl
        if added is None:
            added = np.zeros((6 * n, 6 * n))
            if fluid is not None and fluid.model == "given":
                added = np.array(fluid.matrix)
            elif fluid is not None and fluid.model == "strip":
                added = strips(fluid.density, s, weights, b, a, dl)
        return cls(
            dl,
            np.stack(shares, axis=1),
            stiffness,
            stiffness * (0.0 if damping is None else np.asarray(damping.retardation_time)),
            dl * np.broadcast_to(beam.natural_curvature, (n - 1, 3)),
            added,
            scene.integrator.strain == "joint_angle",
        )


def sections(scene: Scene) -> tuple[Array, Array, Array, Array]:
    """Return Gauss points s (N, 8), weights (8,) (m), and half widths and heights there (m)."""
    beam = scene.beam
    n, length, section = beam.elements, beam.length, beam.section
    points, weights = np.polynomial.legendre.leggauss(8)
    s = (np.arange(n)[:, None] + 0.5 * (points + 1.0)) * length / n
    if section.profile == "fish":
        b, a = (PchipInterpolator(*np.array(section.table).T[[0, i]])(s / length) for i in (1, 2))
    else:
        shape = np.ones_like(s)
        if section.profile == "ellipsoid":
            shape = np.sqrt(1.0 - (2.0 * s / length - 1.0) ** 2)
        b, a = section.half_width * shape, section.half_height * shape
    return s, 0.5 * weights * length / n, b, a


def strips(density: float, s: Array, weights: Array, b: Array, a: Array, dl: float) -> Array:
    """Return the added mass of strips, (6 N, 6 N)."""
    n = len(s)
    added = np.zeros((6 * n, 6 * n))
    for k in range(n):
        for i, weight in enumerate(weights):
            x = s[k, i] - (k + 0.5) * dl
            u1 = np.array([1.0, 0.0, 0.0, 0.0, x, 0.0])
            u2 = np.array([0.0, 1.0, 0.0, -x, 0.0, 0.0])
            w3 = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
            across, along = a[k, i] ** 2, b[k, i] ** 2
            of_section = (
                across * np.outer(u1, u1)
                + along * np.outer(u2, u2)
                + (across - along) ** 2 / 8.0 * np.outer(w3, w3)
            )
            added[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] += density * np.pi * weight * of_section
    return added


# ---- the discrete Lagrangian ---------------------------------------------------------------------


def motions(q: Numbers, dq: Numbers) -> Numbers:
    """Return V = (v1 v2 v3 w1 w2 w3) of every element, (..., 6 N)."""
    v = np.einsum("...kix,...kx->...ki", q[..., 1:, :], dq[..., 0, :])
    w = vect_skew(np.einsum("...kix,...kjx->...kij", q[..., 1:, :], dq[..., 1:, :]))
    both = np.concatenate([v, w], axis=-1)
    return both.reshape(*both.shape[:-2], -1)


def kinetic(q: Numbers, rate: Numbers, body: Body) -> Numbers:
    """Return the kinetic energy (J) of body and fluid, (...,)."""
    squares = (rate[..., :3, :] ** 2).sum(axis=-1)
    v = motions(q, rate)
    return np.asarray(
        0.5 * (squares * body.inertia).sum(axis=(-1, -2)) + 0.5 * ((v @ body.added) * v).sum(-1)
    )


def strain_energy(q: Numbers, after: Numbers, body: Body) -> Numbers:
    """Return W (17) (J) between the poses q and `after`; of one pose if they are the same."""
    if body.joint_angle:
        strain = 0.5 * (log(joint_matrices(q)) + log(joint_matrices(after)))
    else:
        strain = vect_skew(joint_matrices(0.5 * (q + after)))
    return np.asarray((0.5 * body.stiffness * (strain - body.rest) ** 2).sum(axis=(-1, -2)))


class Step(NamedTuple):
    """A step of length h by L_d, or by its adjoint -L_d(q_{n+1}, q_n, -h), under torques."""

    body: Body
    h: float  # s
    torques: Array  # (N - 1, 3), N m
    adjoint: bool = False

    def lagrangian(self, q: Numbers, dq: Numbers) -> Numbers:
        """Return L_d(q, q + dq) (J s), (...,)."""
        after = q + dq
        energy = kinetic(after if self.adjoint else q, dq, self.body) / self.h
        return np.asarray(energy - self.h * strain_energy(q, after, self.body))

    def by_start(self, q: Array, dq: Array, along: Array) -> Array:
        """Return D1 L_d along directions (M, N, 4, 3) in q, (M,)."""
        return _imag(lambda step: self.lagrangian(q + step * along, dq - step * along))

    def by_end(self, q: Array, dq: Array, along: Array) -> Array:
        """Return D2 L_d along directions (M, N, 4, 3) in q + dq, (M,)."""
        return _imag(lambda step: self.lagrangian(q, dq + step * along))

    def half_impulse(self, q: Array, dq: Array, at: Array, along: Array) -> Array:
        """Return (h/2) F of torques and damping over the step, along directions at `at`, (M,)."""
        turned = log(joint_matrices(q + dq)) - log(joint_matrices(q))
        force = self.torques - self.body.damping * turned / self.h
        work = _imag(lambda step: (force * log(joint_matrices(at + step * along))).sum((-1, -2)))
        return 0.5 * self.h * work

    def balance(self, p: Array, q: Array, dq: Array, along: Array) -> Array:
        """Return p_n + D1 L_d + (h/2) F along directions, p_n being given along them."""
        return p + self.by_start(q, dq, along) + self.half_impulse(q, dq, q, along)

    def momenta_after(self, q: Array, dq: Array, along: Array) -> Array:
        """Return D2 L_d + (h/2) F along directions."""
        return self.by_end(q, dq, along) + self.half_impulse(q, dq, q + dq, along)


def parts_of(scene: Scene, body: Body, torques: Array) -> list[Step]:
    """Return the parts that a scene's scheme makes of a time step."""
    h = scene.integrator.time_step
    if scene.integrator.scheme == "paper":
        return [Step(body, h, torques)]
    return [Step(body, 0.5 * h, torques, adjoint) for adjoint in (False, True)]


def _imag(f: Callable[[complex], Numbers]) -> Array:
    return np.asarray(f(1j * _TINY).imag / _TINY)


def momenta_of(q: Array, rate: Array, body: Body, along: Array) -> Array:
    """Return dL/dq' along directions, (M,), at a pose and its rate of change."""
    return _imag(lambda step: kinetic(q, rate + step * along, body))


def mass_of(q: Array, body: Body) -> Array:
    """Return the mass matrix on the free motions, (3 N + 3, 3 N + 3)."""
    free = free_motions(q, body.dl)
    return np.stack([momenta_of(q, rate, body, free) for rate in free])


def energy_of(q: Array, p: Array, body: Body) -> float:
    """Return H = p M^-1 p/2 + W (J), p along the free motions."""
    kinetic_part = 0.5 * p @ np.linalg.solve(mass_of(q, body), p)
    return float(kinetic_part + strain_energy(q, q, body))


# ---- steps in minimal coordinates ----------------------------------------------------------------


def increment(q: Array, unknowns: Array, dl: float) -> Array:
    """Return dq of R_k -> R_k exp(phi_k), the mean centre moving by the first three (m)."""
    directors = directors_of(q)
    turn = directors @ (exp(unknowns[3:].reshape(-1, 3)) - np.eye(3))
    return pose(unknowns[:3], turn, dl)


def unknowns_between(q: Array, mean: Array, after: Array, directors: Array) -> Array:
    """Return the unknowns that lead from q with its mean centre to another pose."""
    phi = log(np.swapaxes(directors_of(q), -1, -2) @ directors)
    return np.concatenate([after - mean, phi.ravel()])


def solve(step: Step, q: Array, p: Array, tolerance: float = 1e-14) -> tuple[Array, Array]:
    """Take a step from q with momenta p along the free motions; return dq and the new momenta.

    Newton's method with differences for the matrix, until the balance is met to that share of the
    impulses in it.
    """
    dl = step.body.dl
    free = free_motions(q, dl)

    def balance(unknowns: Array) -> Array:
        return step.balance(p, q, increment(q, unknowns, dl), free)

    unknowns = np.zeros(len(p))
    best = np.inf
    for _ in range(30):
        dq = increment(q, unknowns, dl)
        residual = step.balance(p, q, dq, free)
        scale = max(np.abs(p).max(), np.abs(residual - p).max())
        if np.abs(residual).max() < tolerance * scale:
            break
        if np.abs(residual).max() >= best and best < 1e-12 * scale:
            break
        best = np.abs(residual).max()
        width = 1e-7
        matrix = [(balance(unknowns + width * e) - residual) / width for e in np.eye(len(p))]
        unknowns = unknowns - np.linalg.solve(np.transpose(matrix), residual)
    else:
        raise RuntimeError(f"not solved: {np.abs(residual).max()} of {scale}")
    after = q + dq
    return dq, step.momenta_after(q, dq, free_motions(after, dl))
