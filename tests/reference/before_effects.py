"""Runs that were stored before the later effects existed, to compare with what they give now.

An effect that is not in a scene must not change a bit. ``python -m tests.reference.before_effects``
wrote the file; writing it again would defeat its purpose, and is right only where the solver itself
was changed on purpose.
"""

from __future__ import annotations

from pathlib import Path

import llvmlite
import llvmlite.binding
import numba
import numpy as np
from numpy.typing import NDArray

from swim_env import Scene, Simulator, load_scene

STORED = Path(__file__).parent / "before_effects.npz"
STEPS = 60


def scenes() -> dict[str, Scene]:
    """Return the scenes, which have none of the later effects."""
    paper = load_scene("paper_i")
    return {
        "paper_i": paper,
        "paper_vi": load_scene("paper_vi"),
        "paper_xii": load_scene("paper_xii"),
        "swimmer": load_scene("swimmer"),
        "fine": paper.replace(
            {"beam.elements": 5, "fluid.panels_per_element": 8, "fluid.cap_panels": 2}
        ),
        "axial": paper.replace("axial_added_mass", True),
        "no_fluid": load_scene("swimmer").replace("fluid", None),
        "no_stiffness": paper.replace("beam.bending_stiffness", 0.0),
        "frozen": paper.replace("fluid.model", "frozen"),
        "composed": load_scene("swimmer").replace("integrator.scheme", "composed"),
    }


def torques(scene: Scene) -> NDArray[np.float64]:
    """Return torques that are random, small and held over four steps."""
    rng = np.random.default_rng(7)
    limit = 1.0 if scene.beam.stiffness_at_joints().any() else 0.003
    held = rng.uniform(-limit, limit, (STEPS // 4, scene.beam.elements - 1))
    return np.repeat(held, 4, axis=0)


def run(scene: Scene) -> NDArray[np.float64]:
    """Return coordinates of elements, angles, momenta, energies and residuals, in one vector."""
    trajectory = Simulator(scene).rollout(torques(scene))
    assert trajectory.steps == STEPS
    parts = (
        trajectory.centres[-1],
        trajectory.angles[-1],
        trajectory.momentum[-1],
        trajectory.energy[-8:],
        trajectory.work[-8:],
        trajectory.dissipated[-8:],
        trajectory.residual[-8:],
    )
    return np.concatenate([part.ravel() for part in parts])


def machine() -> str:
    """Return what the bits of a result hang on, besides this package."""
    return " ".join(
        (
            llvmlite.binding.get_host_cpu_name(),
            llvmlite.binding.get_host_cpu_features().flatten(),
            numba.__version__,
            llvmlite.__version__,
            np.__version__,
        )
    )


if __name__ == "__main__":
    results = {name: run(scene) for name, scene in scenes().items()}
    np.savez_compressed(STORED, machine=np.array(machine()), **results)
