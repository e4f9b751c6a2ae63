"""Saved agents: a folder with the model and a description of what it was trained on.

``model.zip`` is a file of stable-baselines3, which its own ``load`` reads too. Such files hold
pickled Python objects beside the weights, and unpickling runs whatever code they contain. An agent
is therefore rebuilt from ``agent.json`` and the weights alone, which PyTorch reads without running
code (``weights_only``); only a bare model file without a description has to be trusted, and only
on request.
"""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_agents.files import DAMAGED, as_json, read_json
from swim_agents.fit import AGENT_FIELDS, difference, is_similar
from swim_agents.learning.config import TrainingConfig
from swim_agents.learning.settings import ALGORITHMS, Network
from swim_agents.learning.smoothing import WIDTH, SmoothedPolicy, Smoothing
from swim_env.envs.assessment import OBSERVATION_LAYOUT, OBSERVATION_LIMIT
from swim_env.envs.interface import action_space_of, observation_space_of
from swim_env.envs.tasks import TASKS, make_task
from swim_env.errors import OptionError, SceneError, SettingsError, SwimError
from swim_env.files.folders import write_folder
from swim_env.files.names import shown_name
from swim_env.scene import Scene
from swim_env.scene.block import build_block
from swim_env.scene.checks import integer, one_of, text

#: What an agent's folder holds, and what a training run may put beside it.
AGENT_FILES = ("agent.json", "model.zip")
FORMAT_VERSION = 1
#: What agent.json keeps of the configuration, beside the scene.
_KEPT = (
    *("name", "description", "algorithm", "task"),
    *("environment", "network", "state_dependent_noise", "action_smoothing"),
)


class AgentError(SwimError, ValueError):
    """A saved agent cannot be read, or does not fit the scene or task to be played."""


class AgentPolicy:
    """A trained policy, with the `predict` call of a model of stable-baselines3.

    Parameters
    ----------
    policy : Actor or stable_baselines3.common.policies.BasePolicy
        The network.
    description : mapping
        What ``agent.json`` says of it: name, algorithm, task, scene, the record of the training.
    """

    def __init__(self, policy: Any, description: Mapping[str, Any]) -> None:
        self._policy = policy
        self.description = dict(description)

    @property
    def name(self) -> str:
        """The agent's name."""
        return str(self.description["name"])

    @property
    def scene(self) -> Scene:
        """The scene that it was trained on."""
        return Scene.from_dict(self.description["scene"])

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Return actions, (N - 1,) or (M, N - 1), and the state as it came.

        An observation of another shape than those it was trained with is an OptionError.
        """
        shape = np.shape(observation)
        size = self._policy.observation_space.shape[0]
        if len(shape) not in (1, 2) or shape[-1] != size:
            raise OptionError(
                f"observation must have shape ({size},) or (M, {size}), as agent {self.name} was "
                f"trained with, got {shape}"
            )
        actions, _ = self._policy.predict(
            np.asarray(observation, dtype=np.float32), deterministic=deterministic
        )
        return actions, state

    def check(self, scene: Scene, task: str | None = None) -> None:
        """Refuse a scene or a task that the agent was not trained for (AgentError).

        The body, its fluid with drag and stream, the torque limit and the control interval must be
        the same in body units: a body of twice the length may be played, with stiffness, torques
        and times to match. The time step, the panels, damping, the start and its noise may differ.
        """
        trained = self.description["task"]
        if task is not None and not _same_task(task, trained):
            raise AgentError(f"agent {self.name} was trained for task {trained}, not for {task}")
        own = self.scene
        found = difference(own, scene, AGENT_FIELDS, "training")
        if found and not is_similar(own, scene):
            raise AgentError(
                f"agent {self.name} was trained on scene {own.name} and cannot play scene "
                f"{scene.name}: {found}"
            )


# ---- writing and reading -----------------------------------------------------------------------


def save_agent(
    folder: str | os.PathLike[str], model: Any, config: TrainingConfig, record: Mapping[str, Any]
) -> None:
    """Write an agent's folder, whole or not at all; one of an earlier agent is replaced.

    Parameters
    ----------
    folder : str or os.PathLike
        The folder. If it cannot be written, that is a SwimError, and an earlier agent untouched.
    model : stable_baselines3.common.base_class.BaseAlgorithm
        The model, trained as `config` says.
    record : mapping
        Seed, steps, seconds, scores, versions ... as plain values, for ``agent.json``.
    """
    data = config.to_dict()
    description = {
        "format_version": FORMAT_VERSION,
        **{name: data[name] for name in _KEPT},
        "observation": {
            "layout": OBSERVATION_LAYOUT,
            "size": config.make_task().observation_size,
        },
        "training": dict(record),
        "scene": data["scene"],
    }

    def write(ready: Path) -> None:
        (ready / "agent.json").write_bytes(as_json(description))
        model.save(ready / "model.zip")

    write_folder(folder, AGENT_FILES, write)


def load_agent(folder: str | os.PathLike[str]) -> AgentPolicy:
    """Read an agent's folder. No code from it is run: see this module's first lines.

    It is an AgentError if a file is missing or damaged, if the two do not belong together, or if
    the agent observes other quantities than this version of the environment gives.
    """
    where = os.fspath(folder)
    description = _description(Path(folder) / "agent.json")
    from swim_agents.learning.actor import Actor

    try:
        scene = Scene.from_dict(description["scene"])
        task = text(description["task"], "task")
        network = build_block(Network, description["network"], "network")
        layout = description["observation"]
        algorithm = one_of(ALGORITHMS)(description["algorithm"], "algorithm")
        gsde = bool(description["state_dependent_noise"])
        width = description.get("action_smoothing")  # agents of earlier versions have none
        if width is not None:
            width = WIDTH(width, "action_smoothing")
        name = text(description["name"], "name")
        if not name.isprintable():
            raise SceneError("name must be text on one line")
        if not isinstance(layout, Mapping):
            raise SceneError("observation")
        space = _observation_space(task, scene, description.get("environment") or {}, layout)
    except (KeyError, TypeError, OptionError, SettingsError) as error:
        raise AgentError(f"agent.json does not describe an agent: {error} ({where})") from None
    expected = {"layout": OBSERVATION_LAYOUT, "size": space.shape[0]}
    if layout != expected:
        raise AgentError(
            f"agent {name} observes layout {layout.get('layout')} with {layout.get('size')} "
            f"numbers, this version gives layout {expected['layout']} with {expected['size']} "
            f"({where})"
        )
    weights = _weights(Path(folder) / "model.zip")
    try:
        policy = Actor(algorithm, space, action_space_of(scene), network, gsde)
        policy.take_weights(weights)
    except (RuntimeError, AttributeError, TypeError):
        raise AgentError(
            f"the weights in model.zip are not those of the agent that agent.json describes "
            f"({where})"
        ) from None
    smoothing = Smoothing(scene, width)
    return AgentPolicy(SmoothedPolicy(policy, smoothing), description)


def _observation_space(
    task: str, scene: Scene, options: Mapping[str, Any], layout: Mapping[str, Any]
) -> gymnasium.spaces.Box:
    """Return what an agent observes; no code of a task that does not ship is run."""
    if task in TASKS:
        return observation_space_of(make_task(task, scene, options))
    if ":" not in task:
        raise SceneError(f"unknown task {task!r}")
    size = integer(1, 10**9)(layout.get("size"), "observation.size")
    return gymnasium.spaces.Box(-OBSERVATION_LIMIT, OBSERVATION_LIMIT, (size,), np.float32)


def _same_task(one: str, other: str) -> bool:
    """Return whether two names are those of one task, whose file may have moved."""
    (place, _, kind), (elsewhere, _, other_kind) = one.rpartition(":"), other.rpartition(":")
    files = place.endswith(".py") and elsewhere.endswith(".py")
    moved = files and (Path(place).name, kind) == (Path(elsewhere).name, other_kind)
    return one == other or moved


def _description(path: Path) -> dict[str, Any]:
    try:
        data = read_json(path, "agent.json cannot be read", AgentError)
    except FileNotFoundError:
        raise AgentError(f"no agent there: {path.name} is missing ({path.parent})") from None
    version = data.get("format_version") if isinstance(data, dict) else None
    if version != FORMAT_VERSION:
        raise AgentError(
            f"agent.json must be of format version {FORMAT_VERSION}, got {version} ({path.parent})"
        )
    return dict(data)


def _weights(path: Path) -> Any:
    """Return the policy's weights out of a file of stable-baselines3, reading only them."""
    import torch

    try:
        with zipfile.ZipFile(path) as archive:
            content = archive.read("policy.pth")
        return torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except FileNotFoundError:
        raise AgentError(f"no agent there: {path.name} is missing ({path.parent})") from None
    except OSError as error:
        raise AgentError(f"cannot read the model: {error.strerror or error} ({path})") from None
    except DAMAGED:
        raise AgentError(
            f"the model is damaged or cut short, or no file of stable-baselines3 ({path})"
        ) from None


def load_bare_model(
    path: str | os.PathLike[str], scene: Scene, trust: bool, task: str | None = None
) -> AgentPolicy:
    """Read a model file of stable-baselines3 without ``agent.json``, as trained on a scene.

    It is taken to be trained for the task, or else for ``forward`` or ``target``. It is an
    AgentError unless the file is trusted, as reading it runs code in it, or if the model cannot be
    read or does not fit the scene.
    """
    name = os.fspath(path)
    if not trust:
        raise AgentError(
            f"{name} has no agent.json beside it, so reading it would unpickle, that is run, what "
            "it contains; if you trust where it came from, say so (trust=True, or --trust)"
        )
    try:
        import stable_baselines3
    except ImportError as missing:
        raise AgentError(
            f"a model file without agent.json needs stable-baselines3 ({missing}): install it "
            f"(pip install stable-baselines3) ({name})"
        ) from None

    for algorithm in ALGORITHMS:
        try:
            model = getattr(stable_baselines3, algorithm).load(
                path, device="cpu", custom_objects={"replay_buffer_class": None}
            )
            break
        except DAMAGED:
            continue
        except OSError as error:
            raise AgentError(f"cannot read the model: {error.strerror or error} ({name})") from None
    else:
        raise AgentError(f"the model is damaged or cut short, or neither PPO nor SAC ({name})")
    names = dict.fromkeys([*([task] if task else []), "forward", "target"])
    shapes = {one: str(observation_space_of(make_task(one, scene)).shape) for one in names}
    actions = str(action_space_of(scene).shape)
    seen, acted = (_shape(space) for space in (model.observation_space, model.action_space))
    tasks = [one for one, shape in shapes.items() if seen == shape]
    if not tasks or acted != actions:
        raise AgentError(
            f"the model observes {seen} and acts in {acted} numbers; scene {scene.name} has "
            f"{shapes['forward']} (or {shapes['target']} with a target) and {actions} ({name})"
        )
    description = {
        "name": shown_name(Path(path).stem),
        "algorithm": algorithm,
        "task": tasks[0],
        "scene": scene.to_dict(),
        "training": {},
    }
    return AgentPolicy(model.policy, description)


def _shape(space: gymnasium.Space[Any]) -> str:
    return str(space.shape) if isinstance(space, gymnasium.spaces.Box) else type(space).__name__
