"""Looking at a recording: rerun's viewer in a window, or a picture of it without one."""

from __future__ import annotations

import contextlib
import io
import math
import os
import shlex
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from swim_env.errors import OptionError, SwimError
from swim_env.files.atomic import write_atomically
from swim_env.recording.schema import TIMELINE
from swim_env.recording.writer import require_rerun

__all__ = ["check_picture", "open_viewer", "take_picture", "typed_command"]

#: Seconds that the viewer has to draw.
_TO_DRAW = 1.5
#: Seconds within which a viewer ends that finds no display.
_TO_FAIL = 1.0
#: Endings of pictures, and what they are written as.
_PICTURES = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG"}
#: Share of the window that its menu takes.
_MENU = 0.034


def rerun_command() -> str:
    """Return the path of rerun's program, beside this Python or on the path, or raise SwimError."""
    require_rerun()
    beside = Path(sys.executable).with_name("rerun")
    found = str(beside) if beside.exists() else shutil.which("rerun")
    if found is None:
        raise SwimError("the program rerun was not found; it comes with the extra 'view'")
    return found


def typed_command() -> str:
    """Return what to type for rerun's program here: its name, or its path where that is needed."""
    command = rerun_command()
    if shutil.which("rerun"):
        return "rerun"
    with contextlib.suppress(ValueError):  # on another drive
        return os.path.relpath(command)
    return command


def open_viewer(path: str | os.PathLike[str]) -> str | None:
    """Open rerun's viewer with the recording in a file, in a process of its own.

    Returns one line that says what to do where there is no display, or none that answers; None
    where a window opens.
    """
    command = rerun_command()
    has_display = sys.platform in ("darwin", "win32") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
    typed, file = typed_command(), os.fspath(path)
    browser = ["swim-env", "visualise", "--recording", file, "--web"]
    hint = (
        f"look at the recording with: {shlex.join([typed, file])} (on a machine with one) or "
        f"{shlex.join(browser)} (in a browser)"
    )
    if not has_display:
        return f"there is no display; {hint}"
    try:
        viewer = subprocess.Popen(
            [command, "--bind", "127.0.0.1", os.fspath(path)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
    except OSError as error:
        raise SwimError(f"cannot start rerun's viewer: {error.strerror or error}") from None
    # One that finds another viewer open hands the recording over and ends well.
    with contextlib.suppress(subprocess.TimeoutExpired):
        if viewer.wait(_TO_FAIL):
            return f"rerun's viewer has ended at once, no display answers it; {hint}"
    return None


def check_picture(picture: str | os.PathLike[str]) -> None:
    """Check that a picture can be written to a file, which ends with .png, .jpg or .jpeg."""
    file = Path(picture)
    if file.suffix.lower() not in _PICTURES:
        raise OptionError(f"a picture's name ends with {', '.join(_PICTURES)} ({file})")
    if file.is_dir():
        raise OptionError(f"a picture is a file, this is a folder ({file})")
    if not file.absolute().parent.is_dir():
        raise OptionError(f"no such folder for the picture ({file.parent})")
    if not os.access(file.absolute().parent, os.W_OK):
        raise OptionError(f"cannot write into the folder for the picture ({file.parent})")


def take_picture(
    recording: str | os.PathLike[str], picture: str | os.PathLike[str], time_shown: float
) -> list[str]:
    """Open a recording in rerun's viewer without a window, and keep what it shows.

    It takes a driver that draws, a graphics card's or Mesa's llvmpipe. The picture is a .png, .jpg
    or .jpeg file and shows some simulated time (s). Returns what the viewer complains of in its
    views.
    """
    rerun_command()
    check_picture(picture)
    if not 0.0 <= time_shown < math.inf:
        raise OptionError(f"a picture shows a time of at least 0 s, got {time_shown!r}")
    with _viewer() as viewer:
        viewer.open([os.path.abspath(recording)])
        viewer.set_time(TIMELINE, duration=time_shown, play_state="paused")
        time.sleep(_TO_DRAW)
        content = viewer.take_screenshot()
        state = viewer.get_state()
    if state.active_recording is None:
        raise SwimError(f"rerun's viewer does not show the recording ({os.fspath(recording)})")
    try:
        write_atomically(
            picture,
            lambda file: file.write(_tidy(content, _PICTURES[Path(picture).suffix.lower()])),
        )
    except OSError as error:
        raise SwimError(
            f"cannot write the picture: {error.strerror or error} ({os.fspath(picture)})"
        ) from error
    return [f"{view.name}: {report}" for view in state.views for report in view.reports]


def _tidy(content: bytes, kind: str) -> bytes:
    """Return a screenshot without the viewer's own menu, as JPEG or PNG."""
    from PIL import Image

    image = Image.open(io.BytesIO(content)).convert("RGB")
    menu = round(_MENU * image.height)
    out = io.BytesIO()
    options = {"quality": 85, "subsampling": 0} if kind == "JPEG" else {}
    image.crop((0, menu, image.width, image.height)).save(out, kind, optimize=True, **options)
    return out.getvalue()


@contextlib.contextmanager
def _viewer() -> Iterator[Any]:
    """Start a viewer without a window, and end it again."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    # Otherwise the viewer writes what it does to stderr.
    os.environ.setdefault("RUST_LOG", "error")
    viewer, failure = None, "cannot be started without a window"
    hint = (
        "; it may lack a graphics driver, for which Mesa's llvmpipe will do (on Debian, apt "
        "install mesa-vulkan-drivers)"
    )
    # The viewer's sockets need a folder, which not every system names.
    named = os.environ.get("XDG_RUNTIME_DIR")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        os.environ["XDG_RUNTIME_DIR"] = named or folder
        try:
            from rerun.experimental import ViewerClient

            # Rerun itself searches the path only, where a virtual environment's programs are not.
            viewer = ViewerClient.spawn(
                headless=True, port=port, hide_welcome_screen=True, executable_path=rerun_command()
            )
            # It answers before it has found a driver that draws, and ends where there is none.
            viewer.take_screenshot()
            failure, hint = "has failed", ""
            yield viewer
        except SwimError:
            raise
        except Exception as error:  # what a viewer that stops raises is not documented
            why = " ".join(str(error).split()) or type(error).__name__
            raise SwimError(f"rerun's viewer {failure}: {why}{hint}") from None
        finally:
            with contextlib.suppress(Exception):
                if viewer is not None:
                    viewer.quit()
            if not named:
                del os.environ["XDG_RUNTIME_DIR"]
