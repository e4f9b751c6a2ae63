"""Order of the trajectory in the time step: one with the fluid, two without."""

import itertools

import numpy as np
import pytest

from swim_env import Simulator, load_scene
from tests.invariants.runs import orders
from tests.support import rollout

TIME_STEPS = (0.0025, 0.00125, 0.000625, 0.0003125)
#: Torques are held over this time (s) at every time step, so that all runs solve one problem.
HELD = 0.05
DURATION = 1.0
# Elements, EI (N m^2), amplitude of the torques (N m).
CASES = {"N=3": (3, 2.0, 0.3), "N=5, soft": (5, 0.05, 0.02), "N=9, softer": (9, 0.004, 0.002)}


def _states(case: str, fluid: bool, others: dict[str, object], time_step: float) -> np.ndarray:
    """Return centres and angles at common instants, one row each."""
    elements, stiffness, amplitude = CASES[case]
    changes: dict[str, object] = {
        "beam.elements": elements,
        "beam.bending_stiffness": stiffness if fluid else min(stiffness, 0.4),
        "initial.joint_angles": 0.05,
        "initial.velocity": (0.3, 0.3),
        "integrator.time_step": time_step,
        "integrator.tolerance": 1e-13,
        **others,
    }
    if not fluid:
        changes |= {"fluid": None, "beam.rotary_inertia": 1e-3}
    simulator = Simulator(load_scene("paper_i", changes))
    t = HELD * np.arange(round(DURATION / HELD))[:, None]
    wave = np.cos(4.0 * t - 3.0 * simulator.scene.beam.joint_fractions)
    held = (amplitude if fluid else min(amplitude, 0.05)) * np.sin(np.pi * t) ** 2 * wave
    torques = np.repeat(held, round(HELD / time_step), axis=0)
    trajectory = rollout(simulator.scene, torques)
    assert (trajectory.parts == 1).all(), "steps were cut"
    every = round(HELD / time_step)
    centres = trajectory.centres[::every].reshape(len(held) + 1, -1)
    return np.concatenate([centres, trajectory.angles[::every]], axis=1)


ORDERS: dict[str, tuple[str, bool, dict[str, object], float]] = {
    **{case: (case, True, {}, 1.0) for case in CASES},
    **{f"{case}, no fluid": (case, False, {}, 2.0) for case in CASES},
    "damped": ("N=3", True, {"damping": {"retardation_time": 0.005}}, 1.0),
    "damped, no fluid": ("N=3", False, {"damping": {"retardation_time": 0.005}}, 2.0),
    "axial": ("N=3", True, {"axial_added_mass": {}}, 1.0),
}


@pytest.mark.parametrize("name", ORDERS)
def test_trajectory_converges_at_the_schemes_order(name: str) -> None:
    *problem, order = ORDERS[name]
    runs = [_states(*problem, step) for step in TIME_STEPS]
    changes = [float(np.abs(b - a).max()) for a, b in itertools.pairwise(runs)]
    observed = orders(changes)
    assert np.abs(observed - order).max() < 0.12, f"orders {observed}, changes {changes}"


def test_the_tolerance_bounds_the_error_of_newtons_method() -> None:
    exact = _states("N=5, soft", True, {"integrator.tolerance": 1e-13}, 0.005)
    errors = []
    for tolerance in (1e-6, 1e-8, 1e-10):
        run = _states("N=5, soft", True, {"integrator.tolerance": tolerance}, 0.005)
        errors.append(float(np.abs(run - exact).max()))
    assert errors[0] > errors[1] > errors[2], f"errors {errors}"
    assert errors[2] < 1e-6, f"errors {errors}"
