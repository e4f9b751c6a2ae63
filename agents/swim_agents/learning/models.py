"""Models of stable-baselines3: made from a configuration, and saved without pickle."""

from __future__ import annotations

import contextlib
import random
from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np

from swim_agents.learning.actor import ACTIVATIONS
from swim_agents.learning.config import TrainingConfig
from swim_agents.learning.settings import Network
from swim_agents.vec_env import TrainingExtraError  # noqa: F401
from swim_env.errors import SwimError

# After swim_agents.vec_env, which says in one line what is missing where this is not installed.
import stable_baselines3  # isort: skip
import torch  # isort: skip
from stable_baselines3.common.base_class import BaseAlgorithm  # isort: skip


@contextlib.contextmanager
def torch_threads(threads: int) -> Iterator[None]:
    """Let PyTorch use that many threads, and set the number back afterwards."""
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def checked_device(device: str) -> str:
    """Check that PyTorch has a device, and return it; ``auto`` is a GPU where there is one."""
    if device == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    try:
        torch.zeros(1, device=device).cpu()
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        reason = str(error).splitlines()[0]
        raise SwimError(f"cannot train on device {device!r}: {reason}; cpu always works") from None
    return device


def _policy_arguments(network: Network, algorithm: str) -> dict[str, Any]:
    """Return the arguments with which stable-baselines3 makes a network."""
    layers = list(network.layers)
    return {
        "net_arch": {"pi": layers, "vf": layers} if algorithm == "PPO" else layers,
        "activation_fn": ACTIVATIONS[network.activation],
        "log_std_init": network.log_std,
    }


#: Names of settings in stable-baselines3 by algorithm.
_ARGUMENTS = {
    "PPO": {
        "n_steps": "rollout",
        "batch_size": "minibatch",
        "n_epochs": "epochs",
        "gae_lambda": "gae_lambda",
        "clip_range": "clip_range",
        "ent_coef": "entropy_coefficient",
        "vf_coef": "value_coefficient",
        "max_grad_norm": "max_gradient_norm",
        "target_kl": "target_kl",
    },
    "SAC": {
        "buffer_size": "buffer",
        "batch_size": "minibatch",
        "train_freq": "rollout",
        "gradient_steps": "updates",
        "learning_starts": "learning_starts",
        "tau": "tau",
        "n_steps": "return_steps",
    },
}


def make_model(config: TrainingConfig, env: Any, seed: int, device: str) -> BaseAlgorithm:
    """Make the untrained model of a run.

    The seed is that of the network's first weights, of exploration and of minibatches.
    """
    common: dict[str, Any] = {
        "policy": "MlpPolicy",
        "env": env,
        "gamma": config.discount,
        # The rate is set before every round, since a round knows nothing of the whole run.
        "learning_rate": config.learning_rate,
        "use_sde": config.state_dependent_noise,
        "sde_sample_freq": config.noise_hold,
        "policy_kwargs": _policy_arguments(config.network, config.algorithm),
        "seed": seed,
        "device": device,
        "verbose": 0,
    }
    settings = config.ppo or config.sac
    assert settings is not None
    arguments = {name: getattr(settings, own) for name, own in _ARGUMENTS[config.algorithm].items()}
    if config.sac is not None:
        entropy = config.sac.target_entropy
        arguments["ent_coef"] = f"auto_{config.sac.temperature!r}"
        arguments["target_entropy"] = "auto" if entropy is None else entropy
    model = getattr(stable_baselines3, config.algorithm)(**arguments, **common)
    # The constructor seeds the batch with the model's seed; a run's members have their own.
    env.seed(seed * config.members)
    return model


# ---- state -------------------------------------------------------------------------------------

#: Counters of a model, beside its parameters.
_COUNTERS = ("num_timesteps", "_n_updates", "_episode_num")
_BUFFER_ARRAYS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def model_state(model: BaseAlgorithm) -> dict[str, Any]:
    """Return everything training needs to continue, as tensors, arrays and plain values."""
    # Replay buffers and minibatches use numpy's global generator.
    name, keys, *rest = np.random.get_state()
    version, words, gauss = random.getstate()
    state: dict[str, Any] = {
        "parameters": model.get_parameters(),
        "counters": {name: getattr(model, name) for name in _COUNTERS},
        "last_observations": model._last_obs,
        "last_starts": model._last_episode_starts,
        "episodes": [{key: float(x) for key, x in one.items()} for one in model.ep_info_buffer],
        "successes": [float(x) for x in model.ep_success_buffer],
        "random": {
            "torch": torch.get_rng_state(),
            "numpy": [name, np.asarray(keys).tolist(), *rest],
            "python": [version, list(words), gauss],
            "actions": model.action_space.np_random.bit_generator.state,
        },
    }
    if torch.cuda.is_available():
        state["random"]["cuda"] = torch.cuda.get_rng_state_all()
    entropy = getattr(model, "log_ent_coef", None)
    if entropy is not None:
        state["log_entropy_coefficient"] = entropy.detach().cpu()
    buffer = getattr(model, "replay_buffer", None)
    if buffer is not None:
        filled = buffer.buffer_size if buffer.full else buffer.pos
        state["buffer"] = {
            "position": buffer.pos,
            "full": buffer.full,
            **{name: getattr(buffer, name)[:filled] for name in _BUFFER_ARRAYS},
        }
    return state


def set_model_state(model: BaseAlgorithm, state: dict[str, Any]) -> None:
    """Restore what `model_state` returned."""
    model.set_parameters(state["parameters"], exact_match=True, device=model.device)
    for name, value in state["counters"].items():
        setattr(model, name, value)
    model._last_obs = state["last_observations"]
    model._last_episode_starts = state["last_starts"]
    window = model._stats_window_size
    model.ep_info_buffer = deque(state["episodes"], maxlen=window)
    model.ep_success_buffer = deque(state["successes"], maxlen=window)
    if "log_entropy_coefficient" in state:
        with torch.no_grad():
            model.log_ent_coef.copy_(state["log_entropy_coefficient"])
    if "buffer" in state:
        buffer, kept = model.replay_buffer, state["buffer"]
        buffer.pos, buffer.full = kept["position"], kept["full"]
        for name in _BUFFER_ARRAYS:
            getattr(buffer, name)[: len(kept[name])] = kept[name]
    numbers = state["random"]
    torch.set_rng_state(numbers["torch"])
    if "cuda" in numbers and torch.cuda.is_available():
        torch.cuda.set_rng_state_all(numbers["cuda"])
    name, keys, *rest = numbers["numpy"]
    np.random.set_state((name, np.asarray(keys, dtype=np.uint32), *rest))
    version, words, gauss = numbers["python"]
    random.setstate((version, tuple(words), gauss))
    model.action_space.np_random.bit_generator.state = numbers["actions"]
