"""One swimmer of a recording: its run, what it was paid, and the series that follow from both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import OptionError
from swim_env.scene import Scene
from swim_env.trajectory import Trajectory

__all__ = ["Swimmer", "elastic_moments", "frames_of"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Residuals below this count as this (1): their logarithm is shown.
_LEAST_RESIDUAL = 1e-20


def elastic_moments(scene: Scene, joint_angles: Array) -> tuple[Array, Array]:
    """Return bending moments and elastic energies of the joints.

    Parameters
    ----------
    scene : Scene
        The scene; its ``integrator.strain`` says how an angle strains.
    joint_angles : (..., N - 1) array
        Joint angles (rad).

    Returns
    -------
    moments : (..., N - 1) array
        EI K with the strain K of (16) (N m).
    energies : (..., N - 1) array
        dl EI K^2 / 2 (J), the parts of W (33).
    """
    beam = scene.beam
    linear = scene.integrator.strain == "joint_angle"
    bend = joint_angles if linear else np.sin(joint_angles)
    moments: Array = beam.stiffness_at_joints() / beam.element_length * bend
    return moments, 0.5 * moments * bend


@dataclass(frozen=True, eq=False)
class Swimmer:
    """A run to be recorded.

    Attributes
    ----------
    name : str
        What it is called.
    trajectory : Trajectory
        The run.
    rewards : sequence of float, optional
        Reward of every action of an episode (BL).
    goal : (2,) array_like, optional
        Direction in which displacement counts, or the target (m); the scene's heading unless given.
    target_radius : float, optional
        How close the target has to be reached (BL); None where the goal is a direction.
    """

    name: str
    trajectory: Trajectory
    rewards: Sequence[float] | Array | None = None
    goal: Array | Sequence[float] | None = None
    target_radius: float | None = None

    @property
    def scene(self) -> Scene:
        """The scene."""
        return self.trajectory.scene

    @cached_property
    def aim(self) -> Array:
        """The goal, (2,): a direction (unit vector), or the target (m)."""
        given = self.scene.episode.heading if self.goal is None else self.goal
        return np.asarray(given, dtype=np.float64)

    @cached_property
    def joint_angles(self) -> Array:
        """Joint angles, (T + 1, N - 1) (rad)."""
        angles: Array = np.diff(self.trajectory.angles, axis=1)
        return angles

    @cached_property
    def held_torques(self) -> Array:
        """Torque that is held at every instant, (T + 1, N - 1) (N m); the last one's to its end."""
        torques = self.trajectory.torques
        return torques[np.minimum(np.arange(len(torques) + 1), len(torques) - 1)]

    @cached_property
    def moments(self) -> Array:
        """Elastic bending moments, (T + 1, N - 1) (N m)."""
        return elastic_moments(self.scene, self.joint_angles)[0]

    @cached_property
    def reward_times(self) -> Array:
        """Ends of the actions, (A,) (s)."""
        count = 0 if self.rewards is None else len(self.rewards)
        interval = self.scene.episode.control_interval
        ends = self.trajectory.time[0] + interval * np.arange(1, count + 1)
        times: Array = np.minimum(ends, self.trajectory.time[-1])
        return times

    def series(self, group: str, instants: Indices) -> Array:
        """Return a group of series at some instants, a column for each name in the schema.

        Work and drift are sums up to an instant, Newton corrections and residual the largest since
        the instant before it in the list. Velocities, of which the body's kinetic energy is made,
        are differences of positions over two steps, right to second order in the step; the
        fluid's is what remains of the total. Rewards are at `reward_times` instead.
        """
        series: Array = getattr(self, f"_{group}")(instants)
        return series

    def _progress(self, instants: Indices) -> Array:
        path, length = self.trajectory.path, self.scene.beam.length
        if self.target_radius is None:
            along = (path[instants] - path[0]) @ self.aim
        else:
            far = np.hypot(*(self.aim - path).T)
            along = far[0] - far[instants]
        column: Array = along[:, None] / length
        return column

    def _position(self, instants: Indices) -> Array:
        return self.trajectory.path[instants] / self.scene.beam.length

    def _reward(self, instants: Indices) -> Array:
        return np.asarray([] if self.rewards is None else self.rewards, dtype=np.float64)[:, None]

    def _return(self, instants: Indices) -> Array:
        return np.cumsum(self._reward(instants), axis=0)

    def _energy(self, instants: Indices) -> Array:
        run, beam = self.trajectory, self.scene.beam
        if run.steps < 2:
            body = np.full(len(instants), np.nan)
        else:
            step = self.scene.integrator.time_step
            moving: Array = np.gradient(run.centres, step, axis=0, edge_order=2)[instants]
            if self.scene.stream is not None:
                moving -= np.asarray(self.scene.stream.velocity)
            turning: Array = np.gradient(run.angles, step, axis=0, edge_order=2)[instants]
            element = beam.element_length
            body = 0.5 * element * beam.line_density * (moving**2).sum(axis=(1, 2))
            body += 0.5 * element * beam.rotary_inertia * (turning**2).sum(axis=1)
        elastic = elastic_moments(self.scene, self.joint_angles[instants])[1].sum(axis=1)
        total = run.energy[instants]
        return np.column_stack([body, total - body - elastic, elastic, total])

    def _work(self, instants: Indices) -> Array:
        run = self.trajectory
        sums = [_sums(run.work), _sums(run.positive_work), _sums(run.dissipated)]
        unexplained = run.energy - run.energy[0] - sums[0] + sums[2]
        return np.column_stack([*sums, unexplained])[instants]

    def _momentum(self, instants: Indices) -> Array:
        return self.trajectory.momentum[instants]

    def _drift(self, instants: Indices) -> Array:
        run = self.trajectory
        change = run.momentum - run.momentum[0]
        change[1:] -= np.cumsum(run.impulse, axis=0)
        return np.column_stack([np.hypot(change[:, 0], change[:, 1]), change[:, 2]])[instants]

    def _solver(self, instants: Indices) -> Array:
        run = self.trajectory
        columns = []
        for values in (run.iterations, run.residual):
            padded = np.concatenate([values[:1], values])
            begins = np.concatenate([[0], instants[:-1] + 1]) if len(instants) > 1 else instants
            columns.append(np.maximum.reduceat(padded[: instants[-1] + 1], begins))
        columns[1] = np.log10(np.maximum(columns[1], _LEAST_RESIDUAL))
        return np.column_stack(columns)

    def _torques(self, instants: Indices) -> Array:
        return self.held_torques[instants]

    def _joint_angles(self, instants: Indices) -> Array:
        return self.joint_angles[instants]


def _sums(values: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(values)])


def frames_of(trajectory: Trajectory, rate: float) -> Indices:
    """Return the instants of a run that come closest to a number of frames a second.

    Parameters
    ----------
    trajectory : Trajectory
        The run.
    rate : float
        Frames in a simulated second, above 0.

    Returns
    -------
    (F,) array of int
        Every so many instants from the first, and the last one.

    Raises
    ------
    OptionError
        If the rate is not a number above 0, or the run has no step.
    """
    if not (np.isfinite(rate) and rate > 0.0):
        raise OptionError(f"frames in a second must be a number above 0, got {rate!r}")
    if trajectory.steps < 1:
        raise OptionError("a recording takes a run of at least one step")
    every = max(1, round(1.0 / (rate * trajectory.scene.integrator.time_step)))
    chosen = np.arange(0, trajectory.steps + 1, every)
    return chosen if chosen[-1] == trajectory.steps else np.append(chosen, trajectory.steps)
