"""State and work space of a spatial body: named arrays, laid out in flat buffers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.references import reader
from swim_env.physics.runtime.views import MEASURE, matrix, padded, vector
from swim_env.physics.solve.state import COUNTERS
from swim_env.physics.spatial.chain import Pose
from swim_env.physics.spatial.panels.mass import PanelWork, panel_views, panel_work_sizes
from swim_env.physics.spatial.panels.surface import Surface, no_surface

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Columns of the record of a step: the first of `swim_env.physics.solve.state.RECORD_NAMES`. The
#: only impulse from outside is that of a stream, which follows from the momenta.
RECORD_SIZE = 9


class SpatialFluid(NamedTuple):
    """Constants of the fluid.

    Attributes
    ----------
    present : bool
        Whether there is any.
    coupled : bool
        Whether elements have added mass in common; else only that of their own, 6 by 6 each.
    varies : bool
        Whether it changes with the shape.
    added : (36 N^2,) or (0,) array
        The constant added mass A row by row, if there is one, in the elements' frames, ordered
        v1 v2 v3 w1 w2 w3 for each.
    stream : (3,) array
        Velocity of the uniform stream (m/s).
    """

    present: bool
    coupled: bool
    varies: bool
    added: Array
    stream: Array


class State(NamedTuple):
    """A member's state, views of one vector; it outlives a step and is in snapshots.

    Attributes
    ----------
    q : (4 N + 3,) array
        Coordinates, see `swim_env.physics.spatial.chain`.
    p : (3 N + 3,) array
        Momenta.
    history, shape_history : (3, 3 N + 3) arrays
        The last three increments, and the shape forces that belong to them, 3 N numbers each; the
        latest first.
    counters : (7,) array
        As in `swim_env.physics.solve.state`.
    """

    q: Array
    p: Array
    history: Array
    shape_history: Array
    counters: Array


def state_views(buffer: Array, elements: int) -> tuple[State, int]:
    """Lay a `State` over a vector; returns it and the vector's length."""
    n = 3 * elements + 3
    q, end = vector(buffer, 0, 4 * elements + 3)
    rows, end = matrix(buffer, end, 7, n)
    counters, end = vector(buffer, end, COUNTERS)
    return State(q, rows[0], rows[1:4], rows[4:7], counters), end


def state_size(elements: int) -> int:
    """Return the length of a member's state vector."""
    return state_views(MEASURE, elements)[1]


class Increment(NamedTuple):
    """How the body moves in an increment z of the minimal coordinates.

    Attributes
    ----------
    turn : (N, 3, 3) array
        F_k = exp(phi_k) - 1.
    change, directors : (N, 3, 3) arrays
        Changes R_k F_k of the directors, and the directors at q_{n+1}.
    angles : (N - 1, 3) array
        Rotation vectors of the joints at q_{n+1} (rad).
    shift : (N, 3) array
        Increments of the elements' centres (m).
    motion, impulse : (6 N,) arrays, padded
        V, and the fluid's impulse per unit motion A V/h.
    push : (N, 3) array
        The impulse's linear part in the axes of space.
    """

    turn: Array
    change: Array
    directors: Array
    angles: Array
    shift: Array
    motion: Array
    impulse: Array
    push: Array


class Balance(NamedTuple):
    """Momentum balance of a step: its residual, and what it is made of.

    Attributes
    ----------
    momentum, lever : (N, 3) arrays
        P^k, momentum of every element with the fluid's impulse (kg m/s), and sum_k E_kj P^k.
    shape : (N, 3) array
        S, the derivative of V^T A V/2 by the rotation of every element in its own axes.
    early, late : (N, 3) arrays
        Impulses of strain, torques and damping on every element, with the pose of the beginning
        and of the end (kg m^2/s).
    joint_size : (N,) array
        The magnitude of their terms.
    residual, change, scale, size : (3 N + 3,) arrays
        p_n + D1 L_d + h F/2; D1 L_d + D2 L_d + h F; the scale that the residual is measured with;
        and the magnitude of its terms.
    """

    momentum: Array
    lever: Array
    shape: Array
    early: Array
    late: Array
    joint_size: Array
    residual: Array
    change: Array
    scale: Array
    size: Array


#: Entries of `Mass.known`.
TOTAL, ADDED = range(2)


class Mass(NamedTuple):
    """Masses of a pose, and which state they belong to.

    Attributes
    ----------
    added : (6 N, 6 N) array, padded
        Added mass A in the elements' frames.
    total : (3 N + 3, 3 N + 3) array
        Reduced total mass at q_n; its Cholesky factor in place of diagonal and what is below.
    velocity : (3 N + 3,) array
        M^-1 p.
    pose, momentum : (4 N + 3,), (3 N + 3,) arrays
        The coordinates and the momentum that they belong to.
    known : (2,) int array
        1 where `total` (TOTAL) and `added` (ADDED) are there.
    """

    added: Array
    total: Array
    velocity: Array
    pose: Array
    momentum: Array
    known: Integers


class Columns(NamedTuple):
    """What pushes and moves, three rows for an element, with a column for every unknown.

    Rows are filled up to a multiple of 4, columns of unknowns to one of LANES.

    Attributes
    ----------
    vv, vw, wv, ww : (3 N, 3 N) arrays
        The added mass in the axes of space: linear impulses of shifts and of turns, angular ones of
        shifts and of turns.
    moves, pushes, spins, levers, rows : (3 N, 3 N + 3) arrays
        Shifts of the centres, linear and angular impulses, levers of the first, and the rows of
        Newton's matrix that belong to rotations.
    total : (3, 3 N + 3) array
        The sum of the pushes.
    """

    vv: Array
    vw: Array
    wv: Array
    ww: Array
    moves: Array
    pushes: Array
    spins: Array
    levers: Array
    rows: Array
    total: Array


class Newton(NamedTuple):
    """Newton's method: increments, corrections and matrices.

    Attributes
    ----------
    columns : Columns
        What Newton's matrix is made of.
    tangents : (N, 3) array
        Scratch: changes of d3.
    blocks, quaternions, vectors : (8, 3, 3), (3, 4), (4, 3) arrays
        Scratch.
    jacobian : (3 N + 3, 3 N + 3) array
        Minus the derivative of the residual (its factors).
    increment, trial, start, correction, next_correction : (3 N + 3,) arrays
        The increment z that is improved, one that is tried, the first one; corrections of both.
    permutation : (3 N + 3,) int array
        Row exchanges of the factors.
    """

    columns: Columns
    tangents: Array
    blocks: Array
    quaternions: Array
    vectors: Array
    jacobian: Array
    increment: Array
    trial: Array
    start: Array
    correction: Array
    next_correction: Array
    permutation: Integers


class OuterStep(NamedTuple):
    """What is restored where a step or a part of it fails, and what was spent.

    Attributes
    ----------
    q, p, part_q, part_p : arrays
        Of the state, at the beginning of the outer step and of the part.
    angles, part_angles : (N - 1, 3) arrays
        The joints' rotation vectors there.
    part_record : (9,) array
        The record at the beginning of the part.
    losses : (3, N - 1, 3) array
        Of a composed part: damping's impulse in the first half, the joints' rates at its beginning,
        and damping's impulse in the second half.
    effort : (1,) array
        Share that was spent of the effort that an outer step may take.
    tally : (3,) int array
        Newton's corrections and evaluations so far, and the code of why the last shape at the end
        of a part had no added mass, 0 where it had.
    """

    q: Array
    p: Array
    part_q: Array
    part_p: Array
    angles: Array
    part_angles: Array
    part_record: Array
    losses: Array
    effort: Array
    tally: Integers


class Body(NamedTuple):
    """What the step equations of one body work with."""

    pose: Pose
    inc: Increment
    balance: Balance
    mass: Mass


class Member(NamedTuple):
    """One member: its state and its work space, which kernels read by reference."""

    state: State
    body: Body
    newton: Newton
    step: OuterStep
    panels: PanelWork


def _rotations(buffer: Array, start: int, count: int) -> tuple[Array, int]:
    """Return a view (count, 3, 3) of the buffer from an index on, and the index behind it."""
    end = start + 9 * count
    return buffer[start:end].reshape((count, 3, 3)), end


def _columns_views(buffer: Array, start: int, high: int, wide: int) -> tuple[Columns, int]:
    """Lay out `Columns` from an index on; returns them and the index behind."""
    vv, end = matrix(buffer, start, high, high)
    vw, end = matrix(buffer, end, high, high)
    wv, end = matrix(buffer, end, high, high)
    ww, end = matrix(buffer, end, high, high)
    moves, end = matrix(buffer, end, high, wide)
    pushes, end = matrix(buffer, end, high, wide)
    spins, end = matrix(buffer, end, high, wide)
    levers, end = matrix(buffer, end, high, wide)
    rows, end = matrix(buffer, end, high, wide)
    total, end = matrix(buffer, end, 3, wide)
    return Columns(vv, vw, wv, ww, moves, pushes, spins, levers, rows, total), end


def member_views(
    state: Array, surface: Surface, floats: Array, integers: Integers
) -> tuple[Member, int]:
    """Lay a `Member` over its state and work space; returns it and how many floats it takes."""
    elements = surface.elements
    joints, n, coordinates = elements - 1, 3 * elements + 3, 4 * elements + 3
    motions = padded(6 * elements)
    # Rows that are padded come first: they begin at cache lines.
    added, end = matrix(floats, 0, motions, motions)
    # As many rows as `multiply` needs.
    high = (3 * elements + 3) // 4 * 4
    columns, end = _columns_views(floats, end, high, padded(n))
    flow, end = matrix(floats, end, 2, motions)

    directors, end = _rotations(floats, end, elements)
    between, end = _rotations(floats, end, joints)
    bends, end = matrix(floats, end, 2 * joints, 3)
    pose = Pose(directors, between, bends[:joints], bends[joints:])

    turn, end = _rotations(floats, end, elements)
    change, end = _rotations(floats, end, elements)
    new_directors, end = _rotations(floats, end, elements)
    new_angles, end = matrix(floats, end, joints, 3)
    shift, end = matrix(floats, end, elements, 3)
    push, end = matrix(floats, end, elements, 3)
    inc = Increment(turn, change, new_directors, new_angles, shift, flow[0], flow[1], push)

    momentum, end = matrix(floats, end, elements, 3)
    lever, end = matrix(floats, end, elements, 3)
    shape, end = matrix(floats, end, elements, 3)
    early, end = matrix(floats, end, elements, 3)
    late, end = matrix(floats, end, elements, 3)
    joint_size, end = vector(floats, end, elements)
    u, end = matrix(floats, end, 4, n)
    balance = Balance(momentum, lever, shape, early, late, joint_size, u[0], u[1], u[2], u[3])

    total, end = matrix(floats, end, n, n)
    u, end = matrix(floats, end, 2, n)
    pose_of_mass, end = vector(floats, end, coordinates)
    mass = Mass(added, total, u[0], pose_of_mass, u[1], integers[:2])

    tangents, end = matrix(floats, end, elements, 3)
    blocks, end = _rotations(floats, end, 8)
    quaternions, end = matrix(floats, end, 3, 4)
    vectors, end = matrix(floats, end, 4, 3)
    jacobian, end = matrix(floats, end, n, n)
    u, end = matrix(floats, end, 5, n)
    newton = Newton(
        *(columns, tangents, blocks, quaternions, vectors, jacobian),
        *(u[0], u[1], u[2], u[3], u[4], integers[5 : n + 5]),
    )

    q, end = matrix(floats, end, 2, coordinates)
    p, end = matrix(floats, end, 2, n)
    angles, end = matrix(floats, end, 2 * joints, 3)
    record, end = vector(floats, end, RECORD_SIZE)
    losses, end = matrix(floats, end, 3 * joints, 3)
    effort, end = vector(floats, end, 1)
    step = OuterStep(
        *(q[0], p[0], q[1], p[1], angles[:joints], angles[joints:], record),
        *(losses.reshape((3, joints, 3)), effort, integers[2:5]),
    )
    # At a cache line.
    panels, taken = panel_views(floats[padded(end) :], integers[n + 5 :], surface)
    body = Body(pose, inc, balance, mass)
    member = Member(state_views(state, elements)[0], body, newton, step, panels)
    return member, padded(end) + taken


def work_sizes(surface: Surface) -> tuple[int, int]:
    """Return how many float64 and int64 numbers of work space a member takes."""
    _, floats = member_views(MEASURE, surface, MEASURE, MEASURE)
    _, integers = panel_work_sizes(surface)
    return int(padded(floats)), 3 * surface.elements + 8 + integers


def new_spatial_member(surface: Surface) -> Member:
    """Return a member of its own, at rest."""
    floats, integers = work_sizes(surface)
    state = np.zeros(state_size(surface.elements))
    return member_views(state, surface, np.zeros(floats), np.zeros(integers, dtype=np.int64))[0]


#: Returns the member whose words a kernel is given.
spatial_member_at = reader(lambda: new_spatial_member(no_surface(2)))
