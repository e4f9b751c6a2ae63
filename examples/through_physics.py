"""Train a small policy by back-propagation through the physics, without reinforcement learning.

A central pattern generator: a clock and the joint angles go in, torques come out. Every iteration
plays a few seconds, and the exact gradient of the displacement reaches the network's weights.

    python examples/through_physics.py --iterations 40
"""

import argparse
import math

import torch

from swim_env import load_scene
from swim_env.gradients import SwimFunction


class Generator(torch.nn.Module):
    """Torques as shares of their limits, from a clock and the joint angles."""

    def __init__(self, joints: int, frequency: float) -> None:
        super().__init__()
        self.frequency = torch.nn.Parameter(torch.tensor(frequency, dtype=torch.float64))
        self.layers = torch.nn.Sequential(
            torch.nn.Linear(2 + joints, 32, dtype=torch.float64),
            torch.nn.Tanh(),
            torch.nn.Linear(32, joints, dtype=torch.float64),
            torch.nn.Tanh(),
        )

    def forward(self, time: float, joint_angles: torch.Tensor) -> torch.Tensor:
        phase = 2.0 * math.pi * self.frequency * time
        clock = torch.stack([torch.sin(phase), torch.cos(phase)]).expand(len(joint_angles), 2)
        return self.layers(torch.cat([clock, joint_angles], dim=1))


def displacement(scene, function, policy, seconds):
    """Return how far the body swims along its heading (BL), differentiably."""
    coordinates, momenta = function.start()
    first = coordinates[:, :2]
    interval, hold = scene.episode.control_interval, scene.steps_per_action
    for action in range(round(seconds / interval)):
        torques = scene.torque_limit * policy(action * interval, coordinates[:, 3:])
        held = torques[:, None].expand(-1, hold, -1)
        after, moving = function(held, coordinates, momenta)
        coordinates, momenta = after[:, -1], moving[:, -1]
    heading = torch.tensor(scene.episode.heading, dtype=torch.float64)
    return ((coordinates[:, :2] - first) @ heading / scene.beam.length).mean()


def main() -> None:
    """Train, and say how far the policy swims."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--iterations", type=int, default=40)
    parser.add_argument("--seconds", type=float, default=4.0, help="of every run")
    parser.add_argument("--rate", type=float, default=0.01, help="learning rate")
    options = parser.parse_args()
    torch.manual_seed(0)
    scene = load_scene("swimmer")
    function = SwimFunction(scene)
    policy = Generator(scene.joints, frequency=2.5)
    optimiser = torch.optim.Adam(policy.parameters(), lr=options.rate)
    for iteration in range(options.iterations):
        optimiser.zero_grad()
        swum = displacement(scene, function, policy, options.seconds)
        (-swum).backward()
        torch.nn.utils.clip_grad_norm_(policy.parameters(), 1.0)
        optimiser.step()
        print(f"iteration {iteration}: {swum.item():.4f} BL in {options.seconds:g} s")


if __name__ == "__main__":
    main()
