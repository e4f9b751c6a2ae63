"""The beam without a fluid: bending vibrations and statics."""

import functools

import numpy as np
import pytest
from scipy.linalg import eigh

from swim_env import Initial, Scene, Simulator
from tests.analytic.probes import mass_of
from tests.invariants.runs import largest, orders
from tests.support import Array

BETA = np.array([4.730040745, 7.853204624, 10.995607838])
STIFFNESS = 5.0
LINE_DENSITY = 0.31
EXACT = BETA**2 * np.sqrt(STIFFNESS / LINE_DENSITY)


def beam_scene(elements: int, time_step: float, retardation: float = 0.0) -> Scene:
    data = {
        "beam": {"elements": elements, "rotary_inertia": 1e-9, "bending_stiffness": STIFFNESS},
        "integrator": {"time_step": time_step, "tolerance": 1e-12},
    }
    if retardation:
        data["damping"] = {"retardation_time": retardation}
    return Scene.from_dict(data)


@functools.cache
def modes(elements: int) -> tuple[Array, Array]:
    """Return the three lowest bending frequencies (rad/s) and the joints' angles in the modes.

    Mass and stiffness are the simulator's own: momenta of unit velocities, second differences of
    the energy.
    """
    simulator = Simulator(beam_scene(elements, 0.01))
    mass = mass_of(simulator)
    joints = elements - 1
    small = 1e-4

    def energy(angles: Array) -> float:
        simulator.reset(Initial(joint_angles=angles.tolist()))
        return simulator.energy()

    unit = small * np.eye(joints)
    stiffness = np.zeros((joints, joints))
    for i in range(joints):
        for j in range(i + 1):
            second = energy(unit[i] + unit[j]) - energy(unit[i] - unit[j])
            stiffness[i, j] = stiffness[j, i] = second / (2.0 * small**2)
    to_joints = np.zeros((joints, elements + 2))
    to_joints[:, 2:] = np.diff(np.eye(elements), axis=0)
    values, vectors = eigh(to_joints.T @ stiffness @ to_joints, mass)
    assert np.abs(values[:3]).max() < 1e-6 * values[3], f"rigid modes at {values[:4]}"
    return np.sqrt(values[3:6]), (to_joints @ vectors[:, 3:6]).T


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_free_free_eigenfrequencies_at_second_order(mode: int) -> None:
    counts = [9, 18, 36, 72]
    errors = np.array([modes(n)[0][mode] / EXACT[mode] - 1.0 for n in counts])
    observed = orders(errors)
    text = f"mode {mode + 1}: errors {errors.tolist()} at N = {counts}, orders {observed.tolist()}"
    assert abs(errors[0] - [0.027, 0.063, 0.12][mode]) < 0.001, text
    assert (np.abs(observed[1:] - 2.0) < 0.1).all(), text
    assert abs(observed[1] - 2.0) < abs(observed[0] - 2.0), f"order must settle at 2; {text}"


def vibrate(elements: int, mode: int, time_step: float, steps: int) -> float:
    """Let the simulator vibrate in a mode and return its frequency (rad/s).

    A mode obeys x(n+1) + x(n-1) = 2 cos(omega dt) x(n) exactly.
    """
    _, shapes = modes(elements)
    shape = shapes[mode] / np.abs(shapes[mode]).max()
    simulator = Simulator(beam_scene(elements, time_step))
    simulator.reset(Initial(joint_angles=(1e-4 * shape).tolist()))
    trajectory = simulator.rollout(np.zeros((steps, elements - 1)))
    assert trajectory.termination_reason == ""
    joints = np.diff(trajectory.angles, axis=1)
    x = joints @ shape / (shape @ shape)
    assert largest(joints - np.outer(x, shape)) < 1e-3 * largest(x)
    cosine = (x[1:-1] @ (x[2:] + x[:-2])) / (2.0 * x[1:-1] @ x[1:-1])
    return float(np.arccos(cosine)) / time_step


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_simulated_vibration_has_the_eigenfrequency(mode: int) -> None:
    counts = [18, 36, 72]
    measured = []
    for n in counts:
        omega = modes(n)[0][mode]
        step = 0.2 / omega
        found = vibrate(n, mode, step, 200)
        # The midpoint rule slows a mode: tan(omega' dt/2) = omega dt/2.
        unslowed = 2.0 / step * np.tan(0.5 * found * step)
        error = abs(unslowed / omega - 1.0)
        assert error < 1e-6, f"N = {n}: simulated {unslowed}, linearised {omega}, off {error:.1e}"
        measured.append(unslowed / EXACT[mode] - 1.0)
    errors = np.array(measured)
    observed = orders(errors)
    text = f"mode {mode + 1}: errors {errors.tolist()} at N = {counts}, orders {observed.tolist()}"
    assert (np.abs(observed - 2.0) < 0.1).all(), text


def test_vibration_is_second_order_in_time() -> None:
    omega = modes(9)[0][0]
    steps = [0.4 / omega, 0.2 / omega, 0.1 / omega]
    errors = np.array([vibrate(9, 0, step, 300) / omega - 1.0 for step in steps])
    observed = orders(errors)
    text = f"errors {errors.tolist()} at omega dt = 0.4, 0.2, 0.1, orders {observed.tolist()}"
    assert (np.abs(observed - 2.0) < 0.05).all(), text


def test_constant_moment_bends_it_to_a_circle() -> None:
    moment = 6.0
    curvature = []
    counts = [9, 18, 36]
    for n in counts:
        # Nearly critically damped, and raised smoothly: a jump would leave the stiffest modes
        # swinging from step to step, which damping over a step hardly sees.
        simulator = Simulator(beam_scene(n, 0.005, retardation=0.02))
        s = np.clip(np.arange(400) / 200.0, 0.0, 1.0)[:, np.newaxis]
        raised = moment * s**4 * (35.0 - 84.0 * s + 70.0 * s**2 - 20.0 * s**3)
        trajectory = simulator.rollout(np.repeat(raised, n - 1, axis=1))
        assert trajectory.termination_reason == ""
        dl = 1.0 / n
        # W = EI sin^2(a)/(2 dl), so the joint's moment is EI sin(a) cos(a)/dl.
        exact = 0.5 * np.arcsin(2.0 * moment * dl / STIFFNESS)
        error = float(np.abs(simulator.joint_angles - exact).max())
        assert error < 1e-10, (
            f"N = {n}: joints are off sin(2a) = 2 M dl/EI, {exact}, by {error:.1e} rad"
        )
        curvature.append(float(simulator.joint_angles.mean()) / dl)
    errors = np.array(curvature) * STIFFNESS / moment - 1.0
    observed = orders(errors)
    text = f"curvature off M/EI by {errors.tolist()} at N = {counts}, orders {observed.tolist()}"
    assert (np.abs(observed - 2.0) < 0.05).all(), text
