"""The simulator of one swimming beam: a scene, its state, and steps through compiled kernels."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.errors import OptionError, SceneError, SwimError, TorqueError
from swim_env.physics.fluid.outline import LENGTH
from swim_env.physics.fluid.sources import normal_influence
from swim_env.physics.invariants import momentum_map
from swim_env.physics.planar.chain import centres
from swim_env.physics.solve.state import energy_drift_of
from swim_env.physics.status import TERMINATION_REASONS
from swim_env.scene import Initial, Scene, load_scene
from swim_env.scene.checks import checked_option, got, real
from swim_env.sim.batch import Bodies, ended, minimal_start
from swim_env.sim.recorder import needs_recording
from swim_env.sim.trajectory import Trajectory

Array = NDArray[np.float64]

#: Steps per kernel call of a rollout that reports its progress.
_CHUNK = 200


@dataclass(frozen=True)
class Snapshot:
    """A simulator's complete state: a restored run continues bit for bit.

    Attributes
    ----------
    scene : Scene
        The scene.
    state : bytes
        The kernel's state vector.
    reason : str
        Why the run had ended; empty if it had not.
    """

    scene: Scene
    state: bytes
    reason: str


class Simulator:
    """Steps one scene through time.

    Parameters
    ----------
    scene : Scene, str or os.PathLike
        The scene, a shipped name or the path of a scene file.

    Raises
    ------
    SceneError
        If there is no such scene.
    SimulationEndedError
        If the scene's initial pose cannot be simulated.

    Examples
    --------
    >>> simulator = Simulator("paper_i")
    >>> trajectory = simulator.rollout(simulator.prescribed_torques(100))
    >>> bool(trajectory.displacement[0] < 0.0)
    True
    """

    scene: Scene
    _bodies: Any

    def __new__(cls, *arguments: Any, **options: Any) -> Simulator:
        """Make the simulator that the scene's dimension calls for."""
        given = [*arguments, *options.values()]
        # A class based on this one is made as it is, and so is a copy, which has no arguments.
        if cls is not Simulator or len(given) != 1:
            return super().__new__(cls)
        scene = load_scene(given[0])
        if scene.dimension == 3:
            from swim_env.sim.spatial.simulator import SpatialSimulator

            cls = SpatialSimulator
        simulator = super().__new__(cls)
        simulator.scene = scene
        return simulator

    def __init__(self, scene: Scene | str | os.PathLike[str]) -> None:
        # Where it was loaded to choose the class, a file is not read again.
        self.scene = vars(self).get("scene") or load_scene(scene)
        self._bodies = self._make_bodies()
        self._record = self._bodies.new_record(1)
        self._reason = ""
        self.reset()

    # ---- what differs in space -------------------------------------------------------------------

    def _make_bodies(self) -> Any:
        return Bodies(self.scene)

    def _start(self, initial: Any) -> tuple[Array, Array]:
        """Return coordinates and velocity of an initial state."""
        return minimal_start(self.scene, initial)

    @property
    def _state(self) -> Array:
        # Not kept: a copy of a simulator would hold on to a state that no longer moves.
        state: Array = self._bodies.states[0]
        return state

    # ---- state ---------------------------------------------------------------------------------

    @property
    def elements(self) -> int:
        """Number N of elements."""
        return self.scene.beam.elements

    @property
    def time_step(self) -> float:
        """Length dt of a physics step (s)."""
        return self.scene.integrator.time_step

    @property
    def steps(self) -> int:
        """Number of steps taken since the reset."""
        return int(self._bodies.steps_taken[0])

    @property
    def time(self) -> float:
        """Simulated time (s): the number of steps times the time step."""
        return self.steps * self.time_step

    @property
    def termination_reason(self) -> str:
        """Why the run ended, a key of `swim_env.TERMINATION_REASONS`; empty if it has not."""
        return self._reason

    @property
    def coordinates(self) -> Array:
        """Minimal coordinates (N + 2,): mean centre (m), angle of element 1, joint angles (rad)."""
        coordinates: Array = self._bodies.coordinates[0].copy()
        return coordinates

    @property
    def joint_angles(self) -> Array:
        """Joint angles theta_k - theta_{k-1}, (N - 1,) (rad)."""
        return self._state[3 : self.elements + 2].copy()

    @property
    def angles(self) -> Array:
        """Element angles theta_k, (N,) (rad)."""
        return np.cumsum(self._state[2 : self.elements + 2])

    @property
    def centres(self) -> Array:
        """Element centres r^k, (N, 2) (m)."""
        out = np.empty((self.elements, 2))
        centres(self._state[: self.elements + 2], self.scene.beam.element_length, out)
        return out

    def momentum(self) -> Array:
        """Return total linear and angular momentum (3,) of body and fluid.

        Returns
        -------
        (3,) array
            (px, py) in kg m/s and the angular momentum about the origin in kg m^2/s, per metre of
            depth: the discrete momentum map at q_n with the carried p_n.
        """
        n = self.elements + 2
        return momentum_map(self._state[:n], self._state[n : 2 * n])

    def energy(self) -> float:
        """Return H(q_n, p_n) = p_n M(q_n)^-1 p_n/2 + W(q_n) of body and fluid (J).

        This does not fail: no state is reached at which it cannot be computed.
        """
        return float(self._bodies.energy_and_velocity(0)[0])

    def velocity(self) -> Array:
        """Return M(q_n)^-1 p_n, (N + 2,).

        Returns
        -------
        (N + 2,) array
            Velocity of the mean centre (m/s) and turning rate of every element (rad/s).
        """
        return np.asarray(self._bodies.energy_and_velocity(0)[1])

    def energy_drift(self) -> float:
        """Return the largest unexplained energy of all steps since the start.

        Returns
        -------
        float
            max_n |H_n - H_0 - work + dissipated| as a share of max_n H + dissipated. Beyond the
            scene's ``integrator.energy_tolerance`` the run should not be trusted; a smaller time
            step, the composed scheme or damping helps.
        """
        return energy_drift_of(self._state)

    def panel_condition(self) -> float:
        """Return the condition of the panels' normal influence G at the present shape.

        Returns
        -------
        float
            The condition number in the 1-norm: relative errors of the boundary values may be that
            many times as large in the sources. 0 without panels. It grows as the body gets thinner
            and as it bends. Where G can be eliminated only by exchanging rows, as for very thin
            bodies, a run ends beyond 1e10 with ``influence_singular``.
        """
        self._bodies.energy_and_velocity(0)
        work = self._bodies.views(0).fluid_work
        if not work.inverse.size:
            return 0.0
        normal = np.zeros_like(work.inverse)
        count = int(np.count_nonzero(work.outline.panels[LENGTH]))
        normal_influence(work.outline.panels, count, work.layers, normal)
        inverse = work.inverse[:count, :count]
        return float(np.linalg.norm(normal[:count, :count], 1) * np.linalg.norm(inverse, 1))

    # ---- running -------------------------------------------------------------------------------

    def reset(self, initial: Initial | None = None) -> None:
        """Go back to the start.

        Parameters
        ----------
        initial : Initial, optional
            Another pose and velocity than the scene's.

        Raises
        ------
        SceneError
            If the initial state is one of another dimension, does not fit the beam or breaks
            inextensibility.
        SimulationEndedError
            If the initial pose cannot be simulated.
        """
        chosen, kind = (
            self.scene.initial if initial is None else initial,
            self.scene._blocks["initial"],
        )
        if not isinstance(chosen, kind):
            raise SceneError(
                f"initial must be of class {kind.__name__}, got {type(chosen).__name__}"
            )
        self.reset_to(*self._start(chosen))

    def reset_to(self, coordinates: ArrayLike, velocity: ArrayLike) -> None:
        """Go to a start given in minimal coordinates, at time zero.

        Parameters
        ----------
        coordinates : (N + 2,) array_like
            As `Simulator.coordinates`: mean centre (m), angle of element 1, joint angles (rad).
        velocity : (N + 2,) array_like
            As `Simulator.velocity`: of the mean centre (m/s), and turning rates (rad/s).

        Raises
        ------
        SwimError
            If they are not N + 2 finite numbers each.
        SimulationEndedError
            If the pose cannot be simulated; the state is as before.
        """
        given = []
        pairs = (("coordinates", coordinates), ("velocity", velocity))
        sizes = (self._bodies.coordinates_size, self._bodies.unknowns)
        for (name, value), size in zip(pairs, sizes, strict=True):
            array = np.array(value, dtype=np.float64)
            if array.shape != (size,) or not np.isfinite(array).all():
                raise SwimError(f"{name} must be {size} finite numbers, got {array.tolist()}")
            given.append(array)
        self._bodies.start(0, *given)
        self._reason = ""

    def step(self, torques: ArrayLike) -> None:
        """Advance one physics step.

        Parameters
        ----------
        torques : (N - 1,) array_like
            Joint torques held over the step (N m): positive turns the element behind the joint
            counter-clockwise and the one in front of it clockwise.

        Raises
        ------
        TorqueError
            If the torques are not N - 1 finite numbers; the state is as before.
        SimulationEndedError
            If the step cannot be taken, or too much energy is unexplained after it
            (``energy_unexplained``); the state is the last one that was reached.
        """
        held = self._checked(torques, many=False)
        self._refuse_after_end()
        self._bodies.advance(held[None], 1, self._record)
        status = int(self._bodies.outcome[0, 1])
        if status:
            self._reason = TERMINATION_REASONS[status]
            raise ended(self._reason, self.time)

    def rollout(
        self, torques: ArrayLike, progress: Callable[[int], object] | None = None
    ) -> Trajectory:
        """Advance by many steps in one kernel call and return the trajectory.

        Parameters
        ----------
        torques : (T, N - 1) array_like
            Joint torques of every step (N m), each held over its step.
        progress : callable, optional
            Called with the number of steps taken since the last call, every few hundred steps.

        Returns
        -------
        Trajectory, in space SpatialTrajectory
            From the present state to the end, or to the last state that was reached; then
            `termination_reason` says why it ends there.

        Raises
        ------
        TorqueError
            If the torques are not finite numbers of shape (T, N - 1); the state is as before.
        SimulationEndedError
            If the simulation had ended before.
        """
        held = self._checked(torques, many=True)
        self._refuse_after_end()
        n = self._bodies.coordinates_size + self._bodies.unknowns
        total = len(held)
        first, start = self.steps, self.energy()
        trace = np.empty((1, total + 1, self._bodies.trace_columns))
        record = np.zeros((total, self._record.shape[-1]))
        trace[0, 0, :n] = self._state[:n]
        taken = 0
        while taken < total and not self._reason:
            chunk = slice(taken, min(total, taken + _CHUNK) if progress else total)
            after = slice(chunk.start + 1, chunk.stop + 1)
            self._bodies.advance(held[None, chunk], 1, record[None, chunk], trace=trace[:, after])
            steps, status = (int(n) for n in self._bodies.outcome[0])
            taken += steps
            if status:
                self._reason = TERMINATION_REASONS[status]
            if progress:
                progress(steps)
        traced = trace[0, : taken + 1]
        made = self._bodies.trajectory
        run: Trajectory = made(self._reason, first, start, traced, held[:taken], record[:taken])
        return run

    def recorded(self) -> Trajectory:
        """Return the trajectory of all steps since the start, of a scene with the effect recording.

        After `restore` it begins at the snapshot.

        Raises
        ------
        OptionError
            If the scene has no recording.
        """
        run: Any = needs_recording(self._bodies.recorder).trajectory(0, self._reason)
        return run  # type: ignore[no-any-return]

    def _refuse_after_end(self) -> None:
        if self._reason:
            raise ended(self._reason, self.time)

    def _checked(self, torques: ArrayLike, many: bool) -> Array:
        """Return torques of one or many steps as a contiguous array (T, ...) of finite numbers."""
        step = self._bodies.joint_shape
        inner = ", ".join(map(str, step))
        wanted = f"(T, {inner})" if many else f"({inner}{',' * (len(step) == 1)})"
        try:
            given = np.asarray(torques)
            if given.dtype.kind not in "iuf":
                raise TypeError(f"got an array of {given.dtype}")
            held = np.ascontiguousarray(given, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise TorqueError(
                f"torques at t = {self.time:.6g} s must be numbers of shape {wanted}: {error}"
            ) from None
        if given.ndim != len(step) + many or given.shape[many:] != step:
            raise TorqueError(
                f"torques at t = {self.time:.6g} s must have shape {wanted}, got {given.shape}"
            )
        held = held.reshape(-1, *step)
        if not np.isfinite(held).all():
            row, joint, *axis = (int(i) for i in np.argwhere(~np.isfinite(held))[0])
            raise TorqueError(
                f"torques must be finite, got {held[row, joint, *axis]} at joint {joint} for the "
                f"step at t = {self.time + row * self.time_step:.6g} s"
            )
        return held

    def prescribed_torques(self, steps: int) -> Array:
        """Return the scene's torques (N m) for the next steps, (steps, N - 1).

        Each row holds the value at its step's beginning, with the composed scheme at its middle;
        all are zero in a scene without actuation. Other steps than a whole number of at least 0
        are an OptionError.
        """
        count = checked_option(real(at_least=0.0), steps, "steps")
        if not count.is_integer():
            raise OptionError(f"steps must be a whole number, got {got(steps)}")
        steps = int(count)
        if self.scene.actuation is None:
            return np.zeros((steps, *self._bodies.joint_shape))
        times = torque_times(self.scene, self.steps, steps)
        return self.scene.actuation.torques(times, self.scene.beam)

    # ---- snapshots -----------------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        """Return the complete state, including the predictor's memory of earlier steps."""
        return Snapshot(self.scene, self._state.tobytes(), self._reason)

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a snapshot; what follows is bit for bit what followed then.

        Raises
        ------
        SwimError
            If it is no simulator's snapshot, or belongs to another scene.
        """
        if not isinstance(snapshot, Snapshot):
            raise SwimError(
                f"restore needs what a simulator's snapshot returned, got {type(snapshot).__name__}"
            )
        if snapshot.scene != self.scene:
            raise SwimError(
                f"the snapshot belongs to another scene ({snapshot.scene.name}), it can be "
                f"restored only into a simulator of the very same scene ({self.scene.name})"
            )
        self._state[:] = np.frombuffer(snapshot.state)
        self._reason = snapshot.reason
        self._bodies.begin_recording(0)


def torque_times(scene: Scene, first: int, steps: int) -> Array:
    """Return when the prescribed torques of steps from a number on are taken (s), (steps,)."""
    into = 0.5 if scene.integrator.scheme == "composed" else 0.0
    return np.asarray((first + np.arange(steps) + into) * scene.integrator.time_step)
