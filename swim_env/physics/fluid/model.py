"""What a fluid model has to offer; each has a file of its own in this folder, with its name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.fluid.outline import FluidGeometry
from swim_env.scene import Fluid

Array = NDArray[np.float64]
#: Rough times (s) that a model adds to an evaluation of the residual, and takes for an added mass.
Costs = tuple[float, float]


class Model(NamedTuple):
    """A fluid model.

    Attributes
    ----------
    added_mass : kernel
        ``(joint_angles, fluid, work, out) -> int``: writes the symmetric added mass A (K, K), and
        returns 0 or the code of the reason why there is none.
    shape_force : kernel
        ``(motion, fluid, work, out)``: writes the derivative of V^T A V/2 by every element angle
        (N,), V held, for the shape that `added_mass` was called with last.
    varies : bool
        Whether A changes with the joint angles.
    terms : callable
        ``(fluid, geometry) -> array``: the constants that the kernels read from `fluid.terms`.
    panels : callable
        ``geometry -> int``: number of panels while it runs.
    squares : callable
        ``motions -> int``: numbers of scratch space that it takes.
    costs : callable
        ``(elements, panels) -> Costs``.
    sides : int
        Sides of an element that `fluid.panels_per_element` are spread over.
    """

    added_mass: Any
    shape_force: Any
    varies: bool = False
    terms: Callable[[Fluid, FluidGeometry], Array] = lambda fluid, geometry: np.zeros(0)
    panels: Callable[[FluidGeometry], int] = lambda geometry: 0
    squares: Callable[[int], int] = lambda motions: 0
    costs: Callable[[int, int], Costs] = lambda elements, panels: (0.0, 0.0)
    sides: int = 2
