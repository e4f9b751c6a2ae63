"""Looking at a recording without a window: rerun's viewer in a browser, or in a notebook."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any
from urllib.parse import quote

from swim_env.errors import OptionError, SwimError, require_packages
from swim_env.recording.viewer import rerun_command

__all__ = ["WEB_PORT", "WebViewer", "check_web", "show", "web_viewer"]

#: The port of the viewer's page unless one is given, rerun's own.
WEB_PORT = 9090
#: Page and data are served on this address, which no other machine reaches.
_HOST = "127.0.0.1"
#: Seconds within which the page answers, and between two questions whether it does.
_TO_START, _PAUSE = 30.0, 0.05


class WebViewer:
    """A viewer that is being served.

    Parameters
    ----------
    address : str
        What to open in a browser.
    process : subprocess.Popen
        The server.
    """

    def __init__(self, address: str, process: subprocess.Popen[bytes]) -> None:
        self.address = address
        self._process = process

    def wait(self) -> None:
        """Wait until the server ends, which it does not by itself: SwimError."""
        code = self._process.wait()
        raise SwimError(f"rerun's viewer has ended by itself, with code {code}")


def check_web(port: int = WEB_PORT) -> None:
    """Check that rerun is there and that a port is free, or raise SwimError."""
    rerun_command()
    _free_port(port)


@contextlib.contextmanager
def web_viewer(path: str | os.PathLike[str], port: int = WEB_PORT) -> Iterator[WebViewer]:
    """Serve a recording and rerun's viewer to browsers on this machine, until the block ends.

    Parameters
    ----------
    path : str or os.PathLike
        The recording.
    port : int
        Where the page is served; 0 takes any port that is free. The data have a free port of their
        own. Both are bound to 127.0.0.1.

    Yields
    ------
    WebViewer
        Its `address` answers.

    Raises
    ------
    SwimError
        If rerun is not there, the port is taken, or the viewer ends at once.
    """
    rerun_command()
    if not Path(path).is_file():
        raise SwimError(f"no such recording ({os.fspath(path)})")
    page, data = _free_port(port), _free_port(0)
    with tempfile.TemporaryFile() as complaints, _unwound_by_sigterm():
        try:
            process = subprocess.Popen(
                [
                    _program(), "--serve-web", "--bind", _HOST, "--port", str(data),
                    "--web-viewer-port", str(page), os.path.abspath(path),
                ],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=complaints,
                env={**os.environ, "RUST_LOG": "error"},
            )  # fmt: skip
        except OSError as error:
            raise SwimError(f"cannot start rerun's viewer: {error.strerror or error}") from None
        try:
            _wait_for(page, process, complaints)
            source = quote(f"rerun+http://{_HOST}:{data}/proxy", safe="")
            yield WebViewer(f"http://{_HOST}:{page}/?url={source}", process)
        finally:
            process.terminate()
            process.wait()


def show(path: str | os.PathLike[str], height: int = 600) -> Any:
    """Show a recording in a notebook, in the cell whose last line this is.

    The viewer runs in the browser, wherever the notebook does, and fetches its code from
    rerun's site; ``RERUN_NOTEBOOK_ASSET=inline`` in the environment takes the code that is
    installed.

    Parameters
    ----------
    path : str or os.PathLike
        The recording.
    height : int
        Of the viewer (pixels); it is as wide as the cell.

    Returns
    -------
    rerun_notebook.Viewer
        A widget.

    Raises
    ------
    SwimError
        If the file cannot be read or rerun-notebook is not there.
    """
    require_packages("recordings in notebooks need", {"rerun_notebook": "rerun-notebook"}, "view")
    from rerun_notebook import Viewer

    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise SwimError(
            f"cannot read the recording: {error.strerror or error} ({os.fspath(path)})"
        ) from None
    viewer = Viewer(width="auto", height=height)
    viewer.send_rrd(content)
    return viewer


def _free_port(port: int) -> int:
    """Return a port that nobody listens on, any for 0, or raise OptionError."""
    if not 0 <= port < 1 << 16:
        raise OptionError(f"a port is a number from 0 to 65535, got {port}")
    with socket.socket() as probe:
        if os.name == "posix":  # a port whose last user has just ended is free
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((_HOST, port))
        except OSError as error:
            why = error.strerror or error
            raise OptionError(f"cannot serve on port {port}, choose another: {why}") from None
        return int(probe.getsockname()[1])


def _wait_for(port: int, process: subprocess.Popen[bytes], complaints: IO[bytes]) -> None:
    """Wait until a port answers; SwimError with the last complaint if the process ends first."""
    latest = time.monotonic() + _TO_START
    while time.monotonic() < latest:
        if process.poll() is not None:
            complaints.seek(0)
            lines = complaints.read().decode(errors="replace").split("\n")
            said = [line for line in lines if line.strip()] or ["it says nothing"]
            raise SwimError(f"rerun's viewer has ended at once: {said[-1].strip()}")
        with contextlib.suppress(OSError), socket.create_connection((_HOST, port), 1.0):
            return
        time.sleep(_PAUSE)
    raise SwimError(f"rerun's viewer has not answered within {_TO_START:g} s")


@contextlib.contextmanager
def _unwound_by_sigterm() -> Iterator[None]:
    """Raise SystemExit where the process is told to end, so that the server ends with it."""
    ours = False
    with contextlib.suppress(ValueError):  # only the main thread may
        if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
            signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
            ours = True
    try:
        yield
    finally:
        if ours:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _program() -> str:
    """Return rerun's program itself: what its package puts on the path is a script around it."""
    with contextlib.suppress(ImportError):
        import rerun_cli

        folder = Path(rerun_cli.__file__).parent
        for name in ("Rerun.app/Contents/MacOS/Rerun", "rerun.exe", "rerun"):
            if (folder / name).is_file():
                return str(folder / name)
    return rerun_command()
