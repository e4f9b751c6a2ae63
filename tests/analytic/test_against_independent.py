"""Motions of the simulator against an implementation written without sight of it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

from swim_env import Scene, Simulator, load_scene
from tests.reference import independent
from tests.support import PAPERS_STEPS, Array

#: Largest differences allowed (m, rad, kg m/s, kg m^2/s, J), ten tolerances. Reached are 5e-14 and,
#: without a fluid and with soft or light bodies, 1e-12.
BOUND = 1e-11


class Motion(NamedTuple):
    """A scene, its number of steps, and torques other than its own."""

    scene: str
    changes: dict[str, Any]
    steps: int
    torques: Callable[[Scene, int], Array] | None = None


def random_held(scene: Scene, steps: int) -> Array:
    """Return uniform torques in [-1, 1] N m, held for 0.02 s."""
    held = int(round(0.02 / scene.integrator.time_step))
    rng = np.random.default_rng(11)
    rows = rng.uniform(-1.0, 1.0, (-(-steps // held), scene.beam.elements - 1))
    return np.repeat(rows, held, axis=0)[:steps]


MOTIONS = {
    "paper_i": Motion("paper_i", {}, 100),
    "paper_iv": Motion("paper_iv", {}, 150),
    "paper_v": Motion("paper_v", {}, 100),
    "paper_vi": Motion("paper_vi", {}, 100),
    "paper_vii, fifteen elements": Motion("paper_vii", {"beam.elements": 15}, 40),
    "swimmer under random torques": Motion("swimmer", PAPERS_STEPS, 100, random_held),
    "five times the torque": Motion("paper_i", {"actuation.amplitude": 5.0}, 50),
    "axial added mass, two cap panels": Motion(
        "paper_i", {"axial_added_mass": True, "fluid.cap_panels": 2, "beam.elements": 6}, 100
    ),
    "no fluid, drifting": Motion(
        "paper_i",
        {
            "fluid": None,
            "damping.retardation_time": 1e-3,
            "initial.velocity": [-0.1, 0.05],
            "initial.velocity_slope": 0.3,
        },
        100,
    ),
    "turning at the start": Motion(
        "paper_xi",
        {
            "initial.velocity": [0.3, -0.2],
            "initial.velocity_slope": 0.8,
            "beam.bending_stiffness": 0.5,
        },
        100,
    ),
    "other units": Motion(
        "paper_i",
        {
            "beam.length": 0.2,
            "beam.elements": 4,
            "beam.half_thickness": 0.004,
            "beam.line_density": 2.0,
            "beam.rotary_inertia": 0.0,
            "beam.bending_stiffness": [0.3, 0.2, 0.1],
            "fluid.density": 998.0,
            "fluid.panels_per_element": 8,
            "actuation.amplitude": 0.4,
            "integrator.time_step": 0.004,
        },
        100,
    ),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_same_motion(name: str) -> None:
    motion = MOTIONS[name]
    scene = load_scene(motion.scene, {**motion.changes, "integrator.tolerance": 1e-12})
    simulator = Simulator(scene)
    torques = (
        motion.torques(scene, motion.steps)
        if motion.torques
        else simulator.prescribed_torques(motion.steps)
    )
    trajectory = simulator.rollout(torques)
    assert trajectory.termination_reason == ""
    assert trajectory.parts.max() == 1.0, "the reference cannot cut a step"
    exact = independent.simulate(scene, torques)
    figures = {
        key: float(np.abs(getattr(trajectory, key) - exact[key]).max())
        for key in ("centres", "angles", "momentum", "energy", "work")
    }
    moved = float(np.abs(exact["angles"]).max())
    assert moved > 1e-2, f"{name}: angles reach only {moved:.1e} rad, too little to compare"
    for key, figure in figures.items():
        assert figure < BOUND, f"{name}: {key} off by {figure:.1e}, bound {BOUND:.0e}; {figures}"
