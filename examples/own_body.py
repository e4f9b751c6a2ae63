"""A body of your own: how fast it vibrates in its fluid, how it bends, and how it swims."""

import argparse
from pathlib import Path

import numpy as np

from swim_env import SwimEnv, load_scene, natural_frequencies


def main() -> None:
    parser = argparse.ArgumentParser(description="Look at a body and play random torques.")
    parser.add_argument("--steps", type=int, default=500, help="actions")
    options = parser.parse_args()
    scene = load_scene(Path(__file__).with_name("own_body.yaml"))

    first = natural_frequencies(scene)[0]
    interval = scene.episode.control_interval
    print(f"first bending mode: {first:.2f} Hz, actions are held for {interval:g} s")
    if first * interval > 0.25:
        print("that is more than a quarter of its period: shorten episode.control_interval")

    env = SwimEnv(scene)
    env.reset(seed=0)
    random, most = np.random.default_rng(0), 0.0
    for step in range(options.steps):
        if step % 5 == 0:  # torques that are held feed slow modes
            action = random.uniform(-1.0, 1.0) * np.ones(env.action_space.shape)
        _, _, terminated, truncated, info = env.step(action)
        most = max(most, float(np.abs(env.coordinates[3:]).max()))
        if terminated or truncated:
            break
    print(
        f"after {info['time']:g} s: {info['progress']:.4f} body lengths, joints bent by up to "
        f"{most:.2f} rad {info['termination_reason']}"
    )


if __name__ == "__main__":
    main()
