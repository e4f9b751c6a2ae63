"""Task ``forward``: swim along a direction."""

from __future__ import annotations

from swim_env.envs.tasks.base import Task


class ForwardTask(Task):
    """Swim along the scene's heading; the reward is the net displacement in body lengths."""
