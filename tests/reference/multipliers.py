r"""The step equations (34) with Lagrange multipliers, to check the null space form by.

This is the paper's constrained form taken by its letter: the unknowns of a step are the redundant
coordinates q = (r^k, d1^k, d3^k) at its end, 6 N numbers, and the multipliers of the 3 N
orthonormality constraints (2) and the 2 (N - 1) chain constraints (15). In position-momentum form

.. math::
    p_n + D_1 L_d(q_n, q_{n+1}) + \frac{h}{2} F_n^- - h\, G(q_n)^T \lambda_n &= 0, \\
    g(q_{n+1}) &= 0, \\
    p_{n+1} &= D_2 L_d(q_n, q_{n+1}) + \frac{h}{2} F_n^+ .

With p eliminated and F = 0 the first two lines are (34). The minimal coordinates of
`swim_env.physics.solve.integrator` solve the same equations with the multipliers removed by the
discrete null space, so both give the same motion to Newton's tolerance. Only the added mass of a
pose and its shape derivative are shared with that code. Everything here is plain NumPy, for reading
rather than for speed: a step costs a hundred times what the kernels take.

Three things that the letter leaves open:

* The part of p_{n+1} in the range of G(q_{n+1})^T is not determined by the motion. It does not
  matter to it either, as the next step's multipliers take it up; nor does it to the momentum map,
  because g stays zero when the body is turned or shifted. p is therefore not projected, and the
  multipliers are those of (34).
* The added mass A is known on the constraints only. It is continued as a function of the
  directors through dtheta_k = (d1^k . dd3^k - d3^k . dd1^k)/2. Another continuation changes
  multipliers and not the motion.
* The force has one value per step but acts on directors, and so is written with those of the end
  of the step it acts at: F^- with d(n), F^+ with d(n+1). With d(n) at both ends the second half
  of a torque would come out short by cos(delta_k).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from swim_env.physics.planar.beam import BeamConstants
from swim_env.physics.solve.integrator import LARGEST_TURN

from swim_env.errors import SceneError, SimulationEndedError, TorqueError
from swim_env.physics.fluid.added_mass import (
    FluidConstants,
    FluidWork,
    added_mass,
    carve_fluid_work,
    fluid_work_sizes,
    motion_count,
    shape_force,
)
from swim_env.physics.status import (
    FINE,
    STEP_NOT_SOLVED,
    TERMINATION_REASONS,
    TURN_TOO_LARGE,
    describe,
)

__all__ = [
    "CONSTRAINT_TOLERANCE",
    "MultiplierTrajectory",
    "PoseMass",
    "constraint_jacobian",
    "constraints",
    "discrete_lagrangian",
    "discrete_lagrangian_by_end",
    "discrete_lagrangian_by_start",
    "joint_angles",
    "mass_at",
    "momentum_map",
    "redundant_pose",
    "redundant_velocity",
    "simulate_with_multipliers",
]

Array = NDArray[np.float64]
#: Real, or complex where a derivative is taken by a complex step.
Numbers = NDArray[Any]

# Middle axis of redundant coordinates (..., N, 3, 2): centre, normal and tangent of an element.
R, D1, D3 = range(3)

#: Largest g(q_{n+1}) accepted, in units of max(1, |q|) (dimensionless, or m in the chain).
CONSTRAINT_TOLERANCE = 2e-15
_MOST_ITERATIONS = 25
_COMPLEX_STEP = 1e-30


def _ended(code: int, time: float, detail: str = "") -> SimulationEndedError:
    """Return the exception for a status code, by the table where there is no detail to give."""
    reason = TERMINATION_REASONS[code]
    meaning = detail or describe(reason)
    return SimulationEndedError(reason, time, meaning)


class MultiplierTrajectory(NamedTuple):
    """A motion of T steps; row 0 of all but the multipliers is the start.

    Attributes
    ----------
    centres : (T + 1, N, 2) array
        Element centres (m).
    angles : (T + 1, N) array
        Element angles (rad), continuous in time.
    momentum : (T + 1, 3) array
        Momentum map: linear momentum (kg m/s) and angular momentum about the origin (kg m^2/s).
    multipliers : (T, 5 N - 2) array
        lambda_n in the order of `constraints`: N m for orthonormality, N for the chain. With A a
        function of the directors, that of the chain between elements k - 1 and k is the force
        which element k exerts on element k - 1.
    coordinates : (T + 1, N, 3, 2) array
        Redundant coordinates r (m), d1, d3 of every element.
    conjugate_momenta : (T + 1, N, 3, 2) array
        Their momenta p (kg m/s for r, kg m^2/s for the directors), not projected.
    residual : (T,) array
        Scaled residual that was met.
    iterations : (T,) int array
        Newton's corrections.
    """

    centres: Array
    angles: Array
    momentum: Array
    multipliers: Array
    coordinates: Array
    conjugate_momenta: Array
    residual: Array
    iterations: NDArray[np.int64]


class PoseMass(NamedTuple):
    """The fluid at one pose.

    Attributes
    ----------
    added_mass : (K, K) array
        A(q_n) by unit motions (v_1 ... v_N, w_1 ... w_N) and, with the axial effect, (a_1, a_N).
    derivative : (N, K, K) array
        dA/dtheta_k.
    axial : bool
        Whether the axial motions are there.
    """

    added_mass: Array
    derivative: Array
    axial: bool


def _dot(a: Numbers, b: Numbers) -> Numbers:
    # Not np.vdot: a complex step needs the product without conjugation.
    return np.asarray((a * b).sum(axis=-1))


def _times(scalars: Numbers, vectors: Numbers) -> Numbers:
    return np.asarray(scalars[..., np.newaxis] * vectors)


def redundant_pose(q: Array, element_length: float) -> Array:
    """Return the redundant coordinates of a pose in minimal ones.

    Parameters
    ----------
    q : (N + 2,) array
        Mean centre (m), angle of element 1 and joint angles (rad).
    element_length : float
        dl (m).

    Returns
    -------
    (N, 3, 2) array
        r (m), d1 and d3 of every element; (2) and (15) hold.
    """
    angles = np.cumsum(q[2:])
    d3 = np.stack((np.cos(angles), np.sin(angles)), axis=-1)
    d1 = np.stack((-np.sin(angles), np.cos(angles)), axis=-1)
    r = np.zeros_like(d3)
    r[1:] = np.cumsum(0.5 * element_length * (d3[:-1] + d3[1:]), axis=0)
    r += q[:2] - r.mean(axis=0)
    return np.stack((r, d1, d3), axis=1)


def redundant_velocity(q: Array, velocity: Array, element_length: float) -> Array:
    """Return the redundant velocities of a motion that keeps (2) and (15).

    Parameters
    ----------
    q : (N, 3, 2) array
        Redundant coordinates.
    velocity : (N + 2,) array
        Velocity of the mean centre (m/s) and turning rate of every element (rad/s).
    element_length : float
        dl (m).

    Returns
    -------
    (N, 3, 2) array
        Rates of r (m/s), d1 and d3 (1/s).
    """
    rate = np.zeros_like(q)
    rate[:, D1] = -_times(velocity[2:], q[:, D3])
    rate[:, D3] = _times(velocity[2:], q[:, D1])
    rate[1:, R] = np.cumsum(0.5 * element_length * (rate[:-1, D3] + rate[1:, D3]), axis=0)
    rate[:, R] += velocity[:2] - rate[:, R].mean(axis=0)
    return rate


def constraints(q: Array, element_length: float) -> Array:
    """Evaluate g(q): orthonormality (2), then the chain (15).

    Parameters
    ----------
    q : (N, 3, 2) array
        Redundant coordinates.
    element_length : float
        dl (m).

    Returns
    -------
    (5 N - 2,) array
        d1.d1 - 1, d3.d3 - 1 and d1.d3 of element 1, of element 2, ...; then both components of
        r^k - r^{k-1} - dl (d3^{k-1} + d3^k)/2 (m) for k = 2 ... N.
    """
    r, d1, d3 = q[:, R], q[:, D1], q[:, D3]
    directors = np.stack((_dot(d1, d1) - 1.0, _dot(d3, d3) - 1.0, _dot(d1, d3)), axis=1)
    chain = r[1:] - r[:-1] - 0.5 * element_length * (d3[:-1] + d3[1:])
    return np.concatenate((directors.ravel(), chain.ravel()))


def constraint_jacobian(q: Array, element_length: float) -> Array:
    """Return G(q) = dg/dq, of shape (5 N - 2, 6 N); see `constraints` for the rows.

    Parameters
    ----------
    q : (N, 3, 2) array
        Redundant coordinates; the columns run over (element, r or d1 or d3, x or y).
    element_length : float
        dl (m).

    Returns
    -------
    (5 N - 2, 6 N) array
        The derivative.
    """
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
        chain[j, :, j, D3] = -0.5 * element_length * np.eye(2)
        chain[j, :, j + 1, D3] = -0.5 * element_length * np.eye(2)
    return np.concatenate((directors.reshape(3 * n, 6 * n), chain.reshape(2 * n - 2, 6 * n)))


def joint_angles(q: Array) -> Array:
    """Return theta_k - theta_{k-1} (rad), shape (N - 1,), of directors in q (N, 3, 2)."""
    d1, d3 = q[:, D1], q[:, D3]
    sine = 0.5 * (_dot(d1[:-1], d3[1:]) - _dot(d3[:-1], d1[1:]))
    cosine = 0.5 * (_dot(d1[:-1], d1[1:]) + _dot(d3[:-1], d3[1:]))
    return np.arctan2(sine, cosine)


def _turns(q: Array, dq: Numbers) -> Numbers:
    """Return how far every element turns in a step (rad), by a formula fit for complex steps."""
    new = q + dq
    sine = 0.5 * (_dot(q[:, D1], dq[..., D3, :]) - _dot(q[:, D3], dq[..., D1, :]))
    cosine = 0.5 * (_dot(q[:, D1], new[..., D1, :]) + _dot(q[:, D3], new[..., D3, :]))
    return np.asarray(2.0 * np.arctan(sine / (1.0 + cosine)))


def _fluid_work(fluid: FluidConstants) -> FluidWork:
    floats, integers = fluid_work_sizes(fluid)
    return carve_fluid_work(np.zeros(floats), np.zeros(integers, dtype=np.int64), fluid)


def mass_at(q: Array, fluid: FluidConstants, work: FluidWork | None = None) -> tuple[PoseMass, int]:
    """Evaluate the added mass of a pose and its derivative by the element angles.

    Parameters
    ----------
    q : (N, 3, 2) array
        Redundant coordinates.
    fluid : FluidConstants
        Model and sizes.
    work : FluidWork, optional
        Work space of `carve_fluid_work`; made when absent.

    Returns
    -------
    mass : PoseMass
        A and dA/dtheta_k. `shape_force` gives the quadratic form V.(dA/dtheta_k).V/2; its matrix
        follows by polarisation, V running over unit motions and sums of two of them.
    status : int
        0, or the code of the reason why there is none.
    """
    work = _fluid_work(fluid) if work is None else work
    n = q.shape[0]
    count = int(motion_count(fluid))
    matrix = np.zeros((count, count))
    derivative = np.zeros((n, count, count))
    status = int(added_mass(joint_angles(q), fluid, work, matrix))
    if status == FINE:
        unit = np.eye(count)
        force = np.zeros(n)
        for a in range(count):
            shape_force(unit[a], fluid, work, force)
            derivative[:, a, a] = 2.0 * force
        for a in range(count):
            for b in range(a):
                shape_force(unit[a] + unit[b], fluid, work, force)
                mixed = force - 0.5 * (derivative[:, a, a] + derivative[:, b, b])
                derivative[:, a, b] = mixed
                derivative[:, b, a] = mixed
    return PoseMass(matrix, derivative, bool(fluid.axial)), status


def _motions(q: Numbers, dq: Numbers, axial: bool) -> Numbers:
    """Return V: v_k = d1.dr, w_k = (dd3.d1 - dd1.d3)/2 and, at the ends, a_k = d3.dr."""
    d1, d3 = q[..., D1, :], q[..., D3, :]
    dr = dq[..., R, :]
    lateral = _dot(d1, dr)
    turning = 0.5 * (_dot(dq[..., D3, :], d1) - _dot(dq[..., D1, :], d3))
    if not axial:
        return np.concatenate((lateral, turning), axis=-1)
    ends = _dot(d3, dr)[..., [0, -1]]
    return np.concatenate((lateral, turning, ends), axis=-1)


def _fluid_impulses(q: Array, dq: Numbers, h: float, mass: PoseMass) -> tuple[Numbers, ...]:
    """Return V, and A V/h by its lateral, rotary and axial part, each (..., N)."""
    n = q.shape[0]
    motion = _motions(q, dq, mass.axial)
    impulse = motion @ mass.added_mass / h
    axial = np.zeros_like(impulse[..., :n])
    if mass.axial:
        axial[..., [0, -1]] = impulse[..., 2 * n :]
    return motion, impulse[..., :n], impulse[..., n : 2 * n], axial


def _strain_energy(q: Numbers, beam: BeamConstants) -> Numbers:
    """Return W (33) with the strain (16) of any directors, orthonormal or not."""
    dl = beam.element_length
    d1, d3 = q[..., D1, :], q[..., D3, :]
    mean_d1 = 0.5 * (d1[..., 1:, :] + d1[..., :-1, :])
    mean_d3 = 0.5 * (d3[..., 1:, :] + d3[..., :-1, :])
    slope_d1 = (d1[..., 1:, :] - d1[..., :-1, :]) / dl
    slope_d3 = (d3[..., 1:, :] - d3[..., :-1, :]) / dl
    strain = 0.5 * (_dot(mean_d1, slope_d3) - _dot(mean_d3, slope_d1))
    stiffness = beam.joint_stiffness * dl
    return np.asarray((0.5 * dl * stiffness * strain**2).sum(axis=-1))


def _strain_energy_gradient(q: Numbers, beam: BeamConstants) -> Numbers:
    """Return dW/dq, using (16) multiplied out: dl K = (d1^{k-1}.d3^k - d3^{k-1}.d1^k)/2."""
    d1, d3 = q[..., D1, :], q[..., D3, :]
    front_d1, back_d1 = d1[..., :-1, :], d1[..., 1:, :]
    front_d3, back_d3 = d3[..., :-1, :], d3[..., 1:, :]
    moment = 0.5 * beam.joint_stiffness * (_dot(front_d1, back_d3) - _dot(front_d3, back_d1))
    gradient = np.zeros_like(q)
    gradient[..., :-1, D1, :] += 0.5 * _times(moment, back_d3)
    gradient[..., :-1, D3, :] -= 0.5 * _times(moment, back_d1)
    gradient[..., 1:, D1, :] -= 0.5 * _times(moment, front_d3)
    gradient[..., 1:, D3, :] += 0.5 * _times(moment, front_d1)
    return gradient


def discrete_lagrangian(
    q: Numbers, q_next: Numbers, h: float, beam: BeamConstants, mass: PoseMass
) -> Numbers:
    r"""Evaluate L_d(q_n, q_{n+1}) as the paper has it below (34), A(q_n) being given.

    Nothing runs on it: it is what `discrete_lagrangian_by_start` and `discrete_lagrangian_by_end`
    are the derivatives of.

    Parameters
    ----------
    q, q_next : (..., N, 3, 2) arrays
        Redundant coordinates at both ends of the step; they need not keep the constraints.
    h : float
        Length of the step (s).
    beam : BeamConstants
        The beam.
    mass : PoseMass
        The fluid at q_n.

    Returns
    -------
    (...) array
        dq.(M_b + M_f(q_n)).dq/(2 h) - h W(K(q_{n+1/2})) (J s).
    """
    dq = q_next - q
    dr, dd1 = dq[..., R, :], dq[..., D1, :]
    motion = _motions(q, dq, mass.axial)
    body = beam.element_mass * _dot(dr, dr) + beam.element_inertia * _dot(dd1, dd1)
    fluid = _dot(motion @ mass.added_mass, motion)
    kinetic = (body.sum(axis=-1) + fluid) / (2.0 * h)
    return np.asarray(kinetic - h * _strain_energy(0.5 * (q + q_next), beam))


def discrete_lagrangian_by_start(
    q: Array, dq: Numbers, h: float, beam: BeamConstants, mass: PoseMass
) -> Numbers:
    r"""Evaluate D1 L_d(q_n, q_n + dq), the derivative of M_f(q_n) included.

    Parameters
    ----------
    q : (N, 3, 2) array
        Redundant coordinates at the start of the step.
    dq : (..., N, 3, 2) array
        Their increments in the step.
    h : float
        Length of the step (s).
    beam : BeamConstants
        The beam.
    mass : PoseMass
        The fluid at q_n.

    Returns
    -------
    (..., N, 3, 2) array
        Derivatives by r (kg m/s), d1 and d3 (kg m^2/s).
    """
    d1, d3 = q[:, D1], q[:, D3]
    dr = dq[..., R, :]
    new = q + dq
    motion, lateral, turning, axial = _fluid_impulses(q, dq, h, mass)
    # V.(dA/dtheta_k).V/(2 h), with dtheta_k = (d1.dd3 - d3.dd1)/2.
    shape = 0.5 / h * np.einsum("kij,...i,...j->...k", mass.derivative, motion, motion)
    out = np.zeros_like(dq)
    out[..., R, :] = -beam.element_mass / h * dr - _times(lateral, d1) - _times(axial, d3)
    out[..., D1, :] = (
        -beam.element_inertia / h * dq[..., D1, :]
        + _times(lateral, dr)
        + 0.5 * _times(turning, new[..., D3, :])
        - 0.5 * _times(shape, d3)
    )
    out[..., D3, :] = (
        _times(axial, dr) - 0.5 * _times(turning, new[..., D1, :]) + 0.5 * _times(shape, d1)
    )
    # The midpoint depends on either end by one half.
    return np.asarray(out - 0.5 * h * _strain_energy_gradient(q + 0.5 * dq, beam))


def _momenta(q: Array, dq: Array, h: float, beam: BeamConstants, mass: PoseMass) -> Array:
    """Return (M_b + M_f(q)).dq/h, the conjugate momenta of a velocity dq/h."""
    d1, d3 = q[:, D1], q[:, D3]
    _, lateral, turning, axial = _fluid_impulses(q, dq, h, mass)
    out = np.zeros_like(dq)
    out[:, R] = beam.element_mass / h * dq[:, R] + _times(lateral, d1) + _times(axial, d3)
    out[:, D1] = beam.element_inertia / h * dq[:, D1] - 0.5 * _times(turning, d3)
    out[:, D3] = 0.5 * _times(turning, d1)
    return out


def discrete_lagrangian_by_end(
    q: Array, dq: Array, h: float, beam: BeamConstants, mass: PoseMass
) -> Array:
    """Evaluate D2 L_d(q_n, q_n + dq).

    Parameters
    ----------
    q, dq, h, beam, mass
        As in `discrete_lagrangian_by_start`; dq of shape (N, 3, 2).

    Returns
    -------
    (N, 3, 2) array
        Derivatives by r (kg m/s), d1 and d3 (kg m^2/s) at the end of the step.
    """
    elastic = 0.5 * h * _strain_energy_gradient(q + 0.5 * dq, beam)
    return np.asarray(_momenta(q, dq, h, beam, mass) - elastic)


def _half_impulse(
    at: Array, q: Array, dq: Numbers, torques: Array, h: float, beam: BeamConstants
) -> Numbers:
    """Return (h/2) F of torques and damping over the step from q to q + dq, acting at `at`.

    A moment m on an element is f_d3 = m d1/2, f_d1 = -m d3/2: its virtual work on
    dd3 = d1 dtheta, dd1 = -d3 dtheta is m dtheta.
    """
    turns = _turns(q, dq)
    # Impulse of a joint: the torque held, and (EI/dl) t_kv times the change of the joint's angle.
    impulse = h * torques - beam.joint_damping * np.diff(turns, axis=-1)
    moment = np.zeros_like(turns)
    moment[..., 1:] += impulse
    moment[..., :-1] -= impulse
    out = np.zeros_like(dq)
    out[..., D1, :] = -0.25 * _times(moment, at[:, D3])
    out[..., D3, :] = 0.25 * _times(moment, at[:, D1])
    return out


def momentum_map(q: Array, p: Array) -> Array:
    """Return the momentum map of redundant coordinates and momenta.

    Parameters
    ----------
    q, p : (..., N, 3, 2) arrays
        Coordinates (m, dimensionless) and conjugate momenta (kg m/s, kg m^2/s).

    Returns
    -------
    (..., 3) array
        Linear momentum (kg m/s) and angular momentum about the origin (kg m^2/s), to which
        directors contribute as centres do.
    """
    linear = p[..., R, :].sum(axis=-2)
    angular = (q[..., 0] * p[..., 1] - q[..., 1] * p[..., 0]).sum(axis=(-1, -2))
    return np.concatenate((linear, angular[..., np.newaxis]), axis=-1)


class _Step(NamedTuple):
    """What a step's equations are made of."""

    q: Array
    p: Array
    torques: Array
    h: float
    beam: BeamConstants
    mass: PoseMass

    def balance(self, dq: Numbers) -> Numbers:
        """Return p_n + D1 L_d + (h/2) F^-, multipliers left out; (..., N, 3, 2)."""
        by_start = discrete_lagrangian_by_start(self.q, dq, self.h, self.beam, self.mass)
        force = _half_impulse(self.q, self.q, dq, self.torques, self.h, self.beam)
        return np.asarray(self.p + by_start + force)

    def balance_jacobian(self, dq: Array) -> Array:
        """Return the derivative of `balance` by dq, (6 N, 6 N), by complex steps."""
        size = dq.size
        moved = dq + 1j * _COMPLEX_STEP * np.eye(size).reshape(size, *dq.shape)
        return np.asarray(self.balance(moved).imag.reshape(size, size).T / _COMPLEX_STEP)


def _solve(step: _Step, guess: Array, tolerance: float) -> tuple[Array, Array, float, int] | None:
    """Solve (34) by Newton's method from a guess of dq.

    Returns
    -------
    dq, multipliers, residual, iterations : (N, 3, 2) array, (5 N - 2,) array, float, int
        The solution, or None where there is none to be had from this guess.
    """
    dl = step.beam.element_length
    count = guess.size
    start_jacobian = constraint_jacobian(step.q, dl)
    smallest = np.full_like(step.p, step.beam.smallest_spin)
    smallest[:, R] = step.beam.smallest_momentum
    scale = np.maximum(smallest, np.abs(step.p)).ravel()
    constraint_bound = CONSTRAINT_TOLERANCE * max(1.0, float(np.abs(step.q).max()))
    dq = guess
    # Multipliers enter linearly, so Newton's first correction finds them from any value.
    multipliers = np.zeros(start_jacobian.shape[0])
    for iteration in range(_MOST_ITERATIONS + 1):
        balance = step.balance(dq).ravel() - step.h * start_jacobian.T @ multipliers
        violation = constraints(step.q + dq, dl)
        residual = float(np.max(np.abs(balance) / scale))
        if not np.isfinite(residual):
            return None
        if residual <= tolerance and np.max(np.abs(violation)) <= constraint_bound:
            return dq, multipliers, residual, iteration
        matrix = np.block(
            [
                [step.balance_jacobian(dq), -step.h * start_jacobian.T],
                [constraint_jacobian(step.q + dq, dl), np.zeros((violation.size,) * 2)],
            ]
        )
        try:
            correction = np.linalg.solve(matrix, -np.concatenate((balance, violation)))
        except np.linalg.LinAlgError:
            return None
        dq = dq + correction[:count].reshape(dq.shape)
        multipliers = multipliers + correction[count:]
    return None


def _check(
    beam: BeamConstants,
    fluid: FluidConstants,
    q0: Array,
    velocity: Array,
    torques: Array,
    time_step: float,
    tolerance: float,
) -> None:
    n = beam.elements
    if n < 2:
        raise SceneError(f"beam.elements must be at least 2, got {n}")
    if (fluid.geometry.elements, fluid.geometry.element_length) != (n, beam.element_length):
        raise SceneError(
            "fluid.geometry must wrap the beam's own elements, got "
            f"{fluid.geometry.elements} of {fluid.geometry.element_length} m for "
            f"{n} of {beam.element_length} m"
        )
    if torques.ndim != 2 or torques.shape[1] != n - 1:
        raise TorqueError(f"torques must have shape (T, {n - 1}), got {torques.shape}")
    if not np.isfinite(torques).all():
        raise TorqueError("torques must be finite")
    for name, value in (("q0", q0), ("velocity", velocity)):
        if value.shape != (n + 2,):
            raise SceneError(f"{name} must have shape ({n + 2},), got {value.shape}")
        if not np.isfinite(value).all():
            raise SceneError(f"{name} must be finite")
    for name, number in (("time_step", time_step), ("tolerance", tolerance)):
        if not (np.isfinite(number) and number > 0.0):
            raise SceneError(f"{name} must be positive and finite, got {number}")


def simulate_with_multipliers(
    beam: BeamConstants,
    fluid: FluidConstants,
    q0: Array,
    velocity: Array,
    torques: Array,
    time_step: float,
    tolerance: float = 1e-10,
) -> MultiplierTrajectory:
    r"""Simulate a beam by (34) with Lagrange multipliers, starting by momentum.

    Steps are solved whole: where the null space form would cut a step in parts, this one raises.
    It does not look for a loss of positivity of the mass.

    Parameters
    ----------
    beam : BeamConstants
        The beam.
    fluid : FluidConstants
        The fluid.
    q0 : (N + 2,) array
        Start in minimal coordinates: mean centre (m), angle of element 1, joint angles (rad).
    velocity : (N + 2,) array
        Velocity of the mean centre (m/s) and turning rate of every element (rad/s) at the start.
    torques : (T, N - 1) array
        Joint torques held over each step (N m).
    time_step : float
        h (s).
    tolerance : float
        Largest residual of the balance of momentum accepted, max_i |r_i|/max(s, |p_i|), s the
        `smallest_momentum` or `smallest_spin` of the beam, over
        all 6 N components. The constraints are solved to `CONSTRAINT_TOLERANCE` whatever it is.

    Returns
    -------
    MultiplierTrajectory
        The motion, its momentum map and multipliers.

    Raises
    ------
    SceneError, TorqueError
        Where arguments do not fit together.
    SimulationEndedError
        Where the outline of a pose is not admissible, Newton's method fails, or an element or a
        joint turns by more than half a radian in a step, which points to a wrong root.
    """
    q0 = np.asarray(q0, dtype=np.float64)
    velocity = np.asarray(velocity, dtype=np.float64)
    torques = np.asarray(torques, dtype=np.float64)
    _check(beam, fluid, q0, velocity, torques, time_step, tolerance)
    n = beam.elements
    h = float(time_step)
    dl = beam.element_length
    steps = torques.shape[0]
    work = _fluid_work(fluid)
    coordinates = np.zeros((steps + 1, n, 3, 2))
    momenta = np.zeros((steps + 1, n, 3, 2))
    multipliers = np.zeros((steps, 5 * n - 2))
    residuals = np.zeros(steps)
    iterations = np.zeros(steps, dtype=np.int64)

    q = redundant_pose(q0, dl)
    rate = redundant_velocity(q, velocity, dl)
    mass, status = mass_at(q, fluid, work)
    if status != FINE:
        raise _ended(status, 0.0)
    # p_0 = dL/dq'(q_0, v_0).
    p = _momenta(q, rate, 1.0, beam, mass)
    coordinates[0] = q
    momenta[0] = p
    last = h * rate
    for i in range(steps):
        if i > 0:
            mass, status = mass_at(q, fluid, work)
            if status != FINE:
                raise _ended(status, i * h)
        step = _Step(q, p, torques[i], h, beam, mass)
        solution = _solve(step, last, tolerance)
        if solution is None:
            solution = _solve(step, np.zeros_like(q), tolerance)
        if solution is None:
            raise _ended(
                STEP_NOT_SOLVED,
                i * h,
                f"Newton's method did not solve (34) to {tolerance:g}; steps are not cut here",
            )
        dq, multipliers[i], residuals[i], iterations[i] = solution
        turns = _turns(q, dq)
        largest = max(float(np.abs(turns).max()), float(np.abs(np.diff(turns)).max()))
        if largest > LARGEST_TURN:
            raise _ended(
                TURN_TOO_LARGE,
                i * h,
                f"an element or a joint turns by {largest:.2f} rad in a step, more than "
                f"{LARGEST_TURN}; steps are not cut here",
            )
        new = q + dq
        p = discrete_lagrangian_by_end(q, dq, h, beam, mass) + _half_impulse(
            new, q, dq, torques[i], h, beam
        )
        q = new
        last = dq
        coordinates[i + 1] = q
        momenta[i + 1] = p

    angles = np.unwrap(np.arctan2(coordinates[..., D3, 1], coordinates[..., D3, 0]), axis=0)
    # Whole turns that the start has.
    angles += 2.0 * np.pi * np.round((np.cumsum(q0[2:]) - angles[0]) / (2.0 * np.pi))
    return MultiplierTrajectory(
        coordinates[..., R, :].copy(),
        angles,
        momentum_map(coordinates, momenta),
        multipliers,
        coordinates,
        momenta,
        residuals,
        iterations,
    )
