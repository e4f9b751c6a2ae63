"""A reward of your own: a shipped task with one term more, which is named in the infos."""

import argparse

import numpy as np

from swim_env import ForwardTask, SwimVectorEnv


class SmoothTask(ForwardTask):
    """Swim along the heading without bending much; as rewarded as ever, less a cost of bending."""

    def reward(self, now):
        bending = (now.coordinates[:, 3:] ** 2).sum(axis=1)  # rad^2, of all joints
        return {**super().reward(now), "bending": -0.5 * bending * now.seconds}


def main() -> None:
    parser = argparse.ArgumentParser(description="Play random torques in a batch.")
    parser.add_argument("--steps", type=int, default=200, help="actions")
    options = parser.parse_args()
    envs = SwimVectorEnv(8, "swimmer", task=SmoothTask)
    envs.reset(seed=0)
    random, total = np.random.default_rng(0), np.zeros(8)
    for _ in range(options.steps):
        *_, infos = envs.step(random.uniform(-1.0, 1.0, envs.action_space.shape))
        total += infos["reward_bending"]
    print("what the bending cost, by member (BL):", np.round(total, 3))


if __name__ == "__main__":
    main()
