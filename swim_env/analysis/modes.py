"""The straight body's mass matrix and natural frequencies, in its fluid and alone."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import OptionError
from swim_env.scene import Scene
from swim_env.sim.simulator import Simulator

__all__ = ["bending_frequencies", "mass_matrix", "natural_frequencies"]

Array = NDArray[np.float64]


def natural_frequencies(scene: Scene, count: int = 3) -> list[float]:
    """Return the natural frequencies (Hz) of the straight body in its fluid, lowest first.

    They solve the generalised eigenvalue problem K x = omega^2 M x of the straight, undamped
    discrete body, linearised: K has the stiffness EI/dl of (33) at every joint, M is the mass of
    body and fluid, with the added mass of the scene's fluid model (none in a scene without a
    fluid). The three rigid motions, in space six, of frequency zero, are left out. With more
    elements the lowest ones tend, at second order in 1/N, to those of a free-free Euler-Bernoulli
    beam with added mass. In space they are those of bending about either axis and of torsion.

    Parameters
    ----------
    scene : Scene
        The scene; its drive, damping, stream and start do not matter.
    count : int
        How many, at least 1; a body of N elements has N - 1, in space 3 (N - 1).

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
    return bending_frequencies(at_rest, mass_matrix(Simulator(at_rest)))[:count]


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
    # SciPy takes longer to load than the rest of the package.
    from scipy.linalg import eigh

    beam = scene.beam
    spring = beam.stiffness_at_joints() / beam.element_length
    # The change of joint angles by rates of the elements; in space axis by axis, all in the axes of
    # the straight body, whose joints count (pitch, yaw, roll) = (y, z, x).
    bend: Array = np.diff(np.eye(beam.elements), axis=0)
    rigid = 3 * scene.dimension - 3
    if scene.dimension == 3:
        bend = np.asarray(np.kron(bend, np.eye(3)[[1, 2, 0]]))
    stiffness = np.zeros_like(matrix)
    turns = slice(scene.dimension, None)
    stiffness[turns, turns] = bend.T @ (spring.reshape(-1, 1) * bend)
    squares = eigh(stiffness, matrix, eigvals_only=True)
    found = np.sqrt(np.maximum(squares[rigid:], 0.0)) / (2.0 * math.pi)
    return [float(one) for one in found]
