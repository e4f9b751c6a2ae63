"""The state of a body in space at time zero."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SceneError
from swim_env.scene.block import Block
from swim_env.scene.body import Chain
from swim_env.scene.checks import Triple, one_or_many, vector
from swim_env.scene.spatial.body import AXIS_NAMES, PerJoint, check_per_joint, per_joint

Floats = NDArray[np.float64]

MOST_ROTATION = 0.9 * math.pi
"""Rotations of joints must be below this [rad]."""


def _check_rotations(value: object, field: str) -> PerJoint:
    found: PerJoint = one_or_many(vector("rad", *AXIS_NAMES))(value, field)
    angles = np.atleast_1d(np.linalg.norm(found, axis=-1))
    wrong = np.flatnonzero(~(angles < MOST_ROTATION))
    if wrong.size:
        place = f"{field}[{wrong[0]}]" if isinstance(found[0], tuple) else field
        raise SceneError(
            f"{place} must be a rotation by less than 0.9 pi = {MOST_ROTATION:.6g} rad, got one by "
            f"{angles[wrong[0]]:.6g}"
        )
    return found


@dataclass(frozen=True)
class SpatialInitial(Block, path="initial"):
    """The state at time zero. By default straight along +x, head at the origin, at rest.

    Element 1 has d1 = e_y, d2 = e_z and d3 = e_x, and the others follow from the joints. The start
    moves as one rigid body.

    Attributes
    ----------
    velocity : tuple of float
        Velocity (x, y, z) of the mean of all element centres [m/s].
    spin : tuple of float
        Angular velocity (x, y, z) of the whole body about that mean, in space [rad/s].
    joint_rotations : tuple of float, or tuple of such triples
        Rotation vector (pitch, yaw, roll) of each element relative to the one before it [rad], by
        less than 0.9 pi: one for all joints or one for each of the N - 1.
    """

    velocity: Annotated[Triple, vector("m/s", "x", "y", "z")] = (0.0, 0.0, 0.0)
    spin: Annotated[Triple, vector("rad/s", "x", "y", "z")] = (0.0, 0.0, 0.0)
    joint_rotations: Annotated[PerJoint, _check_rotations] = (0.0, 0.0, 0.0)

    def check_sizes(self, beam: Chain) -> None:
        """Refuse rotations that do not fit the beam's number of joints."""
        check_per_joint(self.joint_rotations, beam, "initial.joint_rotations")

    def rotations(self, beam: Chain) -> Floats:
        """Rotation vectors of the joints [rad], shape (N-1, 3), float64."""
        self.check_sizes(beam)
        return per_joint(self.joint_rotations, beam)
