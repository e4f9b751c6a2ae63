"""Work space of the planar step equations: named arrays, laid out in one flat buffer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.views import matrix, padded

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Pose(NamedTuple):
    """Directors and joints at q_n.

    Attributes
    ----------
    d1, d3 : (2, N) arrays
        Normals and tangents of the elements.
    joint_sine, joint_cosine : (N,) arrays
        Of the N - 1 joint angles; the angle and 1 where the strain is linear in it.
    """

    d1: Array
    d3: Array
    joint_sine: Array
    joint_cosine: Array


class Increment(NamedTuple):
    """How the body moves in an increment z of the minimal coordinates.

    Attributes
    ----------
    turn_sine, turn_cosine, half_sine, half_cosine : (N,) arrays
        Of the turn delta_k of every element, and of half of it.
    mean_sine, mean_cosine : (N,) arrays
        Of the N - 1 joint angles at the middle of the step; the angle and 1 where the strain is
        linear.
    new_d1 : (2, N) array
        Normals at q_{n+1}.
    shift : (2, N) array
        Increment of every element's centre (m).
    motion, impulse : (K + 1,) arrays, padded
        V, and the fluid's impulse per unit motion A V/h; zeros behind the K motions.
    """

    turn_sine: Array
    turn_cosine: Array
    half_sine: Array
    half_cosine: Array
    mean_sine: Array
    mean_cosine: Array
    new_d1: Array
    shift: Array
    motion: Array
    impulse: Array


#: Rows of `Balance.joints`: h dW/dtheta at q_n of the element in front and of that behind; the
#: latter's sum with that at q_{n+1}, the former's is the negative; the magnitude of these terms;
#: the impulse h F of torque and damping on the element behind, and the magnitude of its terms.
FRONT, BACK, BOTH, BENDING, TORQUE, EFFORT = range(6)
JOINT_ROWS = 6


class Balance(NamedTuple):
    """Momentum balance of a step: its residual, and what it is made of.

    Attributes
    ----------
    momentum : (2, N) array
        P^k, momentum of every element with the fluid's impulse on its panels (kg m/s).
    lever : (2, N) array
        sum_k E_kj P^k (kg m^2/s).
    sums : (2, N) array
        Scratch.
    shape : (N,) array
        V^T dA/dtheta V/2, the shape force times h.
    pose_forces : (2, N) array
        Impulses of the pose that the inertia is taken at: with its directors held, that of the
        velocity across them, and that of the shape force.
    no_forces : (2, N) array
        Zeros.
    joints : (JOINT_ROWS, N + 1) array
        What the joints do to the elements beside them, see the names of its rows. Joint j is at
        j + 1; zeros at both ends stand for the ends of the body.
    residual, scale, size : (N + 2,) arrays
        p_n + D1 L_d + h F/2, the scale it is measured with, and the magnitude of its terms.
    change : (N + 2,) array
        D1 L_d + D2 L_d + h F, the change of the momentum.
    """

    momentum: Array
    lever: Array
    sums: Array
    shape: Array
    pose_forces: Array
    no_forces: Array
    joints: Array
    residual: Array
    scale: Array
    size: Array
    change: Array


class Drag(NamedTuple):
    """Cross-flow drag in a step.

    Attributes
    ----------
    impulse : (2, N) array
        On every element (kg m/s).
    lever : (2, N) array
        What the joints in front feel of it, like that of `Balance`.
    moment : (N,) array
        Moment of the impulse about the element's centre (kg m^2/s).
    slope, cross, turn_slope : (N,) arrays
        Derivatives of minus the impulse by the shift of the centre along the normal, of either by
        the other, and of the moment by the turn.
    """

    impulse: Array
    lever: Array
    moment: Array
    slope: Array
    cross: Array
    turn_slope: Array


#: Entries of `Mass.known`.
TOTAL, ADDED = range(2)


class Mass(NamedTuple):
    """Masses of a pose, and which pose they belong to.

    Attributes
    ----------
    added : (K', K') array
        Added mass A of the state's `inertia`, or in the second half of a composed step at q_{n+1}.
    total : (N + 2, N + 2) array
        Reduced total mass at q_n; its Cholesky factor replaces the diagonal and what is below.
    diagonal : (N + 2,) array
        Diagonal of the total mass.
    velocity : (N + 2,) array
        M^-1 p.
    pose, momentum : (N + 2,) arrays
        Coordinates that `total` belongs to, and momentum that `velocity` belongs to (NaN for none).
    shape, trial_shape : (N + 2,) arrays
        The N - 1 joint angles that `added` belongs to, and those at the end of a trial increment.
    known : (2,) int array
        1 where `total` (TOTAL) and `added` (ADDED) are those of `pose` and `shape`.
    """

    added: Array
    total: Array
    diagonal: Array
    velocity: Array
    pose: Array
    momentum: Array
    shape: Array
    trial_shape: Array
    known: Integers


class Body(NamedTuple):
    """What the step equations of one body work with."""

    pose: Pose
    inc: Increment
    balance: Balance
    drag: Drag
    mass: Mass


def body_views(
    buffer: Array, start: int, known: Integers, elements: int, motions: int
) -> tuple[Body, int]:
    """Lay out a `Body`; returns it and the index behind it."""
    n = elements + 2
    k = padded(motions)
    added, end = matrix(buffer, padded(start), k, k)
    motion, end = matrix(buffer, end, 2, padded(motions + 1))
    e, end = matrix(buffer, end, 35, elements)
    joints, end = matrix(buffer, end, JOINT_ROWS, elements + 1)
    pose = Pose(e[0:2], e[2:4], e[4], e[5])
    inc = Increment(e[6], e[7], e[8], e[9], e[10], e[11], e[12:14], e[14:16], motion[0], motion[1])
    drag = Drag(e[16:18], e[18:20], e[20], e[21], e[22], e[23])
    u, end = matrix(buffer, end, 10, n)
    balance = Balance(
        e[24:26],
        e[26:28],
        e[28:30],
        e[30],
        e[31:33],
        e[33:35],
        joints,
        u[0],
        u[1],
        u[2],
        u[3],
    )
    total, end = matrix(buffer, end, n, n)
    mass = Mass(added, total, u[4], u[5], u[6], u[7], u[8], u[9], known)
    return Body(pose, inc, balance, drag, mass), end


#: Corrections of a step from which Newton's matrix learns.
MOST_LEARNT = 8


class Newton(NamedTuple):
    """Newton's method: increments, corrections and matrices.

    Attributes
    ----------
    motions, impulses : (N + 2, K + 1) and (N + 2, K) arrays, padded
        Derivatives of V and of A V by the unknowns, a row each.
    moved : (K + 1,) array, padded
        Scratch: V beside that of the increment.
    jacobian, transposed : (N + 2, N + 2) arrays
        Minus the derivative of the residual (its factors), and the rows of its transpose.
    increment, trial : (N + 2,) arrays
        The increment z that is improved, and one that is tried.
    start, whole, held : (N + 2,) arrays
        The increments that the method started from, that was last evaluated as a whole, and that
        solves the adjoint with the added mass of the part's beginning.
    lag : (N + 2,) array
        The increment that solves the adjoint less `held`.
    correction, next_correction : (N + 2,) arrays
        The correction of `increment`, and that of `trial` with the same matrix.
    shape : (N + 2,) array
        Scratch: N components of the shape force of `moved`.
    steps, answers : (MOST_LEARNT + 1, N + 2) arrays
        Corrections that were made, and what the residual after each asked for next.
    permutation : (N + 2,) int array
        Row exchanges of the factors.
    """

    motions: Array
    impulses: Array
    moved: Array
    jacobian: Array
    transposed: Array
    increment: Array
    trial: Array
    start: Array
    whole: Array
    held: Array
    lag: Array
    correction: Array
    next_correction: Array
    shape: Array
    steps: Array
    answers: Array
    permutation: Integers


def newton_views(
    buffer: Array, start: int, permutation: Integers, elements: int, motions: int
) -> tuple[Newton, int]:
    """Lay out a `Newton`; returns it and the index behind it."""
    n = elements + 2
    columns, end = matrix(buffer, padded(start), n + 1, padded(motions + 1))
    impulses_of, end = matrix(buffer, end, n, padded(motions))
    squares, end = matrix(buffer, end, 2 * n, n)
    u, end = matrix(buffer, end, 9, n)
    steps, end = matrix(buffer, end, MOST_LEARNT + 1, n)
    answers, end = matrix(buffer, end, MOST_LEARNT + 1, n)
    motions_of, moved = columns[:n], columns[n]
    jacobian, transposed = squares[:n], squares[n:]
    views = Newton(
        motions_of,
        impulses_of,
        moved,
        jacobian,
        transposed,
        u[0],
        u[1],
        u[2],
        u[3],
        u[4],
        u[5],
        u[6],
        u[7],
        u[8],
        steps,
        answers,
        permutation,
    )
    return views, end
