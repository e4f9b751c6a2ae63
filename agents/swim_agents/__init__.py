"""Policies, episodes played by them, and the check that a score can be trusted.

Training is in `swim_agents.learning`, the comparison of gaits in `swim_agents.comparison`; both are
imported only where they are needed.
"""

from swim_agents.baselines import POLICY_NAMES, Policy, RandomPolicy, WavePolicy, ZeroPolicy
from swim_agents.evaluation import play_episodes
from swim_agents.policies import load_policy, policy_names
from swim_agents.rollout import Rollout, play_episode
from swim_agents.verification import Verification, verify_rollout

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
