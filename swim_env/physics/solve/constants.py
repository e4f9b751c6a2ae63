"""The constants of a scene as kernels read them: beam, fluid and solver, packed by name.

Handing over nested tuples at every call would take longer than all other arguments together, so a
scene's numbers travel in two arrays: one record of named scalars, and one vector of numbers per
joint and per fluid model.
"""

from __future__ import annotations

from typing import NamedTuple, get_type_hints

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.layout import FluidConstants
from swim_env.physics.fluid.outline import FluidGeometry
from swim_env.physics.planar.chain import BeamConstants
from swim_env.physics.runtime.compile import shared

Array = NDArray[np.float64]
#: The record of scalars (1,) and the vector of numbers that `pack_constants` returns.
Constants = tuple[NDArray[np.void], Array]


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


_KINDS: dict[object, type] = {int: np.int64, float: np.float64, bool: np.bool_}


def record_of_scalars(*classes: type) -> np.dtype[np.void]:
    """Return the record of all numbers and flags that classes of constants have, by name."""
    kinds = {name: kind for one in classes for name, kind in get_type_hints(one).items()}
    found = [(name, _KINDS[kind]) for name, kind in kinds.items() if kind in _KINDS]
    return np.dtype(found, align=True)


_SCALARS = record_of_scalars(BeamConstants, FluidGeometry, FluidConstants, SolverConstants)


def pack_constants(
    beam: BeamConstants, fluid: FluidConstants, solver: SolverConstants
) -> Constants:
    """Return what the entry points need to know of a scene, as two arrays."""
    values = {**beam._asdict(), **fluid.geometry._asdict(), **fluid._asdict(), **solver._asdict()}
    scalars = np.array([tuple(values[name] for name in _SCALARS.names or ())], dtype=_SCALARS)
    return scalars, np.concatenate([beam.joint_stiffness, beam.joint_damping, fluid.terms])


@shared
def unpack_constants(
    scalars: NDArray[np.void], vectors: Array
) -> tuple[BeamConstants, FluidConstants, SolverConstants]:
    """Return the constants that `pack_constants` has put into arrays."""
    s = scalars[0]
    elements = s["elements"]
    joints = elements - 1
    beam = BeamConstants(
        elements,
        s["element_length"],
        s["element_mass"],
        s["element_inertia"],
        vectors[:joints],
        vectors[joints : 2 * joints],
        s["strain_of_angles"],
        s["linear_strain"],
        s["contact_radius"],
        s["smallest_momentum"],
        s["smallest_spin"],
    )
    fluid = FluidConstants(
        s["model"],
        FluidGeometry(
            elements, s["element_length"], s["half_thickness"], s["side_panels"], s["cap_panels"]
        ),
        s["density"],
        s["present"],
        s["varies"],
        s["panels"],
        s["squares"],
        s["axial"],
        vectors[2 * joints :],
        s["drag"],
        s["stream_x"],
        s["stream_y"],
    )
    return beam, fluid, unpack_solver(scalars)


@shared
def unpack_solver(scalars: NDArray[np.void]) -> SolverConstants:
    """Return the constants of the integrator from a record of scalars."""
    s = scalars[0]
    return SolverConstants(
        s["time_step"],
        s["tolerance"],
        s["evaluation_cost"],
        s["added_mass_cost"],
        s["matrix_cost"],
        s["composed"],
        s["forces"],
        s["energy_tolerance"],
    )
