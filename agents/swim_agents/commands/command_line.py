"""What the scripts share: the scene's arguments, progress, and errors as one line."""

from __future__ import annotations

import argparse
import contextlib
import errno
import os
import sys
from collections.abc import Callable, Iterator

from tqdm import tqdm

from swim_env.accuracy.choice import choose
from swim_env.errors import SwimError
from swim_env.scene import Scene, load_scene, scene_names

__all__ = ["add_scene_arguments", "progress_bar", "run", "scene_of", "training_bar"]

#: Exit codes: the machine failed, bad input, interrupted by the user.
FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130

#: What is not the input's fault: a full disk, a file beyond a limit, a broken disk.
_FAILURES = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO}


def add_scene_arguments(
    parser: argparse.ArgumentParser, default: str | None = None, accuracy: bool = False
) -> None:
    """Add ``--scene`` and ``--set`` to a parser, and ``--accuracy`` where that has a meaning.

    Settings are chosen by the prescribed torque, so it has none where somebody else plays.
    """
    shipped = ", ".join(scene_names())
    parser.add_argument(
        "--scene",
        default=default,
        required=default is None,
        metavar="NAME",
        help=f"a shipped scene ({shipped}) or the path of a scene file",
    )
    parser.add_argument(
        "--set",
        dest="overrides",
        action="extend",
        nargs="+",
        default=[],
        metavar="FIELD=VALUE",
        help="change fields of the scene, for example beam.elements=27 damping=null",
    )
    if accuracy:
        parser.add_argument(
            "--accuracy",
            type=float,
            metavar="TOLERANCE",
            help="choose the cheapest settings (fluid model, panels, elements, time step, scheme) "
            "that are known to compute the scene's displacement under its prescribed torque to "
            "this share, for example 1e-2",
        )


def scene_of(arguments: argparse.Namespace) -> Scene:
    """Return the scene that the arguments of `add_scene_arguments` name.

    A ``--duration`` among them is what ``--accuracy`` judges settings on.
    """
    scene = load_scene(arguments.scene, arguments.overrides)
    if getattr(arguments, "accuracy", None) is None:
        return scene
    duration = getattr(arguments, "duration", None)
    with progress_bar(40, "run", "choosing settings") as progress:
        choice = choose(scene, arguments.accuracy, duration=duration, progress=progress)
    print(f"chosen {choice.reason}", file=sys.stderr)
    return choice.scene


@contextlib.contextmanager
def progress_bar(total: int, unit: str, label: str) -> Iterator[Callable[[float], object]]:
    """Show a progress bar on stderr, once a second has passed; yields its update function.

    Parts of a unit count once they are whole.
    """
    with tqdm(total=total, unit=unit, desc=label, delay=1.0, file=sys.stderr, leave=False) as bar:
        done = 0.0

        def update(steps: float) -> None:
            nonlocal done
            before, done = int(done + 1e-6), done + steps
            bar.update(int(done + 1e-6) - before)

        yield update


@contextlib.contextmanager
def training_bar(total: int, label: str) -> Iterator[Callable[[int, str], object]]:
    """Show a progress bar on stderr with a text behind it, once a second has passed.

    Yields a function of steps and that text.
    """
    with tqdm(
        total=total,
        unit="step",
        unit_scale=True,
        desc=label,
        delay=1.0,
        file=sys.stderr,
        mininterval=0.5,
    ) as bar:

        def update(steps: int, text: str) -> None:
            bar.set_postfix_str(text, refresh=False)
            bar.update(steps)

        yield update


def run(main: Callable[[list[str] | None], int], arguments: list[str] | None = None) -> int:
    """Run a script's main function and return its exit code.

    Errors of the package become one line on stderr and exit code 2, or 1 where the disk is full or
    broken. A reader of standard output that goes away ends the script quietly.
    """
    try:
        code = main(arguments)
        sys.stdout.flush()
        return code
    except SwimError as error:
        print(f"error: {error}", file=sys.stderr)
        return FAILED if _machine_failed(error) else BAD_INPUT
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        where = f" ({error.filename})" if error.filename else ""
        print(f"error: {error.strerror or error}{where}", file=sys.stderr)
        return FAILED
    except MemoryError:
        print(
            "error: the run does not fit into memory; make it shorter or coarser", file=sys.stderr
        )
        return FAILED
    except KeyboardInterrupt:
        print("interrupted, nothing was written", file=sys.stderr)
        return INTERRUPTED


def _machine_failed(error: BaseException) -> bool:
    """Tell whether an error says of a full or broken disk."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, OSError) and cause.errno in _FAILURES:
            return True
        cause = cause.__cause__ or cause.__context__
    return False
