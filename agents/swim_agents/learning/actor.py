"""The network of a saved agent that chooses actions, in PyTorch alone.

Playing an agent needs neither the critic nor stable-baselines3, whose actions these are to the bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from swim_agents.learning.settings import Network
from swim_env.errors import SwimError

try:
    import torch
except ImportError as error:
    raise SwimError(
        f"playing a trained agent needs PyTorch ({error}): install it (pip install torch)"
    ) from None

ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU, "elu": torch.nn.ELU}

#: Where stable-baselines3 keeps the layers of an actor.
_NAMES = {
    "PPO": {"mlp_extractor.policy_net.": "latent.", "action_net.": "mean.", "log_std": "log_std"},
    "SAC": {"actor.latent_pi.": "latent.", "actor.mu.": "mean.", "actor.log_std": "log_std"},
}
#: Bounds of SAC's mean with noise that depends on the state, and of its log_std without.
_MOST_MEAN, _LOG_STD = 2.0, (-20.0, 2.0)


class Actor(torch.nn.Module):  # type: ignore[misc]
    """Chooses actions as the policies of stable-baselines3 do.

    Parameters
    ----------
    algorithm : str
        ``PPO``, whose actions are cut off at 1, or ``SAC``, whose actions a tanh keeps below 1.
    observation_space, action_space : gymnasium.spaces.Box
        Of the task.
    network : Network
        The hidden layers.
    state_dependent : bool
        Whether exploration is a random function of the state, drawn once.
    """

    def __init__(
        self,
        algorithm: str,
        observation_space: gymnasium.spaces.Box,
        action_space: gymnasium.spaces.Box,
        network: Network,
        state_dependent: bool,
    ) -> None:
        super().__init__()
        self.observation_space = observation_space
        self._squashed, self._state_dependent = algorithm == "SAC", state_dependent
        self._names = _NAMES[algorithm]
        widths = (observation_space.shape[0], *network.layers)
        joints = action_space.shape[0]
        layers: list[torch.nn.Module] = []
        for before, after in zip(widths, network.layers, strict=False):
            layers += [torch.nn.Linear(before, after), ACTIVATIONS[network.activation]()]
        self.latent = torch.nn.Sequential(*layers)
        self.mean: torch.nn.Module = torch.nn.Linear(widths[-1], joints)
        if self._squashed and state_dependent:
            self.mean = torch.nn.Sequential(self.mean, torch.nn.Hardtanh(-_MOST_MEAN, _MOST_MEAN))
        if self._squashed and not state_dependent:
            self.log_std = torch.nn.Linear(widths[-1], joints)
        else:
            shape = (widths[-1], joints) if state_dependent else (joints,)
            self.log_std = torch.nn.Parameter(torch.zeros(shape))
        self._noise: Any = None

    def take_weights(self, weights: Mapping[str, Any]) -> None:
        """Take the actor's weights out of those of a policy; a RuntimeError if they do not fit."""
        own = {
            new + name.removeprefix(old): value
            for name, value in weights.items()
            for old, new in self._names.items()
            if name.startswith(old)
        }
        self.load_state_dict(own)
        self._noise = None

    def predict(
        self, observation: NDArray[np.float32], deterministic: bool = True
    ) -> tuple[NDArray[np.float32], None]:
        """Return actions, (N - 1,) or (M, N - 1), and no state."""
        with torch.no_grad():
            latent = self.latent(torch.as_tensor(np.atleast_2d(observation)))
            actions = self.mean(latent)
            if not deterministic:
                actions = actions + self._drawn(latent)
            if self._squashed:
                actions = torch.tanh(actions)
        found: NDArray[np.float32] = actions.numpy()
        # With the rounding of a scale from -1 ... 1 to the space's limits, which are the same.
        found = found + 1.0 - 1.0 if self._squashed else np.clip(found, -1.0, 1.0)
        return (found if np.ndim(observation) > 1 else found[0]), None

    def _drawn(self, latent: Any) -> Any:
        """Return exploration, (M, N - 1)."""
        if self._state_dependent:
            if self._noise is None:
                self._noise = torch.exp(self.log_std) * torch.randn_like(self.log_std)
            return latent @ self._noise
        log_std = self.log_std
        if self._squashed:
            log_std = self.log_std(latent).clamp(*_LOG_STD)
        return torch.exp(log_std) * torch.randn(len(latent), log_std.shape[-1])
