"""A body of your own: what it can do, its best travelling wave, and an agent that learns on it."""

import argparse
import tempfile
from pathlib import Path

from swim_agents import load_policy, play_episode
from swim_agents.learning.config import load_config
from swim_agents.learning.trainer import train

from swim_env import SwimEnv, characterise, load_scene

FILE = Path(__file__).with_name("own_body.yaml")


def main() -> None:
    parser = argparse.ArgumentParser(description="Look at a body and train an agent on it.")
    parser.add_argument("--steps", type=int, default=250_000, help="of training")
    options = parser.parse_args()
    scene = load_scene(FILE)
    print(characterise(scene))
    with tempfile.TemporaryDirectory() as folder:
        record = train(load_config("ppo", [f"steps={options.steps}"], FILE), folder, notice=print)
        print(f"trained for {record['seconds']:.0f} s")
        played = play_episode(SwimEnv(scene), load_policy(folder, scene), seed=2_000_000)
    print(f"swims {played.net_displacement:.3f} body lengths in {scene.episode.duration:.3g} s")


if __name__ == "__main__":
    main()
