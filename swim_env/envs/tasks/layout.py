"""What a task observes, rewards and tells: names and sizes, found by calling its methods once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swim_env.envs.assessment import FIGURES, OBSERVATION_LIMIT
from swim_env.envs.tasks.moment import Arrays
from swim_env.errors import TaskError
from swim_env.physics.status import TERMINATION_REASONS as PHYSICS_REASONS
from swim_env.scene.checks import nearest

if TYPE_CHECKING:
    from swim_env.envs.tasks.base import Task

Array = NDArray[np.float64]

#: Parts of an observation that every task has, in the order of the kernel; the last one where the
#: goal is a point.
STANDARD_PARTS = (
    *("joint_angles", "joint_rates", "goal_direction", "velocity", "turning_rate", "distance"),
)
#: What the kernel tells beside the reward's terms, whatever the task, and where it is a point.
TOLD = ("progress", "heading_error", "work", "positive_work", "energy_drift")
#: Terms of the reward where a task has none of its own.
TERMS = ("progress", "effort", "heading")
#: Methods of a task that see a `Moment`.
METHODS = ("update", "update_goal", "reward", "ends", "observe", "info")
#: Keys of an info that no task's own may have.
_TAKEN = ("time", "position", "termination_reason", "termination_code", "target", "is_success")
#: What `EnvSnapshot` calls a task's state.
STATE = "task_state_"


class Layout(NamedTuple):
    """What a task's methods return.

    Attributes
    ----------
    parts : dict of str to int
        Parts of the observation, with their sizes.
    own_parts : tuple of str
        Those that `Task.observe` returns.
    terms : tuple of str
        Of the reward.
    infos : tuple of str
        What `Task.info` returns.
    reasons : tuple of str
        What `Task.ends` returns.
    is_own : bool
        Whether any of the methods is the task's own, or what it observes: else the kernel is all
        there is to it.
    """

    parts: dict[str, int]
    own_parts: tuple[str, ...]
    terms: tuple[str, ...]
    infos: tuple[str, ...]
    reasons: tuple[str, ...]
    is_own: bool

    def bounds(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the least and the largest observations, (n,) each."""
        low, high = [], []
        for name, size in self.parts.items():
            limit = 1.0 if name == "goal_direction" else OBSERVATION_LIMIT
            low += [0.0 if name == "distance" else -limit] * size
            high += [limit] * size
        return np.array(low, dtype=np.float32), np.array(high, dtype=np.float32)


def standard_parts(task: Task) -> dict[str, slice]:
    """Return the columns of the STANDARD_PARTS in what the kernel observes."""
    sizes = dict(task.geometry.part_sizes)
    if task.goal_is_point:
        sizes["distance"] = 1
    ends = np.cumsum(list(sizes.values())).tolist()
    return {
        name: slice(end - size, end) for (name, size), end in zip(sizes.items(), ends, strict=True)
    }


def standard_size(task: Task) -> int:
    """Return the number of quantities that the kernel observes."""
    return max(int(column.stop) for column in standard_parts(task).values())


def layout_of(task: Task) -> Layout:
    """Call a task's methods once, of several members at its start, and check what they return."""
    geometry, standard = task.geometry, standard_parts(task)
    size = standard_size(task)
    start = task.draw_start(np.random.default_rng(0), task.plan_start({"noise": 0.0}))
    count = geometry.kept + size  # no other axis has this length
    kept = np.zeros((count, geometry.kept))
    kept[:, : len(start.coordinates)] = start.coordinates
    figures = len(FIGURES.names or ())
    arrays = Arrays(
        kept,
        kept.copy(),
        np.tile(start.velocity, (count, 1)),
        np.zeros((count, 1, *geometry.joint_shape)),
        np.full((count, 2), (task.scene.steps_per_action, 0)),
        np.tile(start.goal, (count, 1)),
        np.zeros((count, figures)),
        np.zeros((count, 3), dtype=np.int64),
        np.zeros((count, size), dtype=np.float32),
        checked_state(task, task.state(count), count),
    )
    checked_drawn(task, start.state, arrays.state, 0)
    members = np.arange(count)
    own: dict[str, dict[str, Any]] = {}
    with np.errstate(all="ignore"):  # this start is none: there are no figures of it
        for is_start in (True, False):
            now = geometry.moment(task.scene, arrays, members, True, is_start)
            task.update(now)
            if task.overrides("update_goal"):
                goal = np.asarray(task.update_goal(now))
                if goal.shape != arrays.goals.shape:
                    raise TaskError(
                        f"task {task.name}: update_goal must return goals of shape "
                        f"{arrays.goals.shape} for {count} members, got {goal.shape}"
                    )
            for method in ("observe", "info", *([] if is_start else ["reward", "ends"])):
                found = named(task, method, getattr(task, method)(now))
                before = own.setdefault(method, found)
                if before.keys() != found.keys():
                    raise TaskError(
                        f"task {task.name}: {method} must return the same names at a start and "
                        f"after an action, got {', '.join(before) or 'none'} and "
                        f"{', '.join(found) or 'none'}"
                    )
                for name, value in found.items():
                    checked(task, method, name, value, count, method == "observe")
    if not own["reward"]:
        raise TaskError(f"task {task.name}: reward must return at least one term")
    taken = {*_TAKEN, "success", *(f"reward_{one}" for one in own["reward"])}
    for name in [name for name in own["info"] if name in taken]:
        raise TaskError(f"task {task.name}: info cannot return {name!r}, which there is already")
    sizes = {name: _size(value) for name, value in own["observe"].items()}
    parts = _parts(task, {name: at.stop - at.start for name, at in standard.items()}, sizes)
    return Layout(
        parts,
        tuple(sizes),
        tuple(own["reward"]),
        tuple(own["info"]),
        _reasons(task, own["ends"]),
        any(map(task.overrides, METHODS)) or list(parts) != list(standard),
    )


def _size(value: Any) -> int:
    shape = np.shape(value)
    return int(shape[1]) if len(shape) > 1 else 1


def _parts(task: Task, standard: dict[str, int], own: dict[str, int]) -> dict[str, int]:
    """Return all parts of the observation with their sizes."""
    known = {**standard, **own}
    for name in own.keys() & set(STANDARD_PARTS):
        raise TaskError(f"task {task.name}: observe cannot return {name!r}, a standard part")
    chosen = list(task.parts or standard)
    for name in chosen:
        if name not in known:
            raise TaskError(
                f"task {task.name}: unknown part {name!r}{nearest(str(name), known)} of the "
                f"observation; parts: {', '.join(known)}"
            )
    chosen += [name for name in own if name not in chosen]
    if len(set(chosen)) < len(chosen):
        raise TaskError(f"task {task.name}: parts must differ, got {', '.join(chosen)}")
    return {name: known[name] for name in chosen}


def _reasons(task: Task, found: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the reasons for an end, in the order in which they count."""
    if found.keys() != task.reasons.keys():
        raise TaskError(
            f"task {task.name}: ends must return its reasons ({', '.join(task.reasons) or 'none'})"
            f", got {', '.join(found) or 'none'}"
        )
    for name in task.reasons:
        if name in (*PHYSICS_REASONS.values(), "target_reached"):
            raise TaskError(f"task {task.name}: {name!r} is a reason already")
    for name in task.successes:
        if name not in task.reasons:
            raise TaskError(f"task {task.name}: success {name!r} is none of its reasons")
    return tuple(found)


def named(task: Task, method: str, found: object) -> dict[str, Any]:
    """Return what a method has returned if it is arrays by name."""
    if type(found) is dict:  # in every step; a name that is none is missed where it is read
        return found
    if not isinstance(found, Mapping) or not all(isinstance(name, str) for name in found):
        raise TaskError(
            f"task {task.name}: {method} must return arrays by name, got {type(found).__name__}"
        )
    return dict(found)


def checked(
    task: Task, method: str, name: str, value: object, count: int, wide: bool = False
) -> NDArray[Any]:
    """Return an array of one of a task's methods, or say in a TaskError what it should be."""
    array = value if type(value) is np.ndarray else np.asarray(value)
    booleans = method == "ends"
    shape_fits = array.shape == (count,) or (wide and array.ndim == 2 and len(array) == count)
    if shape_fits and array.size and array.dtype.kind in ("b" if booleans else "fiu"):
        return array
    shape = f"({count},) or ({count}, k)" if wide else f"({count},)"
    raise TaskError(
        f"task {task.name}: {name!r} of {method} must be {'bools' if booleans else 'numbers'} of "
        f"shape {shape} for {count} members, got {array.dtype} of shape {array.shape}"
    )


def checked_state(task: Task, found: object, count: int) -> dict[str, NDArray[Any]]:
    """Return a task's state of so many members."""
    state = named(task, "state", found)
    for name, array in state.items():
        if not isinstance(array, np.ndarray) or array.ndim == 0 or len(array) != count:
            raise TaskError(
                f"task {task.name}: {name!r} of state must be an array whose first axis is the "
                f"member, {count} for {count} members, got "
                f"{array.shape if isinstance(array, np.ndarray) else type(array).__name__}"
            )
        if array.dtype.kind not in "fiub":
            raise TaskError(f"task {task.name}: {name!r} of state must be numbers or bools")
    return state


def checked_drawn(
    task: Task, found: object, state: Mapping[str, NDArray[Any]], member: int
) -> dict[str, Any]:
    """Return what was drawn of a member's state if it fits the state's arrays."""
    drawn = named(task, "draw_state", found)
    for name, value in drawn.items():
        if name not in state:
            raise TaskError(f"task {task.name}: draw_state returns {name!r}, state does not")
        array, wanted = np.asarray(value), state[name]
        shape = wanted.shape[1:]
        if array.shape != shape or not np.can_cast(array.dtype, wanted.dtype, "same_kind"):
            raise TaskError(
                f"task {task.name}: {name!r} of draw_state must be {wanted.dtype} of shape "
                f"{shape}, as in state, got {array.dtype} of shape {array.shape} for member "
                f"{member}"
            )
    return drawn
