"""What the environments of one dimension must have of their own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.envs.assessment import VELOCITY_SCALE
from swim_env.scene import Scene

if TYPE_CHECKING:
    from swim_env.envs.tasks.moment import Moment

Array = NDArray[np.float64]


class StartPlan(NamedTuple):
    """A start without its noise, made of the checked options of a reset.

    Coordinates and velocity are as in `swim_env.envs.tasks.Start`, before noise, which has a
    factor; `exact` are the fields of the initial state that the options gave, `initial` is that
    state, and the goal is None unless the options gave one.
    """

    coordinates: Array
    velocity: Array
    noise: float
    exact: frozenset[str]
    initial: Any
    goal: Array | None


class Geometry:
    """The scenes of one dimension, as environments see them.

    Attributes
    ----------
    start_fields : tuple of str
        Fields of a scene's initial state, which `reset` takes as options.
    joint_shape : tuple of int
        Shape of the torques of one member.
    part_sizes : dict of str to int
        Sizes of the standard parts of an observation, in order; without the distance from a point.
    kept : int
        How many numbers `assess` keeps of a member from one evaluation to the next; the first of
        them are the coordinates.
    assess : callable
        The kernel; see `swim_env.envs.assessment.assess`.
    moment : type of Moment
        What a task's methods see.
    """

    start_fields: ClassVar[tuple[str, ...]]
    assess: Any
    joint_shape: tuple[int, ...]
    part_sizes: dict[str, int]
    kept: int
    moment: type[Moment]

    def __init__(self, scene: Scene) -> None:
        self.scene = scene

    @property
    def velocity_noise(self) -> float:
        """By how much the components of a start's velocity are off (m/s)."""
        noise = self.scene.episode.velocity_noise
        if noise is not None:
            return noise
        interval = self.scene.episode.control_interval
        return 1e-4 * (VELOCITY_SCALE / interval * self.scene.beam.length)

    @property
    def stream(self) -> Array:
        """Velocity of the fluid far away, (D,) (m/s)."""
        flow = self.scene.stream
        return np.array(flow.velocity if flow else (0.0,) * self.scene.dimension)

    def load(self) -> None:
        """Load the kernels, which must be done before any of them is called."""
        raise NotImplementedError

    def bodies(self, count: int) -> Any:
        """Return so many bodies."""
        raise NotImplementedError

    def start(self, initial: Any) -> tuple[Array, Array]:
        """Return coordinates and velocity of an initial state; it may be a SceneError."""
        raise NotImplementedError

    def draw_noise(self, random: np.random.Generator, share: float) -> Mapping[str, Any]:
        """Draw a start's noise, all of it whatever of it is used."""
        raise NotImplementedError

    def disturbed(self, plan: StartPlan, noise: Mapping[str, Any]) -> tuple[Array, Array]:
        """Return coordinates and velocity of a planned start with its noise."""
        raise NotImplementedError

    def direction_at(self, angle: float, around: float = 0.0) -> Array:
        """Return the direction (D,) at an angle (rad) from the scene's heading.

        In the plane the angle is counter-clockwise and `around` does not matter. In space it is the
        angle (rad) about the heading, from left (0) to up (a quarter turn).
        """
        raise NotImplementedError


def geometry_of(scene: Scene) -> Geometry:
    """Return the geometry of a scene; that of the other dimension is not imported."""
    if scene.dimension == 2:
        from swim_env.envs.geometry.planar import PlanarGeometry

        return PlanarGeometry(scene)
    from swim_env.envs.geometry.spatial import SpatialGeometry

    return SpatialGeometry(scene)
