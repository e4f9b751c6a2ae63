"""What the commands share: common options, progress, tables, and errors as one line."""

from __future__ import annotations

import argparse
import contextlib
import errno
import io
import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO, cast

from tqdm import tqdm

from swim_agents.commands import INTERRUPTED, INTERRUPTED_TEXT
from swim_agents.policies import policy_names, trained_for
from swim_env.accuracy.choice import Choice, choose
from swim_env.envs.tasks import NOISE, SEED, TASKS
from swim_env.errors import SwimError
from swim_env.scene import Scene, load_scene, scene_names
from swim_env.scene.checks import checked_option
from swim_env.scene.yaml import parse_overrides

#: Exit codes: the machine failed, bad input.
FAILED, BAD_INPUT = 1, 2
#: What Ctrl-C ends with where the next start continues.
STUDY_INTERRUPTED = "interrupted; what was done is kept, start again to continue"

#: What is not the input's fault: a full disk, a file beyond a limit, a broken disk.
_FAILURES = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO}


# ---- options -----------------------------------------------------------------------------------


#: Options that several commands have.
_SHARED: dict[str, dict[str, Any]] = {
    "duration": {
        "type": float,
        "metavar": "S",
        "help": "simulated time in seconds, rounded to whole steps (or, in an episode, actions); "
        "the scene's own unless given",
    },
    "task": {
        "help": f"of an episode: {', '.join(TASKS)}, or module:Class or FILE.py:Class of your own; "
        "forward unless given"
    },
    "task-option": {
        "action": "extend",
        "nargs": "+",
        "default": [],
        "metavar": "NAME=VALUE",
        "help": "options of the task, for example reach=2 of station",
    },
    "seed": {"type": int, "help": "of an episode's start and of random torques; 0 unless given"},
    "noise": {
        "type": float,
        "metavar": "X",
        "help": "factor on the noise of an episode's start; 1 unless given",
    },
    "record": {
        "metavar": "PLACE",
        "help": "write a recording for rerun, with the fluid, into this file (.rrd) or folder",
    },
    "accuracy": {
        "type": float,
        "metavar": "TOLERANCE",
        "help": "choose the cheapest settings (fluid model, panels, elements, time step, scheme) "
        "that are known to compute the scene's displacement under its prescribed torque to this "
        "share, for example 1e-2",
    },
    "json": {"action": "store_true", "help": "print the results as one JSON line"},
}


def add_options(parser: argparse.ArgumentParser, *names: str) -> None:
    """Add options that several commands have."""
    for name in names:
        parser.add_argument(f"--{name}", **_SHARED[name])


def add_overrides(parser: argparse.ArgumentParser, subject: str, example: str) -> None:
    """Add ``--set``, which changes fields."""
    parser.add_argument(
        "--set",
        action="extend",
        nargs="+",
        default=[],
        metavar="FIELD=VALUE",
        help=f"change fields of the {subject}, for example {example}",
    )


def add_scene_arguments(
    parser: argparse.ArgumentParser,
    default: str | None = None,
    accuracy: bool = False,
    adopted: bool = False,
) -> None:
    """Add ``--scene``, ``--set`` and ``--json``, and ``--accuracy`` where that has a meaning.

    A default that may be `adopted` from an agent is left open.

    Settings are chosen by playing the prescribed torque, so they say nothing about a policy.
    """
    parser.add_argument(
        "--scene",
        default=None if adopted else default,
        required=default is None,
        metavar="NAME",
        help=f"a shipped scene ({', '.join(scene_names())}) or the path of a scene file"
        + (f"; unless given, that of the first trained agent, else {default}" if adopted else ""),
    )
    add_overrides(parser, "scene", "beam.elements=27 damping=null")
    add_options(parser, *(["accuracy"] if accuracy else []), "json")


def scene_of(options: argparse.Namespace) -> Scene:
    """Return the scene that the options of `add_scene_arguments` name.

    A ``--duration`` among them is what ``--accuracy`` judges settings on.
    """
    scene = load_scene(options.scene, options.set)
    tolerance = getattr(options, "accuracy", None)
    if tolerance is None:
        return scene
    return chosen(scene, tolerance, duration=getattr(options, "duration", None)).scene


def adopt(options: argparse.Namespace, policies: Iterable[str], scene: str = "swimmer") -> None:
    """Take the scene and the task that the options leave open from the first trained agent."""
    if options.scene is None or options.task is None:
        own, task = trained_for(policies) or (scene, "forward")
        options.scene = own if options.scene is None else options.scene
        options.task = task if options.task is None else options.task


def chosen(
    scene: Scene, tolerance: float, keep_elements: bool = False, duration: float | None = None
) -> Choice:
    """Return what `swim_env.accuracy.choose` chooses; progress and the reason go to stderr."""
    with progress_bar(40, "run", "choosing settings") as progress:
        choice = choose(scene, tolerance, keep_elements, duration, progress)
    print(f"chosen {choice.reason}", file=sys.stderr)
    return choice


def task_options(options: argparse.Namespace) -> dict[str, object]:
    """Return the options of the task by name."""
    for text in options.task_option:
        if not text.partition("=")[1]:
            raise SwimError(f"--task-option must read NAME=VALUE, as in reach=2, got {text!r}")
    return parse_overrides(options.task_option)


def played_scene(scene: Scene, duration: float | None) -> Scene:
    """Return a scene with the duration (s) of its episode, its own unless given."""
    return scene if duration is None else scene.replace("episode.duration", duration)


def refuse(options: argparse.Namespace, names: Sequence[str], problem: str) -> None:
    """Refuse options that were given, all for one reason."""
    for name in names:
        given = getattr(options, name)
        if given is not None and given is not False and given != []:
            raise SwimError(f"--{name.replace('_', '-')} {problem}")


def check_numbers(options: argparse.Namespace) -> None:
    """Refuse numbers among the common options that no run can use."""
    for name, check in (("seed", SEED), ("noise", NOISE)):
        value = getattr(options, name, None)
        if value is not None:
            checked_option(check, value, f"--{name}")


def check_places(
    inputs: Iterable[str | None],
    own: Mapping[str, str | None],
    shared: Mapping[str, str | None] | None = None,
) -> None:
    """Refuse results in one place, or in the place of what is read.

    Parameters
    ----------
    inputs : iterable of str
        What is read: files and folders; names of shipped scenes and policies do not matter.
    own : mapping
        By option the files, and the folders that are replaced whole: nothing else goes there.
    shared : mapping, optional
        By option other places, such as folders that may hold anything.
    """
    places = {option: path for option, path in {**own, **(shared or {})}.items() if path}
    read = [one for one in inputs if one and one not in (*scene_names(), *policy_names())]
    read = [one for one in read if os.path.exists(one)]
    for option, place in places.items():
        for one in read:
            if os.path.realpath(one) == os.path.realpath(place) or (
                option in own and _is_within(one, place)
            ):
                raise SwimError(f"{option} would replace what is read ({one}); name another place")
    for option in [option for option in own if option in places]:
        for other, path in places.items():
            if other != option and _is_within(path, places[option]):
                raise SwimError(f"{option} and {other} need different places, got {path} for both")


def _is_within(path: str, place: str) -> bool:
    """Return whether a path is a place or lies in it."""
    real, around = Path(os.path.realpath(path)), Path(os.path.realpath(place))
    return around in (real, *real.parents)


# ---- output ------------------------------------------------------------------------------------


def print_result(result: Any, as_json: bool, text: Callable[[], str]) -> None:
    """Print a result as one JSON line or as text."""
    print(json.dumps(result, allow_nan=False) if as_json else text())


@contextlib.contextmanager
def progress_bar(
    total: int, unit: str, label: str, **options: Any
) -> Iterator[Callable[..., None]]:
    """Show a progress bar on stderr, once a second has passed.

    Yields a function of the steps since its last call, and of a text to show behind the bar, which
    0 steps show at once. Parts of a unit count once they are whole. `options` are those of
    `tqdm.tqdm`.
    """
    options = {"unit": unit, "desc": label, "delay": 1.0, "leave": False, **options}
    with tqdm(total=total, file=sys.stderr, **options) as bar:
        done = 0.0

        def update(steps: float, text: str = "") -> None:
            nonlocal done
            before, done = int(done + 1e-6), done + steps
            bar.set_postfix_str(text, refresh=False)
            bar.update(int(done + 1e-6) - before)
            if not steps and time.time() >= bar.start_t + bar.delay:  # the text alone is new
                bar.refresh()

        yield update


@contextlib.contextmanager
def share_bar(label: str) -> Iterator[Callable[[float], None]]:
    """Show a `progress_bar` of work that is reported in shares, which come to 1."""
    bar_format = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}<{remaining}"
    with progress_bar(1000, "", label, bar_format=bar_format) as bar:
        yield lambda share: bar(1000.0 * share)


# ---- exit codes --------------------------------------------------------------------------------


def run(
    main: Callable[[list[str] | None], int],
    arguments: list[str] | None = None,
    interrupted: str = INTERRUPTED_TEXT,
) -> int:
    """Run a main function and return its exit code.

    Errors of the package become one line on stderr and exit code 2, or 1 where the disk is full or
    broken, Ctrl-C becomes the line `interrupted`. A reader of standard output that has gone away
    ends the command quietly.
    """
    _open_streams()
    try:
        code = main(arguments)
        sys.stdout.flush()
        return code
    except SwimError as error:
        print(f"error: {error}", file=sys.stderr)
        return FAILED if _machine_failed(error) else BAD_INPUT
    except BrokenPipeError:
        _drop_output()
        return 0
    except OSError as error:
        if not error.filename:  # standard output is full: what waits for it is lost
            _drop_output()
        where = f" ({error.filename})" if error.filename else ""
        print(f"error: {error.strerror or error}{where}", file=sys.stderr)
        return FAILED
    except MemoryError:
        print(
            "error: the run does not fit into memory; make it shorter or coarser", file=sys.stderr
        )
        return FAILED
    except KeyboardInterrupt:
        print(interrupted, file=sys.stderr)
        return INTERRUPTED


def _drop_output() -> None:
    """Send what standard output still holds nowhere; Python would fail on it as it ends."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _open_streams() -> None:
    """Let standard output and error take any text; where they are closed, nothing is shown."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    if sys.stderr is sys.__stderr__:
        sys.stderr = cast(TextIO, _Messages(sys.stderr))


class _Messages:
    """Standard error. What it cannot show is lost, and not what is being computed."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        with contextlib.suppress(OSError):
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        with contextlib.suppress(OSError):
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def _machine_failed(error: BaseException) -> bool:
    """Return whether an error comes from a full or broken disk."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, OSError) and cause.errno in _FAILURES:
            return True
        cause = cause.__cause__ or cause.__context__
    return False
