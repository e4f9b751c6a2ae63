"""Finding a task: a shipped name, a class by where it is, a class, or one that is made already."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import os
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from swim_env.envs.tasks.base import FILE_OF_MODULE, SCRIPT, Task
from swim_env.envs.tasks.efficient import EfficientTask
from swim_env.envs.tasks.forward import ForwardTask
from swim_env.envs.tasks.path import PathTask
from swim_env.envs.tasks.station import StationTask
from swim_env.envs.tasks.target import TargetTask
from swim_env.envs.tasks.turn import TurnTask
from swim_env.errors import OptionError
from swim_env.scene import Scene
from swim_env.scene.checks import got, nearest

#: A shipped name, ``module:Class``, ``FILE.py:Class``, a class, or a task of the scene.
TaskLike = str | type[Task] | Task

#: The tasks that ship, by name.
TASKS: dict[str, type[Task]] = {
    "forward": ForwardTask,
    "target": TargetTask,
    "turn": TurnTask,
    "station": StationTask,
    "efficient": EfficientTask,
    "path": PathTask,
}
for _name, _kind in TASKS.items():
    _kind.name = _name


def check_task(task: str, folder: str | os.PathLike[str] | None = None) -> str:
    """Return the name of a task, by which it is found from anywhere; errors as of `find_task`."""
    return find_task(task, folder).name


def find_task(task: str | type[Task], folder: str | os.PathLike[str] | None = None) -> type[Task]:
    """Return the class of a task.

    Parameters
    ----------
    task : str or type
        A shipped name; ``module:Class``, which is imported, also from the present folder;
        ``FILE.py:Class``; or the class.
    folder : str or os.PathLike, optional
        What the path of a file is relative to; the present folder unless given.

    Raises
    ------
    OptionError
        If there is no such task.
    """
    if isinstance(task, type) and issubclass(task, Task):
        return task
    if not isinstance(task, str):
        raise OptionError(
            f"task must be a name, module:Class, a Task class or a task, got "
            f"{task.__name__ if isinstance(task, type) else got(task)}"
        )
    if task in TASKS:
        return TASKS[task]
    place, colon, name = task.rpartition(":")
    if not (colon and place and name):
        raise OptionError(
            f"unknown task {task!r}{nearest(task, TASKS)}; tasks: {', '.join(TASKS)}, or "
            "module:Class (or FILE.py:Class) of your own"
        )
    module = _from_file(Path(folder or "."), place) if place.endswith(".py") else _module(place)
    found: Any = module
    for part in name.split("."):
        found = getattr(found, part, None)
    if not (isinstance(found, type) and issubclass(found, Task)):
        names = [one for one, kind in vars(module).items() if _is_own(kind, module)]
        if place in SCRIPT:
            raise OptionError(
                f"task {name} was defined at a prompt, where no other process finds it: put its "
                "class into a module (module:Class or FILE.py:Class)"
            )
        raise OptionError(
            f"no task {name!r} in {place}{nearest(name, names)}; tasks there: "
            f"{', '.join(names) or 'none'}"
        )
    return found


def _is_own(kind: object, module: ModuleType) -> bool:
    return isinstance(kind, type) and issubclass(kind, Task) and kind.__module__ == module.__name__


def _module(name: str) -> ModuleType:
    """Import a module; the present folder is looked in as well."""
    here = os.getcwd()
    added = here not in sys.path and "" not in sys.path
    if added:
        sys.path.append(here)
    try:
        return importlib.import_module(name)
    except (ImportError, SyntaxError, ValueError) as error:
        raise OptionError(f"cannot import the module of task {name}:...: {error}") from error
    finally:
        if added:
            sys.path.remove(here)


def _from_file(folder: Path, place: str) -> ModuleType:
    """Return the module of a file, which is read once in a process."""
    file = (folder / place).resolve()
    for name in SCRIPT:
        script = sys.modules.get(name)
        if script is not None and Path(getattr(script, "__file__", None) or "").resolve() == file:
            return script
    digest = hashlib.sha256(os.fsencode(file)).hexdigest()[:16]
    name = f"swim_env_task_{file.stem}_{digest}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, file)
    if not file.is_file() or spec is None or spec.loader is None:
        raise OptionError(f"no such file with a task: {place} ({file})")
    module = importlib.util.module_from_spec(spec)
    setattr(module, FILE_OF_MODULE, os.fspath(file))
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException as error:
        del sys.modules[name]
        if isinstance(error, (ImportError, SyntaxError)):
            raise OptionError(f"cannot read the task's file: {error} ({file})") from error
        raise
    return module


def make_task(task: TaskLike, scene: Scene, options: Mapping[str, Any] | None = None) -> Task:
    """Return a task of a scene.

    Parameters
    ----------
    task : str, type or Task
        As for `find_task`, or a task that is made already.
    scene : Scene
        The scene.
    options : mapping, optional
        Arguments of the task's class beside the scene.

    Raises
    ------
    OptionError
        If there is no such task, or it cannot be made.
    """
    if isinstance(task, Task):
        if options:
            raise OptionError(
                f"task_options have no meaning for a task that is made already, got "
                f"{', '.join(options)}"
            )
        if task.scene != scene:
            raise OptionError(
                f"the task was made for scene {task.scene.name}, another one than scene "
                f"{scene.name}: give the scene that it was made for"
            )
        return task
    kind = find_task(task)
    if options is not None and not isinstance(options, Mapping):
        raise OptionError(f"task_options must be a mapping of arguments, got {got(options)}")
    given = dict(options or {})
    check_options(kind, given)
    try:
        made = kind(scene, **given)
    except TypeError as error:
        # A class that hands on **options to one that does not take them.
        refused = re.search(r"unexpected keyword argument '(\w+)'", str(error))
        if refused is None or refused[1] not in given:
            raise
        raise OptionError(f"unknown option {refused[1]!r} of task {kind.name}: {error}") from error
    if getattr(made, "scene", None) is not scene:
        raise OptionError(f"task {kind.name}: its __init__ must call super().__init__(scene)")
    return made


def task_options(kind: type[Task]) -> tuple[str, ...] | None:
    """Return the names of a class's arguments beside the scene, None where it takes any."""
    rest = _arguments(kind)
    if any(one.kind is one.VAR_KEYWORD for one in rest):
        return None
    return tuple(one.name for one in rest if one.kind is not one.VAR_POSITIONAL)


def _arguments(kind: type[Task]) -> list[inspect.Parameter]:
    """Return the arguments of a class beside the scene."""
    _, *found = inspect.signature(kind.__init__).parameters.values()
    if not found or found[0].kind in (
        inspect.Parameter.KEYWORD_ONLY,
        inspect.Parameter.VAR_KEYWORD,
    ):
        raise OptionError(
            f"task {kind.name}: its __init__ must take the scene first, as in "
            "def __init__(self, scene, ...)"
        )
    return found[1:]


def check_options(kind: type[Task], given: Mapping[str, Any]) -> None:
    """Refuse arguments that a task's class does not take (OptionError), or lacks."""
    known = task_options(kind)
    for name in given:
        if known is not None and name not in known:
            raise OptionError(
                f"unknown option {name!r} of task {kind.name}{nearest(str(name), known)}; it takes "
                f"{', '.join(known) or 'none'}"
            )
    for one in _arguments(kind):
        fixed = one.kind not in (one.VAR_KEYWORD, one.VAR_POSITIONAL)
        if fixed and one.default is one.empty and one.name not in given:
            raise OptionError(f"task {kind.name} needs the option {one.name!r}")
