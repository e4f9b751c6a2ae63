r"""The flow around a swimming body: velocity and pressure at points in the fluid.

The panels' source strengths that the added mass is made of give the potential of the whole flow,

.. math:: \phi(x) = \sum_j P_j(x)\, \sigma_j, \qquad G \sigma = B V,

and the unsteady Bernoulli equation gives its pressure (Pa),

.. math:: p = -\rho \left( \partial_t \phi + \tfrac{1}{2} |\nabla \phi|^2 \right),

with the time derivative at a point that is at rest in the fluid far away.

The sources have a sum Q (m^2/s): the elements' motions are imposed on panels of which, at a bent
joint, those of one side are shorter than those of the other, so they push out more on one side than
they take in on the other, although the outline keeps its area. Far away the potential is
:math:`Q / (2 \pi) \ln(r / L)` with the beam's length L, and the pressure is not zero but
:math:`-\rho \dot Q / (2 \pi) \ln(r / L)`: its level depends on L. It is left in, since the added
mass that moves the body is made of the same sources. A rigid body has no such sum. Influences are
those of `swim_env.physics.fluid.sources`, shapes those of `swim_env.physics.fluid.outline`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import OptionError
from swim_env.physics.fluid.layout import motion_count, new_fluid_work
from swim_env.physics.fluid.models import added_mass, fluid_constants, shape_force
from swim_env.physics.fluid.outline import CT, CX, CY, X, Y, panel_count
from swim_env.physics.fluid.sources import (
    LAYERS,
    POTENTIAL,
    VELOCITY_X,
    VELOCITY_Y,
    influence_row,
)
from swim_env.physics.loading import load_kernels
from swim_env.physics.runtime.compile import entry_kernel, kernel
from swim_env.physics.runtime.dense import dot
from swim_env.physics.runtime.references import Referenced
from swim_env.physics.runtime.views import LANES, padded
from swim_env.physics.status import FINE
from swim_env.scene import Scene, require_planar
from swim_env.scene.checks import whole
from swim_env.sim.constants import scene_constants
from swim_env.sim.trajectory import Trajectory

__all__ = ["BodyFlow", "Flow", "flow_of_sources", "pressure_between"]

Array = NDArray[np.float64]

#: Columns of what the kernel writes for every point.
_PHI, _U, _V, _INSIDE = range(4)


@dataclass(frozen=True, eq=False)
class Flow:
    """What the fluid does at P points.

    Attributes
    ----------
    potential : (P,) array
        phi (m^2/s).
    velocity : (P, 2) array
        Velocity (m/s).
    inside : (P,) array of bool
        Which points are inside the body, where the other numbers mean nothing.
    """

    potential: Array
    velocity: Array
    inside: NDArray[np.bool_]


@kernel
def _is_inside(x: float, y: float, count: int, panels: Array) -> bool:
    """Return whether a ray from the point crosses the outline an odd number of times."""
    inside = False
    for j in range(count):
        k = j + 1 if j + 1 < count else 0
        if (panels[Y, j] > y) != (panels[Y, k] > y):
            share = (y - panels[Y, j]) / (panels[Y, k] - panels[Y, j])
            if x < panels[X, j] + share * (panels[X, k] - panels[X, j]):
                inside = not inside
    return inside


@entry_kernel
def _flow_at(
    points: Array,
    count: int,
    panels: Array,
    strengths: Array,
    reference_length: float,
    half_log: Array,
    layers: Array,
    out: Array,
) -> None:
    """Sum the panels' influences at points (P, 2) into out (P, 4).

    The last column of `panels` is no panel: every point in turn is its collocation point.
    """
    last = panels.shape[1] - 1
    inverse_square = 1.0 / (reference_length * reference_length)
    for p in range(points.shape[0]):
        panels[CX, last] = points[p, 0]
        panels[CY, last] = points[p, 1]
        influence_row(last, panels, inverse_square, half_log, layers)
        out[p, _PHI] = dot(layers[POTENTIAL, last], strengths)
        out[p, _U] = dot(layers[VELOCITY_X, last], strengths)
        out[p, _V] = dot(layers[VELOCITY_Y, last], strengths)
        out[p, _INSIDE] = 1.0 if _is_inside(points[p, 0], points[p, 1], count, panels) else 0.0


def flow_of_sources(
    panels: Array, count: int, strengths: Array, points: Array, reference_length: float
) -> Flow:
    """Return the flow of source panels.

    Parameters
    ----------
    panels : (7 or more, M') array
        Rows of an outline, as `swim_env.physics.fluid.sources.influence` takes them.
    count : int
        Number M of panels in it.
    strengths : (M,) array
        Source strengths G^-1 v_n (m/s), where G keeps the factor 2 pi of the influences of
        `swim_env.physics.fluid.sources`.
    points : (P, 2) array
        Positions (m), none of them a corner of the outline.
    reference_length : float
        Length in whose units the logarithm of the potential is taken (m).
    """
    load_kernels()
    size = padded(count)
    laid = np.zeros((len(panels), size + LANES))
    laid[:, :count] = panels[:, :count]
    laid[X, count:], laid[Y, count:] = panels[X, 0], panels[Y, 0]
    laid[CT, count:] = 1.0
    weights = np.zeros(size + LANES)
    weights[:count] = strengths[:count]
    out = np.empty((len(points), 4))
    layers = np.zeros((LAYERS, size + LANES, size + LANES))
    at = np.ascontiguousarray(points, dtype=np.float64)
    half_log = np.empty(size + LANES + 1)
    _flow_at(at, count, laid, weights, reference_length, half_log, layers, out)
    return Flow(out[:, _PHI], out[:, _U : _V + 1], out[:, _INSIDE] > 0.0)


def pressure_between(before: Flow, after: Flow, interval: float, density: float) -> Array:
    """Return the pressure half-way between two instants.

    Parameters
    ----------
    before, after : Flow
        The flow at the same P points of the fluid at rest.
    interval : float
        Time between them (s).
    density : float
        rho (kg/m^3).

    Returns
    -------
    (P,) array
        Pressure (Pa), right to second order in the interval; zero far away where the sources sum to
        zero, else as the module says.
    """
    rate = (after.potential - before.potential) / interval
    velocity = 0.5 * (before.velocity + after.velocity)
    pressure: Array = -density * (rate + 0.5 * (velocity**2).sum(axis=-1))
    return pressure


class BodyFlow:
    """The flow around one scene's body.

    The sources are those of panels on the body's outline, whatever the scene's fluid model: for
    ``panels`` they are the ones that its added mass is made of, for every other model they show
    what the fluid would do around the shapes that the body takes.

    Parameters
    ----------
    scene : Scene
        The scene.

    Raises
    ------
    OptionError
        If the scene has no fluid.
    """

    def __init__(self, scene: Scene) -> None:
        require_planar(scene, "a flow")
        fluid = scene.fluid
        if fluid is None or fluid.density is None:
            raise OptionError(f"scene {scene.name} has no fluid, so there is no flow to show")
        load_kernels()
        self.scene = scene
        self.density = fluid.density
        beam, constants, _ = scene_constants(scene)
        geometry = constants.geometry._replace(side_panels=max(1, fluid.panels_per_element // 2))
        given = fluid_constants("panels", geometry, self.density, axial=constants.axial)
        self._fluid, self._work = Referenced(given), Referenced(new_fluid_work(given))
        size = padded(motion_count(given))
        self._mass = np.zeros((size, size))
        self._length = scene.beam.length
        self._element = beam.element_length
        self._stream = np.array([constants.stream_x, constants.stream_y])

    def at(
        self, points: Array, centre: Array, angles: Array, velocities: Array, turning: Array
    ) -> Flow | None:
        """Return the flow at points, as seen by fluid at rest far away.

        Parameters
        ----------
        points : (P, 2) array
            Positions (m).
        centre : (2,) array
            Mean of the element centres (m).
        angles : (N,) array
            Element angles (rad).
        velocities : (N, 2) array
            Velocities of the element centres (m/s).
        turning : (N,) array
            Turning rates of the elements (rad/s).

        Returns
        -------
        Flow or None
            None if the panels have no solution for this shape.

        Raises
        ------
        OptionError
            If the arrays are those of another number of elements.
        """
        n = self.scene.beam.elements
        shapes = tuple(map(np.shape, (centre, angles, velocities, turning)))
        if shapes != ((2,), (n,), (n, 2), (n,)):
            raise OptionError(
                f"a flow of scene {self.scene.name} takes a centre (2,), angles ({n},), velocities "
                f"({n}, 2) and turning ({n},), got shapes {', '.join(map(str, shapes))}"
            )
        if (
            added_mass(
                np.diff(np.asarray(angles, dtype=np.float64)),
                self._fluid,
                self._work,
                self._mass,
            )
            != FINE
        ):
            return None
        # The shape force itself is not wanted, but the source strengths that it finds.
        motion = self._motion(angles, velocities, turning)
        shape_force(motion, self._fluid, self._work, np.empty(n))
        # The outline is laid out from the first node, along the first element.
        cosine, sine = np.cos(angles[0]), np.sin(angles[0])
        turn = np.array([[cosine, -sine], [sine, cosine]])
        flow = flow_of_sources(
            self._work.outline.panels,
            panel_count(self._fluid.geometry),
            self._work.sigma,
            (points - self._first_node(centre, angles)) @ turn,
            self._length,
        )
        return Flow(flow.potential, flow.velocity @ turn.T, flow.inside)

    def during(self, trajectory: Trajectory, instant: int, points: Array) -> tuple[Flow, Array]:
        """Return velocity and pressure at one of a trajectory's instants.

        The flow is computed half a step before and half a step after, from the velocities of the
        steps themselves; at a trajectory's first and last instant, one step further inside.

        Parameters
        ----------
        trajectory : Trajectory
            A run of at least two steps.
        instant : int
            Index of the instant.
        points : (P, 2) array
            Positions (m).

        Returns
        -------
        flow : Flow
            Mean of both, velocities over ground.
        pressure : (P,) array
            Pressure (Pa).

        Raises
        ------
        OptionError
            If the trajectory has fewer than two steps, is of another body, fluid, stream or time
            step, or has no such instant.
        """
        if trajectory.steps < 2:
            raise OptionError("the flow at an instant takes a trajectory of at least two steps")
        own, other = self.scene, trajectory.scene
        for block in ("beam", "fluid", "axial_added_mass", "stream"):
            if getattr(own, block) != getattr(other, block):
                raise OptionError(
                    f"a flow of scene {own.name} cannot show a trajectory of scene {other.name}: "
                    f"{block} differs"
                )
        if own.integrator.time_step != other.integrator.time_step:
            raise OptionError(
                f"a flow with steps of {own.integrator.time_step:g} s cannot show a trajectory "
                f"with steps of {other.integrator.time_step:g} s"
            )
        if whole(instant) is None or not 0 <= instant <= trajectory.steps:
            raise OptionError(
                f"instant must be 0 to {trajectory.steps} for this trajectory, got {instant}"
            )
        n = min(max(instant, 1), trajectory.steps - 1)
        step = self.scene.integrator.time_step
        found = []
        for first, side in ((n - 1, -0.5), (n, 0.5)):
            angles = trajectory.angles[first : first + 2]
            centres = trajectory.centres[first : first + 2]
            flow = self.at(
                points + side * step * self._stream,
                centres.mean(axis=(0, 1)),
                angles.mean(axis=0),
                np.diff(centres, axis=0)[0] / step - self._stream,
                np.diff(angles, axis=0)[0] / step,
            )
            if flow is None:
                nothing = np.full(len(points), np.nan)
                masked = np.ones(len(points), dtype=np.bool_)
                return Flow(nothing, np.full((len(points), 2), np.nan), masked), nothing
            found.append(flow)
        before, after = found
        mean = Flow(
            0.5 * (before.potential + after.potential),
            0.5 * (before.velocity + after.velocity) + self._stream,
            before.inside | after.inside,
        )
        return mean, pressure_between(before, after, step, self.density)

    def _motion(self, angles: Array, velocities: Array, turning: Array) -> Array:
        """Return the unit motions' velocities V in the order of `added_mass`."""
        cosine, sine = np.cos(angles), np.sin(angles)
        lateral = cosine * velocities[:, 1] - sine * velocities[:, 0]
        parts = [lateral, turning]
        if self._fluid.axial:
            along = cosine * velocities[:, 0] + sine * velocities[:, 1]
            parts.append(along[[0, -1]])
        return np.concatenate(parts)

    def _first_node(self, centre: Array, angles: Array) -> Array:
        arms = self._element * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        middles = np.cumsum(arms, axis=0) - 0.5 * arms
        first: Array = centre - middles.mean(axis=0)
        return first
