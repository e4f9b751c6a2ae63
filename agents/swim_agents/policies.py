"""Finding a policy by its name, or by where it was saved."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path

from swim_agents.baselines import (
    POLICY_NAMES,
    PRESCRIBED_WAVES,
    SPATIAL_POLICY_NAMES,
    TUNED_WAVES,
    Policy,
    RandomPolicy,
    WavePolicy,
    ZeroPolicy,
    paper_wave,
    spatial_wave,
    tuned_wave,
)
from swim_agents.optimal_gait import GAIT_SUFFIX, GOALS, OptimalGait, find_optimal_gait, load_gait
from swim_agents.tuned_wave import SUFFIX
from swim_env.envs.interface import SceneLike
from swim_env.envs.tasks import check_task
from swim_env.errors import OptionError
from swim_env.files.names import file_name
from swim_env.scene import Scene, load_scene, scene_label, scene_names
from swim_env.scene.checks import nearest

__all__ = [
    "PRETRAINED_FOLDER",
    "load_policy",
    "policy_label",
    "policy_names",
    "pretrained_names",
    "run_label",
]

_HERE = Path(__file__).parent
#: The trained agents that ship, a folder each: inside the package in a wheel, else beside it.
PRETRAINED_FOLDER = next(
    (folder for folder in (_HERE / "pretrained", _HERE.parent / "pretrained") if folder.is_dir()),
    _HERE / "pretrained",
)

#: Names of the gaits that were optimised.
_OPTIMAL = {f"optimal_{goal}": goal for goal in GOALS}
_BASELINES: dict[str, Callable[[Scene], WavePolicy | ZeroPolicy | OptimalGait]] = {
    "paper_wave": paper_wave,
    "tuned_wave": tuned_wave,
    "zero": ZeroPolicy,
    **{name: partial(spatial_wave, wave=wave) for name, wave in PRESCRIBED_WAVES.items()},
    **{name: partial(tuned_wave, wave=wave) for name, wave in TUNED_WAVES.items()},
    **{name: partial(find_optimal_gait, goal=goal) for name, goal in _OPTIMAL.items()},
}


def pretrained_names() -> tuple[str, ...]:
    """Return the names of the trained agents that ship, sorted."""
    return tuple(sorted(path.parent.name for path in PRETRAINED_FOLDER.glob("*/agent.json")))


def policy_names() -> tuple[str, ...]:
    """Return all names that `load_policy` knows."""
    return (*POLICY_NAMES, *SPATIAL_POLICY_NAMES, *_OPTIMAL, *pretrained_names())


def policy_label(policy: str) -> str:
    """Return what files of a policy are called: its name, with a digest of a path."""
    if policy in policy_names():
        return policy
    path = Path(policy).resolve()
    return file_name(path.name, str(path))


def run_label(
    scene: Scene, labels: Sequence[str], task: str = "forward", seed: int = 0, **settings: object
) -> str:
    """Return what files of a run are called, so that unlike runs have unlike names.

    Parameters
    ----------
    scene : Scene
        What is played, with the duration of its episode.
    labels : sequence of str
        What drives the bodies, as `policy_label` has it.
    task, seed
        Named where they are not ``forward`` and 0.
    settings : object
        All else that may differ; with any that is not None a digest of them is added.
    """
    parts = [scene_label(scene), *([] if task == "forward" else [task.rpartition(":")[2]]), *labels]
    if seed:
        parts.append(f"seed_{seed}")
    found = {name: value for name, value in settings.items() if value is not None}
    if ":" in task:
        found["task"] = task
    if parts[0] == scene.name:  # else the digest of the scene knows
        duration = scene.episode.duration
        if load_scene(scene.name).episode.duration != duration:
            found["duration"] = duration
    return file_name("-".join(parts), repr(sorted(found.items())) if found else "")


def trained_for(policies: Iterable[str]) -> tuple[Scene | str, str] | None:
    """Return the scene, by its name if it is a shipped one, and the task of the first agent there.

    None if no policy is a trained agent with an ``agent.json``; errors are those of `load_agent`.
    """
    from swim_agents.learning.saved import load_agent

    for policy in policies:
        path = Path(policy)
        runs = [run / "agent" for run in runs_in(path)]
        for folder in (PRETRAINED_FOLDER / policy, path, path / "agent", *runs):
            if (folder / "agent.json").is_file():
                agent = load_agent(folder)
                own = agent.scene
                shipped = own.name in scene_names() and load_scene(own.name) == own
                return (own.name if shipped else own), str(agent.description["task"])
    return None


def load_policy(
    policy: str | os.PathLike[str],
    scene: SceneLike | None = None,
    seed: int | None = None,
    task: str | None = None,
    trust: bool = False,
) -> Policy:
    """Return a policy for a scene: what has `Policy.predict`.

    Parameters
    ----------
    policy : str or os.PathLike
        ``paper_wave``: the scene's prescribed wave, no torque where it has none. ``tuned_wave``:
        the wave that was found to swim farthest, kept beside the scene's file by `swim-env tune`
        (or one that ships), for its body, fluid and damping alone. ``zero``: no torque.
        ``random``: uniform torques. In space, ``lateral_wave``, ``dorsoventral_wave``,
        ``helical_wave_right`` and ``helical_wave_left`` are the prescribed wave about other axes,
        see `spatial_wave`; ``tuned_wave`` is a lateral one, and ``tuned_dorsoventral``,
        ``tuned_helical_right`` and ``tuned_helical_left`` are the others. ``optimal_displacement``,
        ``optimal_efficiency`` and ``optimal_turn`` are what `swim-env optimise` found for the
        scene. A trained agent that ships, see `pretrained_names`. Or a path: an agent's folder, the
        folder of a training run (its best agent) or of several with a single agent among them, a
        model file (.zip) of stable-baselines3, a tuned wave (.tuned_wave.json) or an optimal gait
        (.optimal_gait.json).
    scene : Scene, str or os.PathLike, optional
        The scene to be played; unless given, ``swimmer`` for a baseline, and for an agent the one
        it was trained on.
    seed : int, optional
        Seed of a random policy.
    task : str, optional
        A task, as for `swim_env.envs.tasks.find_task`, to refuse an agent that was trained for
        another one.
    trust : bool
        Whether to unpickle a model file that comes without an ``agent.json``, which runs its code.
        Agents with that file are read without running any.

    Raises
    ------
    OptionError
        If there is no such policy, or several in a folder of runs, the scene has not the axes of a
        wave, or the tuned wave was tuned to another body.
    AgentError
        If a saved agent cannot be read, or was trained on another body or for another task.
    SceneError
        If there is no such scene.
    """
    found = load_scene("swimmer" if scene is None else scene)
    own = None if scene is None else found
    task = None if task is None else check_task(task)
    name = os.fspath(policy)
    if name == "random":
        return RandomPolicy(found, seed)
    if name in _BASELINES:
        baseline = _BASELINES[name](found)
        baseline.check(found, task)
        return baseline
    if name in pretrained_names():
        return _load_agent(PRETRAINED_FOLDER / name, own, task)
    path = Path(name)
    if name.endswith(GAIT_SUFFIX) and path.is_file():
        gait = load_gait(path, found)
        gait.check(found, task)
        return gait
    if name.endswith(SUFFIX) and path.is_file():
        wave = tuned_wave(found, path)
        wave.check(found, task)
        return wave
    if path.is_dir() or path.is_file() or path.suffix == ".zip":
        return _load_agent(_inside(path), own, task, trust)
    names = policy_names()
    raise OptionError(
        f"unknown policy {name!r}{nearest(name, names)}; policies: {', '.join(names)}, or the path "
        "of an agent"
    )


def runs_in(folder: str | os.PathLike[str]) -> list[Path]:
    """Return the training runs ``seed_N`` in a folder that have an agent, by their number."""
    runs = [path for path in Path(folder).glob("seed_*") if (path / "agent").is_dir()]
    return sorted(runs, key=lambda path: (len(str(path)), str(path)))


def _inside(path: Path) -> Path:
    """Return the agent's folder in that of a training run, or of several if it is the only one."""
    if (path / "agent").is_dir():
        return path / "agent"
    runs = runs_in(path)
    if len(runs) > 1:
        names = ", ".join(map(str, runs))
        raise OptionError(f"there are several agents in {path}; name one of {names}")
    return runs[0] / "agent" if runs else path


def _load_agent(path: Path, scene: Scene | None, task: str | None, trust: bool = False) -> Policy:
    """Read an agent's folder, or a model file, by its description where there is one."""
    # What it takes to read agents is imported only here.
    from swim_agents.learning.saved import AgentError, load_agent, load_bare_model

    if path.name == "model.zip" and (path.parent / "agent.json").is_file():
        path = path.parent
    if not path.exists():
        raise AgentError(f"no such model file: {path}")
    if path.is_dir():
        agent = load_agent(path)
    else:
        scene = scene or load_scene("swimmer")
        agent = load_bare_model(path, scene, trust, task)
    agent.check(scene or agent.scene, task)
    return agent
