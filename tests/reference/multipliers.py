r"""The step equations (34) with Lagrange multipliers, a check of the null space form.

The unknowns of a step are the redundant coordinates q = (r^k, d1^k, d3^k) at its end, 6 N numbers,
and the multipliers of the 3 N orthonormality constraints (2) and the 2 (N - 1) chain constraints
(15). In position-momentum form

.. math::
    p_n + D_1 L_d(q_n, q_{n+1}) + \frac{h}{2} F_n^- - h\, G(q_n)^T \lambda_n &= 0, \\
    g(q_{n+1}) &= 0, \\
    p_{n+1} &= D_2 L_d(q_n, q_{n+1}) + \frac{h}{2} F_n^+ .

With p eliminated and F = 0 the first two lines are (34). The package removes the multipliers by the
discrete null space and solves the same equations in minimal coordinates, so both give the same
motion to Newton's tolerance. Nothing here is shared with it: the added mass and its shape
derivative are those of `tests.reference.independent`. SI units, per metre of depth.

Three points that the paper leaves open:

* The part of p_{n+1} in the range of G(q_{n+1})^T does not affect the motion, as the next step's
  multipliers absorb it. p is not projected, and the multipliers are those of (34).
* The added mass A is known on the constraints only. It is continued as a function of the directors
  through dtheta_k = (d1^k . dd3^k - d3^k . dd1^k)/2. Another continuation changes the multipliers
  and not the motion.
* The force has one value per step but acts on directors, and so is written with those of the end
  of the step it acts at: F^- with d(n), F^+ with d(n+1). With d(n) at both ends the second half
  of a torque would be too small by a factor cos(delta_k).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env import Scene
from tests.reference import independent
from tests.reference.independent import _dot

Array = NDArray[np.float64]
#: Real, or complex where a derivative is taken by a complex step.
Numbers = NDArray[Any]

# Middle axis of redundant coordinates (..., N, 3, 2): centre, normal and tangent of an element.
R, D1, D3 = range(3)

#: Largest g(q_{n+1}) accepted, in units of max(1, |q|) (dimensionless, or m in the chain).
CONSTRAINT_TOLERANCE = 2e-15
#: Momenta below this (kg m/s, kg m^2/s) do not tighten the tolerance any further.
SMALLEST_MOMENTUM = 1e-3
MOST_ITERATIONS = 25
#: Largest turn of an element or a joint in a step (rad); beyond it the root is a wrong one.
LARGEST_TURN = 0.5


def _times(scalars: Numbers, vectors: Numbers) -> Numbers:
    return np.asarray(scalars[..., np.newaxis] * vectors)


# ---- coordinates and constraints ---------------------------------------------------------------


def redundant_pose(q: Array, dl: float) -> Array:
    """Return r (m), d1 and d3, (N, 3, 2), of q (N + 2,): mean centre, first and joint angles."""
    angles = np.cumsum(q[2:])
    d3 = np.stack((np.cos(angles), np.sin(angles)), axis=-1)
    d1 = np.stack((-np.sin(angles), np.cos(angles)), axis=-1)
    r = np.zeros_like(d3)
    r[1:] = np.cumsum(0.5 * dl * (d3[:-1] + d3[1:]), axis=0)
    r += q[:2] - r.mean(axis=0)
    return np.stack((r, d1, d3), axis=1)


def redundant_velocity(q: Array, velocity: Array, dl: float) -> Array:
    """Return the rates (N, 3, 2) of a motion that keeps (2) and (15).

    It is given by the velocity of the mean centre (m/s) and the turning rates (rad/s), (N + 2,).
    """
    rate = np.zeros_like(q)
    rate[:, D1] = -_times(velocity[2:], q[:, D3])
    rate[:, D3] = _times(velocity[2:], q[:, D1])
    rate[1:, R] = np.cumsum(0.5 * dl * (rate[:-1, D3] + rate[1:, D3]), axis=0)
    rate[:, R] += velocity[:2] - rate[:, R].mean(axis=0)
    return rate


def constraints(q: Array, dl: float) -> Array:
    """Evaluate g(q), (5 N - 2,).

    d1.d1 - 1, d3.d3 - 1 and d1.d3 of element 1, of element 2, ...; then both components of
    r^k - r^{k-1} - dl (d3^{k-1} + d3^k)/2 (m) for k = 2 ... N.
    """
    r, d1, d3 = q[:, R], q[:, D1], q[:, D3]
    directors = np.stack((_dot(d1, d1) - 1.0, _dot(d3, d3) - 1.0, _dot(d1, d3)), axis=1)
    chain = r[1:] - r[:-1] - 0.5 * dl * (d3[:-1] + d3[1:])
    return np.concatenate((directors.ravel(), chain.ravel()))


def constraint_jacobian(q: Array, dl: float) -> Array:
    """Return G(q) = dg/dq, (5 N - 2, 6 N); columns run over (element, r or d1 or d3, x or y)."""
    n = q.shape[0]
    directors = np.zeros((n, 3, n, 3, 2))
    chain = np.zeros((n - 1, 2, n, 3, 2))
    for k in range(n):
        directors[k, 0, k, D1] = 2.0 * q[k, D1]
        directors[k, 1, k, D3] = 2.0 * q[k, D3]
        directors[k, 2, k, D1] = q[k, D3]
        directors[k, 2, k, D3] = q[k, D1]
    for j in range(n - 1):
        chain[j, :, j, R] = -np.eye(2)
        chain[j, :, j + 1, R] = np.eye(2)
        chain[j, :, j : j + 2, D3] = -0.5 * dl * np.eye(2)[:, np.newaxis]
    return np.concatenate((directors.reshape(3 * n, 6 * n), chain.reshape(2 * n - 2, 6 * n)))


def angles_between(q: Numbers, other: Numbers) -> Numbers:
    """Return the angles (rad), (..., N), from any directors in q to others; complex if they are."""
    d1, d3 = q[..., D1, :], q[..., D3, :]
    sine = 0.5 * (_dot(d1, other[..., D3, :]) - _dot(d3, other[..., D1, :]))
    cosine = 0.5 * (_dot(d1, other[..., D1, :]) + _dot(d3, other[..., D3, :]))
    return independent._atan2(sine, cosine)


def joint_angles(q: Numbers) -> Numbers:
    """Return theta_k - theta_{k-1} (rad), (N - 1,)."""
    return angles_between(q[:-1], q[1:])


# ---- the discrete Lagrangian -------------------------------------------------------------------


class Body(NamedTuple):
    """The constants of a scene that enter (34)."""

    dl: float  # m
    mass: float  # of an element, kg
    inertia: float  # of an element, kg m^2
    stiffness: Array  # EI/dl at the joints, (N - 1,), N m
    damping: Array  # EI t_kv/dl at the joints, (N - 1,), N m s
    fluid: dict[str, Any] | None  # see `independent.fluid_arguments`

    @classmethod
    def of(cls, scene: Scene) -> Body:
        """Return those of a scene with the panel model or without a fluid."""
        beam, dl = scene.beam, scene.beam.element_length
        stiffness = beam.stiffness_at_joints() / dl
        retardation = scene.damping.retardation_time if scene.damping else 0.0
        inertia = dl * beam.rotary_inertia
        fluid = independent.fluid_arguments(scene)
        return cls(dl, dl * beam.line_density, inertia, stiffness, retardation * stiffness, fluid)

    @property
    def axial(self) -> bool:
        return self.fluid is not None and self.fluid["axial"]

    def added_mass(self, q: Numbers) -> Numbers:
        """Return A(q) on the motions (v, w[, a]), (K, K)."""
        if self.fluid is None:
            return np.zeros((2 * len(q), 2 * len(q)))
        return independent.added_mass(joint_angles(q), elements=len(q), **self.fluid)

    def added_mass_and_tensor(self, q: Array) -> tuple[Array, Array]:
        """Return A(q), (K, K), and dA/dtheta_k, (N, K, K)."""
        if self.fluid is None:
            return self.added_mass(q), np.zeros((len(q), 2 * len(q), 2 * len(q)))
        angles = np.concatenate([[0.0], np.cumsum(joint_angles(q))])
        return independent._added_mass_and_tensor(angles, **self.fluid)


def motions(q: Numbers, dq: Numbers, axial: bool) -> Numbers:
    """Return V (..., K): v = d1.dr, w = (d1.dd3 - d3.dd1)/2 and, if asked for, a = d3.dr.

    It is linear in q and in dq.
    """
    lateral = _dot(q[..., D1, :], dq[..., R, :])
    turning = 0.5 * (_dot(q[..., D1, :], dq[..., D3, :]) - _dot(q[..., D3, :], dq[..., D1, :]))
    ends = [_dot(q[..., D3, :], dq[..., R, :])] if axial else []
    return np.concatenate((lateral, turning, *ends), axis=-1)


def strain_energy(q: Numbers, body: Body) -> Numbers:
    """Return W (33), (...,), with the strain (16) of any directors, orthonormal or not."""
    d1, d3 = q[..., D1, :], q[..., D3, :]
    mean_d1 = 0.5 * (d1[..., 1:, :] + d1[..., :-1, :])
    mean_d3 = 0.5 * (d3[..., 1:, :] + d3[..., :-1, :])
    slope_d1 = (d1[..., 1:, :] - d1[..., :-1, :]) / body.dl
    slope_d3 = (d3[..., 1:, :] - d3[..., :-1, :]) / body.dl
    strain = 0.5 * (_dot(mean_d1, slope_d3) - _dot(mean_d3, slope_d1))
    return np.asarray((0.5 * body.dl * (body.stiffness * body.dl) * strain**2).sum(axis=-1))


def _strain_energy_gradient(q: Numbers, body: Body) -> Numbers:
    """Return dW/dq, using (16) multiplied out: dl K = (d1^{k-1}.d3^k - d3^{k-1}.d1^k)/2."""
    d1, d3 = q[..., D1, :], q[..., D3, :]
    front_d1, back_d1 = d1[..., :-1, :], d1[..., 1:, :]
    front_d3, back_d3 = d3[..., :-1, :], d3[..., 1:, :]
    moment = 0.5 * body.stiffness * (_dot(front_d1, back_d3) - _dot(front_d3, back_d1))
    gradient = np.zeros_like(q)
    gradient[..., :-1, D1, :] += 0.5 * _times(moment, back_d3)
    gradient[..., :-1, D3, :] -= 0.5 * _times(moment, back_d1)
    gradient[..., 1:, D1, :] -= 0.5 * _times(moment, front_d3)
    gradient[..., 1:, D3, :] += 0.5 * _times(moment, front_d1)
    return gradient


def discrete_lagrangian(q: Numbers, dq: Numbers, h: float, body: Body) -> Numbers:
    """Evaluate L_d(q, q + dq) (J s) as below (34): dq.(M_b + M_f(q)).dq/(2 h) - h W(q + dq/2).

    q and dq have the shape (N, 3, 2) and need not keep the constraints. Nothing runs on this: it is
    what the derivatives below are checked by.
    """
    v = motions(q, dq, body.axial)
    bare = body.mass * _dot(dq[:, R], dq[:, R]) + body.inertia * _dot(dq[:, D1], dq[:, D1])
    kinetic = (bare.sum() + v @ body.added_mass(q) @ v) / (2.0 * h)
    return np.asarray(kinetic - h * strain_energy(q + 0.5 * dq, body))


class Step(NamedTuple):
    """What the equations of a step from q are made of."""

    q: Array  # (N, 3, 2)
    torques: Array  # (N - 1,), N m
    h: float  # s
    body: Body
    mass: Array  # A(q)
    tensor: Array  # dA/dtheta_k

    @property
    def unit(self) -> Array:
        """Every coordinate's unit increment, (6 N, N, 3, 2)."""
        return np.eye(self.q.size).reshape(-1, *self.q.shape)

    def momenta(self, rate: Numbers) -> Numbers:
        """Return (M_b + M_f(q)).rate, (..., N, 3, 2)."""
        axial = self.body.axial
        impulse = motions(self.q, rate, axial) @ self.mass
        out = np.asarray(impulse @ motions(self.q, self.unit, axial).T).reshape(rate.shape)
        out[..., R, :] += self.body.mass * rate[..., R, :]
        out[..., D1, :] += self.body.inertia * rate[..., D1, :]
        return out

    def by_end(self, dq: Numbers) -> Numbers:
        """Evaluate D2 L_d(q, q + dq), (..., N, 3, 2)."""
        elastic = 0.5 * self.h * _strain_energy_gradient(self.q + 0.5 * dq, self.body)
        return np.asarray(self.momenta(dq) / self.h - elastic)

    def by_start(self, dq: Numbers) -> Numbers:
        """Evaluate D1 L_d(q, q + dq), (..., N, 3, 2), the derivative of M_f(q) included."""
        v = motions(self.q, dq, self.body.axial)
        by_pose = motions(self.unit, dq[..., np.newaxis, :, :, :], self.body.axial)
        out = np.einsum("...ci,...i->...c", by_pose, v @ self.mass).reshape(dq.shape) / self.h
        # V.(dA/dtheta_k).V/(2 h), with dtheta_k = (d1.dd3 - d3.dd1)/2.
        shape = 0.5 / self.h * np.einsum("kij,...i,...j->...k", self.tensor, v, v)
        out[..., D1, :] -= 0.5 * _times(shape, self.q[:, D3])
        out[..., D3, :] += 0.5 * _times(shape, self.q[:, D1])
        elastic = 0.5 * self.h * _strain_energy_gradient(self.q + 0.5 * dq, self.body)
        return np.asarray(out - self.momenta(dq) / self.h - elastic)

    def half_impulse(self, at: Array, dq: Numbers) -> Numbers:
        """Return (h/2) F of torques and damping over the step by dq, acting at the pose `at`.

        A moment m on an element is f_d3 = m d1/2, f_d1 = -m d3/2: its virtual work on
        dd3 = d1 dtheta, dd1 = -d3 dtheta is m dtheta.
        """
        turned = angles_between(self.q, self.q + dq)
        impulse = self.h * self.torques - self.body.damping * np.diff(turned, axis=-1)
        moment = np.zeros_like(turned)
        moment[..., 1:] += impulse
        moment[..., :-1] -= impulse
        out = np.zeros_like(dq)
        out[..., D1, :] = -0.25 * _times(moment, at[:, D3])
        out[..., D3, :] = 0.25 * _times(moment, at[:, D1])
        return out

    def balance(self, p: Array, dq: Numbers) -> Numbers:
        """Return p_n + D1 L_d + (h/2) F^-, without the multipliers; (..., N, 3, 2)."""
        return np.asarray(p + self.by_start(dq) + self.half_impulse(self.q, dq))

    def solve(self, p: Array, guess: Array, tolerance: float) -> tuple[Array, Array, float]:
        """Solve (34) by Newton's method; return dq, the multipliers and the scaled residual."""
        body, dl, count = self.body, self.body.dl, guess.size
        pulls = -self.h * constraint_jacobian(self.q, dl).T
        scale = np.maximum(SMALLEST_MOMENTUM, np.abs(p)).ravel()
        bound = CONSTRAINT_TOLERANCE * max(1.0, float(np.abs(self.q).max()))
        # Multipliers enter linearly, so Newton's first correction finds them from any value.
        dq, multipliers = guess, np.zeros(pulls.shape[1])
        for _ in range(MOST_ITERATIONS):
            missing = self.balance(p, dq).ravel() + pulls @ multipliers
            violation = constraints(self.q + dq, dl)
            residual = float(np.max(np.abs(missing) / scale))
            if residual <= tolerance and np.max(np.abs(violation)) <= bound:
                return dq, multipliers, residual
            moved = self.balance(p, dq + 1j * independent.STEP * self.unit)
            slopes = moved.imag.reshape(count, count).T / independent.STEP
            right = constraint_jacobian(self.q + dq, dl)
            matrix = np.block([[slopes, pulls], [right, np.zeros((len(right), len(right)))]])
            correction = np.linalg.solve(matrix, -np.concatenate((missing, violation)))
            dq = dq + correction[:count].reshape(dq.shape)
            multipliers = multipliers + correction[count:]
        raise independent.ReferenceFailureError(f"(34) not solved to {tolerance:g} ({body})")


# ---- runs --------------------------------------------------------------------------------------


def momentum_map(q: Array, p: Array) -> Array:
    """Return linear momentum (kg m/s) and angular momentum about the origin (kg m^2/s), (..., 3).

    Directors contribute to the latter as centres do.
    """
    linear = p[..., R, :].sum(axis=-2)
    angular = (q[..., 0] * p[..., 1] - q[..., 1] * p[..., 0]).sum(axis=(-1, -2))
    return np.concatenate((linear, angular[..., np.newaxis]), axis=-1)


class MultiplierTrajectory(NamedTuple):
    """A motion of T steps; row 0 of all but multipliers and residual is the start.

    The multipliers are lambda_n in the order of `constraints`: N m for orthonormality, N for the
    chain. That of the chain between elements k - 1 and k is the force which element k exerts on
    element k - 1.
    """

    coordinates: Array  # (T + 1, N, 3, 2), m and dimensionless
    conjugate_momenta: Array  # (T + 1, N, 3, 2), kg m/s and kg m^2/s, not projected
    momentum: Array  # (T + 1, 3), the momentum map, kg m/s and kg m^2/s
    angles: Array  # (T + 1, N), rad, continuous in time
    multipliers: Array  # (T, 5 N - 2)
    residual: Array  # (T,), the scaled residual that was reached


def simulate(scene: Scene, q0: Array, velocity: Array, torques: Array) -> MultiplierTrajectory:
    """Simulate a beam by (34) with Lagrange multipliers, starting from p_0 = M(q_0) v_0.

    Parameters
    ----------
    scene : Scene
        Beam, damping, fluid (panels or none), time step, tolerance; the rest is ignored.
    q0, velocity : (N + 2,) arrays
        Mean centre (m), angle of element 1 and joint angles (rad); velocity of the mean centre
        (m/s) and turning rate of every element (rad/s).
    torques : (T, N - 1) array
        Joint torques held over each step (N m).

    Raises
    ------
    ReferenceFailureError
        Where Newton's method fails, or an element or a joint turns by more than half a radian in
        a step. Steps are never cut.
    """
    body, h, tolerance = Body.of(scene), scene.integrator.time_step, scene.integrator.tolerance
    q = redundant_pose(q0, body.dl)
    rate = redundant_velocity(q, velocity, body.dl)
    dq = h * rate
    coordinates, momenta, multipliers, residuals = [q], [], [], []
    for held in torques:
        step = Step(q, held, h, body, *body.added_mass_and_tensor(q))
        p = momenta[-1] if momenta else step.momenta(rate)
        momenta = momenta or [p]
        dq, pulls, residual = step.solve(p, dq, tolerance)
        turned = angles_between(q, q + dq)
        if max(np.abs(turned).max(), np.abs(np.diff(turned)).max()) > LARGEST_TURN:
            raise independent.ReferenceFailureError(f"a turn of over {LARGEST_TURN} rad in a step")
        momenta.append(step.by_end(dq) + step.half_impulse(q + dq, dq))
        q = q + dq
        coordinates.append(q)
        multipliers.append(pulls)
        residuals.append(residual)
    poses, carried = np.array(coordinates), np.array(momenta)
    angles = np.unwrap(np.arctan2(poses[..., D3, 1], poses[..., D3, 0]), axis=0)
    # Whole turns that the start has.
    angles += 2.0 * np.pi * np.round((np.cumsum(q0[2:]) - angles[0]) / (2.0 * np.pi))
    return MultiplierTrajectory(
        poses,
        carried,
        momentum_map(poses, carried),
        angles,
        np.array(multipliers),
        np.array(residuals),
    )
