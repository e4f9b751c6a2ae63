"""Tasks of one's own, as the tests and other processes find them."""

import numpy as np

from swim_env import ForwardTask, Task


class Gliding(Task):
    """As short as a task may be that has all there is: state, draw, observation, reward, end."""

    reasons = {"too_slow": "the body has stopped", "fast": "it is fast"}
    successes = ("fast",)

    def state(self, count):
        return {"wanted": np.zeros(count), "longest": np.zeros(count)}

    def draw_state(self, random):
        return {"wanted": random.uniform(0.1, 0.5)}

    def update(self, now):
        now.state["longest"][:] = np.maximum(now.state["longest"], now.progress)

    def observe(self, now):
        return {"wanted": now.state["wanted"], "velocity_over_ground": 10.0 * now.velocity}

    def reward(self, now):
        return {**super().reward(now), "longest": now.state["longest"] * now.seconds}

    def ends(self, now):
        return {"too_slow": now.progress < -0.02, "fast": now.progress > now.state["wanted"]}


class Rewarded(ForwardTask):
    """Only the reward is its own, and it is the forward one."""

    def reward(self, now):
        return {"all": now.terms["progress"] + now.terms["effort"]}
