"""Every script starts in a checkout whose packages are installed, from any folder."""

from importlib.metadata import distributions

import pytest

from tests.support import ROOT, run_python

SCRIPTS = sorted((ROOT / "scripts").glob("*.py"))
INSTALLED = any(one.name == "swim-env" for one in distributions())


@pytest.mark.skipif(not INSTALLED, reason="swim-env is not installed, only on the path")
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_needs_no_path_of_its_own(script, tmp_path):
    done = run_python(script, "--help", cwd=tmp_path, PYTHONPATH="")
    assert done.code == 0, done.err
    assert done.out.startswith("usage: ")
