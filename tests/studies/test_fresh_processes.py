"""Work side by side in fresh processes: results, errors, dead workers and ends.

Calls that nobody may wait for take longer than a test may.
"""

import multiprocessing
import threading
import time
from contextlib import closing

import pytest

from studies.fresh_processes import Call, in_fresh_processes


def test_results_come_with_the_index_of_their_call():
    calls: list[Call] = [(pow, (2, n)) for n in range(5)]
    assert dict(in_fresh_processes(calls, 2)) == {n: 2**n for n in range(5)}
    assert list(in_fresh_processes([], 2)) == []
    # Large arguments and results come whole.
    calls = [(bytes.upper, (bytes([97 + n]) * 5_000_000,)) for n in range(4)]
    assert dict(in_fresh_processes(calls, 2)) == {n: bytes([65 + n]) * 5_000_000 for n in range(4)}


def test_an_error_of_a_call_ends_all():
    calls: list[Call] = [(int, ("no number",)), (time.sleep, (3600.0,))]
    with pytest.raises(ValueError, match="no number"):
        list(in_fresh_processes(calls, 2))
    assert multiprocessing.active_children() == []


def large(seconds: float) -> bytes:
    time.sleep(seconds)
    return bytes(40_000_000)


@pytest.mark.parametrize("other", [(time.sleep, 3600.0), *((large, s) for s in (0.0, 0.02, 0.05))])
def test_whoever_stops_early_does_not_wait(other):
    """Nor where a worker is ended in the middle of its answer, the rest of which nobody gets."""
    work, seconds = other
    with closing(in_fresh_processes([(pow, (2, 3)), (work, (seconds,))], 2)) as results:
        # Processes start in any order, so either may be the first.
        index, value = next(results)
        assert value == (8, bytes(40_000_000))[index]
    assert multiprocessing.active_children() == []


class Awkward(Exception):
    """Cannot be made anew from what it says."""

    def __init__(self, one: str, two: str) -> None:
        super().__init__(f"{one} {two}")


def fail(kind: str) -> None:
    if kind == "awkward":
        raise Awkward("no", "luck")
    raise ConnectionError("the disk's own trouble")


def test_errors_are_those_of_the_call():
    """Also those that look like a dead worker, and those that cannot be sent as they are."""
    with pytest.raises(ConnectionError, match="the disk's own trouble") as caught:
        list(in_fresh_processes([(fail, ("connection",))], 1))
    assert "in fail" in caught.value.__notes__[0]
    with pytest.raises(RuntimeError, match="^Awkward: no luck"):
        list(in_fresh_processes([(fail, ("awkward",))], 1))
    with pytest.raises(TypeError, match="pickle"):
        list(in_fresh_processes([(threading.Lock, ())], 1))
