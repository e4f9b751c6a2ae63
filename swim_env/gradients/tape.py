"""Runs that are recorded for their gradients, and the kernels' sweeps over them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.errors import OptionError, SimulationEndedError
from swim_env.gradients.objectives import Slopes, Stretch
from swim_env.physics.fluid.layout import motion_count
from swim_env.physics.gradients.loading import load_planar_gradients
from swim_env.physics.gradients.planar_sweep import new_sweep, pull_back, push_forward
from swim_env.physics.runtime.references import Referenced
from swim_env.physics.solve.state import PARTS
from swim_env.physics.status import TERMINATION_REASONS, describe
from swim_env.scene import Scene
from swim_env.sim.simulator import Simulator

Array = NDArray[np.float64]

#: Largest scaled residual of the steps of a run that is to be differentiated: what solves the
#: equations only roughly has only rough derivatives.
TOLERANCE = 1e-12
#: Bends of a joint (rad) by whose difference the added mass is differentiated along a
#: direction. The expansion is a quadratic form, of which every difference is exact.
_BENDS = {"expansion": 0.05}
_BEND = 2e-5


@dataclass(frozen=True)
class Record:
    """Some steps of a run, with what their derivatives need beside a `Stretch`.

    Attributes
    ----------
    stretch : Stretch
        The states and torques.
    increments : (S, H, M) array
        What each of the H parts of a step adds to the coordinates, two with the composed scheme.
    """

    stretch: Stretch
    increments: Array


class CutStepError(OptionError):
    """A step had to be cut into parts, which has no derivative."""


class Tape:
    """Plays a scene step by step and records what derivatives need; `Tape.of` makes one.

    Parameters
    ----------
    scene : Scene
        What moves.
    start : pair of arrays, optional
        Coordinates and velocity as of `Simulator.reset_to`; the scene's start unless given.
    tolerance : float
        Largest scaled residual of its steps, or the scene's where that is smaller.

    Raises
    ------
    OptionError
        If the scene has something that has no gradient.
    """

    def __init__(
        self,
        scene: Scene,
        start: tuple[ArrayLike, ArrayLike] | None = None,
        tolerance: float = TOLERANCE,
    ) -> None:
        self._check(scene)
        tolerance = min(tolerance, scene.integrator.tolerance)
        self.scene = scene
        self.simulator = Simulator(
            scene.replace({"integrator.tolerance": tolerance, "recording": None})
        )
        if start is not None:
            self.simulator.reset_to(*start)
        else:
            start = self.simulator._start(scene.initial)
        #: Coordinates and velocity of the start.
        self.start = tuple(np.array(one, dtype=np.float64) for one in start)
        self._bodies: Any = self.simulator._bodies
        #: Whether there is any momentum at the start, in the frame that moves with a stream.
        self.moving = bool(self._bodies.momenta[0].any())
        self.parts = 2 if scene.integrator.scheme == "composed" else 1
        #: Members whose work space the sweeps use.
        self._work: Any = type(self._bodies)(self._bodies.scene, 2)
        self._sweep = Referenced(self._new_sweep())
        #: Number of parameters of the beam.
        self.parameters = len(self._sweep.unused)

    @staticmethod
    def of(
        scene: Scene,
        start: tuple[ArrayLike, ArrayLike] | None = None,
        tolerance: float = TOLERANCE,
    ) -> Tape:
        """Return the tape that the scene's dimension calls for."""
        if scene.dimension == 3:
            from swim_env.gradients.spatial import SpatialTape

            return SpatialTape(scene, start, tolerance)
        return Tape(scene, start, tolerance)

    def _check(self, scene: Scene) -> None:
        if scene.cross_flow_drag is not None:
            raise OptionError(
                f"gradients are those of an ideal fluid, and {scene.name} has cross_flow_drag; "
                "remove it"
            )
        if scene.fluid is not None and scene.fluid.model == "centreline":
            raise OptionError(f"the fluid model centreline of {scene.name} has no gradient")

    def _new_sweep(self) -> Any:
        """Load the kernels; return what a sweep works with."""
        load_planar_gradients()
        scene = self._bodies.scene
        model = scene.fluid.model if scene.fluid is not None else ""
        self._options: tuple[float, ...] = (_BENDS.get(model, _BEND),)
        return new_sweep(scene.beam.elements, motion_count(self._work._constants.fluid))

    def move_to(self, coordinates: Array, momenta: Array) -> None:
        """Go to a state without a past, at time zero."""
        self.simulator.reset()
        self._bodies.move_to(0, coordinates, momenta)

    def play(self, torques: Array, first: int, total: int) -> Record:
        """Take steps from the present state and record them.

        Raises
        ------
        SimulationEndedError
            If the run ends early.
        CutStepError
            If a step had to be cut into parts.
        """
        bodies = self._bodies
        history = self._history()
        size = bodies.coordinates_size
        steps = len(torques)
        states = np.empty((steps + 1, size + bodies.unknowns))
        increments = np.empty((steps, self.parts, bodies.unknowns))
        record = bodies.new_record(1)
        present = bodies.states[0, : states.shape[1]]
        states[0] = present
        order = range(self.parts - 1, -1, -1)
        for step in range(steps):
            bodies.advance(torques[None, step : step + 1], 1, record)
            if bodies.outcome[0, 1]:
                reason = TERMINATION_REASONS[bodies.outcome[0, 1]]
                raise SimulationEndedError(
                    reason,
                    (first + step) * self.scene.integrator.time_step,
                    f"{describe(reason)}; a run that ends has no gradient",
                )
            if record[0, 0, PARTS] != 1.0:
                time = (first + step) * self.scene.integrator.time_step
                raise CutStepError(
                    f"the step at t = {time:.6g} s was cut into {record[0, 0, PARTS]:.0f} parts, "
                    "which has no derivative; a smaller integrator.time_step may help"
                )
            states[step + 1] = present
            for part, row in enumerate(order):
                increments[step, part] = history[row]
        coordinates, momenta = states[:, :size], states[:, size:]
        joints = self.joints(coordinates)
        stretch = Stretch(self.scene, first, total, coordinates, momenta, torques, joints)
        return Record(stretch, increments)

    def _history(self) -> Array:
        """Return the last increments, the latest first."""
        history: Array = self._bodies.views(0).state.history
        return history

    def joints(self, coordinates: Array) -> Array:
        """Return the joint angles (S + 1, N - 1) of coordinates."""
        return coordinates[:, 3:]

    def rates(self, stretch: Stretch, slopes: Slopes) -> tuple[Array, Array]:
        """Return derivatives by coordinates and momenta in the basis of momenta, (S + 1, M) each.

        That is the mean centre and the turn of every element.
        """
        q, p = np.zeros_like(stretch.coordinates), np.zeros_like(stretch.momenta)
        if slopes.coordinates is not None:
            q += slopes.coordinates
        if slopes.joints is not None:
            q[:, 3:] += slopes.joints
        if slopes.momenta is not None:
            p += slopes.momenta
        # The angle of an element turns the joint in front of it one way, that behind the other.
        q[:, 2:-1] -= q[:, 3:]
        return q, p

    def by_coordinates(self, by_turns: Array, coordinates: Array) -> Array:
        """Return a derivative by coordinates from one in the basis of momenta."""
        found = by_turns.copy()
        found[2:] = np.cumsum(by_turns[:1:-1])[::-1]
        return found

    def turns_of(self, change: Array, coordinates: Array) -> Array:
        """Return a change of coordinates in the basis of momenta."""
        found = np.array(change, dtype=np.float64)
        found[2:] = np.cumsum(found[2:])
        return found

    def moved(self, turns: Array) -> Array:
        """Return the start's coordinates after a change in the basis of momenta."""
        coordinates: Array = self.start[0].copy()
        coordinates += turns
        coordinates[3:] -= turns[2:-1]
        return coordinates

    def momenta_of(self, coordinates: Array, velocity: Array, scene: Scene | None = None) -> Array:
        """Return the momenta that go with a velocity, in this scene or another."""
        simulator = Simulator(scene or self._bodies.scene)
        simulator.reset_to(coordinates, velocity)
        momenta: Array = simulator._bodies.momenta[0].copy()
        return momenta

    def mass_times(self, rates: Array) -> Array:
        """Return the start's reduced mass times rates (M,)."""
        coordinates, velocity = self.start
        return self.momenta_of(coordinates, velocity + rates) - self.momenta_of(
            coordinates, velocity
        )

    def pull(
        self, record: Record, by_q: Array, by_p: Array, adjoint: Array, by_parameters: Array
    ) -> Array:
        """Carry an adjoint (2, M) of the stretch's end to its start, in place.

        Returns the derivatives by the torques; those by the parameters are added.
        """
        by_torques = np.zeros(record.stretch.torques.shape)
        status, step = self._pull_back(
            *self._given(record),
            by_q,
            by_p,
            adjoint,
            by_torques,
            by_parameters,
        )
        self._check_sweep(status, record.stretch.first + step)
        return by_torques

    def push(self, record: Record, tangent: Array, by_parameters: Array, torques: Array) -> Array:
        """Return the changes (S + 1, 2, M) of all states that follow from the start's (2, M)."""
        tangents = np.zeros((len(record.stretch.coordinates), *tangent.shape))
        tangents[0] = tangent
        status, step = self._push_forward(
            *self._given(record),
            by_parameters,
            np.ascontiguousarray(torques),
            tangents,
        )
        self._check_sweep(status, record.stretch.first + step)
        return tangents

    def _given(self, record: Record) -> tuple[Any, ...]:
        """Return what both sweeps take of a run and of this tape."""
        return (
            np.ascontiguousarray(record.stretch.coordinates),
            record.increments,
            np.ascontiguousarray(record.stretch.torques),
            *self._options,
            *(self._work._constants.words, self._work._places, self._sweep.words),
        )

    _pull_back: Any = staticmethod(pull_back)
    _push_forward: Any = staticmethod(push_forward)

    def _check_sweep(self, status: int, step: int) -> None:
        if status:
            reason = TERMINATION_REASONS[status]
            raise SimulationEndedError(
                reason,
                step * self.scene.integrator.time_step,
                f"{describe(reason)}, beside a shape of the run, where its derivative is taken",
            )
