"""From what the kernels trace to a `Trajectory`, and the effect that keeps it for every step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.errors import OptionError
from swim_env.physics.beam import centres_of_trajectory
from swim_env.physics.integrator import RECORD_NAMES
from swim_env.physics.invariants import momentum_map
from swim_env.scene import Scene
from swim_env.trajectory import Trajectory

__all__ = ["Recorder", "needs_recording", "trajectory_of"]

Array = NDArray[np.float64]

# Steps taken before, energy (J), coordinates and momenta; trace, torques and record of some steps.
_Start = tuple[int, float, Array]
_Steps = tuple[Array, Array, Array]


def trajectory_of(
    scene: Scene,
    reason: str,
    first: int,
    energy: float,
    trace: Array,
    torques: Array,
    record: Array,
) -> Trajectory:
    """Make a trajectory of T steps from what `Bodies.advance` has written.

    Parameters
    ----------
    scene : Scene
        What was run.
    reason : str
        Why it ended early, empty where it did not.
    first : int
        Steps taken before its first instant.
    energy : float
        H at its first instant (J).
    trace : (T + 1, C) array
        Coordinates and momenta of the first instant and after each step, and internal forces of
        each step where the scene asks for them.
    torques : (T, N - 1) array
        Torques of each step (N m).
    record : (T, 12) array
        Columns RECORD_NAMES.
    """
    elements = scene.beam.elements
    n = elements + 2
    q, p = trace[:, :n].copy(), trace[:, n : 2 * n]
    forces = None
    if scene.internal_forces is not None:
        forces = trace[1:, 2 * n :].reshape(-1, elements - 1, 2).copy()
    positions = np.empty((len(q), elements, 2))
    centres_of_trajectory(q, scene.beam.element_length, positions)
    columns = dict(zip(RECORD_NAMES, record.T.copy(), strict=True))
    # The kernel records the energy at the end of each step.
    energies = np.concatenate([[energy], columns.pop("energy")])
    outside = [columns.pop(name) for name in ("impulse_x", "impulse_y", "angular_impulse")]
    steps = np.arange(first, first + len(q), dtype=np.float64)
    return Trajectory(
        scene=scene,
        termination_reason=reason,
        time=steps * scene.integrator.time_step,
        centres=positions,
        angles=np.cumsum(q[:, 2:], axis=1),
        torques=torques.copy(),
        momentum=momentum_map(q, p),
        energy=energies,
        impulse=np.stack(outside, axis=-1),
        internal_forces=forces,
        **columns,
    )


class Recorder:
    """Keeps the steps of M bodies since each one's start.

    Parameters
    ----------
    scene : Scene
        What they are.
    count : int
        Their number M.
    """

    def __init__(self, scene: Scene, count: int) -> None:
        self._scene = scene
        self._starts: list[_Start | None] = [None] * count
        self._steps: list[list[_Steps]] = [[] for _ in range(count)]

    def begin(self, member: int, steps: int, energy: float, state: Array) -> None:
        """Forget a member's steps; its trajectory begins here.

        Parameters
        ----------
        member : int
            Which one.
        steps : int
            Steps it has taken before.
        energy : float
            Its energy (J).
        state : (2 (N + 2),) array
            Its coordinates and momenta.
        """
        self._starts[member] = (steps, energy, state.copy())
        self._steps[member] = []

    def forget(self) -> None:
        """Forget everything."""
        self.restore(([None] * len(self._starts), [[] for _ in self._steps]))

    def snapshot(self) -> tuple[list[_Start | None], list[list[_Steps]]]:
        """Return what there is, to go back to."""
        return list(self._starts), [list(steps) for steps in self._steps]

    def restore(self, snapshot: tuple[list[_Start | None], list[list[_Steps]]]) -> None:
        """Go back to a snapshot of this recorder."""
        self._starts, self._steps = snapshot

    def add(self, member: int, trace: Array, torques: Array, record: Array) -> None:
        """Add the steps that a member has taken, as `Bodies.advance` has written them."""
        self._steps[member].append((trace.copy(), torques.copy(), record.copy()))

    def trajectory(self, member: int, reason: str) -> Trajectory:
        """Return a member's trajectory since its start, which ended for this reason or goes on.

        Raises
        ------
        OptionError
            If it was never started.
        """
        start_of = self._starts[member]
        if start_of is None:
            raise OptionError("nothing was recorded yet: call reset first")
        first, energy, state = start_of
        parts = self._steps[member]
        columns = parts[0][0].shape[1] if parts else state.size
        start = np.full((1, columns), np.nan)
        start[0, : state.size] = state
        joints = self._scene.beam.elements - 1
        return trajectory_of(
            self._scene,
            reason,
            first,
            energy,
            np.concatenate([start, *(part[0] for part in parts)]),
            np.concatenate([np.zeros((0, joints)), *(part[1] for part in parts)]),
            np.concatenate([np.zeros((0, len(RECORD_NAMES))), *(part[2] for part in parts)]),
        )


def needs_recording(recorder: Recorder | None) -> Recorder:
    """Return the recorder of a scene with the effect ``recording``.

    Raises
    ------
    OptionError
        If there is none.
    """
    if recorder is None:
        raise OptionError(
            "nothing was recorded: the scene needs the block recording "
            "(scene.replace('recording', True))"
        )
    return recorder
