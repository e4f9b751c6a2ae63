"""The constants of a spatial scene as kernels read them, in a record of scalars and a vector."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.runtime.compile import shared
from swim_env.physics.solve.constants import (
    SolverConstants,
    record_of_scalars,
    unpack_solver,
)
from swim_env.physics.spatial.chain import SpatialBeam
from swim_env.physics.spatial.layout import SpatialFluid
from swim_env.physics.spatial.panels.surface import Surface

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
#: The record of scalars (1,), the numbers and the indices that `pack_constants` returns.
Constants = tuple[NDArray[np.void], Array, Integers]


class SpatialConstants(NamedTuple):
    """All constants of a scene in space."""

    beam: SpatialBeam
    fluid: SpatialFluid
    solver: SolverConstants
    surface: Surface


class _Counts(NamedTuple):
    """Sizes of the surface's arrays."""

    around: int
    ring_count: int


_SCALARS = record_of_scalars(SpatialBeam, SpatialFluid, SolverConstants, Surface, _Counts)


def pack_constants(scene: SpatialConstants) -> Constants:
    """Return what the entry points need to know of a scene: scalars, numbers and indices."""
    beam, fluid, solver, surface = scene
    values = {**surface._asdict(), **beam._asdict(), **fluid._asdict(), **solver._asdict()}
    values |= _Counts(surface.circle.shape[1], len(surface.rings))._asdict()
    scalars = np.array([tuple(values[name] for name in _SCALARS.names or ())], dtype=_SCALARS)
    numbers = [beam.mass, beam.inertia, beam.stiffness, beam.damping, beam.rest]
    numbers += [surface.circle, surface.rings, fluid.stream, fluid.added]
    indices = (surface.first, surface.ring_elements, surface.faces)
    return (
        scalars,
        np.concatenate([np.ravel(one) for one in numbers]),
        np.concatenate([np.ravel(one) for one in indices]),
    )


@shared
def unpack_constants(
    scalars: NDArray[np.void], vectors: Array, indices: Integers
) -> SpatialConstants:
    """Return the constants that `pack_constants` has put into arrays."""
    s = scalars[0]
    elements = s["elements"]
    joints = elements - 1
    # Three numbers for each element, nine for each joint, then the surface's.
    first = 3 * elements
    behind = first + 9 * joints
    beam = SpatialBeam(
        elements,
        s["element_length"],
        vectors[:elements],
        vectors[elements:first].reshape((elements, 2)),
        vectors[first : first + 3 * joints].reshape((joints, 3)),
        vectors[first + 3 * joints : first + 6 * joints].reshape((joints, 3)),
        vectors[first + 6 * joints : behind].reshape((joints, 3)),
        s["strain_of_angles"],
        s["smallest_momentum"],
        s["smallest_spin"],
    )
    rings, around = s["ring_count"], s["around"]
    faces = indices[elements + 1 + 2 * rings :]
    circle = vectors[behind : behind + 2 * around].reshape((2, around))
    behind += 2 * around
    surface = Surface(
        elements,
        s["element_length"],
        s["rows"],
        s["gauss"],
        s["density"],
        vectors[behind : behind + 3 * rings].reshape((rings, 3)),
        indices[elements + 1 : elements + 1 + 2 * rings].reshape((rings, 2)),
        s["first_row"],
        circle,
        faces.reshape((faces.size // 4, 4)),
        indices[: elements + 1],
    )
    behind += 3 * rings
    stream, added = vectors[behind : behind + 3], vectors[behind + 3 :]
    fluid = SpatialFluid(s["present"], s["coupled"], s["varies"], added, stream)
    return SpatialConstants(beam, fluid, unpack_solver(scalars), surface)


def no_surface(elements: int) -> Surface:
    """Return the surface of a body that has no panels."""
    none = np.zeros(0, dtype=np.int64)
    return Surface(
        *(elements, 1.0, 0, False, 0.0, np.zeros((0, 3)), none.reshape(0, 2), 0),
        *(np.zeros((2, 0)), none.reshape(0, 4), np.zeros(elements + 1, dtype=np.int64)),
    )
