"""Policies, episodes played by them, and the check that a score can be trusted.

Training is in `swim_agents.learning`, the comparison of gaits in `swim_agents.comparison`, the
console command in `swim_agents.commands`. Everything is imported only when it is first used.
"""

from __future__ import annotations

import importlib

# Without typing, whose import takes longer than all the rest of this module.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from swim_agents.baselines import POLICY_NAMES, Policy, RandomPolicy, WavePolicy, ZeroPolicy
    from swim_agents.policies import load_policy, policy_names
    from swim_agents.rollout import Rollout, play_episode, play_episodes
    from swim_agents.verification import Verification, fine_scene, verify_rollout

__all__ = [
    "POLICY_NAMES",
    "Policy",
    "RandomPolicy",
    "Rollout",
    "Verification",
    "WavePolicy",
    "ZeroPolicy",
    "fine_scene",
    "load_policy",
    "play_episode",
    "play_episodes",
    "policy_names",
    "verify_rollout",
]

_MODULES = ("baselines", "policies", "rollout", "verification")


def __getattr__(name: str) -> Any:
    """Import a public name from its module."""
    if name in __all__:
        for module in (importlib.import_module(f"{__name__}.{one}") for one in _MODULES):
            if name in module.__all__:
                return getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
