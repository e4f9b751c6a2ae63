"""The kernel cache as processes fill it that do not know of each other."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LOAD = "from swim_env.envs.assessment import load_assessment; load_assessment()"


def load(cache: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", LOAD],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(cache)},
        timeout=280,
    )


@pytest.mark.slow
def test_two_processes_fill_an_empty_cache_without_writing_to_the_same_place(tmp_path):
    """A kernel with two signatures has two files that are numbered as they come.

    Processes that compile at the same time could then take the same number for different code.
    """
    first = load(tmp_path)
    assert first.returncode == 0, first.stderr
    assert "compiling the physics kernels" in first.stderr and "kept in" in first.stderr
    kept = list(tmp_path.rglob("*.nbc"))
    assert len(kept) > 50
    assert [path.name for path in kept if not path.name.endswith(".1.nbc")] == []
    second = load(tmp_path)
    assert (second.returncode, second.stderr) == (0, "")
    assert len(list(tmp_path.rglob("*.nbc"))) == len(kept)
