"""The console command ``swim-env``, a module for each subcommand; the scripts call the same.

A subcommand has ``add_arguments(parser)`` and ``main(options)``, which returns an exit code or
raises a `SwimError`. Its module's docstring is its help text.
"""

import sys
from types import TracebackType

#: What Ctrl-C ends with where a command does not say more.
INTERRUPTED_TEXT = "interrupted; files that were finished are kept, no others were written"
#: Exit code of a command that the user has interrupted.
INTERRUPTED = 130

_usual = sys.excepthook


def _one_line(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Say in one line that Ctrl-C was pressed while the modules of a command were imported."""
    if issubclass(kind, KeyboardInterrupt):
        print(INTERRUPTED_TEXT, file=sys.stderr)
        raise SystemExit(INTERRUPTED)
    _usual(kind, error, trace)


# Imports take a second, before a command can do anything about Ctrl-C.
sys.excepthook = _one_line
