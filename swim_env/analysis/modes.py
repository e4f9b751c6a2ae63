"""The straight body's mass matrix and natural frequencies, in its fluid and alone."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import OptionError
from swim_env.scene import AXIS_NAMES, Scene
from swim_env.sim.simulator import Simulator

__all__ = [
    "MODE_NAMES",
    "bending_frequencies",
    "driven_axis",
    "mass_matrix",
    "mode_frequencies",
    "natural_frequencies",
]

Array = NDArray[np.float64]

MODE_NAMES: dict[str, str] = {"pitch": "dorsoventral", "yaw": "lateral", "roll": "torsion"}
"""What modes are called, by the axis that joints turn about."""


#: Frequencies of a round body that differ by such a share are the same.
_ALIKE = 1e-9


def natural_frequencies(
    scene: Scene, count: int = 3, axes: Sequence[str] | None = None
) -> list[float]:
    """Return the natural frequencies (Hz) of the straight body in its fluid, lowest first.

    They solve the generalised eigenvalue problem K x = omega^2 M x of the straight, undamped
    discrete body, linearised: K has the stiffness EI/dl of (33) at every joint, M is the mass of
    body and fluid, with the added mass of the scene's fluid model (none in a scene without a
    fluid). The three rigid motions, in space six, of frequency zero, are left out. With more
    elements the lowest ones tend, at second order in 1/N, to those of a free-free Euler-Bernoulli
    beam with added mass. In space they are those of bending about either axis and of torsion; the
    straight body has two planes of symmetry, so its modes are each about one axis.

    Parameters
    ----------
    scene : Scene
        The scene; its drive, damping, stream and start do not matter.
    count : int
        How many, at least 1; a body of N elements has N - 1, in space N - 1 about each axis.
    axes : sequence of str, optional
        In space, the axes whose modes are wanted, of `swim_env.scene.AXIS_NAMES`; all of them
        unless given.

    Raises
    ------
    OptionError
        If the count is not a positive number.

    Examples
    --------
    >>> [round(f, 1) for f in swim_env.natural_frequencies(swim_env.load_scene("paper_i"), 2)]
    [5.1, 15.7]
    """
    if not count >= 1:
        raise OptionError(f"count must be at least 1, got {count!r}")
    at_rest = scene.replace("initial", {})
    if at_rest.stream is not None:
        at_rest = at_rest.replace("stream", None)
    matrix = mass_matrix(Simulator(at_rest))
    if axes is None or at_rest.dimension == 2:
        return bending_frequencies(at_rest, matrix)[:count]
    found = mode_frequencies(at_rest, matrix)
    return sorted(one for axis in axes for one in found[axis])[:count]


def driven_axis(scene: Scene) -> str:
    """Return the axis whose first mode is the period T1 of a scene: yaw in the plane.

    In space it is that of the actuated bending axes, yaw and pitch, whose first mode is the lowest:
    the body bends easily that way, so it is what torques excite and what swims. Roll is it only
    where nothing else is actuated. Passive bodies have the lateral mode, as `Scene.axes` says.
    """
    bending = [axis for axis in scene.axes if axis != "roll"]
    if len(bending) < 2:
        return (*bending, "roll")[0]
    yaw, pitch = (natural_frequencies(scene, 1, (axis,))[0] for axis in ("yaw", "pitch"))
    return "pitch" if pitch < (1.0 - _ALIKE) * yaw else "yaw"


def mass_matrix(simulator: Simulator) -> Array:
    """Return the mass matrix of a simulator's straight body, with the fluid's added mass.

    Parameters
    ----------
    simulator : Simulator
        It is reset to its scene's start.

    Returns
    -------
    (N + 2, N + 2) array, in space (3 N + 3, 3 N + 3)
        Momenta (kg m/s, kg m^2/s) of unit velocities (m/s, rad/s), in the order of
        `Simulator.velocity`.
    """
    simulator.reset()
    straight, still = simulator.coordinates, np.zeros_like(simulator.velocity())
    if simulator.scene.dimension == 2:
        straight[:] = 0.0

    def momentum(velocity: Array) -> Array:
        simulator.reset_to(straight, velocity)
        state = np.frombuffer(simulator.snapshot().state)
        return state[straight.size : straight.size + still.size]

    # In a stream a body at rest has momentum: momenta are those relative to the stream.
    at_rest = momentum(still)
    matrix: Array = np.array([momentum(unit) - at_rest for unit in np.eye(still.size)])
    simulator.reset()
    symmetric: Array = 0.5 * (matrix + matrix.T)
    return symmetric


def bending_frequencies(scene: Scene, matrix: Array) -> list[float]:
    """Return all frequencies (Hz) of the straight body with this `mass_matrix`."""
    beam = scene.beam
    spring = beam.stiffness_at_joints() / beam.element_length
    # The change of joint angles by rates of the elements; in space axis by axis, all in the axes of
    # the straight body, whose joints count (pitch, yaw, roll) = (y, z, x).
    bend: Array = np.diff(np.eye(beam.elements), axis=0)
    if scene.dimension == 3:
        bend = np.asarray(np.kron(bend, np.eye(3)[[1, 2, 0]]))
    return _frequencies(matrix, bend, spring.ravel(), scene.dimension)


def mode_frequencies(scene: Scene, matrix: Array) -> dict[str, list[float]]:
    """Return the frequencies (Hz) about each axis of a body in space with this `mass_matrix`.

    Joints turn about that axis alone, which the straight body's modes do by symmetry. A ``given``
    added mass may couple the axes; then these are modes with the other axes held.
    """
    beam = scene.beam
    spring = beam.stiffness_at_joints() / beam.element_length
    bend: Array = np.diff(np.eye(beam.elements), axis=0)
    found = {}
    for number, axis in enumerate(AXIS_NAMES):
        turns = 3 + (number + 1) % 3 + 3 * np.arange(beam.elements)  # (y, z, x) again
        kept = np.concatenate([np.arange(3), turns])
        found[axis] = _frequencies(matrix[np.ix_(kept, kept)], bend, spring[:, number], 3)
    return found


def _frequencies(matrix: Array, bend: Array, spring: Array, dimension: int) -> list[float]:
    """Return all but the rigid frequencies (Hz) of coordinates: a velocity and the turning rates.

    `bend` (n, m) takes the m rates to those of n joints with the stiffnesses `spring` (n,).
    """
    # SciPy takes longer to load than the rest of the package.
    from scipy.linalg import eigh

    stiffness = np.zeros_like(matrix)
    turns = slice(dimension, None)
    stiffness[turns, turns] = bend.T @ (spring[:, None] * bend)
    squares = eigh(stiffness, matrix, eigvals_only=True)
    rigid = len(matrix) - len(bend)
    found = np.sqrt(np.maximum(squares[rigid:], 0.0)) / (2.0 * math.pi)
    return [float(one) for one in found]
