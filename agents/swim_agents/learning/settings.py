"""The blocks of a training configuration, each of which checks its own fields."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from swim_env.errors import SceneError
from swim_env.scene.checks import check_fields, check_integer, check_name, check_real, got, listed

__all__ = [
    "ACTIVATIONS",
    "ALGORITHMS",
    "BLOCKS",
    "MOST",
    "Evaluations",
    "Network",
    "PPOSettings",
    "SACSettings",
    "build_settings",
    "network_of",
    "store",
]

ALGORITHMS = ("PPO", "SAC")
ACTIVATIONS = ("tanh", "relu", "elu")

#: Largest number of steps, samples or transitions.
MOST = 10**12


def store(block: object, **values: object) -> None:
    """Store checked values in a frozen dataclass; only for use in ``__post_init__``."""
    for name, value in values.items():
        object.__setattr__(block, name, value)


@dataclass(frozen=True)
class Network:
    """The policy's network; the critic has one of the same shape.

    Attributes
    ----------
    layers : tuple of int
        Widths of the hidden layers.
    activation : str
        One of ACTIVATIONS.
    log_std : float
        Logarithm, at the start, of the standard deviation of independent noise or, where the noise
        depends on the state, of the weights with which the last layer's activations make it.
    """

    layers: tuple[int, ...] = (64, 64)
    activation: str = "tanh"
    log_std: float = -1.0

    def __post_init__(self) -> None:
        """Check every field and store it in its final form."""
        widths = listed(self.layers)
        if not widths:
            raise SceneError(
                f"network.layers must be a list of widths such as [64, 64], got {got(self.layers)}"
            )
        store(
            self,
            layers=tuple(
                check_integer(width, f"network.layers[{i}]", 1, 65536)
                for i, width in enumerate(widths)
            ),
            activation=check_name(self.activation, "network.activation", ACTIVATIONS),
            log_std=check_real(self.log_std, "network.log_std", at_least=-20.0, at_most=2.0),
        )


@dataclass(frozen=True)
class PPOSettings:
    """What proximal policy optimisation (Schulman et al. 2017) has of its own.

    Attributes
    ----------
    rollout : int
        Actions that each member plays between updates.
    minibatch : int
        Samples of one gradient step; divides ``members * rollout``.
    epochs : int
        Passes over the samples of an update.
    gae_lambda : float
        Of the generalised advantage estimate, in [0, 1].
    clip_range : float
        Bound on the change of the probability ratio.
    entropy_coefficient, value_coefficient : float
        Weights in the loss.
    max_gradient_norm : float
        Gradients are shortened to it.
    target_kl : float or None
        An update ends early beyond 1.5 times this divergence.
    """

    rollout: int = 128
    minibatch: int = 2048
    epochs: int = 5
    gae_lambda: float = 0.95
    clip_range: float = 0.2
    entropy_coefficient: float = 0.0
    value_coefficient: float = 0.5
    max_gradient_norm: float = 0.5
    target_kl: float | None = None

    def __post_init__(self) -> None:
        """Check every field and store it in its final form."""
        kl = self.target_kl
        store(
            self,
            rollout=check_integer(self.rollout, "ppo.rollout", 2, MOST),
            minibatch=check_integer(self.minibatch, "ppo.minibatch", 2, MOST),
            epochs=check_integer(self.epochs, "ppo.epochs", 1, 10_000),
            gae_lambda=check_real(self.gae_lambda, "ppo.gae_lambda", at_least=0.0, at_most=1.0),
            clip_range=check_real(self.clip_range, "ppo.clip_range", above=0.0, at_most=10.0),
            entropy_coefficient=check_real(
                self.entropy_coefficient, "ppo.entropy_coefficient", at_least=0.0
            ),
            value_coefficient=check_real(
                self.value_coefficient, "ppo.value_coefficient", at_least=0.0
            ),
            max_gradient_norm=check_real(
                self.max_gradient_norm, "ppo.max_gradient_norm", above=0.0
            ),
            target_kl=None if kl is None else check_real(kl, "ppo.target_kl", above=0.0),
        )


@dataclass(frozen=True)
class SACSettings:
    """What soft actor-critic (Haarnoja et al. 2018) has of its own.

    Attributes
    ----------
    buffer : int
        Transitions that the replay buffer holds.
    minibatch : int
        Transitions of one update.
    rollout : int
        Actions that each member plays between updates; exploration that depends on the state is
        drawn anew at their start at the latest.
    updates : int
        Updates after each of these.
    learning_starts : int
        Steps with random actions before the first update.
    tau : float
        Share by which the target critic follows, in (0, 1].
    return_steps : int
        Rewards that a target of the critic sums before it relies on the critic (n-step returns).
    temperature : float
        Weight of the entropy at the start, which is then tuned. Rewards of a swimmer are small: the
        usual 1 keeps it from learning anything else for long.
    target_entropy : float or None
        Entropy that the temperature is tuned for; minus the number of joints where None.
    """

    buffer: int = 300_000
    minibatch: int = 256
    rollout: int = 4
    updates: int = 16
    learning_starts: int = 10_000
    tau: float = 0.01
    return_steps: int = 3
    temperature: float = 0.01
    target_entropy: float | None = None

    def __post_init__(self) -> None:
        """Check every field and store it in its final form."""
        entropy = self.target_entropy
        store(
            self,
            buffer=check_integer(self.buffer, "sac.buffer", 1, MOST),
            minibatch=check_integer(self.minibatch, "sac.minibatch", 1, MOST),
            rollout=check_integer(self.rollout, "sac.rollout", 1, MOST),
            updates=check_integer(self.updates, "sac.updates", 1, 100_000),
            learning_starts=check_integer(self.learning_starts, "sac.learning_starts", 0, MOST),
            tau=check_real(self.tau, "sac.tau", above=0.0, at_most=1.0),
            return_steps=check_integer(self.return_steps, "sac.return_steps", 1, 10_000),
            temperature=check_real(self.temperature, "sac.temperature", above=0.0),
            target_entropy=None if entropy is None else check_real(entropy, "sac.target_entropy"),
        )


@dataclass(frozen=True)
class Evaluations:
    """The periodic evaluation: the same starts every time, without exploration.

    Attributes
    ----------
    every : int
        Environment steps between two.
    episodes : int
        Episodes of each, with the seeds `seed`, `seed` + 1, ...
    seed : int
        The first seed; training uses others.
    """

    every: int = 250_000
    episodes: int = 16
    seed: int = 1_000_000

    def __post_init__(self) -> None:
        """Check every field and store it in its final form."""
        store(
            self,
            every=check_integer(self.every, "evaluation.every", 1, MOST),
            episodes=check_integer(self.episodes, "evaluation.episodes", 1, 10_000),
            seed=check_integer(self.seed, "evaluation.seed", 0, 2**62),
        )


#: The blocks by their names in a configuration.
BLOCKS: dict[str, type] = {
    "network": Network,
    "ppo": PPOSettings,
    "sac": SACSettings,
    "evaluation": Evaluations,
}


def build_settings(name: str, value: object) -> object:
    """Make a block from a mapping of its fields, or return a block as it is.

    Raises
    ------
    SceneError
        If a field is unknown, of the wrong type or out of range.
    """
    block = BLOCKS[name]
    if isinstance(value, block):
        return value
    return block(**check_fields(value, name, [spec.name for spec in fields(block)]))


def network_of(mapping: Mapping[str, Any]) -> Network:
    """Make a network from what `TrainingConfig.to_dict` says of it.

    Raises
    ------
    SceneError
        If a field is unknown or out of range.
    """
    network = build_settings("network", mapping)
    assert isinstance(network, Network)
    return network
