r"""The elastic law: strain (16), energy (17), their derivatives in a step, torques and damping.

The moment of a joint follows from its strain at the middle of a step. In the paper's scheme the
*directors* are averaged: with delta the turns of the elements in front and behind and a the mean
joint angle,

.. math:: K\, dl = \cos(\delta_{front}/2) \cos(\delta_{back}/2) \sin a.

The other strains leave the cosines of the turns out, and the linear one is a itself.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.planar.chain import BeamConstants
from swim_env.physics.planar.layout import Increment, Pose
from swim_env.physics.runtime.compile import inlined, kernel, row_kernel

Array = NDArray[np.float64]


@kernel
def linearise_joints(q: Array, pose: Pose) -> None:
    """Put the joint angle and its slope, 1, in the place of its sine and cosine."""
    for j in range(q.size - 3):
        pose.joint_sine[j] = q[3 + j]
        pose.joint_cosine[j] = 1.0


@kernel
def linearise_mean_joints(z: Array, pose: Pose, inc: Increment) -> None:
    """Do the same for the mean joint angles of a step with increment z (N + 2,)."""
    for j in range(z.size - 3):
        inc.mean_sine[j] = pose.joint_sine[j] + 0.5 * z[3 + j]
        inc.mean_cosine[j] = 1.0


@kernel
def with_elastic_energy(energy: float, beam: BeamConstants, pose: Pose) -> float:
    """Return an energy and W = dl/2 sum EI K^2 (17), (33) of a pose with it (J)."""
    for j in range(beam.joint_stiffness.size):
        sine = pose.joint_sine[j]
        energy += 0.5 * beam.joint_stiffness[j] * sine * sine
    return energy


@kernel
def _shortening(
    j: int, strain_of_angles: bool, half_cosine: Array, half_sine: Array
) -> tuple[float, float, float, float]:
    """Return cosines of half the turns in front of and behind a joint, and their sines.

    Averages of directors that turn are shorter than 1 by these cosines. The strains of angles do
    not know of turns.
    """
    if strain_of_angles:
        return 1.0, 1.0, 0.0, 0.0
    return half_cosine[j], half_cosine[j + 1], half_sine[j], half_sine[j + 1]


@row_kernel
def joint_terms(
    h: float,
    torques: Array,
    z: Array,
    beam: BeamConstants,
    inc: Increment,
    front: Array,
    back: Array,
    both: Array,
    bending: Array,
    torque: Array,
    effort: Array,
) -> None:
    """Write what elasticity, held torques and Kelvin-Voigt damping do in a step.

    It is differentiated h W(K(q_{n+1/2})), and the impulses of the others. The last six are the
    rows of `Balance.joints`, from the first joint on.
    """
    for j in range(torques.size):
        sine = inc.mean_sine[j]
        cosine = inc.mean_cosine[j]
        front_cosine, back_cosine, front_sine, back_sine = _shortening(
            j, beam.strain_of_angles, inc.half_cosine, inc.half_sine
        )
        moment = h * beam.joint_stiffness[j] * front_cosine * back_cosine * sine
        straight = 0.5 * front_cosine * back_cosine * cosine
        front[j] = moment * (-straight + 0.5 * front_sine * back_cosine * sine)
        back[j] = moment * (straight + 0.5 * back_sine * front_cosine * sine)
        both[j] = 2.0 * moment * straight
        bending[j] = abs(moment)
        torque[j] = h * torques[j] - beam.joint_damping[j] * z[3 + j]
        effort[j] = h * abs(torques[j]) + beam.joint_damping[j] * abs(z[3 + j])


@inlined
def add_turn_columns(h: float, beam: BeamConstants, inc: Increment, transposed: Array) -> None:
    """Add the derivatives by the elements' turns: those of the factors cos(delta/2) of the strain.

    `transposed` has a row for every unknown, the elements' turns from row 2 on.
    """
    if beam.strain_of_angles:
        return
    for j in range(beam.joint_stiffness.size):
        sine = inc.mean_sine[j]
        cosine = inc.mean_cosine[j]
        front = inc.half_cosine[j]
        back = inc.half_cosine[j + 1]
        front_sine = inc.half_sine[j]
        back_sine = inc.half_sine[j + 1]
        stiffness = h * beam.joint_stiffness[j]
        strain = front * back * sine
        row_front = 0.5 * (-front * back * cosine + front_sine * back * sine)
        row_back = 0.5 * (front * back * cosine + back_sine * front * sine)
        # By the turn of the element in front.
        strain_change = -0.5 * front_sine * back * sine
        transposed[2 + j, 2 + j] += stiffness * (
            strain_change * row_front
            + strain * 0.25 * (front_sine * back * cosine + front * back * sine)
        )
        transposed[2 + j, 3 + j] += stiffness * (
            strain_change * row_back
            - strain * 0.25 * (front_sine * back * cosine + front_sine * back_sine * sine)
        )
        # By the turn of the element behind.
        strain_change = -0.5 * back_sine * front * sine
        transposed[3 + j, 2 + j] += stiffness * (
            strain_change * row_front
            + strain * 0.25 * (front * back_sine * cosine - front_sine * back_sine * sine)
        )
        transposed[3 + j, 3 + j] += stiffness * (
            strain_change * row_back
            + strain * 0.25 * (-front * back_sine * cosine + front * back * sine)
        )


@inlined
def add_joint_columns(h: float, beam: BeamConstants, inc: Increment, jacobian: Array) -> None:
    """Add the derivatives of moments and damping by the joint angles to Newton's matrix."""
    for j in range(beam.joint_stiffness.size):
        sine = inc.mean_sine[j]
        cosine = inc.mean_cosine[j]
        front, back, front_sine, back_sine = _shortening(
            j, beam.strain_of_angles, inc.half_cosine, inc.half_sine
        )
        stiffness = h * beam.joint_stiffness[j]
        strain = front * back * sine
        slope = front * back * cosine
        row_front = 0.5 * (-slope + front_sine * back * sine)
        row_back = 0.5 * (slope + back_sine * front * sine)
        front_change = 0.5 * (strain + front_sine * back * cosine)
        back_change = 0.5 * (-strain + back_sine * front * cosine)
        damping = 0.5 * beam.joint_damping[j]
        jacobian[2 + j, 3 + j] += (
            0.5 * stiffness * (slope * row_front + strain * front_change) - damping
        )
        jacobian[3 + j, 3 + j] += (
            0.5 * stiffness * (slope * row_back + strain * back_change) + damping
        )
    if beam.linear_strain:
        _straighten_columns(0.25 * h, beam, inc.mean_sine, jacobian)


@kernel
def _straighten_columns(
    quarter: float, beam: BeamConstants, strain: Array, jacobian: Array
) -> None:
    """Take the curvature of the sine, which a strain linear in the angle lacks, from the matrix.

    `quarter` is a quarter of the step (s), `strain` (N - 1,) that of the joints.
    """
    for j in range(beam.joint_stiffness.size):
        change = quarter * beam.joint_stiffness[j] * strain[j] * strain[j]
        jacobian[2 + j, 3 + j] -= change
        jacobian[3 + j, 3 + j] += change


@inlined
def add_pose_softening(h: float, beam: BeamConstants, pose: Pose, jacobian: Array) -> None:
    """Add the softening of averaged directors where either element turns."""
    if beam.strain_of_angles:
        return
    for j in range(beam.joint_stiffness.size):
        sine = pose.joint_sine[j]
        softening = 0.25 * h * beam.joint_stiffness[j] * sine * sine
        jacobian[2 + j, 2 + j] += softening
        jacobian[3 + j, 3 + j] += softening


@inlined
def add_pose_springs(h: float, beam: BeamConstants, pose: Pose, jacobian: Array) -> None:
    """Add the springs and dampers of the joints at a vanishing increment."""
    for j in range(beam.joint_stiffness.size):
        sine = pose.joint_sine[j]
        cosine = pose.joint_cosine[j]
        spring = 0.25 * h * beam.joint_stiffness[j] * (cosine * cosine - sine * sine)
        spring += 0.5 * beam.joint_damping[j]
        jacobian[2 + j, 3 + j] -= spring
        jacobian[3 + j, 3 + j] += spring
    if beam.linear_strain:
        _straighten_columns(0.25 * h, beam, pose.joint_sine, jacobian)
