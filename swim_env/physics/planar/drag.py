"""Quadratic cross-flow drag of the elements: impulse, moment, loss, and derivatives in a step.

The force per length on a place that moves with u along the normal, -rho C |u| u/2, is summed at two
Gauss points of every element, exact where the sign of u does not change along it. Velocity and
normal are those of the middle of the step, so the drag is of second order in time and takes energy
in every step. Half its impulse acts at each end of the step.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.planar.chain import BeamConstants, sum_from_centres
from swim_env.physics.planar.layout import Balance, Drag, Increment, Pose
from swim_env.physics.runtime.compile import kernel

Array = NDArray[np.float64]


@kernel
def _drag_terms(
    z: Array,
    h: float,
    beam: BeamConstants,
    coefficient: float,
    pose: Pose,
    inc: Increment,
    drag: Drag,
) -> None:
    """Collect the impulse over the step, and its slopes; `coefficient` is rho C/2 (kg/m^2)."""
    elements = beam.elements
    dl = beam.element_length
    arm = dl / (2.0 * math.sqrt(3.0))
    weight = 0.5 * coefficient * dl
    rate = 1.0 / h
    turn = 0.0
    total_x = 0.0
    total_y = 0.0
    for k in range(elements):
        turn += z[2 + k]
        normal_x = pose.d1[0, k] * inc.half_cosine[k] - pose.d3[0, k] * inc.half_sine[k]
        normal_y = pose.d1[1, k] * inc.half_cosine[k] - pose.d3[1, k] * inc.half_sine[k]
        across = rate * (normal_x * inc.shift[0, k] + normal_y * inc.shift[1, k])
        front = across - arm * rate * turn
        back = across + arm * rate * turn
        impulse = -h * weight * (abs(front) * front + abs(back) * back)
        drag.impulse[0, k] = impulse * normal_x
        drag.impulse[1, k] = impulse * normal_y
        drag.moment[k] = -h * weight * arm * (abs(back) * back - abs(front) * front)
        drag.slope[k] = 2.0 * weight * (abs(front) + abs(back))
        drag.cross[k] = 2.0 * weight * arm * (abs(back) - abs(front))
        drag.turn_slope[k] = arm * arm * drag.slope[k]
        total_x += drag.impulse[0, k]
        total_y += drag.impulse[1, k]
    sum_from_centres(drag.impulse, total_x, total_y, dl, drag.lever)


@kernel
def add_drag(
    z: Array,
    h: float,
    beam: BeamConstants,
    coefficient: float,
    pose: Pose,
    inc: Increment,
    balance: Balance,
    drag: Drag,
) -> None:
    """Add the drag to residual, scale and change of the momentum of `balance`."""
    _drag_terms(z, h, beam, coefficient, pose, inc, drag)
    b = balance
    size = 0.0
    for k in range(beam.elements):
        b.residual[0] += 0.5 * drag.impulse[0, k]
        b.residual[1] += 0.5 * drag.impulse[1, k]
        b.change[0] += drag.impulse[0, k]
        b.change[1] += drag.impulse[1, k]
        size += abs(drag.impulse[0, k]) + abs(drag.impulse[1, k])
        arm = pose.d1[0, k] * drag.lever[0, k] + pose.d1[1, k] * drag.lever[1, k]
        new_arm = inc.new_d1[0, k] * drag.lever[0, k] + inc.new_d1[1, k] * drag.lever[1, k]
        b.residual[2 + k] += 0.5 * (drag.moment[k] + arm)
        b.change[2 + k] += drag.moment[k] + 0.5 * (arm + new_arm)
        turning = abs(drag.moment[k]) + abs(arm)
        b.scale[2 + k] = max(b.scale[2 + k], turning)
        b.size[2 + k] += turning
    for i in range(2):
        b.scale[i] = max(b.scale[i], size)
        b.size[i] += size


@kernel
def drag_loss(z: Array, h: float, inc: Increment, drag: Drag) -> float:
    """Return the energy (J) that the drag took in the step of the last evaluation, at least 0."""
    turn = 0.0
    loss = 0.0
    for k in range(z.size - 2):
        turn += z[2 + k]
        loss -= (
            drag.impulse[0, k] * inc.shift[0, k]
            + drag.impulse[1, k] * inc.shift[1, k]
            + drag.moment[k] * turn
        )
    return loss / h


@kernel
def drag_moment(pose: Pose, inc: Increment, drag: Drag) -> float:
    """Return the drag's angular impulse about the mean centre in the last evaluation (kg m^2/s)."""
    moment = 0.0
    for k in range(drag.moment.size):
        mean_x = 0.5 * (pose.d1[0, k] + inc.new_d1[0, k])
        mean_y = 0.5 * (pose.d1[1, k] + inc.new_d1[1, k])
        moment += drag.moment[k] + mean_x * drag.lever[0, k] + mean_y * drag.lever[1, k]
    return moment
