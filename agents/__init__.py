"""Policies, episodes played by them, and the check that a score can be trusted.

Training is in `agents.learning`, the comparison of gaits in `agents.comparison`; both are imported
only where they are needed.
"""

from agents.baselines import POLICY_NAMES, Policy, RandomPolicy, WavePolicy, ZeroPolicy
from agents.evaluation import play_episodes
from agents.policies import load_policy, policy_names
from agents.rollout import Rollout, play_episode
from agents.verification import Verification, verify_rollout

__all__ = [
    "POLICY_NAMES",
    "Policy",
    "RandomPolicy",
    "Rollout",
    "Verification",
    "WavePolicy",
    "ZeroPolicy",
    "load_policy",
    "play_episode",
    "play_episodes",
    "policy_names",
    "verify_rollout",
]
