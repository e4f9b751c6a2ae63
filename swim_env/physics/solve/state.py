"""A member's state, which outlives a step and is in snapshots, and its work space, which is not.

What a step takes over from the one before is in the state, and so in snapshots: a restored run goes
on bit for bit. The work space remembers masses of the last pose, which only saves time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.layout import (
    SAMPLE,
    FluidConstants,
    FluidWork,
    fluid_views,
    fluid_work_sizes,
    motion_count,
)
from swim_env.physics.planar.layout import Body, Newton, body_views, newton_views
from swim_env.physics.runtime.compile import shared
from swim_env.physics.runtime.references import reader
from swim_env.physics.runtime.views import MEASURE, matrix, padded, vector

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Entries of `State.counters`: steps taken, increments of equal parts that are known (at most 3),
#: and how many 1024ths of a step the last part was; then the energy budget (J): the energy that
#: start, work and losses explain, the largest energy, what was lost to damping and drag, and the
#: largest that was not explained.
STEPS, KNOWN_INCREMENTS, LAST_PART, EXPLAINED, LARGEST, LOST, UNEXPLAINED = range(7)
COUNTERS = 7

#: Columns of the record that `advance` writes for every step.
RECORD_NAMES = (
    "energy",
    "work",
    "positive_work",
    "dissipated",
    "residual",
    "iterations",
    "evaluations",
    "parts",
    "at_round_off",
    "impulse_x",
    "impulse_y",
    "angular_impulse",
)
ENERGY, WORK, POSITIVE_WORK, DISSIPATED, RESIDUAL_MET, ITERATIONS = range(6)
EVALUATIONS, PARTS, AT_ROUND_OFF = range(6, 9)
IMPULSE_X, IMPULSE_Y, ANGULAR_IMPULSE = range(9, 12)
_RECORD = 12


class State(NamedTuple):
    """A member's state, views of one vector.

    Attributes
    ----------
    q, p : (N + 2,) arrays
        Coordinates and momenta, see `swim_env.physics.planar.chain`.
    history : (3, N + 2) array
        The last three increments, the latest first.
    shape_history : (3, N + 2) array
        The shape forces that belong to them, N numbers each.
    past : (2, N + 2) array
        Mean momentum of every element in the last step, with half its drag; N numbers each.
    lag : (N + 2,) array
        The increment of the last adjoint less the one found with the added mass of the part's
        beginning; added to that of the next.
    inertia : (N - 1,) array
        Joint angles of the shape whose added mass the state has: q's own or, after an adjoint,
        one so near that the residual is met with it (rad).
    counters : (7,) array
        See the names of its entries.
    """

    q: Array
    p: Array
    history: Array
    shape_history: Array
    past: Array
    lag: Array
    inertia: Array
    counters: Array


def state_views(buffer: Array, elements: int) -> tuple[State, int]:
    """Lay a `State` over a vector; returns it and the vector's length."""
    rows, end = matrix(buffer, 0, 12, elements + 2)
    counters, end = vector(buffer, end, COUNTERS)
    state = State(
        *(rows[0], rows[1], rows[2:5], rows[5:8], rows[8:10], rows[10]),
        rows[11, : elements - 1],
        counters,
    )
    return state, end


def state_size(elements: int) -> int:
    """Return the length of a member's state vector."""
    return state_views(MEASURE, elements)[1]


def energy_drift_of(state: Array) -> float:
    """Return `swim_env.physics.invariants.energy_drift` of the steps since the start."""
    return float(unexplained_share(state[-COUNTERS:]))


@shared
def unexplained_share(counters: Array) -> float:
    """Return `energy_drift_of` from the counters of a state, with which it ends."""
    through = counters[LARGEST] + counters[LOST]
    if counters[UNEXPLAINED] == 0.0:
        return 0.0
    if through > 0.0:
        return float(counters[UNEXPLAINED] / through)
    return np.inf


def steps_column(size: int) -> int:
    """Return the column of a state vector, of that many, that counts the steps taken."""
    return size - COUNTERS + STEPS


#: Entries of `OuterStep.tally`.
CORRECTIONS, EVALUATED, SHAPE_FAILURE, LEARNT = range(4)
TALLIES = 4


class OuterStep(NamedTuple):
    """The outer step so far, and what is restored where it or one of its parts fails.

    Attributes
    ----------
    total : (N + 2,) array
        Increment since its beginning.
    q, p, lag, inertia : (N + 2,), (N + 2,), (N + 2,), (N - 1,) arrays
        Of the state, at its beginning.
    part_q, part_p, part_inertia, part_total : arrays
        The same but the lag, and `total`, at the beginning of the part.
    part_record : (12,) array
        The record at the beginning of the part.
    losses : (3, N + 2) array
        Of a composed part: the impulses of damping and drag in its halves, their sum and by how
        much the second is larger, and the velocity at its beginning.
    effort : (1,) array
        Share that was spent of the effort that an outer step may take.
    tally : (4,) int array
        Newton's corrections (CORRECTIONS) and whole evaluations (EVALUATED) so far; the code of why
        the last shape at the end of a part had no added mass (SHAPE_FAILURE), 0 where it had; and
        from how many corrections the factors in `newton.jacobian` have learnt (LEARNT), -1 where a
        new matrix has to be made.
    """

    total: Array
    q: Array
    p: Array
    lag: Array
    inertia: Array
    part_q: Array
    part_p: Array
    part_inertia: Array
    part_total: Array
    part_record: Array
    losses: Array
    effort: Array
    tally: Integers


class ForceWork(NamedTuple):
    """What the internal forces of a step are made of.

    Attributes
    ----------
    mean, push : (2, N) arrays
        Mean momentum of every element over the step so far, and its drag (kg m/s).
    part_mean, part_push : (2, N) arrays
        The same at the beginning of the part.
    net : (2, N) array
        Force on every element from its neighbours at the beginning of the step (N).
    """

    mean: Array
    push: Array
    part_mean: Array
    part_push: Array
    net: Array


class Member(NamedTuple):
    """One member: its state and its work space, which kernels read by reference."""

    state: State
    body: Body
    fluid_work: FluidWork
    newton: Newton
    step: OuterStep
    forces: ForceWork


def member_views(
    state: Array, fluid: FluidConstants, floats: Array, integers: Integers
) -> tuple[Member, int]:
    """Lay a `Member` over its state and work space; returns it and how many floats it takes."""
    elements = fluid.geometry.elements
    motions = motion_count(fluid)
    n = elements + 2
    end = 2 + TALLIES
    known, tally, permutation = integers[:2], integers[2:end], integers[end : end + n]
    panel_integers = integers[end + n :]
    body, end = body_views(floats, 0, known, elements, motions)
    newton, end = newton_views(floats, end, permutation, elements, motions)
    rows, end = matrix(floats, end, 12, n)
    record, end = vector(floats, end, _RECORD)
    effort, end = vector(floats, end, 1)
    joints = elements - 1
    step = OuterStep(
        *(rows[0], rows[1], rows[2], rows[3], rows[10][:joints]),
        *(rows[4], rows[5], rows[11][:joints], rows[6]),
        record,
        rows[7:10],
        effort,
        tally,
    )
    sums, end = matrix(floats, end, 10, elements)
    forces = ForceWork(sums[0:2], sums[2:4], sums[4:6], sums[6:8], sums[8:10])
    # At a cache line.
    fluid_work, taken = fluid_views(floats[padded(end) :], panel_integers, fluid)
    member = Member(state_views(state, elements)[0], body, fluid_work, newton, step, forces)
    return member, padded(end) + taken


def work_sizes(fluid: FluidConstants) -> tuple[int, int]:
    """Return how many float64 and int64 numbers of work space a member takes."""
    _, floats = member_views(MEASURE, fluid, MEASURE, MEASURE)
    _, integers = fluid_work_sizes(fluid)
    # A multiple of a cache line, so that rows begin at one in every member's part.
    return int(padded(floats)), integers + 2 + TALLIES + fluid.geometry.elements + 2


def new_member(fluid: FluidConstants) -> Member:
    """Return a member of its own, at rest."""
    floats, integers = work_sizes(fluid)
    state = np.zeros(state_size(fluid.geometry.elements))
    return member_views(state, fluid, np.zeros(floats), np.zeros(integers, dtype=np.int64))[0]


#: Returns the member whose words a kernel is given.
member_at = reader(lambda: new_member(SAMPLE))
