"""Policies, episodes played by them, and the check that a score can be trusted."""

from agents.baselines import POLICY_NAMES, Policy, RandomPolicy, WavePolicy, ZeroPolicy
from agents.policies import load_policy
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
    "verify_rollout",
]
