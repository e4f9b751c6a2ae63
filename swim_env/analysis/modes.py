"""The straight body's natural frequencies, in its fluid and alone."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from swim_env.analysis.kirchhoff import mass_matrix
from swim_env.scene import Scene
from swim_env.sim.simulator import Simulator

__all__ = ["bending_frequencies", "natural_frequencies"]

Array = NDArray[np.float64]


def natural_frequencies(scene: Scene, count: int = 3) -> list[float]:
    """Return the bending frequencies of the straight body in its fluid (Hz), lowest first.

    Parameters
    ----------
    scene : Scene
        The scene; its drive, damping and start do not matter.
    count : int
        How many; fewer come back where there are fewer joints.
    """
    return bending_frequencies(scene, mass_matrix(Simulator(scene)))[:count]


def bending_frequencies(scene: Scene, matrix: Array) -> list[float]:
    """Return all bending frequencies (Hz) of the straight body with this mass matrix."""
    beam = scene.beam
    spring = beam.stiffness_at_joints() / beam.element_length
    bend = np.diff(np.eye(beam.elements), axis=0)
    stiffness = np.zeros_like(matrix)
    stiffness[2:, 2:] = bend.T @ (spring[:, None] * bend)
    squares = eigh(stiffness, matrix, eigvals_only=True)
    # The first three are the rigid motions.
    found = np.sqrt(np.maximum(squares[3:], 0.0)) / (2.0 * math.pi)
    return [float(one) for one in found]
