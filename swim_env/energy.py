"""The energy of a recorded run in its parts: kinetic of the body and of the fluid, and elastic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.errors import SwimError
from swim_env.simulator import Simulator
from swim_env.trajectory import Trajectory

__all__ = ["EnergySplit", "elastic_energy", "split_energy"]

Array = NDArray[np.float64]

#: What the body alone does not have.
_SURROUNDINGS = ("axial_added_mass", "cross_flow_drag", "stream", "self_contact", "fluid")


@dataclass(frozen=True, eq=False)
class EnergySplit:
    """The energy at K instants in its parts, whose sum is the recorded energy.

    Attributes
    ----------
    time : (K,) array
        Instants (s).
    body, fluid : (K,) arrays
        Kinetic energy of the beam and of the fluid around it (J), in a stream's frame.
    elastic : (K,) array
        Energy of bending (J).
    """

    time: Array
    body: Array
    fluid: Array
    elastic: Array


def elastic_energy(trajectory: Trajectory, instants: ArrayLike | None = None) -> Array:
    """Return the energy of bending, (K,) (J): what the kernels find in the body alone, at rest.

    Parameters
    ----------
    trajectory : Trajectory
        A run.
    instants : (K,) array_like of int, optional
        Numbers of the instants; all unless given.
    """
    places = _places(trajectory)[_chosen(trajectory, instants)]
    return _weighed_alone(trajectory, places, np.zeros_like(places))


def split_energy(
    trajectory: Trajectory, velocity: ArrayLike, instants: ArrayLike | None = None
) -> EnergySplit:
    """Split the energy of a run, exactly.

    A trajectory holds no velocities, so its torques are played again. The kernels weigh the body
    alone, without fluid, at rest and in motion; what is left of the recorded energy is the fluid's.

    Parameters
    ----------
    trajectory : Trajectory
        A run from its start.
    velocity : (N + 2,) array_like
        That it started with, as `Simulator.velocity`: of the mean centre (m/s), and turning rates
        (rad/s).
    instants : (K,) array_like of int, optional
        Numbers of the instants, rising; all unless given.

    Raises
    ------
    SwimError
        If this velocity does not lead along the trajectory.
    """
    chosen = _chosen(trajectory, instants)
    places = _places(trajectory)
    again = Simulator(trajectory.scene)
    again.reset_to(places[0], velocity)
    rates = np.empty((len(chosen), places.shape[1]))
    for row, instant in enumerate(chosen.tolist()):
        for torques in trajectory.torques[again.steps : instant]:
            again.step(torques)
        rates[row] = again.velocity()
    off = np.abs(again.coordinates - places[again.steps]).max()
    if not off <= 1e-6 * trajectory.scene.beam.length:
        raise SwimError(
            "the velocity is not the one that the run started with: played again, it is "
            f"{off:.2g} off after {again.time:g} s"
        )
    if trajectory.scene.stream is not None:
        rates[:, :2] -= trajectory.scene.stream.velocity
    elastic = elastic_energy(trajectory, chosen)
    moving = _weighed_alone(trajectory, places[chosen], rates)
    rest = trajectory.energy[chosen] - moving
    return EnergySplit(trajectory.time[chosen], moving - elastic, rest, elastic)


def _chosen(trajectory: Trajectory, instants: ArrayLike | None) -> NDArray[np.int64]:
    if instants is None:
        return np.arange(trajectory.steps + 1)
    return np.asarray(instants, dtype=np.int64)


def _places(trajectory: Trajectory) -> Array:
    """Return minimal coordinates at all instants, (T + 1, N + 2)."""
    angles = trajectory.angles
    places: Array = np.concatenate(
        [trajectory.path, angles[:, :1], np.diff(angles, axis=1)], axis=1
    )
    return places


def _weighed_alone(trajectory: Trajectory, places: Array, rates: Array) -> Array:
    """Return the energy of the body without the fluid and what comes with it, (K,) (J)."""
    alone = Simulator(trajectory.scene.replace(dict.fromkeys(_SURROUNDINGS)))
    found = np.empty(len(places))
    for row, (place, rate) in enumerate(zip(places, rates, strict=True)):
        alone.reset_to(place, rate)
        found[row] = alone.energy()
    return found
