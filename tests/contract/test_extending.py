"""The worked examples of docs/howto/extending.md, applied to a copy of the package."""

import re
import shutil
import subprocess
from typing import Any

import numpy as np
import pytest

from tests.support import ROOT, run_python

pytestmark = [pytest.mark.slow, pytest.mark.ci_slice, pytest.mark.timeout(900)]

PROBE = """
import json
import numpy as np
import swim_env
from swim_env import Simulator, load_scene

scene = load_scene("paper_i")
aside = scene.replace({"actuation": None, "fluid.model": "tapered", "initial.velocity": [0.0, 0.2]})
viscous = scene.replace({"joint_viscosity": {"coefficient": 1e-3}, "fluid.model": "strip"})
soft = viscous.replace("beam.bending_stiffness", 0.0)


def play(scene, steps):
    simulator = Simulator(scene)
    return simulator.rollout(simulator.prescribed_torques(steps))


def run(scheme, step):
    changes = {"integrator.scheme": scheme, "integrator.time_step": step, "fluid.model": "frozen",
               "integrator.tolerance": 1e-10}
    return play(load_scene("swimmer").replace(changes), round(1.0 / step))


ends, starts = [[run(scheme, step) for step in (0.005, 0.0025)] for scheme in ("end", "paper")]
print(json.dumps({
    "models": list(swim_env.FLUID_MODELS),
    "effects": [list(swim_env.EFFECTS), list(viscous.effects)],
    "momentum": Simulator(aside).momentum().tolist(),
    "plain": Simulator(aside.replace("fluid.model", "strip")).momentum().tolist(),
    "dissipated": [float(play(one, 50).dissipated.sum()) for one in (viscous, soft)],
    "ends": [one.displacement.tolist() for one in ends],
    "starts": [one.displacement.tolist() for one in starts],
    "drift": [one.summary()["momentum_drift"] for one in ends],
}))
"""


def blocks(page: str) -> tuple[list[tuple[str, str]], list[str]]:
    """Return the new files of the page, with their names, and its diffs."""
    files = re.findall(r"`(swim_env/[\w/]+\.py)`\n\n```python\n(.*?)```", page, flags=re.S)
    return files, re.findall(r"```diff\n(.*?)```", page, flags=re.S)


@pytest.fixture(scope="module")
def probed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    copy = tmp_path_factory.mktemp("extended")
    for folder in ("swim_env", "configs"):
        shutil.copytree(ROOT / folder, copy / folder, ignore=shutil.ignore_patterns("__pycache__"))
    files, diffs = blocks((ROOT / "docs" / "howto" / "extending.md").read_text(encoding="utf-8"))
    assert len(files) == 1 and len(diffs) == 8
    for name, text in files:
        (copy / name).write_text(text, encoding="utf-8")
    for text in diffs:
        command = ["git", "apply", "--recount", "-"]
        done = subprocess.run(command, input=text, cwd=copy, text=True, capture_output=True)
        assert done.returncode == 0, f"{done.stderr}\n{text}"
    environment = {"PYTHONPATH": str(copy), "NUMBA_CACHE_DIR": str(copy / "cache")}
    return run_python("-c", PROBE, cwd=copy, timeout=800.0, **environment).figures()


def test_a_model_of_ones_own_is_there_and_has_its_mass(probed):
    assert "tapered" in probed["models"]
    momentum, plain = np.array(probed["momentum"]), np.array(probed["plain"])
    # As much mass as the strips have, but further ahead.
    assert momentum[:2] == pytest.approx(plain[:2], abs=1e-12)
    assert 0.0 < momentum[2] < 0.95 * plain[2]


def test_an_effect_of_ones_own_dissipates(probed):
    everything, present = probed["effects"]
    assert "joint_viscosity" in everything and "joint_viscosity" in present
    assert min(probed["dissipated"]) > 0.0


def test_a_scheme_of_ones_own_converges_to_the_same_motion(probed):
    gaps = np.linalg.norm(np.array(probed["ends"]) - np.array(probed["starts"]), axis=1)
    # Both are of first order, and the steps are short enough to show it.
    assert gaps[1] / gaps[0] == pytest.approx(0.5, abs=0.03)
    assert max(probed["drift"]) < 1e-10
