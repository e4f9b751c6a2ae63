"""A window that shows frames in real time, or one line of text where there is no display."""

from __future__ import annotations

import importlib
import os
import sys
import time
import warnings
import weakref
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

Frame = NDArray[np.uint8]

_NO_WINDOW = (
    "swim_env: no window, {why}; to see an episode, use render_mode='rgb_array' with "
    "gymnasium.wrappers.RecordVideo, or swim-env replay --env --record-video FOLDER{cure}"
)
_CURE = ", or install the extra 'view' (pip install 'swim-env[view]')"
_CLOSED = "swim_env: the window was closed; the environment continues without it"
_printed: set[str] = set()

#: Drivers of SDL, and the variables that name the displays that they show on.
_SERVERS = (("x11", "DISPLAY"), ("wayland", "WAYLAND_DISPLAY"))


def _print_once(line: str) -> None:
    """Write a line to stderr, once per process."""
    if line not in _printed:
        _printed.add(line)
        print(line, file=sys.stderr, flush=True)


class Window:
    """Shows frames, no faster than real time.

    A process has one window at most; several of these objects share it. Without a display, and
    after the user has closed the window, frames are dropped without delay. The rate is that of the
    frames in a second of real time.
    """

    #: Those that show their frames: the last one to be closed closes the window.
    _showing: ClassVar[weakref.WeakSet[Window]] = weakref.WeakSet()

    def __init__(self, title: str, rate: float) -> None:
        self._title = title
        self._period = 1.0 / rate
        self._due = 0.0
        self._pygame = _ready_pygame()
        if self._pygame is not None:
            self._showing.add(self)

    @property
    def is_open(self) -> bool:
        """Whether frames are shown."""
        return self in self._showing

    def show(self, frame: Frame) -> None:
        """Show a frame, (height, width, 3), when it is due."""
        pygame = self._pygame
        if pygame is None or not self.is_open:
            return
        height, width = frame.shape[:2]
        screen = pygame.display.get_surface()
        if screen is None or screen.get_size() != (width, height):
            screen = pygame.display.set_mode((width, height))
        pygame.display.set_caption(self._title)
        screen.blit(pygame.image.frombuffer(frame.tobytes(), (width, height), "RGB"), (0, 0))
        time.sleep(max(0.0, self._due - time.monotonic()))
        # A frame that comes late moves the later ones: no rush to make up for it.
        self._due = max(self._due, time.monotonic()) + self._period
        pygame.display.flip()
        if any(event.type == pygame.QUIT for event in pygame.event.get()):
            self._showing.clear()
            pygame.display.quit()
            _print_once(_CLOSED)

    def close(self) -> None:
        """Show no more frames. Closing twice does no harm."""
        if self.is_open:
            self._showing.discard(self)
            if not self._showing:
                self._pygame.display.quit()


def _ready_pygame() -> Any:
    """Return pygame with its display started, or None after a line on stderr."""
    chosen = os.environ.get("SDL_VIDEODRIVER")
    # SDL's own search would try drivers that show nothing, and print lines about it.
    found = ",".join(driver for driver, name in _SERVERS if os.environ.get(name))
    if chosen or found or sys.platform in ("darwin", "win32"):
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        # SDL would turn SIGTERM into a closed window, and the program could not be ended by it.
        os.environ.setdefault("SDL_NO_SIGNAL_HANDLERS", "1")
        try:
            with warnings.catch_warnings():
                # pygame imports pkg_resources where it finds it, which warns about itself.
                warnings.simplefilter("ignore")
                importlib.import_module("PIL.Image")
                import pygame
        except ImportError as error:
            missing = "Pillow" if "PIL" in str(error) else "pygame"
            _print_once(_NO_WINDOW.format(why=f"{missing} is not installed", cure=_CURE))
            return None
        try:
            if found and not chosen:
                os.environ["SDL_VIDEODRIVER"] = found
            pygame.display.init()
            # Drivers that show nothing count only where the environment asks for them.
            if chosen or pygame.display.get_driver() not in ("dummy", "offscreen"):
                return pygame
            pygame.display.quit()
        except pygame.error:
            pass
        finally:
            if not chosen:
                os.environ.pop("SDL_VIDEODRIVER", None)
    _print_once(_NO_WINDOW.format(why="there is no display", cure=""))
    return None
