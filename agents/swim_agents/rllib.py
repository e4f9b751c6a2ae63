"""RLlib (Ray's reinforcement learning): the environments under one name, and its agents as ours.

RLlib also takes the environments by their ids (``swim_env:swim_env/KirchhoffSwimmer-v0``), without
this module. The registered name adds that each process uses as many kernel threads as Ray gives it
processors, and chooses plane or space by the scene.
"""

from __future__ import annotations

import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium

from swim_agents.learning.actor import ACTIVATIONS
from swim_agents.learning.config import TrainingConfig
from swim_agents.learning.saved import AgentError, save_agent
from swim_agents.learning.settings import Network
from swim_env import SwimEnv, SwimVectorEnv
from swim_env.errors import require_packages

if TYPE_CHECKING:
    from ray.rllib.algorithms.algorithm import Algorithm

__all__ = ["NAME", "export", "make_env", "register"]

#: Under which `register` makes the environments known.
NAME = "swim_env"
#: Arguments of an environment that are not the task's.
_NOT_OF_THE_TASK = (
    *("scene", "overrides", "task", "task_options"),
    *("render_mode", "autoreset_mode", "max_episode_steps", "num_threads"),
)
#: Logarithm of a standard deviation that is none.
_NO_NOISE = -20.0


def register() -> str:
    """Make the environments known to RLlib, in all its processes; return their name.

    ``config.environment(register(), env_config={"scene": "eel_3d"})``
    """
    _require_rllib()
    from ray.tune.registry import register_env

    register_env(NAME, make_env)
    return NAME


def _require_rllib() -> None:
    """Refuse what needs RLlib where it is not installed (SwimError)."""
    require_packages("agents of RLlib need", {"ray": "Ray"}, "ray")


def make_env(config: Mapping[str, Any]) -> gymnasium.Env[Any, Any] | gymnasium.vector.VectorEnv:
    """Make an environment as RLlib asks for it.

    Parameters
    ----------
    config : mapping
        RLlib's ``env_config``: the arguments of `swim_env.SwimEnv`, as ``scene``, ``overrides``,
        ``task`` and ``task_options``. ``num_threads`` is as many as Ray gives the process
        processors, at least one, unless given; with ``num_envs``, which RLlib adds for
        ``gym_env_vectorize_mode="vector_entry_point"``, it is a batch.

    Raises
    ------
    SceneError, OptionError
        As of `swim_env.SwimEnv`.
    SwimError
        If Ray is not installed.
    """
    arguments = {"num_threads": _processors(), **config}
    return (SwimVectorEnv if "num_envs" in arguments else SwimEnv)(**arguments)


def _processors() -> int | None:
    """Return how many processors Ray gives this process; None outside of its workers."""
    _require_rllib()
    import ray

    context = ray.get_runtime_context() if ray.is_initialized() else None
    if context is None or context.worker.mode != ray.WORKER_MODE:
        return None
    return max(1, int(context.get_assigned_resources().get("CPU", 1)))


def export(
    algorithm: Algorithm | str | os.PathLike[str], folder: str | os.PathLike[str], name: str = ""
) -> None:
    """Write an agent's folder, which `compare`, `visualise` and `load_policy` know by its path.

    Parameters
    ----------
    algorithm : ray.rllib.algorithms.algorithm.Algorithm, str or os.PathLike
        PPO, or a folder with its checkpoint.
    folder : str or os.PathLike
        Written whole or not at all; an agent that is there is replaced.
    name : str
        Of the agent; the folder's unless given.

    Raises
    ------
    AgentError
        If the policy is no plain network of one activation, or sees changed observations.
    SwimError
        If the folder cannot be written.

    Notes
    -----
    Where the standard deviation depends on the state (without ``free_log_std``), the agent has no
    exploration; its best action is the same.
    """
    _require_rllib()
    import ray
    from ray.rllib.algorithms.algorithm import Algorithm

    if not isinstance(algorithm, Algorithm):
        algorithm = Algorithm.from_checkpoint(os.path.abspath(algorithm))
    config = algorithm.config
    if config._env_to_module_connector is not None:
        raise AgentError("an agent with connectors of its own cannot be exported")
    env_config = dict(config.env_config)
    made: Any = gymnasium.make if config.env != NAME else lambda _, **given: make_env(given)
    with made(config.env, **env_config) as env:
        task, scene = env.unwrapped.task.name, env.unwrapped.scene
    own = {key: value for key, value in env_config.items() if key not in _NOT_OF_THE_TASK}
    network, weights = _network(algorithm.get_module())
    described = TrainingConfig(
        name=name or Path(folder).name,
        description="trained with RLlib",
        task=task,
        scene=scene,
        environment={**env_config.get("task_options", {}), **own},
        network=network,
        state_dependent_noise=False,
    )
    record = {"library": f"ray {ray.__version__}", "iterations": algorithm.iteration}
    save_agent(folder, _Weights(weights), described, record)


def _network(module: Any) -> tuple[Network, dict[str, Any]]:
    """Return the layers of a policy, and its weights as stable-baselines3 names them."""
    import torch

    encoder = module.encoder
    parts = (getattr(encoder, "actor_encoder", None) or encoder.encoder, module.pi)
    leaves = [leaf for part in parts for leaf in part.modules() if not list(leaf.children())]
    linear, between = leaves[::2], {type(leaf) for leaf in leaves[1::2]}
    names = [name for name, kind in ACTIVATIONS.items() if between == {kind}]
    if not names or not all(isinstance(layer, torch.nn.Linear) for layer in linear):
        raise AgentError(
            "only policies of linear layers with one activation between them "
            f"({', '.join(ACTIVATIONS)}) can be exported, got {module.pi} behind {parts[0]}"
        )
    *hidden, last = linear
    joints = module.action_space.shape[0]
    free = getattr(module.pi, "log_std", None)
    weights = {
        "action_net.weight": last.weight[:joints],
        "action_net.bias": last.bias[:joints],
        "log_std": torch.full((joints,), _NO_NOISE) if free is None else free,
    }
    for i, layer in enumerate(hidden):
        weights[f"mlp_extractor.policy_net.{2 * i}.weight"] = layer.weight
        weights[f"mlp_extractor.policy_net.{2 * i}.bias"] = layer.bias
    layers = tuple(layer.out_features for layer in hidden)
    kept = {key: value.detach().cpu().clone() for key, value in weights.items()}
    return Network(layers=layers, activation=names[0]), kept


class _Weights:
    """Weights with the `save` of a model of stable-baselines3."""

    def __init__(self, weights: Mapping[str, Any]) -> None:
        self._weights = dict(weights)

    def save(self, path: Path) -> None:
        """Write a zip file with the weights alone."""
        import torch

        with zipfile.ZipFile(path, "w") as archive, archive.open("policy.pth", "w") as file:
            torch.save(self._weights, file)
