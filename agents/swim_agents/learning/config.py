"""A training run's configuration: one YAML file, one dataclass that determines the whole run."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any

from swim_agents.learning.automatic import resolve
from swim_agents.learning.settings import (
    ALGORITHMS,
    MOST,
    Evaluations,
    Network,
    PPOSettings,
    SACSettings,
)
from swim_agents.learning.smoothing import WIDTH
from swim_env.envs.tasks import Task, check_task, find_task, make_task
from swim_env.envs.tasks.find import task_options
from swim_env.errors import OptionError, SceneError, SettingsError, SwimError, TaskError
from swim_env.files.atomic import write_atomically
from swim_env.files.names import file_name
from swim_env.scene import Scene, load_scene, scene_names
from swim_env.scene.block import Block, block, plain
from swim_env.scene.checks import Check, check_fields, got, integer, nearest, one_of, real, text
from swim_env.scene.yaml import dump_yaml, parse_overrides, parse_yaml, read_text

_BLOCKS = ("network", "ppo", "sac", "evaluation")


class ConfigError(SettingsError):
    """A training configuration cannot be used."""


@contextlib.contextmanager
def _located(source: str | None = None, prefix: str = "") -> Iterator[None]:
    """Turn an error of settings into one of a configuration, from a source if that is known."""
    try:
        yield
    except SettingsError as error:
        raise ConfigError(prefix + error.problem, source or error.source) from None


def _name(value: object, field: str) -> str:
    name = text(value, field)
    if name in ("", ".", "..") or not name.isprintable() or set(name) & set("/\\"):
        raise ConfigError(f"name must be a short text without slashes, got {name!r}")
    return name


def _is_a(kind: type, what: str) -> Check[object]:
    """Return a check for an instance of a type."""

    def check(value: object, field: str) -> object:
        if not isinstance(value, kind):
            raise ConfigError(f"{field} must be {what}, got {got(value)}")
        return value

    return check


def _task(value: object, field: str) -> str:
    try:
        return check_task(text(value, field))
    except OptionError as error:
        raise ConfigError(str(error)) from error


def _discount(value: object, field: str) -> float:
    number = real(above=0.0)(value, field)
    if not number < 1.0:
        raise ConfigError(f"{field} must be below 1, got {number:g}")
    return number


@dataclass(frozen=True)
class TrainingConfig(Block):
    """Everything that determines a training run but its seed."""

    #: Of the agent.
    name: Annotated[str, _name] = "agent"
    #: What it is for, and why the settings are what they are.
    description: Annotated[str, text] = ""
    #: One of ALGORITHMS.
    algorithm: Annotated[str, one_of(ALGORITHMS)] = "PPO"
    #: A shipped name, ``module:Class`` or ``FILE.py:Class``; a file is relative to that of the
    #: configuration.
    task: Annotated[str, _task] = "forward"
    scene: Annotated[Scene, _is_a(Scene, "a Scene")] = field(
        default_factory=lambda: load_scene("swimmer")
    )
    #: Arguments of the task's class, such as ``effort_weight`` or ``target_distance``.
    environment: dict[str, Any] = field(default_factory=dict)
    #: Episodes that are played side by side.
    members: Annotated[int, integer(1, 100_000)] = 64
    #: Environment steps (actions) in all.
    steps: Annotated[int, integer(1, MOST)] = 1_000_000
    #: gamma, in (0, 1); a file may have ``auto``, as for `noise_hold`.
    discount: Annotated[float, _discount] = 0.998
    #: Of Adam, at the start and at the end, linear in between; constant where the final one is not
    #: given.
    learning_rate: Annotated[float, real(above=0.0, at_most=1.0)] = 3e-4
    final_learning_rate: Annotated[float | None, real(at_least=0.0, at_most=1.0)] = None
    #: What the learner sees is the reward times this. With PPO it may be None: the reward over the
    #: running standard deviation of the discounted return.
    reward_scale: Annotated[float | None, real(above=0.0)] = None
    #: Whether exploration is a random function of the state (gSDE, Raffin et al. 2022), drawn again
    #: every `noise_hold` actions, instead of independent noise at every joint and action.
    state_dependent_noise: Annotated[bool, _is_a(bool, "true or false")] = True
    noise_hold: Annotated[int, integer(1, 1_000_000)] = 4
    #: Standard deviation (BL) of the Gaussian weights with which the policy's actions, exploration
    #: included, are averaged over neighbouring joints; None for no smoothing.
    action_smoothing: Annotated[float | None, WIDTH] = None
    #: Of policy and critic.
    network: Annotated[Network, block(Network)] = field(default_factory=Network)
    #: With algorithm PPO, and with it alone.
    ppo: Annotated[PPOSettings | None, block(PPOSettings)] = None
    #: With algorithm SAC, and with it alone.
    sac: Annotated[SACSettings | None, block(SACSettings)] = None
    #: The periodic evaluation.
    evaluation: Annotated[Evaluations, block(Evaluations)] = field(default_factory=Evaluations)
    #: Environment steps between checkpoints.
    checkpoint_every: Annotated[int, integer(1, MOST)] = 250_000
    #: Threads of PyTorch. One is fastest for networks of this size, and only a fixed number gives
    #: the same run twice.
    torch_threads: Annotated[int, integer(1, 1024)] = 1

    def __post_init__(self) -> None:
        """Check every field, and that they fit together."""
        with _located():
            super().__post_init__()
        own, other = ("ppo", "sac") if self.algorithm == "PPO" else ("sac", "ppo")
        if getattr(self, other) is not None:
            raise ConfigError(f"a block {other} has no meaning with algorithm {self.algorithm}")
        if getattr(self, own) is None:
            self._store(**{own: PPOSettings() if own == "ppo" else SACSettings()})
        if self.sac is not None and self.reward_scale is None:
            raise ConfigError(
                "reward_scale must be a number with algorithm SAC, whose buffer keeps rewards for "
                "long, got null"
            )
        if self.ppo is not None and self.round_steps % self.ppo.minibatch:
            raise ConfigError(
                f"ppo.minibatch must divide members * ppo.rollout = {self.round_steps}, "
                f"got {self.ppo.minibatch}"
            )
        if self.sac is not None and self.sac.buffer < self.members:
            raise ConfigError(
                f"sac.buffer must be at least members = {self.members}, got {self.sac.buffer}"
            )
        with _located(prefix="scene: "):
            # Refuses a control interval that is no whole number of steps, as an environment would.
            _ = self.scene.steps_per_action
        known = task_options(find_task(self.task))
        if not isinstance(self.environment, Mapping):
            raise ConfigError(
                f"environment must be a mapping of arguments, got {got(self.environment)}"
            )
        for name in self.environment:
            if known is not None and name not in known:
                raise ConfigError(
                    f"unknown field environment.{name}{nearest(str(name), known)}; known fields "
                    f"with task {self.task}: {', '.join(known) or 'none'}"
                )
        self._store(environment={key: plain(value) for key, value in self.environment.items()})
        try:
            _ = self.make_task().layout
        except TaskError as error:
            raise ConfigError(str(error)) from None
        except SwimError as error:
            raise ConfigError(f"environment: {error}") from None

    # ---- what follows from it ------------------------------------------------------------------

    def make_task(self) -> Task:
        """Return the task, with the arguments in `environment`."""
        return make_task(self.task, self.scene, self.environment)

    @property
    def round_steps(self) -> int:
        """Environment steps of one round, a rollout of all members and the updates after it."""
        settings = self.ppo or self.sac
        assert settings is not None
        return self.members * settings.rollout

    def learning_rate_at(self, steps: int) -> float:
        """Return the learning rate after a number of environment steps."""
        if self.final_learning_rate is None:
            return self.learning_rate
        done = min(1.0, steps / self.steps)
        return self.learning_rate + done * (self.final_learning_rate - self.learning_rate)

    # ---- to and from YAML ----------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, the scene in full, from which `from_dict` makes the same again."""
        data: dict[str, Any] = {}
        for spec in fields(self):
            value = getattr(self, spec.name)
            if spec.name == "scene":
                data["scene"] = value.to_dict()
            elif value is not None or spec.name not in _BLOCKS:
                data[spec.name] = dict(value) if isinstance(value, dict) else plain(value)
        return data

    def to_yaml(self) -> str:
        """Return the resolved configuration as YAML."""
        return dump_yaml(self.to_dict())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the resolved configuration as YAML, whole or not at all (else OSError)."""
        content = self.to_yaml().encode("utf-8")
        write_atomically(path, lambda file: file.write(content))

    @classmethod
    def from_dict(cls, mapping: Mapping[str, Any], source: str | None = None) -> TrainingConfig:
        """Make a configuration from plain values, or raise ConfigError.

        ``scene`` is a shipped name, a path, or the scene's own fields; beside it there may be
        ``overrides``, changes to the scene by dotted path. ``discount``, ``noise_hold`` and
        ``ppo.gae_lambda`` may be ``auto``: then they follow from the body's first period, see
        `swim_agents.learning.automatic`. Messages name the source.
        """
        known = [spec.name for spec in fields(cls)]
        with _located(source):
            if not isinstance(mapping, Mapping):
                raise ConfigError(
                    f"a configuration must be a mapping of fields, got {got(mapping)}"
                )
            given = check_fields(mapping, "", [*known, "overrides"])
            with _located(source, "scene: "):
                given["scene"] = _scene(given.pop("scene", "swimmer"), given.pop("overrides", None))
            kind = given.get("algorithm", "PPO")
            if kind in ALGORITHMS:  # another one is refused below
                given = resolve(given, given["scene"], kind)
            absent = [name for name in _BLOCKS if given.get(name) is None]
            return cls(**{name: value for name, value in given.items() if name not in absent})


def _scene(scene: object, overrides: object) -> Scene:
    """Return the scene that a configuration names or holds, with its overrides."""
    changes: Any = overrides
    if overrides is not None and not isinstance(overrides, (Mapping, list)):
        raise ConfigError(f"overrides must be a mapping or a list, got {got(overrides)}")
    return load_scene(scene, changes)  # type: ignore[arg-type]


def _changed(data: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a file's fields with changes by name or dotted path.

    Those of the scene join its overrides, so that what follows from the body does so after them.
    """
    found = dict(data)
    scene: dict[str, Any] = {}
    for path, value in changes.items():
        name, _, rest = str(path).partition(".")
        if name == "scene" and rest:
            scene[rest] = value
        elif rest and (name in _BLOCKS or name == "environment"):
            inner = found.get(name) or {}
            if not isinstance(inner, Mapping):
                raise ConfigError(f"{name} must be a mapping of fields, got {got(inner)}")
            found[name] = {**inner, rest: value}
        else:
            found[path] = value
    if scene:
        found["overrides"] = {**parse_overrides(found.get("overrides") or {}), **scene}
    return found


def _placed(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return a file's fields with the paths of scene and task, which are relative to it."""
    found = dict(data)
    scene, task = data.get("scene"), data.get("task")
    if isinstance(scene, str) and scene not in scene_names():
        given = Path(scene)
        is_path = given.suffix in (".yaml", ".yml") or len(given.parts) > 1
        if is_path or (folder / given).is_file():
            found["scene"] = os.path.normpath(folder / given)
    if isinstance(task, str) and task.rpartition(":")[0].endswith(".py"):
        found["task"] = os.fspath(folder.absolute() / task)
    return found


# ---- finding configurations --------------------------------------------------------------------


def _config_folder() -> Path:
    """Return the folder of the shipped configurations: in the wheel, or beside the package."""
    here = Path(__file__).parents[1]
    beside = here.parents[1] / "configs" / "agents"
    inside = here / "configs" / "agents"
    return inside if inside.is_dir() else beside


def config_names() -> tuple[str, ...]:
    """Return the names of the shipped configurations, sorted."""
    return tuple(sorted(path.stem for path in _config_folder().glob("*.yaml")))


def load_config(
    config: str | os.PathLike[str],
    overrides: list[str] | Mapping[str, Any] | None = None,
    scene: str | os.PathLike[str] | None = None,
) -> TrainingConfig:
    """Read a configuration, put another scene into it, and change fields of it.

    Parameters
    ----------
    config : str or os.PathLike
        A shipped name (see `config_names`) or the path of a YAML file.
    overrides : list of str or mapping, optional
        Changes such as ``"steps=100000"``, ``"ppo.epochs=10"`` or ``"scene.beam.elements=18"``, the
        values read as YAML. What is left to the body, in the configuration or in the scene's file,
        follows from the body with all changes.
    scene : str or os.PathLike, optional
        A shipped scene or a scene's file, in the place of the configuration's own; the agent is
        named after both. The configuration's ``overrides`` change this scene as well.

    Raises
    ------
    ConfigError
        If there is no such file, or it or an override cannot be used.

    Examples
    --------
    >>> load_config("ppo_forward", ["steps=1000000"]).steps
    1000000
    """
    given = os.fspath(config)
    path, source = Path(given), given
    if given in config_names():
        path, source = _config_folder() / f"{given}.yaml", f"configs/agents/{given}.yaml"
    if not path.exists():
        names = config_names()
        raise ConfigError(
            f"no such configuration: {given}{nearest(path.stem, names)}; shipped: "
            f"{', '.join(names) or 'none'}"
        )
    try:
        text = read_text(path, source)
        data: Any = parse_yaml(text, source)
    except SceneError as error:
        problem = error.problem.replace("the scene file", "the configuration")
        raise ConfigError(problem, error.source) from None
    if data is None:
        raise ConfigError("the file is empty, must hold a training configuration", source)
    if isinstance(data, dict):
        data = {"name": path.stem, **_placed(data, path.parent)}
    if scene is not None and isinstance(data, dict):
        with _located():
            body = load_scene(scene).name
        data = {**data, "name": file_name(f"{data['name']}_{body}"), "scene": scene}
    found = TrainingConfig.from_dict(data, source)  # errors of the file are not those of changes
    with _located(f"{source} with overrides"):
        changes = parse_overrides(overrides or {})
        return TrainingConfig.from_dict(_changed(data, changes)) if changes else found
