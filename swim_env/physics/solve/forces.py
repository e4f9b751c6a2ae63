"""Internal forces between the elements, from the momentum balance of each of them.

The momentum of an element contains the fluid's impulse on its own panels. What it gets from its
neighbours is the change from its mean momentum in one step to that in the next, less the drag.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.planar.layout import Balance, Drag
from swim_env.physics.runtime.compile import kernel
from swim_env.physics.solve.state import STEPS, ForceWork, State

Array = NDArray[np.float64]


@kernel
def begin_forces(forces: ForceWork) -> None:
    """Begin to collect the momenta of a step."""
    forces.mean[:] = 0.0
    forces.push[:] = 0.0


@kernel
def add_momenta(
    share: float, with_drag: bool, balance: Balance, drag: Drag, forces: ForceWork
) -> None:
    """Add the momenta of a part, a share of the step, to their mean over it, and its drag."""
    for k in range(forces.mean.shape[1]):
        forces.mean[0, k] += share * balance.momentum[0, k]
        forces.mean[1, k] += share * balance.momentum[1, k]
        if with_drag:
            forces.push[0, k] += drag.impulse[0, k]
            forces.push[1, k] += drag.impulse[1, k]


@kernel
def find_forces(time_step: float, forces: ForceWork, state: State) -> None:
    """Find what every element gets from its neighbours at the beginning of a step that was taken.

    In the first step after a start it is not known: there is no step before.
    """
    for k in range(forces.mean.shape[1]):
        for i in range(2):
            mean, push = forces.mean[i, k], forces.push[i, k]
            forces.net[i, k] = (mean - 0.5 * push - state.past[i, k]) / time_step
            if state.counters[STEPS] == 0.0:
                forces.net[i, k] = np.nan
            state.past[i, k] = mean + 0.5 * push


@kernel
def write_forces(forces: ForceWork, out: Array) -> None:
    """Write the force (N) on what is in front of each joint by what is behind it, x and y."""
    x = 0.0
    y = 0.0
    for j in range(forces.net.shape[1] - 1):
        x += forces.net[0, j]
        y += forces.net[1, j]
        out[2 * j] = x
        out[2 * j + 1] = y
