"""Task ``efficient``: swim far with little work."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.envs.tasks.base import Array, Task
from swim_env.envs.tasks.moment import Moment
from swim_env.scene import Scene
from swim_env.scene.checks import checked_option, real


class EfficientTask(Task):
    """Swim along the scene's heading with little work.

    The reward is the displacement (BL), less a weight times the torques' positive work in units of
    the body's energy: the mean bending stiffness over the length, EI/l (J), that is twice what it
    takes to bend the body by 1 rad in all, or the torque limit times 1 rad without stiffness.
    ``info`` has the ``cost_of_transport`` since the start: positive work per body mass and
    displacement, J/(kg m), infinite where there is none.

    Parameters
    ----------
    scene : Scene
        The body, its fluid and how the episode is played.
    work_weight : float
        What that energy costs (BL), at least 0.

    Raises
    ------
    OptionError
        If the weight cannot be used.
    """

    def __init__(self, scene: Scene, work_weight: float = 0.05) -> None:
        super().__init__(scene)
        self.work_weight = checked_option(real("BL", at_least=0.0), work_weight, "work_weight")
        length, joints = scene.beam.length, scene.beam.stiffness_at_joints()
        # In space that of yaw.
        stiffness = float(np.mean(joints if scene.dimension == 2 else joints[:, 1])) / length
        self._work_cost = self.work_weight / (stiffness or float(scene.action_limits[0]))
        self._weight = scene.mass * length

    def state(self, count: int) -> dict[str, NDArray[Any]]:
        """Return the positive work since the start (J)."""
        return {"positive_work": np.zeros(count)}

    def update(self, now: Moment) -> None:
        """Add up the positive work."""
        now.state["positive_work"][:] += now.positive_work

    def reward(self, now: Moment) -> Mapping[str, Array]:
        """Return the displacement, and what the work has cost."""
        return {
            "progress": now.terms["progress"],
            "work": -self._work_cost * now.positive_work,
        }

    def info(self, now: Moment) -> Mapping[str, Array]:
        """Return the cost of transport."""
        there = now.progress > 0.0
        way = self._weight * np.where(there, now.progress, 1.0)
        return {"cost_of_transport": np.where(there, now.state["positive_work"] / way, np.inf)}
