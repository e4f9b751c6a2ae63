"""Train with RLlib on the environments given by name, and restore what was saved.

python ppo.py swim_env:swim_env/KirchhoffSwimmer3D-v0
"""

import json
import sys
from pathlib import Path
from typing import Any

import ray
import torch
from ray.rllib.algorithms.algorithm import Algorithm
from ray.rllib.algorithms.ppo import PPOConfig

#: Vectorisation, env runners (0: in this process) and environments in each.
FORMS = (("sync", 0, 4), ("vector_entry_point", 0, 4), ("vector_entry_point", 2, 2))


def configured(name: str, mode: str, runners: int, members: int) -> PPOConfig:
    """Return PPO on episodes of one second, as small as will still go through every stage."""
    return (
        PPOConfig()
        .environment(name, env_config={"overrides": "episode.duration=1.0"})
        .env_runners(
            num_env_runners=runners,
            num_envs_per_env_runner=members,
            gym_env_vectorize_mode=mode,
        )
        .training(train_batch_size=512, minibatch_size=128, num_epochs=2)
        .debugging(seed=0)
    )


def kinds(algorithm: Algorithm) -> list[str]:
    """Return what the env runners step."""
    runners = algorithm.env_runner_group
    return runners.foreach_env_runner(
        lambda runner: type(runner.env.unwrapped).__name__,
        local_env_runner=not runners.num_remote_env_runners(),
    )


def trained(algorithm: Algorithm) -> dict[str, float]:
    """Train for one iteration; return the figures of its episodes."""
    found = algorithm.train()["env_runners"]
    quantities = ("len_min", "len_max", "return_min", "return_max")
    figures = {quantity: float(found[f"episode_{quantity}"]) for quantity in quantities}
    return {**figures, "steps": float(found["num_env_steps_sampled_lifetime"])}


def actions(algorithm: Algorithm) -> torch.Tensor:
    """Return the policy's actions without exploration for some observations."""
    module = algorithm.get_module()
    random = torch.Generator().manual_seed(0)
    observations = torch.randn(8, *module.observation_space.shape, generator=random)
    distribution = module.get_inference_action_dist_cls().from_logits(
        module.forward_inference({"obs": observations})["action_dist_inputs"]
    )
    return distribution.to_deterministic().sample()


def main() -> None:
    """Train on every environment in every form; print one line of JSON for each."""
    ray.init(num_cpus=2, include_dashboard=False)
    for name in sys.argv[1:]:
        for mode, runners, members in FORMS:
            algorithm = configured(name, mode, runners, members).build_algo()
            figures: dict[str, Any] = {"name": name, "kinds": kinds(algorithm)}
            untrained = actions(algorithm)
            figures["iterations"] = [trained(algorithm) for _ in range(3)]
            learned = actions(algorithm)
            figures["learned"] = not torch.equal(learned, untrained)
            if runners:
                saved = algorithm.save_to_path(Path("checkpoint").absolute())
                algorithm.stop()
                algorithm = Algorithm.from_checkpoint(saved)
                figures["restored"] = torch.equal(actions(algorithm), learned)
                figures["iterations"].append(trained(algorithm))
            algorithm.stop()
            print(json.dumps(figures), flush=True)


if __name__ == "__main__":
    main()
