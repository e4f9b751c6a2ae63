r"""Geometry and constants of the spatial chain of rigid elements.

The minimal coordinates are q = (c, e_1, b_1 ... b_{N-1}): the mean c of the element centres, the
quaternion of element 1, and those of the joints, R_{j+1} = R_j Q_j. Joints are carried rather than
differenced, so the moments of a stiff beam keep their digits, and quaternions are scaled to unit
length after every step, so rotations stay orthonormal to round-off. Increments z = (dc, phi_1 ...
phi_N) turn every element in its own axes, R_k(n+1) = R_k(n) exp(phi_k). Momenta p = (p_c, p_1 ...
p_N) and rates (c', omega_1 ... omega_N) are in the axes of space, where moments between neighbours
are opposite and the angular momentum is a plain sum.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.planar.chain import chain_weight
from swim_env.physics.runtime.compile import kernel
from swim_env.physics.spatial.rotations import (
    matrix_of_quaternion,
    product,
    vector_of_quaternion,
)

Array = NDArray[np.float64]


class SpatialBeam(NamedTuple):
    """Constants of the beam, per element and joint.

    Attributes
    ----------
    elements : int
        Number N of elements.
    element_length : float
        dl (m).
    mass : (N,) array
        dl rho_A of every element (kg).
    inertia : (N, 2) array
        dl rho_I1 and dl rho_I2 (kg m^2), which the rates of d1 and d2 are weighted with (18).
    stiffness, damping : (N - 1, 3) arrays
        EI1/dl, EI2/dl and GJ/dl (N m), and these times the retardation times (N m s).
    rest : (N - 1, 3) array
        dl K0, the natural bend and twist.
    strain_of_angles : bool
        Whether the strain is the joint's mean rotation vector instead of (16) of the averaged
        directors.
    smallest_momentum, smallest_spin : float
        Smallest scale of the residual of a momentum (kg m/s) and an angular one (kg m^2/s).
    """

    elements: int
    element_length: float
    mass: Array
    inertia: Array
    stiffness: Array
    damping: Array
    rest: Array
    strain_of_angles: bool = False
    smallest_momentum: float = 0.0
    smallest_spin: float = 0.0


class Pose(NamedTuple):
    """Directors and joints at q_n.

    Attributes
    ----------
    directors : (N, 3, 3) array
        R_k, with columns d1, d2, d3.
    joints : (N - 1, 3, 3) array
        Q_j = R_j^T R_{j+1}.
    bend : (N - 1, 3) array
        Axial vectors of the skew parts of Q_j: dl K (16).
    angles : (N - 1, 3) array
        Rotation vectors theta_j = log Q_j (rad).
    """

    directors: Array
    joints: Array
    bend: Array
    angles: Array


@kernel
def set_pose(q: Array, pose: Pose) -> None:
    """Compute directors and joints from the minimal coordinates q (4 N + 3,)."""
    matrix_of_quaternion(q[3:7], pose.directors[0])
    for j in range(pose.joints.shape[0]):
        joint = q[7 + 4 * j : 11 + 4 * j]
        matrix_of_quaternion(joint, pose.joints[j])
        for i in range(3):
            pose.bend[j, i] = 2.0 * joint[0] * joint[1 + i]
        vector_of_quaternion(joint, pose.angles[j])
        product(pose.directors[j], pose.joints[j], pose.directors[j + 1])


@kernel
def sum_to_centres(change: Array, shift: Array, dl: float, out: Array) -> None:
    """Apply E to changes of d3 (N, 3) and add a shift of the mean centre (3,) (m).

    out_k = shift + sum_j E_kj change_j, which follows from (15).
    """
    elements = change.shape[0]
    for i in range(3):
        front = 0.0
        for j in range(elements):
            front -= chain_weight(j, elements) * change[j, i]
        for k in range(elements):
            out[k, i] = shift[i] + dl * (front + 0.5 * change[k, i])
            front += change[k, i]


@kernel
def sum_from_centres(push: Array, dl: float, out: Array) -> None:
    """Apply the transpose of E: out_j = sum_k E_kj push_k; both (N, 3)."""
    elements = push.shape[0]
    for i in range(3):
        total = 0.0
        for k in range(elements):
            total += push[k, i]
        behind = 0.0
        for back in range(elements):
            j = elements - 1 - back
            out[j, i] = dl * (behind + 0.5 * push[j, i] - chain_weight(j, elements) * total)
            behind += push[j, i]
