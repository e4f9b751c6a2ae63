"""The kernels between actions and rewards: torques, observations, figures and ends of episodes.

The single and the batched environment call the same kernels, so each formula is written once and
both give the same bits. They work on rows of a batch, as `swim_env.physics.solve.advance.advance`
does, and share no code with it.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.physics.loading import load_kernels
from swim_env.physics.runtime.compile import entry_kernel, kernel
from swim_env.physics.solve.state import (
    COUNTERS,
    POSITIVE_WORK,
    RECORD_NAMES,
    STEPS,
    WORK,
    state_size,
    unexplained_share,
)

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: What an observation of 1 means: joint angles (rad), and per control interval joint rates (rad),
#: velocity (body lengths) and turning (rad). Random actions on scene swimmer give root mean squares
#: of 0.22, 0.27, 0.29 and 0.64; the tuned wave, at the first resonance, 1.3, 0.8, 2.2 and 0.44.
ANGLE_SCALE, RATE_SCALE, VELOCITY_SCALE, TURNING_SCALE = 0.1, 0.1, 0.002, 0.02
#: Version of the observation's layout, docs/environments/interface.md; what was trained on one
#: cannot use another.
OBSERVATION_LAYOUT = 3
#: Observations are clipped to this, so that the space is finite; sine and cosine have their own.
OBSERVATION_LIMIT = 100.0

#: The figures that are kept of every member, all of them floats. The coordinate counts the
#: progress: along the heading, or minus the distance (BL).
FIGURES = np.dtype(
    [
        (name, np.float64)
        for name in (
            *("reward", "reward_progress", "reward_effort", "reward_heading"),
            *("progress", "x", "y", "z", "heading_error", "distance", "work", "positive_work"),
            *("time", "coordinate", "coordinate_at_start", "energy_drift"),
        )
    ]
)

#: What `assess` knows of a task: body length and radius of the point (m), time step and control
#: interval (s), weight of the effort and of the heading (BL/s).
TASK_SETTINGS = np.dtype(
    [
        ("body_length", np.float64),
        ("time_step", np.float64),
        ("control_interval", np.float64),
        ("goal_is_point", np.bool_),
        ("radius", np.float64),
        ("effort_weight", np.float64),
        ("heading_weight", np.float64),
        ("actions_per_episode", np.int64),
    ],
    align=True,
)

#: Columns of the counters: actions since the start, the code of the reason for an end or 0, and 1
#: once the time is up.
ACTIONS_TAKEN, END_CODE, TIME_IS_UP = range(3)

#: Code of the end that a task has of its own, besides those of the physics.
REACHED = 9


@entry_kernel
def torques_of_actions(
    members: Indices, actions: Array, torque_of_one: Array, places: Indices, torques: Array
) -> int:
    """Write the torques (M, K) (N m) of members' actions (M, n), clipped to [-1, 1].

    The torque of an action of 1 (n,) (N m) is 0 where nothing drives a joint, and the places (n,)
    are the columns of the torques. Returned is -1, or n member + action of the first one that is
    not finite; then nothing is written.
    """
    for member in members:
        for i in range(actions.shape[1]):
            if not np.isfinite(actions[member, i]):
                bad: int = member * actions.shape[1] + i
                return bad
    for member in members:
        for i in range(actions.shape[1]):
            action = min(1.0, max(-1.0, actions[member, i]))
            torques[member, places[i]] = torque_of_one[i] * action
    return -1


@kernel
def observed(value: float) -> float:
    """Return a number as it is observed, within the limits."""
    return min(OBSERVATION_LIMIT, max(-OBSERVATION_LIMIT, value))


@kernel
def account(
    start: bool,
    task: Any,
    figure: Any,
    counter: Indices,
    record: Array,
    outcome: Indices,
    budget: Array,
    coordinate: float,
    distance: float,
    sine: float,
    cosine: float,
    effort: float,
    drives: int,
) -> None:
    """Write a member's figures and counters, but for its position; see `assess`.

    `effort` is the sum of squares of so many actions, sine and cosine are those of the angle from
    the head's direction to the goal's, coordinate and distance (m) are there now.
    """
    time_step = task["time_step"]
    taken = 0 if start else outcome[0]
    seconds = taken * time_step
    figure["time"] = time_step * budget[STEPS]
    figure["heading_error"] = np.arctan2(sine, cosine)
    figure["distance"] = distance / task["body_length"]
    figure["work"] = 0.0
    figure["positive_work"] = 0.0
    figure["energy_drift"] = unexplained_share(budget)
    if start:
        figure["coordinate"] = coordinate
        figure["coordinate_at_start"] = coordinate
        figure["progress"] = 0.0
        figure["reward"] = 0.0
        figure["reward_progress"] = 0.0
        figure["reward_effort"] = 0.0
        figure["reward_heading"] = 0.0
        counter[:] = 0
        return
    for step in range(taken):
        figure["work"] += record[step, WORK]
        figure["positive_work"] += record[step, POSITIVE_WORK]
    gained = coordinate - figure["coordinate"]
    figure["coordinate"] = coordinate
    figure["progress"] = coordinate - figure["coordinate_at_start"]
    figure["reward_progress"] = gained
    figure["reward_effort"] = 0.0 - task["effort_weight"] * effort / drives * seconds
    figure["reward_heading"] = 0.0 - task["heading_weight"] * max(0.0, 1.0 - cosine) * seconds
    figure["reward"] = gained + figure["reward_effort"] + figure["reward_heading"]
    code = outcome[1]
    if code == 0 and task["goal_is_point"] and distance <= task["radius"]:
        code = REACHED
    counter[ACTIONS_TAKEN] += 1
    counter[END_CODE] = code
    counter[TIME_IS_UP] = int(counter[ACTIONS_TAKEN] >= task["actions_per_episode"])


@entry_kernel
def assess(
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
    """Evaluate members after a start or an action: what they observe, gain and whether they end.

    At a start nothing has been gained. States, velocities, record and outcome are as
    `swim_env.physics.solve.advance.advance` leaves them, torques (M, N - 1) (N m) those that were
    held, places (N - 1,) their columns by action, goals (M, 2) unit vectors or points (m), settings
    (1,) the task's. The coordinates at the last evaluation, earlier (M, N + 2), observations
    (M, n), figures (M,) and counters (M, 3) are overwritten for these members.

    Rates and velocities are observed as means over the action: when torques jump, the stiffest
    modes ring, and no affordable time step resolves their velocities at one instant.
    """
    task = settings[0]
    length = task["body_length"]
    rate_of_one = RATE_SCALE / task["control_interval"]
    speed_of_one = VELOCITY_SCALE / task["control_interval"] * length
    turning_of_one = TURNING_SCALE / task["control_interval"]
    to_point = task["goal_is_point"]
    for member in members:
        unknowns = velocities.shape[1]
        joints = unknowns - 3
        q = states[member]
        velocity = velocities[member]
        seen = observations[member]
        seconds = 0.0 if start else outcome[member, 0] * task["time_step"]

        # By how much the coordinates move, and in how long (s): in the action, or at the velocity
        # of a start in a second.
        moves = earlier[member]
        if start:
            lasted = 1.0
            for i in range(unknowns):
                moves[i] = velocity[i] - (velocity[i - 1] if i > 2 else 0.0)
        else:
            lasted = seconds
            for i in range(unknowns):
                moves[i] = q[i] - moves[i]

        # The mean element angle, the head's direction, and the direction to the goal.
        angle = q[2]
        mean_angle = q[2]
        turned = moves[2]
        mean_turned = moves[2]
        for k in range(joints):
            angle += q[3 + k]
            mean_angle += angle
            turned += moves[3 + k]
            mean_turned += turned
        mean_angle /= joints + 1
        mean_turned /= joints + 1
        ahead_x = -np.cos(mean_angle)
        ahead_y = -np.sin(mean_angle)
        goal_x = goals[member, 0]
        goal_y = goals[member, 1]
        distance = 0.0
        if to_point:
            away_x = goal_x - q[0]
            away_y = goal_y - q[1]
            distance = np.hypot(away_x, away_y)
            # At the very point every direction is as good as straight ahead.
            goal_x = away_x / distance if distance > 0.0 else ahead_x
            goal_y = away_y / distance if distance > 0.0 else ahead_y
            coordinate = -distance / length
        else:
            coordinate = (q[0] * goal_x + q[1] * goal_y) / length
        cosine = ahead_x * goal_x + ahead_y * goal_y
        sine = ahead_x * goal_y - ahead_y * goal_x

        for k in range(joints):
            seen[k] = observed(q[3 + k] / ANGLE_SCALE)
        at = 2 * joints
        seen[at] = min(1.0, max(-1.0, sine))
        seen[at + 1] = min(1.0, max(-1.0, cosine))
        # Where not one step could be taken, all is as it was.
        if lasted > 0.0:
            for k in range(joints):
                seen[joints + k] = observed(moves[3 + k] / lasted / rate_of_one)
            velocity_x = moves[0] / lasted
            velocity_y = moves[1] / lasted
            forward = velocity_x * ahead_x + velocity_y * ahead_y
            leftward = velocity_y * ahead_x - velocity_x * ahead_y
            seen[at + 2] = observed(forward / speed_of_one)
            seen[at + 3] = observed(leftward / speed_of_one)
            seen[at + 4] = observed(mean_turned / lasted / turning_of_one)
        if to_point:
            seen[at + 5] = observed(distance / length)
        for i in range(unknowns):
            moves[i] = q[i]

        figure = figures[member]
        figure["x"] = q[0]
        figure["y"] = q[1]
        effort = 0.0
        for i in range(joints):
            if torque_of_one[i] > 0.0:
                part = torques[member, places[i]] / torque_of_one[i]
                effort += part * part
        account(
            start,
            task,
            figure,
            counters[member],
            record[member],
            outcome[member],
            q[-COUNTERS:],
            coordinate,
            distance,
            sine,
            cosine,
            effort,
            joints,
        )


@entry_kernel
def collect(
    observations: NDArray[np.float32],
    figures: Array,
    counters: Indices,
    seen: NDArray[np.float32],
    columns: Array,
    flags: NDArray[np.bool_],
) -> int:
    """Copy what a batched step returns into new arrays, and count the members at their end.

    One call for everything: a step of many members drives Python and NumPy out of the processor's
    caches, and then the first call of any other function takes tens of microseconds. Overwritten
    are seen (M, n) with the observations, columns (F, M) with the figures (M, F), and flags (2, M)
    with which members were terminated and whose time is up.
    """
    ended = 0
    for member in range(figures.shape[0]):
        for i in range(seen.shape[1]):
            seen[member, i] = observations[member, i]
        for i in range(figures.shape[1]):
            columns[i, member] = figures[member, i]
        flags[0, member] = counters[member, END_CODE] > 0
        flags[1, member] = counters[member, TIME_IS_UP] > 0
        if flags[0, member] or flags[1, member]:
            ended += 1
    return ended


@functools.cache
def load_collecting() -> None:
    """Load the kernels that environments of all scenes need."""
    one = np.zeros(1, dtype=np.int64)
    torques_of_actions(one, np.zeros((1, 1)), np.zeros(1), one, np.zeros((1, 1)))
    observations, flags = np.zeros((1, 8), dtype=np.float32), np.zeros((2, 1), dtype=np.bool_)
    figures, counters = np.zeros((1, len(FIGURES.names or ()))), np.zeros((1, 3), dtype=np.int64)
    collect(observations, figures, counters, observations.copy(), figures.T.copy(), flags)


@functools.cache
def load_assessment() -> None:
    """Load the physics' kernels and these, which must be done before any of them is called."""
    load_kernels()
    load_collecting()
    one = np.zeros(1, dtype=np.int64)
    assess(
        one,
        True,
        np.zeros((1, state_size(2))),
        np.zeros((1, 4)),
        np.zeros((1, 1)),
        np.zeros(1),
        one,
        np.zeros((1, 1, len(RECORD_NAMES))),
        np.zeros((1, 2), dtype=np.int64),
        np.array([[1.0, 0.0]]),
        np.ones(1, dtype=TASK_SETTINGS),
        np.zeros((1, 4)),
        np.zeros((1, 8), dtype=np.float32),
        np.zeros((1, len(FIGURES.names or ()))).view(FIGURES)[:, 0],
        np.zeros((1, 3), dtype=np.int64),
    )
