"""The kernel cache: which processes fill it, and what invalidates it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from swim_env.physics.runtime.compile import fingerprint
from tests.support import ROOT, Done, run_python


def test_the_fingerprint_sees_every_file_with_kernels_in_folders_of_any_depth(tmp_path):
    package = tmp_path / "swim_env"
    shutil.copytree(ROOT / "swim_env" / "physics", package / "physics")
    for name in ("envs/assessment.py", "scene/fluid.py"):
        (package / name).parent.mkdir()
        shutil.copy(ROOT / "swim_env" / name, package / name)
    sources = sorted(package.rglob("*.py"))
    assert len({path.parent for path in sources}) > 5
    (package / "physics" / "spatial" / "rods").mkdir(parents=True)
    seen = {fingerprint(package)}
    for count, path in enumerate([*sources, package / "physics" / "spatial" / "rods" / "new.py"]):
        with path.open("a") as file:
            file.write("# changed\n")
        seen.add(fingerprint(package))
        assert len(seen) == 2 + count, f"a change of {path} would run old machine code"


def load(cache: Path) -> Done:
    code = "from swim_env.envs.assessment import load_assessment; load_assessment()"
    return run_python("-c", code, timeout=280, NUMBA_CACHE_DIR=str(cache))


@pytest.mark.slow
def test_two_processes_fill_an_empty_cache_without_writing_to_the_same_place(tmp_path):
    """A kernel with two signatures has two files that are numbered as they come.

    Processes that compile at the same time could then take the same number for different code.
    """
    first = load(tmp_path)
    assert first.code == 0, first.err
    assert "compiling the physics kernels" in first.err and "kept in" in first.err
    kept = list(tmp_path.rglob("*.nbc"))
    assert len(kept) > 50
    assert [path.name for path in kept if not path.name.endswith(".1.nbc")] == []
    assert load(tmp_path) == Done(0, "", "")
    assert len(list(tmp_path.rglob("*.nbc"))) == len(kept)
