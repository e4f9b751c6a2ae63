"""Every script starts in a checkout whose packages are installed, from any folder."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.metadata import distributions

import pytest

from tests.support import ROOT

SCRIPTS = sorted((ROOT / "scripts").glob("*.py"))
INSTALLED = any(one.name == "swim-env" for one in distributions())


@pytest.mark.skipif(not INSTALLED, reason="swim-env is not installed, only on the path")
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_needs_no_path_of_its_own(script, tmp_path):
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, script, "--help"],
        cwd=tmp_path,
        env=environment,
        text=True,
        capture_output=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("usage: ")
