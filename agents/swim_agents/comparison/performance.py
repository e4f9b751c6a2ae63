"""An episode in figures: how far, how fast, at what cost, and in what gait."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_agents.comparison.gait import Gait, analyse_gait
from swim_agents.comparison.spatial_gait import SpatialGait, analyse_spatial_gait
from swim_agents.rollout import Rollout
from swim_agents.verification import Verification
from swim_env.physics.spatial.invariants import heading_of
from swim_env.scene import Scene
from swim_env.sim.spatial.trajectory import SpatialTrajectory
from swim_env.sim.trajectory import Trajectory, TrajectoryBase

__all__ = ["Performance", "measure_gait", "measure_performance"]

Array = NDArray[np.float64]

#: Share of an episode, from its start, that is left out of the gait as a transient.
_TRANSIENT = 0.25
#: Fewest actions after it from which a gait is measured.
_FEWEST_ACTIONS = 16


@dataclass(frozen=True)
class Performance:
    """The figures of an episode."""

    #: Of the start.
    seed: int
    #: `Task.score_name`, and the same of the policy in the finer scene.
    score: float
    closed_score: float | None
    #: Along the goal's direction or towards its point (BL).
    net_displacement: float
    #: The same in the finer scene that verifies it: by the same torques, and by the policy (BL).
    fine_displacement: float
    closed_displacement: float | None
    #: Whether the score counts, see `swim_agents.verify_rollout`.
    verified: bool
    #: By how much the score changes as a share of itself: with the time step, the sides' panels,
    #: the ends' panels and in space the fluid's model refined by themselves, with all of them, and
    #: in the closed loop. None where the scene has no such source of error, or the policy did not
    #: play.
    time_step_change: float
    panels_change: float | None
    ends_change: float | None
    model_change: float | None
    together_change: float
    closed_loop_change: float | None
    #: Simulated time (s), shorter than the scene's where an end came early.
    duration: float
    #: Net displacement per time (BL/s).
    speed: float
    #: Net displacement per period of the bending's dominant frequency (BL); NaN without a gait.
    displacement_per_cycle: float
    #: Work of the torques, its positive parts over joints, axes and time steps (J).
    positive_work: float
    #: Positive work per body mass and net displacement (J/(kg m)); infinite where there is none or
    #: it is backwards.
    cost_of_transport: float
    #: Integral of the squared torques over time, summed over joints and axes (N^2 m^2 s).
    torque_squared: float
    #: Change of the mean element angle (rad); in space the angle of the body's whole turn.
    heading_change: float
    #: Of the run, see `swim_env.Trajectory.summary`; the largest of the finer computations of its
    #: torques; and that of the closed loop.
    energy_drift: float
    fine_energy_drift: float
    closed_energy_drift: float | None
    #: Whether the target was reached, and in the closed loop; None where there is none.
    success: bool | None
    closed_success: bool | None
    #: How near torques and policy come to the target in the finer scene (BL).
    fine_distance: float | None
    closed_distance: float | None
    #: Why it ended early, empty where it did not, and why the closed loop did.
    termination_reason: str
    closed_termination_reason: str | None
    #: None where the episode is too short for one or nothing moves.
    gait: Gait | SpatialGait | None

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON; what is not finite as null."""
        data = {**vars(self), "gait": None if self.gait is None else self.gait.to_dict()}
        return {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in data.items()
        }


def measure_performance(
    rollout: Rollout, trajectory: Trajectory, verification: Verification
) -> Performance:
    """Return the figures of an episode; the trajectory is that of `Rollout.simulate`."""
    rollout.own(trajectory)
    scene = rollout.scene
    net, duration = rollout.net_displacement, trajectory.duration
    gait = measure_gait(rollout, trajectory)
    cycles = gait.frequency * duration if gait is not None else 0.0
    work = float(trajectory.positive_work.sum())
    changes = verification.changes
    return Performance(
        seed=-1 if rollout.seed is None else rollout.seed,
        score=rollout.score,
        closed_score=(
            verification.closed_displacement
            if rollout.task.scored_by_displacement
            else verification.closed_return
        ),
        net_displacement=net,
        fine_displacement=verification.fine_displacement,
        closed_displacement=verification.closed_displacement,
        verified=verification.verified,
        time_step_change=changes["time_step"],
        panels_change=changes.get("panels"),
        ends_change=changes.get("ends"),
        model_change=changes.get("model"),
        together_change=changes["together"],
        closed_loop_change=changes.get("closed_loop"),
        duration=duration,
        speed=net / duration if duration else 0.0,
        displacement_per_cycle=net / cycles if cycles else math.nan,
        positive_work=work,
        cost_of_transport=work / (scene.mass * net * scene.beam.length) if net > 0.0 else math.inf,
        torque_squared=float((trajectory.torques**2).sum()) * scene.integrator.time_step,
        heading_change=trajectory.heading_change,
        energy_drift=float(trajectory.summary()["energy_drift"]),
        fine_energy_drift=verification.fine_energy_drift,
        closed_energy_drift=verification.closed_energy_drift,
        success=rollout.info.get("success"),
        closed_success=verification.closed_success,
        fine_distance=verification.fine_distance,
        closed_distance=verification.closed_distance,
        termination_reason=rollout.info["termination_reason"],
        closed_termination_reason=verification.closed_termination_reason,
        gait=gait,
    )


def measure_gait(rollout: Rollout, trajectory: TrajectoryBase) -> Gait | SpatialGait | None:
    """Return the gait of an episode after its start; None where there is none."""
    scene = rollout.scene
    hold = scene.steps_per_action
    whole = trajectory.steps // hold
    first = math.ceil(_TRANSIENT * whole)
    if whole - first < _FEWEST_ACTIONS:
        return None
    instants = slice(first * hold, whole * hold, hold)
    torques = rollout.torques[first:whole]
    times = np.asarray(np.arange(first, whole) * scene.episode.control_interval, np.float64)
    places = scene.beam.joint_fractions
    if isinstance(trajectory, SpatialTrajectory):
        rotations = trajectory.joint_rotations[instants]
        if not np.ptp(rotations, axis=0).any():
            return None
        frames: Array = heading_of(trajectory.directors[instants])
        path: Array = trajectory.path[instants]
        return analyse_spatial_gait(
            times, rotations, torques, places, frames, _forward_speed(scene, times, frames, path)
        )
    assert isinstance(trajectory, Trajectory)
    bending = np.diff(trajectory.angles[instants], axis=1)
    if np.ptp(bending) == 0.0:
        return None
    return analyse_gait(times, bending, torques, places)


def _forward_speed(scene: Scene, times: Array, frames: Array, path: Array) -> float:
    """Return the mean velocity of a path (T, 3) (m) through the fluid, head first (BL/s)."""
    drift = 0.0 if scene.stream is None else np.array(scene.stream.velocity)
    velocity = np.diff(path, axis=0) / np.diff(times)[:, None] - drift
    tailwards = 0.5 * (frames[1:, :, 2] + frames[:-1, :, 2])
    return -float((velocity * tailwards).sum(axis=1).mean()) / scene.beam.length
