"""Blocks of a training configuration (PPO, SAC, networks ...); each checks its own fields."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from swim_env.errors import SceneError
from swim_env.scene.block import Block
from swim_env.scene.checks import got, integer, listed, one_of, real

ALGORITHMS = ("PPO", "SAC")
ACTIVATIONS = ("tanh", "relu", "elu")

#: Largest number of steps, samples or transitions.
MOST = 10**12


def _widths(value: object, field: str) -> tuple[int, ...]:
    """Return a list of layers' widths as a tuple."""
    widths = listed(value)
    if not widths:
        raise SceneError(f"{field} must be a list of widths such as [64, 64], got {got(value)}")
    return tuple(integer(1, 65536)(width, f"{field}[{i}]") for i, width in enumerate(widths))


@dataclass(frozen=True)
class Network(Block, path="network"):
    """The policy's network; the critic has one of the same shape."""

    #: Widths of the hidden layers.
    layers: Annotated[tuple[int, ...], _widths] = (64, 64)
    #: One of ACTIVATIONS.
    activation: Annotated[str, one_of(ACTIVATIONS)] = "tanh"
    #: Logarithm, at the start, of the standard deviation of independent noise or, where the noise
    #: depends on the state, of the weights with which the last layer's activations make it.
    log_std: Annotated[float, real(at_least=-20.0, at_most=2.0)] = -1.0


@dataclass(frozen=True)
class PPOSettings(Block, path="ppo"):
    """Settings of proximal policy optimisation (Schulman et al. 2017)."""

    #: Actions that each member plays between updates.
    rollout: Annotated[int, integer(2, MOST)] = 128
    #: Samples of one gradient step; divides ``members * rollout``.
    minibatch: Annotated[int, integer(2, MOST)] = 2048
    #: Passes over the samples of an update.
    epochs: Annotated[int, integer(1, 10_000)] = 5
    #: lambda of the generalised advantage estimate, in [0, 1].
    gae_lambda: Annotated[float, real(at_least=0.0, at_most=1.0)] = 0.95
    #: Bound on the change of the probability ratio.
    clip_range: Annotated[float, real(above=0.0, at_most=10.0)] = 0.2
    #: Weights in the loss.
    entropy_coefficient: Annotated[float, real(at_least=0.0)] = 0.0
    value_coefficient: Annotated[float, real(at_least=0.0)] = 0.5
    #: Largest norm of a gradient; longer ones are scaled down to it.
    max_gradient_norm: Annotated[float, real(above=0.0)] = 0.5
    #: An update ends early beyond 1.5 times this divergence.
    target_kl: Annotated[float | None, real(above=0.0)] = None


@dataclass(frozen=True)
class SACSettings(Block, path="sac"):
    """Settings of soft actor-critic (Haarnoja et al. 2018)."""

    #: Transitions that the replay buffer holds.
    buffer: Annotated[int, integer(1, MOST)] = 300_000
    #: Transitions of one update.
    minibatch: Annotated[int, integer(1, MOST)] = 256
    #: Actions that each member plays between updates; state-dependent exploration is drawn again at
    #: the start of each rollout at the latest.
    rollout: Annotated[int, integer(1, MOST)] = 4
    #: Updates after each rollout.
    updates: Annotated[int, integer(1, 100_000)] = 16
    #: Steps with random actions before the first update.
    learning_starts: Annotated[int, integer(0, MOST)] = 10_000
    #: Share by which the target critic follows, in (0, 1].
    tau: Annotated[float, real(above=0.0, at_most=1.0)] = 0.01
    #: Rewards that a target of the critic sums before it relies on the critic (n-step returns).
    return_steps: Annotated[int, integer(1, 10_000)] = 3
    #: Initial weight of the entropy, tuned from there. A swimmer's rewards are small: with the
    #: usual 1 it long learns nothing but to be random.
    temperature: Annotated[float, real(above=0.0)] = 0.01
    #: Entropy that the temperature is tuned for; None for minus the number of joints.
    target_entropy: Annotated[float | None, real()] = None


@dataclass(frozen=True)
class Evaluations(Block, path="evaluation"):
    """The periodic evaluation: the same starts every time, without exploration."""

    #: Environment steps between two evaluations.
    every: Annotated[int, integer(1, MOST)] = 250_000
    #: Episodes of each evaluation, with the seeds `seed`, `seed` + 1, ...
    episodes: Annotated[int, integer(1, 10_000)] = 16
    #: The first seed; training uses others.
    seed: Annotated[int, integer(0, 2**62)] = 1_000_000
