"""The flow around a body in space: velocity at points in the fluid.

The source strengths of the panels that the added mass is made of (G sigma = B V) give the velocity
everywhere. A panel's own influence follows from Gauss's law unless the scene says `self_term:
flat`; right at a panel the flow then misses the motion's normal velocity by some percent, on thin
bodies by more, which is the price of every panel sending its exact share out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import OptionError
from swim_env.physics.runtime.references import Referenced
from swim_env.physics.spatial.loading import load_panel_kernels
from swim_env.physics.spatial.panels.influence import KEPT, NORMAL, POINT_ROWS, influence
from swim_env.physics.spatial.panels.mass import MOTIONS, new_panel_work, panel_mass
from swim_env.physics.status import FINE
from swim_env.scene.checks import whole
from swim_env.scene.spatial.fluid import SPATIAL_FLUID_TABLE
from swim_env.scene.spatial.scene import SpatialScene
from swim_env.sim.spatial.constants import surface_of
from swim_env.sim.spatial.trajectory import SpatialTrajectory

__all__ = ["SpatialBodyFlow", "has_panels"]

Array = NDArray[np.float64]

#: Points are taken in multiples of this, see `influence`.
_LANES = 8


def has_panels(scene: SpatialScene) -> bool:
    """Return whether a scene's fluid is made of source panels, whose flow is known."""
    return scene.fluid is not None and SPATIAL_FLUID_TABLE[scene.fluid.model].panels


class SpatialBodyFlow:
    """The flow around one scene's body.

    For ``panels`` it is the flow that the added mass is made of, for ``frozen`` what the same
    panels would do around the shapes that the body takes.

    Parameters
    ----------
    scene : SpatialScene
        The scene.

    Raises
    ------
    OptionError
        If the scene has no panels.
    """

    def __init__(self, scene: SpatialScene) -> None:
        if not has_panels(scene):
            model = "no fluid" if scene.fluid is None else f"fluid.model {scene.fluid.model}"
            raise OptionError(
                f"a flow needs fluid.model panels or frozen, scene {scene.name} has {model}"
            )
        load_panel_kernels()
        self.scene = scene
        self._stream = np.array(scene.stream.velocity) if scene.stream else np.zeros(3)
        surface = surface_of(scene)
        self._surface, self._work = Referenced(surface), Referenced(new_panel_work(surface))
        size = MOTIONS * scene.beam.elements
        self._mass = np.zeros((size, size))

    def at(
        self, points: Array, centre: Array, directors: Array, velocities: Array, spins: Array
    ) -> Array | None:
        """Return the velocity of fluid that is at rest far away, at points, (P, 3) (m/s).

        Parameters
        ----------
        points : (P, 3) array
            Positions (m).
        centre : (3,) array
            Mean of the element centres (m).
        directors : (N, 3, 3) array
            R_k of every element, with columns d1, d2, d3.
        velocities, spins : (N, 3) arrays
            Velocities of the element centres (m/s) and angular velocities of the elements (rad/s),
            both in the axes of space.

        Returns
        -------
        (P, 3) array or None
            None if the panels have no solution for this shape. Inside of the body it means nothing.
        """
        turns = np.ascontiguousarray(directors, dtype=np.float64)
        if panel_mass(turns, self._surface, self._work, self._mass) != FINE:
            return None
        in_frames = [np.einsum("kij,ki->kj", turns, moving) for moving in (velocities, spins)]
        motion = np.concatenate(in_frames, axis=1).ravel()
        count = len(self._surface.faces)
        strengths = motion @ self._work.strengths[: len(motion), :count]
        # The panels' own columns come first: `influence` writes their self terms there.
        columns = count + len(points)
        columns += -columns % _LANES
        seen = np.zeros((POINT_ROWS, columns))
        seen[:3, count : count + len(points)] = (points - centre).T
        normal, potential = np.zeros((2, count, columns))
        kept = np.empty((KEPT, 1, columns))
        found = np.empty((len(points), 3))
        for axis in range(3):
            seen[NORMAL : NORMAL + 3] = np.eye(3)[axis][:, None]
            influence(seen, self._work.sources, count, False, normal, potential, kept)
            found[:, axis] = (strengths @ normal)[count : count + len(points)]
        return found

    def during(self, trajectory: SpatialTrajectory, instant: int, points: Array) -> Array | None:
        """Return the velocity over ground of the fluid at points at one of a trajectory's instants.

        The body's velocities are central differences, at the first and the last instant those over
        the step beside it.

        Parameters
        ----------
        trajectory : SpatialTrajectory
            A run of at least one step of this scene's body.
        instant : int
            Index of the instant.
        points : (P, 3) array
            Positions (m).

        Returns
        -------
        (P, 3) array or None
            As `at`.

        Raises
        ------
        OptionError
            If the trajectory has no step, is of another body, fluid or stream, or has no such
            instant.
        """
        own, other = self.scene, trajectory.scene
        if trajectory.steps < 1:
            raise OptionError("the flow at an instant takes a trajectory of at least one step")
        for block in ("beam", "fluid", "stream"):
            if getattr(own, block) != getattr(other, block):
                raise OptionError(
                    f"a flow of scene {own.name} cannot show a trajectory of scene {other.name}: "
                    f"{block} differs"
                )
        if whole(instant) is None or not 0 <= instant <= trajectory.steps:
            raise OptionError(
                f"instant must be 0 to {trajectory.steps} for this trajectory, got {instant}"
            )
        a, b = max(instant - 1, 0), min(instant + 1, trajectory.steps)
        interval = (b - a) * other.integrator.time_step
        velocities = (trajectory.centres[b] - trajectory.centres[a]) / interval - self._stream
        turns = trajectory.directors[b] @ np.swapaxes(trajectory.directors[a], 1, 2)
        spins = _rotation_vectors(turns) / interval
        centre = trajectory.centres[instant].mean(axis=0)
        found = self.at(points, centre, trajectory.directors[instant], velocities, spins)
        return None if found is None else found + self._stream

    def inside(
        self, points: Array, centres: Array, directors: Array, margin: float = 0.0
    ) -> NDArray[np.bool_]:
        """Return which points are in the body, or no further from it than about a margin, (P,).

        Parameters
        ----------
        points : (P, 3) array
            Positions (m).
        centres, directors : (N, 3), (N, 3, 3) arrays
            The shape.
        margin : float
            By how much sections and ends are enlarged (m).
        """
        beam = self.scene.beam
        local = np.einsum("pki,kij->pkj", points[:, None] - centres, directors)
        half = 0.5 * beam.element_length
        # On the outer side of a bend a point is beside no element: the nearest one is meant.
        beyond = local[..., 2] - np.clip(local[..., 2], -half, half)
        nearest = np.hypot(np.hypot(local[..., 0], local[..., 1]), beyond).argmin(axis=1)
        rows = np.arange(len(points))
        across, along = local[rows, nearest, :2], local[rows, nearest, 2]
        s = (nearest + 0.5) * beam.element_length + along
        at = np.clip(s, 0.0, beam.length)
        with np.errstate(divide="ignore", invalid="ignore"):
            x = across[:, 0] / (beam.half_width_at(at) + margin)
            y = across[:, 1] / (beam.half_height_at(at) + margin)
        found: NDArray[np.bool_] = (
            (x**2 + y**2 <= 1.0) & (s >= -margin) & (s <= beam.length + margin)
        )
        return found


def _rotation_vectors(turns: Array) -> Array:
    """Return the rotation vectors (N, 3) of rotations (N, 3, 3) by less than a quarter turn."""
    skew = 0.5 * (turns - np.swapaxes(turns, 1, 2))
    sines = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=-1)
    size = np.linalg.norm(sines, axis=-1, keepdims=True)
    angle = np.arcsin(np.minimum(size, 1.0))
    vectors: Array = np.divide(angle, size, out=np.ones_like(size), where=size > 0.0) * sines
    return vectors
