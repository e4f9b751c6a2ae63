"""PPO with RLlib on the batched environment in space: train, save, restore, evaluate."""

import argparse
import tempfile

from ray.rllib.algorithms.algorithm import Algorithm
from ray.rllib.algorithms.ppo import PPOConfig

ID = "swim_env:swim_env/KirchhoffSwimmer3D-v0"


def main() -> None:
    parser = argparse.ArgumentParser(description="Train and evaluate an agent.")
    parser.add_argument("--iterations", type=int, default=50, help="of 128 steps of each member")
    parser.add_argument("--members", type=int, default=64, help="episodes side by side")
    options = parser.parse_args()

    batch = 128 * options.members
    config = (
        PPOConfig()
        .environment(ID, env_config={"scene": "eel_3d"})  # or overrides, task, task_options ...
        .env_runners(
            num_env_runners=0,  # the batch has threads of its own
            num_envs_per_env_runner=options.members,
            gym_env_vectorize_mode="vector_entry_point",
        )
        .training(gamma=0.998, train_batch_size=batch, minibatch_size=min(1024, batch))
        .evaluation(evaluation_duration=options.members, evaluation_config={"explore": False})
    )
    algorithm = config.build_algo()
    for _ in range(options.iterations):
        algorithm.train()
    with tempfile.TemporaryDirectory() as folder:
        algorithm = Algorithm.from_checkpoint(algorithm.save_to_path(folder))
    episodes = algorithm.evaluate()["env_runners"]
    print(f"swam {episodes['episode_return_mean']:.3f} body lengths on average")


if __name__ == "__main__":
    main()
