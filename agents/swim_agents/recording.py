"""From episodes that were played to recordings of them."""

from __future__ import annotations

from swim_agents.rollout import Rollout
from swim_env.envs.task import TARGET_RADIUS
from swim_env.recording import Swimmer
from swim_env.sim.trajectory import Trajectory

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
