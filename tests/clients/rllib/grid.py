"""Compare two stiffnesses with Ray Tune, a training of RLlib for each.

python grid.py swim_env:swim_env/KirchhoffSwimmer-v0
"""

import json
import sys
from pathlib import Path

import ray
from ray import tune
from ray.rllib.algorithms.ppo import PPO, PPOConfig

STIFFNESSES = (2.5, 10.0)


def main() -> None:
    """Train; print a line of JSON for each stiffness, and one for the best."""
    ray.init(num_cpus=2, include_dashboard=False)
    changes = [{"episode.duration": 1.0, "beam.bending_stiffness": one} for one in STIFFNESSES]
    config = (
        PPOConfig()
        .environment(sys.argv[1], env_config={"overrides": tune.grid_search(changes)})
        .env_runners(num_env_runners=0, num_envs_per_env_runner=2)
        .training(train_batch_size=256, minibatch_size=128, num_epochs=1)
        .debugging(seed=0)
    )
    figure = "env_runners/episode_return_mean"
    results = tune.Tuner(
        PPO,
        param_space=config,
        tune_config=tune.TuneConfig(metric=figure, mode="max"),
        run_config=tune.RunConfig(
            storage_path=str(Path("tune").absolute()), stop={"training_iteration": 2}
        ),
    ).fit()

    def line(result: tune.Result) -> str:
        runners = result.metrics["env_runners"]
        return json.dumps(
            {
                "stiffness": result.config["env_config"]["overrides"]["beam.bending_stiffness"],
                "return": float(runners["episode_return_mean"]),
                "iterations": result.metrics["training_iteration"],
            }
        )

    for result in results:
        print(line(result), flush=True)
    print(line(results.get_best_result()), flush=True)


if __name__ == "__main__":
    main()
