"""A task of your own: swim at a speed that is drawn anew for every episode.

    swim-env train examples/custom_task.yaml
    swim-env compare --task examples/custom_task.py:CruiseTask --policies zero random

As a program it plays an episode of random torques and prints what was rewarded.
"""

import argparse

import numpy as np

from swim_env import SwimEnv, Task


class CruiseTask(Task):
    reasons = {"turned_away": "the head points away from the heading"}

    def state(self, count):
        return {"speed": np.zeros(count)}  # BL/s, kept of every member

    def draw_state(self, random):
        return {"speed": random.uniform(0.05, 0.2)}

    def observe(self, now):
        return {"speed": 10.0 * now.state["speed"]}

    def reward(self, now):
        forward = now.terms["progress"] / np.maximum(now.seconds, 1e-9)
        miss = np.abs(forward - now.state["speed"])
        return {"speed": -miss * now.seconds, "effort": -0.01 * (now.shares**2).mean(axis=1)}

    def ends(self, now):
        return {"turned_away": np.abs(now.heading_error) > 2.0}


def main() -> None:
    parser = argparse.ArgumentParser(description="Play an episode of the task.")
    parser.add_argument("--steps", type=int, default=1000, help="actions at most")
    options = parser.parse_args()
    env = SwimEnv("swimmer", task=CruiseTask)
    env.reset(seed=0)
    env.action_space.seed(0)
    paid: dict[str, float] = {}
    for _ in range(options.steps):
        _, _, terminated, truncated, info = env.step(env.action_space.sample())
        for name in ("reward_speed", "reward_effort"):
            paid[name] = paid.get(name, 0.0) + info[name]
        if terminated or truncated:
            break
    print(paid, info["termination_reason"] or "no end before the time")


if __name__ == "__main__":
    main()
