"""Names under which Gymnasium finds the environments."""

from __future__ import annotations

import gymnasium

FORWARD_ID = "swim_env/KirchhoffSwimmer-v0"
TARGET_ID = "swim_env/KirchhoffSwimmerTarget-v0"


def register_environments() -> None:
    """Register both tasks, single and batched; the time limit is the scene's own."""
    for name, single, batched in (
        (FORWARD_ID, "SwimEnv", "SwimVectorEnv"),
        (TARGET_ID, "SwimTargetEnv", "SwimTargetVectorEnv"),
    ):
        if name not in gymnasium.registry:
            gymnasium.register(
                id=name,
                entry_point=f"swim_env.envs.single:{single}",
                vector_entry_point=f"swim_env.envs.vector:{batched}",
            )
