"""From episodes that were played to recordings of them."""

from __future__ import annotations

from agents.rollout import Rollout
from swim_env.task import TARGET_RADIUS
from swim_env.trajectory import Trajectory
from swim_env.viewer.recording import Swimmer

__all__ = ["swimmer_of"]


def swimmer_of(
    name: str,
    rollout: Rollout,
    trajectory: Trajectory | None = None,
    target_radius: float = TARGET_RADIUS,
) -> Swimmer:
    """Return what a recording needs of an episode.

    Parameters
    ----------
    name : str
        What the swimmer is called.
    rollout : Rollout
        The episode.
    trajectory : Trajectory, optional
        Its motion; its torques are played again unless given.
    target_radius : float
        How close a target had to be reached (BL), where the goal is one.
    """
    return Swimmer(
        name,
        rollout.simulate() if trajectory is None else trajectory,
        rollout.rewards,
        rollout.goal,
        target_radius if rollout.goal_is_point else None,
        rollout.velocity,
    )
