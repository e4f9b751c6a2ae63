"""What a task's methods see of its members after a start or an action."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.envs.assessment import ACTIONS_TAKEN, FIGURES
from swim_env.scene import Scene

Array = NDArray[np.float64]

COLUMNS = {name: column for column, name in enumerate(FIGURES.names or ())}


@dataclass(eq=False)
class Arrays:
    """All members' arrays behind a `Moment`, as `swim_env.envs.episodes.Episodes` has them.

    Coordinates and previous ones are as in `Moment`, `seen` (M, n) what the kernel lets members
    observe, `state` what the task keeps of them; the rest is named as there.
    """

    coordinates: Array
    previous: Array
    velocities: Array
    torques: Array
    outcome: NDArray[np.int64]
    goals: Array
    figures: Array
    counters: NDArray[np.int64]
    seen: NDArray[np.float32]
    state: dict[str, NDArray[Any]] = field(default_factory=dict)


def columns(*values: Array) -> Array:
    """Return arrays (m,) as the columns of one, (m, k): `numpy.stack` for tasks in a hurry."""
    joined: Array = np.empty((len(values[0]), len(values)))
    for column, value in enumerate(values):
        joined[:, column] = value
    return joined


@functools.cache
def _shares(elements: int) -> Array:
    """Return the share of the elements that each joint angle turns, (N - 1,)."""
    return np.arange(elements - 1, 0, -1) / elements


class Moment:
    """Members after a start or an action, as arrays whose first axis is the member, (m, ...).

    Scenes of three dimensions have a `SpatialMoment`, in which D = 3; in the plane D = 2.

    Nothing is to be written to but `state`. Directions and positions are over ground, BL
    are body lengths. A member gets the same bits whatever else is in the arrays, as long as a task
    works on elements, or sums a member's own.

    Attributes
    ----------
    scene : Scene
        The scene.
    members : (m,) array of int
        Which members these are: all that have moved, or one that starts.
    start : bool
        Whether this is a start, at which nothing has been gained yet.
    coordinates, previous : (m, N + 2) arrays
        Mean centre (m), angle of element 1 and joint angles (rad), now and before the action.
    goal : (m, D) array
        Unit vectors, or points (m).
    state : dict of str to (m, ...) array
        What the task keeps of the members, see `Task.state`. What is written into it is kept.
    """

    def __init__(
        self, scene: Scene, arrays: Arrays, members: NDArray[np.int64], whole: bool, start: bool
    ) -> None:
        self.scene, self.members, self.start = scene, members, start
        self._arrays, self._whole = arrays, whole
        self.coordinates = self._of(arrays.coordinates)
        self.previous = self._of(arrays.previous)
        self.goal = self._of(arrays.goals)
        self.state: Mapping[str, NDArray[Any]] = {
            name: self._of(array) for name, array in arrays.state.items()
        }

    def _of(self, array: NDArray[Any]) -> Any:
        return array if self._whole else array[self.members]

    @cached_property
    def _figures(self) -> Array:
        # Rows, as functions may round otherwise for numbers that are not neighbours.
        return np.ascontiguousarray(self._of(self._arrays.figures).T)

    def _figure(self, name: str) -> Array:
        row: Array = self._figures[COLUMNS[name]]
        return row

    # ---- where and how it moves ----------------------------------------------------------------

    @cached_property
    def position(self) -> Array:
        """Mean centre, (m, D) (BL)."""
        place: Array = self.coordinates[:, : self.scene.dimension] / self.scene.beam.length
        return place

    @cached_property
    def velocity(self) -> Array:
        """Velocity of the mean centre, (m, D) (BL/s): the mean over the action, or the start's."""
        length, size = self.scene.beam.length, self.scene.dimension
        if self.start:
            at_start: Array = self._of(self._arrays.velocities)[:, :size] / length
            return at_start
        moved = self.coordinates[:, :size] - self.previous[:, :size]
        mean: Array = moved / (self._some_seconds * length)[:, None]
        return mean

    @cached_property
    def heading(self) -> Array:
        """Angle of the head's direction in the plane, (m,) (rad); turns add up."""
        return self._mean_angle(self.coordinates) + np.pi

    @cached_property
    def ahead(self) -> Array:
        """The head's direction, (m, 2) unit vectors."""
        angle = self._mean_angle(self.coordinates)
        return columns(-np.cos(angle), -np.sin(angle))

    @cached_property
    def turning_rate(self) -> Array:
        """Mean turning rate of the elements, (m,) (rad/s), counter-clockwise; as `velocity`."""
        if self.start:
            mean: Array = self._of(self._arrays.velocities)[:, 2:].mean(axis=1)
            return mean
        turned = self._mean_angle(self.coordinates) - self._mean_angle(self.previous)
        return turned / self._some_seconds

    def in_body(self, vectors: Array) -> Array:
        """Return vectors (m, D) as the body sees them, (m, D): (forward, left), in space and up."""
        ahead_x, ahead_y = self.ahead.T
        x, y = vectors.T
        return columns(ahead_x * x + ahead_y * y, ahead_x * y - ahead_y * x)

    def seen_direction(self, way: Array) -> tuple[Array, Array]:
        """Return how directions `in_body` are observed, and their `heading_error`."""
        forward, left = way.T
        return columns(left, forward), np.arctan2(left, forward)

    def _mean_angle(self, coordinates: Array) -> Array:
        bending = coordinates[:, 3:] * _shares(self.scene.beam.elements)
        angle: Array = coordinates[:, 2] + np.add.reduce(bending, axis=1)
        return angle

    # ---- the goal ------------------------------------------------------------------------------

    @property
    def heading_error(self) -> Array:
        """Angle from the head's direction to the goal's, (m,) (rad).

        It is -pi to pi, and in space 0 to pi.
        """
        return self._figure("heading_error")

    @property
    def distance(self) -> Array:
        """Distance of the mean centre from the goal, (m,) (BL); 0 where that is a direction."""
        return self._figure("distance")

    @property
    def progress(self) -> Array:
        """Net displacement along the goal or towards it since the start, (m,) (BL)."""
        return self._figure("progress")

    @property
    def terms(self) -> dict[str, Array]:
        """The standard terms of the reward with their signs, (m,) (BL): progress, effort, heading.

        The progress is that of the action; the others have the weights `Task` was given.
        """
        names = ("progress", "effort", "heading")
        return {name: self._figure(f"reward_{name}") for name in names}

    # ---- time, torques, work -------------------------------------------------------------------

    @property
    def time(self) -> Array:
        """Time since the start, (m,) (s)."""
        return self._figure("time")

    @cached_property
    def seconds(self) -> Array:
        """Time that the action was held, (m,) (s): less where the physics ended it, 0 at a start.

        A reward per time is multiplied by it.
        """
        if self.start:
            return np.zeros(len(self.members))
        taken: Array = self._of(self._arrays.outcome)[:, 0] * self.scene.integrator.time_step
        return taken

    @property
    def share_held(self) -> Array:
        """The same as a share of the control interval, (m,): 1, unless the physics ended it.

        A cost of time that is multiplied by it is the same for bodies that swim alike, however
        fast they are.
        """
        share: Array = self.seconds / self.scene.episode.control_interval
        return share

    @cached_property
    def _some_seconds(self) -> Array:
        # Where no step could be taken, nothing has moved either.
        return np.maximum(self.seconds, self.scene.integrator.time_step)

    @cached_property
    def actions_taken(self) -> NDArray[np.int64]:
        """Actions since the start, (m,)."""
        counted: NDArray[np.int64] = self._of(self._arrays.counters)[:, ACTIONS_TAKEN]
        return counted

    @cached_property
    def torques(self) -> Array:
        """Torques that were held, (m, N - 1), in space (m, N - 1, 3) (N m); 0 at a start."""
        held: Array = self._of(self._arrays.torques)[:, 0]
        return held

    @cached_property
    def shares(self) -> Array:
        """The actions that were held, (m, n): shares of the limits, in -1 to 1."""
        return self.scene.actions_of(self.torques)

    @property
    def work(self) -> Array:
        """Work of the torques over the action, (m,) (J)."""
        return self._figure("work")

    @property
    def positive_work(self) -> Array:
        """Its positive parts over joints and time steps, (m,) (J)."""
        return self._figure("positive_work")

    @property
    def energy_drift(self) -> Array:
        """Unexplained share of the energy, (m,), see docs/environments/interface.md."""
        return self._figure("energy_drift")
