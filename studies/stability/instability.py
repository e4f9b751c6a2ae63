"""The straight body's instability: the rate at which it leaves its line, and what starts it.

A stiff body that moves along itself is unstable: by Kirchhoff's equations a small lateral momentum
turns it like theta = (1 - cosh(lambda t)) m22 v/(m11 U) with
lambda^2 = U^2 m11 (m22 - m11)/(m22 I - g^2), m11, m22, I and g the body's own with the fluid's.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from swim_env.analysis.kirchhoff import growth_rate, mass_matrix, rigid_mass
from swim_env.scene import load_scene
from swim_env.sim.simulator import Simulator

__all__ = ["Onset", "measure_onset"]

_SPEED = 0.1
#: Lateral velocity (m/s) small enough for the linear equations over the time (s) that is watched.
_LATERAL, _WATCHED = 1e-7, 40.0
#: Panels per element of the paper's three cases, and of others.
_PANELS = {3: 12}


@dataclass(frozen=True)
class Onset:
    """How a straight body of N elements leaves its line.

    Attributes
    ----------
    elements : int
        N.
    stiffness : float
        EI (N m^2).
    rate : float
        The rate that was fitted, over Kirchhoff's.
    kirchhoff : float
        Kirchhoff's rate (1/s) with the discrete body's own mass.
    alone, tiny : float
        Largest angle of an element after 60 s (rad) without any perturbation but the solver's own,
        and with one of 1e-16 m/s.
    """

    elements: int
    stiffness: float
    rate: float
    kirchhoff: float
    alone: float
    tiny: float

    def to_dict(self) -> dict[str, Any]:
        """Return the fields by name, for JSON."""
        return asdict(self)


def measure_onset(elements: int, stiffness: float) -> Onset:
    """Measure how a body leaves its line at 0.1 m/s.

    Parameters
    ----------
    elements : int
        N.
    stiffness : float
        EI (N m^2).
    """
    simulator = _simulator(elements, stiffness, _LATERAL)
    mass = rigid_mass(mass_matrix(simulator))
    rate = growth_rate(mass, _SPEED)
    amplitude = mass.across * _LATERAL / (mass.along * _SPEED)
    steps = round(_WATCHED / simulator.time_step)
    trajectory = simulator.rollout(np.zeros((steps, elements - 1)))
    angle = trajectory.angles.mean(axis=1)

    def misfit(x: np.ndarray) -> np.ndarray:
        model = x[1] * amplitude * (1.0 - np.cosh(x[0] * rate * trajectory.time))
        gap: np.ndarray = (model - angle) / abs(angle[-1])
        return gap

    fit = least_squares(misfit, [1.0, 1.0], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    left = []
    for lateral in (0.0, 1e-16):
        other = _simulator(elements, stiffness, lateral)
        run = other.rollout(np.zeros((round(60.0 / other.time_step), elements - 1)))
        left.append(float(np.abs(run.angles[-1]).max()))
    return Onset(elements, stiffness, float(fit.x[0]), rate, *left)


def _simulator(elements: int, stiffness: float, lateral: float) -> Simulator:
    return Simulator(
        load_scene(
            "paper_x",
            {
                "beam.elements": elements,
                "beam.bending_stiffness": stiffness,
                "fluid.panels_per_element": _PANELS.get(elements, 4),
                "initial.velocity": [_SPEED, lateral],
            },
        )
    )
