"""What is compared between two computations of one scene: displacement, path and energy."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swim_env.scene import Scene
from swim_env.sim.replay import steps_of
from swim_env.sim.simulator import Simulator
from swim_env.sim.trajectory import Trajectory

__all__ = ["SAMPLES", "Outcome", "compared_figures", "outcome_of", "play", "relative_error"]

Array = NDArray[np.float64]

#: Instants at which paths are compared, besides the start.
SAMPLES = 40
#: Displacements are compared on a scale of at least this, in body lengths.
_SMALLEST = 0.01


@dataclass(frozen=True, eq=False)
class Outcome:
    """The figures of one run.

    Attributes
    ----------
    displacement : (2,) array
        Of the mean centre, its position averaged over the last period of the drive (m); in the
        frame of the stream where there is one.
    path : (SAMPLES + 1, 2) array
        Position of the mean centre relative to its start, at equal times, in the same frame (m).
    energy, largest_bend : float
        H averaged over the last period (J), and the largest joint angle during the run (rad).
    steps, seconds, cut_steps
        The scene's time steps in the run, their wall time (s), and how many had to be cut.
    termination_reason : str
        Why the run ended early, empty if it did not.
    evaluations, corrections : int
        Evaluations of the equations together with the added mass and its gradient, and Newton
        corrections, which keep the fluid's force on the shape if they can.
    """

    displacement: Array
    path: Array
    energy: float
    largest_bend: float
    steps: int
    seconds: float
    cut_steps: int
    termination_reason: str
    evaluations: int = 0
    corrections: int = 0

    @property
    def values(self) -> Array:
        """Displacement, energy and path in one vector, (2 SAMPLES + 5,)."""
        return np.concatenate([self.displacement, [self.energy], self.path.ravel()])


def play(scene: Scene, duration: float) -> Outcome:
    """Play a scene's prescribed torque for a duration (s) and return what is compared."""
    simulator = Simulator(scene)
    torques = simulator.prescribed_torques(steps_of(scene, duration))
    start = time.perf_counter()
    trajectory = simulator.rollout(torques)
    return outcome_of(trajectory, duration, time.perf_counter() - start)


def outcome_of(trajectory: Trajectory, duration: float, seconds: float) -> Outcome:
    """Return what is compared of a run that was to last for a duration (s), with its wall time."""
    recorded = (trajectory.time, trajectory.path, trajectory.energy)
    return Outcome(
        *compared_figures(trajectory.scene, *recorded, duration),
        largest_bend=float(np.abs(np.diff(trajectory.angles, axis=1)).max(initial=0.0)),
        steps=trajectory.steps,
        seconds=seconds,
        cut_steps=int(np.count_nonzero(trajectory.parts > 1)),
        termination_reason=trajectory.termination_reason,
        evaluations=int(np.sum(trajectory.evaluations)),
        corrections=int(np.sum(trajectory.iterations)),
    )


def compared_figures(
    scene: Scene, times: Array, path: Array, energy: Array, duration: float
) -> tuple[Array, Array, float]:
    """Return displacement, path and energy of an `Outcome` from those at all instants (T,)."""
    path = path - path[0]
    if scene.stream is not None:
        # Drifting with the stream is exact in any computation.
        path = path - np.outer(times - times[0], scene.stream.velocity)
    period = duration
    if scene.actuation is not None and scene.actuation.frequency != 0.0:
        period = min(duration, 2.0 * math.pi / abs(scene.actuation.frequency))
    elif scene.actuation is None:
        period = 0.0
    samples = np.linspace(0.0, duration, SAMPLES + 1)
    return (
        np.array([_last_mean(times, path[:, i], period) for i in range(2)]),
        np.stack([np.interp(samples, times, path[:, i]) for i in range(2)], axis=1),
        _last_mean(times, energy, period),
    )


def _last_mean(times: Array, values: Array, period: float) -> float:
    """Return the mean of piecewise linear values over the last period, or the last value."""
    if period <= 0.0 or len(times) < 2:
        return float(values[-1])
    integral = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(times) * (values[1:] + values[:-1]))])
    begin = max(times[0], times[-1] - period)
    # Between two instants the integral of a straight line is a parabola.
    k = min(int(np.searchsorted(times, begin, side="right")) - 1, len(times) - 2)
    share = (begin - times[k]) / (times[k + 1] - times[k])
    slope = values[k + 1] - values[k]
    before = (times[k + 1] - times[k]) * (share * values[k] + 0.5 * share**2 * slope)
    return float((integral[-1] - integral[k] - before) / (times[-1] - begin))


def relative_error(displacement: Array, reference: Array, length: float) -> float:
    """Return |dX - dX_ref| / max(|dX_ref|, 0.01 l), infinite if dX is not finite."""
    scale = max(float(np.hypot(*reference)), _SMALLEST * length)
    error = float(np.hypot(*(displacement - reference))) / scale
    return error if math.isfinite(error) else math.inf
