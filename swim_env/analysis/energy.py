"""The energy of a recorded run in its parts: kinetic of the body and of the fluid, and elastic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.errors import OptionError, SwimError
from swim_env.scene import Scene
from swim_env.sim.simulator import Simulator
from swim_env.sim.trajectory import Trajectory

__all__ = [
    "EnergySplit",
    "elastic_energy",
    "elastic_moments",
    "split_energy",
    "velocity_of_start",
    "summed",
]

Array = NDArray[np.float64]

#: Coordinates that are no further apart (BL, rad) are the same but for rounding, which an unstable
#: motion carries on; played again they may also differ by the tolerance of the scene's steps, whose
#: first guess depends on steps before the start.
_ROUNDING = 1e-6
#: Blocks of a scene that the body alone is without.
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

    Raises
    ------
    OptionError
        If the angles are those of another number of joints.
    """
    beam = scene.beam
    if np.shape(joint_angles)[-1:] != (beam.elements - 1,):
        raise OptionError(
            f"joint_angles must have shape (..., {beam.elements - 1}) in scene {scene.name}, got "
            f"{np.shape(joint_angles)}"
        )
    linear = scene.integrator.strain == "joint_angle"
    bend = joint_angles if linear else np.sin(joint_angles)
    moments: Array = beam.stiffness_at_joints() / beam.element_length * bend
    return moments, 0.5 * moments * bend


def elastic_energy(trajectory: Trajectory, instants: ArrayLike | None = None) -> Array:
    """Return the energy of bending, (K,) (J).

    Parameters
    ----------
    trajectory : Trajectory
        A run.
    instants : (K,) array_like of int, optional
        Indices of the instants; all unless given.
    """
    joint_angles = np.diff(trajectory.angles[_chosen(trajectory, instants)], axis=1)
    total: Array = elastic_moments(trajectory.scene, joint_angles)[1].sum(axis=1)
    return total


def split_energy(
    trajectory: Trajectory, velocity: ArrayLike, instants: ArrayLike | None = None
) -> EnergySplit:
    """Split the energy of a run, exactly.

    A trajectory holds no velocities, so its torques are played again. The simulator gives the
    energy of the body alone, without fluid, in motion; the rest of the recorded energy is the
    fluid's.

    Parameters
    ----------
    trajectory : Trajectory
        A run from its start.
    velocity : (N + 2,) array_like
        The run's first velocity, as `Simulator.velocity`: of the mean centre (m/s), and turning
        rates (rad/s).
    instants : (K,) array_like of int, optional
        Indices of the instants, increasing; all unless given.

    Raises
    ------
    SwimError
        If this velocity does not lead along the trajectory.
    """
    chosen = _chosen(trajectory, instants)
    rates = _velocities(trajectory, velocity, chosen)
    if trajectory.scene.stream is not None:
        rates[:, :2] -= trajectory.scene.stream.velocity
    elastic = elastic_energy(trajectory, chosen)
    alone = Simulator(trajectory.scene.replace(dict.fromkeys(_SURROUNDINGS)))
    moving = np.empty(len(chosen))
    for row, (place, rate) in enumerate(zip(_places(trajectory)[chosen], rates, strict=True)):
        alone.reset_to(place, rate)
        moving[row] = alone.energy()
    rest = trajectory.energy[chosen] - moving
    return EnergySplit(trajectory.time[chosen], moving - elastic, rest, elastic)


def velocity_of_start(trajectory: Trajectory) -> Array | None:
    """Return the velocity that a run started with, if it began as its scene says.

    Parameters
    ----------
    trajectory : Trajectory
        A run, for example one that was saved: files hold no velocities. Its torques are played
        again.

    Returns
    -------
    (N + 2,) array or None
        As `Simulator.velocity`; None if the scene's own start does not lead along the run.
    """
    try:
        simulator = Simulator(trajectory.scene)
        velocity = simulator.velocity()
        if not _apart(simulator.coordinates, _places(trajectory)[0], trajectory) <= _ROUNDING:
            return None
        _velocities(trajectory, velocity, np.array([trajectory.steps]))
    except SwimError:
        return None
    return velocity


def _velocities(trajectory: Trajectory, velocity: ArrayLike, chosen: NDArray[np.int64]) -> Array:
    """Return velocities at instants (K, N + 2) by playing the torques again from the start's."""
    places = _places(trajectory)
    again = Simulator(trajectory.scene)
    again.reset_to(places[0], velocity)
    same = max(_ROUNDING, trajectory.scene.integrator.tolerance)
    rates = np.empty((len(chosen), places.shape[1]))
    for row, instant in enumerate(chosen.tolist()):
        torques = trajectory.torques[again.steps : instant]
        if len(torques):
            # Unlike `step`, this does not raise where the run itself ended early.
            again.rollout(torques)
        rates[row] = again.velocity()
        off = _apart(again.coordinates, places[again.steps], trajectory)
        if again.steps != instant or not off <= same:
            raise SwimError(
                "the velocity is not the one that the run started with: played again, it is "
                f"{off:.2g} (BL, rad) off after {again.time:g} s"
            )
    return rates


def _apart(one: Array, other: Array, trajectory: Trajectory) -> float:
    """Return how far apart coordinates are: the largest of lengths (BL) and angles (rad)."""
    gaps = np.abs(one - other)
    gaps[:2] /= trajectory.scene.beam.length
    return float(gaps.max())


def summed(values: Array) -> Array:
    """Return running sums from zero, (T + 1,), of what every step adds, (T,)."""
    sums: Array = np.concatenate([[0.0], np.cumsum(values)])
    return sums


def _chosen(trajectory: Trajectory, instants: ArrayLike | None) -> NDArray[np.int64]:
    if instants is None:
        return np.arange(trajectory.steps + 1)
    chosen = np.atleast_1d(np.asarray(instants))
    last = trajectory.steps
    if chosen.size and (
        chosen.dtype.kind not in "iu" or not ((chosen >= 0) & (chosen <= last)).all()
    ):
        raise OptionError(f"instants must be whole numbers of 0 to {last} in this trajectory")
    return chosen.astype(np.int64)


def _places(trajectory: Trajectory) -> Array:
    """Return minimal coordinates at all instants, (T + 1, N + 2)."""
    angles = trajectory.angles
    places: Array = np.concatenate(
        [trajectory.path, angles[:, :1], np.diff(angles, axis=1)], axis=1
    )
    return places
