"""The state of one or many bodies of one scene, and the kernel calls that move them.

The simulator, the single environment and the batched one all step bodies through this class and
so through the same compiled code: a body moves the same to the bit whichever of them steps it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import SimulationEndedError
from swim_env.physics.loading import load_model
from swim_env.physics.runtime.references import Referenced, words_of
from swim_env.physics.runtime.threads import share
from swim_env.physics.solve.advance import advance, energy_and_velocity, momentum_of_velocity
from swim_env.physics.solve.constants import SAMPLE_SCENE, Constants
from swim_env.physics.solve.state import (
    RECORD_NAMES,
    Member,
    member_views,
    state_size,
    state_views,
    steps_column,
    work_sizes,
)
from swim_env.physics.status import STATE_NOT_FINITE, TERMINATION_REASONS, describe
from swim_env.scene import Initial, Scene, require_planar
from swim_env.scene.fluid import NO_FLUID
from swim_env.sim.constants import scene_constants
from swim_env.sim.recorder import Recorder, trace_columns, trajectory_of
from swim_env.sim.trajectory import TrajectoryBase

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Bytes.
_CACHE_LINE = 64


class Bodies:
    """M bodies of one scene, each with its own state and work space.

    Parameters
    ----------
    scene : Scene
        What every one of them is.
    count : int
        Their number M.

    Attributes
    ----------
    states : (M, S) array
        State vectors of the kernels: q, p and what the predictor remembers.
    velocities : (M, N + 2) array
        M^-1 p as of the last start or advance: velocity of the mean centre (m/s) and turning rate
        of every element (rad/s).
    outcome : (M, 2) array of int
        Steps taken by the last advance, and 0 or the code of the reason for an early end.
    all_members : (M,) array of int
        The indices of all members.
    coordinates_size, unknowns : int
        Numbers of coordinates and of momenta, N + 2 of both.
    trace_columns, record_columns : int
        Columns of a trace, see `swim_env.sim.recorder.trace_columns`, and of a record.
    joint_shape : tuple of int
        Shape of one member's torques, (N - 1,).
    recorder : Recorder or None
        What keeps their steps, where the scene has the effect `recording`.
    """

    # The kernels; another class of bodies has others that take the same.
    _advance: Any = staticmethod(advance)
    _energy_and_velocity: Any = staticmethod(energy_and_velocity)
    _momentum_of_velocity: Any = staticmethod(momentum_of_velocity)
    record_columns = len(RECORD_NAMES)

    def __init__(self, scene: Scene, count: int = 1) -> None:
        require_planar(scene, "a simulation")
        self.scene = scene
        self._load_kernels()
        beam, fluid, solver = scene_constants(scene)
        self.coordinates_size = self.unknowns = scene.beam.elements + 2
        self.trace_columns = trace_columns(scene)
        self.joint_shape: tuple[int, ...] = (scene.joints,)
        self._constants: Any = Referenced(Constants(beam, fluid, solver), SAMPLE_SCENE)
        self._allocate(count, state_size(scene.beam.elements), work_sizes(fluid))

    def _load_kernels(self) -> None:
        fluid = self.scene.fluid
        load_model(fluid.model if fluid is not None else NO_FLUID)

    def _allocate(self, count: int, state: int, work: tuple[int, int]) -> None:
        self._floats = aligned_zeros(count, work[0])
        self._integers = np.zeros((count, work[1]), dtype=np.int64)
        self.states: Array = np.zeros((count, state))
        self.velocities: Array = np.zeros((count, self.unknowns))
        self.outcome = np.zeros((count, 2), dtype=np.int64)
        self.all_members = np.arange(count)
        self._steps_column = steps_column(state)
        self.recorder = Recorder(self) if self.scene.recording is not None else None
        self._no_trace = np.zeros((count, 0, self.trace_columns))
        self._find_places()

    def _find_places(self) -> None:
        """Note the words of every member, which are those of its arrays' places in memory."""
        first = words_of(self.views(0))
        # Members lie one behind the other, so places differ by as much from each to the next.
        step = words_of(self.views(1)) - first if len(self.states) > 1 else 0
        self._places = first + self.all_members[:, None] * step

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_places"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._load_kernels()
        self._find_places()

    @property
    def coordinates(self) -> Array:
        """Minimal coordinates (M, N + 2), a view: mean centre, angle of element 1, joint angles."""
        return self.states[:, : self.coordinates_size]

    @property
    def momenta(self) -> Array:
        """Momenta (M, N + 2), a view: linear (kg m/s), and angular of every element (kg m^2/s)."""
        first = self.coordinates_size
        return self.states[:, first : first + self.unknowns]

    @property
    def steps_taken(self) -> Array:
        """Number of steps that each member has taken since its start, (M,), a view of floats."""
        return self.states[:, self._steps_column]

    def start(self, member: int, coordinates: Array, velocity: Array) -> None:
        """Put a member at a start; if that cannot be simulated, it stays as it is."""
        self.put(member, self.prepared(member, coordinates, velocity), velocity)

    def prepared(self, member: int, coordinates: Array, velocity: Array) -> Array:
        """Return the state vector (S,) of a start as of `minimal_start`, for `put`.

        Nothing changes but the member's work space. A SimulationEndedError says that the pose
        cannot be simulated.
        """
        before = self.states[member].copy()
        given = self.member(member)
        try:
            self.states[member] = self._state_at(coordinates)
            _, status = self._energy_and_velocity(np.empty(self.unknowns), *given)
            if not status and not np.isfinite(self._momentum_of_velocity(velocity, *given)):
                status = STATE_NOT_FINITE
            state: Array = self.states[member].copy()
        finally:
            self.states[member] = before
        if status:
            raise ended(TERMINATION_REASONS[status], 0.0)
        return state

    def _state_at(self, coordinates: Array) -> Array:
        """Return a state vector (S,) with these coordinates, at rest and without a past."""
        state: Array = np.zeros(self.states.shape[1])
        state[: self.unknowns] = coordinates
        state_views(state, self.scene.beam.elements)[0].inertia[:] = coordinates[3:]
        return state

    def move_to(self, member: int, coordinates: Array, momenta: Array) -> None:
        """Give a member coordinates and momenta, (N + 2,) each, and no past."""
        self.states[member] = self._state_at(coordinates)
        self.momenta[member] = momenta

    def put(self, member: int, state: Array, velocity: Array) -> None:
        """Put a member at a start that was `prepared`."""
        self.states[member] = state
        self.velocities[member] = velocity
        self.outcome[member] = 0
        self.begin_recording(member)

    def begin_recording(self, member: int) -> None:
        """Let a recording begin at the member's present state; without a recorder do nothing."""
        if self.recorder is not None:
            steps = int(self.steps_taken[member])
            state = self.states[member, : self.coordinates_size + self.unknowns]
            self.recorder.begin(member, steps, self.energy_and_velocity(member)[0], state)

    def energy_and_velocity(self, member: int, time: float = 0.0) -> tuple[float, Array]:
        """Return a member's energy (J) and its velocity M^-1 p (N + 2,).

        Every state that is handed out has been prepared before, so this does not fail; of any other
        state it may raise a SimulationEndedError, which names a time (s).
        """
        velocity = np.zeros(self.unknowns)
        energy, status = self._energy_and_velocity(velocity, *self.member(member))
        if status:
            raise ended(TERMINATION_REASONS[status], time)
        return energy, velocity

    def member(self, index: int) -> tuple[Any, ...]:
        """Return the words that kernels take of one member: the scene's constants and its own."""
        return self._constants.words, self._places[index]

    def views(self, index: int) -> Member:
        """Return the names of one member's state and work space, views of both."""
        state, floats, integers = self.states[index], self._floats[index], self._integers[index]
        return member_views(state, self._constants.fluid, floats, integers)[0]

    def trajectory(
        self, reason: str, first: int, energy: float, trace: Array, torques: Array, record: Array
    ) -> TrajectoryBase:
        """Return the run that a trace holds; see `swim_env.sim.recorder.trajectory_of`."""
        return trajectory_of(self.scene, reason, first, energy, trace, torques, record)

    def new_record(self, steps: int) -> Array:
        """Return an array for `advance` to write to: (M, steps, 12), columns RECORD_NAMES."""
        return np.zeros((len(self.states), steps, self.record_columns))

    def advance(
        self,
        torques: Array,
        hold: int,
        record: Array,
        members: Indices | None = None,
        threads: int = 1,
        trace: Array | None = None,
    ) -> None:
        """Advance members by all their rows of torques, in up to that many threads.

        Torques (M, R, N - 1) (N m), not checked here, are held over so many steps each. The record
        (M, R hold, 12) of these members, all unless given, is overwritten, and so is a trace
        (M, R hold, trace_columns), if there is one, with coordinates and momenta after each step
        and internal forces; see `swim_env.physics.solve.advance.advance`. One thread starts none.
        """
        traced = self._no_trace if trace is None else trace
        if self.recorder is not None and trace is None:
            traced = self.recorder.room(record.shape[1])

        def run(some: Indices) -> None:
            self._advance(
                some,
                self._places,
                torques,
                hold,
                self._constants.words,
                traced,
                record,
                self.velocities,
                self.outcome,
            )

        chosen = self.all_members if members is None else members
        share(run, chosen, threads)
        if self.recorder is not None:
            self.recorder.add(chosen, self.outcome[:, 0], traced, torques, hold, record)


def ended(reason: str, time: float) -> SimulationEndedError:
    """Return the error of a simulation that ended for a reason at a time (s)."""
    return SimulationEndedError(reason, time, describe(reason))


def aligned_zeros(rows: int, columns: int) -> Array:
    """Return zeros (rows, columns) that begin at a cache line: loads across two take twice as long.

    Where an array from NumPy begins changes from process to process.
    """
    spare = _CACHE_LINE // 8
    buffer = np.zeros(rows * columns + spare)
    skipped = (-buffer.ctypes.data % _CACHE_LINE) // 8
    return buffer[skipped : skipped + rows * columns].reshape(rows, columns)


def minimal_start(scene: Scene, initial: Initial) -> tuple[Array, Array]:
    """Return the minimal coordinates and velocity of an initial state, (N + 2,) each.

    They are the mean centre (m), the angle of element 1 and the joint angles (rad); the velocity of
    the mean centre (m/s) and the turning rate of every element (rad/s). A SceneError says that the
    initial state does not fit the beam or breaks inextensibility.
    """
    beam = scene.beam
    if initial is not scene.initial:
        initial.check_sizes(beam)
        initial.check_inextensible(beam)
    centre, angles = initial.pose(beam)
    moving, turning = initial.velocities(beam)
    coordinates = np.empty(beam.elements + 2)
    coordinates[:2] = centre.mean(axis=0)
    coordinates[2] = angles[0]
    coordinates[3:] = initial.joint_angles
    return coordinates, np.concatenate([moving.mean(axis=0), turning])
