"""Exceptions of the package."""

from __future__ import annotations


class SwimError(Exception):
    """Base of every exception that this package raises on purpose."""


class SceneError(SwimError, ValueError):
    """A scene, or a request to change or find one, cannot be used.

    The message is one line: what is wrong, in which field, what would be right and,
    where known, the file in brackets.

    Parameters
    ----------
    problem : str
        What is wrong and what would be right, with the dotted name of the field.
    source : str, optional
        Where the scene came from, as the caller named it.
    """

    def __init__(self, problem: str, source: str | None = None) -> None:
        problem = " ".join(problem.splitlines())
        super().__init__(problem, source)
        self.problem = problem
        self.source = source

    def __str__(self) -> str:
        """Return the message, with the source in brackets where known."""
        return self.problem if self.source is None else f"{self.problem} ({self.source})"

    def located(self, source: str | None) -> SceneError:
        """Return the same error naming `source`, unless it names one already."""
        return self if self.source is not None else SceneError(self.problem, source)
