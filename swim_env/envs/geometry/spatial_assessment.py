"""The kernels between actions and rewards in space; see `swim_env.envs.assessment`.

The body's frame is that of its mean rotation: forward = -d3, left = -d1 and up = d2 of the polar
factor of the elements' mean directors, or of the rotation that is nearest to all of theirs where
the polar factor is a reflection.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from swim_env.envs.assessment import (
    ANGLE_SCALE,
    FIGURES,
    RATE_SCALE,
    TASK_SETTINGS,
    TURNING_SCALE,
    VELOCITY_SCALE,
    account,
    load_collecting,
    observed,
)
from swim_env.physics.runtime.compile import entry_kernel, kernel
from swim_env.physics.runtime.dense import copy
from swim_env.physics.solve.state import COUNTERS, RECORD_NAMES
from swim_env.physics.spatial.layout import state_size
from swim_env.physics.spatial.loading import load_spatial_kernels
from swim_env.physics.spatial.rotations import quaternion_product, vector_of_quaternion

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: The body's frame (3, 3) row by row, with columns forward, left and up, and its quaternion (4,);
#: then scratch, as kernels make no arrays.
_FRAME, _SCRATCH = 13, 44
#: What is kept of a member beside its coordinates.
KEPT_BESIDE = _FRAME + _SCRATCH
#: Sweeps after which the frame's eigenvectors are exact to rounding.
_SWEEPS = 12


@kernel
def _diagonalise(matrix: Array, vectors: Array) -> int:
    """Find the eigenvectors of a symmetric matrix (4, 4), by Jacobi's rotations.

    The matrix is overwritten, the vectors are columns. Returned is the column of the largest
    eigenvalue.
    """
    for i in range(4):
        for j in range(4):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(_SWEEPS):
        rest = 0.0
        for i in range(3):
            for j in range(i + 1, 4):
                rest += abs(matrix[i, j])
        if rest == 0.0:
            break
        for i in range(3):
            for j in range(i + 1, 4):
                off = matrix[i, j]
                # What is lost in the sum with what it turns is no rotation.
                small = abs(off) * 1e-3
                if abs(matrix[i, i]) + small == abs(matrix[i, i]) and (
                    abs(matrix[j, j]) + small == abs(matrix[j, j])
                ):
                    matrix[i, j] = matrix[j, i] = 0.0
                    continue
                ratio = (matrix[j, j] - matrix[i, i]) / (2.0 * off)
                tangent = 1.0 / (abs(ratio) + math.sqrt(1.0 + ratio * ratio))
                if ratio < 0.0:
                    tangent = -tangent
                cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
                sine = tangent * cosine
                for k in range(4):
                    a, b = matrix[k, i], matrix[k, j]
                    matrix[k, i], matrix[k, j] = cosine * a - sine * b, sine * a + cosine * b
                for k in range(4):
                    a, b = matrix[i, k], matrix[j, k]
                    matrix[i, k], matrix[j, k] = cosine * a - sine * b, sine * a + cosine * b
                    a, b = vectors[k, i], vectors[k, j]
                    vectors[k, i], vectors[k, j] = cosine * a - sine * b, sine * a + cosine * b
    best = 0
    for i in range(1, 4):
        if matrix[i, i] > matrix[best, best]:
            best = i
    return best


@kernel
def write_frame(q: Array, work: Array, frame: Array) -> None:
    """Write the body's frame and quaternion (13,) of coordinates (4 N + 3,).

    Work space is (10, 4). The mean quaternion is the eigenvector of the largest eigenvalue of
    sum_k e_k e_k^T, e_k the elements' quaternions (Markley et al. 2007, doi:10.2514/1.28949): the
    rotation that is nearest to all of theirs in the Frobenius norm, as the polar factor of the
    mean is.
    """
    matrix, vectors = work[:4], work[4:8]
    element, turned = work[8], work[9]
    matrix[:] = 0.0
    for k in range((q.size - 3) // 4):
        own = q[3 + 4 * k : 7 + 4 * k]
        if k == 0:
            copy(own, element)
        else:
            quaternion_product(1.0, element, own, turned)
            copy(turned, element)
        for i in range(4):
            for j in range(4):
                matrix[i, j] += element[i] * element[j]
    best = _diagonalise(matrix, vectors)
    w, x, y, z = vectors[0, best], vectors[1, best], vectors[2, best], vectors[3, best]
    # Columns -d3, -d1 and d2.
    frame[0] = -2.0 * (x * z + w * y)
    frame[3] = -2.0 * (y * z - w * x)
    frame[6] = -(1.0 - 2.0 * (x * x + y * y))
    frame[1] = -(1.0 - 2.0 * (y * y + z * z))
    frame[4] = -2.0 * (x * y + w * z)
    frame[7] = -2.0 * (x * z - w * y)
    frame[2] = 2.0 * (x * y - w * z)
    frame[5] = 1.0 - 2.0 * (x * x + z * z)
    frame[8] = 2.0 * (y * z + w * x)
    frame[9], frame[10], frame[11], frame[12] = w, x, y, z


@kernel
def _along(frame: Array, column: int, x: float, y: float, z: float) -> float:
    """Return the component of a vector along one of the frame's axes."""
    component: float = frame[column] * x + frame[3 + column] * y + frame[6 + column] * z
    return component


@entry_kernel
def assess_in_space(
    members: Indices,
    start: bool,
    states: Array,
    velocities: Array,
    torques: Array,
    torque_of_one: Array,
    places: Indices,
    record: Array,
    outcome: Indices,
    goals: Array,
    settings: NDArray[np.void],
    earlier: Array,
    observations: NDArray[np.float32],
    figures: NDArray[np.void],
    counters: Indices,
) -> None:
    """Evaluate members after a start or an action, as `swim_env.envs.assessment.assess` does.

    Arrays are those of `swim_env.physics.spatial.advance.advance_spatial`, torques flattened,
    (M, 3 (N - 1)); goals (M, 3). What is kept of the last evaluation, earlier (M, 4 N + 60), are
    coordinates, the body's frame and scratch.
    """
    task = settings[0]
    length = task["body_length"]
    rate_of_one = RATE_SCALE / task["control_interval"]
    speed_of_one = VELOCITY_SCALE / task["control_interval"] * length
    turning_of_one = TURNING_SCALE / task["control_interval"]
    to_point = task["goal_is_point"]
    for member in members:
        elements = (velocities.shape[1] - 3) // 3
        coordinates = 4 * elements + 3
        joints = elements - 1
        state = states[member]
        q = state[:coordinates]
        velocity = velocities[member]
        seen = observations[member]
        kept = earlier[member, :coordinates]
        frame = earlier[member, coordinates : coordinates + _FRAME]
        scratch = earlier[member, coordinates + _FRAME :].reshape((11, 4))
        work, before, vector, old = scratch[:10], scratch[8], scratch[9], scratch[10]
        taken = 0 if start else outcome[member, 0]
        lasted = 1.0 if start else taken * task["time_step"]
        copy(frame[9:], old)
        write_frame(q, work, frame)

        goal_x, goal_y, goal_z = goals[member, 0], goals[member, 1], goals[member, 2]
        distance = 0.0
        if to_point:
            goal_x -= q[0]
            goal_y -= q[1]
            goal_z -= q[2]
            distance = math.sqrt(goal_x * goal_x + goal_y * goal_y + goal_z * goal_z)
            if distance > 0.0:
                goal_x /= distance
                goal_y /= distance
                goal_z /= distance
            else:  # at the very point every direction is as good as straight ahead
                goal_x, goal_y, goal_z = frame[0], frame[3], frame[6]
            coordinate = -distance / length
        else:
            coordinate = (q[0] * goal_x + q[1] * goal_y + q[2] * goal_z) / length

        at = 6 * joints
        for i in range(3):
            share = _along(frame, i, goal_x, goal_y, goal_z)
            seen[at + i] = min(1.0, max(-1.0, share))
        cosine = _along(frame, 0, goal_x, goal_y, goal_z)
        sine = math.hypot(
            _along(frame, 1, goal_x, goal_y, goal_z), _along(frame, 2, goal_x, goal_y, goal_z)
        )
        for j in range(joints):
            vector_of_quaternion(q[7 + 4 * j : 11 + 4 * j], vector)
            for i in range(3):
                seen[3 * j + i] = observed(vector[i] / ANGLE_SCALE)
            if lasted > 0.0:
                vector_of_quaternion(kept[7 + 4 * j : 11 + 4 * j], before)
                for i in range(3):
                    # A start moves as one rigid body.
                    rate = 0.0 if start else (vector[i] - before[i]) / lasted
                    seen[3 * joints + 3 * j + i] = observed(rate / rate_of_one)
        # Where not one step could be taken, all is as it was.
        if start:
            for i in range(3):
                speed = _along(frame, i, velocity[0], velocity[1], velocity[2])
                seen[at + 3 + i] = observed(speed / speed_of_one)
                turning = 0.0
                for k in range(elements):
                    own = velocity[3 + 3 * k : 6 + 3 * k]
                    turning += _along(frame, i, own[0], own[1], own[2])
                seen[at + 6 + i] = observed(turning / elements / turning_of_one)
        elif lasted > 0.0:
            for i in range(3):
                speed = _along(frame, i, q[0] - kept[0], q[1] - kept[1], q[2] - kept[2]) / lasted
                seen[at + 3 + i] = observed(speed / speed_of_one)
            # The rotation from the last frame to this one, whose axes (d1, d2, d3) are -left, up
            # and -forward.
            quaternion_product(-1.0, old, frame[9:], before)
            vector_of_quaternion(before, vector)
            turning_of_frame = (-vector[2], -vector[0], vector[1])
            for i in range(3):
                seen[at + 6 + i] = observed(turning_of_frame[i] / lasted / turning_of_one)
        if to_point:
            seen[at + 9] = observed(distance / length)
        copy(q, kept)

        budget = state[-COUNTERS:]
        figure = figures[member]
        figure["x"], figure["y"], figure["z"] = q[0], q[1], q[2]
        effort = 0.0
        for action in range(places.size):
            if torque_of_one[action] > 0.0:
                part = torques[member, places[action]] / torque_of_one[action]
                effort += part * part
        account(
            start,
            task,
            figure,
            counters[member],
            record[member],
            outcome[member],
            budget,
            coordinate,
            distance,
            sine,
            cosine,
            effort,
            places.size,
        )


@functools.cache
def load_spatial_assessment() -> None:
    """Load the spatial physics' kernels and these, before any of them is called."""
    load_spatial_kernels()
    load_collecting()
    assess_in_space(
        np.zeros(1, dtype=np.int64),
        True,
        np.zeros((1, state_size(2))),
        np.zeros((1, 9)),
        np.zeros((1, 3)),
        np.zeros(1),
        np.zeros(1, dtype=np.int64),
        np.zeros((1, 1, len(RECORD_NAMES))),
        np.zeros((1, 2), dtype=np.int64),
        np.array([[1.0, 0.0, 0.0]]),
        np.ones(1, dtype=TASK_SETTINGS),
        np.zeros((1, 11 + KEPT_BESIDE)),
        np.zeros((1, 16), dtype=np.float32),
        np.zeros((1, len(FIGURES.names or ()))).view(FIGURES)[:, 0],
        np.zeros((1, 3), dtype=np.int64),
    )
