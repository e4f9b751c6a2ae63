"""Runs a task's methods on the members that start or have moved, and keeps what they return."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim_env.envs.assessment import END_CODE, OBSERVATION_LIMIT
from swim_env.envs.tasks.base import Task
from swim_env.envs.tasks.layout import (
    METHODS,
    STATE,
    checked,
    checked_drawn,
    checked_state,
    named,
    standard_parts,
)
from swim_env.envs.tasks.moment import COLUMNS, Arrays, Moment
from swim_env.errors import TaskError

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_REWARD = COLUMNS["reward"]


class Hooks:
    """The methods of a task that are its own, for M members.

    Parameters
    ----------
    task : Task
        The task.
    arrays : Arrays
        The members' arrays. The task's state is added to them.
    codes : mapping
        Code of each of the task's reasons.

    Attributes
    ----------
    observations : (M, n) array of float32
        What each member observes, the kernel's own array where the task observes nothing else.
    terms, infos : (M, T) and (M, I) arrays
        The reward's terms and the figures for `info`, columns as in `Task.layout`.
    drawn : list of dict
        By member what `Task.draw_state` has drawn at its start.
    """

    def __init__(self, task: Task, arrays: Arrays, codes: Mapping[str, int]) -> None:
        self._task, self._arrays, self._codes = task, arrays, codes
        layout = self.layout = task.layout
        count = len(arrays.coordinates)
        arrays.state = checked_state(task, task.state(count), count)
        self._state_at_start = checked_state(task, task.state(1), 1)
        self._all = np.arange(count)
        self.drawn: list[dict[str, Any]] = [{} for _ in range(count)]
        self._own = {name for name in METHODS if task.overrides(name)}
        terms = layout.terms if "reward" in self._own else ()
        self._names = (*(f"reward_{name}" for name in terms), *layout.infos)
        self.terms = np.zeros((count, len(terms)))
        self.infos = np.zeros((count, len(layout.infos)))
        standard = standard_parts(task)
        self._aim, self._distance = standard["goal_direction"], standard.get("distance")
        self._copied: list[tuple[slice, slice]] = []
        #: Of parts of the task's own: columns in the observation, and in their own array.
        self._placed: dict[str, tuple[slice, slice]] = {}
        at = own = 0
        for name, size in layout.parts.items():
            here = slice(at, at := at + size)
            if name in layout.own_parts:
                self._placed[name] = here, slice(own, own := own + size)
            elif (
                self._copied
                and (last := self._copied[-1])[0].stop == here.start
                and (last[1].stop == standard[name].start)
            ):  # neighbours in both
                self._copied[-1] = (
                    slice(last[0].start, here.stop),
                    slice(last[1].start, standard[name].stop),
                )
            else:
                self._copied.append((here, standard[name]))
        self._own_values = np.zeros((count, own))
        self.observations = arrays.seen
        if list(layout.parts) != list(standard):
            self.observations = np.zeros((count, at), dtype=np.float32)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what decides how the episodes continue, by the names of a snapshot."""
        own = {f"{STATE}{name}": array for name, array in self._arrays.state.items()}
        return {"task_terms": self.terms, "task_infos": self.infos, **own}

    def told(self, member: int) -> dict[str, float]:
        """Return what a member's info has of the task's own."""
        return dict(zip(self._names, self._columns()[:, member].tolist(), strict=True))

    def told_of_all(self) -> dict[str, Array]:
        """Return what a batch's infos have of the task's own, new arrays (M,)."""
        return dict(zip(self._names, self._columns(), strict=True))

    def _columns(self) -> Array:
        columns: Array = np.concatenate([self.terms.T, self.infos.T])
        return columns

    def begin(self, member: int, drawn: Mapping[str, Any]) -> None:
        """Set a member's state to that of a start."""
        values = checked_drawn(self._task, drawn, self._state_at_start, member)
        self.drawn[member] = values
        for name, array in self._arrays.state.items():
            array[member] = values.get(name, self._state_at_start[name][0])

    def before(self) -> None:
        """Keep the coordinates before an action."""
        np.copyto(self._arrays.previous, self._arrays.coordinates)

    def run(self, members: Indices, start: bool) -> None:
        """Call the task's methods after a start or an action that the kernel has assessed."""
        if not len(members):  # all have ended
            return
        arrays, task, own = self._arrays, self._task, self._own
        whole = len(members) == len(self._all)
        if whole:
            members = self._all
        index: Any = slice(None) if whole else members
        if start:
            arrays.previous[index] = arrays.coordinates[index]
        now = task.geometry.moment(task.scene, arrays, members, whole, start)
        if "update" in own:
            task.update(now)
        if "update_goal" in own:
            self._aim_at(now, index)
        if "reward" in own:
            self._pay(now, index)
        if "ends" in own and not start:
            self._end(now, index)
        if self.observations is not arrays.seen:
            self._observe(now, index)
        if "info" in own:
            found = named(task, "info", task.info(now))
            for column, name in enumerate(self.layout.infos):
                self.infos[index, column] = self._checked("info", found, name, now)
        if not whole:
            for name, array in arrays.state.items():
                array[members] = now.state[name]

    def _checked(
        self, method: str, found: Mapping[str, Any], name: str, now: Moment
    ) -> NDArray[Any]:
        if name not in found:
            raise TaskError(
                f"task {self._task.name}: {method} must always return {name!r}, got "
                f"{', '.join(found) or 'nothing'}"
            )
        return checked(self._task, method, name, found[name], len(now.members), method == "observe")

    def _pay(self, now: Moment, index: Any) -> None:
        """Keep the reward and its terms, 0 at a start."""
        rewards = self._arrays.figures
        if now.start:
            self.terms[index] = 0.0
            rewards[index, _REWARD] = 0.0
            return
        found = named(self._task, "reward", self._task.reward(now))
        total: Array | None = None
        for column, name in enumerate(self.layout.terms):
            value = self._checked("reward", found, name, now).astype(np.float64, copy=False)
            self.terms[index, column] = value
            total = value if total is None else total + value
        assert total is not None
        if len(found) > len(self.layout.terms):
            more = ", ".join(found.keys() - set(self.layout.terms))
            raise TaskError(f"task {self._task.name}: reward returns a new term: {more}")
        if not np.isfinite(total).all():
            self._not_finite("reward", found, now)
        rewards[index, _REWARD] = total

    def _end(self, now: Moment, index: Any) -> None:
        """Keep the codes of members that end, unless the physics has ended them."""
        found = named(self._task, "ends", self._task.ends(now))
        codes = self._arrays.counters
        for name in self.layout.reasons:
            hit = self._checked("ends", found, name, now)
            if hit.any():
                some = now.members[hit]
                some = some[codes[some, END_CODE] == 0]
                codes[some, END_CODE] = self._codes[name]

    def _observe(self, now: Moment, index: Any) -> None:
        """Put the observation together."""
        observations, seen = self.observations, self._arrays.seen
        for here, there in self._copied:
            observations[index, here] = seen[index, there]
        if not self._placed:
            return
        found = named(self._task, "observe", self._task.observe(now))
        own = self._own_values[: len(now.members)]
        for name, (_, there) in self._placed.items():
            value = self._checked("observe", found, name, now)
            if value.ndim == 1:
                value = value[:, None]
            if value.shape[1] != there.stop - there.start:
                raise TaskError(
                    f"task {self._task.name}: {name!r} of observe must keep its shape, "
                    f"(m, {there.stop - there.start}) for m members, got {value.shape}"
                )
            own[:, there] = value
        if not np.isfinite(own).all():
            self._not_finite("observe", found, now)
        np.minimum(own, OBSERVATION_LIMIT, out=own)
        np.maximum(own, -OBSERVATION_LIMIT, out=own)
        for here, there in self._placed.values():
            observations[index, here] = own[:, there]

    def _aim_at(self, now: Moment, index: Any) -> None:
        """Give members their new goals, and all that the kernel has derived from the old ones."""
        task, figures = self._task, self._arrays.figures
        goals = np.asarray(task.update_goal(now), dtype=np.float64)
        if goals.shape != now.goal.shape:
            raise TaskError(
                f"task {task.name}: update_goal must return goals of shape {now.goal.shape} for "
                f"{len(now.members)} members, got {goals.shape}"
            )
        if not np.isfinite(goals).all():
            self._not_finite("update_goal", {"goal": goals}, now)
        self._arrays.goals[index] = goals
        now.goal = goals
        way = goals
        if self._distance is not None:
            away = goals - now.coordinates[:, : goals.shape[1]]
            length = np.hypot.reduce(away.T)
            distance = length / task.scene.beam.length
            figures[index, COLUMNS["distance"]] = distance
            distance = np.minimum(distance, OBSERVATION_LIMIT)
            self._arrays.seen[index, self._distance] = distance[:, None]
            # At the very point every direction is as good as straight ahead.
            there = (length > 0.0)[:, None]
            way = np.where(there, away / np.where(there, length[:, None], 1.0), now.ahead)
        seen, error = now.seen_direction(now.in_body(way))
        figures[index, COLUMNS["heading_error"]] = error
        np.minimum(seen, 1.0, out=seen)
        self._arrays.seen[index, self._aim] = np.maximum(seen, -1.0, out=seen)
        now.__dict__.pop("_figures", None)

    def _not_finite(self, method: str, found: Mapping[str, Any], now: Moment) -> None:
        """Say of which member something is not finite."""
        values = {name: np.asarray(value, dtype=np.float64) for name, value in found.items()}
        for name, value in values.items():
            rows = ~np.isfinite(value).reshape(len(value), -1).all(axis=1)
            if rows.any():
                row = int(np.flatnonzero(rows)[0])
                raise TaskError(
                    f"task {self._task.name}: {name!r} of {method} must be finite, got "
                    f"{value[row].tolist()} for member {now.members[row]} at "
                    f"{now.time[row]:g} s"
                )
        raise TaskError(f"task {self._task.name}: the sum of the reward's terms is not finite")
