r"""The same equations in continuous time, solved by SciPy: what the integrators are compared with.

With L = T - W, T the kinetic energy of body and fluid in the frame of the stream,

.. math::
    \dot q = M(q)^{-1} p, \qquad
    \dot p_{\theta_j} = - f_{v,j}\, d_3^j \cdot \dot r^j + f_{a,j}\, d_1^j \cdot \dot r^j
        - \dot\theta_j\, d_3^j \cdot \sum_k E_{kj} P^k
        + \tfrac{1}{2} V^T \frac{\partial A}{\partial\theta_j} V
        - \frac{\partial W}{\partial\theta_j} + F_j,

with the names of `swim_env.physics.planar.equations`, of whose step this is the limit. These
solvers know nothing of momentum and energy, and resolve the fastest mode or damp it.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SimulationEndedError, SwimError
from swim_env.physics.fluid.layout import motion_count
from swim_env.physics.fluid.models import shape_force
from swim_env.physics.runtime.references import Referenced
from swim_env.scene import Scene
from swim_env.sim.batch import Bodies, minimal_start
from swim_env.sim.constants import momentum_units, scene_constants
from swim_env.sim.replay import steps_of

__all__ = ["METHODS", "ContinuousRun", "integrate"]

Array = NDArray[np.float64]

#: SciPy's solvers that `integrate` takes.
METHODS = ("RK45", "DOP853", "Radau", "BDF", "LSODA")


@dataclass(frozen=True, eq=False)
class ContinuousRun:
    """A solution at T + 1 instants.

    Attributes
    ----------
    time : (T + 1,) array
        Instants (s).
    coordinates, momenta : (T + 1, N + 2) arrays
        As the kernels carry them: mean centre, angle of element 1 and joint angles; momentum, and
        angular momentum of every element.
    energy : (T + 1,) array
        H (J).
    evaluations : int
        Evaluations of the right-hand side, each with the added mass and its gradient; those for the
        Jacobians of implicit solvers as well.
    seconds : float
        Wall time of the solver (s).
    """

    time: Array
    coordinates: Array
    momenta: Array
    energy: Array
    evaluations: int
    seconds: float

    @property
    def path(self) -> Array:
        """Path of the mean element centre, (T + 1, 2) (m)."""
        return self.coordinates[:, :2]


class _Equations:
    """The right-hand side for one scene."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.bodies = Bodies(scene)
        #: SciPy's own count leaves out Jacobians.
        self.evaluations = 0
        #: Why trials of the solver had no velocity.
        self.refusals: list[SimulationEndedError] = []
        self._beam, self._fluid, _ = scene_constants(scene)
        self._levers = _levers(self._beam.elements, self._beam.element_length)
        self._views = self.bodies.views(0)
        self._given = Referenced(self._fluid), Referenced(self._views.fluid_work)
        self._motions = int(motion_count(self._fluid))
        self._drag_places = np.array([-1.0, 1.0]) * self._beam.element_length / np.sqrt(12.0)

    def start(self) -> Array:
        """Return coordinates and momenta at time zero."""
        self.bodies.start(0, *minimal_start(self.scene, self.scene.initial))
        n = self.bodies.unknowns
        return self.bodies.states[0, : 2 * n].copy()

    def energy_and_velocity(self, time: float, state: Array) -> tuple[float, Array]:
        """Return the energy (J) and the velocities, in the frame of the ground."""
        self.bodies.move_to(0, *np.split(state, 2))
        # The place does not matter, and implicit solvers try remote ones for that very reason: as
        # nothing changes, they look for a derivative by ever larger differences.
        self.bodies.states[0, :2] = 0.0
        return self.bodies.energy_and_velocity(0, time)

    def __call__(self, time: float, state: Array) -> Array:
        """Return the rates; not numbers where a trial of the solver goes where there are none."""
        self.evaluations += 1
        n = self.bodies.unknowns
        q, p = state[:n], state[n:]
        try:
            _, ground = self.energy_and_velocity(time, state)
        except SimulationEndedError as error:
            if np.isfinite(state).all():
                self.refusals.append(error)
            return np.full_like(state, np.nan)
        rates = ground.copy()
        rates[3:] = np.diff(ground[2:])
        stream = np.array([self._fluid.stream_x, self._fluid.stream_y])
        return np.concatenate([rates, self._forces(time, q, p, ground[:2] - stream, ground[2:])])

    def _forces(self, time: float, q: Array, p: Array, centre: Array, turning: Array) -> Array:
        beam, fluid = self._beam, self._fluid
        angles = np.cumsum(q[2:])
        tangent = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
        moving = centre + self._levers @ (turning[:, None] * normal)
        push = beam.element_mass * moving
        rates = np.zeros_like(p)
        if fluid.present:
            elements = beam.elements
            motion = self._views.body.inc.motion[: self._views.body.mass.added.shape[1]]
            motion[:elements] = (normal * moving).sum(axis=1)
            motion[elements : 2 * elements] = turning
            along = (tangent * moving).sum(axis=1)
            if fluid.axial:
                motion[2 * elements : 2 * elements + 2] = along[[0, -1]]
            impulse = self._views.body.mass.added[: self._motions] @ motion
            shape = np.empty(elements)
            shape_force(motion, *self._given, shape)
            rates[2:] += shape - impulse[:elements] * along
            push += impulse[:elements, None] * normal
            if fluid.axial:
                ends = impulse[2 * elements : 2 * elements + 2]
                rates[[2, -1]] += ends * motion[[0, elements - 1]]
                push[[0, -1]] += ends[:, None] * tangent[[0, -1]]
        rates[2:] -= turning * ((self._levers.T @ push) * tangent).sum(axis=1)
        joints = q[3:]
        bent = joints if beam.linear_strain else np.sin(joints) * np.cos(joints)
        moment = -beam.joint_stiffness * bent
        moment -= beam.joint_damping * np.diff(turning)
        if self.scene.actuation is not None:
            moment += self.scene.actuation.torques([time], self.scene.beam)[0]
        rates[2:-1] -= moment
        rates[3:] += moment
        if fluid.drag > 0.0:
            across = (normal * moving).sum(axis=1)[:, None] + self._drag_places * turning[:, None]
            force = -0.5 * fluid.drag * beam.element_length * np.abs(across) * across
            drag = force.sum(axis=1)[:, None] * normal
            rates[:2] += drag.sum(axis=0)
            rates[2:] += (force * self._drag_places).sum(axis=1)
            rates[2:] += ((self._levers.T @ drag) * normal).sum(axis=1)
        return rates


def _levers(elements: int, element_length: float) -> Array:
    """Return E, (N, N): centre k moves by E_kj (m) times the change of d3 of element j."""
    k, j = np.indices((elements, elements))
    weight = (elements - j - 0.5) / elements
    levers: Array = element_length * (np.where(j < k, 1.0, 0.0) + 0.5 * (j == k) - weight)
    return levers


def integrate(
    scene: Scene,
    duration: float,
    method: str = "DOP853",
    relative_tolerance: float = 1e-8,
    absolute_tolerance: float = 1e-10,
    largest_step: float = np.inf,
    progress: Callable[[float], object] | None = None,
) -> ContinuousRun:
    """Solve the scene's equations in continuous time, with torques that are functions of time.

    Parameters
    ----------
    scene : Scene
        The scene. Of its integrator only the strain and the time step count: the solution is
        returned at multiples of the step.
    duration : float
        Simulated time (s).
    method : str
        One of METHODS.
    relative_tolerance, absolute_tolerance : float
        SciPy's ``rtol`` and ``atol``: of positions in body lengths, of angles in rad, and of
        momenta in `swim_env.sim.constants.momentum_units`.
    largest_step : float
        Longest step that the solver may take (s).
    progress : callable, optional
        Called with the simulated seconds that were solved since the last call.

    Returns
    -------
    ContinuousRun
        The solution.

    Raises
    ------
    SwimError
        If the method is unknown or the solver gives up.
    SimulationEndedError
        If the body takes a shape that has no added mass. Where only a trial of the solver does, the
        solver takes a shorter step.
    """
    # SciPy takes longer to load than the rest of the package.
    from scipy.integrate import solve_ivp

    if method not in METHODS:
        raise SwimError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    if not largest_step > 0.0:
        raise SwimError(f"largest_step must be above 0 s, got {largest_step!r}")
    steps = steps_of(scene, duration)
    equations = _Equations(scene)
    times: Array = np.arange(steps + 1, dtype=np.float64) * scene.integrator.time_step
    state = equations.start()
    momentum, spin = momentum_units(scene)
    units = np.ones((2, state.size // 2))
    units[0, :2], units[1, :2], units[1, 2:] = scene.beam.length, momentum, spin
    seconds = 0.0
    states = [state]
    # Torques that stop make a kink, over which no solver should step.
    end = scene.actuation.end_time if scene.actuation else None
    borders = [0.0, *([end] if end is not None and 0.0 < end < times[-1] else []), times[-1]]
    for begin, until in zip(borders, borders[1:], strict=False):
        begun = clock.perf_counter()
        longest = largest_step
        while True:
            equations.refusals.clear()
            with np.errstate(over="ignore", invalid="ignore"):
                solution = solve_ivp(
                    equations,
                    (begin, until),
                    state,
                    method=method,
                    rtol=relative_tolerance,
                    atol=absolute_tolerance * units.ravel(),
                    max_step=longest,
                    dense_output=True,
                )
            if method != "LSODA" or np.isfinite(solution.y).all():
                break
            # The others reject what is not a number; LSODA goes on with it.
            longest = 0.5 * min(longest, until - begin)
            if longest < 1e-6 * scene.integrator.time_step:
                break
        seconds += clock.perf_counter() - begun
        if equations.refusals and not (solution.success and np.isfinite(solution.y).all()):
            raise equations.refusals[-1]
        if not solution.success:
            raise SwimError(f"{method} gave up at t = {solution.t[-1]:g} s: {solution.message}")
        inside = times[(times > begin) & (times <= until)]
        states += list(np.atleast_2d(solution.sol(inside).T))
        state = solution.y[:, -1]
        if progress is not None:
            progress(until - begin)
    found = np.array(states)
    n = found.shape[1] // 2
    energy: Array = np.array(
        [equations.energy_and_velocity(t, y)[0] for t, y in zip(times, found, strict=True)]
    )
    return ContinuousRun(times, found[:, :n], found[:, n:], energy, equations.evaluations, seconds)
