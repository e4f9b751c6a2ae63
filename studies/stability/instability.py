"""The straight body's instability: the rate at which it leaves its line, and what starts it.

A stiff body that moves along itself is unstable: by Kirchhoff's equations a small lateral momentum
turns it like theta = (1 - cosh(lambda t)) m22 v/(m11 U) with
lambda^2 = U^2 m11 (m22 - m11)/(m22 I - g^2), m11, m22, I and g the body's own with the fluid's.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from studies.kirchhoff import growth_rate, rigid_mass
from swim_env.analysis.modes import mass_matrix
from swim_env.scene import load_scene
from swim_env.sim.simulator import Simulator
from swim_env.sim.trajectory import Trajectory

_SPEED = 0.1
#: Lateral velocity (m/s) small enough for the linear equations over the time (s) that is watched.
_LATERAL, _WATCHED = 1e-7, 40.0
#: Panels per element of the paper's three cases, and of others.
_PANELS = {3: 12}


def measure_onset(elements: int, stiffness: float) -> dict[str, float]:
    """Measure how a body of N elements with EI (N m^2) leaves its line at 0.1 m/s.

    Returns
    -------
    dict
        ``elements``, ``stiffness``; ``rate``, the one that was fitted, over Kirchhoff's;
        ``kirchhoff``, Kirchhoff's rate (1/s) with the discrete body's own mass; ``alone`` and
        ``tiny``, the largest angle of an element after 60 s (rad) without any perturbation but the
        solver's own, and with one of 1e-16 m/s.
    """

    def drift(lateral: float, seconds: float) -> Trajectory:
        """Return how the body moves that sets out with some lateral velocity (m/s)."""
        simulator = Simulator(scene.replace("initial.velocity", [_SPEED, lateral]))
        steps = round(seconds / simulator.time_step)
        return simulator.rollout(np.zeros((steps, elements - 1)))

    changes = {
        "beam.elements": elements,
        "beam.bending_stiffness": stiffness,
        "fluid.panels_per_element": _PANELS.get(elements, 4),
    }
    scene = load_scene("paper_x", changes)
    mass = rigid_mass(mass_matrix(Simulator(scene)))
    rate = growth_rate(mass, _SPEED)
    amplitude = mass.across * _LATERAL / (mass.along * _SPEED)
    trajectory = drift(_LATERAL, _WATCHED)
    angle = trajectory.angles.mean(axis=1)

    def misfit(x: np.ndarray) -> np.ndarray:
        model = x[1] * amplitude * (1.0 - np.cosh(x[0] * rate * trajectory.time))
        gap: np.ndarray = (model - angle) / abs(angle[-1])
        return gap

    fit = least_squares(misfit, [1.0, 1.0], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    alone, tiny = (np.abs(drift(lateral, 60.0).angles[-1]).max() for lateral in (0.0, 1e-16))
    return {
        "elements": elements,
        "stiffness": stiffness,
        "rate": float(fit.x[0]),
        "kirchhoff": rate,
        "alone": float(alone),
        "tiny": float(tiny),
    }
