"""PPO with RLlib: train on batches, save, restore, evaluate, and export an agent to be compared.

python examples/rllib_ppo.py --output results/rllib
swim-env compare --scene eel_3d --policies results/rllib/agent tuned_wave --seeds 0

An exported agent needs no Ray to be played.
"""

import argparse
from pathlib import Path

from ray.rllib.algorithms.algorithm import Algorithm
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from swim_agents.rllib import export, register


def main() -> None:
    parser = argparse.ArgumentParser(description="Train, evaluate and export an agent.")
    parser.add_argument("--scene", default="eel_3d")
    parser.add_argument("--iterations", type=int, default=50, help="of 128 steps of each member")
    parser.add_argument("--members", type=int, default=64, help="episodes side by side")
    parser.add_argument("--runners", type=int, default=0, help="processes that sample, 0: this one")
    parser.add_argument("--output", type=Path, default=Path("results/rllib"))
    options = parser.parse_args()

    batch = 128 * options.members
    config = (
        PPOConfig()
        .environment(
            register(),
            env_config={"scene": options.scene},  # or overrides, task ...
            # Actions are shares of the limits, which the environment clips: this saves a fifth of
            # RLlib's own time.
            normalize_actions=False,
            clip_actions=False,
        )
        .env_runners(
            num_env_runners=options.runners,
            num_envs_per_env_runner=options.members // max(1, options.runners),
            gym_env_vectorize_mode="vector_entry_point",
        )
        .rl_module(model_config=DefaultModelConfig(fcnet_hiddens=[64, 64], free_log_std=True))
        .training(gamma=0.998, train_batch_size=batch, minibatch_size=min(1024, batch))
        .evaluation(evaluation_duration=options.members, evaluation_config={"explore": False})
    )
    algorithm = config.build_algo()
    for number in range(options.iterations):
        episodes = algorithm.train()["env_runners"]
        print(number, episodes.get("episode_return_mean"))
    saved = algorithm.save_to_path((options.output / "checkpoint").absolute())
    algorithm.stop()
    algorithm = Algorithm.from_checkpoint(saved)
    episodes = algorithm.evaluate()["env_runners"]
    print(f"swam {episodes['episode_return_mean']:.3f} body lengths on average")
    export(algorithm, options.output / "agent")


if __name__ == "__main__":
    main()
