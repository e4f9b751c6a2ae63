"""PPO in one file, in the manner of CleanRL's ppo_continuous_action.py, on the batched environment.

python ppo_continuous_action.py swim_env/KirchhoffSwimmer-v0
"""

import json
import random
import sys
from collections.abc import Iterator

import gymnasium as gym
import numpy as np
import torch
from gymnasium.wrappers.vector import ClipAction, RecordEpisodeStatistics
from torch import nn
from torch.distributions.normal import Normal

import swim_env

SEED, MEMBERS, ROLLOUT, UPDATES = 1, 4, 64, 3
GAMMA, GAE_LAMBDA, CLIP, EPOCHS, MINIBATCHES = 0.99, 0.95, 0.2, 4, 4
LEARNING_RATE, VALUE_WEIGHT, LARGEST_GRADIENT = 3e-4, 0.5, 0.5


def layer(inputs: int, outputs: int, gain: float = np.sqrt(2)) -> nn.Linear:
    """Return a layer with orthogonal weights."""
    made = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(made.weight, gain)
    nn.init.constant_(made.bias, 0.0)
    return made


class Agent(nn.Module):
    """A critic and a policy with one standard deviation for each joint."""

    def __init__(self, observed: int, joints: int) -> None:
        super().__init__()
        self.critic = nn.Sequential(
            layer(observed, 64), nn.Tanh(), layer(64, 64), nn.Tanh(), layer(64, 1, 1.0)
        )
        self.mean = nn.Sequential(
            layer(observed, 64), nn.Tanh(), layer(64, 64), nn.Tanh(), layer(64, joints, 0.01)
        )
        self.log_std = nn.Parameter(torch.zeros(joints))

    def act(
        self, seen: torch.Tensor, action: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return actions, their log-probabilities and the values of what was seen."""
        normal = Normal(self.mean(seen), self.log_std.exp())
        action = normal.sample() if action is None else action
        return action, normal.log_prob(action).sum(-1), self.critic(seen).flatten()


def minibatches(samples: int) -> Iterator[torch.Tensor]:
    """Yield the indices of all samples in random order, a minibatch at a time, for every epoch."""
    for _ in range(EPOCHS):
        yield from torch.randperm(samples).split(samples // MINIBATCHES)


def main() -> None:
    """Train for a few updates; print the episodes' figures as one line of JSON."""
    (name,) = sys.argv[1:]
    random.seed(SEED)
    np.random.seed(SEED)
    torch.manual_seed(SEED)
    envs = gym.make_vec(
        name, num_envs=MEMBERS, overrides="episode.duration=1.0", autoreset_mode="SameStep"
    )
    assert isinstance(envs.unwrapped, swim_env.SwimVectorEnv)
    statistics = RecordEpisodeStatistics(envs)
    envs = ClipAction(statistics)
    spaces = envs.single_observation_space, envs.single_action_space
    agent = Agent(*(space.shape[0] for space in spaces))
    optimizer = torch.optim.Adam(agent.parameters(), LEARNING_RATE, eps=1e-5)
    before = [parameter.detach().clone() for parameter in agent.parameters()]

    first, _ = envs.reset(seed=SEED)
    seen, done = torch.tensor(first, dtype=torch.float32), torch.zeros(MEMBERS)
    for _ in range(UPDATES):
        rows = []
        for _ in range(ROLLOUT):
            with torch.no_grad():
                action, log_prob, value = agent.act(seen)
            following, reward, terminated, truncated, _ = envs.step(action.numpy())
            rows.append((seen, action, log_prob, value, torch.tensor(reward).float(), done))
            seen = torch.tensor(following, dtype=torch.float32)
            done = torch.tensor(terminated | truncated).float()
        parts = map(torch.stack, zip(*rows, strict=True))
        all_seen, actions, log_probs, values, rewards, dones = parts
        with torch.no_grad():
            value, ended, gain = agent.act(seen)[2], done, torch.zeros(MEMBERS)
            advantages = torch.zeros_like(rewards)
            for t in reversed(range(ROLLOUT)):
                delta = rewards[t] + GAMMA * value * (1 - ended) - values[t]
                gain = delta + GAMMA * GAE_LAMBDA * (1 - ended) * gain
                advantages[t], value, ended = gain, values[t], dones[t]
        aims = (advantages + values).flatten()
        gains, old = advantages.flatten(), log_probs.flatten()
        flat_seen, flat_actions = all_seen.flatten(0, 1), actions.flatten(0, 1)
        for some in minibatches(ROLLOUT * MEMBERS):
            _, log_prob, value = agent.act(flat_seen[some], flat_actions[some])
            ratio = (log_prob - old[some]).exp()
            gain = (gains[some] - gains[some].mean()) / (gains[some].std() + 1e-8)
            policy_loss = -torch.min(gain * ratio, gain * ratio.clamp(1 - CLIP, 1 + CLIP)).mean()
            loss = policy_loss + VALUE_WEIGHT * 0.5 * ((value - aims[some]) ** 2).mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), LARGEST_GRADIENT)
            optimizer.step()
    figures = {
        "episodes": len(statistics.return_queue),
        "lengths": sorted({int(length) for length in statistics.length_queue}),
        "mean_return": float(np.mean(statistics.return_queue)),
        "loss": loss.item(),
        "learned": any(
            not torch.equal(old, new) for old, new in zip(before, agent.parameters(), strict=True)
        ),
    }
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
