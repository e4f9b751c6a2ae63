"""The states of one or many bodies in space of one scene, and the kernel calls that move them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SceneError
from swim_env.physics.runtime.references import Referenced
from swim_env.physics.spatial.advance import advance_spatial, spatial_energy, spatial_momentum
from swim_env.physics.spatial.constants import SAMPLE_SPATIAL_SCENE
from swim_env.physics.spatial.invariants import centres_of, directors_of, momentum_map
from swim_env.physics.spatial.layout import RECORD_SIZE, member_views, state_size, work_sizes
from swim_env.physics.spatial.loading import load_spatial_kernels
from swim_env.scene.spatial.initial import SpatialInitial
from swim_env.scene.spatial.scene import SpatialScene
from swim_env.sim.batch import Bodies
from swim_env.sim.recorder import columns_of
from swim_env.sim.spatial.constants import spatial_constants
from swim_env.sim.spatial.trajectory import SpatialTrajectory

Array = NDArray[np.float64]


class SpatialBodies(Bodies):
    """M bodies of one scene in space, see `Bodies` for what is not said here.

    States are coordinates (4 N + 3), momenta (3 N + 3), see `swim_env.physics.spatial.chain`, and
    what the predictor remembers. Velocities are (M, 3 N + 3): of the mean centre (m/s), and angular
    ones of the elements in the axes of space (rad/s). Torques are (M, R, N - 1, 3), records have
    9 columns.
    """

    _advance = staticmethod(advance_spatial)
    _energy_and_velocity = staticmethod(spatial_energy)
    _momentum_of_velocity = staticmethod(spatial_momentum)
    record_columns = RECORD_SIZE

    def __init__(self, scene: SpatialScene, count: int = 1) -> None:
        if scene.dimension != 3:
            found = f"got {scene.name} of dimension {scene.dimension}"
            raise SceneError(f"a simulation in space needs a scene of dimension 3, {found}")
        self.scene = scene
        self._load_kernels()
        elements = scene.beam.elements
        self.coordinates_size, self.unknowns = 4 * elements + 3, 3 * elements + 3
        self.trace_columns = self.coordinates_size + self.unknowns
        self.joint_shape = (elements - 1, 3)
        self._constants = Referenced(spatial_constants(scene), SAMPLE_SPATIAL_SCENE)
        sizes = work_sizes(self._constants.surface)
        self._allocate(count, state_size(elements), sizes)

    def _load_kernels(self) -> None:
        fluid = self.scene.fluid
        load_spatial_kernels(fluid is not None and fluid.model == "panels")

    def views(self, index: int) -> Any:
        """Return the names of one member's state and work space, views of both."""
        state, floats, integers = self.states[index], self._floats[index], self._integers[index]
        return member_views(state, self._constants.surface, floats, integers)[0]

    def _state_at(self, coordinates: Array) -> Array:
        state: Array = np.zeros(self.states.shape[1])
        state[: self.coordinates_size] = coordinates
        return state

    def trajectory(
        self, reason: str, first: int, energy: float, trace: Array, torques: Array, record: Array
    ) -> SpatialTrajectory:
        """Return the run that a trace holds, as `Bodies.trajectory`."""
        scene = self.scene
        q, p = np.split(trace, [self.coordinates_size], axis=1)
        directors, rotations = directors_of(q)
        momentum, impulse = momentum_map(q, p), np.zeros((len(torques), 6))
        if scene.stream is not None:
            # About an origin at rest, a momentum that is carried along gains h U x p.
            drift = scene.integrator.time_step * np.array(scene.stream.velocity)
            impulse[:, 3:] = np.cross(drift, momentum[1:, :3])
        return SpatialTrajectory(
            scene=scene,
            termination_reason=reason,
            centres=centres_of(q[:, :3], directors, scene.beam.element_length),
            directors=directors,
            joint_rotations=rotations,
            torques=torques.copy(),
            momentum=momentum,
            impulse=impulse,
            **columns_of(scene, first, energy, record),
        )


def spatial_start(scene: SpatialScene, initial: SpatialInitial) -> tuple[Array, Array]:
    """Return the minimal coordinates (4 N + 3,) and velocity (3 N + 3,) of an initial state.

    A SceneError says that the initial state does not fit the beam.
    """
    elements = scene.beam.elements
    rotations = initial.rotations(scene.beam)
    q = np.zeros(4 * elements + 3)
    # Element 1 lies along e_x, with d1 = e_y and d2 = e_z.
    q[3:7] = 0.5
    angle = np.linalg.norm(rotations, axis=1)
    joints = q[7:].reshape(-1, 4)
    joints[:, 0] = np.cos(0.5 * angle)
    joints[:, 1:] = 0.5 * np.sinc(0.5 * angle / np.pi)[:, None] * rotations
    directors, _ = directors_of(q)
    # The head is at the origin.
    ahead = centres_of(np.zeros(3), directors, scene.beam.element_length)
    q[:3] = 0.5 * scene.beam.element_length * directors[0, :, 2] - ahead[0]
    return q, np.concatenate([initial.velocity, np.tile(initial.spin, elements)])
