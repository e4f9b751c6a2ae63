"""Names under which Gymnasium finds the environments."""

from __future__ import annotations

import gymnasium

FORWARD_ID = "swim_env/KirchhoffSwimmer-v0"
TARGET_ID = "swim_env/KirchhoffSwimmerTarget-v0"
FORWARD_3D_ID = "swim_env/KirchhoffSwimmer3D-v0"
TARGET_3D_ID = "swim_env/KirchhoffSwimmer3DTarget-v0"


def register_environments() -> None:
    """Register both tasks, in the plane and in space; the time limit is the scene's own."""
    for name, single, batched in (
        (FORWARD_ID, "single:SwimEnv", "vector:SwimVectorEnv"),
        (TARGET_ID, "single:SwimTargetEnv", "vector:SwimTargetVectorEnv"),
        (FORWARD_3D_ID, "spatial:SwimEnv3D", "spatial:SwimVectorEnv3D"),
        (TARGET_3D_ID, "spatial:SwimTargetEnv3D", "spatial:SwimTargetVectorEnv3D"),
    ):
        if name not in gymnasium.registry:
            gymnasium.register(
                id=name,
                entry_point=f"swim_env.envs.{single}",
                vector_entry_point=f"swim_env.envs.{batched}",
            )
