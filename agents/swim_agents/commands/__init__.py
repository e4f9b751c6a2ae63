"""The console command ``swim-env``, a module for each subcommand; the scripts call the same.

A subcommand has ``add_arguments(parser)`` and ``main(options)``, which returns an exit code or
raises a `SwimError`. Its module's docstring is its help text.

Importing this package makes Ctrl-C quiet from here on: the imports that follow take seconds.
"""

from __future__ import annotations

import _thread
import signal
import sys
import threading

TYPE_CHECKING = False  # without typing, which takes longer to import than all of the above
if TYPE_CHECKING:
    from types import FrameType, TracebackType

#: What Ctrl-C ends with where a command does not say more.
INTERRUPTED_TEXT = "interrupted; files that were finished are kept, no others were written"
#: Exit code of a command that the user has interrupted.
INTERRUPTED = 130

#: Parts of the names of files in whose functions Ctrl-C has to wait: imports, callbacks of
#: llvmlite, torch when it writes, callbacks of numba's types.
_UNSAFE = ("frozen importlib", "llvmlite", "serialization.py", "abstract.py")

_usual = sys.excepthook


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, once no module is imported, no kernel loaded, no model written.

    Raised there, it would abort the process, be swallowed, or become another error of torch.
    """
    while frame is not None:
        if any(name in frame.f_code.co_filename for name in _UNSAFE):
            again = threading.Timer(0.02, _thread.interrupt_main)
            again.daemon = True
            again.start()
            return
        frame = frame.f_back
    raise KeyboardInterrupt


def _one_line(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """End in one line where Ctrl-C is pressed before `run` takes care of it."""
    if issubclass(kind, KeyboardInterrupt):
        print(INTERRUPTED_TEXT, file=sys.stderr)
        raise SystemExit(INTERRUPTED)
    _usual(kind, error, trace)


sys.excepthook = _one_line
if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    try:
        signal.signal(signal.SIGINT, _interrupt)
    except ValueError:  # only the main thread may
        pass
