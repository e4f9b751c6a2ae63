"""Elastic moments and energy of a beam in space."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.scene.spatial.scene import SpatialScene

__all__ = ["spatial_elastic_energy", "spatial_moments"]

Array = NDArray[np.float64]


def spatial_moments(scene: SpatialScene, joint_rotations: Array) -> tuple[Array, Array]:
    """Return elastic moments and energies of the joints about (pitch, yaw, roll).

    Parameters
    ----------
    scene : SpatialScene
        The scene; its ``integrator.strain`` says how a rotation strains, see (16) and (17).
    joint_rotations : (..., N - 1, 3) array
        Rotation vectors of the joints (rad).

    Returns
    -------
    moments : (..., N - 1, 3) array
        EI (K - K_0) (N m).
    energies : (..., N - 1, 3) array
        dl EI (K - K_0)^2 / 2 (J).
    """
    beam = scene.beam
    strain = joint_rotations
    if scene.integrator.strain != "joint_angle":
        angle = np.linalg.norm(joint_rotations, axis=-1, keepdims=True)
        strain = np.sinc(angle / np.pi) * joint_rotations
    bend = strain - beam.element_length * beam.natural_curvature_at_joints()
    moments: Array = beam.stiffness_at_joints() / beam.element_length * bend
    return moments, 0.5 * moments * bend


def spatial_elastic_energy(scene: SpatialScene, joint_rotations: Array) -> Array:
    """Return the elastic energy (...) (J) of shapes, see `spatial_moments`."""
    energy: Array = spatial_moments(scene, joint_rotations)[1].sum(axis=(-2, -1))
    return energy
