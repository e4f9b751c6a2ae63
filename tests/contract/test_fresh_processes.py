"""Work side by side in fresh processes: results, errors, dead workers and ends."""

from __future__ import annotations

import multiprocessing
import os
import time
from contextlib import closing

import pytest

from swim_env.errors import SwimError
from swim_env.fresh_processes import Call, in_fresh_processes


def test_results_come_with_the_index_of_their_call() -> None:
    calls: list[Call] = [(pow, (2, n)) for n in range(5)]
    assert dict(in_fresh_processes(calls, 2)) == {n: 2**n for n in range(5)}


def test_no_calls_are_no_work() -> None:
    assert list(in_fresh_processes([], 2)) == []


def test_an_error_of_a_call_ends_all() -> None:
    calls: list[Call] = [(int, ("no number",)), (time.sleep, (60.0,))]
    begin = time.monotonic()
    with pytest.raises(ValueError, match="no number"):
        list(in_fresh_processes(calls, 2))
    assert time.monotonic() - begin < 30.0
    assert multiprocessing.active_children() == []


def test_a_dead_process_is_one_clear_line() -> None:
    with pytest.raises(SwimError) as caught:
        list(in_fresh_processes([(os._exit, (9,))], 1, advice="start again"))
    text = str(caught.value)
    assert text.startswith("a worker process has died") and text.endswith("; start again")
    assert "\n" not in text


def test_whoever_stops_early_does_not_wait() -> None:
    calls: list[Call] = [(pow, (2, 3)), (time.sleep, (60.0,))]
    begin = time.monotonic()
    with closing(in_fresh_processes(calls, 2)) as results:
        assert next(results) == (0, 8)
    assert time.monotonic() - begin < 30.0
    assert multiprocessing.active_children() == []
