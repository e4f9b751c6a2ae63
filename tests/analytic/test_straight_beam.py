"""Added mass of the straight default beam."""

from typing import NamedTuple

import numpy as np
import pytest

from swim_env import Simulator, load_scene
from tests.analytic.conformal import rectangle_mass
from tests.analytic.probes import fluid_constants, probe_fluid, rigid_mass
from tests.invariants.runs import largest

PLATE_LATERAL = np.pi / 4.0
PLATE_ROTARY = np.pi / 128.0


class Straight(NamedTuple):
    """Lateral and rotary mass at unit density, their coupling, and the asymmetry of A."""

    lateral: float
    rotary: float
    coupling: float
    asymmetry: float


def straight(elements: int, panels: int, caps: int = 1) -> Straight:
    fluid = fluid_constants(elements, panels, caps)
    probe = probe_fluid(np.zeros(elements - 1), fluid)
    along = (np.arange(elements) + 0.5) / elements - 0.5
    rates = np.zeros((2 * elements, 2))
    rates[:elements, 0], rates[:elements, 1], rates[elements:, 1] = 1.0, along, 1.0
    mass = rates.T @ probe.mass @ rates / fluid.density
    asymmetry = float(np.abs(probe.raw - probe.raw.T).max() / np.abs(probe.raw).max())
    return Straight(mass[0, 0], mass[1, 1], mass[0, 1], asymmetry)


def test_lateral_mass_a_few_per_cent_above_the_plate() -> None:
    excess = {panels: straight(9, panels).lateral / PLATE_LATERAL - 1.0 for panels in (4, 8, 12)}
    text = f"lateral mass over the plate's by {excess}"
    assert all(0.04 < value < 0.07 for value in excess.values()), text
    change = abs((1.0 + excess[12]) / (1.0 + excess[4]) - 1.0)
    assert change < 0.01, f"from 4 to 12 panels per element it changes by {change:.2%}; {text}"


def test_elements_and_panels_cut_the_same_outline() -> None:
    # 3 x 12, 9 x 4 and 18 x 2 panels are one polygon, so one rigid body.
    found = np.array([straight(3, 12)[:3], straight(9, 4)[:3], straight(18, 2)[:3]])
    spread = float(np.ptp(found, axis=0).max())
    assert spread < 1e-13, f"the same polygon differs by {spread:.2e}: {found.tolist()}"
    assert largest(found[:, 2]) < 1e-14


def test_simulator_carries_body_and_fluid() -> None:
    simulator = Simulator(load_scene("paper_i"))
    body = rigid_mass(simulator)
    lines = 0.31 * np.array([1.0, (1.0 - 1.0 / 81.0) / 12.0]) + [0.0, 7.8e-6]
    fluid = straight(9, 4)
    found = np.array([body.across - lines[0], body.inertia - lines[1]]) / 10.0
    assert largest(found / [fluid.lateral, fluid.rotary] - 1.0) < 1e-13
    axial = abs(body.along / 0.31 - 1.0)
    assert axial < 1e-14, f"mass along the beam is off rho_B A l by {axial:.2e}, must have no fluid"


def test_refining_sides_alone_stays_off() -> None:
    # One cap panel leaves 0.8 % in the lateral and 1.3 % in the rotary mass.
    exact = rectangle_mass(1.0, 0.02)[1:]
    found = [straight(9, panels) for panels in (16, 32, 64)]
    errors = np.array([np.array(f[:2]) / exact - 1.0 for f in found])
    text = f"errors against the rectangle {errors.tolist()} at 16, 32, 64 panels per element"
    assert np.abs(errors[-1] - [0.0075, 0.0132]).max() < 2e-4, text
    assert np.abs(errors[-1] - errors[-2]).max() < 1e-4, text
    asymmetry = [f.asymmetry for f in found]
    assert 1.5e-3 < asymmetry[-1] < 2.5e-3, f"asymmetry of A {asymmetry}, levels off near 2e-3"
    assert asymmetry[-1] > 1.03 * asymmetry[-2] > 1.03 * asymmetry[-3], f"asymmetry {asymmetry}"


@pytest.mark.parametrize("kind", ["lateral", "rotary"])
def test_refining_caps_and_sides_converges_to_the_rectangle(kind: str) -> None:
    index = 0 if kind == "lateral" else 1
    exact = rectangle_mass(1.0, 0.02)[1 + index]
    errors, asymmetry = [], []
    for caps in (8, 16, 32):
        found = straight(9, 4 * caps, caps)
        errors.append(abs(found[index] / exact - 1.0))
        asymmetry.append(found.asymmetry)
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    text = f"{kind} errors {errors} at 8, 16, 32 panels a cap, orders {orders.tolist()}"
    assert errors[-1] < 1.2e-3, text
    assert (orders > 0.4).all(), text
    fall = np.log2(np.array(asymmetry[:-1]) / asymmetry[1:])
    assert (fall > 0.6).all(), f"asymmetry of A {asymmetry} must vanish, orders {fall.tolist()}"
