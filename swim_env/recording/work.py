"""Sharing the work on a recording among threads."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from swim_env.physics.runtime.threads import usable_threads

__all__ = ["side_by_side"]

Item = TypeVar("Item")
Result = TypeVar("Result")


def side_by_side(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Return what a function makes of items, in their order.

    It runs in as many threads as numba is told to use, and in this one where Python is ending and
    starts no more of them: that is when what nobody has closed is written.
    """
    listed = list(items)
    with ThreadPoolExecutor(usable_threads()) as pool:
        try:
            waiting = [pool.submit(function, item) for item in listed]
        except RuntimeError:
            return [function(item) for item in listed]
        return [one.result() for one in waiting]
