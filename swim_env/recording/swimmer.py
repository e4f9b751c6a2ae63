"""One swimmer of a recording: its run, its rewards, and the series that follow from both."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.analysis.energy import elastic_energy, elastic_moments, split_energy, summed
from swim_env.errors import OptionError
from swim_env.scene import Scene
from swim_env.scene.checks import checked_option, real
from swim_env.sim.trajectory import Trajectory, TrajectoryBase

__all__ = ["Swimmer", "checked_rate", "frames_of"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Residuals below this count as this (1): their logarithm is shown.
_LEAST_RESIDUAL = 1e-20


@dataclass(frozen=True, eq=False)
class Swimmer:
    """A run to be recorded.

    Attributes
    ----------
    name, trajectory : str, Trajectory
        What it is called, and the run.
    rewards : sequence of float, optional
        Reward of every action of an episode (BL).
    goal : (2,) array_like, in space (3,), optional
        Direction in which displacement counts, or the target (m); the scene's heading unless given.
    target_radius : float, optional
        How close the target has to be reached (BL); None where the goal is a direction.
    start_velocity : (N + 2,) array_like, optional
        The run's first velocity, as `Simulator.velocity`. With it the kinetic energy is split
        between body and fluid, for which the torques are played again; without, and always in
        space, it is given whole.
    """

    name: str
    trajectory: Trajectory
    rewards: Sequence[float] | Array | None = None
    goal: Array | Sequence[float] | None = None
    target_radius: float | None = None
    start_velocity: Array | Sequence[float] | None = None

    def __new__(cls, name: str = "", trajectory: Any = None, *_: Any, **__: Any) -> Swimmer:
        """Make the swimmer that the run's dimension calls for."""
        if trajectory is not None and trajectory.scene.dimension == 3:
            from swim_env.recording.spatial_swimmer import SpatialSwimmer

            return object.__new__(SpatialSwimmer)
        return object.__new__(cls)

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

    @property
    def girth(self) -> float:
        """How far the body is drawn from its centre line (m), 0 in the plane, where it is thin."""
        return 0.0

    def largest(self, colour: str) -> float:
        """Return the torque or, in this run, moment that a colour of the body reaches to (N m)."""
        if colour == "torque":
            return self.scene.torque_limit
        return float(np.abs(self.moments).max(initial=0.0)) or 1.0

    @cached_property
    def reward_times(self) -> Array:
        """Ends of the actions, (A,) (s)."""
        count = 0 if self.rewards is None else len(self.rewards)
        interval = self.scene.episode.control_interval
        ends = self.trajectory.time[0] + interval * np.arange(1, count + 1)
        times: Array = np.minimum(ends, self.trajectory.time[-1])
        return times

    def check(self) -> None:
        """Check that what is given beside the run can belong to it, else raise OptionError.

        Rewards are finite numbers, one for each action that the run has begun. An action in which
        the physics made no step at all may have one too.
        """
        for what, value, size in (
            ("goal", self.goal, self.scene.dimension),
            ("start_velocity", self.start_velocity, self.scene.beam.elements + 2),
        ):
            if value is not None and (
                np.shape(value) != (size,) or not np.isfinite(np.asarray(value, float)).all()
            ):
                raise OptionError(f"the {what} of {self.name} must be {size} finite numbers")
        if self.target_radius is not None and self.goal is None:
            raise OptionError(f"the target_radius of {self.name} needs a goal, the target (m)")
        if self.rewards is None:
            return
        rewards = np.asarray(self.rewards)
        if rewards.ndim != 1 or rewards.dtype.kind not in "iuf" or not np.isfinite(rewards).all():
            raise OptionError(f"the rewards of {self.name} must be a list of finite numbers")
        run = self.trajectory
        actions = -(-run.steps // self.scene.steps_per_action)
        if len(rewards) - actions not in ((0, 1) if run.termination_reason else (0,)):
            raise OptionError(
                f"the run of {self.name} takes {actions} rewards, one for each control interval of "
                f"{self.scene.episode.control_interval:g} s, got {len(rewards)}"
            )

    def series(self, group: str, instants: Indices) -> Array:
        """Return a group of series at some instants, a column for each of its `schema.names_of`.

        Work and drift are sums up to an instant, Newton corrections and residual the largest since
        the instant before it in the list. Rewards are at `reward_times` instead. If the run did not
        start with the given velocity, the energy's is a SwimError.
        """
        series: Array = getattr(self, f"_{group}")(instants)
        return series

    def _progress(self, instants: Indices) -> Array:
        path = self._mean_centres(np.concatenate([[0], instants]))
        if self.target_radius is None:
            along = (path[1:] - path[0]) @ self.aim
        else:
            far = np.linalg.norm(self.aim - path, axis=1)
            along = far[0] - far[1:]
        column: Array = along[:, None] / self.scene.beam.length
        return column

    def _position(self, instants: Indices) -> Array:
        return self._mean_centres(instants) / self.scene.beam.length

    def _mean_centres(self, instants: Indices) -> Array:
        """Return the path, (K, 2) (m); of every step it would take four times as long."""
        path: Array = self.trajectory.centres[instants].mean(axis=1)
        return path

    def _reward(self, instants: Indices) -> Array:
        return np.asarray([] if self.rewards is None else self.rewards, dtype=np.float64)[:, None]

    def _return(self, instants: Indices) -> Array:
        return np.cumsum(self._reward(instants), axis=0)

    def _energy(self, instants: Indices) -> Array:
        total = self.trajectory.energy[instants]
        if self.start_velocity is None:
            elastic = elastic_energy(self.trajectory, instants)
            return np.column_stack([total - elastic, elastic, total])
        split = split_energy(self.trajectory, self.start_velocity, instants)
        return np.column_stack([split.body, split.fluid, split.elastic, total])

    def _work(self, instants: Indices) -> Array:
        run = self.trajectory
        sums = [summed(part) for part in (run.work, run.positive_work, run.dissipated)]
        return np.column_stack([*sums, run.unexplained_energy])[instants]

    def _momentum(self, instants: Indices) -> Array:
        return self.trajectory.momentum[instants]

    def _drift(self, instants: Indices) -> Array:
        change = self.trajectory.unexplained_momentum
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


def checked_rate(rate: object, name: str) -> float:
    """Return a number of frames in a second, or raise OptionError if it is not above 0."""
    return checked_option(real(above=0.0), rate, name)


def frames_of(trajectory: TrajectoryBase, rate: float | None, times: float = 1.0) -> Indices:
    """Return the instants (F,) of a run that come closest to a number of frames a simulated second.

    Every so many instants from the first, and the last one; `times` as many as the rate says, that
    of the scene's `frame_interval` unless it is given. A rate that is not above 0 and a run without
    a step are OptionErrors.
    """
    if rate is None:
        rate = 1.0 / trajectory.scene.frame_interval
    rate = times * checked_rate(rate, "the number of frames in a second")
    if trajectory.steps < 1:
        raise OptionError("a recording takes a run of at least one step")
    step = trajectory.scene.integrator.time_step
    # Halfway between two, the more frames, whatever the rounding.
    every = max(1, math.ceil(1.0 / (rate * step) * (1.0 - 1e-9) - 0.5))
    if every * step < 1e-9:
        raise OptionError(
            "recordings count nanoseconds, so their frames must be at least that far apart, and "
            f"steps of scene {trajectory.scene.name} are {step:g} s: give at most 1e9 frames in a "
            "second"
        )
    chosen = np.arange(0, trajectory.steps + 1, every)
    return chosen if chosen[-1] == trajectory.steps else np.append(chosen, trajectory.steps)
