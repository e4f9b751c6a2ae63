"""The constants of a scene as kernels read them: beam, fluid and solver."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swim_env.physics.fluid.layout import SAMPLE, FluidConstants
from swim_env.physics.planar.chain import BeamConstants
from swim_env.physics.runtime.references import reader


class SolverConstants(NamedTuple):
    """Constants of the integrator.

    Attributes
    ----------
    time_step : float
        dt (s).
    tolerance : float
        Largest scaled residual accepted.
    evaluation_cost, added_mass_cost, matrix_cost : float
        What an evaluation of the residual, one of the added mass, and a matrix of N + 2 rows with
        its factors take, as shares of the effort that an outer step may take before it ends
        unsolved. They depend on sizes alone, not on a clock, so that results do not depend on the
        machine; 0 for no bound.
    composed : bool
        Whether a step is one of half the length followed by its adjoint.
    forces : bool
        Whether internal forces are found and written to the trace.
    energy_tolerance : float
        Share of the energy that went through beyond which energy that nothing explains ends a run.
    """

    time_step: float
    tolerance: float
    evaluation_cost: float = 0.0
    added_mass_cost: float = 0.0
    matrix_cost: float = 0.0
    composed: bool = False
    forces: bool = False
    energy_tolerance: float = np.inf


class Constants(NamedTuple):
    """All constants of a planar scene, which kernels read by reference."""

    beam: BeamConstants
    fluid: FluidConstants
    solver: SolverConstants


#: Constants of the types that all have.
SAMPLE_SCENE = Constants(
    BeamConstants(2, 0.5, 0.1, 1e-3, np.zeros(1), np.zeros(1)), SAMPLE, SolverConstants(0.01, 1e-10)
)
#: Returns the constants whose words a kernel is given.
constants_at = reader(lambda: SAMPLE_SCENE)
