"""Train with Tianshou's PPO on single environments in its own vector form, and evaluate.

python ppo.py swim_env/KirchhoffSwimmer-v0
"""

import json
import sys

import gymnasium
import numpy as np
import torch
from tianshou.algorithm import PPO
from tianshou.algorithm.modelfree.reinforce import ProbabilisticActorPolicy
from tianshou.algorithm.optim import AdamOptimizerFactory
from tianshou.data import Collector, VectorReplayBuffer
from tianshou.env import DummyVectorEnv, SubprocVectorEnv
from tianshou.trainer import OnPolicyTrainerParams
from tianshou.utils.net.common import Net
from tianshou.utils.net.continuous import ContinuousActorProbabilistic, ContinuousCritic
from torch.distributions import Independent, Normal

import swim_env  # noqa: F401  registers the environments

MEMBERS = 4


def distribution(parameters: tuple[torch.Tensor, torch.Tensor]) -> Independent:
    """Return the distribution of actions with a mean and a standard deviation."""
    return Independent(Normal(*parameters), 1)


def main() -> None:
    """Train for two epochs, evaluate; print the figures as one line of JSON."""
    (name,) = sys.argv[1:]
    np.random.seed(0)
    torch.manual_seed(0)

    def one() -> gymnasium.Env:
        return gymnasium.make(f"swim_env:{name}", overrides="episode.duration=1.0")

    env = one()
    seen, acted = env.observation_space.shape, env.action_space.shape
    policy = ProbabilisticActorPolicy(
        actor=ContinuousActorProbabilistic(
            preprocess_net=Net(state_shape=seen, hidden_sizes=(64, 64), activation=torch.nn.Tanh),
            action_shape=acted,
            unbounded=True,
        ),
        dist_fn=distribution,
        deterministic_eval=True,
        action_space=env.action_space,
        action_bound_method="clip",
    )
    critic = ContinuousCritic(
        preprocess_net=Net(state_shape=seen, hidden_sizes=(64, 64), activation=torch.nn.Tanh)
    )
    algorithm = PPO(policy=policy, critic=critic, optim=AdamOptimizerFactory(lr=3e-4))
    before = [parameter.detach().clone() for parameter in policy.parameters()]
    training = SubprocVectorEnv([one] * MEMBERS)
    training.seed(0)
    buffer = VectorReplayBuffer(4096, MEMBERS)
    result = algorithm.run_training(
        OnPolicyTrainerParams(
            training_collector=Collector(algorithm, training, buffer, exploration_noise=True),
            max_epochs=2,
            epoch_num_steps=400,
            collection_step_num_env_steps=200,
            batch_size=64,
            update_step_num_repetitions=2,
            test_in_training=False,
        )
    )
    evaluation = Collector(algorithm, DummyVectorEnv([one] * MEMBERS))
    played = evaluation.collect(n_episode=2 * MEMBERS, reset_before_collect=True)
    training.close()
    figures = {
        "steps": result.train_step,
        "episodes": int(played.n_collected_episodes),
        "lengths": sorted({int(length) for length in played.lens}),
        "mean_return": float(np.mean(played.returns)),
        "learned": any(
            not torch.equal(old, new) for old, new in zip(before, policy.parameters(), strict=True)
        ),
    }
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
