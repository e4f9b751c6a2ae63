"""Trajectories made of what the kernels write, and the effect that records every step."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import OptionError
from swim_env.physics.invariants import momentum_map
from swim_env.physics.planar.chain import centres_of_trajectory
from swim_env.physics.solve.state import RECORD_NAMES
from swim_env.scene import Scene
from swim_env.sim.trajectory import Trajectory, TrajectoryBase

if TYPE_CHECKING:
    from swim_env.sim.batch import Bodies

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Of a member: steps taken before the start, energy (J), and rows of the start and every step.
Kept = tuple[int, float, Array]

#: Rows of a table at its first step; a full table doubles.
_FIRST_ROWS = 1024


def trace_columns(scene: Scene) -> int:
    """Return the number of columns of a trace: coordinates, momenta, internal forces if any."""
    elements = scene.beam.elements
    forces = 2 * (elements - 1) if scene.internal_forces is not None else 0
    return 2 * (elements + 2) + forces


def trajectory_of(
    scene: Scene,
    reason: str,
    first: int,
    energy: float,
    trace: Array,
    torques: Array,
    record: Array,
) -> Trajectory:
    """Make a trajectory of T steps from what `Bodies.advance` has written.

    The reason for an early end is empty if there was none; `first` steps were taken before the
    first instant, at which H is the energy (J). The trace is (T + 1, C) with a row for the first
    instant, torques (T, N - 1) (N m) and record (T, 12) are those of each step.
    """
    elements = scene.beam.elements
    n = elements + 2
    q, p = trace[:, :n].copy(), trace[:, n : 2 * n]
    forces = None
    if scene.internal_forces is not None:
        forces = trace[1:, 2 * n :].reshape(-1, elements - 1, 2).copy()
    positions = np.empty((len(q), elements, 2))
    centres_of_trajectory(q, scene.beam.element_length, positions)
    columns = columns_of(scene, first, energy, record)
    outside = [columns.pop(name) for name in ("impulse_x", "impulse_y", "angular_impulse")]
    return Trajectory(
        scene=scene,
        termination_reason=reason,
        centres=positions,
        angles=np.cumsum(q[:, 2:], axis=1),
        torques=torques.copy(),
        momentum=momentum_map(q, p),
        impulse=np.stack(outside, axis=-1),
        internal_forces=forces,
        **columns,
    )


def columns_of(scene: Scene, first: int, energy: float, record: Array) -> dict[str, Array]:
    """Return time (T + 1,) (s), energy (T + 1,) (J) and the other columns (T,) of a record.

    `first` steps were taken before the first instant, at which H is the energy (J).
    """
    # In space there are no columns for impulses from outside.
    found = dict(zip(RECORD_NAMES[: record.shape[1]], record.T.copy(), strict=True))
    # The kernel records the energy at the end of each step.
    found["energy"] = np.concatenate([[energy], found["energy"]])
    steps = np.arange(first, first + len(record) + 1, dtype=np.float64)
    return {"time": steps * scene.integrator.time_step, **found}


class Recorder:
    """Keeps the steps of M bodies since each one's start.

    A member has a table with a row for its start and for every step, which doubles when it is full.
    Rows are never overwritten, so arrays that were taken out of a table stay valid.

    Parameters
    ----------
    bodies : swim_env.sim.batch.Bodies
        The bodies.
    """

    def __init__(self, bodies: Bodies) -> None:
        self._bodies = bodies
        count = len(bodies.states)
        #: Columns of a table: trace, torques, record.
        first = bodies.trace_columns
        last = first + math.prod(bodies.joint_shape)
        self._parts = slice(first), slice(first, last), slice(last, last + bodies.record_columns)
        self._kept: list[Kept | None] = [None] * count
        #: Steps in each table.
        self._steps = [0] * count
        self._trace = np.empty((count, 0, first))

    def begin(self, member: int, steps: int, energy: float, state: Array) -> None:
        """Forget a member's steps; its trajectory begins here.

        So far it has taken some steps; it has an energy (J), and the state is its coordinates and
        momenta.
        """
        start = np.full((1, self._parts[-1].stop), np.nan)
        start[0, : state.size] = state
        self._kept[member] = (steps, energy, start)
        self._steps[member] = 0

    def kept(self, member: int) -> Kept | None:
        """Return what is recorded of a member, None before its first start."""
        kept = self._kept[member]
        return None if kept is None else (*kept[:2], kept[2][: self._steps[member] + 1])

    def room(self, steps: int) -> Array:
        """Return an array for a trace of T steps, (M, T, C); the same one while T is the same."""
        if self._trace.shape[1] != steps:
            self._trace = np.empty((len(self._kept), steps, self._trace.shape[2]))
        return self._trace

    def add(
        self,
        members: Indices,
        taken: Indices,
        trace: Array,
        torques: Array,
        hold: int,
        record: Array,
    ) -> None:
        """Add the steps that members have taken, with what `Bodies.advance` was given and wrote."""
        traced, driven, recorded = self._parts
        for member, steps in zip(members.tolist(), taken[members].tolist(), strict=True):
            kept = self._kept[member]
            # Without a start, this recorder was attached in the middle of the member's run.
            if kept is None or not self.wants(member):
                continue
            rows = kept[2]
            begin = self._steps[member] + 1
            end = begin + steps
            if end > len(rows):
                longer = np.empty((max(end, 2 * len(rows), _FIRST_ROWS), rows.shape[1]))
                longer[:begin] = rows[:begin]
                rows = longer
                self._kept[member] = (*kept[:2], rows)
            held = torques[member].reshape(torques.shape[1], -1)
            rows[begin:end, traced] = trace[member, :steps]
            rows[begin:end, driven] = held if len(held) == 1 else held[np.arange(steps) // hold]
            rows[begin:end, recorded] = record[member, :steps]
            self._steps[member] = end - 1

    def wants(self, member: int) -> bool:
        """Return whether a member's steps are recorded: those of all members here."""
        return True

    def trajectory(self, member: int, reason: str) -> TrajectoryBase:
        """Return a member's trajectory since its start (OptionError if there was none)."""
        return self.trajectory_of(self.kept(member), reason)

    def trajectory_of(self, kept: Kept | None, reason: str) -> TrajectoryBase:
        """Return the trajectory of what was kept of a member, with the reason for its end."""
        if kept is None:
            raise OptionError("nothing was recorded yet: call reset first")
        steps, energy, rows = kept
        traced, driven, recorded = self._parts
        torques = rows[1:, driven].reshape(len(rows) - 1, *self._bodies.joint_shape)
        made = self._bodies.trajectory
        return made(reason, steps, energy, rows[:, traced], torques, rows[1:, recorded])


def needs_recording(recorder: Recorder | None) -> Recorder:
    """Return the recorder of a scene with the effect ``recording``, OptionError without one."""
    if recorder is None:
        raise OptionError(
            "nothing was recorded: the scene needs the block recording "
            "(scene.replace('recording', True))"
        )
    return recorder
