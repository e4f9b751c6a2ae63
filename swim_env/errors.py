"""Exceptions of the package, and the one line that says what is not installed."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Self


class SwimError(Exception):
    """Base of every exception that this package raises on purpose."""


class SettingsError(SwimError, ValueError):
    """Settings cannot be used: base of the errors of scenes and training configurations.

    The message is one line: what is wrong, in which field, what would be right and,
    where known, the file in brackets.

    Parameters
    ----------
    problem : str
        What is wrong and what would be right, with the dotted name of the field.
    source : str, optional
        Where the settings came from, as the caller named it.
    """

    def __init__(self, problem: str, source: str | None = None) -> None:
        problem = " ".join(problem.splitlines())
        super().__init__(problem, source)
        self.problem = problem
        self.source = source

    def __str__(self) -> str:
        """Return the message, with the source in brackets where known."""
        return self.problem if self.source is None else f"{self.problem} ({self.source})"

    def located(self, source: str | None) -> Self:
        """Return the same error naming `source`, unless it names one already."""
        return self if self.source is not None else type(self)(self.problem, source)


class SceneError(SettingsError):
    """A scene cannot be found or used, or a change of it is not valid."""


class OutlineError(SwimError, ValueError):
    """An outline cannot be divided into panels."""


class SurfaceError(SwimError, ValueError):
    """A surface cannot be divided into panels."""


class TorqueError(SwimError, ValueError):
    """Joint torques have the wrong shape or type, or are not finite."""


class SimulationEndedError(SwimError, RuntimeError):
    """The simulation cannot continue; its state is the last one that was reached.

    Parameters
    ----------
    reason : str
        A reason of `swim_env.TERMINATION_REASONS`.
    time : float
        Simulated time of the last state that was reached (s).
    meaning : str
        The reason in one sentence.
    """

    def __init__(self, reason: str, time: float, meaning: str) -> None:
        super().__init__(reason, time, meaning)
        self.reason = reason
        self.time = time
        self.meaning = meaning

    def __str__(self) -> str:
        """Return the reason, the time and what they mean."""
        return f"the simulation ended at t = {self.time:.6g} s: {self.reason} ({self.meaning})"


class ActionError(SwimError, ValueError):
    """An action has the wrong shape or type, or is not finite."""


class OptionError(SwimError, ValueError):
    """An option or argument of an environment is unknown or cannot be used."""


class TaskError(OptionError):
    """A task's methods return what cannot be used: other names or shapes, or not finite."""


class TrajectoryError(SwimError, ValueError):
    """A trajectory file cannot be written or read."""


def require_packages(wish: str, packages: Mapping[str, str], extra: str) -> None:
    """Check that optional packages can be imported; else a SwimError says how to get them.

    Parameters
    ----------
    wish : str
        What needs them: ``recordings need``.
    packages : mapping
        The packages' names by what is imported.
    extra : str
        The extra of this package that has them.
    """
    for module, name in packages.items():
        try:
            importlib.import_module(module)
        except ImportError as error:
            missing = getattr(error, "name", None)
            why = f"; {error}" if missing and missing.partition(".")[0] != module else ""
            raise SwimError(
                f"{wish} {name}: install the extra '{extra}' (pip install 'swim-env[{extra}]'{why})"
            ) from None
