"""The simulator of one beam in space."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.errors import OptionError, SwimError
from swim_env.physics.spatial.invariants import centres_of, directors_of, momentum_map
from swim_env.scene.spatial.scene import SpatialScene
from swim_env.sim.simulator import Simulator
from swim_env.sim.spatial.bodies import SpatialBodies, spatial_start

Array = NDArray[np.float64]

#: How far a quaternion of a start may be from unit length.
_UNIT = 1e-9


class SpatialSimulator(Simulator):
    """Steps one scene in space through time; `Simulator` makes it of a scene of dimension 3.

    Calls are those of `Simulator`. Joint torques have an axis more, (N - 1, 3): about (pitch, yaw,
    roll), conjugate to the joints' rotation vectors, whether a scene's actuation has the axis or
    not. Coordinates and velocities are those of `swim_env.physics.spatial.chain`, 4 N + 3 and
    3 N + 3 numbers.
    """

    scene: SpatialScene

    def _make_bodies(self) -> Any:
        return SpatialBodies(self.scene)

    def _start(self, initial: Any) -> tuple[Array, Array]:
        return spatial_start(self.scene, initial)

    def reset_to(self, coordinates: ArrayLike, velocity: ArrayLike) -> None:
        """Go to a start as `Simulator.reset_to`; its quaternions must have unit length.

        The velocity is that of the mean centre (m/s) and the angular velocity of every element
        (rad/s), in the axes of space.
        """
        quaternions = np.array(coordinates, dtype=np.float64)[3:]
        if quaternions.size == 4 * self.elements:
            lengths = np.linalg.norm(quaternions.reshape(-1, 4), axis=1)
            if (np.abs(lengths - 1.0) > _UNIT).any():
                raise SwimError(
                    f"the quaternions of coordinates must have unit length, got {lengths.tolist()}"
                )
        super().reset_to(coordinates, velocity)

    @property
    def directors(self) -> Array:
        """Directors of the elements, (N, 3, 3), with columns d1, d2 and d3 (head to tail)."""
        return directors_of(self.coordinates)[0]

    @property
    def joint_rotations(self) -> Array:
        """Rotation vectors of the joints (pitch, yaw, roll), (N - 1, 3) (rad)."""
        return directors_of(self.coordinates)[1]

    @property
    def centres(self) -> Array:
        """Element centres r^k, (N, 3) (m)."""
        return centres_of(self._state[:3], self.directors, self.scene.beam.element_length)

    @property
    def angles(self) -> Array:
        """Bodies in space have no angles; see `directors` and `joint_rotations`."""
        raise AttributeError("a simulator in space has directors and joint_rotations, no angles")

    @property
    def joint_angles(self) -> Array:
        """Bodies in space have no joint angles; see `joint_rotations`."""
        raise AttributeError("a simulator in space has joint_rotations, no joint_angles")

    def momentum(self) -> Array:
        """Return total linear and angular momentum (6,) of body and fluid.

        Returns
        -------
        (6,) array
            (px, py, pz) in kg m/s and the angular momentum about the origin in kg m^2/s: the
            discrete momentum map at q_n with the carried p_n.
        """
        return momentum_map(self._bodies.coordinates[0], self._bodies.momenta[0])

    def panel_condition(self) -> float:
        """Not known in space (OptionError)."""
        raise OptionError("the condition of panels is known in the plane only")
